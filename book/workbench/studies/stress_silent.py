"""The bench broken as in `stress`, and rig files that say nothing.

    python -m workbench.studies stress_silent

makes ``stress_silent.csv`` again. The instants are the first ones of ``stress.csv``. Where `stress` has
a rig that states that it is exact, or how well it is known, this one has no word of it: a usual
calibration is assumed, and whether the fault is one of the rig is not known. Faults of the
calibration itself are silent in `stress` already.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

from trinolab.datasets import load_handle

from .broken import FAULTS
from .replication import EVERY
from .stress import instants, methods_of, rows_of, summed

SILENT_FAULTS = tuple(name for name in FAULTS if not name.startswith("calibration"))


def trial(fault: str, handle: str, block: int) -> dict[str, float]:
    """As `stress.trial`, with rigs that say nothing."""
    truths, taken = instants(fault, handle, block)
    silent = [one._replace(rig=replace(one.rig, covariance=None)) for one in taken]
    return summed(silent, truths, load_handle(handle), methods_of(block))


def make_table(instants: int, workers: int, kept: Path | None) -> pd.DataFrame:
    """The faults of `SILENT_FAULTS`; parameters, columns and errors as for `stress.make_table`."""
    return rows_of(trial, SILENT_FAULTS, tuple(EVERY), instants, workers, kept)
