"""A rig corrected by what one instant shows: offsets that are put in are found, and what is left is
as uncertain as it says.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.handle import slants
from trinolab.identity.hypotheses import Poses
from trinolab.identity.parameters import IdentityParameters
from trinolab.identity.reconcile import fit_with_offsets, reconciled
from trinolab.sensitivity import contradicting, offsets_at
from trinolab.default_covariance import FREEDOM, known_covariance

P = IdentityParameters()
CODED = load_handle("coded")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
SIGMA_PX = 0.05


def known(name):
    """A rig with principal points known to 0.3 px and directions to 0.02 deg."""
    rig = load_rig(name)
    sigma = np.zeros((len(rig.cameras), 15))
    sigma[:, 2:4] = 0.3
    sigma[:, 9:12] = np.deg2rad(0.02)
    return replace(rig, covariance=RigCovariance(rig.names, np.diag(sigma.ravel() ** 2)))


def centroids(rig, noise=0.0):
    """Pixels (cameras, markers, 2) of the markers that face a camera within 60 deg."""
    slant = np.stack([slants(CODED, POSE, camera.centre) for camera in rig.cameras])
    views = Views(*np.nonzero(slant < np.deg2rad(60)))
    uv = np.full((*slant.shape, 2), np.nan)
    uv[views] = predict_centroids(rig, CODED, POSE, views)[0]
    return uv + noise


@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
def test_offsets_that_no_motion_makes_are_found(name):
    rig = known(name)
    basis = contradicting(offsets_at(rig, POSE.translation).by_position)
    sizes = np.array([0.7, -0.4, 0.5])[: basis.shape[1]]
    shift = (basis @ sizes).reshape(-1, 1, 2)
    start = RigidTransform.from_components(
        POSE.translation + [0.5, -0.5, 1.0], Rotation.from_rotvec([0.01, 0, 0.01]) * POSE.rotation
    ).as_matrix()[None]
    poses = Poses(start[:, :3, :3], start[:, :3, 3])
    uv = (centroids(rig) + shift)[None]
    free = np.zeros((len(sizes), len(sizes)))
    found = fit_with_offsets(rig, CODED, poses, uv, basis[None], free, SIGMA_PX, P)
    # the layout's centroids are right to first order in a marker's size
    np.testing.assert_allclose(found.size[0], sizes, atol=0.01)
    np.testing.assert_allclose(found.poses.translations[0], POSE.translation, atol=0.02)


def test_an_exact_rig_stays_as_it_is():
    rig = load_rig("raised_40deg")
    noise = 0.1 * np.random.default_rng(0).standard_normal((3, len(CODED.marker_centres), 2))
    assert reconciled(rig, CODED, centroids(rig, noise), POSE, SIGMA_PX, P) == (rig, POSE)


@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
def test_an_exact_rig_is_doubted_where_it_is_contradicted(name):
    rig = load_rig(name)
    basis = contradicting(offsets_at(known(name), POSE.translation).by_position)
    shift = 2.0 * basis[:, 0]  # px, over all images
    uv = centroids(rig) + shift.reshape(-1, 1, 2)
    here, _ = reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)
    place = POSE.translation[None]
    learnt = [
        a.project(place)[0] - b.project(place)[0]
        for a, b in zip(here.cameras, rig.cameras, strict=True)
    ]
    np.testing.assert_allclose(basis.T @ np.concatenate(learnt), basis.T @ shift, atol=0.05)
    assert here.covariance.doubted
    assert not known(name).covariance.doubted
    # what does not show is taken to be of that size, by Student's factor: three ways are free
    at = offsets_at(here, POSE.translation)
    m = basis.shape[1]
    expected = np.sqrt(3 * 2.0**2 / m) * {1: 1.837, 3: 1.197}[m]
    assert np.sqrt(np.trace(at.covariance)) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("name", "shown"), [("paper_pair", 1), ("raised_40deg", 3)])
def test_a_rig_that_says_nothing_learns_how_well_it_is_known(name, shown):
    """What the offsets show is counted with what was assumed, degree of freedom by degree."""
    rig = replace(load_rig(name), covariance=None)
    usual = known_covariance(rig)
    at = offsets_at(rig, POSE.translation)
    basis = contradicting(at.by_position)
    V = at.by_parameters @ usual.matrix @ at.by_parameters.T
    sigma = np.sqrt(basis[:, 0] @ V @ basis[:, 0])
    for sigmas in (0.0, 6.0):
        shift = (sigmas * sigma * basis[:, 0]).reshape(-1, 1, 2)
        here, _ = reconciled(rig, CODED, centroids(rig) + shift, POSE, SIGMA_PX, P)
        assert here.covariance.freedom == pytest.approx(FREEDOM + shown, abs=0.05)
        surprise = (sigmas * sigma) ** 2 * np.linalg.inv(basis.T @ V @ basis)[0, 0]
        # a direction that no offset shows is scaled and not learnt
        ahead = at.by_position[:, 2]
        ahead /= np.linalg.norm(ahead)
        cross = basis.T @ V @ ahead
        hidden = ahead @ V @ ahead - cross @ np.linalg.solve(basis.T @ V @ basis, cross)
        left = at.by_parameters.T @ ahead
        expected = (FREEDOM + surprise) / (FREEDOM + shown) * hidden
        assert left @ here.covariance.matrix @ left == pytest.approx(expected, rel=0.1)


def test_one_camera_tells_nothing_of_a_rig_that_says_nothing():
    rig = replace(load_rig("paper_pair"), covariance=None)
    uv = centroids(rig)
    uv[1] = np.nan
    here, _ = reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)
    assert here.covariance.freedom == pytest.approx(FREEDOM, abs=1e-3)
    np.testing.assert_allclose(
        here.covariance.matrix, known_covariance(rig).matrix, atol=1e-3 * 0.35**2
    )


def test_one_camera_contradicts_nobody():
    rig = load_rig("paper_pair")
    uv = centroids(rig)
    uv[1] = np.nan
    uv[0] += [3.0, 3.0]
    assert reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)[0] is rig


@pytest.mark.slow
def test_what_is_left_is_as_uncertain_as_it_says():
    """Offsets of the images where the handle is, of 60 drawn rigs: normalised squares."""
    rig = known("raised_40deg")
    rng = np.random.default_rng(1)
    n = 60
    before = []
    after = []
    for _ in range(n):
        errors = np.sqrt(np.diag(rig.covariance.matrix)) * rng.standard_normal(45)
        noise = SIGMA_PX * rng.standard_normal((3, len(CODED.marker_centres), 2))
        uv = centroids(displaced(rig, errors), noise)
        here, _ = reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)
        at = offsets_at(rig, POSE.translation)
        shifts = at.by_parameters @ errors
        learnt = np.concatenate([c.project(POSE.translation[None])[0] for c in here.cameras])
        learnt -= np.concatenate([c.project(POSE.translation[None])[0] for c in rig.cameras])
        left = at.by_parameters @ here.covariance.matrix @ at.by_parameters.T
        away = shifts - learnt
        after.append(away @ np.linalg.solve(left, away))
        basis = contradicting(at.by_position)
        before.append((np.linalg.norm(basis.T @ shifts), np.linalg.norm(basis.T @ away)))
    # chi-square with 6 degrees of freedom: the mean of 60 has a standard deviation of 0.45
    assert 4.6 < np.mean(after) < 7.4
    shown, remaining = np.mean(before, axis=0)
    assert remaining < 0.1 * shown


def test_a_rig_that_shows_more_than_its_file_says_is_worse_known():
    rig = known("raised_40deg")
    at = offsets_at(rig, POSE.translation)
    basis = contradicting(at.by_position)
    sigma = np.sqrt(basis[:, 0] @ at.covariance @ basis[:, 0])
    before = np.trace(at.covariance)

    def left(sigmas):
        uv = centroids(rig) + (sigmas * sigma * basis[:, 0]).reshape(-1, 1, 2)
        here, _ = reconciled(rig, CODED, uv, POSE, SIGMA_PX, P)
        moved = at.by_parameters @ here.covariance.matrix @ at.by_parameters.T
        return np.trace(moved) / before

    assert left(0.0) < 0.6  # what shows is known now
    assert left(2.0) == pytest.approx(left(0.0), rel=0.05)
    # chi-square about 36 of three, times Student's 1.197 squared: 17
    assert 10 * left(0.0) < left(6.0) < 25 * left(0.0)
