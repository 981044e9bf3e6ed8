"""The rules of book/design.md that a reader cannot check by eye: imports, notebooks, addresses."""

import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from trinolab.bench.rendering import DRAWN_WITH
from workbench.imports import PACKAGES, files_of_module, module_of_file, our_files

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))


def cells(path):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


def test_a_recording_is_stale_when_what_draws_it_has_changed():
    """`DRAWN_WITH` names all that decides what a frame shows, and nothing that measures."""
    package = PACKAGES["trinolab"]
    named = {path for pattern in DRAWN_WITH for path in package.glob(pattern)}
    drawing = files_of_module("trinolab.bench.scenario") - {package / "__init__.py"}
    assert drawing <= named


def test_only_figures_draw():
    drawing = {
        module_of_file(path)
        for path in our_files()
        if re.search(r"^\s*(import|from) (matplotlib|pyvista)", path.read_text(), re.MULTILINE)
    }
    others = {name for name in drawing if not name.startswith("workbench.plotting.")}
    # the kit's pages are drawn without the package of all figures, which takes long to load
    assert others == {
        "satellites.accept.figures",
        "satellites.classkit.prints",
        "workbench.sweep.figures",
        "workbench.sweep.sliders",
        "workbench.teleop.view",
    }


def loaded_by(code):
    """The modules that some code loads in a new process."""
    code = f"import sys\n{code}\nprint(*sys.modules)"
    return set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_the_papers_chain_runs_by_itself():
    loaded = loaded_by("""
import numpy as np
import trinolab
paper = trinolab.Parameters(estimator="paper")
trinolab.measure([np.zeros((1024, 1280))] * 2, "paper_pair", "paper", parameters=paper)""")
    assert "trinolab.pose" in loaded
    assert "pandas" not in loaded  # it takes a quarter of the first call's time
    beyond = ("trinolab.estimators.", "trinolab.uncertainty")
    assert {name for name in loaded if name.startswith(beyond)} == {
        "trinolab.estimators.identified",
        "trinolab.estimators.paper",
    }


def test_import_is_light():
    heavy = {"matplotlib", "pyvista", "vtk", "mujoco", "cv2", "numba"}
    assert not heavy & loaded_by("import trinolab, workbench, satellites, workbench.sweep")
    assert "matplotlib" not in loaded_by("import trinolab.calibration.calibrate")


def test_there_are_notebooks_and_the_table_of_contents_names_them_all():
    toc = (ROOT / "_toc.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"notebooks/(\w+)", toc))
    assert named == {path.stem for path in NOTEBOOKS} != set()


def test_notebooks_are_stored_without_outputs_and_with_one_cell_of_parameters():
    for path in NOTEBOOKS:
        code = cells(path)
        assert not any(cell.outputs or cell.execution_count is not None for cell in code), path.stem
        tags = [tag for cell in code for tag in cell.metadata.get("tags", [])]
        assert tags.count("parameters") == 1, path.stem


def repository_files():
    """Every file that git would store."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        names = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.split("\0")
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git repository, or git (Debian package: git) is missing")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


def test_no_file_names_a_machine():
    # Put together here, so that this file does not name one itself.
    paths = "|".join(f"/{folder}/" for folder in ("work", "root", "home", "Users", "tmp/[a-z]"))
    hosts = r"pypi\.\w+|files\.python" r"hosted|regis" r"try\.npmjs|\bin" r"dex-url"
    for path in repository_files():
        text = path.read_bytes().decode("utf-8", errors="replace")
        found = re.search(rf"(?<![\w.]){'(?:' + paths + ')'}|{hosts}", text)
        assert found is None, f"{path.relative_to(ROOT)}: {found.group()}"
