"""A rig corrected by what one instant shows: offsets that are put in are found and taken off."""

from dataclasses import replace

import numpy as np
import pytest
from boards import motion
from scenes import centroids

from trinolab.camera import RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.identity.hypotheses import Poses
from trinolab.identity.parameters import IdentityParameters
from trinolab.identity.reconcile import fit_with_offsets, reconciled
from trinolab.rigid import shifted
from trinolab.sensitivity import contradicting, offsets_at

P = IdentityParameters()
CODED = load_handle("coded")
POSE = motion([20.0, -10.0, 560.0], [0.2, 0.3, 0.4])
SIGMA_PX = 0.05


def known(name):
    """A rig with principal points known to 0.3 px and directions to 0.02 deg."""
    rig = load_rig(name)
    sigma = np.zeros((len(rig.cameras), 15))
    sigma[:, 2:4] = 0.3
    sigma[:, 9:12] = np.deg2rad(0.02)
    return replace(rig, covariance=RigCovariance(rig.names, np.diag(sigma.ravel() ** 2)))


def seen(rig, noise=0.0):
    """Pixels (cameras, markers, 2) of the markers that face a camera within 60 deg."""
    return centroids(rig, CODED, POSE, 60) + noise


def shifts_at(rig, other):
    """By how much the images of the handle's place differ between two rigs, px, (2 C,)."""
    ways = [
        b.project(POSE.translation[None])[0] - a.project(POSE.translation[None])[0]
        for a, b in zip(rig.cameras, other.cameras, strict=True)
    ]
    return np.concatenate(ways)


@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
def test_offsets_that_no_motion_makes_are_found(name):
    rig = known(name)
    basis = contradicting(offsets_at(rig, POSE.translation).by_position)
    sizes = np.array([0.7, -0.4, 0.5])[: basis.shape[1]]
    shift = (basis @ sizes).reshape(-1, 1, 2)
    start = shifted(POSE, np.array([0.5, -0.5, 1.0, 0.01, 0, 0.01])).as_matrix()[None]
    poses = Poses(start[:, :3, :3], start[:, :3, 3])
    uv = (seen(rig) + shift)[None]
    free = np.zeros((len(sizes), len(sizes)))
    found = fit_with_offsets(rig, CODED, poses, uv, basis[None], free, SIGMA_PX, P)
    # the layout's centroids are right to first order in a marker's size
    np.testing.assert_allclose(found.size[0], sizes, atol=0.01)
    np.testing.assert_allclose(found.poses.translations[0], POSE.translation, atol=0.02)


@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
def test_an_exact_rig_is_corrected_where_it_is_contradicted(name):
    rig = load_rig(name)
    basis = contradicting(offsets_at(known(name), POSE.translation).by_position)
    shift = 2.0 * basis[:, 0]  # px, over all images
    uv = seen(rig) + shift.reshape(-1, 1, 2)
    here, _ = reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)
    np.testing.assert_allclose(basis.T @ shifts_at(rig, here), basis.T @ shift, atol=0.05)
    assert here.covariance.is_exact


def test_one_camera_contradicts_nobody():
    rig = load_rig("paper_pair")
    uv = seen(rig)
    uv[1] = np.nan
    uv[0] += [3.0, 3.0]
    assert reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)[0] is rig


@pytest.mark.parametrize("states", [True, False])
def test_a_rig_is_corrected_by_what_shows(states):
    """Of 60 rigs that are off by what the first one's file says."""
    stated = known("raised_40deg")
    rig = stated if states else replace(stated, covariance=None)
    basis = contradicting(offsets_at(rig, POSE.translation).by_position)
    rng = np.random.default_rng(1)
    shown, left = [], []
    for _ in range(60):
        true = displaced(rig, np.sqrt(np.diag(stated.covariance.matrix)) * rng.standard_normal(45))
        noise = SIGMA_PX * rng.standard_normal((3, len(CODED.marker_centres), 2))
        here, _ = reconciled(rig, CODED, seen(true, noise), POSE, SIGMA_PX, P)
        assert here.covariance is rig.covariance
        shown.append(np.linalg.norm(basis.T @ shifts_at(rig, true)))
        left.append(np.linalg.norm(basis.T @ shifts_at(here, true)))
    assert np.mean(left) < 0.1 * np.mean(shown)


def test_a_rig_is_corrected_by_as_much_as_its_covariance_lets_it_be():
    """The update of a Kalman filter by hand, of one parameter: with a prior of the offset that is as
    wide as the fit's, half of what shows.
    """
    rig = known("paper_pair")
    at = offsets_at(rig, POSE.translation)
    basis = contradicting(at.by_position)
    free = np.zeros((1, 1))
    matrix = POSE.as_matrix()[None]
    poses = Poses(matrix[:, :3, :3], matrix[:, :3, 3])
    uv = seen(rig) + (0.01 * basis[:, 0]).reshape(-1, 1, 2)
    fit = fit_with_offsets(rig, CODED, poses, uv[None], basis[None], free, SIGMA_PX, P)
    known_px2 = basis[:, 0] @ at.covariance @ basis[:, 0]
    share = np.sqrt(fit.covariance[0, 0, 0] / known_px2)
    narrow = replace(rig.covariance, matrix=share**2 * rig.covariance.matrix)
    here, _ = reconciled(replace(rig, covariance=narrow), CODED, uv, POSE, SIGMA_PX, P)
    corrected = basis.T @ shifts_at(rig, here)
    np.testing.assert_allclose(corrected, 0.5 * fit.size[0], rtol=0.01)
