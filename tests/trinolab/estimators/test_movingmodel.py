"""The image of a moving handle against the mean of many still ones, and its derivatives against
differences.
"""

import numpy as np
import pytest
from imagemodel_reference import blur_matrices, layers, unblurred
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import random_pose
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views, shading_basis
from trinolab.estimators.imagemodel import MotionBlur, first_state
from trinolab.estimators.movingmodel import linearise_moving
from trinolab.estimators.patches import Grid, MarkerViews, cut, moving_patches
from trinolab.estimators.pixels import both_in_world, moved
from trinolab.rigid import shifted

HANDLE = load_handle("coded")
RIG = load_rig("raised_40deg")
T = random_pose(np.random.default_rng(1))
MOTION = np.array([2.4, -1.2, 0.8, 0.004, -0.003, 0.002])  # 14 px
ALL_CELLS = 10**6  # so that each is a pixel
EMPTY_IMAGES = [np.zeros(camera.size[::-1], np.uint8) for camera in RIG.cameras]


def moving(most_cells=ALL_CELLS):
    """Windows of a handle that moves, and a state with greys."""
    here = moving_patches(EMPTY_IMAGES, RIG, HANDLE, T, 55.0, MOTION, most_cells)
    blur = MotionBlur(MOTION, MOTION, np.eye(6))
    greys = np.tile([130.0, 90.0, 0.1, -0.2, 0.05, 45.0], (len(here.points), 1))
    return here, first_state(T, RIG, blur)._replace(greys=greys)


def slopes(state, here):
    """Copies of a model's derivatives, whose memory the next model takes, and which cells count."""
    told = linearise_moving(state, here, RIG, HANDLE)
    return told.by_pose, told.weight > 0


def test_a_moving_handle_looks_like_the_mean_of_many_still_ones():
    here, state = moving()
    told = linearise_moving(state, here, RIG, HANDLE)
    usable = told.weight > 0
    B = blur_matrices(max(here.drawn.shape), state.blur_px2)[here.views.camera]
    exposures = []
    for time in (np.arange(60) + 0.5) / 60 - 0.5:
        shown = layers(RIG, HANDLE, shifted(T, time * MOTION), here.views, here.at, any_marker=True)
        basis = shading_basis(shown.turn).transpose(1, 0, 2)
        exposures.append(unblurred(shown, basis, state.greys))
    sharp = np.mean(exposures, axis=0).reshape(-1, *here.at.shape)
    rows, columns = here.at.shape
    expected = B[:, :rows, :rows] @ sharp @ B[:, :columns, :columns].mT
    lens_px = 5  # beyond which the mean, which is of the window alone, lacks nothing
    inner = np.zeros(here.at.shape, bool)
    inner[lens_px:-lens_px, lens_px:-lens_px] = True
    usable &= inner.ravel()
    assert usable.mean() > 0.3
    error = (told.predicted - expected.reshape(told.predicted.shape))[usable]
    # of a contrast of 130: what turns, and comes nearer, is not smeared all along one way
    assert np.sqrt(np.mean(error**2)) < 1.0
    assert np.abs(error).max() < 10.0


@pytest.mark.parametrize("most_cells", [ALL_CELLS, 5_000])
def test_the_derivatives_are_those_of_the_model(most_cells):
    here, state = moving(most_cells)
    assert (here.at.pixels > 1) == (most_cells < ALL_CELLS)
    by_pose_told, usable = slopes(state, here)
    turn = both_in_world(T)

    def predicted(pose: RigidTransform, motion: np.ndarray) -> np.ndarray:
        blur = state.motion_blur._replace(motion=motion)
        changed = state._replace(T_world_handle=pose, motion_blur=blur)
        return linearise_moving(changed, here, RIG, HANDLE).predicted.copy()

    step = 1e-3
    for k, d in enumerate(step * np.eye(6)):
        by_motion = (predicted(T, MOTION + turn @ d) - predicted(T, MOTION - turn @ d)) / (2 * step)
        size = np.linalg.norm(by_motion[usable])
        # in coarse cells 0.017: of the highest frequency they do not show which way it goes
        assert np.linalg.norm((by_pose_told[:, 6 + k] - by_motion)[usable]) < 0.03 * size
    # where there is no shading: as the handle moves, it would stay where the light has it
    greys = state.greys.copy()
    greys[:, 2:5] = 0
    state = state._replace(greys=greys)
    by_pose_told, usable = slopes(state, here)
    for k, d in enumerate(np.diag([step] * 3 + [step / 10] * 3)):
        by_pose = predicted(moved(T, d), MOTION) - predicted(moved(T, -d), MOTION)
        by_pose /= 2 * d[k]
        size = np.linalg.norm(by_pose[usable])
        # an edge is taken as straight within a cell
        assert np.linalg.norm((by_pose_told[:, k] - by_pose)[usable]) < 0.1 * size


@pytest.mark.parametrize("way_mm", [0.5, 40.0])
def test_the_work_is_bounded_however_long_the_way(way_mm):
    here = moving_patches(EMPTY_IMAGES, RIG, HANDLE, T, 72.0, way_mm * MOTION, 18_000)
    assert len(here.points) * np.prod(here.drawn.shape) < 1.35 * 18_000  # rounded to quick sizes


@pytest.mark.parametrize("cell", [(1, 1), (2, 3)])
def test_a_cell_is_the_mean_of_its_pixels_and_valid_if_none_is_saturated(cell):
    """By loops over the pixels."""
    width, height = cell
    rows, columns = 4, 5
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, camera.size[::-1], dtype=np.uint8) for camera in RIG.cameras]
    views, points = Views(np.array([0]), np.array([3])), HANDLE.marker_centres[[3]]
    seen = MarkerViews(np.full((3, 12, 2), [400.0, 300.0]), np.zeros((3, 12)), np.ones((3, 12)))
    here = cut(images, RIG, seen, views, points, Grid((rows, columns), cell))
    left, top = here.at.corner[0]
    for v in range(rows):
        for u in range(columns):
            block = images[0][top + v * height :, left + u * width :][:height, :width].tolist()
            greys = [grey for row in block for grey in row]
            assert here.grey[0, v * columns + u] == pytest.approx(sum(greys) / len(greys))
            assert here.valid[0, v * columns + u] == (max(greys) < 250)
