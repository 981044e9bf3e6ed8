"""Import paths of version 0.1: each still works, and says where its module is now."""

import subprocess
import sys
from importlib.util import find_spec

import pytest

from trinolab.moved import MOVED, moved_to

if find_spec("matplotlib") is None:
    pytest.skip("the modules that moved need the extra 'workbench'", allow_module_level=True)


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


@pytest.mark.parametrize(
    "old", ["trinolab.studies.accounts", "trinolab.slave.pointing", "trinolab.systematic"]
)
def test_an_old_path_gives_the_module_and_names_its_place(old):
    new = moved_to(old)
    done = run(f"import {old} as old, {new} as new\nprint(old is new, new.__spec__.name)")
    assert done.stdout.split() == ["True", new]
    assert f"FutureWarning: {old} is now {new}" in done.stderr


def test_from_an_old_package_a_name_can_be_taken():
    done = run("from trinolab.sweep import sweep\nprint(sweep.__module__)")
    assert done.stdout == "workbench.sweep.runs\n"
    assert "<string>:1: FutureWarning: trinolab.sweep is now workbench.sweep" in done.stderr


def test_an_old_module_runs_as_a_command():
    command = [sys.executable, "-m", "trinolab.studies", "--help"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert "python -m workbench.studies" in done.stdout


def test_what_never_was_is_not_found():
    assert moved_to("trinolab.nothing") is None
    assert "No module named 'trinolab.nothing'" in run("import trinolab.nothing").stderr
    assert (
        "No module named 'trinolab.studies.nothing'"
        in run("import trinolab.studies.nothing").stderr
    )


def test_every_place_is_there():
    assert all(find_spec(new) is not None for new in MOVED.values())
