"""The Cramer-Rao bound at Table 1's poses, for every shipped rig, on the paper's handle.

    python -m trinolab.table1_bound --out data/sweeps

makes ``bound.csv`` again.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from .bound import Bound, bound_of, information
from .checks import Array
from .datasets import load_handle, load_rig, load_table1
from .factors import write_sweep
from .outputs import check_target

RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")
SHIPPED_PIXELS = ("markers", "around")  # without and with the outline near the markers, see `bound.information`
COLUMNS = ("mean_mm", "mean_deg", "rms_mm", "rms_deg")


def table1_bounds(rig: str, pixels: str = "markers", known_greys: bool = True) -> list[Bound]:
    """The bound at each of Table 1's poses, for a shipped rig; the other parameters are those of `bound.information`.

    Raises ValueError for an unknown name.
    """
    # CCD1 and CCD2 are the same in every rig, and so is what they know
    cameras = [("paper_pair", 0), ("paper_pair", 1), (rig, 2)][:len(load_rig(rig).cameras)]
    return [bound_of(sum((_information(*camera, row, pixels, known_greys) for camera in cameras), np.zeros((6, 6))))
            for row in tqdm(range(len(load_table1().set_poses)), leave=False, unit="pose", disable=None)]


def sweep_bounds() -> pd.DataFrame:
    """A row for each rig, choice of `pixels` and `row` of Table 1: `mean_mm`, `mean_deg`, `rms_mm`, `rms_deg`."""
    bounds = {(rig, pixels): table1_bounds(rig, pixels) for rig in RIGS for pixels in SHIPPED_PIXELS}
    return pd.DataFrame([
        {"rig": rig, "pixels": pixels, "row": row, **{name: getattr(b, name) for name in COLUMNS}}
        for (rig, pixels), found in bounds.items() for row, b in enumerate(found, start=1)])


@cache
def _information(rig: str, camera: int, row: int, pixels: str, known_greys: bool) -> Array:
    return information(load_rig(rig).cameras[camera], load_handle("paper"), load_table1().set_poses[row], None, pixels,
                       known_greys)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the table."""
    parser = argparse.ArgumentParser(prog="python -m trinolab.table1_bound",
                                     description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", default="data/sweeps", help="folder of the table (%(default)s)")
    path = Path(parser.parse_args(argv).out) / "bound.csv"
    check_target(path)
    write_sweep(sweep_bounds(), path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
