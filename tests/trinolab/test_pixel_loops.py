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
    if draw(st.booleans()):
        known = np.round(known)
    if draw(st.booleans()):  # a frame much like its background, as most are
        frame = np.clip(known, 0, 255).astype(np.uint8)
    parameters = BackgroundParameters(
        update_rate=draw(st.floats(0, 1)),
        difference_threshold=draw(st.floats(0, 60)),
        shadow_share=draw(st.floats(0, 1)),
        masked_rate=draw(st.none() | st.floats(0, 1)),
    )
    return frame, known, draw(st.floats(0.25, 4)), parameters


def written_by(loop, frame, known, gain, p):
    results = np.empty_like(known), np.empty_like(frame), np.empty(frame.shape, bool)
    rates = p.difference_threshold, p.shadow_share, p.update_rate, p.slow_rate
    loop(frame, known, gain, *rates, background.WHITE, *results)
    return results


@settings(max_examples=300)
@given(instants())
@example((np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.float32), 1.0, BackgroundParameters()))
def test_a_pixel_is_compared_and_renewed_as_the_equations_say(instant):
    by_equations = background._by_equations(*instant)
    compiled = written_by(pixel_loops.compare_and_renew, *instant)
    in_python = written_by(pixel_loops.compare_and_renew.py_func, *instant)
    for wanted, one, other in zip(by_equations, compiled, in_python, strict=True):
        assert one.dtype == other.dtype == wanted.dtype
        np.testing.assert_array_equal(one, wanted)
        np.testing.assert_array_equal(other, wanted)


MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 15)))


@settings(max_examples=300)
@given(MASKS)
@example(np.ones((1, 1), bool))
@example(np.ones((3, 1), bool))
@example(np.arange(15)[None] % 2 == 0)  # as many runs as a row can have
def test_the_largest_region_is_that_of_a_fill_from_each_pixel(mask):
    mask[-1, -1] |= not mask.any()
    labels = ndimage.label(mask, np.ones((3, 3)))[0]  # numbered from the top
    rows, columns = np.nonzero(labels == np.bincount(labels.ravel())[1:].argmax() + 1)
    wanted = (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)
    assert pixel_loops.largest_region(mask, mask.sum()) == wanted
    assert pixel_loops.largest_region.py_func(mask, mask.sum()) == wanted
    assert tuple(background._largest_region(mask)) == wanted


@pytest.fixture
def in_a_browser(monkeypatch):
    """Without Numba, and what was loaded is forgotten."""
    monkeypatch.setitem(sys.modules, "numba", None)  # its import then fails
    monkeypatch.delitem(sys.modules, "trinolab.pixel_loops")
    monkeypatch.delattr("trinolab.pixel_loops")
    background._loops.cache_clear()
    yield
    background._loops.cache_clear()


def frame_and_background(kind):
    """A frame with a hand before it, and its background."""
    rng = np.random.default_rng(0)
    known = rng.normal(60, 20, (301, 333)).clip(0, 400).astype(np.float32)
    frame = np.clip(1.2 * known + rng.normal(0, 2, known.shape), 0, 255).astype(np.uint8)
    frame[100:160, 50:90] = 220
    match kind:
        case "black":
            frame[:] = 0
        case "saturated":
            frame[:] = 255
        case "strided":
            frame = np.repeat(frame, 2, axis=1)[:, ::2]
            known = np.repeat(known, 2, axis=0)[::2]
    return frame, known


KINDS = ["usual", "black", "saturated", "strided"]
COMPILED = {kind: step(*frame_and_background(kind)[::-1]) for kind in KINDS}


@pytest.mark.usefixtures("in_a_browser")
@pytest.mark.parametrize("kind", KINDS)
def test_a_step_is_the_same_in_a_browser(kind):
    frame, known = frame_and_background(kind)
    assert background._loops() is None
    new, detection = step(known, frame)
    by_loop, same = COMPILED[kind]
    np.testing.assert_array_equal(new, by_loop)
    np.testing.assert_array_equal(detection.image, same.image)
    np.testing.assert_array_equal(detection.mask, same.mask)
    assert detection.window == same.window


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_frames_of_other_types_give_the_same(kind):
    frame, known = frame_and_background("usual")
    new, detection = step(known, frame.astype(kind))
    np.testing.assert_array_equal(new, COMPILED["usual"][0])
    np.testing.assert_array_equal(detection.mask, COMPILED["usual"][1].mask)


def test_what_is_held_is_never_written_over():
    frame, known = frame_and_background("usual")
    held = [step(known, frame + np.uint8(k)) for k in range(20)]
    part = held[3][0][5:9]  # a view holds the memory as well
    copies = [array.copy() for new, seen in held for array in (new, seen.image, seen.mask)]
    wanted = part.copy()
    for k in range(20):
        step(known, frame - np.uint8(k))
    for array, copy in zip(
        [array for new, seen in held for array in (new, seen.image, seen.mask)], copies, strict=True
    ):
        np.testing.assert_array_equal(array, copy)
    del held, array
    for k in range(20):
        step(known, frame - np.uint8(k))
    np.testing.assert_array_equal(part, wanted)


def test_memory_that_is_let_go_is_used_again():
    frame, known = frame_and_background("usual")
    for _ in range(3):
        step(known, frame)
    few = [len(kept) for kept in memory._let_go.values()]
    step(known, frame)
    assert [len(kept) for kept in memory._let_go.values()] == few


def test_numba_is_not_loaded_by_an_import():
    program = "import sys, trinolab.tracker; raise SystemExit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
