"""Contradictions between what was seen: none in noise, and those of markers and of images are told
apart.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.estimators.reprojection import fit_pixels, response_of_pixels
from trinolab.handle import slants
from trinolab.rigid import motion_between
from trinolab.uncertainty import contradiction, size
from trinolab.uncertainty.contradiction import honest
from trinolab.uncertainty.size import Residuals, likely_size
from trinolab.sensitivity import (
    NOTHING,
    Response,
    contradict,
    motion_slopes,
    students_factor,
)

PAIR, THREE = load_rig("paper_pair"), load_rig("raised_40deg")
CODED = load_handle("coded")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
SIGMA_PX = 0.03


def facing(rig):
    """The views of the markers that face a camera within 60 deg."""
    return Views(*np.nonzero([slants(CODED, POSE, c.centre) < np.deg2rad(60) for c in rig.cameras]))


def found(rig, handle, noise, offsets=0.0, sigma_px=SIGMA_PX):
    """The fit to centroids with noise (k, 2), px, and an offset of each image (C, 2), px."""
    views = facing(rig)
    offsets = np.broadcast_to(offsets, (len(rig.cameras), 2))
    uv = predict_centroids(rig, handle, POSE, views)[0] + noise + offsets[views.camera]
    spread = np.tile(sigma_px**2 * np.eye(2), (len(uv), 1, 1))
    T, covariance = fit_pixels(uv, spread, rig, handle, views, POSE)
    left = uv - predict_centroids(rig, handle, T, views)[0]
    answers = response_of_pixels(uv, spread, rig, handle, views, T)
    residuals = Residuals(left, np.linalg.inv(spread))
    told = honest(covariance, answers, residuals, T, rig, handle)
    return told.T_world_handle, covariance, told


def drawn(rig, seed, sigma_px=SIGMA_PX):
    shape = (len(facing(rig).camera), 2)
    return sigma_px * np.random.default_rng(seed).standard_normal(shape)


def known_to(rig, px):
    """A rig whose principal points are known to some pixels."""
    sigma = np.zeros((len(rig.cameras), 15))
    sigma[:, 2:4] = px
    return replace(rig, covariance=RigCovariance(rig.names, np.diag(sigma.ravel() ** 2)))


def test_a_chi_square_by_the_table():
    assert not contradict(16.8, 6)  # 16.81: one in a hundred (Abramowitz and Stegun, table 26.8)
    assert contradict(16.82, 6)
    assert not contradict(1e9, 0)


def test_students_factor_by_the_table():
    # t of one degree of freedom is 1.837 where the normal distribution is 1, of three 1.197
    assert students_factor(1) == pytest.approx(1.837**2, rel=1e-3)
    assert students_factor(3) == pytest.approx(1.197**2, rel=1e-3)
    assert students_factor(np.inf) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("rig", [PAIR, THREE], ids=["pair", "three"])
def test_noise_is_no_contradiction(rig):
    n = 20
    noticed = 0
    for seed in range(n):
        _, covariance, told = found(rig, CODED, drawn(rig, seed))
        noticed += not (np.array_equal(told.covariance, covariance) and not told.systematic.any())
        assert not told.refused
    assert noticed <= 3  # two tests of one in a hundred: 0.4; more than 3 of 20 once in 1500


def test_markers_that_contradict_each_other_scale_the_covariance():
    ratios = []
    for seed in range(10):
        _, covariance, told = found(THREE, CODED, drawn(THREE, seed, 3 * SIGMA_PX))
        ratios.append(told.covariance[0, 0] / covariance[0, 0])
    # 9, less what Huber's weights hold back
    assert 5.5 < np.mean(ratios) < 10


def test_images_that_contradict_each_other_are_a_systematic_error():
    """Offsets of 0.3 px that nobody knows of: the size of those that show tells that of all."""
    rng = np.random.default_rng(0)
    rows = []
    for seed in range(15):
        offsets = 0.3 * rng.standard_normal((3, 2))
        T, covariance, told = found(THREE, CODED, drawn(THREE, seed), offsets)
        away = np.sum((T.translation - POSE.translation) ** 2)
        parts = told.systematic, covariance
        rows.append((away, *(np.trace(part[:3, :3]) for part in parts)))
        # what corrects the pose has noise of its own
        assert np.linalg.eigvalsh(told.covariance - covariance).min() > -1e-9
    error, systematic, noise = np.sqrt(np.mean(rows, axis=0))
    assert error > 3 * noise
    # 15 draws of three ways know a ratio to 1 in sqrt(2 x 45), 0.105: three of that
    assert 0.68 < error / systematic < 1.32


@pytest.mark.parametrize("rig", [PAIR, THREE], ids=["pair", "three"])
def test_images_that_a_rolling_shutter_stretches_are_distorted(monkeypatch, rig):
    """The rows of a handle that moves down are further apart. Errors of the rig alone leave a part of
    that out; with a stretch of each image the pose is no further off than one in a thousand is.
    """
    views = facing(rig)
    uv = predict_centroids(rig, CODED, POSE, views)[0]
    cameras = range(len(rig.cameras))
    middle = np.stack([uv[views.camera == c].mean(axis=0) for c in cameras])[views.camera]
    stretch = 0.01 * (uv - middle) * [0.0, 1.0]
    assert np.abs(stretch).max() > 0.3  # px

    def chi_square():
        T, _, told = found(rig, CODED, drawn(rig, 0) + stretch)
        away = motion_between(T, POSE)
        return away @ np.linalg.solve(told.covariance + told.systematic, away)

    distorted = chi_square()
    monkeypatch.setattr(size, "_distortions", lambda found, rig: 0.0 * found.points[0, 0])
    assert distorted < min(0.7 * chi_square(), 22.5)


def test_a_rig_that_is_known_no_better_does_not_contradict():
    noise = drawn(THREE, 0)
    rig = known_to(THREE, 1.0)
    offsets = np.array([[0, 0], [0, 0], [0, 1.0]])
    _, _, told = found(rig, CODED, noise, offsets, sigma_px=0.5)
    expected = found(rig, CODED, noise, 0 * offsets, sigma_px=0.5)[2]
    sigmas = np.sqrt(np.diag(expected.systematic))
    assert (sigmas > 0).all()
    assert (np.abs(told.systematic - expected.systematic) < 0.1 * np.outer(sigmas, sigmas)).all()


def test_a_wrong_convergence_shows_in_the_handles_size_and_is_taken_off():
    """One image of a pair is shifted along the baseline: the distance is wrong, and so is the size.
    With much less noise than error what is left is what the linear algebra of all pixels has.
    """
    rig, sigma_px = known_to(PAIR, 0.3), 0.002
    offsets = np.array([[0.3, 0.0], [0.0, 0.0]])
    T, _, told = found(rig, CODED, drawn(PAIR, 0, sigma_px), offsets, sigma_px)
    by_noise = found(PAIR, CODED, drawn(PAIR, 0, sigma_px), offsets, sigma_px)[0]
    away, uncorrected = (abs(p.translation[2] - POSE.translation[2]) for p in (T, by_noise))
    assert uncorrected > 0.25  # mm: 0.3 px is 0.3 mm of distance at this convergence
    assert away < 0.2 * uncorrected
    e = motion_between(T, POSE)
    total = told.covariance + told.systematic
    assert e @ np.linalg.solve(total, e) < 16.8  # one in a hundred is beyond


def test_a_corrected_pose_is_the_one_of_generalised_least_squares(monkeypatch):
    """Another way to it: all pixels weighed at once by the covariance of noise and rig (Gauss and
    Markov). The noise differs from pixel to pixel. If all that is left over is an error of the rig.
    """
    monkeypatch.setattr(contradiction, "SURE", 1.0)
    rng = np.random.default_rng(4)
    rig = known_to(THREE, 0.05)
    views = facing(THREE)
    k = len(views.camera)
    points = POSE.apply(CODED.marker_centres)[views.marker]
    J = motion_slopes(rig, views.camera, points, POSE.translation).reshape(-1, 6)
    variances = rng.uniform(0.01, 0.04, 2 * k) ** 2
    by_noise = np.linalg.inv(J.T / variances @ J)
    gain = by_noise @ J.T / variances
    offsets = 0.05 * rng.standard_normal((3, 2))
    y = (offsets[views.camera]).ravel() + np.sqrt(variances) * rng.standard_normal(2 * k)
    answers = Response(gain.reshape(6, k, 2), views.camera, points, views.marker)
    information = np.zeros((k, 2, 2))
    information[:, [0, 1], [0, 1]] = 1 / variances.reshape(k, 2)
    left = Residuals((y - J @ gain @ y).reshape(k, 2), information)
    told = honest(by_noise, answers, left, POSE, rig, CODED)
    same = (views.camera[:, None] == views.camera).repeat(2, 0).repeat(2, 1)
    V = np.diag(variances) + 0.05**2 * same * np.tile(np.eye(2), (k, k))
    expected = np.linalg.inv(J.T @ np.linalg.solve(V, J))
    best = expected @ J.T @ np.linalg.solve(V, y)
    np.testing.assert_allclose(told.covariance + told.systematic, expected, rtol=1e-6)
    step = motion_between(told.T_world_handle, POSE)
    np.testing.assert_allclose(gain @ y + step, best, rtol=1e-6)
    np.testing.assert_allclose(
        told.answers.gain.reshape(6, -1) @ y, best, rtol=1e-6
    )  # as a pixel moves it


def test_a_doubtful_correction_is_the_mean_of_two_poses(monkeypatch):
    """Of three in four and one in four: the mean, and the covariance of the mixture, by hand. The
    chance that noise leaves as much is far above what is needed for a full correction.
    """
    rig, offsets = known_to(PAIR, 0.3), np.array([[0.2, 0.0], [0.0, 0.0]])
    told = {}
    for sure in (1.0, 0.75):
        monkeypatch.setattr(contradiction, "SURE", sure)
        told[sure] = found(rig, CODED, drawn(PAIR, 0), offsets)[2]
    T, covariance, _ = found(PAIR, CODED, drawn(PAIR, 0), offsets)
    full = motion_between(told[1.0].T_world_handle, T)
    part = motion_between(told[0.75].T_world_handle, T)
    assert np.linalg.norm(full[:3]) > 0.05  # mm
    np.testing.assert_allclose(part, 0.75 * full, rtol=1e-6, atol=1e-9)
    by_noise = told[1.0].covariance - covariance
    expected = covariance + 0.75**2 * by_noise + 0.75 * 0.25 * np.outer(full, full)
    np.testing.assert_allclose(told[0.75].covariance, expected, rtol=1e-4, atol=1e-12)


def silent(rig):
    return replace(rig, covariance=None)


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "low"), [(PAIR, 0.5), (THREE, 0.7)], ids=["pair", "three"])
def test_a_rig_that_says_nothing_is_as_uncertain_as_what_is_seen_makes_it(rig, low):
    """Images that are shifted by a fifth of what is usual, by as much, and five times as much."""
    rng = np.random.default_rng(0)
    ratios = []
    for px in (0.07, 0.35, 1.75):
        squares = []
        for seed in range(90):
            offsets = px * rng.standard_normal((len(rig.cameras), 2))
            T, _, told = found(silent(rig), CODED, drawn(rig, seed), offsets)
            away = T.translation - POSE.translation
            squares.append(away @ away / np.trace((told.covariance + told.systematic)[:3, :3]))
        ratios.append(np.sqrt(np.mean(squares)))
    assert ratios[0] < 1.0  # a pair has one degree of freedom of its own beside what was assumed
    assert low < ratios[1] < 1.2
    # so bad a rig has a long tail: 2.0 in the rms of three cameras, with a median of 1.1
    assert low < ratios[2] < 2.3


def test_the_size_of_a_covariance_is_the_most_likely_one():
    """With very many numbers to tell it, it is what they say, whatever was assumed; with none it is
    what was assumed, by Student's factor.
    """
    rng = np.random.default_rng(0)
    # half of them show the noise alone, which may be larger than it is said to be
    values = np.r_[rng.uniform(1.0, 5.0, 300), np.zeros(300)]
    rest = rng.standard_normal(600)
    for noise in (1.0, 30.0):
        seen = np.sqrt(noise + 7.0 * values) * rest
        assert likely_size(np.diag(values), seen, 1.0) == pytest.approx(7.0, rel=0.3)
    for freedom, factor in ((3.0, 1.197), (5.0, 1.111)):  # by the table of Student's t
        size = likely_size(np.zeros((2, 2)), np.zeros(2), freedom)
        assert size == pytest.approx(factor**2, rel=0.02)


def test_a_rig_that_states_its_covariance_is_settled():
    rig = known_to(PAIR, 0.3)
    _, _, told = found(rig, CODED, drawn(PAIR, 0))
    assert told.rig is rig
    _, _, told = found(silent(PAIR), CODED, drawn(PAIR, 0))
    assert told.rig.covariance.freedom == np.inf


def test_a_pose_that_large_contradictions_leave_open_is_refused():
    across = [[0, 3.0], [0, -3.0]]  # of the pair's baseline, which no motion of the handle makes
    assert found(PAIR, CODED, drawn(PAIR, 0), across)[2].refused
    assert not found(PAIR, CODED, drawn(PAIR, 0))[2].refused


def test_nothing_systematic_where_nothing_is_known_or_shows():
    told = found(PAIR, CODED, np.zeros_like(drawn(PAIR, 0)))[2]
    np.testing.assert_array_equal(told.systematic, NOTHING)


def test_what_does_not_count_cannot_contradict():
    # all windows of an instant may be without weight: the rig is known, nothing was seen
    views = facing(PAIR)
    uv = predict_centroids(PAIR, CODED, POSE, views)[0]
    spread = np.tile(SIGMA_PX**2 * np.eye(2), (len(uv), 1, 1))
    answers = response_of_pixels(uv, spread, PAIR, CODED, views, POSE)
    nothing = Residuals(np.zeros_like(uv), np.zeros_like(spread))
    told = honest(np.eye(6), answers, nothing, POSE, known_to(PAIR, 0.1), CODED)
    np.testing.assert_array_equal(told.covariance, np.eye(6))
    assert not told.refused
