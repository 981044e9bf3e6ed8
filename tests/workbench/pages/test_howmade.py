"""The card at a page's foot, the links to it, and what a page was built with: true to the notebook,
the build and the repository.
"""

import json
import re
from pathlib import Path

import nbformat
import pytest
from docutils import nodes
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from pages import HTML, built

from workbench.pages import howmade, tablesread
from workbench.studies import factors
from workbench.studies.__main__ import MAKES

ROOT = Path(__file__).resolve().parents[3]
NOTEBOOKS = sorted([*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("book/*.ipynb")])


@pytest.mark.parametrize(
    ("code", "tables"),
    [
        ('load_sweep("bound")\ndatasets.load_sweep("speed")', "sweeps/bound sweeps/speed"),
        ('for name in ("speed", "turn"):\n    load_sweep(name)', "sweeps/speed sweeps/turn"),
        ('def show(name):\n    gallery.load(name)\nshow("blur")', "sweeps/gallery/blur"),
        ('pd.read_csv(datasets.data_path("claims_results.csv"))', "claims_results"),
        ('print("bound")\ndata_path(*parts)', ""),
    ],
)
def test_the_tables_of_a_notebook_are_those_that_its_code_names(code, tables):
    assert tablesread.tables_read(code) == [f"{name}.csv" for name in tables.split()]


def test_every_shipped_table_has_the_command_that_makes_it():
    shipped = {path.stem for path in (ROOT / "data" / "sweeps").glob("*.csv")}
    others = {"claims_results", "claims_draws", "sensitivity"}
    assert {table for tables in MAKES.values() for table in tables} == shipped | others
    assert MAKES["factors"] == tuple(factors.FACTORS)


@pytest.mark.parametrize(
    ("table", "command"),
    [
        ("sweeps/patterns.csv", "python -m workbench.studies budget"),
        ("sweeps/turn.csv", "python -m workbench.studies factors --factor turn"),
        ("sweeps/gallery/blur.csv", "python -m workbench.studies gallery blur"),
        ("claims_draws.csv", "python -m workbench.studies claims"),
        ("accept/raised_40deg.json", "make sheet"),
        ("table1.csv", ""),
    ],
)
def test_the_command_that_makes_a_file_again(table, command):
    assert tablesread.command_for(table) == command


@pytest.fixture
def build(tmp_path):
    """What a build leaves of a notebook of four cells."""
    times = {
        "iopub.execute_input": "2026-01-02T23:59:59.500000Z",
        "iopub.status.idle": "2026-01-03T00:00:01.000000Z",
    }
    number = new_output("display_data", metadata={"scrapbook": {"name": "E_t_mm"}})
    cells = [
        new_markdown_cell("# One", id="one-00"),
        new_code_cell("seed = 7  # of it all\nn = 3", metadata={"tags": ["parameters"]}),
        new_code_cell("glue()", id="one-02", outputs=[number], metadata={"execution": times}),
        new_code_cell("seed = 8"),
    ]
    (tmp_path / "executed").mkdir()
    nbformat.write(new_notebook(cells=cells), tmp_path / "executed" / "01_one.ipynb")
    hashes = {name: "0123456789abcdef" * 4 for name in howmade.HASHED}
    (tmp_path / "made_from.json").write_text(json.dumps({"01_one": hashes}))
    (tmp_path / "seconds.json").write_text(json.dumps({"01_one": 21.4}))
    return tmp_path


def test_a_chapter_is_read_as_the_build_has_stored_it(build):
    chapter = howmade.read_chapter("notebooks/01_one.ipynb", build)
    assert (chapter.seeds, chapter.glued) == (["seed = 7"], {"E_t_mm": 2})
    assert [(k, cell.number, cell.seconds) for k, cell in sorted(chapter.cells.items())] == [
        (1, 2, None),
        (2, 3, 1.5),
        (3, 4, None),
    ]
    assert howmade.read_chapter("notebooks/02_two.ipynb", build) is None


def fields_and_rows(made):
    """What a card says of all cells, by name, and its rows of text."""
    _, about, table, _ = made
    fields = {field[0].astext(): field[1].astext() for field in about.children}
    rows = [[entry.astext() for entry in row] for row in table.findall(nodes.row)]
    return fields, rows


def test_the_card_says_it_all(build):
    chapter = howmade.read_chapter("notebooks/01_one.ipynb", build)
    section = nodes.section("", nodes.title(text="The gain"), ids=["the-gain"])
    chapter = chapter._replace(tables=["sweeps/turn.csv", "table1.csv"])
    cells = [(chapter.cells[2], section), (chapter.cells[3], None)]
    fields, (_, first, second) = fields_and_rows(howmade.card(chapter, cells, "abc and changes"))
    assert fields["Hashes"].count("0123456789ab") == 4
    names = ("Notebook", "Seed", "Commit", "Run", "Reads")
    assert [fields[name] for name in names] == [
        "notebooks/01_one.ipynb",
        "seed = 7",
        "abc and changes",
        "2026-01-02, 21 s for the whole notebook",
        "data/sweeps/turn.csv, made again by python -m workbench.studies factors --factor turn; "
        "data/table1.csv",
    ]
    assert (first[1:], second[1:]) == (["The gain", "1.50"], ["", ""])
    bare = chapter._replace(cells={}, seeds=[], tables=[], hashes={}, seconds=None)
    fields, _ = fields_and_rows(howmade.card(bare, cells, ""))
    said = [fields[name] for name in ("Seed", "Reads", "Hashes", "Run")]
    assert said == ["none drawn", "no shipped table", "none stored", "not recorded"]


def test_the_commit_in_words(monkeypatch):
    for name, said in (("0123456789abcdef", "0123456789ab"), ("0123456789abcdef+", "and changes")):
        monkeypatch.setattr(howmade, "commit", lambda name=name: name)
        assert howmade.commit_said().endswith(said)


@built
def test_on_the_pages_every_output_and_every_number_leads_to_its_row_of_the_card():
    for path in NOTEBOOKS:
        page = (HTML / path.relative_to(ROOT)).with_suffix(".html").read_text(encoding="utf-8")
        body, card = page.split('<details class="made">')
        outputs = [cell for cell in body.split('<div class="cell ')[1:] if '"cell_output' in cell]
        assert all('href="#made-' in cell for cell in outputs), path
        typed = path.read_text(encoding="utf-8").count("{glue:text}")
        assert page.count('class="pasted-text"') == typed
        numbers = re.findall(r'<a class="glued [^>]*href="#(made-\d+)"', body)
        assert len(numbers) >= 0.9 * typed, "all but those in headings and links"
        rows = re.findall(r'id="(made-\d+)"', card)
        assert len(set(rows)) == len(rows)
        assert set(re.findall(r'href="#(made-\d+)"', body)) == set(rows)
        back = re.findall(r'href="#(from-made-\d+)"', card)
        assert back == [f"from-{row}" for row in rows]
        assert all(body.count(f'id="{place}"') == 1 for place in back)


@built
def test_a_link_opens_the_card_and_its_row_leads_back(browser):
    browser.open((HTML / "notebooks" / "04_kalman.html").as_uri())
    card = "document.querySelector('details.made')"
    assert not browser.evaluate(f"{card}.open")
    browser.evaluate("document.querySelector('p.made a').click()")
    assert browser.evaluate(f"{card}.open")
    row = browser.evaluate("location.hash.slice(1)")
    assert browser.evaluate(f"document.getElementById('{row}').checkVisibility()")
    browser.evaluate(f"document.getElementById('{row}').nextElementSibling.click()")
    assert browser.evaluate("location.hash") == f"#from-{row}"


@built
def test_every_page_says_what_it_was_built_with_and_nothing_of_the_machine():
    for file in HTML.glob("**/*.html"):
        text = file.read_text(encoding="utf-8")
        assert str(ROOT) not in text, file
        assert str(Path.home() / "x")[:-1] not in text, file
        if '<article class="bd-article' in text:
            assert re.search(r"Built on \d{4}-\d\d-\d\d with trinolab [\d.]+, Python 3", text), file
