"""The rules of book/design.md that a reader cannot check by eye: imports, notebooks, addresses."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(ROOT.glob("trinolab/*.py"))
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))

# A module imports only from those before it.
ORDER = [
    "checks", "outputs", "csvfile", "quiet", "greyimage", "lens", "camera", "rigfile", "handle", "metrics", "wall",
    "wallcontact", "fetch", "board", "datasets", "realsets", "ledger", "cones", "convex", "faces", "workspace",
    "window", "plotting", "plotting_errors", "plotting_rigs", "plotting_estimators", "plotting_calibration",
    "plotting_structure", "plotting_markers", "plotting_motion", "plotting_wall", "plotting_sweep", "light",
    "background", "covariance", "kalman", "image_track", "blobs", "spot", "markers", "matching", "triangulation",
    "rigid", "pose", "posetable", "posefilter", "layout", "hypotheses", "threepoint", "seeds", "verdict", "search",
    "identity", "bodyend", "parameters", "noise", "appearance", "centroids", "patches", "blur", "imagemodel",
    "registration", "outline", "refine", "reprojection", "weighted", "estimation", "corners", "targets", "relative",
    "zhang", "adjustment", "calibration", "tracker", "follow", "recentre", "posetracker", "markertrack",
    "plotting_windows", "plotting_geoms", "plotting_slave", "tuning", "overlay", "readings", "monitor", "raycast",
    "capsule", "arm", "motion", "training", "bench", "layer", "shadow", "scene", "exposure", "script", "filming",
    "bound", "boardscene", "boardtrial", "footage", "recording", "clip", "recorder", "provenance", "rendering",
    "standard", "devices", "capturing", "trackquality", "evaluation", "sync", "targetviews", "suspects",
    "calibrating", "errata_workspace", "errata_background", "errata_kalman", "errata_markers", "errata_pose",
    "errata_table1", "errata", "oneeuro", "teleop", "robot", "limiter", "reference", "inverse", "slave", "session",
    "sessionlog", "grids", "outcome", "notebookrun", "plotting_sliders", "kernelstate", "warmkernel", "engines",
    "sweepfolder", "sweeping", "sweep", "workflows", "trackrows", "tracking", "teleoperating", "slave_trial",
    "teleop_trial", "factors", "table1_bound", "deviations", "error_sources", "mixing", "pattern", "budget",
    "evidence", "trials", "known", "elevation", "centroid_trial", "marker_trial", "covertruth", "sweep_trials",
    "gallery", "scoreboard", "arguments", "cli",
]
# all that makes the truth may know
BENCH = {"checks", "outputs", "quiet", "greyimage", "lens", "camera", "handle", "raycast", "capsule", "arm", "motion",
         "bench", "layer", "shadow"}


def imports(path):
    """The package's modules that a module imports, and the other packages, wherever the import stands."""
    own, other = set(), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ("trinolab." if node.level else "") + (node.module or "")
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in filter(None, (name.replace("..", ".") for name in names)):
            top, _, rest = name.partition(".")
            (own if top == "trinolab" else other).add(rest.split(".")[0] if top == "trinolab" else top)
    return own & set(ORDER), other


def cells(path, kind="code"):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == kind]


def test_every_module_has_a_place_in_the_order():
    assert sorted(path.stem for path in MODULES) == sorted([*ORDER, "__init__"])


def test_a_module_imports_only_modules_above_it():
    places = {name: place for place, name in enumerate(ORDER)}
    upwards = [f"{path.stem} imports {name}" for path in MODULES for name in sorted(imports(path)[0])
               if path.stem in places and places[name] >= places[path.stem]]
    assert upwards == []
    assert imports(ROOT / "trinolab" / "__init__.py")[0] == set()


def test_import_reader_finds_every_form(tmp_path):
    source = ["import trinolab.pose", "from trinolab import scene", "from .camera import Rig", "from . import handle",
              "import cv2 as c"]
    (tmp_path / "m.py").write_text("\n".join(source))
    assert imports(tmp_path / "m.py") == ({"pose", "scene", "camera", "handle"}, {"cv2"})


def test_truth_and_estimate_share_only_camera_and_handle():
    found = {path.stem: imports(path)[0] for path in MODULES}
    for name in BENCH | {"scene"}:
        assert found.get(name, set()) <= BENCH, name
    for name in ("exposure", "script", "filming"):
        assert found[name] <= BENCH | {"scene", "exposure", "script"}, name
    assert not {"tracker", "estimation", "identity"} & (found["rendering"] | found["standard"])
    assert "scene" not in found.get("tracker", set())
    assert found["boardscene"] <= BENCH | {"board"}
    assert not {"boardscene", "bench"} & (found["calibration"] | found["corners"])


def test_only_plotting_draws():
    drawing = {path.stem for path in MODULES if imports(path)[1] & {"matplotlib", "pyvista"}}
    drawing -= {"kernelstate"}  # it takes matplotlib back to where it was, and draws nothing
    assert drawing == {"plotting", "plotting_errors", "plotting_estimators", "plotting_rigs", "plotting_calibration",
                       "plotting_motion", "plotting_wall", "plotting_structure", "plotting_markers", "plotting_windows",
                       "plotting_sweep", "plotting_sliders", "plotting_geoms", "plotting_slave"}
    computing = {path.stem for path in MODULES if imports(path)[0] & drawing} - drawing
    # their pictures, at the end; nothing else in the package waits for figures
    assert computing == {"calibrating", "sweeping", "teleoperating"}


def test_calibrating_loads_its_figure_only_when_needed():
    code = "import sys, trinolab.calibrating; print('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


@pytest.mark.parametrize("module", ["trinolab", "trinolab.sweep"])
def test_import_is_light(module):
    code = f"import sys, {module}; print(*sorted({{name.split('.')[0] for name in sys.modules}}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"matplotlib", "pyvista", "vtk", "mujoco", "cv2"} & set(loaded)


def test_there_are_notebooks_and_the_table_of_contents_names_them_all():
    toc = (ROOT / "_toc.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"notebooks/(\w+)", toc))
    assert named == {path.stem for path in NOTEBOOKS} != set()


def test_notebooks_are_stored_without_outputs():
    run = [path.stem for path in NOTEBOOKS for cell in cells(path) if cell.outputs or cell.execution_count is not None]
    assert run == []


def test_a_notebook_has_one_cell_of_parameters():
    counts = {path.stem: sum("parameters" in cell.metadata.get("tags", []) for cell in cells(path))
              for path in NOTEBOOKS}
    assert set(counts.values()) == {1}, counts


def repository_files():
    """Every file that git would store."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
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
