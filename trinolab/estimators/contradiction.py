"""Whether the places where markers were seen contradict each other beyond their noise, and what
that says of the pose.

A pose has six numbers, and what is seen has three times as many: what is left over is a chi-square.
Where it is larger than the noise explains, with one chance in a hundred, there are two reasons.

Markers contradict each other within each image: the model of what is seen is not exact, or the
markers are not where the layout says. The covariance is scaled by the chi-square by its degrees of
freedom (Birge 1932, DOI 10.1103/PhysRev.40.207; the scale factor of the Particle Data Group).

Images contradict each other as a whole: the rig is not what its file says. Some of the images'
offsets show, others make the same shifts as a motion of the handle, and do not. All are taken to be
of one size, which is estimated from those that show, one for two cameras, three for three, so that
the size is itself uncertain: it is enlarged by Student's factor for as few.

Where the size of the rig's covariance is hardly known to begin with, as for a rig whose file says
nothing, all that is left over tells of it: where the images lie, and how large they are, since a
wrong distance shows in the handle's size. How likely each size is follows from the likelihood of what
is left over (restricted maximum likelihood: Patterson and Thompson 1971, DOI 10.1093/biomet/58.3.545)
and from the degrees of freedom with which it was assumed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform
from scipy.special import fdtri, ndtr

from ..camera import Rig, RigCovariance
from ..checks import Array, frozen
from ..handle import Handle
from ..rigid import cross_matrices
from ..uncertainty.systematic import (
    CHANCE,
    NOTHING,
    ONE_SIGMA,
    Response,
    contradict,
    contradicting,
    errors_by_rig,
    known_errors,
    pixel_slopes,
    slopes_at,
    students_factor,
    systematic_covariance,
    variance_of_few,
)
from ..uncertainty.usual import known_covariance

__all__ = ["Honest", "Residuals", "honest", "settled"]

FREE = 1e-3  # share of an offset below which it does not show beside a pose
# A pose whose images contradict each other is refused if this many standard deviations are more.
REFUSED_SIGMAS = 2.0
MOST_MM, MOST_RAD = 2.0, np.deg2rad(5.0)
# Sizes of a rig's covariance that are asked for their likelihood, by what is assumed.
SIZES = frozen(np.geomspace(1e-3, 1e5, 81))


class Residuals(NamedTuple):
    """What is left of the places in which markers were seen.

    Attributes
    ----------
    px : ndarray, shape (k, 2)
        Seen minus predicted.
    information : ndarray, shape (k, 2, 2)
        Inverse covariance of where they were seen, px^-2; zeros for what does not count.
    """

    px: Array
    information: Array


class Honest(NamedTuple):
    """A pose's covariances when all contradictions are counted.

    Attributes
    ----------
    covariance, systematic : ndarray, shape (6, 6)
        See `pose.Pose`.
    refused : bool
        Whether the contradictions are so large that the pose is not to be relied on.
    rig : Rig
        With a covariance whose size is settled, see `settled`.
    """

    covariance: Array
    systematic: Array
    refused: bool
    rig: Rig


def honest(
    covariance: Array,
    found: Response,
    left: Residuals,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
) -> Honest:
    """The covariances of a pose by what is known of rig and layout, and by what contradicts.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of the pose, by the noise.
    found : Response
    left : Residuals
        In the same order.
    T_world_handle : RigidTransform
    rig, handle
        What their errors explain is no contradiction.
    """
    rig = settled(found, left, T_world_handle, rig, handle)
    scale, offset_px2 = _contradictions(found, left, T_world_handle, rig, handle)
    own = covariance if scale == 1 else scale * covariance
    unexplained = offset_px2 * _by_offsets(found, rig) if offset_px2 else NOTHING
    total = own + unexplained
    sigmas = np.sqrt([np.trace(total[:3, :3]), np.trace(total[3:, 3:])])
    too_much = (REFUSED_SIGMAS * sigmas > [MOST_MM, MOST_RAD]).any()
    refused = bool((scale > 1 or offset_px2 > 0) and too_much)
    systematic = systematic_covariance(found, rig, handle) + unexplained
    return Honest(own, systematic, refused, rig)


def settled(
    found: Response, left: Residuals, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Rig:
    """A rig the size of whose covariance is as likely as what is seen makes it; one that states its
    covariance stays as it is.

    Parameters
    ----------
    found, left, T_world_handle, rig, handle
        As for `honest`.

    Returns
    -------
    Rig
        With a covariance of certain size: such that one standard deviation holds as large a share
        of the errors, over all sizes that may be, as it always does.
    """
    known = known_covariance(rig)
    used = left.information.any(axis=(1, 2))
    if not np.isfinite(known.freedom):
        return rig
    size = students_factor(known.freedom)
    if used.any():
        seen = Response(found.gain[:, used], *(part[used] for part in found[1:]))
        by_rig = errors_by_rig(seen, rig)
        others = block_diag(*np.linalg.inv(left.information[used]))
        others += known_errors(seen, rig, handle) - by_rig
        root = np.linalg.cholesky(others)
        by_pose = np.linalg.solve(root, _by_pose(seen, T_world_handle, rig))
        free = np.linalg.svd(by_pose)[0][:, 6:].T
        rest = np.linalg.solve(root, left.px[used].ravel())
        spread = np.linalg.solve(root, np.linalg.solve(root, by_rig / size).T)
        size = _likely_size(free @ spread @ free.T, free @ rest, known.freedom)
    covariance = RigCovariance(known.names, size * known.matrix)
    return replace(rig, covariance=covariance)


def _likely_size(spread: Array, rest: Array, freedom: float) -> float:
    """The size s of a covariance: numbers `rest` (n,) have the covariance 1 + s `spread` (n, n), and
    s was assumed to be 1 with some degrees of freedom (scaled inverse chi-square).
    """
    values, vectors = np.linalg.eigh(spread)
    variances = 1 + SIZES[:, None] * np.maximum(values, 0.0)
    squares = (vectors.T @ rest) ** 2
    likelihood = -(np.log(variances) + squares / variances).sum(axis=1) / 2
    likelihood -= freedom / 2 * (np.log(SIZES) + 1 / SIZES)
    weights = np.exp(likelihood - likelihood.max())
    sigmas = np.sqrt(SIZES)
    below = ndtr(sigmas[:, None] / sigmas) @ weights / weights.sum()
    return float(np.interp(ONE_SIGMA, below, sigmas) ** 2)


def _by_pose(found: Response, T_world_handle: RigidTransform, rig: Rig) -> Array:
    """How the places (2 k, 6) move with a motion of the handle, world frame."""
    _, by_points = slopes_at(rig, found.camera, found.points)
    arms = found.points - T_world_handle.translation
    by_pose = np.concatenate([by_points, -by_points @ cross_matrices(arms)], axis=2)
    return by_pose.reshape(-1, 6)


def _contradictions(
    found: Response, left: Residuals, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> tuple[float, float]:
    """The scale of the covariance, 1 without a contradiction within the images, and the variance of
    the images' offsets, px^2, 0 without one between them.
    """
    used = left.information.any(axis=(1, 2))
    if not used.any():
        return 1.0, 0.0
    seen = Response(found.gain[:, used], *(part[used] for part in found[1:]))
    V = block_diag(*np.linalg.inv(left.information[used])) + known_errors(seen, rig, handle)
    by_pose = _by_pose(seen, T_world_handle, rig).reshape(-1, 2, 6)
    offsets = _offsets_that_show(T_world_handle, rig)[seen.camera]
    # whitened, and what a pose explains taken off
    root = np.linalg.cholesky(V)
    rows = np.concatenate([by_pose, offsets, left.px[used][..., None]], axis=2)
    white = np.linalg.solve(root, rows.reshape(len(root), -1))
    explained = np.linalg.qr(white[:, :6])[0]
    rest = white[:, 6:] - explained @ (explained.T @ white[:, 6:])
    U, sizes, Vt = np.linalg.svd(rest[:, :-1], full_matrices=False)
    observable = sizes > FREE * np.linalg.norm(white[:, 6:-1])
    along = U[:, observable].T @ rest[:, -1]
    between = float((along**2).sum())
    within = float((rest[:, -1] ** 2).sum()) - between
    count = int(observable.sum())
    freedom = 2 * int(used.sum()) - 6 - count
    scale = within / freedom if contradict(within, freedom) else 1.0
    if freedom <= 0 or not count or between <= count * scale * fdtri(count, freedom, 1 - CHANCE):
        return scale, 0.0
    px = Vt[observable].T @ (along / sizes[observable])
    return scale, variance_of_few(float(px @ px), count)


def _offsets_that_show(T_world_handle: RigidTransform, rig: Rig) -> Array:
    """Offsets of the images (C, 2, n), each of size 1, that no motion of the handle makes."""
    place = T_world_handle.translation[None]
    by_position = np.concatenate([pixel_slopes(camera, place)[1][0] for camera in rig.cameras])
    return contradicting(by_position).reshape(len(rig.cameras), 2, -1)


def _by_offsets(found: Response, rig: Rig) -> Array:
    """Covariance (6, 6) of the pose by offsets of all images of 1 px each way."""
    moved = np.stack(
        [found.gain[:, found.camera == c].sum(axis=1) for c in range(len(rig.cameras))]
    )
    return np.einsum("cad,cbd->ab", moved, moved)
