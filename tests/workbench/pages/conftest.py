"""A board of claims for the tests of the pages, without computing one."""

import pytest

from workbench.pages import claims_pages
from workbench.studies import scoreboard
from workbench.studies.protocol import load_claims


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """A board whose verdicts are those that the ledger declares, with the drawn numbers."""
    path = tmp_path_factory.mktemp("board") / "board.csv"
    with pytest.MonkeyPatch.context() as patch:
        # nothing is rendered, no recording is read
        patch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, lambda: 0.31))
        scoreboard.scoreboard().to_csv(path, index=False)
    found = claims_pages.read_board(path)
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return found.assign(verdict=found["no"].map(declared))
