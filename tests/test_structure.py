"""The rules of book/design.md that a reader cannot check by eye: imports, notebooks, addresses."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "trinolab"
MODULES = sorted(PACKAGE.glob("**/*.py"))
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))

# The paper's chain at the top, in the order in which its parts import each other. `identity` and
# `estimators`, which the paper does not have, are folders within it. A part imports its own group
# and those before it.
CHAIN = [
    {"checks", "rigid", "methods", "intervals"},
    {"lens", "camera", "handle", "window", "systematic"},
    {
        "background",
        "kalman",
        "image_track",
        "blobs",
        "markers",
        "matching",
        "triangulation",
        "metrics",
    },
    {"pose"},
    {"identity"},
    {"parameters"},
    {"estimators"},
    {"measurement"},
    {"tracker"},
]
WHOLE_CHAIN = set().union(*CHAIN)
GEOMETRY = {"checks", "rigid", "lens", "camera", "handle", "window", "metrics"}
# What each folder, and `datasets`, may import beside itself.
WALLS = {
    "files": GEOMETRY | {"pose", "datasets"},
    "datasets": GEOMETRY | {"files"},
    "workspace": GEOMETRY,
    "plotting": GEOMETRY | {"workspace"},
    "calibration": GEOMETRY | {"files", "plotting"},
    "bench": GEOMETRY | {"pose", "files", "datasets", "calibration"},
    "second": {"checks", "camera", "handle", "files", "datasets"},
    "sweep": GEOMETRY | {"files", "datasets", "plotting"},
    "following": WHOLE_CHAIN | {"files", "calibration"},
    "slave": WHOLE_CHAIN | {"following", "bench", "files", "datasets"},
    "live": WHOLE_CHAIN | {"following", "slave", "bench", "files", "datasets"},
    "classkit": WHOLE_CHAIN | {"following", "files", "datasets", "calibration", "plotting"},
    "paper": WHOLE_CHAIN - {"identity", "estimators", "measurement", "tracker"}
    | {"files", "datasets", "workspace"},
}
FACE = {"__init__", "__main__"}  # what a user meets first; nobody imports it
WALLS["studies"] = WHOLE_CHAIN | set(WALLS)
WALLS["accept"] = WALLS["studies"] | {"studies"}
WALLS["course"] = WALLS["studies"] | {"studies"}
WALLS["cli"] = WALLS["accept"] | {"accept", "course"}


def imports(path):
    """The names of this package that a file imports, wherever the import stands, and the other
    packages.
    """
    own, other = set(), set()
    package = path.parent.relative_to(ROOT).parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join(filter(None, [*above, node.module]))
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            top, _, rest = name.partition(".")
            if top == "trinolab":
                own.add(rest)
            else:
                other.add(top)
    return own, other


def room(path):
    """The folder of the package that a file lies in, or its own name at the top."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def rooms_imported(path):
    """The folders and modules at the top that a file imports, without its own."""
    rooms = {room(module) for module in MODULES}
    return {name.split(".")[0] for name in imports(path)[0]} & rooms - {room(path)}


def cells(path, kind="code"):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == kind]


def test_every_module_and_folder_has_a_place():
    assert {room(path) for path in MODULES} == WHOLE_CHAIN | set(WALLS) | FACE


def test_a_folder_imports_only_what_it_may_know():
    through = [
        f"{path.relative_to(ROOT)} imports {other}"
        for path in MODULES
        if room(path) in WALLS
        for other in sorted(rooms_imported(path) - WALLS[room(path)])
    ]
    assert through == []


def test_the_chain_imports_only_backwards():
    place = {name: number for number, group in enumerate(CHAIN) for name in group}
    forwards = [
        f"{path.relative_to(ROOT)} imports {other}"
        for path in MODULES
        if room(path) in place
        for other in sorted(rooms_imported(path))
        if place.get(other, len(CHAIN)) > place[room(path)]
    ]
    assert forwards == []


def test_no_circle():
    """Neither among folders, nor among the modules of one."""
    by_name = {
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): path
        for path in MODULES
        if room(path) not in FACE
    }

    def module_of(name):
        while name and name not in by_name:
            name = name.rpartition(".")[0]
        return {name} - {""}

    left = {
        name: set().union(*map(module_of, imports(path)[0])) - {name}
        for name, path in by_name.items()
    }
    while left:
        free = {name for name, others in left.items() if not others & set(left)}
        assert free, f"in circles: {sorted(left)}"
        left = {name: others for name, others in left.items() if name not in free}


def test_the_bench_and_the_chain_never_meet():
    """What makes the images and what measures them share camera and handle: the truth must not know
    the estimate.
    """
    measuring = WHOLE_CHAIN - GEOMETRY - {"pose", "methods"} | {"following"}
    assert not measuring & WALLS["bench"]
    estimates = [path for path in MODULES if room(path) in measuring | {"calibration"}]
    assert not [path for path in estimates if "bench" in rooms_imported(path)]
    used = {name for path in MODULES if room(path) == "bench" for name in imports(path)[0]}
    assert {name for name in used if name.startswith("calibration")} <= {"calibration.target.Board"}


def test_the_second_renderer_knows_neither_the_bench_nor_the_chain():
    """An error that both renderers had, or one of them and the measurement, would be invisible."""
    assert not WALLS["second"] & (
        WHOLE_CHAIN - {"checks", "camera", "handle"} | {"bench", "calibration"}
    )
    knowing = {room(path) for path in MODULES if "second" in rooms_imported(path)}
    assert knowing == {"studies"}


def test_import_reader_finds_every_form(tmp_path, monkeypatch):
    source = [
        "import trinolab.pose",
        "from trinolab import scene",
        "from ..camera import Rig",
        "from . import handle",
        "import cv2 as c",
    ]
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    path = tmp_path / "trinolab" / "files" / "m.py"
    path.parent.mkdir(parents=True)
    path.write_text("\n".join(source))
    assert imports(path) == ({"pose", "scene", "camera.Rig", "files.handle"}, {"cv2"})


def test_only_figures_draw():
    drawing = {
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if imports(path)[1] & {"matplotlib", "pyvista"} and room(path) != "plotting"
    }
    # kernelstate takes matplotlib back to where it was, and draws nothing
    assert drawing == {
        "sweep/figures.py",
        "sweep/sliders.py",
        "sweep/kernelstate.py",
        "slave/view.py",
    }


def loaded_by(code):
    """The modules that some code loads in a new process."""
    code = f"import sys\n{code}\nprint(*sys.modules)"
    return set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_calibrating_loads_its_figure_only_when_needed():
    assert "matplotlib" not in loaded_by("import trinolab.calibration.calibrate")


def test_the_papers_chain_runs_by_itself():
    loaded = loaded_by("""
import numpy as np
from trinolab import datasets
from trinolab.measurement import measure
rig = datasets.load_rig("paper_pair")
measure([np.zeros(camera.size[::-1]) for camera in rig.cameras], rig, datasets.load_handle("paper"))""")
    assert "trinolab.pose" in loaded
    assert {name for name in loaded if name.startswith("trinolab.estimators.")} == {
        "trinolab.estimators.identified"
    }


@pytest.mark.parametrize("module", ["trinolab", "trinolab.sweep"])
def test_import_is_light(module):
    assert not {"matplotlib", "pyvista", "vtk", "mujoco", "cv2"} & loaded_by(f"import {module}")


def test_there_are_notebooks_and_the_table_of_contents_names_them_all():
    toc = (ROOT / "_toc.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"notebooks/(\w+)", toc))
    assert named == {path.stem for path in NOTEBOOKS} != set()


def test_notebooks_are_stored_without_outputs():
    run = [
        path.stem
        for path in NOTEBOOKS
        for cell in cells(path)
        if cell.outputs or cell.execution_count is not None
    ]
    assert run == []


def test_a_notebook_has_one_cell_of_parameters():
    counts = {
        path.stem: sum("parameters" in cell.metadata.get("tags", []) for cell in cells(path))
        for path in NOTEBOOKS
    }
    assert set(counts.values()) == {1}, counts


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
