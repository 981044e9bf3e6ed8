"""Eq. 5-6 against OpenCV, double loops and closed forms; the factor of the light
against NumPy's median, and the one that a frame was made with.
"""

import cv2
import numpy as np
import pytest

from trinolab.background import (
    BackgroundParameters,
    difference,
    light_gain,
    moving_window,
    step,
    update,
)
from trinolab.window import Window

SIZE = (31, 23)  # width, height: not square
RNG = np.random.default_rng(0)
FRAME = RNG.integers(0, 256, SIZE[::-1], dtype=np.uint8)
BACKGROUND = RNG.uniform(0, 255, SIZE[::-1]).astype(np.float32)
MASK = RNG.uniform(size=SIZE[::-1]) < 0.3
# grey levels; float32 resolves 1.5e-5 at 255, and two programs round in another order
GREY_ATOL = 5e-5


@pytest.mark.parametrize(
    ("threshold", "share"), [(0, 0), (15, 0), (80.5, 0), (255, 0), (15, 0.3), (15, 1)]
)
def test_difference_is_that_of_two_loops(threshold, share):
    image, mask = difference(FRAME, BACKGROUND, threshold, share)
    expected = np.zeros_like(MASK)
    for v, u in np.ndindex(MASK.shape):
        low = (1 - share) * float(BACKGROUND[v, u]) - threshold
        expected[v, u] = not low <= FRAME[v, u] <= float(BACKGROUND[v, u]) + threshold
    np.testing.assert_array_equal(mask, expected)
    np.testing.assert_array_equal(image, np.where(expected, FRAME, 0))
    assert image.dtype == FRAME.dtype
    assert mask.any() or threshold == 255


def test_a_moving_black_pixel_is_in_the_mask_and_lost_in_the_image():
    frame, background = np.array([[30, 31, 10, 9, 0]], np.uint8), np.full((1, 5), 20.0)
    image, mask = difference(frame, background, 10)
    # Eq. 5: 0 means background; the threshold itself is not exceeded
    np.testing.assert_array_equal(mask, [[False, True, False, True, True]])
    np.testing.assert_array_equal(image, [[0, 31, 0, 9, 0]])


@pytest.mark.parametrize("alpha", [0.0, 0.1, 1.0])
def test_update_is_that_of_two_loops_with_a_slower_rate_under_the_mask(alpha):
    expected = np.empty(FRAME.shape)
    for v, u in np.ndindex(FRAME.shape):
        rate = 0.01 if MASK[v, u] else alpha
        expected[v, u] = rate * float(FRAME[v, u]) + (1 - rate) * float(BACKGROUND[v, u])
    found = update(BACKGROUND, FRAME, alpha, MASK, 0.01)
    np.testing.assert_allclose(found, expected, rtol=0, atol=GREY_ATOL)
    # left as they are
    np.testing.assert_array_equal(update(BACKGROUND, FRAME, alpha, MASK)[MASK], BACKGROUND[MASK])
    assert found.dtype == update(FRAME, FRAME, alpha).dtype == np.float32
    assert update(BACKGROUND.astype(float), FRAME, alpha).dtype == np.float64


RESTING = [
    # (90 - 45) (1 - alpha)^k falls below T = 15 at k = ln 3 / -ln(1 - alpha): 21.4
    (BackgroundParameters(update_rate=0.05, masked_rate=None), 22),
    (BackgroundParameters(masked_rate=0.02), 55),
    (BackgroundParameters(masked_rate=0.0), None),
    (BackgroundParameters(), None),
]


@pytest.mark.parametrize(("parameters", "frames"), RESTING)
def test_a_resting_square_is_swallowed_as_printed_and_kept_by_the_mask(parameters, frames):
    background, frame = np.full((40, 50), 45.0), np.full((40, 50), 45, np.uint8)
    frame[10:30, 10:30] = 90
    shares = []
    for _ in range(60):
        background, detection = step(background, frame, parameters)
        shares.append(detection.mask[10:30, 10:30].mean())
    # the k-th frame meets the background of k - 1
    assert shares == [1.0] * (frames or 60) + [0.0] * (60 - (frames or 60))


def test_a_saturated_lamp_light_and_back():
    # The right half is seen at 255 while the lamp is up; its light, 300, is still known when it
    # goes down again.
    rng, bench = np.random.default_rng(3), np.repeat([[45.0, 200.0]], [80, 80], axis=1)
    bench = np.repeat(bench, 60, axis=0)
    state, shares = bench, []
    for gain in [1.0] * 3 + [1.5] * 30 + [1.0] * 3:
        noise = np.sqrt(0.05 * gain * bench + 1.5**2) * rng.standard_normal(bench.shape)
        frame = np.clip(np.rint(gain * bench + noise), 0, 255).astype(np.uint8)
        if gain > 1:
            off = BackgroundParameters(compensate_light=False)
            assert step(bench, frame, off)[1].mask.mean() > 0.7
        state, detection = step(state, frame)
        shares.append(detection.mask.mean())
    # half of the pixels have a noise of 3.5 grey levels, T is 15: 4 standard deviations
    assert max(shares) < 1e-3
    assert state[:, 80:].mean() == pytest.approx(200, abs=1)


def test_window_is_the_extremes_of_the_largest_region():
    mask = np.zeros((40, 60), bool)
    mask[2:4, 50:60] = True  # 20 px at the edge
    region = np.zeros_like(mask)
    region[np.arange(10, 30), np.arange(5, 25)] = True  # a diagonal: its pixels touch at corners
    region[20, 8:30] = True
    assert moving_window(mask | region) == Window(*cv2.boundingRect(region.astype(np.uint8)))


def test_window_needs_more_pixels_than_the_threshold():
    mask = np.zeros((20, 20), bool)
    mask[3, 4:9], mask[15, 15] = True, True  # 6 in all
    assert moving_window(mask, 5) == Window(4, 3, 5, 1)
    assert moving_window(mask, 6) is None
    assert moving_window(np.zeros((20, 20), bool)) is None
    assert moving_window(np.eye(1, 9, 4, dtype=bool)) == Window(4, 0, 1, 1)


def test_windows_by_hand():
    window = Window(3, 1, 4, 2)
    image = np.arange(50).reshape(5, 10)
    np.testing.assert_array_equal(window.crop(image), [[13, 14, 15, 16], [23, 24, 25, 26]])
    uv = [[2.5, 0.5], [6.49, 2.49], [2.49, 1], [6.5, 1], [4, 2.5], [np.nan, 1]]
    np.testing.assert_array_equal(window.contains(uv), [True, True, False, False, False, False])
    assert (window.area, window.centre) == (8, (4.5, 1.5))
    # 3.4 lies on pixel 3, 6.5 on pixel 7, 7.6 and 8.4 on pixel 8
    assert Window.around([[3.4, 7.6], [np.nan, 0], [6.5, 8.4]]) == Window(3, 8, 5, 1)
    assert Window.around([[np.nan, 1]]) is None
    assert window.grown(1.2) == Window(1, -1, 8, 6)
    assert Window(1, -1, 8, 6).clipped((7, 4)) == Window(1, 0, 6, 4)
    assert Window(7, 0, 3, 3).clipped((7, 4)) is None
    assert Window(-3, 0, 3, 3).clipped((7, 4)) is None


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("whole", [False, True])
def test_the_commonest_ratio_is_numpys_median_to_the_last_digit(whole, even):
    rng = np.random.default_rng(1)
    old = rng.normal(60, 12, (100, 120 + even)).clip(20, 120)
    old = np.round(old) if whole else old
    frame = np.round(0.8 * old + rng.normal(0, 1, old.shape)).astype(np.uint8)
    frame[:30] = 200  # a hand before the bench
    logs = np.log(frame / old)
    counts, edges = np.histogram(logs, bins=277, range=(-np.log(4), np.log(4)))
    peak = edges[np.convolve(counts, np.hanning(25), "same").argmax()]
    near = logs[np.abs(logs - peak) < 0.15]
    assert light_gain(frame, old, 1) == np.exp(np.median(near))


def greys(*values):
    """An image of columns, eight of each grey."""
    return np.repeat(np.array(values)[None], 8, axis=0).repeat(8, axis=1)


LIGHTS = [
    (greys(0, 0), greys(50, 50), 1.0),  # a covered lens
    (greys(50, 50), greys(0, 0), 1.0),  # a dark background
    (greys(50, 50), greys(10, 10), 1.0),  # and one that is just dark
    (greys(255, 255, 72), greys(200, 200, 45), 1.6),  # two thirds saturated, a ratio of 1.28
    (greys(*[0] * 19, 90), greys(*[45] * 20), 1.0),  # few agree
    (greys(*[0] * 17, 90, 90, 90), greys(*[45] * 20), 2.0),  # enough do
]


@pytest.mark.parametrize(("frame", "background", "gain"), LIGHTS)
def test_light_gain_by_hand(frame, background, gain):
    found = light_gain(frame.astype(np.uint8), background.astype(float), 1)
    assert found == pytest.approx(gain, rel=1e-9)


REFUSED = [
    (difference, (FRAME, BACKGROUND[:-1], 15)),
    (difference, (FRAME, BACKGROUND, -1)),
    (difference, (FRAME, BACKGROUND, 15, -0.1)),
    (difference, (FRAME, BACKGROUND * np.nan, 15)),
    (update, (BACKGROUND, FRAME, 1.1)),
    (update, (BACKGROUND, FRAME, 0.1, MASK.astype(int))),
    (update, (BACKGROUND, FRAME, 0.1, MASK, -0.1)),
    (moving_window, (MASK[:0],)),
    (moving_window, (MASK, -1)),
    (light_gain, (FRAME, BACKGROUND, 0)),
    (Window, (0, 0, 0, 1)),
    (Window, (0.5, 0, 1, 1)),
    (Window(0, 0, 9, 9).crop, (np.zeros((5, 5)),)),
    (Window(0, 0, 1, 1).grown, (-1,)),
    (BackgroundParameters, (2,)),
    (BackgroundParameters, (0, -1)),
    (BackgroundParameters, (0, 0, 2)),
    (BackgroundParameters, (0, 0, 0, "few")),
    (BackgroundParameters, (0, 0, 0, 0, -0.1)),
    (BackgroundParameters, (0, 0, 0, 0, 0, 1)),
]


@pytest.mark.parametrize(("call", "given"), REFUSED)
def test_bad_input_is_a_value_error(call, given):
    with pytest.raises(ValueError, match="expected"):
        call(*given)
