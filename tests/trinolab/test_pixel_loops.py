"""The loops over the pixels against the forms in NumPy and OpenCV, to the last digit: as Python runs
them, which refuses an index out of bounds, and compiled.
"""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from trinolab import background, memory, pixel_loops
from trinolab.background import BackgroundParameters, step

SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 70))
# what a background may hold: up to what a saturated one is scaled to
LIGHT = st.floats(0, 500, width=32)
LEVELS = st.one_of(st.integers(0, 255), st.sampled_from([0, 254, 255]))


@st.composite
def instants(draw):
    """A frame, a background, a gain and parameters; black, saturated and whole ones among them."""
    shape = draw(SHAPES)
    frame = draw(arrays(np.uint8, shape, elements=LEVELS))
    known = draw(arrays(np.float32, shape, elements=LIGHT))
    if draw(st.booleans()):  # a frame much like its background, as most are
        frame = np.clip(known, 0, 255).astype(np.uint8)
    rates = draw(st.floats(0, 1)), draw(st.floats(0, 60)), draw(st.floats(0, 1))
    parameters = BackgroundParameters(*rates, masked_rate=draw(st.none() | st.floats(0, 1)))
    return frame, known, draw(st.floats(0.25, 4)), parameters


@settings(max_examples=100)
@given(instants())
@example((np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.float32), 1.0, BackgroundParameters()))
def test_a_pixel_is_compared_and_renewed_as_the_equations_say(instant):
    frame, known, gain, p = instant
    by_equations = background._by_equations(*instant)
    loop = pixel_loops.compare_and_renew
    for way in (loop, loop.py_func):
        found = np.empty_like(known), np.empty_like(frame), np.empty(frame.shape, bool)
        rates = p.difference_threshold, p.shadow_share, p.update_rate, p.slow_rate
        way(frame, known, gain, *rates, background.WHITE, *found)
        for wanted, one in zip(by_equations, found, strict=True):
            assert one.dtype == wanted.dtype
            np.testing.assert_array_equal(one, wanted)


SPECKLE = np.random.default_rng(0).random((2, 100, 120)) < [[[0.3]], [[0.45]]]


@settings(max_examples=100)
@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 15))))
@example(np.ones((1, 1), bool))
@example(np.ones((3, 1), bool))
@example(np.arange(15)[None] % 2 == 0)  # as many runs as a row can have
@example(SPECKLE[0])
@example(SPECKLE[1])
def test_the_largest_region_is_that_of_a_fill_from_each_pixel(mask):
    mask[-1, -1] |= not mask.any()
    labels = ndimage.label(mask, np.ones((3, 3)))[0]  # numbered from the top
    rows, columns = np.nonzero(labels == np.bincount(labels.ravel())[1:].argmax() + 1)
    wanted = (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)
    assert pixel_loops.largest_region(mask, mask.sum()) == wanted
    assert pixel_loops.largest_region.py_func(mask, mask.sum()) == wanted
    assert tuple(background._largest_region(mask)) == wanted


def frame_and_background(kind=""):
    """A frame with a hand before it, and its background."""
    rng = np.random.default_rng(0)
    known = rng.normal(60, 20, (301, 333)).clip(0, 400).astype(np.float32)
    frame = np.clip(1.2 * known + rng.normal(0, 2, known.shape), 0, 255).astype(np.uint8)
    frame[100:160, 50:90] = 220
    if kind == "strided":
        frame = np.repeat(frame, 2, axis=1)[:, ::2]
        known = np.repeat(known, 2, axis=0)[::2]
    return frame, known


@pytest.mark.parametrize("kind", ["strided", np.uint16, np.float32, "in a browser"])
def test_a_step_is_the_same_for_any_type_and_without_the_loops(kind, monkeypatch):
    frame, known = frame_and_background(kind)
    new, detection = step(*frame_and_background()[::-1])
    if kind == "in a browser":
        monkeypatch.setattr(background, "_loops", lambda: None)
    elif kind != "strided":
        frame = frame.astype(kind)
    other, seen = step(known, frame)
    np.testing.assert_array_equal(other, new)
    np.testing.assert_array_equal(seen.image, detection.image)
    np.testing.assert_array_equal(seen.mask, detection.mask)
    assert seen.window == detection.window


def test_what_is_held_is_never_written_over_and_what_is_let_go_is_used_again():
    frame, known = frame_and_background()
    held = [step(known, frame + np.uint8(k)) for k in range(8)]
    part = held[3][0][5:9]  # a view holds the memory as well
    arrays_held = [array for new, seen in held for array in (new, seen.image, seen.mask)]
    copies = [array.copy() for array in arrays_held]
    wanted = part.copy()
    for k in range(8):
        step(known, frame - np.uint8(k))
    for array, copy in zip(arrays_held, copies, strict=True):
        np.testing.assert_array_equal(array, copy)
    del held, arrays_held, array
    counts = []
    for k in range(8):
        step(known, frame - np.uint8(k))
        counts.append([len(kept) for kept in memory._let_go.values()])
    np.testing.assert_array_equal(part, wanted)
    assert counts[-1] == counts[2]


def test_numba_is_not_loaded_by_an_import_and_not_needed():
    program = (
        "import sys, trinolab.tracker; assert 'numba' not in sys.modules; sys.modules['numba'] = None; "
        "from trinolab import background; assert background._loops() is None"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
