"""The gallery's tables: whole, and what their commands say."""

import shlex
from pathlib import Path
from types import SimpleNamespace

import nbformat
import numpy as np
import pytest
from executed import as_it_stands

from trinolab.datasets import load_sweep
from trinolab.window import Window
from workbench.cli.arguments import parser
from workbench.studies import gallery
from workbench.studies.gallery import GALLERY, command, load, settings
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
    assert f"../data/sweeps/gallery/{name}.csv" in TEXT


@pytest.mark.parametrize("name", CHAPTERS)
def test_command_of_a_chapter_has_the_same_runs(name):
    arguments = parser().parse_args(shlex.split(command(name))[1:])
    assert runs(parse(arguments.parameter)) == settings(name)
    assert (ROOT / arguments.notebook).is_file()


def test_tables_agree_where_two_sweeps_meet():
    """At the standard scene, and with the table of chapter 9, which another module computed."""
    at = {
        "noise": ("read_noise", 1.5),
        "blur": ("blur_px", 0.7),
        "marker_size": ("marker_diameter_mm", 3.0),
    }
    here = {
        name: load(name).query(f"{column} == {value} and seed == 0")
        for name, (column, value) in at.items()
    }
    stored = load_sweep("marker_size").query("marker_diameter_mm == 3 and seed == 0").iloc[0]
    assert here["marker_size"]["E_t_mm_paper"].item() == pytest.approx(stored["E_t_mm"], rel=DIGITS)
    for column in ("E_t_mm_paper", "geodesic_deg_patches"):
        assert here["blur"][column].item() == pytest.approx(
            here["marker_size"][column].item(), rel=1e-5
        )


@pytest.mark.parametrize("function", [load, settings, command])
def test_an_unknown_name_is_refused(function):
    with pytest.raises(ValueError, match="name: expected one of update_rate"):
        function("colour")


# --- what a sweep reads, once


@pytest.fixture
def read(monkeypatch):
    """What is read of which recording, in place of it."""
    asked = []

    def recording(name, **how):
        asked.append((name, how))
        empty = [f"{name} empty {k}" for k in (1, 2, 3)]
        return SimpleNamespace(images_of=lambda k: f"{name} ccd{k + 1}", empty=empty)

    caches = gallery.kept_recording, gallery.regions, gallery.hard_light
    for cached in caches:
        cached.cache_clear()
    monkeypatch.setattr(gallery, "read_recording", recording)
    yield asked
    for cached in caches:
        cached.cache_clear()


def test_what_moves_is_asked_once_of_each_camera_with_its_own_empty_bench(read, monkeypatch):
    monkeypatch.setattr(gallery.markertrack, "moving_regions", lambda *given: given)
    first = gallery.regions("calm")
    assert first == [(f"calm ccd{k}", f"calm empty {k}") for k in (1, 2, 3)]
    assert gallery.regions("calm") is first
    assert gallery.regions("hard") != first
    assert read == [("calm", {}), ("hard", {})]


def test_pixels_are_counted_in_a_fourth_of_ccd3_s_rows_and_columns(read, monkeypatch):
    monkeypatch.setattr(gallery, "moving", lambda recording, camera, seam_px: (camera, seam_px))
    assert gallery.hard_light() == ("hard ccd3", "hard empty 3", (2, 2))
    assert read == [("hard", {"every": 4})]


def test_an_image_is_lost_if_a_marker_is_outside_or_nothing_is_used(monkeypatch):
    """Five images, of which the third shows no marker."""
    seen = np.array([True, True, False, True, True])
    window = Window(0, 0, 40, 20)
    looks = [
        SimpleNamespace(window=window if used is not None else None, used=bool(used))
        for used in (True, True, True, False, None)
    ]
    instants = [SimpleNamespace(seen=np.array([[any_of_them]])) for any_of_them in seen]
    camera = SimpleNamespace(size=(200, 100))
    recording = SimpleNamespace(
        rig=SimpleNamespace(cameras=[camera]),
        instants=instants,
        images_of=lambda k: [],
        times_s=[],
        handle=None,
    )
    monkeypatch.setattr(gallery, "kept_recording", lambda name: recording)
    monkeypatch.setattr(gallery, "regions", lambda name: [None])
    monkeypatch.setattr(gallery.markertrack, "follow", lambda *_: looks)
    monkeypatch.setattr(gallery, "held", lambda *_: np.array([True, False, True, True, False]))
    assert gallery.followed("calm", 0, None) == [
        (0.04, False),
        (0.04, True),
        (0.04, True),
        (0.0, True),
    ]
