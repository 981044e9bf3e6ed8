"""Limits of the files that are read: one budget for all readers.

Files come from others, and a short one may need any amount of memory or time: a header may state a
huge image, names may be nested, content may be compressed. Each reader checks its file here before
it reads the content. The limits are far beyond the needs of a bench of cameras, and a file within
them takes about a second to read.

An image is refused by OpenCV, whose decoders read its header: `trinolab` sets
``OPENCV_IO_MAX_IMAGE_PIXELS``, unless it is set already, before it loads OpenCV. Where OpenCV was loaded
before `trinolab`, its own limit of a thousand million pixels holds until the image is decoded.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import BinaryIO, Final

MIB: Final = 1 << 20
CAMERAS = 16  # of a rig
MARKERS = 200  # of a handle
PIXELS = 50_000_000  # of an image or a video's frame
TOML_BYTES = 1 * MIB  # a second to read
COVARIANCE_BYTES = 2 * MIB  # of 16 cameras it has 1.8
ENTRIES = 100_000  # commas, and lines, of a TOML file; the covariance of 16 cameras has 57,600
DOTS = 32  # of a name in a TOML file
BRACKETS = 20_000  # of a TOML file: tables and lists; the covariance of 16 cameras has 242
ALL_DOTS = 10_000  # of its names: what is shipped has none, a rig with metadata one per camera
TREE_BYTES = 16 * MIB  # JSON, notebooks, and the description of a bag or a robot
TABLE_BYTES = 128 * MIB  # CSV, and rows that are kept
LINES = 1_000_000  # of a CSV file
COLUMNS = 1000
CELLS = 10_000_000  # 500,000 poses: four and a half hours of 30 a second
WORDS = 2_000_000  # of these cells; a word takes four times as long to read as a number
IMAGE_BYTES = 256 * MIB  # of an image file as it lies there
BAG_BYTES = 64 * MIB  # of a bag's messages that are held, decompressed, at a time

# a part of a name, and the dot behind it, more often than `DOTS` says; no step is ever taken back
_NESTED = re.compile(
    rb"(?<![A-Za-z0-9_-])(?:(?:[A-Za-z0-9_-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+\.[ \t]*+){%d}"
    % (DOTS + 1)
)
# a number with a dot, which is no part of a name
_NUMBERS = re.compile(
    rb"(?<![A-Za-z0-9_.\"'-])[+-]?[0-9_]++\.[0-9_]++(?:[eE][+-]?[0-9_]++)?(?![ \t]*+[.=A-Za-z\"'-])"
)


def check_regular(path: str | Path) -> None:
    """Refuse, with a ValueError that names it, what is there and no regular file: a pipe, a device,
    a folder. A file that does not exist passes: opening it raises the error.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(mode):
        raise ValueError(f"{path}: cannot be read ({_kind(mode)}, expected a regular file)")


def open_regular(path: str | Path) -> BinaryIO:
    """Open a regular file to read its bytes.

    Raises
    ------
    OSError
        If it cannot be opened.
    ValueError
        Names what is no regular file; a pipe is not waited for.
    """
    check_regular(path)
    # what has become a pipe meanwhile is opened without waiting, and refused all the same
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(mode := os.fstat(handle).st_mode):
        os.close(handle)
        raise ValueError(f"{path}: cannot be read ({_kind(mode)}, expected a regular file)")
    return os.fdopen(handle, "rb")


def read_bytes(path: str | Path, most: int) -> bytes:
    """Read a regular file of at most so many bytes. Raises as `open_regular`, and ValueError for a
    longer one.
    """
    with open_regular(path) as file:
        check_bytes(path, os.fstat(file.fileno()).st_size, most)
        content = file.read(most + 1)  # it may grow
    check_bytes(path, len(content), most)
    return content


def check_bytes(path: str | Path, count: int, most: int) -> None:
    """Refuse a file of more bytes than the limit."""
    if count > most:
        allowed = f"{most / MIB:,.1f}".removesuffix(".0")
        raise ValueError(f"{path}: {count / MIB:,.1f} MiB, expected at most {allowed}")


def check_count(count: int, most: int, what: str) -> None:
    """Refuse more of something than the limit."""
    if count > most:
        raise ValueError(f"expected at most {most:,} {what}, got {count:,}")


def check_pixels(path: str | Path, width: int, height: int) -> None:
    """Refuse an image, or a video's frames, that are larger than the limit."""
    if width * height > PIXELS:
        raise ValueError(
            f"{path}: {width} x {height} pixels, expected at most {PIXELS / 1e6:.0f} million"
        )


def check_toml(path: str | Path, text: bytes) -> None:
    """Refuse TOML with more commas, lines, tables or dots in names than the limit, or a name of
    more parts: each part is a table within the one before, for which the parser's time and memory
    grow with the square of their number.
    """
    _check(path, text.count(b","), ENTRIES, "commas")
    _check(path, text.count(b"\n"), ENTRIES, "lines")
    _check(path, text.count(b"[") + text.count(b"{"), BRACKETS, "tables and lists")
    if _NESTED.search(text):
        raise ValueError(f"{path}: a name of more than {DOTS} dots")
    dots = text.count(b".")
    if dots > ALL_DOTS:  # those of numbers are not meant
        _check(path, dots - len(_NUMBERS.findall(text)), ALL_DOTS, "dots in its names")


def check_table(path: str | Path, text: bytes, separator: bytes = b",") -> None:
    """Refuse a CSV table of more lines, columns or cells than the limits; a separator between
    quotes counts as well.
    """
    lines = text.count(b"\n") + text.count(b"\r")
    separators = text.count(separator)
    # they are not so many by now that a list of the lines would be long
    _check(path, lines, LINES, "lines")
    _check(path, lines + separators, CELLS, "cells")
    if separators >= COLUMNS:
        widest = max(line.count(separator) for line in text.splitlines())
        _check(path, widest + 1, COLUMNS, "columns")


def _check(path: str | Path, count: int, most: int, what: str) -> None:
    try:
        check_count(count, most, what)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "Is a directory"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device or a socket"
