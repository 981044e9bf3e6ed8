r"""The covariance of a pose, given the residuals of its fit: marginal least squares.

A fit weighted by the noise alone leaves residuals y: the remaining shifts of the markers' places,
projected onto the complement of what a motion of the handle explains. To first order

    y = F (r + J d),    cov y = q F (S + \sum_i s_i A_i A_i') F'

with the residuals r of all places, the displacement d of the rig at which they were computed, the
projection F, the covariance S of the noise and of the stated errors, and components A_i of unstated
sizes s_i (`components`). The pose responds to the same places by a gain G, so that pose and residuals
are jointly normal, and the pose's mean and covariance, given the residuals, follow for each choice of
sizes (generalised least squares; Aitken 1936). Sizes are not chosen: the pose is the mean over all of
them, each weighted by its prior and by its marginal likelihood, which is the restricted one (REML:
Patterson and Thompson 1971, DOI 10.1093/biomet/58.3.545), since F takes the pose out. The scale q has
an inverse chi-square prior with `FREEDOM` degrees of freedom, over which the integral is closed: a
Student t.

The windows of pixels are not linear over the half pixel by which a rig may be wrong, so `refitted` fits
them again at the most likely rig, given the first residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.linalg import block_diag, solve_triangular
from scipy.spatial.transform import RigidTransform
from scipy.special import ndtr

from ..camera import Rig, RigCovariance, difference, displaced
from ..checks import Array
from ..default_covariance import PLACEMENT_MM, default_covariance, known_covariance
from ..handle import Handle
from ..rigid import shifted
from ..sensitivity import NOTHING, Response, by_parameters, contradict
from . import components
from .components import FAULTS, NO_FAULT, SILENT_PLACEMENT, SILENT_RIG, Component, Prior

MEMORY = 0.9  # share of what earlier instants say of the rig that an instant leaves
LEAST_INFORMATION = 1e-2  # of earlier instants that counts, by what is known without them
FREEDOM = 4.0  # of the scale that noise and all components share
SAME_RIG_PX = 0.1  # a displacement of the rig that moves no place by more needs no other fit
FEWEST_WEIGHT = 1e-4  # of sizes that count for the covariance
WRONG_MM, WRONG_RAD = 2.0, np.deg2rad(5.0)  # a pose that is further off is a false one


class LinearFit(NamedTuple):
    """A least-squares fit by the noise alone, to first order; k places in images.

    Attributes
    ----------
    T_world_handle : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame, by the noise.
    response : Response
        The response of the pose to shifts of the places.
    residuals_px : ndarray, shape (k, 2)
        Measured minus predicted places.
    noise : ndarray, shape (2 k, 2 k)
        Covariance of the places, px^2; u and v of the first place come first.
    explained : ndarray, shape (2 k, m)
        Shifts of the places that the pose and other unknowns of the fit explain.
    own : (Component, Prior) or None
        An error of the places, of no stated size, that is peculiar to this estimator.
    is_efficient : bool
        Whether the fit weights the places by the noise, so that its residuals are independent of its
        error by the noise.
    """

    T_world_handle: RigidTransform
    covariance: Array
    response: Response
    residuals_px: Array
    noise: Array
    explained: Array
    own: tuple[Component, Prior] | None = None
    is_efficient: bool = True


class RigInformation(NamedTuple):
    """A normal likelihood of the displacement of a rig, by instants of a recording.

    Attributes
    ----------
    matrix : ndarray, shape (15 C, 15 C)
    vector : ndarray, shape (15 C,)
        The matrix times the likeliest displacement, see `camera.displaced`.
    """

    matrix: Array
    vector: Array

    def then(self, later: RigInformation) -> RigInformation:
        """The sum with that of a later instant; older information has less weight, see `MEMORY`."""
        return RigInformation(
            MEMORY * self.matrix + later.matrix, MEMORY * self.vector + later.vector
        )


class Assessment(NamedTuple):
    """A pose and its covariance, given the residuals of its fit.

    Attributes
    ----------
    T_world_handle : RigidTransform
    covariance_random, systematic : ndarray, shape (6, 6)
        See `pose.Pose`.
    displacement : ndarray, shape (15 C,)
        The most likely error of the rig, see `camera.displaced`.
    weights : dict
        The probability of each fault of `components.FAULTS`, and under ``""`` that of none.
    correction : ndarray, shape (6,)
        The motion from the pose by the noise to this one, mm and rad, world frame.
    scale : float
        The likely ratio of the noise's variance to that of the fit.
    information : RigInformation or None
        The likelihood of the rig, given this instant; None for an exact rig.
    """

    T_world_handle: RigidTransform
    covariance_random: Array
    systematic: Array
    displacement: Array
    weights: dict[str, float]
    correction: Array
    scale: float = 1.0
    information: RigInformation | None = None

    @property
    def wrong(self) -> float:
        """An upper bound of the probability that the pose's error exceeds `WRONG_MM` or
        `WRONG_RAD`.
        """
        total = self.covariance_random + self.systematic
        parts = [total[:3, :3], total[3:, 3:]]
        sigmas = np.sqrt([np.linalg.eigvalsh(part)[-1] for part in parts])
        return float(min((2 * ndtr(-np.array([WRONG_MM, WRONG_RAD]) / sigmas)).sum(), 1.0))


class Fitted(Protocol):
    """A fit of an estimator."""

    @property
    def linear(self) -> LinearFit:
        """The fit to first order."""


F = TypeVar("F", bound=Fitted)


def refitted(
    fit_at: Callable[[Rig, RigidTransform], F | None],
    start: RigidTransform,
    rig: Rig,
    handle: Handle,
    near: Rig,
    earlier: RigInformation | None = None,
) -> tuple[F, Assessment] | None:
    """Fit, assess, and, if the assessment makes another rig likely, fit again at that rig.

    Parameters
    ----------
    fit_at : callable
        The fit with a rig from a start, T_world_handle; None where nothing fixes the pose.
    start : RigidTransform
    rig, handle
        As given: their errors are those of `rig`, whatever the fits are made with.
    near : Rig
        The rig of the first fit.
    earlier : RigInformation, optional
        Of earlier instants of the same recording.

    Returns
    -------
    (Fitted, Assessment) or None
        The last fit; None if there is none.
    """
    fit = fit_at(near, start)
    return None if fit is None else assessed(fit, fit_at, rig, handle, near, earlier)[:2]


def assessed(
    fit: F,
    fit_at: Callable[[Rig, RigidTransform], F | None],
    rig: Rig,
    handle: Handle,
    near: Rig,
    earlier: RigInformation | None = None,
) -> tuple[F, Assessment, Rig]:
    """Assess a fit and, if another rig is likely, fit again at that rig.

    Parameters as for `refitted`.

    Returns
    -------
    fit : Fitted
        The last one.
    assessment : Assessment
    near : Rig
        The rig of that fit.
    """
    assessment = assess(fit.linear, rig, handle, near, earlier)
    if (
        _moved_px(fit.linear.response, near, assessment.displacement - _difference(near, rig))
        < SAME_RIG_PX
    ):
        return fit, assessment, near
    here = displaced(rig, assessment.displacement)
    again = fit_at(here, assessment.T_world_handle)
    if again is None:
        return fit, assessment, near
    return again, assess(again.linear, rig, handle, here, earlier), here


def _moved_px(places: Response, rig: Rig, displacement: Array) -> float:
    """The largest motion of a place by a displacement of the rig, px."""
    moved = by_parameters(places, rig) @ displacement
    return float(np.abs(moved).max(initial=0.0))


def assess(
    fit: LinearFit,
    rig: Rig,
    handle: Handle,
    near: Rig | None = None,
    earlier: RigInformation | None = None,
) -> Assessment:
    """Assess a fit.

    Parameters
    ----------
    fit : LinearFit
    rig, handle
        As given, with their stated errors.
    near : Rig, optional
        The rig with which the fit was made; by default the given one.
    earlier : RigInformation, optional
        Of earlier instants of the same recording.

    Returns
    -------
    Assessment
        By the noise alone where rig and handle are stated to be exact and the residuals pass the misfit
        test at 1 %.
    """
    near = near or rig
    free = _free(fit.explained)
    exact = known_covariance(rig).is_exact and handle.placement_sigma_mm == 0.0
    if exact and near is rig and fit.own is None and not _misfits(fit, free):
        return Assessment(
            fit.T_world_handle,
            fit.covariance,
            NOTHING,
            np.zeros(known_covariance(rig).matrix.shape[0]),
            {"": 1.0},
            np.zeros(6),
        )
    stated, unstated, possible = _components(fit, rig, near, handle)
    known = known_covariance(rig)
    displacement = _difference(near, rig)
    slopes = by_parameters(fit.response, near)
    shifts = slopes @ displacement
    seen = _seen(fit, free, stated, shifts, _earlier(earlier, known))
    lines = _lines(
        seen.stated(stated),
        [(seen.joint([one]), prior) for one, prior in unstated],
        [(name, seen.joint([one]), FAULTS[name]) for name, one in possible],
    )
    assessment = _mixture(fit, seen, lines)
    if known.is_exact:
        return assessment
    # what it says of the rig, as far as nothing is wrong with it
    layout = [one for one in stated if one.of_rig is None]
    whiten = _whitening(fit.noise, free, layout)
    inside = whiten @ slopes
    y = whiten @ (fit.residuals_px.ravel() + shifts)
    share = assessment.weights[""] / assessment.scale
    information = RigInformation(share * inside.T @ inside, share * inside.T @ y)
    return assessment._replace(information=information)


@lru_cache(maxsize=4)  # a follower stays with its rig
def _difference(rig: Rig, start: Rig) -> Array:
    """`camera.difference` as one vector."""
    return (
        np.zeros(len(rig.parameters) * len(rig.cameras))
        if rig is start
        else difference(rig, start).ravel()
    )


def _free(explained: Array) -> Array:
    """An orthonormal basis (n, 2 k) across shifts (2 k, m)."""
    return np.linalg.qr(explained, mode="complete")[0][:, explained.shape[1] :].T


def _misfits(fit: LinearFit, free: Array) -> bool:
    """Whether the residuals fail the misfit test: whether they are larger than the noise explains."""
    y = free @ fit.residuals_px.ravel()
    chi_square = float(y @ np.linalg.solve(free @ fit.noise @ free.T, y)) if len(y) else 0.0
    return contradict(chi_square, len(y))


def _components(
    fit: LinearFit, rig: Rig, near: Rig, handle: Handle
) -> tuple[list[Component], list[tuple[Component, Prior]], list[tuple[str, Component]]]:
    """The stated components, those that are present with no stated size, and the faults, of which at
    most one is present.
    """
    places, origin = fit.response, fit.T_world_handle.translation
    known = known_covariance(rig)
    stated, unstated = [], []
    possible = components.faults(places, near, handle, origin, default_covariance(rig))
    if np.isfinite(known.freedom):
        unstated.append((components.of_rig(places, near, known), SILENT_RIG))
        del possible["another rig"]
    elif not known.is_exact:
        stated.append(components.of_rig(places, near, known))
    placement_mm = handle.placement_sigma_mm
    if placement_mm is None:
        stated.append(components.of_scale(places, near))
        placement = components.of_placement(places, near, PLACEMENT_MM)
        unstated.append((placement, SILENT_PLACEMENT))
        del possible["markers off their places"]
    elif placement_mm > 0:
        stated.append(components.of_placement(places, near, placement_mm))
    if fit.own is not None:
        unstated.append(fit.own)
    return stated, unstated, [(name, component()) for name, component in possible.items()]


class _Seen(NamedTuple):
    """The m residuals that no motion explains, those of earlier instants included, whitened by the
    stated covariance.

    Attributes
    ----------
    y : ndarray, shape (m,)
    whiten : ndarray, shape (m, 2 k + n)
        From shifts of the k places, and the n residuals of earlier instants.
    gain : ndarray, shape (6, 2 k + n)
        Of the pose.
    noise : ndarray, shape (m + 6, m)
        Covariance of residuals and pose with the residuals, by the noise alone.
    moved : ndarray, shape (6,)
        The change of the pose by the displacement of the rig.
    earlier : _Earlier
    """

    y: Array
    whiten: Array
    gain: Array
    noise: Array
    moved: Array
    earlier: _Earlier

    def joint(self, parts: Sequence[Component]) -> Array:
        """Covariance (m + 6 + p, ...) by components of unit size, of the residuals, the pose, and
        the rig's p parameters.
        """
        p = self.earlier.slopes.shape[1]
        total = np.zeros((len(self.y) + 6 + p,) * 2)
        for one in parts:
            shape = self.earlier.joined(one).shape
            of_rig = np.zeros((p, shape.shape[1])) if one.of_rig is None else one.of_rig
            factor = np.vstack([self.whiten @ shape, self.gain @ shape, of_rig])
            total += factor @ factor.T
        return total

    def stated(self, parts: Sequence[Component]) -> Array:
        """The same for the stated errors and the noise, by which the residuals are whitened."""
        m = len(self.y)
        total = self.joint(parts)
        total[:m, :m] = 0.0
        total[m : m + 6, :m] += self.noise[m:]
        return total


def _seen(
    fit: LinearFit, free: Array, stated: Sequence[Component], shifts: Array, earlier: _Earlier
) -> _Seen:
    """The residuals of a fit, of which the rig's displacement has made the shifts (2 k,), with those
    of earlier instants.
    """
    n = len(earlier.y)
    noise = block_diag(fit.noise, np.eye(n))
    joined = [earlier.joined(one) for one in stated]
    whiten = _whitening(noise, block_diag(free, np.eye(n)), joined)
    y = whiten @ np.concatenate([fit.residuals_px.ravel() + shifts, earlier.y])
    of_places = fit.response.gain.reshape(6, -1)
    gain = np.pad(of_places, ((0, 0), (0, n)))
    by_noise = np.vstack([whiten, np.zeros_like(gain) if fit.is_efficient else gain])
    return _Seen(y, whiten, gain, by_noise @ noise @ whiten.T, of_places @ shifts, earlier)


def _whitening(noise: Array, free: Array, stated: Sequence[Component]) -> Array:
    """The matrix that takes shifts of the places to residuals whose covariance, by noise and stated
    components, is 1.
    """
    by_stated = sum((one.shape @ one.shape.T for one in stated), np.zeros_like(noise))
    root = np.linalg.cholesky(free @ (noise + by_stated) @ free.T)
    return solve_triangular(root, free, lower=True)


class _Earlier(NamedTuple):
    """The information of earlier instants about the rig, as n residuals of unit covariance: their
    derivatives (n, 15 C) with respect to the displacement, and their values (n,).
    """

    slopes: Array
    y: Array

    def joined(self, component: Component) -> Component:
        """A component and its effect on these residuals."""
        below = np.zeros((len(self.y), component.shape.shape[1]))
        if component.of_rig is not None:
            below = self.slopes @ component.of_rig
        return component._replace(shape=np.vstack([component.shape, below]))


def _earlier(information: RigInformation | None, known: RigCovariance) -> _Earlier:
    """The residuals of earlier instants, without the directions in which they add nothing to the
    prior.
    """
    n = len(known.matrix)
    if information is None:
        return _Earlier(np.zeros((0, n)), np.zeros(0))
    unit = np.sqrt(np.diag(known.matrix))
    per_unit = np.divide(1.0, unit, out=np.zeros(n), where=unit > 0)
    values, vectors = np.linalg.eigh(unit[:, None] * information.matrix * unit)
    tells = values > LEAST_INFORMATION
    rows = vectors[:, tells].T
    root = np.sqrt(values[tells])
    return _Earlier(root[:, None] * rows * per_unit, rows @ (unit * information.vector) / root)


class _Lines(NamedTuple):
    """Sizes of all components, in lines: along a line one component, the axis, has several sizes, and
    all others have one.

    Attributes
    ----------
    names : list of str
        The fault of each line.
    others, axis : ndarray, shape (n, m + 6 + p, m + 6 + p)
        Covariances, see `_Seen.joint`.
    sizes, log_weights : ndarray, shape (n, a)
        Of the axis.
    """

    names: list[str]
    others: Array
    axis: Array
    sizes: Array
    log_weights: Array


def _lines(
    stated: Array,
    unstated: Sequence[tuple[Array, Prior]],
    possible: Sequence[tuple[str, Array, Prior]],
) -> _Lines:
    """All combinations of sizes: the axis is the first component that is always present, or each fault
    in turn.
    """
    faults = [("", np.zeros_like(stated), Prior(np.zeros(1), np.log([NO_FAULT]))), *possible]
    if not unstated:
        longest = max(len(prior.sizes) for _, _, prior in faults)
        sizes = np.zeros((len(faults), longest))
        log_weights = np.full((len(faults), longest), -np.inf)
        for row, (_, _, prior) in enumerate(faults):
            sizes[row, : len(prior.sizes)], log_weights[row, : len(prior.sizes)] = prior
        names = [name for name, _, _ in faults]
        axis = np.stack([joint for _, joint, _ in faults])
        return _Lines(names, np.broadcast_to(stated, axis.shape), axis, sizes, log_weights)
    (axis, of_axis), *more = unstated
    base, log_base = stated[None], np.zeros(1)
    for joint, prior in more:
        base, log_base = _with_each(base, log_base, joint, prior)
    names, blocks = [], []
    for name, joint, prior in faults:
        blocks.append(_with_each(base, log_base, joint, prior))
        names += [name] * len(blocks[-1][1])
    others = np.concatenate([block for block, _ in blocks])
    log_weights = np.concatenate([block for _, block in blocks])
    return _Lines(
        names,
        others,
        np.broadcast_to(axis, others.shape),
        np.broadcast_to(of_axis.sizes, (len(names), len(of_axis.sizes))),
        np.add.outer(log_weights, of_axis.log_weights),
    )


def _with_each(base: Array, log_base: Array, joint: Array, prior: Prior) -> tuple[Array, Array]:
    """Covariances (n, ...) and their log weights (n,), each with a component of each size."""
    both = base[:, None] + prior.sizes[:, None, None] * joint
    return both.reshape(-1, *joint.shape), np.add.outer(log_base, prior.log_weights).ravel()


def _mixture(fit: LinearFit, seen: _Seen, lines: _Lines) -> Assessment:
    """The mean over all sizes, each weighted by its prior and its marginal likelihood."""
    m = len(seen.y)
    inside, pose, rig = slice(m), slice(m, m + 6), slice(m + 6, None)
    others, axis = lines.others, lines.axis
    root = np.linalg.cholesky(np.eye(m) + others[:, inside, inside])
    inverse_root = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse_root @ axis[:, inside, inside] @ inverse_root.mT)
    # from whitened residuals to those whose covariance is 1 + size * values
    turn = inverse_root.mT @ vectors  # (n, m, m)
    z = seen.y @ turn  # (n, m)
    variances = 1 + lines.sizes[..., None] * np.maximum(values, 0.0)[:, None]  # (n, a, m)
    squares = (z[:, None] ** 2 / variances).sum(axis=2)
    log_det = np.log(variances).sum(axis=2)
    log_det = log_det + 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)[:, None]
    log_weights = lines.log_weights - log_det / 2 - (FREEDOM + m) / 2 * np.log(FREEDOM + squares)
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    counted = np.where(weights > FEWEST_WEIGHT, weights, 0.0)
    counted /= counted.sum()
    line, size = np.nonzero(counted)
    weight = counted[line, size]

    def joint(rows: slice, columns: slice) -> Array:
        """The part of the covariance of the components, for each line and size that counts."""
        sizes = lines.sizes[line, size][:, None, None]
        return others[line, rows, columns] + sizes * axis[line, rows, columns]

    cross = joint(pose, inside)
    mine = turn[line]
    gain = (cross @ mine / variances[line, size][:, None]) @ mine.mT  # (n, 6, m)
    corrections = seen.moved - gain @ seen.y
    correction = weight @ corrections
    spread = corrections - correction
    scale = weight * (FREEDOM + squares[line, size]) / (FREEDOM + m - 2)
    in_common = gain @ seen.noise[m:].T
    of_noise = gain @ seen.noise[:m] @ gain.mT - in_common - in_common.mT
    random = np.einsum("n,nij->ij", scale, fit.covariance + of_noise)
    whole = np.einsum("n,nij->ij", scale, fit.covariance + joint(pose, pose) - gain @ cross.mT)
    whole = whole + (weight * spread.T) @ spread
    # the rig answers to residuals times the inverse of their covariance, and to that times the size
    shares = np.stack([counted, counted * lines.sizes])[..., None] / variances
    by_y, by_size = (turn @ (shares.sum(axis=2) * z)[..., None])[..., 0]
    displacement = np.einsum("npm,nm->p", others[:, rig, inside], by_y)
    displacement = displacement + np.einsum("npm,nm->p", axis[:, rig, inside], by_size)
    by_fault = dict.fromkeys(lines.names, 0.0)
    for name, share in zip(lines.names, weights.sum(axis=1).tolist(), strict=True):
        by_fault[name] += share
    return Assessment(
        shifted(fit.T_world_handle, correction),
        random,
        whole - random,
        displacement,
        by_fault,
        correction,
        float(scale.sum()),
    )
