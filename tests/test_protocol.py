"""The protocol is frozen: its criteria, its log of deviations, and the rule of the verdicts."""

import re
from dataclasses import replace

import pytest

from trinolab.studies.claim_draws import TRIALS
from trinolab.studies.protocol import (
    KINDS,
    can_show,
    frozen_hash,
    load_claims,
    load_deviations,
    load_trials,
    logged_hashes,
)

CLAIMS = load_claims()
ROWS = load_trials()


def claim(no):
    return next(c for c in CLAIMS if c.no == no)


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.no)
def test_criterion_is_the_frozen_one(claim):
    """Else data/deviations.toml needs an entry: `python -m trinolab.studies claims --hashes`."""
    assert logged_hashes().get(claim.no) == frozen_hash(claim, ROWS)


def test_no_frozen_row_was_dropped():
    assert set(logged_hashes()) == {c.no for c in CLAIMS}


@pytest.mark.parametrize(
    "change",
    [{"at_least": 0.5}, {"criterion": "Anything."}, {"trial": "clip"}, {"statistic": "mean"}],
)
def test_a_moved_criterion_is_found(change):
    row = claim("11")
    assert frozen_hash(replace(row, **change), ROWS) != logged_hashes()["11"]


def test_a_changed_trial_is_found_and_a_verdict_is_not_frozen():
    row = claim("11")
    fewer = {**ROWS, row.trial: ROWS[row.trial]._replace(draws=3)}
    assert frozen_hash(row, fewer) != logged_hashes()["11"]
    assert frozen_hash(replace(row, verdict="x", reason="y"), ROWS) == logged_hashes()["11"]


def test_log_is_in_order_and_names_rows():
    log = load_deviations()
    assert [entry.date for entry in log] == sorted(entry.date for entry in log)
    for entry in log:
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", entry.date)
        assert set(entry.claims) <= {c.no for c in CLAIMS}
        assert set(entry.hashes) <= set(entry.claims)
        assert entry.was
        assert entry.now
        assert entry.why


@pytest.mark.parametrize("row", CLAIMS, ids=lambda row: row.no)
def test_row_says_what_it_is(row):
    assert row.kind in KINDS
    assert row.is_ours == (row.kind == "ours beyond")
    assert bool(row.quote) != row.is_ours
    assert (row.trial is None) == (row.statistic is None)
    assert row.statistic in (None, "share", "mean", "ratio", "rms")
    assert row.kind != "ours beyond" or row.no[-1].isalpha()


def test_every_trial_is_drawn_and_used():
    assert set(ROWS) == set(TRIALS) == {c.trial for c in CLAIMS if c.trial}
    seeds = [trial.seed for trial in ROWS.values()]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) > 1700


@pytest.mark.parametrize(
    ("no", "low", "high", "verdict"),
    [
        ("11", 0.96, 1.0, "match"),
        ("11", 0.94, 1.0, "undecided"),
        ("11", 0.80, 0.94, "differs"),
        ("15", 0.0, 0.009, "match"),
        ("15", 0.0, 0.02, "undecided"),
        ("15", 0.02, 0.03, "differs"),
        ("5", 0.24, 0.38, "match"),
        ("5", 0.06, 0.08, "differs"),
        ("5", 0.2, 0.3, "undecided"),
        ("5a", 0.06, 0.08, "met"),
        ("5a", 0.16, 0.18, "missed"),
        ("5a", 0.14, 0.16, "undecided"),
        ("16", 0.01, 0.02, "cannot be tested"),
        ("2", 0.60, 0.75, "differs"),
    ],
)
def test_interval_makes_the_verdict(no, low, high, verdict):
    # claim 2 is a re-computation: 0.71 alone decides
    middle = 0.71 if no == "2" else (low + high) / 2
    assert claim(no).computed_verdict(middle, low, high) == verdict


def test_what_a_sample_can_show():
    # Wilson: n / (n + 1.96^2) for n of n
    assert can_show(claim("11"), ROWS) == "120 of 120 would show 0.97 or more"
    assert can_show(claim("15"), ROWS) == ""
