"""The run of the protocol: every trial by its frozen number of draws and seed.

python -m workbench.studies claims

makes ``data/claims_results.csv``, and ``data/claims_draws.csv`` with the numbers of each draw. A draw
is kept as soon as it is made, so that an interruption loses none, and the tables are written after
each trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from trinolab.checks import Array
from trinolab.files.outputs import check_targets, write_table

from ..intervals import NONE, Interval, of_ratio, of_share, of_student, ratio
from .carrier import kept_draws
from .claim_draws import TRIALS, Draw
from .protocol import Claim, Trial, frozen_hash, load_claims, load_trials

DRAWS = ("trial", "k", "check", "a", "b")
COLUMNS = ("check", "trial", "statistic", "value", "low", "high", "n", "draws", "seed")


def make_tables(results: Path, every: Path, kept: Path, names: Sequence[str] = ()) -> None:
    """Run trials, all without `names`, and put what they give into two tables, of the results and of
    every draw; the rows of other trials stay.

    Raises
    ------
    ValueError
        For an unknown trial, or a file that another process has or that cannot be written.
    """
    if unknown := [name for name in names if name not in TRIALS]:
        raise ValueError(f"trial: expected one of {', '.join(TRIALS)}, got {unknown[0]!r}")
    kept.mkdir(parents=True, exist_ok=True)
    for name in names or TRIALS:
        trial = load_trials()[name]
        draws = drawn(name, trial, kept / f"{name}.jsonl")
        _put(table_of_draws(name, draws), every, name)
        _put(results_of(name, trial, draws), results, name)


def make_tables_in(out: Path, kept: Path, names: Sequence[str]) -> None:
    """`make_tables` into the files of a folder, each found to be writable first."""
    results, every = out / "claims_results.csv", out / "claims_draws.csv"
    check_targets([results, every])
    make_tables(results, every, kept, names)


def table_of_draws(name: str, draws: Sequence[Draw]) -> pd.DataFrame:
    """The numbers a and b of each draw; columns `DRAWS`."""
    rows = [(name, k, check, *pair) for k, draw in enumerate(draws) for check, pair in draw.items()]
    return pd.DataFrame(rows, columns=list(DRAWS))


def draws_of(table: pd.DataFrame, name: str) -> list[Draw]:
    """The draws of a trial from a table as `table_of_draws` gives it."""
    draws: dict[int, Draw] = {}
    for row in table[table["trial"] == name].itertuples():
        draws.setdefault(int(row.k), {})[str(row.check)] = (float(row.a), float(row.b))
    return [draws[k] for k in sorted(draws)]


def _put(rows: pd.DataFrame, path: Path, name: str) -> None:
    """Put the rows of a trial into a table, in the place of those that it has."""
    if path.exists():
        others = pd.read_csv(path)
        rows = pd.concat([others[others["trial"] != name], rows])
    write_table(rows, path)


def drawn(name: str, trial: Trial, path: Path) -> list[Draw]:
    """All draws of a trial, those in the file taken up."""
    about = {"trial": name, "seed": trial.seed}
    return kept_draws(path, about, trial.draws, lambda k: TRIALS[name](k, trial.seed), name)


def results_of(name: str, trial: Trial, draws: Sequence[Draw]) -> pd.DataFrame:
    """A row for each check that a claim has in a trial; columns `COLUMNS`."""
    rows = []
    for claim in checks_of(name):
        pairs = np.array([draw[str(claim.check)] for draw in draws], float)
        pairs = pairs[pairs[:, 1] != 0]
        value, interval = estimated(pairs, str(claim.statistic))
        numbers = (value, interval.low, interval.high, len(pairs), len(draws), trial.seed)
        rows.append((claim.check, name, claim.statistic, *numbers))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def checks_of(name: str) -> list[Claim]:
    """A claim for each check of a trial; several may have the same."""
    return list({claim.check: claim for claim in load_claims() if claim.trial == name}.values())


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
