"""The parts of the scoreboard's page and of the protocol's page that come from the ledger and the board."""

import re

import pytest

from workbench.cli import QUESTION_WIDTH, main
from workbench.pages import claims_pages
from workbench.studies import scoreboard
from workbench.studies.protocol import load_claims, load_deviations, load_trials

CLAIMS = load_claims()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    with pytest.MonkeyPatch.context() as patch:
        # nothing is rendered, no recording is read
        patch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, lambda: 0.31))
        main(["scoreboard", "--csv", str(folder / "board.csv")])
    claims_pages.write_pages(folder / "board.csv", folder / "claims")
    return {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("claims/*.md")}


def rows_of(table):
    return re.findall(r"^\* - (.*)$", table, flags=re.MULTILINE)[1:]


def numbers_of(table, anchor):
    """The rows of claims, each of which has a place to link to."""
    return re.findall(rf"^\* - .*\{{#{anchor}-(\w+)\}}$", table, flags=re.MULTILINE)


def test_each_claim_stands_on_one_of_three_boards(pages):
    rest = [c for c in CLAIMS if c.question is None]
    assert numbers_of(pages["paper"], "claim") == [c.no for c in rest if not c.is_ours]
    assert numbers_of(pages["own"], "claim") == [c.no for c in rest if c.is_ours]
    first = re.findall(r"\{#claim-(\w+)\}", pages["essential"])
    assert first == [c.no for c in CLAIMS if c.question is not None]
    assert numbers_of(pages["criteria"], "criterion") == [c.no for c in CLAIMS]


def test_a_row_shows_verdict_interval_sample_and_criterion(pages):
    row = pages["paper"].split("{#claim-12}\n")[1].split("\n* - ")[0]
    line = pages["essential"].split("{#claim-11} ")[1].split("\n* - ")[0]
    for shown in ("11 **✓ match**: 1 (0.969 to 1)", "**✓ match** (n 120, seed 1706)"):
        assert shown in line
    assert "in at least 0.95 of the cases" in line
    assert "**✓ match**" in row
    assert "every instant is tracked" in row


def test_fifteen_questions_have_a_line_each(pages):
    questions = {c.question for c in CLAIMS if c.question is not None}
    assert len(questions) == 15
    assert len(rows_of(pages["essential"])) == 15
    assert all(len(question) <= QUESTION_WIDTH for question in questions)


def test_a_criterion_is_printed_once(pages):
    text = "".join(pages.values())
    for criterion in {c.criterion for c in CLAIMS if len(c.criterion) > 60}:
        rows = [c for c in CLAIMS if criterion in c.criterion]
        assert text.count(claims_pages.escaped(criterion)) == len(rows), criterion


def test_protocol_has_trials_quotes_and_log(pages):
    assert len(rows_of(pages["trials"])) == len(load_trials())
    assert "can adapt well to changing ambient light" in pages["criteria"]
    assert pages["deviations"].count("*Was:*") == len(load_deviations())
    assert "claim {ref}`12 <claim-12>`." in pages["deviations"]


def test_no_cell_has_markup_by_chance(pages):
    text = "".join(pages.values())
    assert "P\\_0 = 0" in text
    assert "\\[1 1 0 0 0 0\\]" in text
