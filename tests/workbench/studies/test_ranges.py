"""The rule of the front: a verdict holds over the whole range, or is undecided and the row says why."""

import tomllib
from types import SimpleNamespace

import pandas as pd
import pytest

from trinolab.datasets import data_path
from workbench.studies import ranges
from workbench.studies.protocol import load_claims, load_trials

CLAIMS = {claim.no: claim for claim in load_claims()}
FRONT = [no for no, claim in CLAIMS.items() if claim.question is not None]
TABLE = pd.read_csv(data_path("sensitivity.csv"))


def other(verdict, instead="other"):
    return ranges.Elsewhere("A1", instead, 0.5, 0.4, 0.6, verdict)


def test_every_row_of_the_front_has_a_range_or_nothing_open():
    open_ = {no for one in ranges.load_ranges() for no in one.checks}
    closed = set(tomllib.loads(data_path("ranges.toml").read_text("utf-8"))["closed"])
    varied = open_ | {no for no in ("5", "6", "7", "8")}
    assert varied | closed == set(FRONT)
    assert not varied & closed


def test_each_range_is_drawn_by_a_trial_and_names_an_assumption():
    page = (data_path("claims.toml").parents[1] / "book" / "assumptions.md").read_text("utf-8")
    for one in ranges.load_ranges():
        assert one.trial in load_trials()
        assert f"[{one.assumption}]{{#{one.assumption.lower()}}}" in page
        assert set(one.checks) <= set(FRONT)


@pytest.mark.parametrize(
    ("others", "verdict"),
    [
        ([], "match"),
        (["match", "match"], "match"),
        (["match", "not run"], "match"),
        (["match", "differs"], "undecided"),
        (["match", "undecided"], "undecided"),
    ],
)
def test_a_verdict_holds_over_the_whole_range(others, verdict):
    assert ranges.over_range("match", [other(one) for one in others]) == verdict


@pytest.mark.parametrize(
    ("verdict", "others", "words"),
    [
        (
            "match",
            ["undecided", "differs", "match"],
            ["b (A1): 0.5 (0.4", "differs", "and 1 more choice."],
        ),
        ("match", ["undecided"], ["these choices: a (A1)", "undecided"]),
        ("match", ["match"] * 3, ["same with 3 other choices."]),
        ("match", ["match"] * 3 + ["not run"], ["same with 3", "We did not run 1 further choice."]),
        ("undecided", ["undecided"], []),
        ("undecided", ["differs"], ["a (A1)", "differs"]),
        ("match", [], []),
    ],
)
def test_the_row_says_what_decides_it(verdict, others, words):
    text = ranges.deciding(verdict, [other(*one) for one in zip(others, "abcd", strict=False)])
    assert all(word in text for word in words)
    assert bool(text) == bool(words)


def test_a_difference_of_the_table_is_added_interval_to_interval():
    base = SimpleNamespace(value=0.46, low=0.44, high=0.48)
    rows = ranges.elsewhere(CLAIMS["6"], base, {})
    four = next(row for row in rows if row.instead == "markers of 4 mm")
    (line,) = TABLE[(TABLE["claim"] == "6b") & (TABLE["instead"] == four.instead)].itertuples()
    assert four.value == pytest.approx(0.46 + line.difference)
    assert four.low == pytest.approx(0.44 + line.low)
    assert four.high == pytest.approx(0.48 + line.high)
    assert len(rows) == TABLE[TABLE["claim"] == "6b"]["difference"].notna().sum()
