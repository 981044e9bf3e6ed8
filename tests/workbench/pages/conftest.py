"""One browser for all tests of pages, and a board of claims without computing one."""

import pytest

from workbench.pages import claims_pages
from workbench.pages.browser import CHROMIUM, Browser
from workbench.studies import scoreboard
from workbench.studies.protocol import load_claims


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("Chromium is missing (Debian package: chromium)")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    browser.open("about:blank")
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def board_csv(tmp_path_factory):
    """A board with the drawn numbers: nothing is rendered, no recording is read."""
    path = tmp_path_factory.mktemp("board") / "board.csv"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, lambda: 0.31))
        scoreboard.scoreboard().to_csv(path, index=False)
    return path


@pytest.fixture(scope="session")
def board(board_csv):
    """The board whose verdicts are those that the ledger declares."""
    found = claims_pages.read_board(board_csv)
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return found.assign(verdict=found["no"].map(declared))
