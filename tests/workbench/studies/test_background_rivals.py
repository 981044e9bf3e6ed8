"""The rivals of the background: when a pixel that jumps goes into each, by formula."""

import math

import numpy as np
import pytest

from trinolab.background import BackgroundParameters
from workbench.studies import background_rivals, ground_truth
from workbench.studies.ground_truth import Regions, Watched

EMPTY = np.full((40, 50), 45, np.uint8)
INSIDE = np.zeros(EMPTY.shape, bool)
INSIDE[10:20, 15:35] = True
TRUTH = Regions(INSIDE, ~INSIDE)


def at_rest(grey, n):
    """A rod that lies in the view in each of n frames."""
    frame = EMPTY.copy()
    frame[INSIDE] = grey
    return [frame] * n


@pytest.mark.parametrize(("step_grey", "T"), [(0.5, 15.0), (2.0, 10.0)])
def test_a_running_median_takes_equal_steps(step_grey, T):
    seen = [
        mask[INSIDE].all()
        for mask in background_rivals.running_median(at_rest(90, 100), EMPTY, T, step_grey)
    ]
    frames = math.ceil((45 - T) / step_grey)
    assert seen == [k < frames for k in range(100)]


def test_a_running_median_rests_at_the_median():
    """Of 80 % dark and 20 % bright frames it stays dark; the mean would be 54."""
    rng = np.random.default_rng(0)
    frames = [at_rest(90 if rng.random() < 0.2 else 45, 1)[0] for _ in range(400)]
    *_, last = background_rivals.running_median([*frames, at_rest(54, 1)[0]], EMPTY, 6.0)
    assert last[INSIDE].all()


@pytest.mark.parametrize("alpha", [0.005, 0.01, 0.05])
def test_mog2_learns_what_has_a_tenth_of_the_weight(alpha):
    """A new Gaussian belongs to the background when those before it have less than 0.9."""
    masks = background_rivals.mog2(at_rest(90, 60), EMPTY, alpha)
    seen = np.array([mask[INSIDE].all() for mask in masks])
    assert seen[0]
    frames = math.log(0.9) / math.log(1 - alpha)
    assert abs(seen.sum() - frames) <= 2
    assert not seen[seen.sum() :].any()


def test_a_wide_gaussian_takes_a_small_change():
    """A new Gaussian's variance is 15: a jump of 12 is 9.6 variances."""
    (narrow,) = background_rivals.mog2(at_rest(57, 1), EMPTY, 0.01, 4.0)
    (wide,) = background_rivals.mog2(at_rest(57, 1), EMPTY, 0.01, 16.0)
    assert narrow[INSIDE].all()
    assert not wide[INSIDE].any()


def test_masks_are_judged_as_the_package_judges_its_own():
    p = BackgroundParameters(
        shadow_share=0.0, min_pixels=50, masked_rate=None, compensate_light=False
    )
    frames = at_rest(90, 40)
    ours = ground_truth.watch(frames, EMPTY, [TRUTH] * 40, p)
    B, masks = EMPTY.astype(float), []
    for frame in frames:
        masks.append(np.abs(frame - B) > p.difference_threshold)
        B = p.update_rate * frame + (1 - p.update_rate) * B
    same = background_rivals.judged(masks, [TRUTH] * 40, p.min_pixels)
    assert np.array_equal(same.false, ours.false)
    assert np.array_equal(same.missed, ours.missed)
    assert same.windows == ours.windows
    assert same.windows[0] is not None
    few = background_rivals.judged(masks, [TRUTH] * 40, 1000)
    assert few.windows == [None] * 40


@pytest.fixture(scope="module")
def recording():
    """An instant of `hard` with a handle, sixty times."""
    one = ground_truth.read_recording("hard", [50], every=16)
    return one._replace(instants=one.instants * 60)


@pytest.mark.parametrize(
    ("false", "missed", "expected"),
    [
        (0.0009, 0.009, (True, True)),
        (0.0011, 0.011, (False, False)),
        (0.0011, 0.0, (False, True)),
        (0.0, 0.011, (True, False)),
    ],
)
def test_a_step_is_survived_up_to_the_limits(recording, false, missed, expected):
    shares = np.zeros((2, 60))
    shares[:, 50] = false, missed
    whole = ground_truth.Window(0, 0, *recording.rig.cameras[2].size)
    watched = Watched(*shares, [whole] * 60, np.empty(0))
    assert background_rivals.survives_the_step(watched, recording, 2) == (*expected, True)
    # what was as bad in the second before the step may be as bad behind it
    shares[:, 20] = false, missed
    watched = Watched(*shares, [whole] * 60, np.empty(0))
    assert background_rivals.survives_the_step(watched, recording, 2) == (True, True, True)
    lost = Watched(*shares, [None] * 60, np.empty(0))
    assert background_rivals.survives_the_step(lost, recording, 2) == (True, True, False)
