"""The gallery's tables: whole, and what their commands say."""

import shlex
from pathlib import Path

import nbformat
import numpy as np
import pytest
from executed import as_it_stands

from workbench.cli.arguments import parser
from workbench.studies import gallery
from workbench.studies.gallery import (
    GALLERY,
    background_pixels,
    command,
    load,
    settings,
)
from workbench.studies.ground_truth import Regions
from workbench.sweep.grid import parse, runs
from workbench.sweep.notebook import read_parameters

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "book" / "gallery.ipynb"
TEXT = "\n".join(cell.source for cell in nbformat.read(PAGE, as_version=4).cells)
CHAPTERS = [name for name, one in GALLERY.items() if isinstance(one.what, str)]
each_exhibit = pytest.mark.parametrize("name", GALLERY)
# Tables have six digits. Between instruction sets their numbers differ by at most 1.3e-11 of
# themselves (make verify ARGS="--only spread --groups tables").
DIGITS = 1e-5


@each_exhibit
def test_table_is_whole(name):
    table, expected = load(name), settings(name)
    assert table.attrs["parameters"] == list(expected[0])
    assert table[list(expected[0])].to_dict("records") == [
        pytest.approx(row, rel=1e-5) for row in expected
    ]
    results = table.drop(columns=table.attrs["parameters"])
    assert len(results.columns) >= 2
    assert results.notna().any().all()
    if GALLERY[name].results:
        assert tuple(results.columns) == GALLERY[name].results


@pytest.mark.parametrize("name", CHAPTERS)
def test_a_chapter_s_table_has_what_the_chapter_gives(name):
    """The run with the chapter's own parameters."""
    path = ROOT / "notebooks" / f"{GALLERY[name].what}.ipynb"
    table, defaults = load(name), read_parameters(path)
    (row,) = (k for k, setting in enumerate(settings(name)) if setting.items() <= defaults.items())
    results = as_it_stands(path).results
    for result in GALLERY[name].results:
        assert results[result] == pytest.approx(table.loc[row, result], rel=DIGITS), result


@each_exhibit
def test_page_has_the_command_and_the_table(name):
    assert command(name) in TEXT
    if name in CHAPTERS:
        arguments = parser().parse_args(shlex.split(command(name))[1:])
        assert runs(parse(arguments.parameter)) == settings(name)
        assert (ROOT / arguments.notebook).is_file()
    assert f"../data/sweeps/gallery/{name}.csv" in TEXT


# --- what the trials change


def test_a_step_of_the_light_is_false_as_printed_and_cured(monkeypatch):
    """A bright square on an empty scene: inside and outside without a seam."""
    inside = np.zeros((40, 60), bool)
    inside[10:20, 10:30] = True
    frames = np.full((4, 40, 60), 50, np.uint8)
    empty = frames[0].copy()
    frames[2:] += 30  # all of it is brighter from the third frame on
    frames[:, inside] += 100
    clip = list(frames), empty, [Regions(inside, ~inside)] * 4
    monkeypatch.setattr(gallery, "hard_light", lambda: clip)
    found = background_pixels(update_rate=0.01, difference_threshold=15.0)
    assert found["false_percent_printed"] == pytest.approx(50.0)
    assert found["false_percent_cured"] == pytest.approx(0.0)
    assert found["missed_percent_printed"] == found["missed_percent_cured"] == pytest.approx(0.0)
    assert background_pixels(difference_threshold=90.0)["missed_percent_printed"] == 0.0
    assert background_pixels(difference_threshold=140.0)["missed_percent_printed"] == 100.0
