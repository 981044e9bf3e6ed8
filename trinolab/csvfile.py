"""CSV files as tables: what cannot be read is a ValueError that names the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd


def read_csv(path: str | Path, **options: Any) -> pd.DataFrame:
    """Read a CSV file of this computer; `options` are those of `pandas.read_csv`.

    The file is opened here: pandas would fetch an address, and unpack what is named like an archive.

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
        raise ValueError(f"{path}: no valid CSV ({(str(error).splitlines() or ['?'])[0]})") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path}: no valid CSV (rows have more fields than the first line)")
    return table
