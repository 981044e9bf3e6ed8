"""Whether the places where markers were seen contradict each other beyond their noise, and what
that says of the pose.

A pose has six numbers, and what is seen has three times as many: what is left over is a chi-square.
Where it is larger than the noise explains, with one chance in a hundred, there are two reasons.

Markers contradict each other within each image: the model of what is seen is not exact, or the
markers are not where the layout says. The covariance is scaled by the chi-square by its degrees of
freedom (Birge 1932, DOI 10.1103/PhysRev.40.207; the scale factor of the Particle Data Group). Before
that each image may be distorted, as by a shutter that rolls (`size.doubted`).

Images contradict each other as a whole: the rig is not what its file says. Some of the images'
offsets show, others make the same shifts as a motion of the handle, and do not. All are taken to be
of one size, which is estimated from those that show, one for two cameras, three for three, so that
the size is itself uncertain: it is enlarged by Student's factor for as few.

Before that the size of the rig's covariance is settled where it is hardly known to begin with
(`uncertainty.size`).

A fit weighs by the noise alone. What it leaves over tells of the errors of rig and layout as well:
where a pair's directions are off, its distance is wrong, and so is the handle's size. The pose is
corrected by that (generalised least squares; Aitken 1936). But what looks like an error of the rig
may be something else. So the pose is a mean of two, the corrected one and the one by the noise, and how
far they are apart is in its covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtrc, fdtri

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..rigid import shifted
from .size import Residuals, doubted, settled
from .systematic import (
    CHANCE,
    NOTHING,
    Response,
    contradict,
    contradicting,
    is_uncertain,
    known_errors,
    motion_slopes,
    pixel_slopes,
    systematic_covariance,
    variance_of_few,
)
from .usual import known_covariance

FREE = 1e-3  # share of an offset below which it does not show beside a pose
# A pose is corrected in full where noise leaves as much within the images in one of ten instants, or
# more often; by so much less as that is rarer. Where a shutter rolls, the handle's size is wrong, and
# no error of the rig: the images fit badly then.
FITS = 0.1
# And then by this share: one deviation in twenty that looks like an error of the rig is taken to be
# something else, since nothing in one instant can say that it is not. Of silent pairs before a
# rolling shutter 5 in 400 poses were off by more than five of their sigmas without it, of pairs that
# state their errors 1 in 120.
SURE = 0.95
# A pose whose images contradict each other is refused if this many standard deviations are more.
REFUSED_SIGMAS = 2.0
MOST_MM, MOST_RAD = 2.0, np.deg2rad(5.0)


class Honest(NamedTuple):
    """A pose's covariances when all contradictions are counted.

    Attributes
    ----------
    covariance, systematic : ndarray, shape (6, 6)
        See `pose.Pose`.
    refused : bool
        Whether the contradictions are so large that the pose is not to be relied on.
    rig : Rig or None
        With a covariance whose size is settled, see `settled`; None where it is contradicted, and its
        errors are not those that it states.
    T_world_handle : RigidTransform
        The pose, corrected by what its residuals say of the errors of rig and layout.
    answers : Response or None
        How the corrected pose answers to the pixels; None where it was not asked.
    """

    covariance: Array
    systematic: Array
    refused: bool
    rig: Rig | None
    T_world_handle: RigidTransform
    answers: Response | None


def honest(
    covariance: Array,
    found: Response,
    left: Residuals,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
    corrects: bool = True,
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
    corrects : bool
        Whether the pose is corrected by what is left over. Of a handle that is followed it is not: its
        errors by the rig stay the same from instant to instant, and the noise of what is left over
        would shake it.
    """
    may_be_at_fault = not known_covariance(rig).doubted
    rig = settled(found, left, T_world_handle, rig, handle)
    contradicted = contradictions(found, left, T_world_handle, rig, handle)
    scale, between = contradicted.scale, contradicted.between
    answers, T = found, T_world_handle
    if corrects and may_be_at_fault and is_uncertain(rig, handle):
        answers, step, noise = _corrected(found, left, contradicted, T, rig, handle)
        T = shifted(T, step)
        covariance = covariance + noise
    systematic = systematic_covariance(answers, rig, handle)
    if contradicted.explained:
        return Honest(covariance, systematic, False, rig, T, answers)
    doubt = doubted(found, left, T_world_handle, rig, handle, distorted=scale > 1)
    unexplained = answers.covariance_by(doubt)
    scale = contradictions(found, left, T_world_handle, rig, handle, doubt).scale
    own = scale * covariance
    total = own + unexplained if between else own
    sigmas = np.sqrt([np.trace(total[:3, :3]), np.trace(total[3:, 3:])])
    refused = bool((REFUSED_SIGMAS * sigmas > [MOST_MM, MOST_RAD]).any())
    return Honest(own, systematic + unexplained, refused, None, T, answers)


class Contradictions(NamedTuple):
    """What is left of the places where markers were seen, by what noise, rig and layout explain.

    Attributes
    ----------
    scale : float
        Of the covariance by the noise; 1 without a contradiction within the images.
    between : bool
        Whether the images contradict each other as a whole.
    chance : float
        With which noise leaves as much within the images, or more; 0 where nothing is left to tell.
    reduced : float
        What is left within the images by its degrees of freedom; 1 where there are none.
    """

    scale: float
    between: bool
    chance: float
    reduced: float

    @property
    def explained(self) -> bool:
        """Whether nothing contradicts, within the images or between them."""
        return self.scale == 1 and not self.between


def _corrected(
    found: Response,
    left: Residuals,
    contradicted: Contradictions,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
) -> tuple[Response, Array, Array]:
    """The response of a pose that is corrected by what is left over, the step (6,) that corrects it,
    and the covariance (6, 6) that comes with it.

    What is left over in the directions that no motion of the handle makes has the noise in it and the
    errors of rig and layout, which the pose has as well: it is moved by what is to be expected of
    them (the mean of a normal distribution, given another's value).

    It may have other causes, which the images show by fitting badly. Then the pose is moved by a part
    of that: the mean of two poses, of which one is right with a chance w and the other with 1 - w. How
    far they are apart is in the covariance.
    """
    used = left.used
    # where images contradict each other, what is wrong may be no error of the rig
    weight = 0.0 if contradicted.between else SURE * min(contradicted.chance / FITS, 1.0)
    if weight == 0 or 2 * used.sum() <= 6:
        return found, np.zeros(6), NOTHING
    rows = used.repeat(2)
    moves = motion_slopes(rig, found.camera[used], found.points[used], T_world_handle.translation)
    free = null_space(moves.reshape(-1, 6).T).T
    noise = left.noise
    errors = known_errors(found, rig, handle)
    gain = found.gain.reshape(6, -1)
    total = free @ (contradicted.scale * noise + errors[np.ix_(rows, rows)]) @ free.T
    by_left = np.linalg.solve(total, free @ errors[rows] @ gain.T).T @ free
    corrected = gain.copy()
    corrected[:, rows] -= weight * by_left
    step = -by_left @ left.px[used].ravel()
    answers = found._replace(gain=corrected.reshape(found.gain.shape))
    by_noise = weight**2 * by_left @ noise @ by_left.T
    apart = weight * (1 - weight) * np.outer(step, step)
    return answers, weight * step, by_noise + apart


def contradictions(
    found: Response,
    left: Residuals,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
    doubt: Array | None = None,
) -> Contradictions:
    """How what is left over contradicts.

    Parameters
    ----------
    found, left, T_world_handle, rig, handle
        As for `honest`, after the size of the rig's covariance is settled.
    doubt : ndarray, shape (2 k, 2 k), optional
        Covariance of the places by more errors, as of `size.doubted`, px^2.
    """
    used = left.used
    if not used.any():
        return Contradictions(1.0, False, 0.0, 1.0)
    seen = found.part(used)
    V = left.noise + known_errors(seen, rig, handle)
    if doubt is not None:
        rows = used.repeat(2)
        V += doubt[np.ix_(rows, rows)]
    by_pose = motion_slopes(rig, seen.camera, seen.points, T_world_handle.translation)
    offsets = _offsets_that_show(T_world_handle, rig)[seen.camera]
    # whitened, and what a pose explains taken off
    root = np.linalg.cholesky(V)
    columns = np.concatenate([by_pose, offsets, left.px[used][..., None]], axis=2)
    white = np.linalg.solve(root, columns.reshape(len(root), -1))
    explained = np.linalg.qr(white[:, :6])[0]
    rest = white[:, 6:] - explained @ (explained.T @ white[:, 6:])
    U, sizes, _ = np.linalg.svd(rest[:, :-1], full_matrices=False)
    observable = sizes > FREE * np.linalg.norm(white[:, 6:-1])
    along = U[:, observable].T @ rest[:, -1]
    between = float((along**2).sum())
    within = float((rest[:, -1] ** 2).sum()) - between
    count = int(observable.sum())
    freedom = 2 * int(used.sum()) - 6 - count
    scale = variance_of_few(within, freedom) if contradict(within, freedom) else 1.0
    shows = freedom > 0 and count > 0
    chance = float(chdtrc(freedom, within)) if freedom > 0 else 0.0
    is_between = shows and between > count * scale * fdtri(count, freedom, 1 - CHANCE)
    reduced = within / freedom if freedom > 0 else 1.0
    return Contradictions(scale, bool(is_between), chance, reduced)


def _offsets_that_show(T_world_handle: RigidTransform, rig: Rig) -> Array:
    """Offsets of the images (C, 2, n), each of size 1, that no motion of the handle makes."""
    place = T_world_handle.translation[None]
    by_position = np.concatenate([pixel_slopes(camera, place)[1][0] for camera in rig.cameras])
    return contradicting(by_position).reshape(len(rig.cameras), 2, -1)
