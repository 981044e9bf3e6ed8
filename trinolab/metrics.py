"""Errors of measured poses: Eq. 26 and 27, the geodesic angle, and errors up to a handle's
symmetry.

Poses are a batched ``RigidTransform`` of length n, each ``T_world_handle`` (a single one counts as
n = 1). Only valid poses are accepted: drop rows with NaN first, and report the share that remains.
Names that end in ``_deg`` are degrees.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array, as_array, as_number, as_transform

FAR_MM, FAR_DEG = 2.0, 5.0  # beyond either a pose is far off
# markers that one camera, or each of two, has to see: as many fix the pose
SEEN_BY_ONE, SEEN_BY_TWO = 4, 3


@dataclass(frozen=True)
class PoseErrors:
    """Errors of n measured poses against their truths: the paper's four means, and what they do not
    show.

    ``E_*`` are the means of Eq. 26 and 27; the geodesic angle is that of the rotation from truth to
    estimate, which has no gimbal lock. The Euler angles' means and maxima are ill-conditioned near
    beta = +-90 deg.
    """

    n: int
    E_t_mm: float
    E_alpha_deg: float
    E_beta_deg: float
    E_gamma_deg: float
    geodesic_mean_deg: float
    position_median_mm: float
    position_max_mm: float
    alpha_median_deg: float
    beta_median_deg: float
    gamma_median_deg: float
    geodesic_median_deg: float
    geodesic_max_deg: float


def pose_errors(estimates: RigidTransform, truths: RigidTransform) -> PoseErrors:
    """Compare poses with their truths, instant by instant (Eq. 26-27).

    Parameters
    ----------
    estimates, truths : RigidTransform of length n
        ``T_world_handle``, mm. The caller accounts for a handle's symmetry, see
        `nearest_equivalent`.
    """
    position = position_errors(estimates, truths)
    angles = np.abs(angle_differences_deg(estimates, truths))
    geodesic = geodesic_deg(estimates, truths)
    values = [
        position_error(estimates, truths),
        *angle_errors_deg(estimates, truths),
        geodesic.mean(),
        np.median(position),
        position.max(),
        *np.median(angles, axis=0),
        np.median(geodesic),
        geodesic.max(),
    ]
    return PoseErrors(len(position), *(float(value) for value in values))


def position_errors(estimates: RigidTransform, truths: RigidTransform) -> Array:
    """Distances between measured and true origins, shape (n,), mm."""
    estimates, truths = _as_pairs(estimates, truths)
    return np.linalg.norm(estimates.translation - truths.translation, axis=1)


def position_error(estimates: RigidTransform, truths: RigidTransform) -> float:
    """Mean distance E_t between measured and true origins, mm (Eq. 26)."""
    return float(position_errors(estimates, truths).mean())


def angle_differences_deg(estimates: RigidTransform, truths: RigidTransform) -> Array:
    """Measured minus true (alpha, beta, gamma), wrapped to (-180, 180], shape (n, 3), deg."""
    estimates, truths = _as_pairs(estimates, truths)
    difference = euler_deg(estimates) - euler_deg(truths)
    return 180.0 - (180.0 - difference) % 360.0


def angle_errors_deg(estimates: RigidTransform, truths: RigidTransform) -> Array:
    """Mean absolute errors E_alpha, E_beta, E_gamma, shape (3,), deg (Eq. 27)."""
    return np.abs(angle_differences_deg(estimates, truths)).mean(axis=0)


def geodesic_deg(estimates: RigidTransform, truths: RigidTransform) -> Array:
    """Angle of the rotation that carries the true orientation to the measured one, shape (n,), deg,
    0 to 180.
    """
    estimates, truths = _as_pairs(estimates, truths)
    return np.rad2deg((estimates.rotation * truths.rotation.inv()).magnitude())


def nees(estimate: RigidTransform, covariance: ArrayLike, truth: RigidTransform) -> Array:
    """Normalised estimation errors squared e^T C^-1 e: of a pose, and of its position and its
    rotation alone.

    Parameters
    ----------
    estimate, truth : RigidTransform
        One pose each, T_world_handle, mm.
    covariance : array_like, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame; as `pose.Pose` holds it.

    Returns
    -------
    ndarray, shape (3,)
        If the covariance is consistent they are chi-square with 6, 3 and 3 degrees of freedom
        (Bar-Shalom, Li and Kirubarajan 2001, sect. 5.4.2, DOI 10.1002/0471221279).
    """
    T = as_transform(estimate, "estimate")
    true = as_transform(truth, "truth")
    C = as_array(covariance, "covariance", (6, 6))
    error = np.concatenate(
        [T.translation - true.translation, (T.rotation * true.rotation.inv()).as_rotvec()]
    )
    parts = slice(0, 6), slice(0, 3), slice(3, 6)
    return np.array([error[part] @ np.linalg.solve(C[part, part], error[part]) for part in parts])


def euler_deg(poses: RigidTransform) -> Array:
    """Euler angles alpha, beta, gamma about Z, Y, X: R = Rz(alpha) Ry(beta) Rx(gamma) (Sect. 5.3,
    6.5).

    Returns
    -------
    ndarray, shape (n, 3), or (3,) for a single pose
        Degrees; alpha and gamma in [-180, 180], beta in [-90, 90]. At beta = +-90 deg only a
        combination of alpha and gamma is determined; gamma is then 0.
    """
    if not isinstance(poses, RigidTransform):
        raise ValueError(f"poses: expected a RigidTransform, got {type(poses).__name__}")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock", category=UserWarning)
        return poses.rotation.as_euler("ZYX", degrees=True)


def pose_from_euler_deg(position_mm: ArrayLike, angles_deg: ArrayLike) -> RigidTransform:
    """Poses from positions and Euler angles alpha, beta, gamma about Z, Y, X: the inverse of
    `euler_deg`.

    Parameters
    ----------
    position_mm, angles_deg : array_like, shape (n, 3), or (3,) for a single pose
    """
    wanted = (3,) if np.ndim(position_mm) == 1 else (None, 3)
    position = as_array(position_mm, "position_mm", wanted)
    angles = as_array(angles_deg, "angles_deg", position.shape)
    return RigidTransform.from_components(
        position, Rotation.from_euler("ZYX", angles, degrees=True)
    )


def nearest_equivalent(
    estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]
) -> RigidTransform:
    """Replace each pose by the one of its equivalents ``T_world_handle * S`` that is closest to its
    truth.

    The instants count as independent; for a track see `track_equivalent`. The closest one has the
    smallest geodesic angle and, among equals (to 1e-9 deg), the smallest distance.

    Parameters
    ----------
    estimates, truths : RigidTransform of length n
    symmetries : sequence of RigidTransform
        `Handle.symmetries`.

    Raises
    ------
    ValueError
        If there is no symmetry (the identity is always one).
    """
    best = nearest_index(estimates, truths, symmetries)
    estimates, _ = _as_pairs(estimates, truths)
    return estimates * RigidTransform.concatenate([symmetries[k] for k in best])


def nearest_index(
    estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]
) -> NDArray[np.intp]:
    """Index of the symmetry that `nearest_equivalent` takes for each pose, shape (n,); parameters
    and errors are the same.
    """
    angle, distance = _against_equivalents(estimates, truths, symmetries)
    tied = angle <= angle.min(axis=0) + 1e-9
    return np.where(tied, distance, np.inf).argmin(axis=0)


def track_equivalent(
    estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]
) -> RigidTransform:
    """Replace the poses of one track by ``T_world_handle * S`` with one S for all: a flip inside
    stays an error.

    S is the symmetry with the least mean geodesic angle and, among equals (to 1e-9 deg), the least
    mean distance. Parameters and errors as for `nearest_equivalent`.
    """
    angle, distance = (
        value.mean(axis=1) for value in _against_equivalents(estimates, truths, symmetries)
    )
    best = int(np.where(angle <= angle.min() + 1e-9, distance, np.inf).argmin())
    return _as_pairs(estimates, truths)[0] * symmetries[best]


def flips(
    estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]
) -> int:
    """Number of changes of the nearest equivalent from one pose of a track to the next.

    Parameters
    ----------
    estimates, truths : RigidTransform of length n
        T_world_handle in the order of time.
    symmetries : sequence of RigidTransform
        `Handle.symmetries`.

    Raises
    ------
    ValueError
        As `nearest_equivalent`.
    """
    return int(np.count_nonzero(np.diff(nearest_index(estimates, truths, symmetries))))


def far_off(
    estimates: RigidTransform,
    truths: RigidTransform,
    symmetries: Sequence[RigidTransform],
    far_mm: float = FAR_MM,
    far_deg: float = FAR_DEG,
) -> int:
    """Number of poses of a track that are off by more than `far_mm` or `far_deg`, by one equivalent
    for all.

    Parameters and errors as for `flips`; also raises ValueError for a limit that is no number or
    negative.
    """
    far_mm = as_number(far_mm, "far_mm", 0.0)
    far_deg = as_number(far_deg, "far_deg", 0.0)
    turned = track_equivalent(estimates, truths, symmetries)
    beyond = (position_errors(turned, truths) > far_mm) | (geodesic_deg(turned, truths) > far_deg)
    return int(np.count_nonzero(beyond))


def waits(
    measured: ArrayLike, counted: ArrayLike | None = None
) -> tuple[tuple[int, ...], int | None]:
    """Durations of the losses in instants: from a measured pose that no measured one follows, to
    the next measured one.

    Parameters
    ----------
    measured : array_like of bool, shape (n,)
        Whether an instant has a measured pose, in the order of time. Instants before the first
        measured one are not a loss.
    counted : array_like of bool, shape (n,), optional
        The instants that count, such as those at which the handle can be seen; all by default.

    Returns
    -------
    ended : tuple of int
        One per loss after which the track came back.
    unended : int or None
        Instants of a last loss after which it did not; None if there is none.

    Raises
    ------
    ValueError
        If the arrays are not of one dimension and one length.
    """
    seen = np.asarray(measured, dtype=bool)
    counts = np.ones(seen.shape, bool) if counted is None else np.asarray(counted, dtype=bool)
    if seen.ndim != 1 or counts.shape != seen.shape:
        raise ValueError(
            f"measured, counted: expected shape (n,) of both, got {seen.shape} and {counts.shape}"
        )
    at = np.flatnonzero(seen)
    ended = tuple(int(counts[a + 1 : b].sum()) for a, b in pairwise(at) if b > a + 1)
    if len(at) == 0 or seen[-1]:
        return ended, None
    return ended, int(counts[at[-1] + 1 :].sum())


def can_be_measured(seen: ArrayLike) -> NDArray[np.bool_]:
    """Whether enough is truly seen to fix the pose: four markers by one camera, or three by two.

    Parameters
    ----------
    seen : array_like of int, shape (n, cameras)
        How many markers each camera truly sees at each instant.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    counts = as_array(seen, "seen", (None, None), finite=False)
    return (counts >= SEEN_BY_ONE).any(axis=1) | ((counts >= SEEN_BY_TWO).sum(axis=1) >= 2)


def _against_equivalents(
    estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]
) -> tuple[Array, Array]:
    """Geodesic angles (deg) and distances (mm) of every equivalent of every pose, each of shape (k,
    n).
    """
    if len(symmetries) == 0:
        raise ValueError("symmetries: expected one motion or more, got none")
    estimates, truths = _as_pairs(estimates, truths)
    turned = [estimates * S for S in symmetries]
    return (
        np.array([geodesic_deg(poses, truths) for poses in turned]),
        np.array([position_errors(poses, truths) for poses in turned]),
    )


def _as_pairs(estimates: Any, truths: Any) -> tuple[RigidTransform, RigidTransform]:
    estimates = _as_poses(estimates, "estimates")
    truths = _as_poses(truths, "truths")
    if len(estimates) != len(truths):
        raise ValueError(
            f"estimates, truths: expected as many of either, got {len(estimates)} and {len(truths)}"
        )
    return estimates, truths


def _as_poses(value: Any, name: str) -> RigidTransform:
    if not isinstance(value, RigidTransform):
        raise ValueError(
            f"{name}: expected a RigidTransform of length n, got {type(value).__name__}"
        )
    matrices = value.as_matrix().reshape(-1, 4, 4)
    if len(matrices) == 0 or not np.isfinite(matrices).all():
        raise ValueError(
            f"{name}: expected one valid pose or more, got {'NaN' if len(matrices) else 'none'}"
        )
    return RigidTransform.concatenate([value]) if value.single else value
