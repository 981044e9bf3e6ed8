"""The budget of what is read: what is within it is taken, what is beyond is refused before it is read."""

import os
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trinolab.camera import RigCovariance
from trinolab.files import limits
from trinolab.files.imageheader import Stated, stated
from trinolab.files.images import read_grey
from trinolab.files.inputs import read_csv, read_toml
from trinolab.files.kept import KeptLines, sole_writer
from trinolab.files.rigs import covariance_text

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)


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


@pytest.mark.parametrize(
    ("text", "taken"),
    [
        ("a" + ".a" * limits.DOTS + " = 1", True),
        ("a" + ".a" * (limits.DOTS + 1) + " = 1", False),
        ("[a" + " . 'a'" * (limits.DOTS + 1) + "]", False),
        ("x = [" + "0.5, 1.25, " * 1000 + "]", True),
        ("x = [\n" + "0.5,\n" * 1000 + "]", True),
        ("x = '" + ". " * 1000 + "'", True),
        ("x = '" + "a" * 100_000 + "'", True),
        ('x = "' + "a " * 100_000 + '"', True),
    ],
)
def test_names_within_names_are_counted_and_numbers_are_not(tmp_path, text, taken):
    (tmp_path / "a.toml").write_text(text)
    if taken:
        assert read_toml(tmp_path / "a.toml")
    else:
        with pytest.raises(ValueError, match=r"a\.toml: a name of more than 32 dots"):
            read_toml(tmp_path / "a.toml")


def test_a_toml_file_has_so_many_commas_and_lines(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("x = [" + "1," * limits.ENTRIES + "]")
    assert len(read_toml(path)["x"]) == limits.ENTRIES
    path.write_text("x = [" + "1," * limits.ENTRIES + "1,]")
    with pytest.raises(ValueError, match=r"a\.toml: expected at most 100,000 commas, got 100,001$"):
        read_toml(path)
    path.write_text("\n" * (limits.ENTRIES + 1))
    with pytest.raises(ValueError, match=r"a\.toml: expected at most 100,000 lines, got 100,001$"):
        read_toml(path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("[a{k}.a.a.a.a.a]\n", "10,000 dots in its names, got 15,000"),
        ("a{k} . 'a'.\"a\".a.a.a.a = 1.5\n", "10,000 dots in its names, got 18,000"),
        ("a{k}.1.2.3.4.5 = -1.5e3\n", "10,000 dots in its names, got 15,000"),
        ("x{k} = [[1.5, -2.5, 3.5e-7, 1.5], [+0.5, 1.5]]\n", ""),
        (
            "[a{k}]\nx = 1\n[b{k}]\nx = {{}}\n[[c{k}]]\nx = []\n[d{k}]\n",
            "20,000 tables and lists, got 21",
        ),
    ],
)
def test_a_toml_file_has_so_many_names_and_tables(tmp_path, line, said):
    path = tmp_path / "a.toml"
    path.write_text("".join(line.format(k=k) for k in range(3000)))
    if not said:
        assert len(read_toml(path)) == 3000
        return
    with pytest.raises(ValueError, match=rf"a\.toml: expected at most {said}"):
        read_toml(path)


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


def test_rows_that_are_kept_are_no_longer_than_a_table(tmp_path, monkeypatch):
    with KeptLines(tmp_path / "rows", "head\n", lambda *_: True) as rows:
        rows.add_line("x" * 100)
    monkeypatch.setattr(limits, "TABLE_BYTES", 50)
    with pytest.raises(ValueError, match=r"rows: 0\.0 MiB, expected at most 0"):
        KeptLines(tmp_path / "rows", "head\n", lambda *_: True)


# --- images


@pytest.mark.parametrize("shape", [(6, 8), (6, 8, 3), (1, 300), (300, 1)])
@pytest.mark.parametrize("kind", [".png", ".jpg", ".tiff", ".bmp", ".pgm"])
def test_a_header_states_what_the_decoder_finds(kind, shape):
    image = np.zeros(shape, np.uint8)
    if kind == ".pgm" and image.ndim == 3:
        kind = ".ppm"
    header = stated(cv2.imencode(kind, image)[1].tobytes())
    assert header[:2] == (shape[1], shape[0])
    assert header.held >= shape[0] * shape[1]


def test_a_pgm_may_have_comments():
    assert stated(b"P5 # of a\n# camera\n8\n# wide\n6 255\n") == Stated(8, 6, 48)


@pytest.mark.parametrize("kind", [".png", ".jpg", ".tiff", ".bmp", ".pgm"])
def test_a_header_that_is_cut_off_states_nothing_or_the_same(kind):
    content = cv2.imencode(kind, GREY)[1].tobytes()
    for length in range(len(content)):
        assert stated(content[:length]) in (None, stated(content))
    assert stated(b"RIFF....WEBP" + content) is None


def test_of_a_tag_that_a_tiff_has_twice_the_largest_counts():
    content = cv2.imencode(".tiff", GREY)[1].tobytes()
    order = "little" if content[:2] == b"II" else "big"
    at = int.from_bytes(content[4:8], order)
    entries = content[at + 2 : at + 2 + 12 * int.from_bytes(content[at : at + 2], order)]
    parts = [entries[k : k + 12] for k in range(0, len(entries), 12)]
    tags = {int.from_bytes(part[:2], order): part for part in parts}
    wide = tags[256][:2] + (4).to_bytes(2, order) + (1).to_bytes(4, order)
    twice = [*parts, wide + (70_000).to_bytes(4, order)]
    body = len(twice).to_bytes(2, order) + b"".join(twice) + bytes(4)
    again = content[:4] + len(content).to_bytes(4, order) + content[8:] + body
    assert stated(again).width == 70_000


def test_an_image_is_refused_by_its_header(tmp_path, monkeypatch):
    """Before it is decoded: its body is not even there."""
    path = tmp_path / "a.bmp"
    content = bytearray(cv2.imencode(".bmp", GREY)[1].tobytes())
    content[18:22] = (100_000).to_bytes(4, "little")
    content[22:26] = (501).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(ValueError, match="100000 x 501 pixels, expected at most 50 million"):
        read_grey(path)
    with pytest.raises(ValueError, match="100000 x 501 pixels, the rig says 8 x 6"):
        read_grey(path, (8, 6))


# --- one writer


def test_one_writes_at_a_time_and_the_lock_is_gone_afterwards(tmp_path):
    pytest.importorskip("fcntl", reason="no such locks on this system")
    target = tmp_path / "rig.toml"
    (tmp_path / ".rig.toml.lock").touch()  # of a process that was killed
    with (
        sole_writer(target),
        pytest.raises(ValueError, match=r"^.*/rig\.toml: another process works on it$"),
        sole_writer(target),
    ):
        pass
    assert list(tmp_path.iterdir()) == []
