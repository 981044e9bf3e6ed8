"""The gallery's tables: whole, what their commands say, and what is computed anew; its command.

`make verify ARGS="--only spread"` computes a run of each table anew, here it is a run of each kind.
"""

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
from workbench.studies.__main__ import main
from workbench.studies.gallery import GALLERY, Exhibit, command, load, settings
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


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.heavy)
        for name in ("marker_size", "background", "elevation")
    ],
)
def test_one_run_is_computed_again(name):
    """The run in the middle: `make sweeps` makes the tables anew after a change."""
    table, expected = load(name), settings(name)
    k = len(expected) // 2
    found = GALLERY[name].what(**expected[k])
    results = table.columns.difference(table.attrs["parameters"])
    np.testing.assert_allclose(
        [found[result] for result in results], table.loc[k, results].astype(float), rtol=DIGITS
    )


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


# --- the command


def squares(a, b=1.0):
    return {"square": a * a, "product": a * b}


@pytest.fixture
def small(monkeypatch, tmp_path):
    monkeypatch.setattr(
        gallery,
        "GALLERY",
        {
            "one": Exhibit(squares, ("a=1,2,3",)),
            "two": Exhibit(squares, ("a=0.5:1.5:3", "b=2.0,4.0"), ("product",)),
        },
    )
    (tmp_path / "tables").mkdir()
    folders = ["--out", str(tmp_path / "tables"), "--kept", str(tmp_path / "kept")]
    return tmp_path / "tables", ["gallery", *folders, "--workers", "1"]


def test_the_command_writes_the_tables(small):
    folder, arguments = small
    assert main(arguments) == 0
    assert (folder / "one.csv").read_text() == "a,square,product\n1,1,1\n2,4,2\n3,9,3\n"
    assert (folder / "two.csv").read_text().splitlines()[:3] == [
        "a,b,product",
        "0.5,2,1",
        "0.5,4,2",
    ]
    assert not list((folder.parent / "kept").iterdir())


def test_the_command_goes_on_where_it_was_stopped(small, monkeypatch, capsys):
    folder, arguments = small
    done = []

    def stopping(a, b=1.0):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(a)
        return squares(a, b)

    monkeypatch.setitem(gallery.GALLERY, "one", Exhibit(stopping, ("a=1,2,3",)))
    assert main([*arguments, "one", "two"]) == 130
    assert "2 of 3 runs are kept" in capsys.readouterr().err
    assert not list(folder.iterdir())
    done.append("one more")
    assert main([*arguments, "one"]) == 0
    assert done == [1, 2, "one more", 3]
    assert (folder / "one.csv").read_text() == "a,square,product\n1,1,1\n2,4,2\n3,9,3\n"


def test_a_sweep_with_a_failed_run_writes_nothing(small, monkeypatch, capsys):
    folder, arguments = small
    monkeypatch.setitem(gallery.GALLERY, "two", Exhibit(lambda a: 1 / (a - 2), ("a=1,2,3",)))
    assert main(arguments) == 2
    assert "two: 1 of 3 runs failed; the first: ZeroDivisionError" in capsys.readouterr().err
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("more", "named"),
    [
        (["three"], "expected one of one, two, got 'three'"),
        (["--out", "/nowhere"], "no such folder"),
        (["--workers", "0"], "workers"),
    ],
)
def test_the_command_refuses_in_a_line(small, more, named, capsys):
    assert main([*small[1], *more]) == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert named in line


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
