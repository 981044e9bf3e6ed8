"""The article: its numbers are computed, its words agree with the board, its printed pages are whole."""

import re
from pathlib import Path

import pandas as pd
import pypdfium2
import pytest
import yaml

from trinolab.datasets import load_table1
from workbench.pages import article, printing
from workbench.pages.browser import CHROMIUM
from workbench.pages.figures import HTML
from workbench.studies import answer
from workbench.studies.protocol import load_claims

TEXT = (Path(article.__file__).parent / article.TEMPLATE).read_text(encoding="utf-8")
# What may have a digit without being a result: places in the paper, names, links and licences.
NAMES = (
    r"\{#-.*?-#\}|\{\{.*?\}\}",  # of the template: a remark, a computed value
    r"\$\$[^$]+\$\$|\$[^$]+\$|^:(?:widths|header-rows): [\d ]+$",  # formulas, a table
    r"(Eq|Sect|Fig)\. \d[\d.]*( and \d+| to \d+)?",
    r"Table 1\b",
    r"CCD[123]",
    r"interval of 95 %",
    r"CC BY 4\.0|BSD-3-Clause|SHA-256",
    r"`[^`\n]*`",
    r"^:width: \d+%$",
)


@pytest.fixture(scope="module")
def text(board):
    return article.article(board)


def without_names(text):
    for name in NAMES:
        text = re.sub(name, "", text, flags=re.MULTILINE | re.DOTALL if "#-" in name else re.M)
    return text


def test_no_number_is_typed_by_hand():
    typed = re.findall(r".*\d.*", without_names(TEXT))
    assert typed == []


def test_a_typed_number_would_be_seen():
    assert "0.17" in without_names("The error is 0.17 mm ({{ claim(5) }}, Eq. 26, Table 1).")


def test_the_values_are_those_of_the_board_and_of_the_printed_table(text):
    results = pd.read_csv(article.ROOT / "data" / "claims_results.csv").set_index("check")
    for check in ("calibrated_position", "replication_position", "plain_mean"):
        row = results.loc[check]
        assert f"{row['value']:.3g}" in text
        assert f"({row['low']:.3g} to {row['high']:.3g})" in text
    table = load_table1()
    first_angles = [
        (measured - set_to + 180) % 360 - 180
        for measured, set_to in zip(
            table.measured.rotation.as_euler("ZYX", degrees=True)[:, 2],
            table.set_poses.rotation.as_euler("ZYX", degrees=True)[:, 2],
            strict=True,
        )
    ]
    offsets = re.search(r"The signed means are (.*?), with", text.replace("\n", " "))[1]
    mean = sum(first_angles) / len(first_angles)
    assert f"{mean:+.2f}°" in offsets


def test_it_begins_with_the_answer(text):
    abstract = text.split("## Abstract")[1].split("##")[0]
    assert abstract.strip().startswith(answer.sentence())


def test_every_essential_row_stands_in_the_table(board):
    links = re.findall(r"<claim-(\w+)>", article.claims_table(board))
    assert links == [claim.no for claim in load_claims() if claim.question is not None]


def test_a_verdict_that_the_text_does_not_know_stops_the_build(board):
    changed = board.assign(verdict=board["verdict"].mask(board["no"] == "5", "match"))
    with pytest.raises(ValueError, match=r"claim 5: the text says 'undecided', the board 'match'"):
        article.article(changed)


def test_the_text_counts_no_verdicts(text):
    assert not re.search(r"\d+ (?:match|differ|are undecided|rows)", text)


def test_the_metadata_have_the_abstract_and_leave_people_their_part(text):
    fields = yaml.safe_load(article.metadata(text))
    assert fields["title"].startswith("[Re] The Master Manipulator")
    assert fields["abstract"].startswith(answer.sentence())
    assert "{" not in fields["abstract"]
    assert fields["authors"][0]["orcid"] is None
    wanted = "title authors affiliations keywords code data replication abstract bibliography type"
    assert set(wanted.split()) | {"domain", "language", "journal"} <= set(fields)


def test_the_sections_of_a_replication_are_there(text):
    heads = re.findall(r"^## (.*)$", text, flags=re.MULTILINE)
    for word in (
        *("Abstract", "Introduction", "equations", "Methods", "Results"),
        *("failed", "come from", "repeat"),
    ):
        assert any(word in head for head in heads), word
    undone = text.split("is not done\n")[1].split("## ")[0]
    for word in ("Ask the authors", "Deposit", "DOI", "not done"):
        assert word in undone


def test_the_figures_are_drawings(board, tmp_path):
    board.to_csv(tmp_path / "board.csv", index=False)
    article.write_pages(tmp_path / "board.csv", tmp_path)
    shown = set(re.findall(r"article/(\w+)\.svg", TEXT))
    assert shown == set(article.FIGURES) == {path.stem for path in tmp_path.glob("*.svg")}
    assert len(shown) <= 5
    for path in tmp_path.glob("*.svg"):
        drawn = path.read_text(encoding="utf-8")
        assert "<path" in drawn
        assert "<image" not in drawn, "a picture of pixels"


@pytest.mark.heavy
@pytest.mark.skipif(not (HTML / "book" / "article.html").exists(), reason="no built pages")
@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)")
def test_it_is_eight_to_ten_printed_pages_without_a_fault():
    (printed,) = printing.print_pages(HTML, ["book/article"])
    assert printing.faults(printed) == []
    assert 8 <= len(pypdfium2.PdfDocument(printed.pdf)) <= 10
