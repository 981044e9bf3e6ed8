"""What an image file says of its size, before anything is decoded: PNG, JPEG, TIFF, BMP, PGM."""

from __future__ import annotations

import re
import struct
from typing import NamedTuple


class Stated(NamedTuple):
    """Width and height of an image, px, and how many pixels its decoder holds at a time: a TIFF's
    tile may be larger than the image.
    """

    width: int
    height: int
    held: int


def stated(data: bytes) -> Stated | None:
    """What an image file states; None if it is none of these formats, or says nothing of its size."""
    for begins, read in (
        (b"\x89PNG\r\n\x1a\n", _png),
        (b"\xff\xd8\xff", _jpeg),
        (b"II", _tiff),
        (b"MM", _tiff),
        (b"BM", _bmp),
        (b"P", _pnm),
    ):
        if data.startswith(begins):
            try:
                width, height, *tile = read(data)
            except (struct.error, ValueError):  # it is cut off, or says something else
                return None
            held = max(width, *tile[:1], 0) * max(height, *tile[1:], 0)
            return Stated(width, height, held) if width > 0 and height > 0 else None
    return None


def _png(data: bytes) -> tuple[int, ...]:
    kind, width, height = struct.unpack_from(">4sII", data, 12)
    if kind != b"IHDR":
        raise ValueError
    return width, height


def _jpeg(data: bytes) -> tuple[int, ...]:
    """From the frame header; the segments before it are passed over."""
    at = 2
    while True:
        mark, kind, length = struct.unpack_from(">BBH", data, at)
        if mark != 0xFF:
            raise ValueError
        if kind == 0xFF:  # a filling byte
            at += 1
        elif 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        elif kind == 0xD9 or kind == 0xDA:  # the image begins, or ends
            raise ValueError
        else:
            at += 2 + length


# A TIFF's tags: of the image, of a tile, of a strip.
_WIDTH, _HEIGHT, _TILE_WIDTH, _TILE_HEIGHT, _STRIP = 256, 257, 322, 323, 278
_WHOLE_IMAGE = 2**32 - 1  # rows of a strip


def _tiff(data: bytes) -> tuple[int, ...]:
    """From the first directory. Of a tag that is there twice the largest value counts."""
    order = "<" if data.startswith(b"II") else ">"
    (version,) = struct.unpack_from(f"{order}H", data, 2)
    if version not in (42, 43):
        raise ValueError
    big = version == 43
    offset, counted, entry = ("Q", "Q", "HHQQ") if big else ("I", "H", "HHII")
    (at,) = struct.unpack_from(order + offset, data, 8 if big else 4)
    (count,) = struct.unpack_from(order + counted, data, at)
    at += struct.calcsize(order + counted)
    values: dict[int, int] = {}
    for _ in range(min(count, 4096)):
        tag, kind = struct.unpack_from(order + entry[:2], data, at)
        form = {3: "H", 4: "I", 16: "Q"}.get(kind)
        if form is not None and tag in (_WIDTH, _HEIGHT, _TILE_WIDTH, _TILE_HEIGHT, _STRIP):
            (value,) = struct.unpack_from(order + form, data, at + (12 if big else 8))
            if (tag, value) != (_STRIP, _WHOLE_IMAGE):
                values[tag] = max(values.get(tag, 0), value)
        at += struct.calcsize(order + entry)
    tile_height = max(values.get(_TILE_HEIGHT, 0), values.get(_STRIP, 0))
    return values.get(_WIDTH, 0), values.get(_HEIGHT, 0), values.get(_TILE_WIDTH, 0), tile_height


def _bmp(data: bytes) -> tuple[int, ...]:
    (length,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if length == 12 else "<ii", data, 18)
    return width, abs(height)  # rows from the top have a height below zero


def _pnm(data: bytes) -> tuple[int, ...]:
    words = re.match(
        rb"P[1-6]\s(?:\s|#[^\n]*\n)*(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s", data[:4096]
    )
    if words is None:
        raise ValueError
    return int(words[1]), int(words[2])
