"""The run of the protocol: every trial by its frozen number of draws and seed. A table has the results,
another the numbers of each draw.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from trinolab.checks import Array
from workbench.intervals import NONE, Interval, of_ratio, of_share, of_student, ratio
from workbench.studies.carrier import all_runs
from workbench.studies.claim_draws import TRIALS, Draw
from workbench.studies.protocol import Trial, frozen_hash, load_claims, load_trials
from workbench.studies.ranges import statistics_of

DRAWS = ("trial", "k", "check", "a", "b")
COLUMNS = ("check", "trial", "statistic", "value", "low", "high", "n", "draws", "seed")


def make_tables(
    kept: Path, before: Sequence[Path], names: Sequence[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Run trials, all without `names`, and return two tables, of the results and of every draw.

    Parameters
    ----------
    kept : path
        Folder of finished draws.
    before : sequence of path
        The two files as they are: the rows of other trials stay.
    names : sequence of str

    Raises
    ------
    ValueError
        For an unknown trial.
    """
    if unknown := [name for name in names if name not in TRIALS]:
        raise ValueError(f"trial: expected one of {', '.join(TRIALS)}, got {unknown[0]!r}")
    results, every = (pd.read_csv(path) if path.exists() else None for path in before)
    for name in names or TRIALS:
        trial = load_trials()[name]
        draws = drawn(name, trial, kept / name)
        every = _with_rows(every, name, table_of_draws(name, draws))
        results = _with_rows(results, name, results_of(name, trial, draws))
    assert results is not None
    assert every is not None
    return results, every


def table_of_draws(name: str, draws: Sequence[Draw]) -> pd.DataFrame:
    """The numbers a and b of each draw; columns `DRAWS`."""
    rows = [(name, k, check, *pair) for k, draw in enumerate(draws) for check, pair in draw.items()]
    return pd.DataFrame(rows, columns=list(DRAWS))


def _with_rows(table: pd.DataFrame | None, name: str, rows: pd.DataFrame) -> pd.DataFrame:
    """The table with these rows of a trial, in the place of those that it has."""
    return rows if table is None else pd.concat([table[table["trial"] != name], rows])


def drawn(name: str, trial: Trial, kept: Path) -> list[Draw]:
    """All draws of a trial, those in the folder taken up."""
    grid = {"trial": [name], "k": range(trial.draws), "seed": [trial.seed]}
    runs = all_runs(name, one_draw, grid, kept, 1)
    checks = [column.removesuffix("/a") for column in runs if column.endswith("/a")]
    return [
        {check: (run[f"{check}/a"], run[f"{check}/b"]) for check in checks}
        for run in runs.to_dict("records")
    ]


def one_draw(trial: str, k: int, seed: int) -> dict[str, float]:
    """The numbers a and b of each check."""
    pairs = TRIALS[trial](k, seed)
    return {
        f"{check}/{name}": x
        for check, pair in pairs.items()
        for name, x in zip("ab", pair, strict=True)
    }


def results_of(name: str, trial: Trial, draws: Sequence[Draw]) -> pd.DataFrame:
    """A row for each check that a claim or a range has in a trial; columns `COLUMNS`."""
    rows = []
    for check, statistic in checks_of(name).items():
        if check not in draws[0]:
            continue  # a range that the trial does not draw
        pairs = np.array([draw[check] for draw in draws], float)
        pairs = pairs[pairs[:, 1] != 0]
        value, interval = estimated(pairs, statistic)
        numbers = (value, interval.low, interval.high, len(pairs), len(draws), trial.seed)
        rows.append((check, name, statistic, *numbers))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def checks_of(name: str) -> dict[str, str]:
    """The checks of a trial that claims and ranges have, each with its statistic."""
    of_claims = {
        str(claim.check): str(claim.statistic) for claim in load_claims() if claim.trial == name
    }
    return of_claims | statistics_of(name)


def estimated(pairs: Array, statistic: str) -> tuple[float, Interval]:
    """The value of a check from the numbers a and b of n draws, and its interval; NaN without a
    draw.

    Parameters
    ----------
    pairs : ndarray, shape (n, 2)
    statistic : {"share", "mean", "ratio", "rms"}
        See the head of ``data/claims.toml``.
    """
    if len(pairs) == 0:
        return float("nan"), NONE
    if statistic == "mean":
        return float(pairs[:, 0].mean()), of_student(pairs[:, 0])
    if statistic == "share":
        return float(pairs[:, 0].mean()), of_share(int(pairs[:, 0].sum()), len(pairs))
    value = ratio(pairs)
    interval = of_ratio(*pairs.T)
    if value in (0.0, 1.0) and interval.low == interval.high:
        interval = of_share(round(value * len(pairs)), len(pairs))
    if statistic == "ratio":
        return value, interval
    low, high = np.sqrt([interval.low, interval.high])
    return float(np.sqrt(value)), Interval(float(low), float(high), interval.how)


def print_hashes() -> None:
    """Print the hash of each row of the protocol, as ``data/deviations.toml`` has them."""
    trials = load_trials()
    for claim in load_claims():
        print(f'"{claim.no}" = "{frozen_hash(claim, trials)}"')
