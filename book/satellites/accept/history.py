"""A8: the control chart: jitter and static accuracy from commit to commit, in a CSV that grows by a
sheet at a time.

Poses and noise follow from the seed, so two rows of one size and seed differ by the code alone; the
interval of the first says which difference another draw would make as well.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from trinolab.files.inputs import read_csv
from trinolab.files.journal import locked
from trinolab.files.outputs import write_whole
from workbench.provenance import commit

from .figures import as_png, plot_control_chart
from .numbers import Number, Picture

# test, quantity, statistic, and a short name for the chart's axis
CHARTED = (
    ("A1", "jitter, position", "rms", "jitter / mm"),
    ("A1", "jitter, rotation", "rms", "jitter / deg"),
    ("A2", "position error", "rms", "static position error, rms / mm"),
    ("A2", "angle error", "rms", "static angle error, rms / deg"),
)
RUN = ("date", "commit", "rig", "handle", "poses", "seed")
COLUMNS = (*RUN, "test", "what", "statistic", "value", "low", "high", "unit", "n")
SHORT = 7  # letters of a commit
ALT = (
    "The {} over the commits, a dot with its interval each; the band is the interval of the first."
)


def rows_of(
    numbers: Sequence[Number], rig: str, handle: str, poses: int, seed: int
) -> pd.DataFrame:
    """The charted numbers of a sheet, one row each, with the commit of this code."""
    name = commit()
    short = name[:SHORT] + ("+" if name.endswith("+") else "") if name else "?"
    run = (datetime.now(UTC).date().isoformat(), short, rig, handle, poses, seed)
    rows = [
        (*run, n.test, n.what, n.statistic, n.value, n.low, n.high, n.unit, n.n)
        for test, what, statistic, _ in CHARTED
        for n in numbers
        if (n.test, n.what, n.statistic) == (test, what, statistic)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def read_history(path: str | Path) -> pd.DataFrame:
    """Read a chart's table. ValueError if a column is missing or holds no numbers."""
    table = read_csv(path, dtype={"commit": str, "rig": str, "handle": str})
    if missing := [name for name in COLUMNS if name not in table]:
        raise ValueError(f"{path}: column '{missing[0]}' is missing")
    for name in ("poses", "seed", "value", "low", "high", "n"):
        if not pd.api.types.is_numeric_dtype(table[name]):
            raise ValueError(f"{path}: column '{name}' holds something that is no number")
    return table


def extend(path: str | Path, rows: pd.DataFrame) -> pd.DataFrame:
    """Add a sheet's rows to a chart's table, which is made if it is not there; those of the same
    commit, rig, handle, size and seed give way.

    Raises
    ------
    ValueError
        Names the file that is no such table, or that cannot be written.
    """
    target = Path(path)
    with locked(target.parent, wait=True):
        if target.exists():
            before = read_history(target)
            keys = list(RUN[1:])
            again = pd.MultiIndex.from_frame(before[keys]).isin(
                pd.MultiIndex.from_frame(rows[keys])
            )
            rows = pd.concat([before[~again], rows], ignore_index=True)[list(COLUMNS)]
        text = rows.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        write_whole(target, text)
    return read_csv(target) if target.exists() else pd.read_csv(io.StringIO(text))


def charts(table: pd.DataFrame, rig: str, handle: str, poses: int, seed: int) -> list[Picture]:
    """A control chart for each of `CHARTED` that the table has for a rig, a handle, a size and a
    seed.
    """
    same = (
        (table["rig"] == rig)
        & (table["handle"] == handle)
        & (table["poses"] == poses)
        & (table["seed"] == seed)
    )
    pictures = []
    for test, what, statistic, label in CHARTED:
        rows = table[
            same
            & (table["test"] == test)
            & (table["what"] == what)
            & (table["statistic"] == statistic)
        ]
        if len(rows):
            limits = rows[["low", "high"]].to_numpy(float)
            value = rows["value"].to_numpy(float)
            limits = np.where(np.isfinite(limits), limits, value[:, None])
            figure = plot_control_chart(rows["commit"].tolist(), value, limits, label)
            pictures.append(Picture(f"chart_{test}_{what}", ALT.format(label), as_png(figure)))
    return pictures
