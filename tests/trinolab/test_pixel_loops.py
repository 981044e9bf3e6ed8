"""The loop over the pixels against the form in NumPy, bit for bit: as Python runs it, and compiled."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from trinolab import background, pixel_loops
from trinolab.background import BackgroundParameters, step

needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="Numba is not installed")


@pytest.fixture(scope="module")
def loops():
    """The loops as Numba compiles them; not loaded before a test needs them."""
    compiled = pixel_loops.compiled()
    if compiled is None:
        pytest.skip("Numba has no folder to keep what it compiles, or is told not to compile")
    return compiled


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


def assert_same(loop, frame, known, gain, p):
    by_numpy = background._by_strips(frame, known, gain, p)
    for one, other in zip(written_by(loop, frame, known, gain, p), by_numpy, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@given(instants())
def test_the_loop_in_python_is_the_form_in_numpy(instant):
    assert_same(pixel_loops.compare_and_renew, *instant)


@needs_numba
@settings(max_examples=300)
@given(instants())
def test_the_compiled_loop_is_the_form_in_numpy(loops, instant):
    assert_same(loops.compare_and_renew, *instant)


def assert_regions(loop, mask):
    """The regions of a mask by a loop over its runs, against a fill from each pixel."""
    runs = background._runs(mask)
    region = np.empty(len(runs.row), np.int32)
    loop(*runs, region)
    labels = ndimage.label(mask, np.ones((3, 3)))[0][runs.row, runs.begin]
    first = [np.flatnonzero(labels == label)[0] for label in labels]
    np.testing.assert_array_equal(region, first)


MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 15)))


@given(MASKS)
def test_regions_of_runs_in_python(mask):
    assert_regions(pixel_loops.regions_of_runs, mask)


@needs_numba
@settings(max_examples=300)
@given(MASKS)
def test_regions_of_runs_compiled(loops, mask):
    assert_regions(loops.regions_of_runs, mask)


@needs_numba
@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("share", [0.01, 0.15, 0.5])
def test_the_window_of_speckle_is_the_same_with_and_without_numba(share, monkeypatch):
    mask = np.random.default_rng(0).random((400, 500)) < share
    window = background.moving_window(mask)
    monkeypatch.setattr(pixel_loops, "compiled", lambda: None)
    assert background.moving_window(mask) == window


def large(kind):
    """A frame of more than the pixels from which the loop is compiled, and its background."""
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


@needs_numba
@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("kind", ["usual", "black", "saturated", "strided"])
def test_a_step_is_the_same_with_and_without_numba(kind, monkeypatch):
    frame, known = large(kind)
    assert background._suits_loop(frame, known)
    new, detection = step(known, frame)
    monkeypatch.setattr(pixel_loops, "compiled", lambda: None)
    assert not background._suits_loop(frame, known)
    by_numpy, same = step(known, frame)
    np.testing.assert_array_equal(new, by_numpy)
    np.testing.assert_array_equal(detection.image, same.image)
    np.testing.assert_array_equal(detection.mask, same.mask)
    assert detection.window == same.window


def test_other_types_and_small_images_take_the_form_in_numpy():
    frame, known = large("usual")
    assert not background._suits_loop(frame.astype(np.uint16), known)
    assert not background._suits_loop(frame, known.astype(float))
    assert not background._suits_loop(frame[:20, :20], known[:20, :20])


@pytest.fixture
def forgotten():
    """What is compiled, asked for anew."""
    pixel_loops.compiled.cache_clear()
    yield
    pixel_loops.compiled.cache_clear()


@pytest.mark.usefixtures("forgotten")
def test_without_numba_there_is_no_compiled_loop(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)  # its import then fails
    assert pixel_loops.compiled() is None
    frame, known = large("usual")
    assert step(known, frame)[1].window is not None


@needs_numba
@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("why", ["no folder for the cache", "nothing is to be compiled"])
def test_where_numba_cannot_compile_for_good_numpy_does_it(why, monkeypatch):
    import numba

    def refuse(*_, **__):
        raise RuntimeError("cannot cache function: no locator available")

    if why == "no folder for the cache":
        monkeypatch.setattr(numba, "njit", refuse)
    else:
        monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    assert pixel_loops.compiled() is None


def test_numba_is_not_loaded_by_an_import():
    program = "import sys, trinolab.tracker; raise SystemExit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
