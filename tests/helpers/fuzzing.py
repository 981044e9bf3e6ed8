"""Files that are wrong in every way: valid ones with other words or other bytes.

A reader of users' files takes one or refuses it, by a ValueError of one line that names it; nothing
else may happen.
"""

import io
import json
import os
import re
import shutil
import tempfile
import warnings
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import cv2
import numpy as np
from healthy import BOARDS, CAPTURE, EVALUATE, FOLLOW, MEASURE, TRACK, VIDEOS, run
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

IMAGE = "rec/images/ccd1/000001.png"

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


# --- what is done to them

LISTED = """
    0 1 -1 9223372036854775808 nan inf -inf 1e400 1e308 -1e308 1e155 1e-320 0x1 1_0 1+2j
    True true None 1979-05-27 07:32:00 lost measured "" "nan" "1.5" "a\\nb" "\\u0000" ' "
    [] {} [[]] [1,"a"] [1,[2]] [0.0,0.0,0.0] [[1,0,0],[0,1,0],[0,0,1]] name - . , = # [ ] { } [[ ]]
"""
WORDS = [word.encode() for word in LISTED.split()]
WORDS += [
    b"",
    b" ",
    b"\n",
    b"\r",
    b"\0",
    b"\x1b[2J",
    "\ufeff\u00e9".encode(),
    400 * b"9",
    400 * b"[",
]
NUMBERS = st.one_of(st.floats(), st.integers()).map(repr) | st.text(max_size=6)


@st.composite
def other_words(draw, seed):
    """A file with one to three other words, of a list or from elsewhere in it; a line more or less."""
    parts = re.split(rb"([\w.+-]+|[^\w\s])", seed)
    other = st.sampled_from(WORDS) | st.sampled_from(parts)
    other |= NUMBERS.map(lambda text: text.encode("utf-8", errors="surrogatepass"))
    for _ in range(draw(st.integers(1, 3))):
        parts[draw(st.integers(0, len(parts) - 1))] = draw(other)
    lines = b"".join(parts).split(b"\n")
    k = draw(st.integers(0, len(lines) - 1))
    lines[k : k + 1] = draw(st.sampled_from([1, 1, 1, 1, 0, 2])) * [lines[k]]
    return draw(st.sampled_from([b"\n", b"\n", b"\r\n", b"\r"])).join(lines)


@st.composite
def other_bytes(draw, seed):
    """A file with up to four stretches replaced, repeated or cut off."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(seed)))
        stop = start + draw(st.integers(0, 30) | st.just(len(seed)))
        again = seed[start : start + 25] * draw(st.sampled_from([0, 0, 0, 10, 100_000]))
        seed = seed[:start] + draw(st.binary(max_size=25)) + again + seed[stop:]
    return seed


WAYS = {"text": other_words, "bytes": other_bytes}


def kinds(name):
    """How the files of a reader are made from valid ones."""
    return ["bytes"] if name == "image" else list(WAYS)


def repeated(count):
    return settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )


def fuzz(name, kind, count):
    """How many files were taken, and how many refused, of `count` that were tried. Raises what is a
    finding.
    """
    counts = Counter()

    @repeated(count)
    @given(st.sampled_from(SEEDS[name]).flatmap(WAYS[kind]))
    def attempt(content):
        counts["taken" if refusal(name, content) is None else "refused"] += 1

    attempt()
    return counts


# --- whole commands

# each with the files that it reads
READ = {
    EVALUATE: "found.csv truth.csv handle.toml",
    MEASURE: f"rig.toml handle.toml {IMAGE}",
    TRACK: f"rec/rig.toml rec/handle.toml rec/timestamps.csv {IMAGE}",
    VIDEOS: "ccd1.mkv ccd2.mkv",
    CAPTURE: "ccd1.mkv rig.toml",
    FOLLOW: "path.csv rig.toml handle.toml",
    BOARDS: "a/02.png b/03.png",
    "track bag --out poses.csv": "bag/metadata.yaml bag/bag.mcap",
}
PLACES = [(line, file) for line, files in READ.items() for file in files.split()]


def fuzz_commands(healthy, work, count):
    """The exit codes of commands that were run in the folder `work`, the working folder, each on a
    copy of the healthy files of which one is wrong. Raises what is a finding: an exception, or another
    answer than one line of what is wrong.
    """
    codes = Counter()

    @repeated(count)
    @given(st.data(), st.sampled_from(PLACES))
    def attempt(data, place):
        line, file = place
        for name in work.iterdir():
            shutil.rmtree(name) if name.is_dir() else name.unlink()
        shutil.copytree(healthy, work, dirs_exist_ok=True)
        content = (work / file).read_bytes()
        (work / file).write_bytes(data.draw(other_bytes(content) | other_words(content)))
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
            code = run(line)
        codes[code] += 1
        last = said.getvalue().splitlines()[-1:]
        assert code in (0, 1) or last[0].startswith(f"trinolab {line.split()[0]}: "), (
            said.getvalue()
        )
        assert "not enough memory" not in said.getvalue(), said.getvalue()

    attempt()
    return codes
