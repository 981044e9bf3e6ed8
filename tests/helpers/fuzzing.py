"""Files that are wrong in every way: valid ones with other values, keys and types, with other text,
with other bytes.

A reader of users' files takes one or refuses it, by a ValueError of one line that names it; nothing
else may happen.
"""

import copy
import json
import os
import tempfile
import tomllib
import warnings
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import data_path, load_rig
from trinolab.files.images import read_grey
from trinolab.files.poses import pose_table, poses_by_frame, poses_text, read_poses
from trinolab.files.recording import read_timestamps
from trinolab.files.recording_writer import read_manifest
from trinolab.files.rigs import read_handle, read_rig, rig_text
from trinolab.pose import LOST, Pose

# --- the readers, each with what is done at once to what it takes


def _rig(path):
    for camera in read_rig(path).cameras:
        camera.project(np.array([[0.0, 0.0, 600.0]]))


def _handle(path):
    assert len(read_handle(path).symmetries) >= 1


def _poses(path):
    poses_by_frame(read_poses(path))


def _image(path):
    assert read_grey(path).ndim == 2


READERS = {
    "rig": _rig,
    "handle": _handle,
    "poses": _poses,
    "timestamps": read_timestamps,
    "manifest": read_manifest,
    "image": _image,
}


def refusal(name, content):
    """What a reader says of a file that it refuses; None if it takes it. Any other exception is a
    finding.
    """
    path = Path(tempfile.gettempdir()) / f"trinolab-fuzz-{os.getpid()}"
    path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a warning would be a second line
            READERS[name](path)
    except ValueError as error:
        said = str(error)
        assert said.startswith(f"{path}: "), said
        assert not any(ord(letter) < 32 for letter in said), said
        return said
    finally:
        path.unlink()
    return None


# --- valid files


def _seeds():
    poses = [
        Pose("measured", RigidTransform.from_translation([1.0, 2, 560]), np.eye(6), 0.1, 6, 2),
        LOST,
        Pose("ambiguous", RigidTransform.from_translation([1.0, 2, 570]), np.eye(6), 0.1, 4, 1),
    ]
    table = poses_text(pose_table(poses, [0.0, 0.1, 0.2]))
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    manifest = {"motion": "calm", "seed": 3, "frames": 6, "rig": "0123456789abcdef"}
    images = [
        cv2.imencode(kind, grey)[1].tobytes() for kind in (".png", ".jpg", ".tiff", ".bmp", ".pgm")
    ]
    return {
        "rig": [
            rig_text(load_rig("paper_pair")).encode(),
            data_path("rigs", "raised_40deg.toml").read_bytes(),
        ],
        "handle": [
            data_path("handles", f"{name}.toml").read_bytes() for name in ("paper", "coded")
        ],
        "poses": [
            table.encode(),
            b"qz,qw,qx,qy,x_mm,y_mm,z_mm,frame\n0,1,0,0,1,2,570,7\n0,1,0,0,1,2,9,9\n",
        ],
        "timestamps": [b"frame,t_s\n0,0.0\n1,0.0333333\n2,0.0666667\n"],
        "manifest": [json.dumps(manifest).encode()],
        "image": images,
    }


SEEDS = _seeds()


# --- other values, keys and types

SPECIAL = [
    0,
    1,
    -1,
    2**63,
    10**40,
    float("nan"),
    float("inf"),
    1e-320,
    1e308,
    -1e308,
    1e155,
    "",
    "nan",
    "1.5",
    [],
    {},
    [[]],
    [1, "a"],
    [1, [2]],
    [0.0] * 3,
    [0.0] * 5,
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    True,
    "a\nb",
    "\x1b[2J",
]
VALUES = st.one_of(
    st.sampled_from(SPECIAL),
    st.floats(),
    st.integers(),
    st.text(max_size=5),
    st.booleans(),
    st.dates(),
    st.times(),
    st.datetimes(),
    st.lists(st.floats() | st.integers(), max_size=6),
    st.recursive(
        st.floats() | st.text(max_size=3),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=6,
    ),
).map(copy.deepcopy)  # what is put into a document may be changed there
CELLS = st.one_of(
    st.sampled_from(
        [
            "",
            " ",
            "nan",
            "inf",
            "-inf",
            "1e400",
            "1e308",
            "-1",
            "9" * 30,
            "9" * 400,
            "0x1",
            "True",
            "1+2j",
            "1979-05-27",
            "lost",
            "measured",
            '"',
            '"a\nb"',
            "a,b",
            "\x00",
            "\ufeff",
            "#",
            "é",
            "1_0",
            "\x1b[2J",
            "None",
        ]
    ),
    st.floats().map(repr),
    st.integers().map(str),
    st.text(max_size=6),
)


def _places(node):
    """Every container of a document with each of its keys or indices."""
    keys = (
        list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    )
    return [(node, key) for key in keys] + [place for key in keys for place in _places(node[key])]


@st.composite
def documents(draw, seed):
    """A TOML document with one to three other values, or other, missing and additional keys."""
    found = copy.deepcopy(tomllib.loads(seed.decode()))
    for _ in range(draw(st.integers(1, 3))):
        if not (places := _places(found)):
            break
        node, key = draw(st.sampled_from(places))
        what = draw(st.sampled_from(["set", "set", "set", "drop", "add", "rename"]))
        if what == "set":
            node[key] = draw(VALUES)
        elif what == "add" and isinstance(node, list):
            node.append(draw(VALUES))
        elif what == "add":
            node[draw(st.text(max_size=4))] = draw(VALUES)
        elif what == "rename" and isinstance(node, dict):
            other = draw(st.sampled_from(list(node)) | st.text(max_size=4))
            node[other] = node.pop(key)
        else:
            del node[key]
    return tomli_w.dumps(found).encode("utf-8", errors="surrogatepass")


@st.composite
def tables(draw, seed):
    """A CSV table with one to three other cells, rows or columns."""
    cells = [line.split(",") for line in seed.decode().splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        row = draw(st.integers(0, len(cells) - 1))
        column = draw(st.integers(0, max(len(cells[row]) - 1, 0)))
        what = draw(st.sampled_from(["set", "set", "set", "drop", "add", "column", "row", "twice"]))
        if what == "set" and cells[row]:
            cells[row][column] = draw(CELLS)
        elif what == "drop":
            del cells[row][column : column + 1]
        elif what == "add":
            cells[row].insert(column, draw(CELLS))
        elif what == "column":
            cells = [line[:column] + line[column + 1 :] for line in cells]
        elif what == "row" and len(cells) > 1:
            del cells[row]
        else:
            cells.insert(row, cells[row][:])
    end = draw(st.sampled_from(["\n", "\n", "\r\n", "\r"]))
    return end.join(",".join(line) for line in cells).encode("utf-8", errors="surrogatepass")


# --- other text, other bytes

PIECES = [
    "",
    ",",
    "\n",
    "\r",
    "nan",
    "inf",
    "-1",
    "1e400",
    "0.0",
    '"',
    "'",
    '"""',
    "[",
    "]",
    "=",
    "{",
    "}",
    "#",
    "true",
    "\x00",
    "\ufeff",
    "name",
    "-",
    ".",
    "9" * 30,
    "lost",
    "1979-05-27",
    "[[",
    "]]",
    400 * "[",
    "\\",
    "\\u0000",
    "_",
    "e",
    "0x",
    "\x1b",
]


@st.composite
def spliced(draw, seed):
    """A file with up to four stretches replaced by something else, or by another stretch of it."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(seed)))
        stop, other = (
            min(len(seed), start + draw(st.integers(0, 30))),
            draw(st.integers(0, len(seed))),
        )
        piece = draw(
            st.sampled_from([*(piece.encode() for piece in PIECES), seed[other : other + 25]])
            | st.binary(max_size=8)
        )
        seed = seed[:start] + piece + seed[stop:]
    return seed


def kinds(name):
    """How the files of a reader are made, by what is done to valid ones."""
    seeds = st.sampled_from(SEEDS[name])
    structured = {
        "rig": documents,
        "handle": documents,
        "poses": tables,
        "timestamps": tables,
    }
    found = {
        "text": seeds.flatmap(spliced),
        "cut": st.builds(lambda seed, n: seed[:n], seeds, st.integers(0, 2000)),
        "bytes": st.binary(max_size=300),
    }
    return ({"values": seeds.flatmap(structured[name])} if name in structured else {}) | found


def fuzz(name, kind, count):
    """How many files were taken, and how many refused, of `count` that were tried. Raises what is a
    finding.
    """
    counts = Counter()

    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(kinds(name)[kind])
    def attempt(content):
        counts["taken" if refusal(name, content) is None else "refused"] += 1

    attempt()
    return counts
