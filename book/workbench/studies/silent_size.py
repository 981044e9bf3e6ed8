"""What can be known of the size of a rig's errors where its file says nothing: the best rule that
knows two sizes, and not which of them it has.

All is linear: pixels, noise, errors of the rig, and the pose by generalised least squares. The rule
takes the likelihood ratio of what the images contradict (Neyman and Pearson 1933,
DOI 10.1098/rsta.1933.0009): no other one calls as many bad rigs bad for as many good ones that it
calls good. It reports the covariance of the one or the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.handle import Handle, slants
from trinolab.sensitivity import motion_slopes, slopes_at

from .broken import covariance_of_such

GOOD, BAD = (0.1, 0.005), (0.3, 0.02)  # principal points, px, and directions, deg
NOISE_PX = 0.008  # of a marker's place, as `patches` has it
SLANT_DEG = 60.0  # up to which a marker is seen


class Seen(NamedTuple):
    """An instant in the linear model.

    Attributes
    ----------
    by_motion : ndarray, shape (m, 6)
        The pixels by a motion of the handle: position (mm) and rotation vector (rad).
    by_rig : ndarray, shape (m, p)
        The pixels by the rig's parameters.
    """

    by_motion: Array
    by_rig: Array


class Curve(NamedTuple):
    """What the rule does, a number for each threshold: mean NEES of good rigs and of bad ones, and the
    rms of the positions' error by reported sigma of good ones.
    """

    good: Array
    bad: Array
    good_by_sigma: Array

    def bad_where_good_is(self, nees: float) -> float:
        """The NEES of bad rigs where that of good ones is so much."""
        return float(np.interp(nees, self.good, self.bad))

    def by_sigma_where_good_is(self, nees: float) -> float:
        """The error by sigma of good rigs where their NEES is so much."""
        return float(np.interp(nees, self.good, self.good_by_sigma))


def seen(rig: Rig, handle: Handle, T_world_handle: RigidTransform) -> Seen:
    """What the cameras see of a handle."""
    slant = np.stack([slants(handle, T_world_handle, camera.centre) for camera in rig.cameras])
    camera, marker = np.nonzero(slant < np.deg2rad(SLANT_DEG))
    points = T_world_handle.apply(handle.marker_centres)[marker]
    by_parameters = slopes_at(rig, camera, points)[0]
    by_rig = np.zeros((len(camera), 2, len(rig.cameras), by_parameters.shape[2]))
    by_rig[np.arange(len(camera)), :, camera] = by_parameters
    by_motion = motion_slopes(rig, camera, points, T_world_handle.translation)
    return Seen(by_motion.reshape(-1, 6), by_rig.reshape(2 * len(camera), -1))


def sizes(rig: Rig) -> tuple[Array, Array]:
    """The covariances of a good rig's parameters and of a bad one's."""
    return covariance_of_such(rig, *GOOD).matrix, covariance_of_such(rig, *BAD).matrix


def curve(
    instants: Sequence[Seen],
    covariances: tuple[Array, Array],
    rng: np.random.Generator,
    together: int = 1,
    draws: int = 100,
    noise_px: float = NOISE_PX,
) -> Curve:
    """Draw rigs, and judge the rule at each threshold.

    Parameters
    ----------
    instants : sequence of Seen
        Each is measured with so many drawn rigs of either size.
    covariances : tuple of ndarray, shape (p, p)
        Of good rigs and of bad ones.
    rng : numpy.random.Generator
    together : int
        From how many instants the size is taken: drawn ones beside the one that is measured, with
        the same rig.
    draws : int
    noise_px : float
    """
    ratios: tuple[list[Array], list[Array]] = ([], [])
    squares: tuple[tuple[list[Array], list[Array]], ...] = (([], []), ([], []))
    for one in instants:
        more = rng.integers(len(instants), size=together - 1)
        group = [one, *(instants[k] for k in more)]
        for true, covariance in enumerate(covariances):
            errors = _root(covariance) @ rng.standard_normal((len(covariance), draws))
            off = [
                part.by_rig @ errors + noise_px * rng.standard_normal((len(part.by_rig), draws))
                for part in group
            ]
            ratios[true].append(_likelihood_ratio(group, off, covariances, noise_px))
            for reported, of_rig in enumerate(covariances):
                squares[true][reported].append(_squares(one, off[0], of_rig, noise_px))
    ratio = [np.concatenate(parts) for parts in ratios]
    squares_of = [[np.concatenate(parts, axis=1) for parts in both] for both in squares]
    thresholds = np.quantile(np.concatenate(ratio), np.linspace(0.0, 1.0, 201))
    means = [
        [np.where(ratio[true] > at, called_bad, called_good).mean(axis=1) for at in thresholds]
        for true, (called_good, called_bad) in enumerate(squares_of)
    ]
    good, bad = np.array(means)  # (thresholds, 2) each
    return Curve(good[:, 0], bad[:, 0], np.sqrt(good[:, 1]))


def fixed(
    instants: Sequence[Seen],
    covariances: tuple[Array, Array],
    reported: Array,
    noise_px: float = NOISE_PX,
) -> tuple[float, float]:
    """The mean NEES of good rigs and of bad ones where a covariance (p, p) of the rig is reported
    whatever is seen.
    """
    means = []
    for covariance in covariances:
        of_instants = []
        for one in instants:
            gain, information = fit(one, reported, noise_px)
            V = pixel_covariance(one, covariance, noise_px)
            of_instants.append(np.trace(information @ gain @ V @ gain.T))
        means.append(float(np.mean(of_instants)))
    return means[0], means[1]


def pixel_covariance(one: Seen, of_rig: Array, noise_px: float) -> Array:
    """Covariance of the pixels (m, m) by the rig's (p, p) and by the noise, px^2."""
    return np.asarray(one.by_rig @ of_rig @ one.by_rig.T + noise_px**2 * np.eye(len(one.by_rig)))


def fit(one: Seen, of_rig: Array, noise_px: float) -> tuple[Array, Array]:
    """The pose by the pixels (6, m) and its information (6, 6), by generalised least squares."""
    V = pixel_covariance(one, of_rig, noise_px)
    weighed = np.linalg.solve(V, one.by_motion).T
    information = weighed @ one.by_motion
    return np.linalg.solve(information, weighed), information


def _squares(one: Seen, off: Array, of_rig: Array, noise_px: float) -> Array:
    """For each draw of the pixels (m, n) the pose's NEES, and the square of its position's error by
    sigma, (2, n).
    """
    gain, information = fit(one, of_rig, noise_px)
    errors = gain @ off
    nees = (errors * (information @ errors)).sum(axis=0)
    variance = np.trace(np.linalg.inv(information)[:3, :3])
    return np.stack([nees, (errors[:3] ** 2).sum(axis=0) / variance])


def _likelihood_ratio(
    group: Sequence[Seen], off: Sequence[Array], covariances: tuple[Array, Array], noise_px: float
) -> Array:
    """How much likelier the second covariance is than the first by all that is left over in a group
    of instants, (n,), as a logarithm.
    """
    parameters = group[0].by_rig.shape[1]
    information = np.zeros((parameters, parameters))
    right = np.zeros((parameters, off[0].shape[1]))
    for one, pixels in zip(group, off, strict=True):
        explained = np.linalg.qr(one.by_motion)[0]
        left = one.by_rig - explained @ (explained.T @ one.by_rig)
        information += left.T @ left / noise_px**2
        right += left.T @ pixels / noise_px**2
    logarithms = []
    for covariance in covariances:
        root = _root(covariance)
        precision = np.eye(parameters) + root.T @ information @ root
        projected = root.T @ right
        fitted = (projected * np.linalg.solve(precision, projected)).sum(axis=0)
        logarithms.append((fitted - np.linalg.slogdet(precision)[1]) / 2)
    return np.asarray(logarithms[1] - logarithms[0])


def _root(covariance: Array) -> Array:
    """A matrix that times its transpose is a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
