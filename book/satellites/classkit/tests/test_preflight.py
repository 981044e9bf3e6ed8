"""Whether a set-up is good: rendered recordings with one fault at a time, each of which has its row."""

import re

import cv2
import numpy as np
import pandas as pd
import pytest
from boards import board_frames
from healthy import run
from pages import page_says
from scipy.ndimage import gaussian_filter1d
from setups import FPS, SMALL, clip, each, pose_at, record, small_rig

from satellites.classkit import criteria
from satellites.classkit.criteria import (
    COLUMNS,
    GOOD,
    NOT_MEASURED,
    NOT_USABLE,
    USABLE,
    overall,
)
from satellites.classkit.preflight import cost_mm, of_rig, preflight
from satellites.classkit.seen import steepness
from trinolab.camera import Rig, RigCovariance, displaced
from trinolab.triangulation import triangulate

FEW = 6  # instants, where nothing has to move


def judged(folder, frames, **rest):
    """The table of a recording, by its questions."""
    return preflight(record(folder, frames, **rest), progress=False).set_index("what")


def verdict(table, criterion):
    return table.loc[criterion.what, "verdict"]


def measured(table, criterion):
    return table.loc[criterion.what, "measured"]


def blurred(sigma):
    return lambda image: cv2.GaussianBlur(image, (0, 0), sigma)


def test_a_good_recording_is_good_and_its_numbers_are_right(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "rec", clip())
    assert run("preflight rec --out table.csv") == 0
    out, _ = capfd.readouterr()
    assert out.splitlines()[-1] == ("the set-up is good (not measured: what the calibration costs)")
    assert "-> trinolab calibrate writes RIG.covariance.toml" in out
    table = pd.read_csv("table.csv")
    assert tuple(table.columns) == COLUMNS
    table = table.set_index("what")
    assert set(table.drop(index=criteria.COST.what)["verdict"]) == {GOOD}
    value = table["value"]
    # marker 220 by ground 90 in the light, less what shading takes and a blur of 0.7 px
    assert 60 < value[criteria.CONTRAST.what] < 130
    assert re.search(r"ccd1 \d+ \((?:1[89]\d|2[01]\d) on [789]\d\)", out)
    assert value[criteria.FOCUS.what] == pytest.approx(0.75, abs=0.15)
    # 6 mm at 510 mm, f 600 px
    assert value[criteria.SIZE.what] == pytest.approx(7.06, abs=0.4)
    assert value[criteria.ANGLE.what] == pytest.approx(41.5, abs=2)
    assert value[criteria.APART.what] < 0.33
    assert value[criteria.FOUND.what] == 100


@pytest.mark.parametrize(
    ("change", "criterion", "expected"),
    [
        (lambda image: 0.12 * image, criteria.CONTRAST, NOT_USABLE),
        (lambda image: 1.4 * image, criteria.WHITE, USABLE),
        (lambda image: 6.0 * image, criteria.WHITE_PIXELS, NOT_USABLE),
    ],
    ids=["dark", "markers white", "all white"],
)
def test_a_fault_of_the_light_has_its_row(tmp_path, change, criterion, expected):
    table = judged(tmp_path / "rec", each(clip()[:FEW], change))
    assert verdict(table, criterion) == expected
    assert table.loc[criterion.what, "do"] == criterion.do


def test_how_much_of_a_blur_shows(tmp_path):
    """Four fifths of 2 px, as `commands` says; what is drawn has 0.7 px already."""
    little, much = (
        judged(tmp_path / f"{sigma}", each(clip()[:FEW], blurred(sigma))) for sigma in (2.0, 3.0)
    )
    assert [verdict(one, criteria.FOCUS) for one in (little, much)] == [USABLE, NOT_USABLE]
    fifths = 5 * little.loc[criteria.FOCUS.what, "value"] / np.hypot(0.7, 2.0)
    assert round(fifths) == 4
    page_says("book/commands.md", "of 2 px on markers of 7 px is shown as 1.6 px.")
    assert much.loc[criteria.FOUND.what, "value"] == 0
    assert "on markers of 7 px a blur of 3 px leaves no pose" in criteria.FOCUS.why


def test_small_markers(tmp_path):
    table = judged(tmp_path / "rec", clip(FEW, handle=SMALL), handle=SMALL)
    assert verdict(table, criteria.SIZE) == NOT_USABLE
    assert verdict(table, criteria.CONTRAST) != NOT_USABLE


def test_a_tiny_baseline(tmp_path):
    frames = clip(FEW, baseline_mm=25.0, cameras=2)
    table = judged(tmp_path / "rec", frames, rig=small_rig(25.0, 2))
    assert verdict(table, criteria.ANGLE) == NOT_USABLE
    assert table.loc[criteria.ANGLE.what, "value"] == pytest.approx(2.9, abs=0.3)


def test_flicker_and_frames_that_are_missing_or_repeated(tmp_path):
    frames = clip()
    light = [1.0 + 0.3 * (k % 3 == 0) for k in range(16)]
    flickering = [
        each([images], lambda i, g=g: g * i)[0] for g, images in zip(light, frames, strict=True)
    ]
    times = np.arange(16.0) / FPS
    times[8:] += 0.2
    twice = [flickering[k - (k % 4 == 1)] for k in range(16)]
    table = judged(tmp_path / "rec", twice, times=times, handle=None)
    assert verdict(table, criteria.FLICKER) == NOT_USABLE
    assert verdict(table, criteria.STEPS) == NOT_USABLE
    assert measured(table, criteria.STEPS).startswith("6.7 % missing; repeated: 26.7 %")


def test_a_rod_at_rest_tells_nothing_of_time(tmp_path):
    table = judged(tmp_path / "rec", [clip()[0]] * FEW)
    assert verdict(table, criteria.SMEAR) == NOT_MEASURED
    assert verdict(table, criteria.APART) == NOT_MEASURED
    assert measured(table, criteria.SMEAR) == "the rod hardly moved"


@pytest.mark.heavy
def test_a_late_camera(tmp_path):
    frames = clip(24)
    late = [[frames[k][0], frames[k + 1][1], frames[k][2]] for k in range(len(frames) - 1)]
    table = judged(tmp_path / "rec", late)
    assert verdict(table, criteria.APART) == NOT_USABLE
    # b's frame is one of 60 a second later; how well that shows is the row's own sigma
    assert table.loc[criteria.APART.what, "value"] == pytest.approx(1e3 / FPS, abs=1.0)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("exposure_ms", "expected"),
    [(4, GOOD), (10, USABLE), (20, NOT_USABLE), (33, NOT_USABLE)],
)
def test_a_long_exposure(tmp_path, exposure_ms, expected):
    table = judged(tmp_path / "rec", clip(24, exposure_s=1e-3 * exposure_ms))
    assert verdict(table, criteria.SMEAR) == expected
    if exposure_ms in (10, 20):
        shown = measured(table, criteria.SMEAR).split("an exposure of ")[1]
        page_says("book/commands.md", f"{shown} for {exposure_ms} ms")


@pytest.mark.heavy
def test_a_moved_camera_is_not_called_good(tmp_path):
    delta = np.zeros(45)
    delta[30 + 9 : 30 + 12] = np.deg2rad([0.3, 0.3, 0.0])
    table = judged(tmp_path / "rec", clip()[:FEW], rig=displaced(small_rig(), delta))
    assert overall(table) == NOT_USABLE
    # 0.3 deg are 5 px: no pose agrees with all cameras
    assert verdict(table, criteria.FOUND) == NOT_USABLE


def test_without_a_handle_light_time_and_cameras_are_judged(tmp_path):
    table = judged(tmp_path / "rec", clip()[:FEW], handle=None)
    light = {criteria.RANGE, criteria.WHITE_PIXELS, criteria.FLICKER, criteria.STEPS}
    assert set(table.index) == {one.what for one in light | {criteria.ANGLE, criteria.COST}}


def test_a_board_s_squares_are_no_markers(tmp_path):
    """A chessboard alone shows nothing like a marker; beside the rod it changes no row about it."""
    views, _ = board_frames(4)
    table = judged(tmp_path / "board", [[view] * 3 for view in views], rig=False)
    assert measured(table, criteria.CONTRAST) == "nothing like a marker was found"
    assert criteria.ANGLE.what not in table.index
    rod = clip()[:4]
    beside = [[image.copy() for image in images] for images in rod]
    for images, view in zip(beside, views, strict=True):
        for image in images:
            image[:120, :160] = view[120:240, 160:320]
    alone, both = (
        judged(tmp_path / name, frames, rig=False)
        for name, frames in (("rod", rod), ("both", beside))
    )
    assert verdict(alone, criteria.SIZE) == GOOD
    for criterion in (criteria.SIZE, criteria.FOCUS, criteria.CONTRAST):
        assert verdict(both, criterion) == verdict(alone, criterion)
    change = both["value"] / alone["value"]
    assert 0.8 < change[criteria.SIZE.what] < 1.25


def test_what_the_calibration_costs_is_what_drawn_calibrations_cost():
    rng = np.random.default_rng(0)
    rig = Rig(small_rig().cameras[:2])
    sigma = np.zeros((2, 15))
    sigma[1] = [1.0, 1.0, 1.5, 1.5, 0, 0, 0, 0, 0, 2e-3, 2e-3, 2e-3, 0.3, 0.3, 0.3]
    known = Rig(rig.cameras, RigCovariance(rig.names, np.diag(sigma.ravel() ** 2)))
    place = pose_at(0.0).translation
    uv = np.stack([camera.project([place]) for camera in rig.cameras])
    drawn = np.array(
        [
            triangulate(displaced(rig, sigma.ravel() * rng.standard_normal(30)), uv)[0] - place
            for _ in range(300)
        ]
    )
    # 4 % of 300 draws, beside what Eq. 20-21, which take the left ray as exact, differ from least squares
    assert cost_mm(known, place) == pytest.approx(np.sqrt((drawn**2).sum(axis=1).mean()), rel=0.15)
    assert cost_mm(rig, place) is None


@pytest.mark.parametrize("length_px", [0.5, 3.0, 6.0, 15.0])
def test_steepness_is_that_of_a_bar_that_is_drawn(length_px):
    step, size, sigma = 0.01, 8.0, 0.9
    x = np.arange(-40, 40, step)
    bar = (np.abs(x) < size / 2).astype(float)
    motion = np.ones(round(length_px / step))
    smeared = np.convolve(bar, motion / len(motion), "same")
    profile = gaussian_filter1d(smeared, sigma / step)
    slope = np.abs(np.gradient(profile, step))
    at_edge = slope[np.abs(x - size / 2).argmin()]
    expected = at_edge / profile[np.abs(x).argmin()]
    found = steepness(np.array([length_px]), np.array([sigma]), np.array([size]))[0]
    assert found == pytest.approx(expected, rel=0.01)


def test_exit_codes_and_mistakes(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "dark", each(clip()[:FEW], lambda image: 0.05 * image))
    assert run("preflight dark") == 1
    assert "the set-up is not usable: markers' contrast" in capfd.readouterr().out
    (tmp_path / "empty").mkdir()
    (tmp_path / "mixed" / "a").mkdir(parents=True)
    for k, size in enumerate([(300, 400), (30, 40), (300, 400)]):
        cv2.imwrite(str(tmp_path / "mixed" / "a" / f"{k}.png"), np.zeros(size, np.uint8))
    for command, said in {
        "preflight": "expected a recording folder, or else --video for each camera",
        "preflight none": "none: no such folder",
        "preflight empty": "empty: neither folders of images nor videos in it",
        "preflight dark --out no/t.csv": "no/t.csv: no such folder to write into",
        "preflight --video a=dark/images/ccd1 --rig dark/rig.toml": "a video or folder for each camera",
        "preflight dark --handle none.toml": "none.toml",
        "preflight mixed": "1.png: 40 x 30 pixels",
    }.items():
        assert run(command) == 2
        err = capfd.readouterr().err
        assert said in err
        assert err.count("\n") == 1


def test_a_rig_whose_axes_do_not_meet_says_that_nobody_knows_where_the_rod_will_be():
    rows = of_rig(small_rig(), None)
    assert [row["what"] for row in rows] == [criteria.ANGLE.what, criteria.COST.what]
    for row in rows:
        assert row["verdict"] == NOT_MEASURED
        assert row["measured"] == "nobody knows where the rod will be: the axes hardly meet"
