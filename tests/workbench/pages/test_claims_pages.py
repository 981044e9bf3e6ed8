"""The scoreboard's page and the protocol's page show the ledger and the board."""

import re

from workbench.studies.protocol import load_claims, load_deviations, load_trials

CLAIMS = load_claims()


def numbers_of(table, anchor):
    """The rows of claims, each of which has a place to link to."""
    return re.findall(rf"^\* - .*\{{#{anchor}-(\w+)\}}$", table, flags=re.MULTILINE)


def test_each_claim_stands_on_one_of_three_boards(page):
    essential, paper, own = page("scoreboard").split("## Supplement")
    rest = [c for c in CLAIMS if c.question is None]
    assert numbers_of(paper, "claim") == [c.no for c in rest if not c.is_ours]
    assert numbers_of(own, "claim") == [c.no for c in rest if c.is_ours]
    first = re.findall(r"\{#claim-(\w+)\}", essential)
    assert first == [c.no for c in CLAIMS if c.question is not None]
    assert numbers_of(page("protocol"), "criterion") == [c.no for c in CLAIMS]


def test_a_row_shows_verdict_interval_sample_and_criterion(page):
    line = page("scoreboard").split("{#claim-11} ")[1].split("\n* - ")[0]
    for shown in (
        "11 **✓ match**: 1 (0.969 to 1)",
        "**✓ match** (n 120, seed 1706)",
        "in at least 0.95 of the cases",
    ):
        assert shown in line


def test_protocol_has_trials_quotes_and_log(page):
    protocol = page("protocol")
    trials = protocol.partition(":class: trials")[2].partition("````")[0]
    assert trials.count("\n* - ") == 1 + len(load_trials())  # a head before them
    assert "can adapt well to changing ambient light" in protocol
    assert protocol.count("*Was:*") == len(load_deviations())
    assert "claim {ref}`12 <claim-12>`." in protocol
    assert "P\\_0 = 0" in protocol + page("scoreboard")  # no markup by chance
