"""The truth of what moves, against images without noise and against distances; its shares by hand."""

import numpy as np
import pytest

from trinolab import scene
from trinolab.background import BackgroundParameters, Detection, step
from trinolab.camera import Rig
from trinolab.covertruth import Regions, cover, regions, watch, wrong
from trinolab.datasets import load_handle, load_rig
from trinolab.filming import take
from trinolab.rendering import scripted

RIG = Rig(tuple(scene.scaled(camera, 0.125) for camera in load_rig("raised_40deg").cameras))
JOB = scripted("calm", RIG, load_handle("coded"), 0, 1.5)


@pytest.mark.parametrize("index", [0, 2])
def test_cover_is_where_the_image_differs_from_the_empty_bench(index):
    shot, camera = JOB.shots[40], RIG.cameras[index]
    image = scene.radiance(camera, JOB.handle, shot.T_world_handle, JOB.bench, shot.arm)
    share = cover(JOB, 40, index)
    assert share.shape == image.shape
    assert 0.01 < (share == 1).mean() < 0.2
    np.testing.assert_array_equal(share > 0, image != scene.background(camera, JOB.bench))


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
    truth = Regions(np.array([[True, True, False, False, False]]), np.array([[False, False, False, True, False]]))
    assert wrong(Detection(found, found, None), truth) == (1.0, 0.5)
    nothing = Regions(*np.zeros((2, 1, 5), bool))
    assert np.isnan(wrong(Detection(found, found, None), nothing)).all()


def test_watching_is_step_after_step():
    frames = [take(JOB, k, 1) for k in (0, 36, 40)]
    truths, parameters = [regions(cover(JOB, k, 1)) for k in (0, 36, 40)], BackgroundParameters(min_pixels=8)
    watched, state = watch(frames, frames[0], truths, parameters), frames[0]
    for k, frame in enumerate(frames):
        state, detection = step(state, frame, parameters)
        assert watched.windows[k] == detection.window
        np.testing.assert_array_equal([watched.false[k], watched.missed[k]], wrong(detection, truths[k]))
    np.testing.assert_array_equal(watched.background, state)
    assert watched.windows[0] is None
    assert watched.windows[1] is not None
    with pytest.raises(ValueError, match="shorter"):
        watch(frames, frames[0], truths[:2])
