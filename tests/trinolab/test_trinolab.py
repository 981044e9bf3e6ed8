"""The names that `trinolab` itself has: each one works, none is hidden by a module, and the
examples of the README and of the reference run.
"""

import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from firsthour import EMPTY, INSTANTS, SECONDS, TAKEN, blocks, write_recording
from makenotebook import glued, make_notebook

import trinolab
from trinolab import FACE
from workbench.paper import ledger
from workbench.sweep import runs

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "trinolab"


def home_of(name):
    """The object that a name of the face stands for, got without the face."""
    module, _, attribute = FACE[name].partition(":")
    loaded = import_module(module)
    return getattr(loaded, attribute) if attribute else loaded


def run(code):
    """What some code prints in a new process."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.parametrize("name", FACE)
def test_a_name_of_the_face_is_the_thing_itself(name):
    assert getattr(trinolab, name) is home_of(name)
    assert name in dir(trinolab)


def test_the_face_is_what_a_star_import_brings():
    given = {}
    exec("from trinolab import *", given)
    assert set(given) - {"__builtins__"} == set(FACE) == set(trinolab.__all__)


def test_type_checkers_see_the_same_face():
    """They read the imports that Python skips; each must lead to the place where the name is taken
    from.
    """
    source = (PACKAGE / "__init__.py").read_text(encoding="utf-8")
    lines = re.findall(r"^    from \.([\w.]*) import (\w+) as (\w+)", source, re.MULTILINE)
    typed = {
        name: f"trinolab.{module}:{what}" if module else f"trinolab.{what}"
        for module, what, name in lines
    }
    typed["mapping"] = typed["mapping"].replace(":", ".")
    # what the algorithms do not import, not even for a type checker
    assert typed | {"sweep": "workbench.sweep"} == FACE


def test_the_map_has_each_name_in_the_order_of_the_data_with_its_equations():
    """The docstring, which `help` shows first, and the names; the equations are those of the things'
    own docstrings.
    """
    rows = re.findall(r"^`(\w+)`  +(Eq\. [\d-]+)?", trinolab.__doc__, re.MULTILINE)
    assert [name for name, _ in rows] == list(FACE)
    for name, equations in rows:
        first = (inspect.getdoc(getattr(trinolab, name)) or "").partition("\n\n")[0]
        named = ledger.equations_named(first)
        if equations and named and not inspect.ismodule(getattr(trinolab, name)):
            start, _, end = equations.removeprefix("Eq. ").partition("-")
            assert set(map(int, named)) <= set(range(int(start), int(end or start) + 1)), name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'trinolab' has no attribute 'mesure'"):
        getattr(trinolab, "mesure")  # noqa: B009  what Python does for the name with a dot
    with pytest.raises(ImportError):
        from trinolab import mesure  # noqa: F401


def test_no_module_is_called_like_another_things_name():
    modules, folders = PACKAGE.glob("*.py"), PACKAGE.glob("*/__init__.py")
    names = {path.stem for path in modules} | {path.parent.name for path in folders}
    homes = {name: f"trinolab.{name}" for name in names & set(FACE)}
    assert homes.items() <= FACE.items(), "a module that is loaded takes the name's place"


@pytest.mark.heavy
def test_a_module_that_is_loaded_hides_no_name_of_the_face():
    """In either order: the homes first, and the names first."""
    homes = sorted({where.partition(":")[0] for where in FACE.values()})
    show = f"print({', '.join(f'trinolab.{name}' for name in FACE)})"
    first, second = (
        run(f"import trinolab\n{show}"),
        run(f"import {', '.join(homes)}\nimport trinolab\n{show}"),
    )
    names = [re.sub(r" at 0x\w+", "", text) for text in (first, second)]
    assert names[0] == names[1]
    assert "function measure" in names[0]
    assert names[0].count("<module") == sum(":" not in where for where in FACE.values())


def test_sweep_is_the_folder_and_the_function():
    assert trinolab.sweep(lambda a: 2 * a, a=[1, 4], progress=False)["result"].tolist() == [2, 8]
    assert (
        run("import trinolab; print(trinolab.sweep.sweep.__module__)") == "workbench.sweep.runs\n"
    )
    assert (
        run(
            "import trinolab\nfrom workbench.sweep import sweep\nimport workbench.sweep.runs\n"
            "print(trinolab.sweep.sweep is sweep)"
        )
        == "True\n"
    )
    assert trinolab.sweep.sweep is runs.sweep


# --- the examples of the README and of the reference


def examples():
    """The README's block of Python, and those of the first page of the API reference."""
    return [*blocks("README.md", "From Python"), *blocks("book/api/index.md", "Examples")]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the recording of the README's first command, and with a small notebook that is
    called like a chapter.
    """
    root = tmp_path_factory.mktemp("readme")
    write_recording(root / "recording")
    (root / "notebooks").mkdir()
    make_notebook(
        root / "notebooks" / "06_matching.ipynb",
        glued(found="ncc_threshold + seed"),
        parameters="ncc_threshold = 0.7\nseed = 0",
    )
    return root


def test_the_readme_makes_that_recording():
    first = blocks("README.md", "Sixty seconds")[0].splitlines()[0]
    assert first == (
        "trinolab render --rig raised_40deg --handle coded --motion calm "
        f"--seconds {SECONDS:g} --out recording"
    )


def test_there_are_four_examples():
    assert len(examples()) == 4


@pytest.fixture
def after(place, monkeypatch):
    """What an example leaves behind, run in that folder."""

    def run_example(number):
        monkeypatch.chdir(place)
        names = {}
        exec(examples()[number], names)
        return names

    return run_example


@pytest.mark.slow
def test_readme_measures_an_instant(after, place):
    left = after(0)
    pose = left["pose"]
    assert pose.status == "measured"
    number = int(re.search(r"/(\d{6})\.png", examples()[0])[1])
    truth = trinolab.read_poses(place / "recording" / "truth.csv").iloc[TAKEN.index(number)]
    away = pose.T_world_handle.translation - truth[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    assert np.linalg.norm(away) < 0.02  # mm, by the best estimator


@pytest.mark.slow
def test_reference_tracks_a_recording(after, capsys):
    left = after(1)
    assert (left["poses"]["status"] == "measured").sum() == INSTANTS - EMPTY
    assert left["result"].measured == INSTANTS - EMPTY
    assert left["result"].errors.E_t_mm < 0.02
    assert capsys.readouterr().out.startswith(f"{INSTANTS - EMPTY} PoseErrors(")


@pytest.mark.heavy
def test_reference_sees_an_own_rig(after):
    result = after(2)["result"]
    assert result.measured == result.instants == 3
    assert result.errors.E_t_mm < 0.05  # mm


def test_reference_sweeps_a_chapter(after):
    table = after(3)["table"]
    assert table["status"].tolist() == ["ok"] * 3
    assert table["found"].tolist() == table["ncc_threshold"].tolist()
