"""The ledger of claims and its scoreboard: a claim that fares otherwise than declared fails here,
either way.
"""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from executed import whole_scoreboard

from trinolab.datasets import data_path, real_set
from workbench.cli import main, not_run
from workbench.studies import scoreboard as module
from workbench.studies.protocol import load_trials
from workbench.studies.scoreboard import CHECKS, COLUMNS, disagreements, load_claims, scoreboard

CLAIMS = load_claims()
REAL = {
    "real_photographs": "opencv_stereo",
    "real_leds": "pymvg_mcsc",
    "real_board": "caliscope",
    "real_particles": "trackpy_particles",
}


def score(claim):
    """The row of a claim, with what was drawn."""
    return module.score(claim, module.drawn_results(), load_trials())


def claim(no):
    return next(c for c in CLAIMS if c.no == no)


def as_declared(check):
    """A number that earns the declared verdict of every claim that the check serves."""
    claims = [c for c in CLAIMS if c.check == check]
    if {c.verdict for c in claims} == {"undecided"}:
        return module.Result(0.01, 0.0, 1e6)  # both sides of every limit
    grid = [0.0, *np.geomspace(1e-6, 100.0, 4001).tolist()]
    return next(
        value for value in grid if all(c.computed_verdict(value) == c.verdict for c in claims)
    )


@pytest.fixture
def cheap(monkeypatch):
    """Every check gives a number that earns the declared verdict, without rendering anything."""
    monkeypatch.setattr(module, "CHECKS", {check: partial(as_declared, check) for check in CHECKS})


# --- the ledger


def test_all_twenty_claims_are_there_once_and_others_go_on_from_there():
    numbers = [c.no for c in CLAIMS]
    papers = [int(no) for no in numbers if no.isdigit()]
    assert papers == list(range(1, len(papers) + 1))
    assert len(papers) >= 20
    assert len(set(numbers)) == len(numbers)
    assert set(CHECKS) == {c.check for c in CLAIMS if c.check and not c.trial}


# --- the verdicts


def test_every_verdict_is_the_declared_one():
    """The whole board, of `make book` if that is not stale; whatever else needs it takes cheap
    numbers.
    """
    board = whole_scoreboard()
    computed = dict(zip(board["no"], board["verdict"], strict=True))
    not_here = {c.no for c in CLAIMS if c.check in REAL and real_set(REAL[c.check]) is None}
    assert computed == {c.no: "not run" if c.no in not_here else c.verdict for c in CLAIMS}
    assert disagreements(board) == []
    run = ~board["no"].isin(not_here)
    assert list(board["reason"][run]) == [c.reason for c in CLAIMS if c.no not in not_here]
    assert board["ours"][run].notna().sum() == sum(
        c.check is not None and c.no not in not_here for c in CLAIMS
    )


# E_t, E_alpha, E_beta, E_gamma added up by hand from the printed table: 6.2418 mm, 14.2, 11.0, 12.8
# deg of twenty
@pytest.mark.parametrize(
    ("no", "value", "verdict"),
    [("1", 0.312088, "match"), ("2", 0.71, "differs"), ("3", 0.55, "match"), ("4", 0.64, "match")],
)
def test_table_1_by_hand(no, value, verdict):
    row = dict(zip(COLUMNS, score(claim(no)), strict=True))
    assert row["ours"] == pytest.approx(value, abs=1e-6)
    assert row["verdict"] == verdict


def test_a_value_is_quoted_with_its_unit_interval_and_draws():
    stored = pd.read_csv(data_path("claims_results.csv")).set_index("check")
    row = stored.loc["replication_position"]
    text = module.quoted("5j")
    assert text == f"{row.value:.3g} mm ({row.low:.3g} to {row.high:.3g}, {row.draws} draws)"
    for no in ("1", "99"):
        with pytest.raises(ValueError, match=f"no: expected a claim that is drawn, got '{no}'"):
            module.quoted(no)


# --- the board


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"check": "table_1_alpha"}, "claim 21: check: expected one of table1_.*'table_1_alpha'"),
        ({"trial": "random_poses"}, "claim 21: trial: expected one of .*'random_poses'"),
    ],
)
def test_what_is_not_there_is_one_line_before_anything_is_computed(
    monkeypatch, capsys, change, words
):
    wrong = (claim("1"), replace(claim("2"), no="21", **change))
    monkeypatch.setattr(module, "load_claims", lambda: wrong)
    monkeypatch.setattr(module, "score", None)
    assert main(["scoreboard"]) == 2
    out, err = capsys.readouterr()
    assert re.match(f"trinolab scoreboard: claims.toml: {words}", err)
    assert (out, err.count("\n")) == ("", 1)


@pytest.mark.parametrize(
    ("no", "declared", "value", "computed"),
    [
        ("1", "differs", 0.312, "match"),
        ("1", "undecided", 0.312, "match"),
        ("2", "differs", 0.67, "match"),
    ],
)
@pytest.mark.usefixtures("cheap")
def test_a_tampered_ledger_is_found(monkeypatch, no, declared, value, computed):
    """A result that is better than declared, too."""
    tampered = tuple(replace(c, verdict=declared) if c.no == no else c for c in CLAIMS)
    monkeypatch.setattr(module, "load_claims", lambda: tampered)
    monkeypatch.setitem(module.CHECKS, claim(no).check, lambda: value)
    board = scoreboard()
    assert disagreements(board) == [no]
    row = board.set_index("no").loc[no]
    assert (row.verdict, row.reason) == (computed, f"The ledger declares '{declared}'.")


@pytest.mark.usefixtures("cheap")
def test_what_was_not_run_is_no_disagreement_and_is_said_below_the_board(monkeypatch, capsys):
    monkeypatch.delenv("TRINOLAB_DATA", raising=False)
    monkeypatch.setitem(module.CHECKS, "real_leds", lambda: None)
    board = scoreboard()
    row = board.set_index("no").loc["5b"]
    assert row["verdict"] == "not run"
    assert row["reason"].startswith("not run: TRINOLAB_DATA is not set; data/real.toml ")
    assert np.isnan(row["ours"])
    assert disagreements(board) == []
    said = not_run(board)
    assert said == f"claim 5b: {row['reason']}"
    assert main(["scoreboard"]) == 0
    assert capsys.readouterr().out.splitlines()[len(CLAIMS) + 1 :] == [said]
