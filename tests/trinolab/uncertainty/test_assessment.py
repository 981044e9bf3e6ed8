"""Poses assessed by their residuals: against numerical integration over sizes and scale, against
generalised least squares, and against draws from the prior.

The systems are linear and Gaussian: slopes of the places that a rig shows, errors drawn.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import lstsq
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import logsumexp
from scipy.stats import chi2

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import RigCovariance, difference, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.default_covariance import PLACEMENT_MM, default_covariance
from trinolab.estimators.fitted import fitted_pose
from trinolab.estimators.identified import Identified
from trinolab.estimators.pixels import fit_patches
from trinolab.estimators.reprojection import fit_centroids
from trinolab.handle import slants
from trinolab.parameters import Parameters
from trinolab.rigid import motion_between, shifted
from trinolab.sensitivity import Response, by_parameters, known_errors, motion_slopes
from trinolab.uncertainty import assessment, components
from trinolab.uncertainty.assessment import FREEDOM, LinearFit, RigInformation, assess
from trinolab.uncertainty.components import FAULTS, NO_FAULT, Prior

PAIR, THREE = load_rig("paper_pair"), load_rig("raised_40deg")
CODED = load_handle("coded")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
SIGMA_PX = 0.03


def silent(rig):
    return replace(rig, covariance=None)


def known_to(rig, px):
    """A rig whose principal points are known to some pixels."""
    sigma = np.zeros((len(rig.cameras), 15))
    sigma[:, 2:4] = px
    return replace(rig, covariance=RigCovariance(rig.names, np.diag(sigma.ravel() ** 2)))


UNPLACED, PLACED = (replace(CODED, placement_sigma_mm=mm) for mm in (None, 0.05))


class System:
    """Places that a rig shows, their slopes by the pose and their noise."""

    def __init__(self, rig, seed=0):
        facing = [slants(CODED, POSE, c.centre) < np.deg2rad(60) for c in rig.cameras]
        camera, marker = np.array(np.nonzero(facing))
        points = POSE.apply(CODED.marker_centres)[marker]
        k = len(camera)
        self.J = motion_slopes(rig, camera, points, POSE.translation).reshape(2 * k, 6)
        rng = np.random.default_rng(seed)
        self.noise = np.diag((SIGMA_PX * rng.uniform(0.5, 2.0, 2 * k)) ** 2)
        weighted = np.linalg.solve(self.noise, self.J)
        self.by_noise = np.linalg.inv(self.J.T @ weighted)
        self.gain = self.by_noise @ weighted.T
        self.places = Response(self.gain.reshape(6, k, 2), camera, points, marker)

    def fit(self, y):
        """The fit by the noise alone to places that are seen y (2 k,) beside those of `POSE`, and its
        error; all is linear about `POSE`, which stands for the fit.
        """
        error = self.gain @ y
        rest = (y - self.J @ error).reshape(-1, 2)
        return LinearFit(POSE, self.by_noise, self.places, rest, self.noise, self.J), error

    def noisy(self, rng):
        """Places with noise alone."""
        return np.sqrt(np.diag(self.noise)) * rng.standard_normal(len(self.J))


def gauss_markov(J, y, V):
    """Estimate, covariance and chi-square of generalised least squares."""
    root = np.linalg.cholesky(V)
    A, b = np.linalg.solve(root, J), np.linalg.solve(root, y)
    estimate = lstsq(A, b)[0]
    return estimate, np.linalg.inv(A.T @ A), float(((b - A @ estimate) ** 2).sum())


def possible(system, rig, handle, stated, unstated, priors):
    """Every prior case: logarithm of its weight, fault, and covariance of the places for q = 1."""
    base = system.noise + sum((A @ A.T for A in stated), 0 * system.noise)
    sizes = [(0.0, 0 * base)]
    for A, prior in unstated:
        sizes = [(w + v, S + s * A @ A.T) for w, S in sizes for s, v in zip(*prior, strict=True)]
    faults = [("", np.log(NO_FAULT), 0 * base)]
    shapes = components.faults(
        system.places, rig, handle, POSE.translation, default_covariance(rig)
    )
    for name in priors:
        A = shapes[name]().shape
        faults += [(name, v, s * A @ A.T) for s, v in zip(*priors[name], strict=True)]
    return [(w + v, name, base + S + T) for w, S in sizes for name, v, T in faults]


def integrated(J, y, cases):
    """Mean and covariance of the pose, and weights of the faults: a sum over all cases and a dense
    grid of scales q, by the restricted likelihood as it is in textbooks.
    """
    log_q = np.linspace(np.log(1e-2), np.log(1e6), 600)
    q = np.exp(log_q)
    log_prior = chi2.logpdf(FREEDOM / q, FREEDOM) - log_q  # of the logarithm, up to a constant
    m = len(y) - J.shape[1]
    logs, means, covariances, names, of_q = [], [], [], [], []
    for log_weight, name, V in cases:
        estimate, covariance, square = gauss_markov(J, y, V)
        log_dets = np.linalg.slogdet(V)[1] - np.linalg.slogdet(covariance)[1]
        joint = log_prior - m / 2 * log_q - square / (2 * q)
        logs.append(log_weight - log_dets / 2 + logsumexp(joint))
        of_q.append(np.exp(joint - logsumexp(joint)) @ q)
        means.append(estimate)
        covariances.append(covariance)
        names.append(name)
    weights = np.exp(logs - logsumexp(logs))
    mean = weights @ np.array(means)
    spread = np.array(means) - mean
    covariance = np.einsum("n,nij->ij", weights * of_q, covariances) + (weights * spread.T) @ spread
    by_fault = {name: weights[np.array(names) == name].sum() for name in names}
    return mean, covariance, by_fault


SETUPS = {
    "silent rig": (silent(PAIR), CODED),
    "silent rig of three": (silent(THREE), PLACED),
    "silent handle": (known_to(PAIR, 0.3), UNPLACED),
    "both silent": (silent(THREE), UNPLACED),
    "both stated": (known_to(THREE, 0.3), PLACED),
    "exact rig": (THREE, UNPLACED),
}


def total(found):
    return found.covariance_random + found.systematic


def squared(e, covariance):
    return e @ np.linalg.solve(covariance, e)


def prior_of(system, rig, handle):
    """`possible` of a rig and a handle, by the rules that the module's documentation states."""
    stated, unstated, faults = [], [], dict(FAULTS)
    places, known = system.places, rig.covariance
    if known is None:
        of_rig = components.of_rig(places, rig, default_covariance(rig)).shape
        unstated.append((of_rig, components.SILENT_RIG))
        del faults["another rig"]
    elif not known.is_exact:
        stated.append(components.of_rig(places, rig, known).shape)
    mm = handle.placement_sigma_mm
    placement = components.of_placement(places, rig, PLACEMENT_MM if mm is None else mm).shape
    if mm is None:
        stated.append(components.of_scale(places, rig).shape)
        unstated.append((placement, components.SILENT_PLACEMENT))
        del faults["markers off their places"]
    elif mm > 0:
        stated.append(placement)
    return possible(system, rig, handle, stated, unstated, faults)


def drawn(cases, rng):
    """Places (2 k,) from the prior."""
    weights = np.exp([log_weight for log_weight, *_ in cases])
    _, name, V = cases[rng.choice(len(cases), p=weights / weights.sum())]
    q = FREEDOM / rng.chisquare(FREEDOM)
    return name, np.linalg.cholesky(q * V) @ rng.standard_normal(len(V))


@pytest.mark.parametrize("name", SETUPS)
def test_an_assessment_is_the_integral_over_sizes_and_scale(name, monkeypatch):
    monkeypatch.setattr(assessment, "FEWEST_WEIGHT", 0.0)
    rig, handle = SETUPS[name]
    system = System(rig)
    cases = prior_of(system, rig, handle)
    rng = np.random.default_rng(3)
    for _ in range(2):
        y = drawn(cases, rng)[1]
        fit, error = system.fit(y)
        found = assess(fit, rig, handle)
        mean, covariance, by_fault = integrated(system.J, y, cases)
        sigma = np.sqrt(np.diag(covariance))
        assert_allclose((error + found.correction - mean) / sigma, 0, atol=1e-4)
        off = (total(found) - covariance) / np.outer(sigma, sigma)
        assert_allclose(off, 0, atol=1e-4)
        assert found.weights == pytest.approx(by_fault, abs=1e-4)
        moved = motion_between(found.T_world_handle, POSE)
        assert_allclose(moved, found.correction, atol=1e-9)


def test_noise_of_an_exact_rig_and_handle_is_the_fits_own():
    """And what is no noise makes the pose less sure."""
    system = System(THREE)
    noise = system.noisy(np.random.default_rng(8))
    found = [assess(system.fit(times * noise)[0], THREE, CODED) for times in (1, 3, 10)]
    np.testing.assert_array_equal(found[0].covariance_random, system.by_noise)
    assert found[0].T_world_handle is POSE
    assert not found[0].systematic.any()
    sigmas = [np.sqrt(np.trace(total(one)[:3, :3])) for one in found]
    assert sigmas[2] > 2 * sigmas[1] > 4 * sigmas[0]


def test_components_are_the_shifts_that_their_errors_make():
    """Beside `known_errors`, which sums in another way, and differences of the places."""
    places, rig = System(THREE).places, known_to(THREE, 0.3)
    for handle in (PLACED, UNPLACED):
        parts = [
            components.of_rig(places, rig, rig.covariance),
            components.of_placement(places, rig, PLACEMENT_MM),
            *([components.of_scale(places, rig)] if handle is UNPLACED else []),
        ]
        total_px2 = sum(part.shape @ part.shape.T for part in parts)
        assert_allclose(total_px2, known_errors(places, rig, handle), rtol=1e-6, atol=1e-9)

    def seen(motion):
        points = shifted(POSE, motion).apply(POSE.inv().apply(places.points))
        each = zip(places.camera, points, strict=True)
        return np.stack([THREE.cameras[c].project([X])[0] for c, X in each])

    rows = seen(np.zeros(6))[:, 1] - [THREE.cameras[c].principal_point[1] for c in places.camera]
    heights = CODED.marker_centres[places.marker, 1].round(3)
    rolling = components.of_rolling_shutter(places, THREE, POSE.translation).shape
    rigid = components.of_rigid_rows(places, THREE, CODED, POSE.translation).shape
    for k, step in enumerate(np.diag([0.1] * 3 + [5e-4] * 3)):
        # by 1 mm, or 5 mrad; per thousand rows, or by 0.05 mm and 0.05 mm at the radius of 5 mm
        moved = (seen(step) - seen(-step)) / 2
        unit = 10 * moved * rows[:, None] / 1000
        assert_allclose(rolling[:, k], unit.ravel(), rtol=1e-4, atol=1e-4)
        for r, height in enumerate(np.unique(heights)):
            own = moved * (0.5 if k < 3 else 20) * (heights == height)[:, None]
            assert_allclose(rigid[:, 6 * r + k], own.ravel(), rtol=1e-4, atol=1e-4)
    bent = components.of_distortion(places, THREE).shape.reshape(-1, 2, 3, 2, 2)
    for c in range(3):
        mine = places.camera == c
        assert (bent[mine, :, c] ** 2).sum() == pytest.approx(2 * mine.sum())
        assert_allclose(bent[mine].sum(axis=0), 0, atol=1e-9)
        assert not bent[~mine, :, c].any()


def without_faults(monkeypatch):
    """As if nothing could be wrong."""
    monkeypatch.setattr(
        assessment, "FAULTS", dict.fromkeys(FAULTS, Prior(np.ones(1), np.full(1, -99.0)))
    )


def test_where_all_is_stated_and_nothing_wrong_it_is_generalised_least_squares(monkeypatch):
    without_faults(monkeypatch)
    rig = known_to(THREE, 0.3)
    system = System(rig)
    slopes = by_parameters(system.places, rig)
    placement = components.of_placement(system.places, rig, 0.05).shape
    V = system.noise + slopes @ rig.covariance.matrix @ slopes.T + placement @ placement.T
    y = np.linalg.cholesky(V) @ np.random.default_rng(9).standard_normal(len(V))
    fit, error = system.fit(y)
    found = assess(fit, rig, PLACED)
    estimate, covariance, square = gauss_markov(system.J, y, V)
    assert_allclose(error + found.correction, estimate, rtol=1e-6)
    scale = (FREEDOM + square) / (FREEDOM + len(y) - 6 - 2)
    assert_allclose(total(found), scale * covariance, rtol=1e-6)
    # what no pixel of another instant averages away
    gain = covariance @ np.linalg.solve(V, system.J).T
    random = scale * gain @ system.noise @ gain.T
    assert_allclose(found.covariance_random, random, rtol=1e-6)


def test_the_rig_that_a_fit_is_made_with_does_not_matter():
    """Of a linear system: its residuals are those of the other one, and so is its pose."""
    rig = silent(THREE)
    system = System(rig)
    rng = np.random.default_rng(10)
    root = np.linalg.cholesky(default_covariance(rig).matrix + 1e-18 * np.eye(45))
    true, here = (root @ rng.standard_normal(45) for _ in range(2))
    near = displaced(rig, 0.02 * here)
    slopes = by_parameters(system.places, rig)
    y = slopes @ true + system.noisy(rng)
    fit, error = system.fit(y)
    other, other_error = system.fit(y - slopes @ difference(near, rig).ravel())
    found, there = assess(fit, rig, CODED), assess(other, rig, CODED, near)
    sigma = np.sqrt(np.diag(total(found)))
    moved = error + found.correction - other_error - there.correction
    assert_allclose(moved / sigma, 0, atol=0.01)
    shift = slopes @ (found.displacement - there.displacement)
    assert_allclose(shift, 0, atol=0.01 * np.abs(slopes @ found.displacement).max())


def test_instants_one_after_the_other_are_all_of_them_together(monkeypatch):
    """Of one rig, whose covariance is stated, and with a scale that is certain: the last pose is that
    of the joint fit of all poses and the rig.
    """
    without_faults(monkeypatch)
    monkeypatch.setattr(assessment, "MEMORY", 1.0)
    monkeypatch.setattr(assessment, "LEAST_INFORMATION", 1e-9)
    monkeypatch.setattr(assessment, "FREEDOM", 1e9)
    rig = known_to(THREE, 0.3)
    rng = np.random.default_rng(11)
    systems = [System(rig, seed) for seed in range(4)]
    d = np.sqrt(np.diag(rig.covariance.matrix)) * rng.standard_normal(45)
    earlier, rows = None, []
    for k, system in enumerate(systems):
        slopes = by_parameters(system.places, rig)
        y = slopes @ d + system.noisy(rng)
        fit, error = system.fit(y)
        found = assess(fit, rig, CODED, earlier=earlier)
        earlier = found.information if earlier is None else earlier.then(found.information)
        poses = [system.J if j == k else 0 * system.J for j in range(len(systems))]
        rows.append((np.hstack([*poses, slopes[:, [2, 3, 17, 18, 32, 33]]]), y))
    # the rig's six numbers are seen once more, in the file, to be zero
    J = np.vstack([*(row for row, _ in rows), np.eye(6, 30, 24)])
    y = np.concatenate([*(y for _, y in rows), np.zeros(6)])
    variances = np.concatenate([*(np.diag(s.noise) for s in systems), np.full(6, 0.3**2)])
    estimate, covariance, _ = gauss_markov(J, y, np.diag(variances))
    assert_allclose(error + found.correction, estimate[18:24], rtol=1e-4, atol=1e-7)
    sigma = np.sqrt(np.diag(total(found)))
    off = (total(found) - covariance[18:24, 18:24]) / np.outer(sigma, sigma)
    assert_allclose(off, 0, atol=1e-4)
    of_rig = found.displacement.reshape(3, 15)[:, 2:4].ravel()
    assert_allclose(of_rig, estimate[24:], atol=1e-5)


def test_what_is_older_counts_for_less():
    one, other = (RigInformation(v * np.eye(2), np.full(2, v)) for v in (1.0, 10.0))
    both = one.then(other)
    assert_allclose(both.matrix, 10.9 * np.eye(2))
    assert_allclose(both.vector, 10.9)


FEW = {
    "one marker in two images": ([0, 1], [3, 3]),
    "three places": ([0, 0, 1], [0, 4, 4]),
    "three places and one more": ([0, 0, 1, 1], [0, 4, 4, 0]),
    "one camera": ([0] * 6, [0, 1, 2, 3, 4, 5]),
}


@pytest.mark.parametrize("views", FEW.values(), ids=FEW)
@pytest.mark.parametrize("name", SETUPS)
@pytest.mark.filterwarnings("error")
def test_few_places_have_covariances(name, views):
    """None, one and some residuals: symmetric matrices without a negative eigenvalue."""
    rig, handle = SETUPS[name]
    camera, marker = map(np.array, views)
    k = len(camera)
    points = POSE.apply(CODED.marker_centres)[marker]
    J = motion_slopes(rig, camera, points, POSE.translation).reshape(2 * k, 6)
    gain = np.linalg.pinv(J)
    noise = SIGMA_PX**2 * np.eye(2 * k)
    residuals = 0.1 * np.random.default_rng(12).standard_normal((k, 2))
    answers = Response(gain.reshape(6, k, 2), camera, points, marker)
    covariance = gain @ noise @ gain.T + 1e-6 * np.eye(6)
    explained = np.linalg.qr(J)[0][:, : np.linalg.matrix_rank(J)]
    fit = LinearFit(POSE, covariance, answers, residuals, noise, explained)
    found = assess(fit, rig, handle)
    for part in (found.covariance_random, found.systematic):
        assert_allclose(part, part.T, atol=1e-12 * np.abs(part).max())
        assert np.linalg.eigvalsh(part)[0] > -1e-9 * np.abs(part).max()
    assert np.isfinite(found.correction).all()
    assert np.isfinite(found.displacement).all()
    assert sum(found.weights.values()) == pytest.approx(1)
    assert 0 <= found.wrong <= 1


@pytest.mark.parametrize(
    ("mm", "deg", "wrong"), [(1.0, 0.1, 0.0455), (0.1, 2.5, 0.0455), (9, 9, 1)]
)
def test_the_chance_that_a_pose_is_wrong(mm, deg, wrong):
    """Beyond two standard deviations of a normal distribution lie 4.55 %."""
    covariance = np.diag([mm, 0, 0, np.deg2rad(deg), 0, 0]) ** 2
    found = assessment.Assessment(POSE, covariance, 0 * covariance, np.zeros(30), {}, np.zeros(6))
    assert found.wrong == pytest.approx(wrong, abs=1e-4)


@pytest.mark.parametrize("estimator", ["patches", "reprojection"])
def test_a_pose_is_nearer_at_the_rig_that_its_residuals_make_likely(estimator):
    """One image of a pair is shifted by half a pixel along the baseline: the distance is wrong, and so
    is the handle's size.
    """
    rig = known_to(PAIR, 0.3)
    true = displaced(rig, 0.5 * np.eye(30)[2])
    images = render_rig(true, CODED, POSE, Bench(), np.random.default_rng(3))
    by_noise = {"patches": fit_patches, "reprojection": fit_centroids}[estimator](
        images, rig, CODED, POSE
    )
    instant = Identified(images, np.empty(0), POSE, rig)
    pose = fitted_pose(instant, rig, CODED, Parameters(estimator=estimator))
    away = motion_between(pose.T_world_handle, POSE)
    uncorrected = motion_between(by_noise.T_world_handle, POSE)
    assert np.linalg.norm(uncorrected[:3]) > 0.3  # mm
    assert np.linalg.norm(away[:3]) < 0.5 * np.linalg.norm(uncorrected[:3])
    assert away @ np.linalg.solve(pose.covariance, away) < chi2.ppf(0.99, 6)
