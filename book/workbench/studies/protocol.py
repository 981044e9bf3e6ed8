"""The protocol: the ledger of claims with their criteria, which are frozen, the rule of the
verdicts, and the log of deviations.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from trinolab.checks import as_number
from trinolab.datasets import data_path
from trinolab.files.inputs import get, read_toml

from ..intervals import of_share

KINDS = (
    "re-computation",
    "replication as printed",
    "replication as corrected",
    "ours beyond",
)
NOT_FROZEN = ("question", "answer", "verdict", "reason")


class Trial(NamedTuple):
    """A trial of the protocol: how many draws, from which seed, and what is drawn at random."""

    draws: int
    seed: int
    drawn: str


@dataclass(frozen=True)
class Claim:
    """One row of the ledger of claims; the fields are explained at the top of
    ``data/claims.toml``.
    """

    no: str
    claim: str
    section: str
    paper: float | str
    unit: str
    criterion: str
    verdict: str
    reason: str
    quote: str = ""
    kind: str = "ours beyond"
    check: str | None = None
    match_within: float | None = None
    at_most: float | None = None
    at_least: float | None = None
    trial: str | None = None
    statistic: str | None = None
    question: str | None = None
    answer: str | None = None

    @property
    def is_ours(self) -> bool:
        """Whether it is a requirement of our own, of which the paper says nothing."""
        return self.paper == ""

    def computed_verdict(
        self, value: float, low: float | None = None, high: float | None = None
    ) -> str:
        """What a computed value and its interval make of the claim, by the criterion's numbers.

        Parameters
        ----------
        value : float
        low, high : float, optional
            Its interval. A re-computation, and what is not drawn, is decided by the value alone.

        Returns
        -------
        str
            "match", "differs" or "undecided" where the paper says something; "met", "missed" or
            "undecided" where it does not; the declared verdict where the criterion has no number.

        Raises
        ------
        ValueError
            For a row that is drawn, without its interval: one value of many decides nothing.
        """
        number = as_number(value, "value")
        least, most = self._limits()
        if least == -np.inf and most == np.inf:
            return self.verdict
        alone = low is None or high is None or np.isnan(low + high)
        if alone and self.trial is not None:
            raise ValueError(
                f"claim {self.no}: expected the interval of a value that is drawn, got none"
            )
        by_value = alone or self.kind == KINDS[0]
        ends = (number, number) if by_value else (float(low or 0.0), float(high or 0.0))
        yes, no = ("met", "missed") if self.is_ours else ("match", "differs")
        if least <= ends[0] and ends[1] <= most:
            return yes
        return no if ends[1] < least or ends[0] > most else "undecided"

    def _limits(self) -> tuple[float, float]:
        """The smallest and the largest number that the criterion allows."""
        if self.match_within is not None:
            paper = as_number(self.paper, f"claim {self.no}: paper")
            return paper - self.match_within, paper + self.match_within
        return (
            -np.inf if self.at_least is None else self.at_least,
            np.inf if self.at_most is None else self.at_most,
        )


def load_claims() -> tuple[Claim, ...]:
    """Load the ledger of the paper's claims, in its order.

    Raises
    ------
    ValueError
        Names the row and the field that is missing or unknown.
    """
    path = data_path("claims.toml")
    return tuple(
        _claim_from(row, f"{path}: claim {row.get('no', k)}")
        for k, row in enumerate(get(read_toml(path), "claim", str(path)), start=1)
    )


def load_trials() -> dict[str, Trial]:
    """Load the trials of the protocol, by name."""
    path = data_path("claims.toml")
    return {name: Trial(**t) for name, t in get(read_toml(path), "trial", str(path)).items()}


def _claim_from(row: dict[str, Any], where: str) -> Claim:
    fields = Claim.__dataclass_fields__
    unknown = sorted(set(row) - set(fields))
    if unknown:
        raise ValueError(f"{where}: '{unknown[0]}' is not a field of a claim ({', '.join(fields)})")
    for name in ("no", "claim", "section", "paper", "unit", "criterion", "verdict", "reason"):
        get(row, name, where)
    return Claim(**row)


def frozen_hash(claim: Claim, trials: dict[str, Trial]) -> str:
    """A hash of all that is frozen of a row, with its trial; 16 hexadecimal digits."""
    fields = {
        name: value
        for name, value in asdict(claim).items()
        if name not in NOT_FROZEN and value is not None
    }
    trial = trials[claim.trial]._asdict() if claim.trial else None
    text = json.dumps([fields, trial], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class Deviation(NamedTuple):
    """An entry of the log: when which claims were changed, what was there before, what now, why; the
    new hashes where the protocol was frozen already.
    """

    date: str
    claims: list[str]
    was: str
    now: str
    why: str
    hashes: dict[str, str]


def load_deviations() -> tuple[Deviation, ...]:
    """Load the log of deviations, ``data/deviations.toml``, in its order."""
    path = data_path("deviations.toml")
    rows = get(read_toml(path), "deviation", str(path))
    return tuple(Deviation(**{"hashes": {}, **row}) for row in rows)


def logged_hashes() -> dict[str, str]:
    """The hash of each row as it was frozen, or as the log has changed it since."""
    path = data_path("deviations.toml")
    hashes = dict(get(get(read_toml(path), "frozen", str(path)), "hashes", str(path)))
    for entry in load_deviations():
        hashes.update(entry.hashes)
    return hashes


def can_show(claim: Claim, trials: dict[str, Trial]) -> str:
    """What the sample of a claim can show at best, in words; "" where that is not known before."""
    if claim.trial is None or claim.statistic not in ("share", "ratio") or claim.at_least is None:
        return ""
    n = trials[claim.trial].draws
    return f"{n} of {n} would show {of_share(n, n).low:.2f} or more"
