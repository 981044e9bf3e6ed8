"""The parts of the scoreboard's page and of the protocol's page that come from the ledger and the board."""

import re

import pytest

from workbench.pages import claims_pages
from workbench.studies.protocol import load_claims, load_deviations, load_trials

CLAIMS = load_claims()


@pytest.fixture(scope="module")
def pages(board_csv, tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    claims_pages.write_pages(board_csv, folder)
    return {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.md")}


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
    line = pages["essential"].split("{#claim-11} ")[1].split("\n* - ")[0]
    for shown in (
        "11 **✓ match**: 1 (0.969 to 1)",
        "**✓ match** (n 120, seed 1706)",
        "in at least 0.95 of the cases",
    ):
        assert shown in line


def test_protocol_has_trials_quotes_and_log(pages):
    assert pages["trials"].count("\n* - ") == 1 + len(load_trials())  # a head before them
    assert "can adapt well to changing ambient light" in pages["criteria"]
    assert pages["deviations"].count("*Was:*") == len(load_deviations())
    assert "claim {ref}`12 <claim-12>`." in pages["deviations"]
    assert "P\\_0 = 0" in "".join(pages.values())  # no markup by chance
