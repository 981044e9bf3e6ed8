"""Where cameras see a target, against the cameras themselves and finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

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
    return np.stack(
        [
            RigidTransform.from_components(p[:3], Rotation.from_rotvec(p[3:])).as_matrix()
            for p in poses
        ]
    )


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


def test_nothing_is_seen_behind_a_camera():
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
    J = np.stack(
        [
            (moved(h * e) - moved(-h * e)) / (2 * h)
            for h, e in zip(sizes, np.eye(q + 12), strict=True)
        ],
        axis=-1,
    )
    valid = np.isfinite(uv)
    N, n = J[valid].T @ J[valid], J[valid].T @ (uv - uv_of(at))[valid]
    scale = np.sqrt(np.diag(N))
    normal = normal_equations(images(at, BOARD.points), uv)
    for found, expected, units in (
        (normal.A, N[:q, :q], np.outer(scale[:q], scale[:q])),
        (normal.a, n[:q], scale[:q]),
        (normal.E.reshape(12, q), N[q:, :q], np.outer(scale[q:], scale[:q])),
        (normal.b.ravel(), n[q:], scale[q:]),
        (normal.D[0], N[q : q + 6, q : q + 6], np.outer(scale[q : q + 6], scale[q : q + 6])),
        (normal.D[1], N[q + 6 :, q + 6 :], np.outer(scale[q + 6 :], scale[q + 6 :])),
    ):
        # the differences' second order; worst seen 2e-7
        np.testing.assert_allclose(found / units, expected / units, rtol=0, atol=1e-6)
    assert not N[q : q + 6, q + 6 :].any()


def test_a_step_turns_about_the_pose_s_own_place():
    before = state(0)
    common = np.zeros(before.common)
    common[12:18] = [1, 2, 3, 0, 0, np.pi / 2]
    views = np.zeros((2, 6))
    views[1] = [0, 0, 5, 0, np.pi / 2, 0]
    after = stepped(before, common, views)
    np.testing.assert_array_equal(after.T_world_cam[0], np.eye(4))
    np.testing.assert_array_equal(after.T_world_cam[1, :3, 3], [91, 7, 13])
    turned = Rotation.from_euler("z", 90, degrees=True).as_matrix() @ before.T_world_cam[1, :3, :3]
    np.testing.assert_allclose(after.T_world_cam[1, :3, :3], turned, atol=1e-15)
    np.testing.assert_array_equal(after.T_world_target[1, :3, 3], [10, 0, 455])
    held = stepped_views(before, views)
    np.testing.assert_array_equal(held.T_world_target, after.T_world_target)
    np.testing.assert_array_equal(held.T_world_cam, before.T_world_cam)
