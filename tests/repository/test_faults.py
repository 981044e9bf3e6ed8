"""What a person may do wrong, and what each command answers: the table `faults.txt`.

A mistake is answered by one line that names the file and the field, exit code 2, and no file that
was not there before; what is the world's (a dark camera, a frozen one) is answered by a status.
Interruptions and full disks: test_stopped.
"""

import ast
import os
import re
import shutil
import zlib
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from cases import cases, unescaped
from healthy import CODED, RIG, contents, make_healthy, run, true_path, write_video

from trinolab.camera import Rig
from trinolab.evaluation import FAR_DEG, FAR_MM
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.files.rigs import write_rig
from trinolab.metrics import geodesic_deg
from workbench.studies import scoreboard
from workbench.sweep import engines

COUNT = 6  # instants of the recording
GREYS = {"black": 0, "grey": 90, "white": 255}
COLUMNS = "frame,x_mm,y_mm,z_mm,qw,qx,qy,qz,status"
FIRST = "rec/images/ccd2/000000.png"
POSE = "0,0,570,1,0,0,0,measured"


# --- what the table's words do to a file


def write(path, content=""):
    path.write_bytes(unescaped(content).encode("latin-1"))


def deep(path, content=""):
    path.write_text(content + 9999 * "[")


def poses(path, lines=""):
    """A table of poses; of times as well, where a row has one more number."""
    rows = [row.replace("POSE", POSE) for row in lines.split("; ") if row]
    has_times = bool(rows) and rows[0].count(",") > COLUMNS.count(",")
    head = COLUMNS.replace("frame", "frame,t_s") if has_times else COLUMNS
    write(path, "\n".join([head, *rows, ""]))


def change(path, values):
    old, new = map(unescaped, values.split(" -> "))
    before = path.read_text()
    assert old in before
    path.write_text(before.replace(old, new, 1))


def cut(path, size="0.5"):
    """What is left is a share of the file, or a number of bytes."""
    data = path.read_bytes()
    path.write_bytes(data[: int(float(size) * len(data)) if "." in size else int(size)])


def damage(path):
    """The third of a file in its middle is zero."""
    data = path.read_bytes()
    third = len(data) // 3
    path.write_bytes(data[:third] + bytes(third) + data[2 * third :])


def copy(path, target):
    for other in matches(target):
        shutil.copy(path, other)


def empty(path):
    shutil.rmtree(path)
    path.mkdir()


def lock(path):
    path.mkdir(mode=0o500)
    if os.access(path, os.W_OK):
        pytest.skip("root may write everywhere")


def loop(path):
    """A link to itself: nobody can read it, whatever they may."""
    path.unlink(missing_ok=True)
    path.symlink_to(path.name)


def pipe(path):
    """Whoever opens it waits for ever."""
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def image(path, what):
    """An image of some width and height, of a grey level, in a format of any name."""
    size, level, kind = re.fullmatch(r"(\S+) ?(\w*) ?(\S*)", what).groups()
    path.write_bytes(cv2.imencode(kind or ".png", flat(size, level or "grey"))[1].tobytes())


def flat(size, level="grey"):
    columns, rows = map(int, size.split("x"))
    if level == "float":
        return np.zeros((rows, columns), np.float32)
    return np.full((rows, columns), GREYS[level], np.uint8)


def huge(path):
    """A PNG whose head promises ten thousand million pixels."""
    data = cv2.imencode(".png", flat("2x2"))[1].tobytes()
    head = b"IHDR" + (100000).to_bytes(4, "big") * 2 + data[24:29]
    path.write_bytes(data[:12] + head + zlib.crc32(head).to_bytes(4, "big") + data[33:])


def video(path, size):
    write_video(path, [flat(size)] * 3)


def twin(path):
    """The second camera of a rig stands where the first one does."""
    write_rig(Rig((RIG.cameras[0], replace(RIG.cameras[0], name="ccd2"))), path)


def layout(path, markers):
    """A handle with other columns and rows of markers."""
    columns, rows = ast.literal_eval(markers)
    path.write_text(tomli_w.dumps({**asdict(CODED), "columns_deg": columns, "rows_mm": rows}))


FUNCTIONS = [write, deep, poses, cut, damage, copy, empty, lock, loop, pipe, image, huge, video]
WORDS = {
    **{function.__name__: function for function in [*FUNCTIONS, twin, layout]},
    "replace": change,
    "delete": Path.unlink,
    "rename": Path.rename,
    "folder": lambda path: path.mkdir(parents=True),
}


def matches(name):
    """The files of a pattern, or the one of a name that there may not yet be."""
    return sorted(Path().glob(name)) if set("*?[") & set(name) else [Path(name)]


def do(action):
    word, name, value = re.fullmatch(r"(\w+) (\S+?)(?:: ?| -> |$)(.*)", action).groups()
    for path in matches(name):
        WORDS[word](path, *([value] if value else []))


# --- the table


FAULTS = cases(Path(__file__).with_name("faults.txt"))
HEALTHY = [line for line in dict.fromkeys(line for line, _, _ in FAULTS) if line]


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    root = tmp_path_factory.mktemp("healthy")
    make_healthy(root, COUNT)
    return root


@pytest.fixture
def folder(healthy, tmp_path, monkeypatch):
    """The working folder: a copy of the healthy one."""
    shutil.copytree(healthy, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("line", HEALTHY)
def test_what_is_healthy_is_taken(line):
    assert run(line) == 0


@pytest.mark.parametrize(
    ("line", "fault", "message"),
    FAULTS,
    ids=[f"{line.partition(' ')[0]}: {fault}" for line, fault, _ in FAULTS],
)
def test_a_fault_costs_one_line_and_no_file(folder, line, fault, message, capfd, monkeypatch):
    monkeypatch.setattr(scoreboard, "CHECKS", {})  # a mistake is found before anything is computed
    monkeypatch.setattr(engines, "CONNECT_S", 1.0)  # of a cluster that never answers
    for action in fault.split(" && ") if fault else []:
        in_line, is_replaced, new = action.removeprefix("with ").partition(" ->")
        if not action.startswith("with "):
            do(action)
        elif is_replaced:
            assert in_line in line
            line = line.replace(in_line, new.strip())
        else:
            line = f"{line} {in_line}"
    before = contents(folder)
    assert run(line) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n"), err[-1:]) == ("", 1, "\n")
    assert err.startswith("trinolab")
    assert message in err
    assert contents(folder) == before


# --- no mistake: what cameras see is answered by a status, or converted


def in_colour(frame):
    return cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)


def deeper(frame):
    return frame.astype(np.uint16) * 257


# what the cameras see, which of them, the statuses of the poses: any where there is none
SEEN = {
    "all black": (lambda frame: 0 * frame, "ccd?", {"lost"}),
    "all white": (lambda frame: 0 * frame + 255, "ccd?", {"lost"}),
    "one black": (lambda frame: 0 * frame, "ccd2", None),
    "one white": (lambda frame: 0 * frame + 255, "ccd1", None),
    "one frozen": (lambda frame: cv2.imread(FIRST, cv2.IMREAD_GRAYSCALE), "ccd2", None),
    "colour": (in_colour, "ccd?", {"measured"}),
    "colour with alpha": (
        lambda frame: cv2.cvtColor(frame, cv2.COLOR_GRAY2BGRA),
        "ccd2",
        {"measured"},
    ),
    "16 bit colour": (lambda frame: deeper(in_colour(frame)), "ccd1", {"measured"}),
    "16 bit": (deeper, "ccd?", {"measured"}),
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "line", ["track rec --out poses.csv", HEALTHY[0]], ids=["track", "measure"]
)
@pytest.mark.parametrize(("changed", "cameras", "statuses"), SEEN.values(), ids=SEEN)
def test_what_cameras_see_is_no_mistake(changed, cameras, statuses, line):
    for path in Path("rec/images").glob(f"{cameras}/*.png"):
        cv2.imwrite(str(path), changed(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))
    assert run(line) == 0
    table, truth = read_poses("poses.csv"), true_path(COUNT)
    assert len(table) == COUNT
    # alone, an instant of so small images may be lost
    if statuses == {"lost"} or (statuses and line.startswith("track")):
        assert set(table["status"]) == statuses
    for frame, T in poses_by_frame(table[table["status"] == "measured"]).items():
        assert np.linalg.norm(T.translation - truth[frame].translation) < FAR_MM
        assert geodesic_deg(T, truth[frame])[0] < FAR_DEG
