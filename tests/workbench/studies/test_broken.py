"""The faults of the broken bench: each does what it says, held against numbers worked out by hand
or against the frames of the whole bench.
"""

from dataclasses import replace

import numpy as np
import pytest

from trinolab.bench.optics import Bench
from trinolab.bench.scene import radiance, render, scaled
from trinolab.camera import difference
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.markers import find_markers
from workbench.studies import broken
from workbench.studies.broken import FAULTS, Instant

PAIR, CODED = load_rig("paper_pair"), load_handle("coded")
TRIO = load_rig("raised_40deg")
T = load_table1().set_poses[4]
NOW = Instant(PAIR, CODED, T)


def spots(image):
    return find_markers(image, 12).uv


def moved_spots(image, camera, shifted, handle=CODED):
    """For each spot of a frame at rest how far its partner lies, and how far it should: px, (n, 2)
    each. `shifted` are the markers' centres as they are in `image`, world frame.
    """
    rest = spots(render(camera, CODED, T, Bench(), np.random.default_rng(5)))
    there = spots(image)
    before, after = camera.project(T.apply(handle.marker_centres)), camera.project(shifted)
    found, due = [], []
    for uv in rest:
        marker = np.linalg.norm(before - uv, axis=1).argmin()
        partner = there[np.linalg.norm(there - uv - (after - before)[marker], axis=1).argmin()]
        found.append(partner - uv)
        due.append((after - before)[marker])
    return np.array(found), np.array(due)


def test_a_rig_file_says_how_far_off_it_is():
    """By many draws; a turn about a camera's centre is one about the world's origin and a shift."""
    rng = np.random.default_rng(0)
    drawn = [
        difference(broken.miscalibrated(TRIO, 0.3, 0.02, rng), TRIO).ravel() for _ in range(500)
    ]
    stated = broken.covariance_of_such(TRIO, 0.3, 0.02).matrix
    sigma = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(sigma.reshape(3, 15)[:, 2:4], 0.3)
    np.testing.assert_allclose(sigma.reshape(3, 15)[:, 9:12], np.deg2rad(0.02))
    assert (sigma > 0).sum() == 2 * 8 + 5  # px, rad, mm; the first camera is the world's origin
    unit = np.outer(*[np.where(sigma > 0, sigma, 1e-9)] * 2)
    # 500 draws: of a variance 6 % are a standard deviation, of a correlation less
    np.testing.assert_allclose(np.cov(np.array(drawn).T) / unit, stated / unit, atol=0.25)


def test_a_camera_that_waits_sees_the_handle_where_it_is_then():
    motion = broken.hand_motion(np.random.default_rng(3))
    assert np.linalg.norm(motion.velocity) == pytest.approx(broken.SPEED_MM_S)
    (first, second), _ = broken.apart(NOW, np.random.default_rng(3))
    for image, camera, t in ((first, PAIR.cameras[0], -0.0025), (second, PAIR.cameras[1], 0.0025)):
        shifted = broken.later(T, motion, t).apply(CODED.marker_centres)
        found, due = moved_spots(image, camera, shifted)
        assert np.abs(due).max() > 1
        np.testing.assert_allclose(found, due, atol=0.15)


def test_a_rolling_shutter_takes_each_row_at_its_own_time():
    motion = broken.hand_motion(np.random.default_rng(3))
    camera = PAIR.cameras[0]
    image = broken.rolled(camera, CODED, T, motion)
    centres = CODED.marker_centres
    shifted = T.apply(centres)
    for _ in range(3):  # the row that takes a marker depends on where it is then
        rows = camera.project(shifted)[:, 1] - camera.principal_point[1]
        times = broken.READOUT_S * rows / 1024
        shifted = np.array(
            [broken.later(T, motion, t).apply(c) for t, c in zip(times, centres, strict=True)]
        )
    found, due = moved_spots(image, camera, shifted)
    assert np.abs(due).max() > 1
    np.testing.assert_allclose(found, due, atol=0.15)
    still = broken.rolled(
        camera, CODED, T, motion._replace(velocity=np.zeros(3), turn_rate=np.zeros(3))
    )
    np.testing.assert_allclose(still, radiance(camera, CODED, T, broken.BENCH), atol=1e-9)


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_gives_frames_of_its_own(name):
    small = replace(PAIR, cameras=tuple(scaled(camera, 0.25) for camera in PAIR.cameras))
    one = Instant(small, CODED, T)
    taken = FAULTS[name](one, np.random.default_rng(2))
    assert [frame.shape for frame in taken.frames] == [(256, 320)] * 2
    assert all(frame.dtype == np.uint8 for frame in taken.frames)
    plain = FAULTS["none"](one, np.random.default_rng(2))
    same = [np.array_equal(a, b) for a, b in zip(taken.frames, plain.frames, strict=True)]
    believed = taken.rig is one.rig
    assert (all(same) and believed) == (name == "none")
