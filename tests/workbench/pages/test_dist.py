"""What is given away: the zip for readers, the wheel, the figures as files."""

import re
import subprocess
import sys
import zipfile

import pandas as pd
import pytest
from pages import built

from workbench.pages import dist, figures

USES_ITS_DATA = """
import trinolab, trinolab.datasets
from pathlib import Path
rig = trinolab.load_rig("raised_40deg")
print(Path(trinolab.__file__).parent, len(rig.cameras), len(trinolab.datasets.load_table1().frame))
"""


@pytest.mark.heavy
@built
def test_the_zip_opens_from_its_index_without_network(browser, tmp_path):
    made = dist.write_zip(dist.HTML, tmp_path)
    with zipfile.ZipFile(made) as book:
        assert book.testzip() is None
        assert {name.split("/")[0] for name in book.namelist()} == {made.stem}
        book.extractall(tmp_path / "there")
    browser.open((tmp_path / "there" / made.stem / "index.html").as_uri())
    browser.arrives("/book/start.html")
    assert browser.errors == []


def test_the_wheel_finds_its_data_wherever_it_is_installed(tmp_path):
    wheel = dist.write_wheel(dist.ROOT, tmp_path)
    with zipfile.ZipFile(wheel) as whole:
        assert not [
            name for name in whole.namelist() if re.search("__pycache__|tables/|tests/", name)
        ]
        assert {name.split("/")[0] for name in whole.namelist() if "dist-info" not in name} == {
            "satellites",
            "trinolab",
            "workbench",
        }
        whole.extractall(tmp_path / "installed")
    done = subprocess.run(
        [sys.executable, "-c", USES_ITS_DATA],
        cwd=tmp_path / "installed",  # the first place where Python looks
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [str(tmp_path / "installed" / "trinolab"), "3", "20"]


@built
def test_every_figure_and_film_is_a_file(tmp_path, monkeypatch):
    """Of the start page and one chapter."""
    monkeypatch.setattr(figures, "pages", lambda _: ["book/start", "notebooks/01_structure"])
    table = figures.write_figures(dist.HTML, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"index.csv", *table.file}
    assert table.file.is_unique
    assert (table.alt.str.len() > 20).all(), "each has words for who does not see it"
    read = pd.read_csv(tmp_path / "index.csv", keep_default_na=False).set_index("file")
    (film,) = [name for name in read.index if name.startswith("01") and name.endswith(".webm")]
    assert (tmp_path / film).read_bytes()[:4] == bytes.fromhex("1a45dfa3")
    assert (tmp_path / "01_structure-fig-structure-rig.png").read_bytes()[1:4] == b"PNG"
    row = read.loc["01_structure-fig-structure-rig.png"]
    assert row.number == "Fig. 1.1"
    assert row.caption.startswith("Three cameras and the rod")


def test_a_page_without_a_figure_gives_none_and_names_are_those_of_places():
    page = """<article><figure id="fig-x"><img src="a.png" alt="A"/><figcaption>
    <span class="caption-number">Fig. 1 </span><span class="caption-text">The <i>x</i>.</span>
    </figcaption></figure><figure id="id3"><img src="b.png" alt="B"/></figure></article>"""
    assert list(figures.pictures("<article>none</article>", "p")) == []
    assert list(figures.pictures(page, "p")) == [
        ("p-fig-x", "a.png", "Fig. 1", "The x.", "A"),
        ("p-02", "b.png", "", "", "B"),
    ]
