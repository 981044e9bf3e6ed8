"""What a result is made from: the files that its code imports, and what a change in one of them
makes stale.
"""

import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from workbench import imports, provenance
from workbench.imports import imported_files
from workbench.provenance import (
    made_from_function,
    made_from_notebook,
)

ROOT = Path(__file__).resolve().parents[2]
WING = ("pack/wing/__init__.py", "pack/wing/deep.py", "pack/wing/inner.py")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A small package in place of ours, and a folder beside it that has one module."""
    files = {
        "pack/__init__.py": "",
        "pack/base.py": "",
        "pack/typed.py": "",
        "pack/lazy.py": "from . import base",
        "pack/alone.py": "import numpy",
        "pack/user.py": "import numpy as np\nfrom typing import TYPE_CHECKING\nfrom .wing.inner import f\n"
        "if TYPE_CHECKING:\n    from . import typed\ndef g():\n    from .lazy import h\n",
        "pack/wing/__init__.py": "",
        "pack/wing/inner.py": "from ..wing import deep\nfrom ..base import nothing",
        "pack/wing/deep.py": "from . import inner",
        "mine/helper.py": "import pack.alone",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(imports, "PACKAGES", {"pack": tmp_path / "pack"})
    monkeypatch.setattr(imports, "FACED", "pack")
    monkeypatch.setattr(imports, "FACE", {"work": "pack.lazy:work", "wing": "pack.wing"})
    return tmp_path


def names(root, source, folder="mine"):
    return {path.relative_to(root).as_posix() for path in imported_files(source, root / folder)}


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import os, numpy", set()),
        ("import pack", {"pack/__init__.py"}),
        ("from pack import base as b, no_module", {"pack/__init__.py", "pack/base.py"}),
        ("import helper", {"mine/helper.py", "pack/__init__.py", "pack/alone.py"}),
        ("from pack.wing.deep import f", {"pack/__init__.py", "pack/base.py", *WING}),
        # a name of the face
        ("import pack\npack.work(1)", {"pack/__init__.py", "pack/lazy.py", "pack/base.py"}),
        (
            "import pack as p\np.work(1)",
            {"pack/__init__.py", "pack/lazy.py", "pack/base.py", "pack/wing/__init__.py"},
        ),
        (  # what only a type checker reads is not loaded, what stands in its place is
            "if TYPE_CHECKING:\n    import pack.typed\nelse:\n    import pack.base",
            {"pack/__init__.py", "pack/base.py"},
        ),
        (
            "def f():\n    from pack import user",
            {"pack/__init__.py", "pack/user.py", "pack/lazy.py", "pack/base.py", *WING},
        ),
    ],
)
def test_imports_are_followed_in_every_form(package, source, expected):
    assert names(package, source) == expected


def notebook_of(*cells):
    return nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])


def test_a_notebook_is_stale_when_what_it_imports_has_changed(package):
    notebook = notebook_of("%matplotlib inline\nfrom pack import user", "!ls\nimport helper")
    before = made_from_notebook(notebook, package / "mine")

    def changed(name):
        path = package / name
        old = path.read_text()
        path.write_text(old + "\n# another line\n")
        found = made_from_notebook(notebook, package / "mine")
        path.write_text(old)
        return {key for key in before if found[key] != before[key]}

    for name in ("user", "lazy", "base", "alone", "wing/inner", "wing/__init__", "__init__"):
        assert changed(f"pack/{name}.py") == {"the package"}, name
    assert changed("mine/helper.py") == {"the notebook"}
    assert changed("pack/typed.py") == set()
    other = made_from_notebook(notebook_of("from pack import base"), package / "mine")
    assert other["the package"] != before["the package"]


def test_a_function_is_made_from_its_file_and_the_imports_of_that(package, monkeypatch):
    (package / "mine" / "work.py").write_text(
        "def f(a):\n    from pack import base\n    import helper\n"
    )
    monkeypatch.syspath_prepend(package / "mine")
    import work

    before = made_from_function(work.f)
    (package / "pack" / "typed.py").write_text("# changed")
    assert made_from_function(work.f) == before
    (package / "pack" / "alone.py").write_text("# changed")
    assert [key for key, value in made_from_function(work.f).items() if value != before[key]] == [
        "the package"
    ]
    without_a_file = eval("lambda a: a")  # is made from the whole package
    whole = made_from_function(without_a_file)
    (package / "pack" / "typed.py").write_text("# changed anew")
    assert made_from_function(without_a_file)["the package"] != whole["the package"]
    (package / "mine" / "helper.py").write_text("import pack.alone  # changed")
    assert made_from_function(work.f)["the function"] != before["the function"]


@pytest.mark.parametrize(
    "chapter",
    [
        "08_pose",
        pytest.param("11_master_slave", marks=pytest.mark.heavy),
        pytest.param("gallery", marks=pytest.mark.heavy),
    ],
)
def test_all_that_a_chapter_loads_is_among_its_imports(chapter):
    """Python itself says which modules are loaded; it knows nothing of the walk along the
    imports.
    """
    path = next(ROOT.glob(f"*/{chapter}.ipynb"))
    source = provenance.source_of(nbformat.read(path, as_version=4))
    lines = [
        line
        for line in source.splitlines()
        if line.startswith(("import ", "from ")) and "(" not in line
    ]
    ours = "name.startswith(('trinolab', 'workbench')) and m.__file__"
    tell = (
        f"import sys; print(*(m.__file__ for name, m in sys.modules.items() if {ours}), sep='\\n')"
    )
    code = "\n".join([*lines, tell])
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=path.parent, capture_output=True, text=True, check=True
    )
    loaded = {Path(file) for file in done.stdout.splitlines()}
    found = imported_files(source, path.parent)
    assert len(loaded) > 20
    assert loaded <= found
    assert len(found) < len(imports.our_files()) * 0.7  # others do not make it stale


def test_the_commit_is_that_of_the_checkout_with_a_plus_if_files_have_changed(
    monkeypatch, tmp_path
):
    with monkeypatch.context() as without_git:
        without_git.setenv("PATH", str(tmp_path))
        assert provenance.commit() == ""
    said = {"rev-parse": "abc\n", "status": ""}

    def git(command, **_):
        return subprocess.CompletedProcess(command, 0, said[command[1]])

    monkeypatch.setattr(provenance.subprocess, "run", git)
    assert provenance.commit() == "abc"
    said["status"] = " M trinolab/pose.py\n"
    assert provenance.commit() == "abc+"


def test_names_and_borders_of_files_count(tmp_path):
    """The same bytes, one after the other, in files of other names or cut elsewhere."""
    hashes = set()
    for files in (
        {"a.csv": b"12", "b.csv": b"3"},
        {"a.csv": b"1", "b.csv": b"23"},
        {"a.csv": b"12", "c.csv": b"3"},
        {"a.csv": b"123"},
    ):
        folder = tmp_path / str(len(hashes))
        folder.mkdir()
        for name, content in files.items():
            (folder / name).write_bytes(content)
        hashes.add(provenance.hash_files(folder.iterdir(), folder))
    assert len(hashes) == 4
