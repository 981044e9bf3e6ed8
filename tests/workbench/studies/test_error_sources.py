"""Each source of error against the exact chain with the same mistake, computed in another way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.pose import rigid_fit
from trinolab.triangulation import triangulate
from workbench.studies import error_sources as sources
from workbench.studies.deviations import drawn, exact, first_order
from workbench.studies.error_sources import make_trial, response, shifted_rig

RIG, HANDLE, TRUTHS = load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses


@pytest.fixture(scope="module")
def trial():
    return make_trial(RIG, HANDLE, TRUTHS)


def fitted(uv, rig=RIG):
    """Poses from pixels (n, 2, 12, 2) by the package's triangulation and fit."""
    return RigidTransform.concatenate(
        [rigid_fit(HANDLE.marker_centres, triangulate(rig, views)) for views in uv]
    )


def test_without_a_mistake_nothing_is_off(trial):
    assert np.abs(response(trial)).max() < 1e-9
    seen = np.isfinite(trial.uv).all(axis=3).all(axis=1).sum(axis=1)
    assert seen.min() == 4
    assert seen.max() == 6


def test_pixel_noise_scatters_as_drawn_noise_does(trial):
    sigma = 0.01  # small enough for first order next to the gimbal lock
    rng = np.random.default_rng(0)
    errors = exact(
        [fitted(trial.uv + sigma * rng.standard_normal(trial.uv.shape)) for _ in range(60)], TRUTHS
    )
    model = first_order(drawn(sources.pixel_noise(trial, sigma), 4000, rng), TRUTHS)
    for found, expected in zip(errors, model, strict=True):
        # (20, 3); 60 draws: 9 % each
        ratio = np.sqrt((found**2).mean(axis=0) / (expected**2).mean(axis=0))
        assert np.abs(np.log(ratio)).max() < 0.4
        assert abs(np.log(ratio).mean()) < 0.03


def test_centroid_bias_is_what_the_changed_pixels_do(trial):
    uv = trial.uv + 0.3 * np.random.default_rng(1).standard_normal(trial.uv.shape)
    # markers that the trial does not use are found too
    extra = np.where(np.isfinite(uv), uv, 500.0)
    source = sources.centroid_bias(trial, extra)
    np.testing.assert_allclose(source.fixed, response(trial, uv), atol=1e-12)
    assert source.size == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert source.roots.shape == (20, 6, 0)


def test_a_shifted_rig_is_shifted_where_it_says():
    x = np.arange(1.0, 15.0) * 1e-3
    moved = shifted_rig(RIG, x)
    left, right = moved.cameras
    np.testing.assert_allclose(left.focal - RIG.cameras[0].focal, [1e-3, 2e-3])
    middle = left.principal_point - RIG.cameras[0].principal_point
    np.testing.assert_allclose(middle, [3e-3, 4e-3])
    np.testing.assert_allclose(right.focal - RIG.cameras[1].focal, [5e-3, 6e-3])
    np.testing.assert_allclose(left.T_cam_world.as_matrix(), np.eye(4))
    np.testing.assert_allclose(right.centre - RIG.cameras[1].centre, [9e-3, 10e-3, 11e-3])
    turn = right.T_world_cam.rotation * RIG.cameras[1].T_world_cam.rotation.inv()
    np.testing.assert_allclose(turn.as_rotvec(), [12e-3, 13e-3, 14e-3], atol=1e-12)


def test_a_turned_camera_is_turned_in_its_own_frame(trial):
    source = sources.turned_camera(trial, 0.01)
    turn = Rotation.from_rotvec([0.01, -0.02, 0.005], degrees=True)
    left, right = RIG.cameras
    turned = right.T_world_cam * RigidTransform.from_rotation(turn)
    moved = replace(right, T_cam_world=turned.inv())
    expected = response(trial, rig=Rig((left, moved)))
    np.testing.assert_allclose(source.roots @ [1.0, -2.0, 0.5], expected, rtol=0.01, atol=0.002)
    assert np.abs(expected[:, 2]).min() > 0.5  # mm: the vergence is the depth


def test_markers_beside_their_places():
    """One marker is moved along the axis, one around it; the rest of the handle stays."""
    few, truths = make_trial(RIG, HANDLE, TRUTHS[3::4]), TRUTHS[3::4]
    source, shift = sources.marker_places(few, 0.01), np.zeros((12, 3))
    z = np.zeros(24)
    z[3], z[12 + 8] = 1.0, -2.0
    shift[3] = [0, 0.01, 0]
    shift[8] = -0.02 * np.cross([0, 1, 0], HANDLE.marker_normals[8])
    uv = np.array(
        [[c.project(T.apply(HANDLE.marker_centres + shift)) for c in RIG.cameras] for T in truths]
    )
    np.testing.assert_allclose(source.roots @ z, response(few, uv + 0 * few.uv), atol=2e-4)
    assert np.abs(source.roots @ z).max() > 0.05


def test_a_handle_set_askew_and_a_turned_reference_turn_poses_and_move_none(trial):
    """On the handle's own side, and about the world's axes."""
    turn = Rotation.from_rotvec([0.1, -0.05, 0.02], degrees=True)
    for source, rotations in (
        (sources.askew(trial, 0.1), TRUTHS.rotation * turn),
        (sources.turned_reference(trial, 0.1), turn * TRUTHS.rotation),
    ):
        turned = RigidTransform.from_components(TRUTHS.translation, rotations)
        found = source.roots @ [1.0, -0.5, 0.2]
        expected = exact([turned], TRUTHS).turns_deg[0]
        np.testing.assert_allclose(found[:, 3:], expected, atol=1e-9)
        assert not found[:, :3].any()


def test_errors_of_the_set_angles(trial):
    """Constants in the angles, and independent scatter of them."""
    roots = sources.set_angles(trial, 0.5).roots
    constant = first_order(roots @ [1.0, 2.0, -1.0], TRUTHS).angles_deg
    np.testing.assert_allclose(constant, np.tile([0.5, 1.0, -0.5], (20, 1)), atol=1e-12)
    tables = drawn(sources.set_scatter(trial, 0.25), 3000, np.random.default_rng(0))
    scatter = first_order(tables, TRUTHS)
    np.testing.assert_allclose(scatter.angles_deg.std(axis=0), 0.25, rtol=0.06)
    assert not scatter.position_mm.any()


def test_a_pose_without_markers_is_refused(trial):
    uv = trial.uv.copy()
    uv[7] = np.nan
    with pytest.raises(ValueError, match="got enough for 19"):
        response(trial, uv)
