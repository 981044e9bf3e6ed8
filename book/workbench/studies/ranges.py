"""The rule of the front's verdicts: one holds over the whole range of what the paper leaves open, one
assumption at a time, else it is undecided. The ranges are ``data/ranges.toml`` and
``data/sensitivity.csv``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, Protocol

import pandas as pd

from trinolab.datasets import data_path
from trinolab.files.inputs import get, read_toml

from .protocol import Claim, load_claims

UNDECIDED = "undecided"
SHOWN = 2  # choices that a row names


class Estimate(Protocol):
    """A value with its interval, as `scoreboard.Result`."""

    @property
    def value(self) -> float: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...


class Range(NamedTuple):
    """Another choice that the paper allows as well.

    Attributes
    ----------
    assumption, instead : str
        The assumption's name in ``book/assumptions.md``, and what holds instead.
    trial : str
        Whose draws give the checks.
    checks : dict of str to str
        From a row of the ledger to the check that computes its value there.
    """

    assumption: str
    instead: str
    trial: str
    checks: dict[str, str]


class Elsewhere(NamedTuple):
    """The value of a row with one other choice, and the verdict there; NaN where it was not run."""

    assumption: str
    instead: str
    value: float
    low: float
    high: float
    verdict: str


@cache
def load_ranges() -> tuple[Range, ...]:
    """Load the ledger of ranges, ``data/ranges.toml``, in its order."""
    path = data_path("ranges.toml")
    return tuple(
        Range(
            row["assumption"],
            row["instead"],
            row["trial"],
            dict(zip(row["claims"], row["checks"], strict=True)),
        )
        for row in get(read_toml(path), "range", str(path))
    )


def statistics_of(trial: str) -> dict[str, str]:
    """The checks of the ranges of a trial, each with the statistic of its row."""
    statistics = {claim.no: str(claim.statistic) for claim in load_claims()}
    return {
        check: statistics[no]
        for one in load_ranges()
        if one.trial == trial
        for no, check in one.checks.items()
    }


def elsewhere(claim: Claim, base: Estimate, results: Mapping[str, Estimate]) -> list[Elsewhere]:
    """A row with each other choice in turn.

    Parameters
    ----------
    claim : Claim
    base : Estimate
        Its value as assumed.
    results : mapping of str to Estimate
        From a check to its value.
    """
    found = [
        (one.assumption, one.instead, results.get(one.checks[claim.no]))
        for one in load_ranges()
        if claim.no in one.checks
    ]
    rows = [
        _judged(claim, assumption, instead, result.value, result.low, result.high)
        if result is not None
        else Elsewhere(assumption, instead, math.nan, math.nan, math.nan, "not run")
        for assumption, instead, result in found
    ]
    for row in _sensitivity().get(claim.no, ()):
        changed = base.value + row.difference, base.low + row.low, base.high + row.high
        rows.append(_judged(claim, row.assumption, row.instead, *changed))
    return sorted(rows, key=lambda row: int(row.assumption.removeprefix("A")))


@cache
def _sensitivity() -> dict[str, list[Any]]:
    """The rows of ``data/sensitivity.csv`` that stand for a row of the front."""
    path = data_path("ranges.toml")
    stands_for = get(read_toml(path), "sensitivity", str(path))
    table = pd.read_csv(data_path("sensitivity.csv")).dropna(subset="difference")
    return {
        no: list(table[table["claim"] == other].itertuples()) for no, other in stands_for.items()
    }


def over_range(verdict: str, others: Sequence[Elsewhere]) -> str:
    """The verdict over the whole range; what was not run says nothing."""
    same = all(one.verdict in (verdict, "not run") for one in others)
    return verdict if same else UNDECIDED


def deciding(verdict: str, others: Sequence[Elsewhere]) -> str:
    """The choices with which a row has another verdict than as assumed, as a sentence: those that
    turn it round, or else those with the narrowest intervals.
    """
    run = [one for one in others if one.verdict != "not run"]
    missing = len(others) - len(run)
    rest = f" We did not run {_choices(missing, 'further')}." if missing else ""
    if not run or all(one.verdict == UNDECIDED == verdict for one in run):
        return rest.strip()
    if over_range(verdict, run) == verdict != UNDECIDED:
        return f"The verdict is the same with {_choices(len(run), 'other')}.{rest}"
    turned = [one for one in run if one.verdict not in (verdict, UNDECIDED)]
    open_ = [one for one in run if one.verdict == UNDECIDED != verdict]
    open_.sort(key=lambda one: one.high - one.low)
    named = (turned or open_)[:SHOWN]
    texts = [
        f"{one.instead} ({one.assumption}): {one.value:.3g} ({one.low:.3g} to {one.high:.3g}), "
        f"{one.verdict}"
        for one in named
    ]
    more = len(turned) + len(open_) - len(named)
    others_too = f"; and {_choices(more, 'more')}" if more else ""
    assumed = f'With our assumptions the verdict is "{verdict}". It changes with these choices:'
    return f"{assumed} {'; '.join(texts)}{others_too}.{rest}"


def _choices(count: int, kind: str) -> str:
    return f"{count} {kind} choice{'s' if count > 1 else ''}"


def _judged(
    claim: Claim, assumption: str, instead: str, value: float, low: float, high: float
) -> Elsewhere:
    verdict = claim.computed_verdict(value, low, high)
    return Elsewhere(assumption, instead, value, low, high, verdict)
