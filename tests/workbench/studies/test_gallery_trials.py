"""What the gallery's trials change, and what they count, on cases whose answer is known
beforehand.
"""

import numpy as np
import pytest

from trinolab.datasets import load_table1, paper_rig
from trinolab.window import Window
from workbench.studies import gallery
from workbench.studies.gallery import (
    background_pixels,
    search_window,
    with_baseline,
    with_vergence,
)
from workbench.studies.ground_truth import Regions, read_recording

PAIR = paper_rig()
BASELINE_MM = float(np.linalg.norm(PAIR.cameras[1].centre - PAIR.cameras[0].centre))
# Tables have six digits. Between instruction sets their numbers differ by at most 1.3e-11 of
# themselves (make verify ARGS="--only spread --groups tables").
DIGITS = 1e-5
MIDDLE = load_table1().set_poses.translation.mean(axis=0)


def axis(camera):
    return camera.T_world_cam.apply([0.0, 0.0, 1.0]) - camera.centre


def angle_deg(rig):
    return np.rad2deg(np.arccos(axis(rig.cameras[0]) @ axis(rig.cameras[1])))


# --- the rigs


@pytest.mark.parametrize("baseline_mm", [20.0, 75.0, 300.0])
def test_another_baseline_keeps_the_work_in_the_same_place_of_both_images(baseline_mm):
    moved = with_baseline(PAIR, baseline_mm)
    first, second = moved.cameras
    assert first == PAIR.cameras[0]
    assert np.linalg.norm(second.centre) == pytest.approx(baseline_mm)
    assert (
        np.linalg.norm(np.cross(second.centre, PAIR.cameras[1].centre))
        < 1e-9 * baseline_mm * BASELINE_MM
    )
    np.testing.assert_allclose(
        second.project([MIDDLE]), PAIR.cameras[1].project([MIDDLE]), rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("vergence_deg", [0.0, 4.0, 30.0])
def test_another_vergence_turns_both_cameras_alike_where_they_stand(vergence_deg):
    turned = with_vergence(PAIR, vergence_deg)
    assert angle_deg(turned) == pytest.approx(vergence_deg, abs=1e-5)
    shares = [
        np.arccos(np.clip(axis(a) @ axis(b), -1, 1))
        for a, b in zip(PAIR.cameras, turned.cameras, strict=True)
    ]
    assert shares[0] == pytest.approx(shares[1], abs=1e-9)
    for before, after in zip(PAIR.cameras, turned.cameras, strict=True):
        np.testing.assert_allclose(after.centre, before.centre, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "value", "named"),
    [
        (with_baseline, 0.0, "baseline_mm"),
        (with_baseline, np.nan, "baseline_mm"),
        (with_vergence, -1.0, "vergence_deg"),
        (with_vergence, 91.0, "vergence_deg"),
    ],
)
def test_a_rig_that_cannot_be_is_refused(change, value, named):
    with pytest.raises(ValueError, match=named):
        change(PAIR, value)


# --- accuracy


# --- pixels


def clip(frames):
    """A bright square on an empty scene: inside and outside without a seam."""
    inside = np.zeros((40, 60), bool)
    inside[10:20, 10:30] = True
    images = list(np.array(frames, np.uint8))
    return (
        images,
        np.full((40, 60), 50, np.uint8),
        [Regions(inside, ~inside)] * len(frames),
    ), inside


def test_a_step_of_the_light_is_false_as_printed_and_cured(monkeypatch):
    frames, inside = np.full((4, 40, 60), 50), clip([np.zeros((40, 60))])[1]
    frames[2:] += 30  # all of it is brighter from the third frame on
    frames[:, inside] += 100
    monkeypatch.setattr(gallery, "hard_light", lambda: clip(frames)[0])
    found = background_pixels(update_rate=0.01, difference_threshold=15.0)
    assert found["false_percent_printed"] == pytest.approx(50.0)
    assert found["false_percent_cured"] == pytest.approx(0.0)
    assert found["missed_percent_printed"] == found["missed_percent_cured"] == pytest.approx(0.0)
    assert background_pixels(difference_threshold=90.0)["missed_percent_printed"] == 0.0
    assert background_pixels(difference_threshold=140.0)["missed_percent_printed"] == 100.0


# --- windows


@pytest.fixture
def still(monkeypatch):
    """Eight instants of the calm recording in place of both."""
    recording = read_recording("calm", range(40, 48))
    regions = [[None] * 8 for _ in recording.rig.cameras]
    monkeypatch.setattr(gallery, "kept_recording", lambda name: recording)
    monkeypatch.setattr(gallery, "regions", lambda name: regions)
    return recording, regions


def test_a_filter_that_expects_anything_searches_everything_and_loses_nothing(still):
    for row in still[1]:
        row[:] = [Window(0, 0, 1280, 1024)] * 8
    found = search_window(jerk_intensity=1e16)
    assert found["window_percent_calm"] > 99.0
    assert found["lost_calm"] == 0.0
    assert search_window(jerk_intensity=1e9)["window_percent_calm"] < 30.0
