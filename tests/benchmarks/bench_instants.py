"""How the times of single instants of a track spread over the standard motions: whoever moves a
robot feels the worst one, not the median.

Calm and hard recordings, a hand as fast as hands are, and a task with an arm; see
`workbench.studies.instant_times`. For the follower with the best estimator and for the paper's chain:
median, 99 %, 99.9 % and worst of the processor time, in ms and by what SimpleBlobDetector takes for
the same images in the same run; the share that is measured of the instants with a handle, the mean
error, and how many poses are false. Films are rendered and followed by processes, one a core:

    python tests/benchmarks/bench_instants.py [--instants 685] [--draws 15]

With draws each instant is seen so often, with other noise: most of the time goes into rendering.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse

import numpy as np
import pandas as pd

from workbench.studies.instant_times import INSTANTS, METHODS, all_followed, films
from workbench.studies.replication import WRONG_DEG, WRONG_MM

SHARES = (0.5, 0.99, 0.999, 1.0)


def line(name: str, table: pd.DataFrame) -> str:
    """Times, ratios and errors of some instants."""
    times = "".join(f"{value:8.1f}" for value in np.quantile(table["ms"], SHARES))
    ratios = "".join(f"{value:8.2f}" for value in np.quantile(table["ratio"], SHARES))
    is_measured = np.isfinite(table["mm"])
    share = 100 * is_measured.sum() / max(table["present"].sum(), 1)
    error_mm = table["mm"][is_measured].mean()
    false = ((table["mm"] > WRONG_MM) | (table["deg"] > WRONG_DEG)).sum()
    return f"  {name:16s}{len(table):6d}{times}  {ratios}{share:8.1f} %{error_mm:9.4f} mm{false:6d}"


def report(instants: int = INSTANTS, workers: int = 1, draws: int = 1) -> None:
    """Print the times of the follower and of the paper's chain, motion by motion and of all."""
    columns = "".join(f"{f'{100 * share:g} %':>8}" for share in SHARES)
    for method in METHODS:
        table = all_followed(films(instants), method, workers, draws)
        print(
            f"{method}: ms, and by SimpleBlobDetector ({table['blobs_ms'].median():.1f} ms an "
            f"instant)\n{'':18}{'n':>6}{columns}  {columns}  measured   mean error false"
        )
        for (motion, exposure_ms), rows in table.groupby(["motion", "exposure_ms"]):
            print(line(f"{motion}, {exposure_ms:g} ms", rows))
        print(line("all", table), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--instants", type=int, default=INSTANTS, help="how many (%(default)s)")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes (one a core)"
    )
    parser.add_argument(
        "--draws", type=int, default=1, help="of the noise of each instant (%(default)s)"
    )
    arguments = parser.parse_args()
    report(arguments.instants, arguments.workers, arguments.draws)


if __name__ == "__main__":
    main()
