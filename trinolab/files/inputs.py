"""Tables that are read: TOML, JSON and CSV. What cannot be read is a ValueError that names the file,
and so is what is larger than `limits` says.
"""

from __future__ import annotations

import io
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from . import limits

__all__ = ["get", "read_csv", "read_json", "read_toml"]


def read_csv(path: str | Path, **options: Any) -> pd.DataFrame:
    """Read a CSV file of this computer; `options` are those of `pandas.read_csv`.

    The file is read here: pandas would fetch an address, and unpack what is named like an archive.

    Raises
    ------
    ValueError
        Names the file: unreadable, empty, no text, rows of different lengths, too large.
    """
    content = _content(path, limits.TABLE_BYTES)
    limits.check_table(path, content)
    try:
        text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", newline="")
        table = pd.read_csv(text, low_memory=False, **options)
    except (ValueError, OverflowError) as error:  # pandas' own are of the first kind
        raise ValueError(f"{path}: no valid CSV ({_reason(error)})") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path}: no valid CSV (rows have more fields than the first line)")
    return table


def _reason(error: Exception) -> str:
    """What pandas says of a CSV file, in words that need no knowledge of it."""
    if isinstance(error, pd.errors.EmptyDataError):
        return "it is empty"
    if lengths := re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error)):
        first, line, there = lengths.groups()
        return f"line {line} has {there} fields, the lines before have {first}"
    if "EOF inside string" in str(error):
        return "a quotation mark is not closed"
    return (str(error).splitlines() or ["?"])[0]


def get(table: Mapping[str, Any], key: str, where: str) -> Any:
    """Return ``table[key]`` of a file's table; a missing key is a ValueError that names file and
    key.
    """
    if not isinstance(table, Mapping) or key not in table:
        raise ValueError(f"{where}: '{key}' is missing")
    return table[key]


def read_toml(path: str | Path, most: int = limits.TOML_BYTES) -> dict[str, Any]:
    """Read a TOML file of at most so many bytes; what cannot be opened or parsed is a ValueError that
    names the file.
    """
    content = _content(path, most)
    limits.check_names(path, content)
    try:
        return tomllib.loads(content.decode())
    except RecursionError:
        raise ValueError(f"{path}: no valid TOML (lists within lists, too many)") from None
    except (
        ValueError
    ) as error:  # tomllib's own, text that is not UTF-8, a whole number of thousands of digits
        raise ValueError(f"{path}: no valid TOML ({error})") from None


def read_json(path: str | Path) -> Any:
    """Read a JSON file; what cannot be opened or parsed is a ValueError that names the file."""
    content = _content(path, limits.TREE_BYTES)
    try:
        return json.loads(content.decode())
    except (ValueError, RecursionError):
        raise ValueError(f"{path}: no valid JSON") from None


def _content(path: str | Path, most: int) -> bytes:
    """A file's bytes. Raises ValueError, which names it, if it cannot be read, or is longer."""
    try:
        return limits.read_bytes(path, most)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
