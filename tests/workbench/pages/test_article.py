"""The article: its numbers are computed, its words agree with the board, its printed pages are whole."""

import re
from pathlib import Path

import pandas as pd
import pytest
import yaml

from trinolab.datasets import load_table1
from workbench.pages import article, template
from workbench.studies import answer
from workbench.studies.protocol import load_claims

TEXT = (Path(template.__file__).parent / article.TEMPLATE).read_text(encoding="utf-8")
# What may have a digit without being a result: places in the paper, names, links and licences.
NAMES = (
    r"\{#-.*?-#\}|\{%.*?%\}|\{\{.*?\}\}",  # of the template: a remark, a statement, a computed value
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
def text(page):
    return page("article")


def without_names(text):
    for name in NAMES:
        text = re.sub(name, "", text, flags=re.MULTILINE | re.DOTALL if "#-" in name else re.M)
    return text


def test_no_number_is_typed_by_hand():
    assert "0.17" in without_names("The error is 0.17 mm ({{ claim(5) }}, Eq. 26, Table 1).")
    assert re.findall(r".*\d.*", without_names(TEXT)) == []


def test_the_values_are_those_of_the_board_and_of_the_printed_table(text):
    results = pd.read_csv(article.ROOT / "data" / "claims_results.csv").set_index("check")
    for check in ("calibrated_position", "replication_position", "plain_mean"):
        row = results.loc[check]
        assert f"{row['value']:.3g}" in text
        assert f"({row['low']:.3g} to {row['high']:.3g})" in text
    table = load_table1()
    measured, set_to = (
        poses.rotation.as_euler("ZYX", degrees=True)[:, 2]
        for poses in (table.measured, table.set_poses)
    )
    offsets = re.search(r"The signed means are (.*?), with", text.replace("\n", " "))[1]
    assert f"{((measured - set_to + 180) % 360 - 180).mean():+.2f}°" in offsets


def test_every_essential_row_stands_in_the_table(text):
    table = text.partition(":class: claims")[2].partition("````")[0]
    links = re.findall(r"<claim-(\w+)>", table)
    assert links == [claim.no for claim in load_claims() if claim.question is not None]


def test_a_verdict_that_the_text_does_not_know_stops_the_build(board):
    changed = board.assign(verdict=board["verdict"].mask(board["no"] == "5", "match"))
    with pytest.raises(ValueError, match=r"claim 5: the text says 'undecided', the board 'match'"):
        article.checked(changed)


def test_the_reason_of_11b_has_the_numbers_of_the_table(numbers):
    (reason,) = [claim.reason for claim in load_claims() if claim.no == "11b"]
    said = f"Of {numbers['damaged_instants']} instants with a fault, {numbers['damaged_measured']} were"
    assert reason.startswith(f"{said} measured. One pose is wrong")
    assert numbers["damaged_faults"] == "rolling shutter 10 ms"


def test_it_begins_with_the_answer_and_the_metadata_have_the_abstract(text):
    abstract = text.split("## Abstract")[1].split("##")[0]
    assert abstract.strip().startswith(answer.sentence())
    fields = yaml.safe_load(article.metadata(text))
    assert fields["title"].startswith("[Re] The Master Manipulator")
    assert fields["abstract"].startswith(answer.sentence())
    assert "{" not in fields["abstract"]
    assert fields["authors"][0]["orcid"] is None
