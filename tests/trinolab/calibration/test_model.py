"""Where cameras see a target, against the cameras themselves and finite differences."""

import numpy as np
import pytest
from boards import motion
from scipy.spatial.transform import RigidTransform

from trinolab.calibration.model import State, images, normal_equations, stepped, stepped_views
from trinolab.calibration.target import Board
from trinolab.camera import Camera

BOARD = Board(4, 3, 20.0)
LENSES = np.array(
    [
        [700.0, 690, 330, 228, -0.25, 0.08, 1e-3, -8e-4, 0.02],
        [715.0, 708, 310, 250, -0.2, 0.05, -5e-4, 6e-4, 0.0],
        [650.0, 655, 322, 241, 0.1, -0.1, 1e-3, 1e-3, 0.01],
    ]
)
CAMERAS = ([0, 0, 0, 0, 0, 0], [90, 5, 10, 0.02, -0.2, 0.01], [-60, -120, 40, 0.3, 0.1, -0.05])
VIEWS = ([-30, -20, 400, 0.3, -0.2, 0.1], [10, 0, 450, -0.2, 0.4, -0.3])


def matrices(poses):
    return np.stack([motion(p[:3], p[3:]).as_matrix() for p in poses])


def state(terms=5):
    return State(LENSES[:, : 4 + terms], matrices(CAMERAS), matrices(VIEWS))


def uv_of(state):
    return images(state, BOARD.points).uv


def test_cameras_see_what_the_model_says():
    for lens, T, seen in zip(LENSES, matrices(CAMERAS), uv_of(state()), strict=True):
        K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
        camera = Camera("c", (640, 480), K, lens[4:], RigidTransform.from_matrix(T).inv())
        for pose, uv in zip(matrices(VIEWS), seen, strict=True):
            points = RigidTransform.from_matrix(pose).apply(np.array(BOARD.points))
            np.testing.assert_allclose(uv, camera.project(points), rtol=0, atol=1e-9)
    # and nothing that is behind them
    behind = state()
    behind.T_world_target[0, 2, 3] = -400.0
    uv = uv_of(behind)
    assert np.isnan(uv[:2, 0]).all()
    assert np.isfinite(uv[:, 1]).all()


@pytest.mark.parametrize("terms", [0, 2, 5])
def test_the_normal_equations_are_those_of_finite_differences(terms):
    at = state(terms)
    rng = np.random.default_rng(0)
    uv = uv_of(at) + rng.normal(0, 1, (3, 2, 12, 2))
    uv[1, 0, 5:] = np.nan
    uv[2, 1] = np.nan
    q = at.common
    assert q == 3 * (4 + terms) + 12

    def moved(x):
        return uv_of(stepped(at, x[:q], x[q:].reshape(2, 6)))

    # a step of about 0.01 px in each of the unknowns
    sizes = np.concatenate(
        [np.tile([0.01] * 4 + [1e-4] * terms, 3), np.tile([0.01] * 3 + [1e-5] * 3, 4)]
    )
    steps = np.diag(sizes)
    J = np.stack([moved(h) - moved(-h) for h in steps], axis=-1) / (2 * sizes)
    valid = np.isfinite(uv)
    N, n = J[valid].T @ J[valid], J[valid].T @ (uv - uv_of(at))[valid]
    scale = np.sqrt(np.diag(N))
    normal = normal_equations(images(at, BOARD.points), uv)
    first, second = slice(q, q + 6), slice(q + 6, None)
    for found, rows, columns in (
        (normal.A, slice(q), slice(q)),
        (normal.E.reshape(12, q), slice(q, None), slice(q)),
        (normal.D[0], first, first),
        (normal.D[1], second, second),
    ):
        units = np.outer(scale[rows], scale[columns])
        # the differences' second order; worst seen 2e-7
        np.testing.assert_allclose(found / units, N[rows, columns] / units, rtol=0, atol=1e-6)
    gradient = np.append(normal.a, normal.b.ravel())
    np.testing.assert_allclose(gradient / scale, n / scale, rtol=0, atol=1e-6)
    assert not N[first, second].any()
    views = np.random.default_rng(1).normal(size=(2, 6))
    held, both = stepped_views(at, views), stepped(at, np.zeros(q), views)
    np.testing.assert_array_equal(held.T_world_target, both.T_world_target)
    np.testing.assert_array_equal(held.T_world_cam, at.T_world_cam)
