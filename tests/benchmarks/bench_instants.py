"""How the times of single instants of a track spread over the standard motions: whoever moves a
robot feels the worst one, not the median.

Calm and hard recordings, a hand as fast as hands are, a task with an arm, a rig that says nothing of
its errors, a recorded hand; see `workbench.studies.instant_times`. For the follower with the best
estimator and for the paper's chain: median, 99 %, 99.9 % and worst of the processor time, in ms and by
what SimpleBlobDetector takes for the same images in the same run; the share that is measured of the
instants at which that is possible, root mean squares of the errors, mean NEES, and how many poses are
false. Films are rendered and followed by processes, one a core:

    python tests/benchmarks/bench_instants.py [--instants 10000]

Each instant is rendered once and taken in many draws of its noise, so that there are so many.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse

import pandas as pd

from workbench.studies.instant_times import (
    METHODS,
    SHARES,
    all_followed,
    films,
    numbers,
    statistics,
)


def line(name: str, table: pd.DataFrame) -> str:
    """Times, ratios and errors of some instants."""
    values = numbers(table)
    values |= {what: statistic(rows) for what, (rows, statistic) in statistics(table).items()}
    times = "".join(f"{values[f'ms_{share}']:8.1f}" for share in SHARES)
    ratios = "".join(f"{values[f'ratio_{share}']:8.2f}" for share in SHARES)
    return (
        f"  {name:16s}{len(table):6d}{times}  {ratios}{values['measured']:8.1f} %"
        f"{values['rms_mm']:9.4f} mm{values['rms_deg']:7.3f} deg{values['nees']:7.2f}{values['wrong']:6d}"
    )


def report(instants: int, workers: int) -> None:
    """Print the times of the follower and of the paper's chain, motion by motion and of all."""
    columns = "".join(f"{f'{100 * share:g} %':>8}" for share in SHARES.values())
    for method in METHODS:
        table = pd.concat(all_followed(films(instants), method, workers))
        print(
            f"{method}: ms, and by SimpleBlobDetector ({table['blobs_ms'].median():.1f} ms an "
            f"instant)\n{'':18}{'n':>6}{columns}  {columns}  measured      rms      rms deg   NEES false"
        )
        for (motion, exposure_ms), rows in table.groupby(["motion", "exposure_ms"]):
            print(line(f"{motion}, {exposure_ms:g} ms", rows))
        print(line("all", table), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--instants", type=int, default=10_000, help="how many (%(default)s)")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes (one a core)"
    )
    arguments = parser.parse_args()
    report(arguments.instants, arguments.workers)


if __name__ == "__main__":
    main()
