"""The truth of what moves, against images without noise and against distances; its shares by
hand.
"""

from dataclasses import replace

import numpy as np
import pytest

from trinolab.background import BackgroundParameters, Detection, step
from trinolab.bench import optics, rendering, scene
from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import take
from trinolab.datasets import load_handle, load_rig
from trinolab.window import Window
from workbench.studies.ground_truth import (
    Regions,
    cover,
    held,
    moving,
    read_recording,
    regions,
    watch,
    wrong,
)

RIG = replace(
    load_rig("raised_40deg"),
    cameras=tuple(scene.scaled(camera, 0.125) for camera in load_rig("raised_40deg").cameras),
)
JOB = scripted("calm", RIG, load_handle("coded"), 0, 1.5)


@pytest.mark.parametrize("index", [0, 2])
def test_cover_is_where_the_image_differs_from_the_empty_bench(index):
    shot, camera = JOB.shots[40], RIG.cameras[index]
    image = scene.radiance(camera, JOB.handle, shot.T_world_handle, JOB.bench, shot.arm)
    share = cover(JOB, 40, index)
    assert share.shape == image.shape
    assert 0.01 < (share == 1).mean() < 0.2
    np.testing.assert_array_equal(share > 0, image != optics.background(camera, JOB.bench))


def test_nothing_covers_the_empty_bench():
    assert not cover(JOB, 0, 0).any()
    inside, outside = regions(cover(JOB, 0, 0))
    assert not inside.any()
    assert outside.all()


def test_the_seam_is_left_out():
    share = np.zeros((20, 30))
    share[5:15, 8:20], share[5:15, 8] = 1.0, 0.5
    inside, outside = regions(share, 2)
    v, u = np.mgrid[:20, :30]
    np.testing.assert_array_equal(inside, (v >= 7) & (v <= 12) & (u >= 11) & (u <= 17))
    np.testing.assert_array_equal(outside, (v < 3) | (v > 16) | (u < 6) | (u > 21))


def test_shares_by_hand():
    found = np.array([[True, False, False, True, True]])
    truth = Regions(
        np.array([[True, True, False, False, False]]),
        np.array([[False, False, False, True, False]]),
    )
    assert wrong(Detection(found, found, None), truth) == (1.0, 0.5)
    nothing = Regions(*np.zeros((2, 1, 5), bool))
    assert np.isnan(wrong(Detection(found, found, None), nothing)).all()


def test_watching_is_step_after_step():
    frames = [take(JOB, k, 1) for k in (0, 36, 40)]
    truths, parameters = (
        [regions(cover(JOB, k, 1)) for k in (0, 36, 40)],
        BackgroundParameters(min_pixels=8),
    )
    watched, state = watch(frames, frames[0], truths, parameters), frames[0]
    for k, frame in enumerate(frames):
        state, detection = step(state, frame, parameters)
        assert watched.windows[k] == detection.window
        np.testing.assert_array_equal(
            [watched.false[k], watched.missed[k]], wrong(detection, truths[k])
        )
    np.testing.assert_array_equal(watched.background, state)
    assert watched.windows[0] is None
    assert watched.windows[1] is not None
    with pytest.raises(ValueError, match="shorter"):
        watch(frames, frames[0], truths[:2])


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The calm script's instants from 1.2 s on, in a cache of their own."""

    def late(rig, times, seed):
        return calm(rig, times + 1.2, seed)

    calm = rendering.SCRIPTS["calm"]
    root = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "cache_folder", lambda: root)
        patch.setitem(rendering.SCRIPTS, "calm", late)
        return read_recording("calm", every=4, seconds=0.07)


def test_what_covers_a_pixel_is_what_it_shows(short):
    """The seam is out, so that the hand is bright and the bench is not."""
    truths = moving(short, 1, seam_px=2)
    assert short.empty[1].shape == truths[0].inside.shape == (256, 320)
    watched = watch(short.images_of(1), short.empty[1], truths, BackgroundParameters(min_pixels=30))
    assert watched.false.max() < 1e-4
    assert watched.missed.max() < 0.02


def test_the_truth_is_that_of_the_instants_that_were_read(short):
    last = short._replace(instants=short.instants[-1:])
    (alone,) = moving(last, 1, seam_px=2)
    np.testing.assert_array_equal(alone.inside, moving(short, 1, seam_px=2)[-1].inside)


def test_window_holds_the_seen_markers_or_does_not(short):
    everything, corner = Window(0, 0, 320, 256), Window(0, 0, 3, 3)
    np.testing.assert_array_equal(held([everything, everything], short, 1), [True, True])
    np.testing.assert_array_equal(held([corner, None], short, 1), [False, False])
