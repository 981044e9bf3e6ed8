"""Masks of any background, judged as the package judges its own, and the criterion of the step."""

import numpy as np
import pytest

from trinolab.background import BackgroundParameters
from workbench.studies import background_rivals, ground_truth
from workbench.studies.ground_truth import Regions, Watched

EMPTY = np.full((40, 50), 45, np.uint8)
INSIDE = np.zeros(EMPTY.shape, bool)
INSIDE[10:20, 15:35] = True
TRUTH = Regions(INSIDE, ~INSIDE)


def test_masks_are_judged_as_the_package_judges_its_own():
    p = BackgroundParameters(
        shadow_share=0.0, min_pixels=50, masked_rate=None, compensate_light=False
    )
    frames = [np.where(INSIDE, 90, EMPTY).astype(np.uint8)] * 40
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
