"""The protocol is frozen: its criteria, its log of deviations, and the rule of the verdicts."""

import re
from dataclasses import replace

import pytest

from workbench.studies import protocol
from workbench.studies.claim_draws import TRIALS
from workbench.studies.protocol import (
    KINDS,
    can_show,
    frozen_hash,
    load_claims,
    load_deviations,
    load_trials,
    logged_hashes,
)
from workbench.studies.ranges import load_ranges

CLAIMS = load_claims()
ROWS = load_trials()


def claim(no):
    return next(c for c in CLAIMS if c.no == no)


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.no)
def test_criterion_is_the_frozen_one(claim):
    """Else data/deviations.toml needs an entry: `python -m workbench.studies claims --hashes`."""
    assert logged_hashes().get(claim.no) == frozen_hash(claim, ROWS)
    assert claim.kind in KINDS
    assert claim.is_ours == (claim.kind == "ours beyond") == (not claim.quote)
    assert (claim.trial is None) == (claim.statistic is None)
    assert claim.statistic in (None, "share", "mean", "ratio", "rms")
    assert not claim.is_ours or claim.no[-1].isalpha()


@pytest.mark.parametrize(
    "change",
    [
        {"at_least": 0.5},
        {"criterion": "Anything."},
        {"trial": "clip"},
        {"statistic": "mean"},
        {"verdict": "x", "reason": "y"},  # these are not frozen
    ],
)
def test_a_moved_criterion_or_trial_is_found(change):
    row = claim("11")
    moved = frozen_hash(replace(row, **change), ROWS) != logged_hashes()["11"]
    assert moved == ("verdict" not in change)
    fewer = {**ROWS, row.trial: ROWS[row.trial]._replace(draws=3)}
    assert frozen_hash(row, fewer) != logged_hashes()["11"]
    assert set(logged_hashes()) == {c.no for c in CLAIMS}


def test_log_is_in_order_and_names_rows():
    log = load_deviations()
    assert [entry.date for entry in log] == sorted(entry.date for entry in log)
    for entry in log:
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", entry.date)
        assert set(entry.claims) <= {c.no for c in CLAIMS}
        assert set(entry.hashes) <= set(entry.claims)
        assert all((entry.was, entry.now, entry.why))


def test_every_trial_is_drawn_and_used():
    used = {c.trial for c in CLAIMS if c.trial} | {one.trial for one in load_ranges()}
    assert set(ROWS) == set(TRIALS) == used
    seeds = [trial.seed for trial in ROWS.values()]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) > 1700


@pytest.mark.parametrize(
    ("no", "low", "high", "verdict"),
    [
        ("11", 0.96, 1.0, "match"),
        ("11", 0.94, 1.0, "undecided"),
        ("11", 0.80, 0.94, "differs"),
        ("15", 0.02, 0.03, "differs"),
        ("5", 0.24, 0.38, "match"),
        ("5a", 0.06, 0.08, "met"),
        ("5a", 0.16, 0.18, "missed"),
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


# --- the ledger


WORDS = {"no": "1", "claim": "It is so.", "section": "6.5", "unit": "mm"}
JUDGED = {"criterion": "As printed.", "verdict": "cannot be tested", "reason": "No frames."}
ROW = {**WORDS, "paper": 0.5, **JUDGED}


@pytest.fixture
def ledger(tmp_path, monkeypatch):
    """Makes the ledger a file of one row, the given one."""

    def of(row):
        path = tmp_path / "claims.toml"
        path.write_text("[[claim]]\n" + "".join(f"{k} = {v!r}\n" for k, v in row.items()))
        monkeypatch.setattr(protocol, "data_path", lambda name: tmp_path / name)

    return of


def test_a_field_that_is_unknown_or_missing_is_named_with_its_row(ledger):
    ledger({**ROW, "no": "7c", "at_lest": 0.5})
    with pytest.raises(ValueError, match="claim 7c: 'at_lest' is not a field"):
        load_claims()
    for name in ("claim", "paper", "reason"):
        ledger({key: value for key, value in ROW.items() if key != name})
        with pytest.raises(ValueError, match=f"claims.toml: claim 1: '{name}' is missing"):
            load_claims()


@pytest.mark.parametrize(
    ("limits", "value", "verdict"),
    [
        ({"match_within": 0.1}, 0.6, "match"),
        ({"match_within": 0.1}, 0.61, "differs"),
        ({"at_least": 0.4}, 0.39, "differs"),
        ({"at_most": 0.4, "paper": ""}, 0.4, "met"),
        ({"at_most": 0.4, "paper": ""}, 0.41, "missed"),
    ],
)
def test_a_value_alone_decides_without_an_interval(ledger, limits, value, verdict):
    ledger({**ROW, **limits})
    (row,) = load_claims()
    assert row.computed_verdict(value) == verdict
    assert row.computed_verdict(value, float("nan"), float("nan")) == verdict


@pytest.mark.parametrize("interval", [(), (None, None), (float("nan"), float("nan"))])
def test_one_value_of_a_row_that_is_drawn_decides_nothing(interval):
    with pytest.raises(ValueError, match="claim 6: expected the interval of a value that is drawn"):
        claim("6").computed_verdict(0.67, *interval)
