"""The cards below the cells, and the foot of the pages: true to the notebook, the build and the
repository.
"""

import json
import re
from pathlib import Path

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from workbench.pages import howmade, tablesread
from workbench.studies import factors
from workbench.studies.__main__ import MAKES

ROOT = Path(__file__).resolve().parents[3]
HTML = ROOT / "_build" / "html"
NOTEBOOKS = sorted([*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("book/*.ipynb")])
built = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)


def test_a_cell_shows_what_it_reads_and_what_the_cells_read_whose_names_it_uses():
    sources = [
        "# text",
        'bounds = load_sweep("bound")\nother = datasets.load_sweep("stress")',
        "best = bounds.min()\nrows = [row for row in bounds]",
        "print(best, other)",
        "best = 3.0",
        "print(best)",
        "%matplotlib inline",
        'print(pd.read_csv(datasets.data_path("claims_results.csv")))',
        'labels = {"speed": "v", "turn": "w"}\ncurves = {}\nfor name in labels:\n'
        "    curves[name] = load_sweep(name)",
        "draw(curves)",
        "folder = data_path(*parts)",
        "def least(bounds):\n    other = 1\n    return bounds.min() + other\nleast(3)",
        "for bounds in [1, 2]:\n    if bounds:\n        print(bounds)",
        "with open(1) as curves:\n    print(curves)",
        "try:\n    best = other\nexcept ValueError:\n    pass",
        "for row in best:\n    print(row)",
        "def show(name):\n    draw(gallery.load(name))",
        'show("blur")',
        "print([best for best in range(3)])",
    ]
    bound, stress = "sweeps/bound.csv", "sweeps/stress.csv"
    speeds = ["sweeps/speed.csv", "sweeps/turn.csv"]
    assert tablesread.tables_read(sources) == [
        [],
        [bound, stress],
        [bound],
        [bound, stress],
        [],
        [],
        [],
        ["claims_results.csv"],
        speeds,
        speeds,
        [],
        [],
        [],
        [],
        [stress],
        [stress],
        [],
        ["sweeps/gallery/blur.csv"],
        [],
    ]


def test_every_shipped_table_has_the_command_that_makes_it():
    shipped = {path.stem for path in (ROOT / "data" / "sweeps").glob("*.csv")}
    assert {table for tables in MAKES.values() for table in tables} == {
        *shipped,
        *("claims_results", "claims_draws", "sensitivity"),
    }
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
        ("rigs/paper_pair.toml", ""),
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
    assert chapter.seeds == ["seed = 7"]
    assert chapter.glued == {"E_t_mm": 2}
    assert sorted(chapter.cells) == [1, 2, 3]
    assert (chapter.cells[2].number, chapter.cells[2].name) == (3, "one-02")
    assert chapter.cells[2].seconds == 1.5
    assert chapter.cells[3].seconds is None
    assert howmade.read_chapter("notebooks/02_two.ipynb", build) is None


def test_a_card_says_it_all(build):
    chapter = howmade.read_chapter("notebooks/01_one.ipynb", build)
    first, about, last = howmade.card(chapter, chapter.cells[2], None, "abc and changes")
    assert first.astext().count("<div") == last.astext().count("</div>") == 1
    said = {field[0].astext(): field[1].astext() for field in about.children}
    assert said["Cell"] == "3 of the 4 of notebooks/01_one.ipynb, called one-02"
    assert said["Made again by"].startswith("python book/build.py --chapter notebooks/01_one.ipynb")
    assert said["Seed"] == "seed = 7"
    assert said["Commit"] == "abc and changes"
    assert said["Hashes"].count("0123456789ab") == 4
    assert said["Run"] == "1.5 s on 2026-01-02; the whole notebook took 21 s"
    without = howmade.card(chapter._replace(seeds=[], hashes={}), chapter.cells[3], None, "")[1]
    said = {field[0].astext(): field[1].astext() for field in without.children}
    assert said["Seed"] == "none drawn"
    assert said["Run"] == "the whole notebook took 21 s"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("0123456789abcdef", "0123456789ab"),
        ("0123456789abcdef+", "0123456789ab and changes"),
        ("", "unknown, since this was built outside of a clone"),
    ],
)
def test_the_commit_in_words(monkeypatch, name, said):
    monkeypatch.setattr(howmade, "commit", lambda: name)
    assert howmade.commit_said() == said


@built
def test_on_the_pages_every_output_has_a_card_and_every_number_leads_to_one():
    for path in NOTEBOOKS:
        page = (HTML / path.relative_to(ROOT)).with_suffix(".html").read_text(encoding="utf-8")
        cells = page.split('<div class="cell ')[1:]
        without = [
            cell[:80] for cell in cells if '"cell_output' in cell and 'id="made-' not in cell
        ]
        assert not without, path
        typed = path.read_text(encoding="utf-8").count("{glue:text}")
        links = re.findall(r'<a class="glued [^>]*href="#(made-\d+)"', page)
        assert page.count('class="pasted-text"') == typed
        assert len(links) >= 0.9 * typed, "all but those in headings and links"
        assert all(f'id="{link}"' in page for link in links)


@built
def test_every_page_says_what_it_was_built_with_and_nothing_of_the_machine():
    for file in HTML.glob("**/*.html"):
        text = file.read_text(encoding="utf-8")
        assert str(ROOT) not in text, file
        assert str(Path.home() / "x")[:-1] not in text, file
        if '<article class="bd-article' in text:
            assert re.search(r"Built on \d{4}-\d\d-\d\d with trinolab [\d.]+, Python 3", text), file
