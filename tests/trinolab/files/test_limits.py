"""The budget of what is read: what is within it is taken, what is beyond is refused before it is read."""

import os
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trinolab.camera import RigCovariance
from trinolab.files import limits
from trinolab.files.inputs import read_csv, read_toml
from trinolab.files.rigs import covariance_text

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)


def each(line):
    """A line for each of 3,000 names."""
    return "".join(line.format(k=k) for k in range(3000))


def test_a_regular_file_of_so_many_bytes_is_read_and_no_longer_one(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 100)
    assert limits.read_bytes(tmp_path / "a", 100) == b"x" * 100
    with pytest.raises(ValueError, match=r"a: 0\.0 MiB, expected at most 0"):
        limits.read_bytes(tmp_path / "a", 99)
    with pytest.raises(FileNotFoundError):
        limits.read_bytes(tmp_path / "none", 99)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name on this system")
def test_nobody_waits_at_a_pipe(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(
        ValueError, match=r"pipe: cannot be read \(a pipe, expected a regular file\)"
    ):
        limits.read_bytes(tmp_path / "pipe", 99)
    # also if it has become one since it was asked
    monkeypatch.setattr(limits, "check_regular", lambda path: None)
    with pytest.raises(ValueError, match=r"a pipe, expected a regular file"):
        limits.read_bytes(tmp_path / "pipe", 99)


DEEP, N = limits.DOTS, limits.ENTRIES


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a" + ".a" * DEEP + " = 1", ""),
        ("a" + ".a" * (DEEP + 1) + " = 1", "a name of more than 32 dots"),
        ("[a" + " . 'a'" * (DEEP + 1) + "]", "a name of more than 32 dots"),
        ("x = [" + "0.5, 1.25, " * 1000 + "]", ""),
        ("x = '" + ". " * 1000 + "'", ""),
        ('x = "' + "a " * 100_000 + '"', ""),
        ("x = [" + "1," * N + "]", ""),
        ("x = [" + "1," * N + "1,]", "expected at most 100,000 commas, got 100,001$"),
        ("\n" * (N + 1), "expected at most 100,000 lines, got 100,001$"),
        (each("[a{k}.a.a.a.a.a]\n"), "10,000 dots in its names, got 15,000"),
        (each("a{k} . 'a'.\"a\".a.a.a.a = 1.5\n"), "10,000 dots in its names, got 18,000"),
        (each("a{k}.1.2.3.4.5 = -1.5e3\n"), "10,000 dots in its names, got 15,000"),
        (each("x{k} = [[1.5, -2.5, 3.5e-7, 1.5], [+0.5, 1.5]]\n"), ""),
        (
            each("[a{k}]\nx = 1\n[b{k}]\nx = {{}}\n[[c{k}]]\nx = []\n[d{k}]\n"),
            "20,000 tables and lists, got 21",
        ),
    ],
    ids=range(14),
)
def test_a_toml_file_has_so_many_names_commas_and_tables(tmp_path, text, said):
    (tmp_path / "a.toml").write_text(text)
    if not said:
        assert read_toml(tmp_path / "a.toml")
        return
    with pytest.raises(ValueError, match=rf"a\.toml: .*{said}"):
        read_toml(tmp_path / "a.toml")


def test_the_covariance_of_as_many_cameras_as_a_rig_may_have_is_read(tmp_path):
    """With all digits of all numbers."""
    names = [f"camera{k}" for k in range(limits.CAMERAS)]
    known = RigCovariance.exact(names)
    factor = np.random.default_rng(0).normal(size=known.matrix.shape)
    text = covariance_text(replace(known, matrix=factor @ factor.T))
    (tmp_path / "a.toml").write_text(text)
    assert read_toml(tmp_path / "a.toml", limits.COVARIANCE_BYTES)["cameras"] == names


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("," * (limits.COLUMNS - 1) + "\n", ""),
        ("," * limits.COLUMNS + "\n", "1,000 columns, got 1,001"),
        ("a\r1" + "," * limits.COLUMNS + "\r", "1,000 columns, got 1,001"),
        ("a\n" * (limits.LINES + 1), "1,000,000 lines, got 1,000,001"),
        (("," * 999 + "\n") * 10_001, "10,000,000 cells, got 10,001,000"),
    ],
    ids=["columns", "a column more", "in a row", "lines", "cells"],
)
def test_a_table_has_so_many_lines_columns_and_cells(tmp_path, text, said):
    path = tmp_path / "a.csv"
    path.write_text(text, newline="")
    if not said:
        assert len(read_csv(path).columns) == limits.COLUMNS
        return
    with pytest.raises(ValueError, match=f"expected at most {said}"):
        read_csv(path)


# --- images, in a process that loads OpenCV anew

LOADS = """
import sys
from pathlib import Path
import {first}
from trinolab.files.images import read_grey
for name in sys.argv[1:]:
    try:
        read_grey(Path(name))
    except ValueError as error:
        print(error)
"""


def said_by_a_process(first, folder, contents):
    """What a process that loads a module first says of images."""
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    environment = {k: v for k, v in os.environ.items() if "MAX_IMAGE" not in k}
    command = [sys.executable, "-c", LOADS.format(first=first), *contents]
    done = subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True
    )
    return done.stdout.splitlines()


def test_an_image_is_refused_before_it_is_decoded(tmp_path):
    """With the limit that `trinolab` gives to OpenCV, by small images whose headers state a size; their
    bodies are not even there.
    """
    width, height = 10_000, limits.PIXELS // 10_000 + 1
    bmp, jpg = (bytearray(cv2.imencode(kind, GREY)[1].tobytes()) for kind in (".bmp", ".jpg"))
    bmp[18:26] = width.to_bytes(4, "little") + height.to_bytes(4, "little")
    at = jpg.index(b"\xff\xc0") + 5
    jpg[at : at + 4] = height.to_bytes(2) + width.to_bytes(2)
    images = {"a.bmp": bmp, "a.jpg": jpg, "a.pgm": b"P5 %d %d 255\n" % (width, height)}
    assert said_by_a_process("trinolab", tmp_path, images) == [
        f"{name}: expected at most 50 million pixels, got more" for name in images
    ]


def test_an_image_is_refused_all_the_same_where_opencv_was_loaded_before(tmp_path):
    image = cv2.imencode(".png", np.zeros((5001, 10_000), np.uint8))[1].tobytes()
    assert said_by_a_process("cv2", tmp_path, {"a.png": image}) == [
        "a.png: 10000 x 5001 pixels, expected at most 50 million"
    ]
