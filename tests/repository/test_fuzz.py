"""A sample of what `make verify` feeds to the readers of users' files; and nothing is run that was
read.
"""

import ast
import re
from pathlib import Path

import pytest
from fuzzing import READERS, SEEDS, fuzz, kinds, refusal

from workbench.course import running
from workbench.imports import module_of_file, our_files


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for name in READERS for kind in kinds(name)]
)
def test_wrong_files_are_taken_or_refused(name, kind):
    assert sum(fuzz(name, kind, 40).values()) >= 40


@pytest.mark.parametrize("name", READERS)
def test_valid_files_are_taken(name):
    for seed in SEEDS[name]:
        assert refusal(name, seed) is None


# --- nothing that was read is run

RUN = {"eval", "exec", "compile", "__import__", "system", "popen", "read_pickle", "to_pickle"}
UNPICKLE = {
    "pickle",
    "cPickle",
    "dill",
    "joblib",
    "marshal",
    "shelve",
    "cloudpickle",
    "yaml",
    "jsonpickle",
    "runpy",
}


def dangers(source):
    """Calls and imports in a module's source that could run what a file says."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] in UNPICKLE)
        elif isinstance(node, ast.ImportFrom):
            yield from ({node.module or "", *(alias.name for alias in node.names)} & UNPICKLE)
        elif isinstance(node, ast.Call):
            name = (
                node.func.attr
                if isinstance(node.func, ast.Attribute)
                else getattr(node.func, "id", "")
            )
            allowed = {
                key.arg
                for key in node.keywords
                if isinstance(key.value, ast.Constant) and not key.value.value
            }
            if name in RUN and ast.unparse(node.func) != "re.compile":
                yield name
            if name == "load" and "np" in ast.unparse(node.func) and "allow_pickle" not in allowed:
                yield "load"
            if any(key.arg == "shell" and key.arg not in allowed for key in node.keywords):
                yield "shell"


# What a student hands in is to be run: in a process of its own, from which plain data come back.
# The cells of a notebook that is swept are run in a process of their own. A table of Anipose's is a pickle, of which
# numbers alone are read: `calibration.tables` refuses all that could run. Kalibr's YAML is read by the safe loader
# of PyYAML, which makes plain data.
RUN_ON_PURPOSE = {
    "trinolab.calibration.tables",
    "trinolab.files.foreign",
    # cells and sweeps on a page, which the reader runs in a browser
    "workbench.browser.guest.session",
    "workbench.browser.guest.sweeping",
    "workbench.course.child",
    "workbench.course.running",
    "workbench.sweep.cells",  # which compiles a cell to look for names, and does not run it
    "workbench.sweep.forking",
}


def test_nothing_that_was_read_is_run():
    found = {
        module_of_file(path): list(dangers(path.read_text(encoding="utf-8")))
        for path in our_files()
        if path.parent.name != "pages"  # what builds the book reads the repository's own files
    }
    assert {name for name, calls in found.items() if calls} == RUN_ON_PURPOSE


def test_what_comes_back_from_a_student_s_process_is_never_unpickled():
    """Without processes, in a browser, a copy of what this one has pickled itself is run."""
    source = Path(running.__file__).read_text(encoding="utf-8")
    without_processes = (
        "if not HAS_PROCESSES:\n        return _run_here(pickle.loads(pickled), calls)"
    )
    assert source.count(without_processes) == 1
    others = source.replace(without_processes, "")
    assert set(re.findall(r"pickle\.(\w+)", others)) == {"dumps"}


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from pickle import loads",
        "import joblib as j",
        "eval(text)",
        "builtins.exec(text)",
        "import numpy as np; np.load(f)",
        "np.load(f, allow_pickle=True)",
        "pd.read_pickle(f)",
        "os.system(text)",
        "from marshal import load",
        "subprocess.run(text, shell=True)",
        "__import__(name)",
        "import yaml",
    ],
)
def test_what_would_run_a_file_is_found(line):
    assert list(dangers(line))


@pytest.mark.parametrize(
    "line",
    [
        "np.load(f, allow_pickle=False)",
        "ast.literal_eval(text)",
        "json.loads(text)",
        "tomllib.load(f)",
        "re.compile(text)",
        "subprocess.run(line, shell=False)",
    ],
)
def test_what_is_harmless_is_not(line):
    assert list(dangers(line)) == []
