"""The bundle adjustment, on centres drawn from known rigs and handles: against a plain least
squares over everything, its gauge, its covariance, and the views that it leaves out.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform
from verification.refined import (
    drawn,
    random_poses,
    seen_centres,
    stated,
)

from trinolab.calibration.bundle import adjust, fit_poses
from trinolab.calibration.misfits import adjust_robustly
from trinolab.calibration.prior import Length, basis, prior_of
from trinolab.camera import Rig, RigCovariance, difference, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.rigid import motion_between, shifted

PAIR, TRIO = (load_rig(name) for name in ("paper_pair", "raised_40deg"))
CODED = replace(load_handle("coded"), placement_sigma_mm=0.05)
TRUE_LENGTH = Length("cameras", 0, 1, float(np.linalg.norm(PAIR.cameras[1].centre)))


def small(rig, count=12, seed=0):
    """A rig that says how well it is known, its truth, what is seen of some instants, their poses."""
    known = stated(rig)
    truth = drawn(known, CODED, np.random.default_rng(seed))
    poses = random_poses(truth, count, np.random.default_rng(seed + 1))
    return known, truth, seen_centres(truth, poses, np.random.default_rng(seed + 2)), poses


def distance(rig, a=0, b=1):
    return float(np.linalg.norm(rig.cameras[a].centre - rig.cameras[b].centre))


def test_the_first_camera_holds_the_world_and_the_others_have_its_error_instead():
    """A rig that is off, moved as a whole until its first camera stands where the file has it, is
    off by what the prior says; with one error alone that is a matrix of rank one.
    """
    error = 1e-4 * np.random.default_rng(3).normal(size=30)
    known = replace(PAIR, covariance=RigCovariance(PAIR.names, np.outer(error, error)))
    true = displaced(PAIR, error)
    T = true.cameras[0].T_cam_world.inv() * PAIR.cameras[0].T_cam_world
    cameras = tuple(replace(c, T_cam_world=c.T_cam_world * T) for c in true.cameras)
    moved = difference(replace(true, cameras=cameras), PAIR).ravel()
    prior = prior_of(known, CODED)
    held = np.arange(9, 15)
    assert not prior.rig[held].any()
    assert not prior.rig[:, held].any()
    # to first order: the squares of the error are 1e-4 of it
    np.testing.assert_allclose(prior.rig, np.outer(moved, moved), atol=1e-3 * (error**2).max())
    B = basis(CODED, prior)[:30]
    np.testing.assert_allclose(B @ B.T, prior.rig, atol=1e-9 * prior.rig.max())
    # what the first camera does not share is known as before
    mixed = np.random.default_rng(3).normal(size=(30, 30))
    mixed[held] = 0.0
    known = replace(PAIR, covariance=RigCovariance(PAIR.names, 1e-4 * mixed @ mixed.T))
    np.testing.assert_allclose(
        prior_of(known, CODED).rig, known.covariance.matrix, rtol=1e-12, atol=1e-18
    )


@pytest.mark.slow
def test_it_agrees_with_a_plain_least_squares_over_everything():
    # Another algorithm: no Schur complement, no basis, no gauge, differences for slopes. The prior
    # of the markers' coordinates, each by itself, holds the handle's frame in the same place.
    rig, _, seen, poses = small(PAIR, 3)
    seen = seen._replace(covariance=9 * seen.covariance)  # nothing is far off: Huber's is a square
    found = adjust(rig, CODED, poses, seen, prior_of(rig, CODED, TRUE_LENGTH))
    assert found.sigma_factor == 1.0
    sigma = np.sqrt(np.diag(rig.covariance.matrix))
    free = sigma > 0
    root = np.linalg.cholesky(np.linalg.inv(seen.covariance)).transpose(0, 2, 1)

    def unpacked(x):
        delta, moved, motions = np.split(x, [free.sum(), free.sum() + 36])
        change = np.zeros(len(sigma))
        change[free] = sigma[free] * delta
        centres = CODED.marker_centres + 0.05 * moved.reshape(-1, 3)
        steps = motions.reshape(-1, 6) * np.repeat([1.0, 0.01], 3)
        now = [shifted(T, step) for T, step in zip(poses, steps, strict=True)]
        return displaced(rig, change), centres, now

    def misfit(x):
        here, centres, now = unpacked(x)
        uv = [[camera.project(T.apply(centres)) for camera in here.cameras] for T in now]
        away = seen.uv - np.array(uv)[seen.instant, seen.camera, seen.marker]
        length = (distance(here) - TRUE_LENGTH.mm) / (1e-6 * TRUE_LENGTH.mm)
        common = x[: free.sum() + 36]
        return np.concatenate([np.einsum("kij,kj->ki", root, away).ravel(), common, [length]])

    plain = least_squares(
        misfit, np.zeros(free.sum() + 36 + 6 * len(poses)), method="lm", ftol=1e-14, xtol=1e-14
    )
    reference, centres, _ = unpacked(plain.x)
    # both stop when steps are 1e-6 of what is known of the unknowns
    tolerance = 1e-3 * np.sqrt(np.diag(found.covariance))
    off = np.append(difference(found.rig, reference), found.handle.marker_centres - centres)
    assert (np.abs(off) <= tolerance + 1e-9).all()
    # its covariance, of differences: to some digits
    spread = np.linalg.inv(plain.jac.T @ plain.jac)[: free.sum(), : free.sum()]
    own = found.rig.covariance.matrix[np.ix_(free, free)]
    scale = np.sqrt(np.diag(own))
    np.testing.assert_allclose(
        spread * np.outer(sigma[free], sigma[free]) / np.outer(scale, scale),
        own / np.outer(scale, scale),
        atol=1e-3,
    )


def test_the_gauge_and_a_length_are_held():
    rig, truth, seen, poses = small(TRIO)
    found = adjust(rig, CODED, poses, seen, prior_of(rig, CODED, TRUE_LENGTH))
    first = found.rig.cameras[0].T_cam_world
    assert np.array_equal(first.as_matrix(), rig.cameras[0].T_cam_world.as_matrix())
    assert distance(found.rig) == pytest.approx(TRUE_LENGTH.mm, rel=1e-5)
    moved = found.handle.marker_centres - CODED.marker_centres
    assert np.linalg.norm(moved.mean(axis=0)) < 1e-9  # no shift and no turn of all
    arms = CODED.marker_centres - CODED.marker_centres.mean(axis=0)
    assert np.abs(np.cross(arms, moved).sum(axis=0)).max() < 1e-7
    assert np.abs(moved).max() > 0.02
    mm = float(np.linalg.norm(np.subtract(*truth.handle.marker_centres[[0, 7]])))
    found = adjust(rig, CODED, poses, seen, prior_of(rig, CODED, Length("markers", 0, 7, mm)))
    ends = found.handle.marker_centres[[0, 7]]
    assert np.linalg.norm(np.subtract(*ends)) == pytest.approx(mm, rel=1e-5)
    # an error of the markers' distance, 12 um on 14 mm, would move the cameras by 0.1 mm
    sigma = np.sqrt(np.diag(found.covariance))[24:30]
    assert distance(found.rig) == pytest.approx(distance(truth.rig), abs=5 * sigma[3:].max())


def test_what_nobody_says_is_held_by_usual_values():
    silent = Rig(PAIR.cameras)
    prior = prior_of(silent, replace(CODED, placement_sigma_mm=None))
    assert prior.placement_sigma_mm == 0.05
    assert prior.length == Length("cameras", 0, 1, pytest.approx(99.1945, abs=1e-4))
    sigma = np.sqrt(np.diag(prior.rig)).reshape(2, 15)
    assert not sigma[:, 4:9].any()  # distortions
    assert not sigma[0, 9:].any()  # the world's frame
    assert (sigma[:, :4] > 0).all()
    assert (sigma[1, 9:] > 0).all()
    assert prior_of(stated(PAIR), CODED).length is None
    # who adjusts what is said to be exact doubts it
    doubted = prior_of(PAIR, replace(CODED, placement_sigma_mm=0.0))
    np.testing.assert_array_equal(doubted.rig, prior.rig)
    assert doubted[1:] == prior[1:]


def test_a_view_that_does_not_fit_is_left_out_with_a_reason():
    rig, _, seen, poses = small(TRIO, 20)
    moved = (seen.instant == 4) & (seen.camera == 1)
    wrong = seen._replace(uv=seen.uv + np.where(moved[:, None], [0.6, 0.2], 0.0))
    prior = prior_of(rig, CODED, TRUE_LENGTH)
    found = adjust_robustly(rig, CODED, poses, wrong, prior)
    assert list(zip(*np.nonzero(found.reasons != ""), strict=True)) == [(4, 1)]
    assert "far above the others" in found.reasons[4, 1]
    without = adjust(rig, CODED, poses, seen.take(~moved), prior)
    np.testing.assert_allclose(
        found.bundle.handle.marker_centres, without.handle.marker_centres, atol=1e-9
    )


def test_an_instant_that_shows_too_little_is_left_out():
    rig, _, seen, poses = small(PAIR, 8)
    few = np.flatnonzero(seen.instant == 2)[:3]
    seen = seen.take(np.r_[few, np.flatnonzero(seen.instant != 2)])
    found = adjust_robustly(rig, CODED, poses, seen, prior_of(rig, CODED, TRUE_LENGTH))
    assert 2 not in found.instants
    assert len(found.bundle.poses) == len(poses) - 1
    assert set(found.reasons[2]) <= {"", "the cameras show too little of the instant"}


def test_centres_that_determine_no_pose_are_refused():
    rig, _, seen, poses = small(PAIR, 4)
    none = seen.take(np.zeros(len(seen.uv), bool))
    with pytest.raises(ValueError, match=r"^centres: expected instants of four or more"):
        adjust_robustly(rig, CODED, poses, none, prior_of(rig, CODED))
    behind = RigidTransform.from_components(poses.translation * [1, 1, -1], poses.rotation)
    for says, start, centres in (
        ("four or more of each instant; a pose is", poses, seen.take(seen.instant != 2)),
        ("got some that no rig explains", behind, seen),
    ):
        with pytest.raises(ValueError, match=rf"^centres: .*{says}"):
            fit_poses(rig, CODED, start, centres)


def test_one_wrong_centre_counts_for_little():
    rig, _, seen, poses = small(PAIR, 40)
    prior = prior_of(rig, CODED, TRUE_LENGTH)
    right = adjust(rig, CODED, poses, seen, prior)
    uv = seen.uv.copy()
    uv[10] += 0.5  # px, forty sigmas
    wrong = adjust(rig, CODED, poses, seen._replace(uv=uv), prior)
    off = wrong.handle.marker_centres - right.handle.marker_centres
    assert np.abs(off).max() < 3 * np.sqrt(np.diag(right.covariance)[30:].max())


def test_poses_alone():
    """Three centres in one image leave no residuals, which say nothing of the noise."""
    _, truth, seen, poses = small(PAIR)
    found = fit_poses(truth.rig, truth.handle, poses, seen)
    assert not difference(found.rig, truth.rig).any()
    away = [motion_between(a, b) for a, b in zip(found.poses, poses, strict=True)]
    assert np.linalg.norm(np.array(away)[:, :3], axis=1).max() < 0.1  # mm
    first = np.flatnonzero(seen.camera == 0)
    k = int(np.bincount(seen.instant[first]).argmax())
    three = seen.take(first[seen.instant[first] == k][:3])._replace(instant=np.zeros(3, int))
    found = fit_poses(truth.rig, CODED, poses[k : k + 1], three)
    assert np.abs(found.residuals_px).max() < 1e-3
    assert found.sigma_factor == 1
