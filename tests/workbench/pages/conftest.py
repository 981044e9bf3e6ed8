"""One browser for all tests of pages, a board of claims without computing one, and the pages that are
rendered from its numbers.
"""

import json
from collections import defaultdict

import pytest
from pages import ROOT, browser  # noqa: F401

from workbench.pages import template
from workbench.pages.numbers import read_board, write_numbers
from workbench.studies import scoreboard
from workbench.studies.protocol import load_claims


@pytest.fixture(scope="session")
def board(tmp_path_factory):
    """The board with the drawn numbers, whose verdicts are those that the ledger declares: nothing is
    rendered, no recording is read.
    """
    path = tmp_path_factory.mktemp("board") / "board.csv"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, lambda: 0.31))
        scoreboard.scoreboard().to_csv(path, index=False)
    found = read_board(path)
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return found.assign(verdict=found["no"].map(declared))


@pytest.fixture(scope="session")
def numbers(board, tmp_path_factory):
    """The numbers of all pages without a chapter's."""
    build = tmp_path_factory.mktemp("build")
    board.to_csv(build / "scoreboard.csv", index=False)
    write_numbers(build)
    return json.loads((build / "generated" / "numbers.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def page(numbers):
    """A page of the book as Sphinx reads it, by its name; what it quotes of chapters is 7."""

    sevens = defaultdict(lambda: 7)

    def rendered(name, glued=sevens, pictures=sevens, **other):
        text = (ROOT / "book" / f"{name}.md").read_text(encoding="utf-8")
        chapters = {str(k): {"glued": glued, "pictures": pictures} for k in range(1, 13)}
        return template.render(text, {**numbers, "chapters": chapters, **other})

    return rendered
