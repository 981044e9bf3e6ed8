"""What `default_covariance` says of usual calibrations: simulated ones, and photographs made by
others, calibrated from halves of them.
"""

import numpy as np
import pytest

from trinolab.calibration.adjust import calibrate
from trinolab.calibration.target import Board, find_corners
from trinolab.camera import pixels_with_slopes
from trinolab.datasets import load_rig
from trinolab.rigid import cross_matrices
from trinolab.triangulation import triangulate
from workbench.studies.real_recordings import load_opencv_stereo
from workbench.studies.simulated_calibration import simulated_calibration

# around the middle of the standard scene, mm
PLACES = np.array(
    [[x, y, z] for x in (-60, 0, 60) for y in (-40, 0, 40) for z in (530, 560, 600.0)]
)


def off_px(rig, true, places):
    """By how much the images of places are off, rms, and by how much if the world may be moved."""
    shifts, by_motion = [], []
    for camera, reference in zip(rig.cameras, true.cameras, strict=True):
        uv, _, by_places = pixels_with_slopes(reference, places)
        shifts.append(camera.project(places) - uv)
        by_motion.append(np.concatenate([by_places, -by_places @ cross_matrices(places)], axis=2))
    r = np.stack(shifts).ravel()
    J = np.stack(by_motion).reshape(-1, 6)
    left = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
    return np.sqrt((r**2).mean()), np.sqrt((left**2).mean())


def beside_mm(rigs, true):
    """By how much the second camera's place is off in the first one's frame, rms of an axis, across
    its line of sight and along it.
    """

    first, second = true.cameras[:2]
    places = [(c[0].T_cam_world * c[1].T_world_cam).translation for c in (r.cameras for r in rigs)]
    off = np.array(places) - (first.T_cam_world * second.T_world_cam).translation
    along = off @ (first.T_cam_world.rotation.as_matrix() @ second.axis)
    across = (off**2).sum(axis=1) - along**2
    return np.sqrt(across.mean() / 2), np.sqrt((along**2).mean())


@pytest.mark.heavy
@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
@pytest.mark.parametrize(("corner_px", "low", "high"), [(0.05, 0.2, 0.7), (0.3, 1.3, 4.0)])
def test_simulated_calibrations_are_off_by_half_a_pixel_to_some(name, corner_px, low, high):
    rng = np.random.default_rng(0)
    rig = load_rig(name)
    rigs = [simulated_calibration(rig, Board(), 14, rng, noise_px=corner_px).rig for _ in range(6)]
    whole, left = np.sqrt(np.mean(np.square([off_px(one, rig, PLACES) for one in rigs]), axis=0))
    assert low < whole < high
    assert left < 0.05 * whole
    across, along = beside_mm(rigs, rig)
    # mm a pixel of the images' shift: 0.05 mm in 0.25 px would be 0.2
    assert across < 0.1 * whole
    assert along < 0.4 * whole


@pytest.mark.heavy
def test_halves_of_real_photographs_disagree_by_two_pixels_of_which_little_is_no_motion():
    photographs = load_opencv_stereo()
    if photographs is None:
        pytest.skip("the recording is not on this machine")
    board = photographs.board
    sides = photographs.left, photographs.right
    corners = np.array([[find_corners(image, board, 5) for image in side] for side in sides])
    sizes = [photographs.left[0].shape[::-1]] * 2

    def calibrated(views):
        some = corners[:, views]
        return calibrate(board.points, some, sizes, ["left", "right"], distortion_terms=5).rig

    n = corners.shape[1]
    places = triangulate(calibrated(np.arange(n)), corners.reshape(2, -1, 2))[::7]
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(8):
        order = rng.permutation(n)
        rows.append(off_px(calibrated(order[: n // 2]), calibrated(order[n // 2 :]), places))
    whole, left = np.sqrt(np.mean(np.square(rows), axis=0) / 2)  # two of them differ
    assert 1.0 < whole < 3.0
    assert 0.02 < left < 0.15
