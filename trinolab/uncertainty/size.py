"""How large the errors of a rig are, where that is hardly known to begin with.

A rig whose file says nothing has a covariance of usual size (`usual`), and what is seen tells by how
much it is to be larger or smaller. A pose has six numbers, and all that is left over tells: where the
images lie, and how large they are, since a wrong distance shows in the handle's size. How likely each
size is follows from the likelihood of what is left over (restricted maximum likelihood: Patterson and
Thompson 1971, DOI 10.1093/biomet/58.3.545) and from the degrees of freedom with which it was assumed.

Only what shifts an image of the handle as a whole tells the size. What the rig's errors do within an
image is as small as the noise, and how much smaller than the shifts it is differs from one calibration
to the next.
Where the images lie against each other is counted once: a rig that was corrected by it
(`identity.reconcile`) has it in its degrees of freedom, and what is left of it is noise.

A rig that states its errors, or that it has none, is taken at its word until it is contradicted. Then
its errors are those of any rig, and their size is what is seen alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.spatial.transform import RigidTransform
from scipy.special import ndtr

from ..camera import Rig, RigCovariance
from ..checks import Array, frozen
from ..handle import Handle
from .systematic import (
    Response,
    contradicting,
    errors_by_rig,
    known_errors,
    motion_slopes,
    offsets_at,
    students_factor,
)
from .usual import CORNER_SHARE, IMAGE_PX, known_covariance, usual_covariance

# Sizes of a rig's covariance that are asked for their likelihood, by what is assumed.
SIZES = frozen(np.geomspace(1e-5, 1e5, 101))
NOISES = frozen(np.geomspace(1.0, 1e3, 25))  # and by how much the noise's variance is larger
# So many standard deviations hold as large a share of the errors, over all sizes that may be, as they
# always do. By one of them the middle is right, and a bad rig that happens to agree is far outside; by
# two a good rig's joint NEES is 3 to 4 for 6. Chosen on path-traced frames, 600 drawn rigs a size.
HELD_SIGMAS = 1.3
TOLD = 1.0  # degree of freedom from which on something has been seen of a size


class Residuals(NamedTuple):
    """What is left of the places in which markers were seen.

    Attributes
    ----------
    px : ndarray, shape (k, 2)
        Seen minus predicted.
    information : ndarray, shape (k, 2, 2)
        Inverse covariance of where they were seen, px^-2; zeros for what does not count.
    common : ndarray, shape (2 k, 2 k), or None
        Covariance of what they have in common besides, px^2.
    """

    px: Array
    information: Array
    common: Array | None = None

    @property
    def used(self) -> np.ndarray:
        """Which places count, bool (k,)."""
        return np.asarray(self.information.any(axis=(1, 2)))

    @property
    def noise(self) -> Array:
        """Covariance of the places that count, by their noise and by what they have in common, px^2."""
        own = np.linalg.inv(self.information[self.used])
        each = np.arange(len(own))
        blocks = np.zeros((len(own), 2, len(own), 2))
        blocks[each, :, each] = own
        total = blocks.reshape(2 * len(own), -1)
        if self.common is not None:
            rows = self.used.repeat(2)
            total += self.common[np.ix_(rows, rows)]
        return np.asarray(total)


def equally_seen(px: Array, sigma_px: float, common: Array | None = None) -> Residuals:
    """Residuals (k, 2) of places that are all seen with the same noise in each direction."""
    information = np.broadcast_to(np.eye(2) / sigma_px**2, (len(px), 2, 2))
    return Residuals(px, information, common)


def settled(
    found: Response, left: Residuals, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Rig:
    """A rig the size of whose covariance is as likely as what is seen makes it; one that states its
    covariance stays as it is.

    Parameters
    ----------
    found : Response
    left : Residuals
        In the same order.
    T_world_handle : RigidTransform
    rig, handle
        A rig whose size is uncertain as it was corrected by the offsets of its images.

    Returns
    -------
    Rig
        With a covariance of certain size: such that `HELD_SIGMAS` standard deviations hold as large a
        share of the errors, over all sizes that may be, as they always do; one where nothing has
        been seen of the size.
    """
    known = known_covariance(rig)
    if not np.isfinite(known.freedom):
        return rig
    size = students_factor(known.freedom)
    certain = replace(rig, covariance=RigCovariance(rig.names, known.matrix))
    offsets = offsets_at(certain, T_world_handle.translation)
    if offsets is not None:
        shifts = np.kron(np.eye(len(rig.cameras))[found.camera], np.eye(2))
        errors = shifts @ offsets.covariance @ shifts.T
        counted_before = shifts @ contradicting(offsets.by_position)
        exact = replace(rig, covariance=RigCovariance.exact(rig.names))
        told = what_tells(errors, found, left, T_world_handle, exact, handle, counted_before)
        if told is not None:
            held_sigmas = HELD_SIGMAS if known.freedom >= TOLD else 1.0
            size = likely_size(*told, known.freedom, held_sigmas)
    return replace(rig, covariance=RigCovariance(rig.names, size * known.matrix))


def doubted(
    found: Response,
    left: Residuals,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
    distorted: bool,
) -> Array:
    """Errors of the places of a rig that is contradicted, beside those that it states: those of any
    rig. Of their size nothing is assumed, and all that is left over counts: also offsets of the
    images, and what the errors do within an image.

    Parameters
    ----------
    found, left, T_world_handle, rig, handle
        As for `settled`.
    distorted : bool
        Whether single images contradict themselves: they may be distorted, too.

    Returns
    -------
    ndarray, shape (2 k, 2 k)
        Covariance, px^2; u and v of the first place come first.
    """
    usual = replace(rig, covariance=RigCovariance(rig.names, usual_covariance(rig).matrix))
    by_rig = errors_by_rig(found, usual)

    def size_of(errors: Array) -> float:
        told = what_tells(errors, found, left, T_world_handle, rig, handle)
        return 1.0 if told is None else likely_size(*told, freedom=0.0)

    total = size_of(by_rig) * by_rig
    if distorted:
        # Of a pair a wrong depth and a stretch look alike: what is left over does not split them.
        distortions = _distortions(found, rig)
        total += size_of(by_rig + distortions) * distortions
    return np.asarray(total)


def _distortions(found: Response, rig: Rig) -> Array:
    """Covariance of the places (2 k, 2 k) by a linear distortion of each image of the handle, as a
    shutter that rolls makes it of a handle that moves: as large at the places as what a usual
    calibration does to single points, px^2.
    """
    k = len(found.points)
    alike = np.zeros((k, k))
    for c in np.unique(found.camera):
        mine = np.flatnonzero(found.camera == c)
        uv = rig.cameras[c].project(found.points[mine])
        aside = uv - uv.mean(axis=0)
        alike[np.ix_(mine, mine)] = aside @ aside.T / max((aside**2).sum() / len(mine), 1e-9)
    return np.asarray((CORNER_SHARE * IMAGE_PX) ** 2 * np.kron(alike, np.eye(2)))


def what_tells(
    errors: Array,
    found: Response,
    left: Residuals,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
    explained: Array | None = None,
) -> tuple[Array, Array] | None:
    """What the places tell of the size of errors that come to those of rig and layout.

    Parameters
    ----------
    errors : ndarray, shape (2 k, 2 k)
        Covariance of the places by the errors, px^2, up to its size.
    found, left, T_world_handle, rig, handle
        As for `settled`.
    explained : ndarray, shape (2 k, n), optional
        Shifts of the places that tell nothing of it, as a motion of the handle does not.

    Returns
    -------
    spread : ndarray, shape (n, n)
        Covariance by the errors of n numbers, in which all else has a variance of 1.
    rest : ndarray, shape (n,)
        The numbers. None instead of both where no place counts.
    """
    used = left.used
    if not used.any():
        return None
    rows = used.repeat(2)
    seen = found.part(used)
    others = left.noise + known_errors(seen, rig, handle)
    moves = motion_slopes(rig, seen.camera, seen.points, T_world_handle.translation)
    others_explain = moves.reshape(-1, 6)
    if explained is not None:
        others_explain = np.hstack([others_explain, explained[rows]])
    root = np.linalg.cholesky(others)
    free = null_space(np.linalg.solve(root, others_explain).T).T
    rest = np.linalg.solve(root, left.px[used].ravel())
    by_errors = errors[np.ix_(rows, rows)]
    spread = np.linalg.solve(root, np.linalg.solve(root, by_errors).T)
    return free @ spread @ free.T, free @ rest


def likely_size(spread: Array, rest: Array, freedom: float, held_sigmas: float = 1.0) -> float:
    """The size s of a covariance: numbers `rest` (n,) have the covariance k + s `spread` (n, n), and
    s was assumed to be 1 with some degrees of freedom (scaled inverse chi-square). The noise's k is
    1 or more, of `NOISES`: what is seen may be described badly, and that is no error of the rig.
    """
    values, vectors = np.linalg.eigh(spread)
    squares = (vectors.T @ rest) ** 2
    # (sizes, noises, n)
    variances = SIZES[:, None, None] * np.maximum(values, 0.0) + NOISES[:, None]
    likelihood = -(np.log(variances) + squares / variances).sum(axis=2) / 2
    likelihood -= freedom / 2 * (np.log(SIZES) + 1 / SIZES)[:, None]
    weights = np.exp(likelihood - likelihood.max()).sum(axis=1)
    sigmas = np.sqrt(SIZES)
    below = ndtr(held_sigmas * sigmas[:, None] / sigmas) @ weights / weights.sum()
    return float(np.interp(ndtr(held_sigmas), below, sigmas) ** 2)
