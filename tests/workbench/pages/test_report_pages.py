"""The replication report: its front follows from the board, its table from the study's numbers."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from workbench.pages import sensitivity
from workbench.pages.numbers import read_sensitivity
from workbench.pages.template import escaped
from workbench.studies.protocol import load_claims
from workbench.studies.ranges import load_ranges
from workbench.studies.scoreboard import essential_rows

ROOT = Path(__file__).resolve().parents[3]
ASSUMPTIONS = (ROOT / "book" / "assumptions.md").read_text(encoding="utf-8")
REPORT = (ROOT / "book" / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["start", "report"])
def test_every_question_is_answered_once_under_its_verdicts(board, page, name):
    text = page(name)
    answers = {claim.question: claim.answer for claim in load_claims() if claim.answer}
    lines = {}
    for question, rows in essential_rows(board).items():
        (line,) = [line for line in text.splitlines() if escaped(answers[question]) in line]
        verdicts = set(rows["verdict"])
        group = verdicts.pop() if len(verdicts) == 1 else "mixed"
        assert lines.setdefault(group, line) == line
        assert all(f"<claim-{no}>" in line for no in rows["no"])
    assert len(set(lines.values())) == len(lines)


def test_every_claim_stands_in_the_table_of_kinds(board, page):
    table = page("report").partition(":class: kinds")[2].partition("````")[0]
    links = re.findall(r"<claim-(\w+)>", table)
    assert sorted(links) == sorted(board["no"])


def test_every_assumption_is_varied_or_it_is_said_why_not():
    there = set(re.findall(r"\{#a(\d+)\}", ASSUMPTIONS))
    varied = {no.removeprefix("A") for no in read_sensitivity()["assumption"]}
    varied |= {one.assumption.removeprefix("A") for one in load_ranges()}
    not_varied = REPORT.partition("Not varied here:")[2].partition("`````")[0]
    spared = set(
        re.findall(r'^- \{\{ "A(\d+)" \| assumption \}\}: .+\.$', not_varied, re.MULTILINE)
    )
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
    assert sensitivity.is_shown(table).tolist() == [True, shown]


def test_the_conclusion_names_what_reaches_the_papers_number(page):
    table = pd.DataFrame([row(changed=0.2), row(assumption="A4", changed=0.6)])
    text = page("report", sensitivity=sensitivity.sensitivity(table))
    assert "between 0.2 and 0.6 mm" in text
    assert "Only [A4](assumptions.md#a4) (0.6 mm) brings it to" in text
    # data/sweeps/budget.csv, R_rl as printed after a registration by 20 poses
    assert "after a registration by Table 1's poses, the effect of A4 is 0.079 mm" in text
    assert "None brings it to" in page("report", sensitivity=sensitivity.sensitivity(table[:1]))


def test_what_is_beyond_chance_is_marked(page):
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
    assert sensitivity.tested(table).tolist() == [True, True, True, False, False]
    assert sensitivity.after_holm(table).tolist() == [True, False, False, True, True]
    text = page("report", sensitivity=sensitivity.sensitivity(table))
    for said in (
        "examined 4 intervals",
        "changed in 3 of them",
        "3 are shown",
        "correction 1 remain",
    ):
        assert said in text
    changes = text.partition(":class: sensitivity")[2].partition("````")[0]
    assert changes.count(" ?") == 2


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({}, "0.1 → **0.2 mm** (+0.05 to +0.15)"),
        ({"n": 5}, "0.1 → **0.2 mm** (+0.05 to +0.15, n 5)"),
        ({"low": np.nan, "high": np.nan}, "0.1 → **0.2 mm**"),
        ({"unit": "share", "n": 30}, "10 → **20 %** (+5 to +15)"),
    ],
)
def test_a_change_is_shown_with_its_interval(page, changes, shown):
    table = pd.DataFrame([row(**changes)])
    assert f"$E_t$ {shown}\n" in page("report", sensitivity=sensitivity.sensitivity(table))
