"""The replication report: its sentence follows from the board, its table from the study's numbers."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from workbench.pages import report_pages
from workbench.pages.claims_pages import escaped
from workbench.studies.protocol import load_claims
from workbench.studies.ranges import load_ranges
from workbench.studies.scoreboard import essential_rows

ROOT = Path(__file__).resolve().parents[3]
ASSUMPTIONS = (ROOT / "book" / "assumptions.md").read_text(encoding="utf-8")
TABLE = pd.read_csv(ROOT / "data" / "sensitivity.csv", keep_default_na=False, na_values=[""])


def test_every_question_is_answered_once_under_its_verdicts(board):
    text = report_pages.front(board)
    answers = {claim.question: claim.answer for claim in load_claims() if claim.answer}
    for question, rows in essential_rows(board).items():
        (line,) = [line for line in text.splitlines() if escaped(answers[question]) in line]
        verdicts = set(rows["verdict"])
        group = verdicts.pop() if len(verdicts) == 1 else "mixed"
        assert line.startswith(f"- **{report_pages.FARES[group]}:**")
        assert all(f"<claim-{no}>" in line for no in rows["no"])


def test_every_claim_stands_in_the_table_of_kinds(board):
    links = re.findall(r"<claim-(\w+)>", report_pages.kinds(board))
    assert sorted(links) == sorted(board["no"])


def test_every_assumption_is_varied_or_it_is_said_why_not():
    there = set(re.findall(r"\{#a(\d+)\}", ASSUMPTIONS))
    varied = {no.removeprefix("A") for no in TABLE["assumption"]}
    varied |= {one.assumption.removeprefix("A") for one in load_ranges()}
    spared = {no.removeprefix("A") for no in report_pages.NOT_VARIED}
    assert varied | spared == there
    assert not varied & spared


ROW = dict(
    zip(
        ("assumption", "instead", "number", "unit", "claim", "as_assumed", "changed"),
        ("A2", "other", "E_t", "mm", "5", 0.1, 0.2),
        strict=True,
    )
) | {"n": 20, "draws": 3, "seed": 1, "source": "rendered"}


def row(difference=0.1, low=0.05, high=0.15, **changes):
    return {**ROW, "difference": difference, "low": low, "high": high, **changes}


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ((), True),
        ((0.1, -0.05), False),
        ((0.1, -0.2, -0.1), True),
        ((1e-5, 1e-6, 2e-5), False),
        ((0.1, np.nan, np.nan), True),
        ((1e-6, np.nan, np.nan), False),
        ((np.nan,), False),
    ],
)
def test_a_change_is_shown_where_it_is_no_chance(changes, shown):
    table = pd.DataFrame([row(), row(*changes)])
    assert report_pages.is_shown(next(table.tail(1).itertuples())) == shown


def test_the_conclusion_names_what_reaches_the_papers_number():
    table = pd.DataFrame([row(changed=0.2), row(assumption="A4", changed=0.6)])
    text = report_pages.conclusion(table)
    assert "between 0.2 and 0.6 mm" in text
    assert "Only [A4](assumptions.md#a4) (0.6 mm) takes it to" in text
    # data/sweeps/budget.csv, R_rl as printed after a registration by 20 poses
    assert "of A4 a registration by Table 1's poses leaves 0.079 mm" in text
    assert "None takes it to" in report_pages.conclusion(table[:1])


def test_what_is_beyond_chance_is_marked():
    """Of three intervals one is far out; the bare 5 % of two others do not stay."""
    table = pd.DataFrame(
        [
            row(0.1, 0.09, 0.11),  # 20 standard deviations
            row(0.1, 0.001, 0.199),  # 1.98
            row(-0.1, -0.199, -0.001),
            row(0.0, 0.0, 0.0),  # nothing changed
            row(0.1, np.nan, np.nan),  # nothing drawn
        ]
    )
    assert report_pages.tested(table).tolist() == [True, True, True, False, False]
    assert report_pages.after_holm(table).tolist() == [True, False, False, True, True]
    text = report_pages.by_chance(table)
    for said in ("In all 4 intervals", "Of these 3 have", "3 are shown", "correction 1 stay"):
        assert said in text
    assert report_pages.sensitivity(table).count(" ?") == 2


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({}, "0.1 → **0.2 mm** (+0.05 to +0.15)"),
        ({"n": 5}, "0.1 → **0.2 mm** (+0.05 to +0.15, n 5)"),
        ({"low": np.nan, "high": np.nan}, "0.1 → **0.2 mm**"),
        ({"unit": "share", "n": 30}, "10 → **20 %** (+5 to +15)"),
    ],
)
def test_a_change_is_shown_with_its_interval(changes, shown):
    (one,) = pd.DataFrame([row(**changes)]).itertuples()
    assert report_pages.change_text(one).endswith(shown)
