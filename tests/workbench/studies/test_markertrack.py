"""The loop of prediction, window, markers and correction, on drawn discs whose places are known."""

from dataclasses import replace

import cv2
import numpy as np

from trinolab.datasets import load_handle
from trinolab.kalman import KalmanParameters
from trinolab.parameters import Parameters
from trinolab.window import Window
from workbench.studies.markertrack import follow, step

CODED = load_handle("coded")
PARAMETERS = Parameters(kalman=KalmanParameters(9.5e8, 1.5, 1200.0, 6000.0))
SIZE = (640, 480)
WHOLE = Window(0, 0, *SIZE)
PATTERN = np.array([(-30, -40), (30, -40), (0, 0), (-30, 40), (30, 40.0)])
TIMES = np.arange(12) / 30


def discs(*middles, size=SIZE):
    """A dark image with bright discs of 15 px, five about each middle, and the noise of a
    camera.
    """
    image = np.full((size[1], size[0]), 45.0)
    for middle in middles:
        for u, v in PATTERN + middle:
            centre = round(16 * u), round(16 * v)
            cv2.circle(image, centre, 16 * 15 // 2, 220.0, -1, cv2.LINE_AA, 4)
    noise = np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.7) + noise, 0, 255).astype(np.uint8)


def middle(t):
    """Of discs that move at 600 px/s and slow down."""
    return np.array([150.0, 200.0]) + [600 * t - 400 * t**2, 300 * t]


def test_it_looks_elsewhere_first_and_then_where_the_target_will_be():
    looks = follow(
        [discs(middle(t)) for t in TIMES], TIMES, CODED, [WHOLE] + [None] * 11, PARAMETERS
    )
    assert looks[0].window == WHOLE
    assert np.isnan(looks[0].nis)
    for t, look in zip(TIMES, looks, strict=True):
        expected = PATTERN + middle(t)
        away = np.linalg.norm(look.markers.uv[:, None] - expected, axis=2)
        assert away.shape == (5, 5)
        assert away.min(axis=0).max() < 0.5  # px; discs are drawn to a sixteenth
        assert look.used
        np.testing.assert_allclose(look.box.centre, middle(t), atol=1.0)  # whole pixels
        assert look.box.width >= 60 + 14  # whole markers
    assert max(look.window.area for look in looks[3:]) < 0.15 * WHOLE.area
    assert np.nanmax([look.nis for look in looks]) < 13.8  # the gate


def test_a_hidden_target_is_looked_for_in_a_window_that_grows_and_after_a_while_elsewhere():
    times = np.arange(18) / 30
    frames = [discs(middle(t)) if t < 0.19 or t > 0.53 else discs() for t in times]
    elsewhere = Window(1, 0, 639, 480)  # no window that grew
    looks = follow(frames, times, CODED, [elsewhere] * 18, replace(PARAMETERS, memory_s=0.25))
    assert [look.used for look in looks] == [True] * 6 + [False] * 10 + [True] * 2
    areas = [look.window.area for look in looks]
    assert (np.diff(areas[6:11]) > 0).all()
    assert looks[14].window == elsewhere  # the last one was seen at 0.17 s
    assert looks[16].window == elsewhere
    assert areas[17] < WHOLE.area


def test_after_a_jump_the_filter_starts_anew():
    state = None
    for t in TIMES[:8]:
        state, _ = step(state, discs(middle(t)), t, CODED, WHOLE, PARAMETERS)
    moved = middle(TIMES[8]) + [24.0, 24.0]  # inside the window, and farther than the motion goes
    after, look = step(state, discs(moved), TIMES[8], CODED, WHOLE, PARAMETERS)
    assert not look.used
    assert look.nis > 13.8  # chi-square of two degrees at 0.999
    np.testing.assert_allclose(after.motion.mean[:2], moved, atol=1.0)
    np.testing.assert_array_equal(after.motion.mean[2:], 0.0)
    after, look = step(after, discs(moved + 20.0), TIMES[9], CODED, WHOLE, PARAMETERS)
    assert look.used
