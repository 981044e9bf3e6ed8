"""Standard recordings with their truth, and spots held against it; small rigs, and a cache of their
own.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trinolab.background import Detection
from trinolab.bench import optics, rendering, scene
from trinolab.bench.rendering import scripted, standard_recording
from trinolab.bench.scene import scaled
from trinolab.datasets import load_handle, load_rig
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.window import Window
from workbench.studies.ground_truth import (
    Regions,
    cover,
    held,
    judge_search,
    judge_spots,
    moving_windows,
    read_recording,
    regions,
    wrong,
)


def shrunk(name, share):
    """A shipped rig with smaller images."""
    rig = load_rig(name)
    return replace(rig, cameras=tuple(scaled(camera, share) for camera in rig.cameras))


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    root = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "cache_folder", lambda: root)
        patch.setattr(rendering, "load_rig", lambda name: shrunk(name, 0.25))
        yield root


@pytest.fixture(scope="module")
def hard():
    return read_recording("hard", seconds=0.2)


def exactly(recording, instant, c):
    """Where the markers' centres are that camera c truly sees."""
    points = instant.T_world_handle.apply(recording.handle.marker_centres[instant.seen[c]])
    return recording.rig.cameras[c].project(points)


def test_the_truth_is_that_of_the_folder(hard):
    folder = standard_recording("hard", seconds=0.2)
    counts = pd.read_csv(folder / "truth_markers.csv")[list(hard.rig.names)].to_numpy()
    assert [now.seen.sum(axis=1).tolist() for now in hard.instants] == counts.tolist()
    assert counts.max() >= 4
    poses = poses_by_frame(read_poses(folder / "truth.csv"))
    for now in hard.instants:
        # nine digits
        assert np.allclose(now.T_world_handle.as_matrix(), poses[now.frame].as_matrix(), atol=1e-6)
        assert now.t_s == pytest.approx(now.frame / 30)
        assert [image.shape for image in now.images] == [(256, 320)] * 3
    assert np.array_equal(hard.times_s, [now.t_s for now in hard.instants])
    assert hard.poses[3] is hard.instants[3].T_world_handle


def test_every_few_rows_and_columns_are_cameras_of_as_many_pixels(hard):
    thin = read_recording("hard", [4], seconds=0.2, every=4)
    whole = hard.instants[4]
    for small, image in zip(thin.instants[0].images, whole.images, strict=True):
        np.testing.assert_array_equal(small, image[::4, ::4])
    np.testing.assert_array_equal(thin.empty[1], hard.empty[1][::4, ::4])
    assert {camera.size for camera in thin.rig.cameras} == {(80, 64)}
    # the image's corner stays where it is, half a pixel outside the first centre
    centre = whole.T_world_handle.translation[None]
    small, large = (one.rig.cameras[2].project(centre) for one in (thin, hard))
    assert small == pytest.approx((large + 0.5) / 4 - 0.5)


def test_nobody_is_seen_on_the_empty_bench():
    calm = read_recording("calm", seconds=0.1)
    assert all(now.T_world_handle is None and not now.seen.any() for now in calm.instants)
    judged = judge_search(calm, lambda image: np.array([[3.0, 4.0]]))
    assert len(judged.errors_px) == 0
    assert judged.false == 3 * 3
    assert moving_windows(calm) == [[None] * 3] * 3


def test_a_window_holds_the_markers_that_are_seen(hard):
    calm = read_recording("calm", seconds=0.1)
    assert held([None] * 3, calm, 0).tolist() == [True] * 3  # there are none
    tight = Window.around(exactly(hard, hard.instants[0], 0))
    for window, holds in ((tight.grown(1.0), True), (Window(0, 0, 2, 2), False), (None, False)):
        assert held([window] * len(hard.instants), hard, 0)[0] == holds


def test_spots_by_hand(hard):
    now, camera = hard.instants[0], hard.rig.cameras[0]
    there = exactly(hard, now, 0)
    spots = np.vstack([there[1:] + [0.3, 0.4], [[5.0, 5.0], [np.nan, 1.0]]])
    judged = judge_spots(camera, hard.handle, now, now.seen[0], spots)
    assert judged.false == 1
    assert np.isnan(judged.errors_px[0])
    assert judged.errors_px[1:] == pytest.approx(np.full(len(there) - 1, 0.5))
    assert (judged.slants_deg <= 62).all()


def test_a_search_in_windows_is_in_the_image_s_pixels(hard):
    windows = moving_windows(hard)
    order = iter([(k, c) for k in range(len(hard.instants)) for c in range(3)])

    def find(cut):
        k, c = next(order)
        assert cut.shape == (windows[k][c].height, windows[k][c].width)
        return exactly(hard, hard.instants[k], c) - [windows[k][c].u, windows[k][c].v]

    judged = judge_search(hard, find, windows)
    assert judged.false == 0
    assert judged.errors_px == pytest.approx(
        np.zeros(sum(now.seen.sum() for now in hard.instants)), abs=1e-9
    )


# --- what moves


EIGHTH = shrunk("raised_40deg", 0.125)
JOB = scripted("calm", EIGHTH, load_handle("coded"), 0, 1.5)


@pytest.mark.parametrize("index", [0, 2])
def test_cover_is_where_the_image_differs_from_the_empty_bench(index):
    shot, camera = JOB.shots[40], EIGHTH.cameras[index]
    image = scene.radiance(camera, JOB.handle, shot.T_world_handle, JOB.bench, shot.arm)
    share = cover(JOB, 40, index)
    assert share.shape == image.shape
    assert 0.01 < (share == 1).mean() < 0.2
    np.testing.assert_array_equal(share > 0, image != optics.background(camera, JOB.bench))
    assert not cover(JOB, 0, index).any()  # nobody is there


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
