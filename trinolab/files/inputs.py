"""Tables that are read: TOML, JSON and CSV. What cannot be read is a ValueError that names the file."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

__all__ = ["get", "read_csv", "read_json", "read_toml"]


def read_csv(path: str | Path, **options: Any) -> pd.DataFrame:
    """Read a CSV file of this computer; `options` are those of `pandas.read_csv`.

    The file is opened here: pandas would fetch an address, and unpack what is named like an
    archive.

    Raises
    ------
    ValueError
        Names the file: unreadable, empty, no text, rows of different lengths.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            table = pd.read_csv(file, low_memory=False, **options)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
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


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file; what cannot be opened or parsed is a ValueError that names the file."""
    try:
        with Path(path).open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except RecursionError:
        raise ValueError(f"{path}: no valid TOML (lists within lists, too many)") from None
    except (
        ValueError
    ) as error:  # tomllib's own, text that is not UTF-8, a whole number of thousands of digits
        raise ValueError(f"{path}: no valid TOML ({error})") from None


def read_json(path: str | Path) -> Any:
    """Read a JSON file; what cannot be opened or parsed is a ValueError that names the file."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise ValueError(f"{path}: no valid JSON") from None
