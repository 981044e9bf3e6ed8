"""Bundle adjustment: rig, marker layout and all poses of a recording adjusted together.

The image of marker m, at X_m in the handle's frame, at instant i in camera c is

    p = lens_c(R_c (R_i X_m + t_i) + t_c),

where R_c, t_c are T_cam_world and R_i, t_i are T_world_handle. The measured images of the centres
determine all of these together, as those of a target of known points determine its poses; here the
markers are the target (Triggs, McLauchlan, Hartley and Fitzgibbon 2000, *Bundle adjustment*, DOI
10.1007/3-540-44480-7_21; Hartley and Zisserman 2004, ch. 18).

**What is minimised.** With r the measured pixels less the predicted ones, C their covariances, and
g the change of the cameras' parameters and of the markers' places,

    sum of rho(r^T C^-1 r) + g^T P^-1 g.

rho is Huber's function, which gives less weight to a centre far from its prediction. P is the prior
covariance, of the rig's parameters and of the markers' placement. A parameter that the images do not
determine, such as the focal length of a camera that sees the handle at one distance only, keeps its
prior value and uncertainty. The sum is the negative logarithm of the posterior density, up to a factor,
and the inverse of its second derivatives the posterior covariance.

**Normal equations.** Common unknowns are those of rig and markers; the poses are eliminated, see
`normal`.

`prior` defines the matrix B in g = B u, with which all common unknowns have a prior of unit variance,
and the gauge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Camera, Rig, RigCovariance, displaced, pixels_with_slopes
from ..checks import Array, frozen
from ..handle import Handle
from ..rigid import cross_matrices, left_jacobian
from .normal import Normal, Reduced, damped, descended, eliminated, rows
from .prior import POSE, Prior, basis

HUBER = 3.0  # standard deviations beyond which a centre counts for less
MOST_ROUNDS = 10
SETTLED = 1e-6  # share of the cost by which the last step lowers it
LENGTH_SHARE = 1e-6  # of a stated length: its sigma, small enough to count as exact


class Centres(NamedTuple):
    """Images of markers' centres, k in all.

    Attributes
    ----------
    instant, camera, marker : ndarray of int, shape (k,)
        Which marker in which image.
    uv : ndarray, shape (k, 2)
        px, of the image as taken.
    covariance : ndarray, shape (k, 2, 2)
        px^2.
    """

    instant: np.ndarray
    camera: np.ndarray
    marker: np.ndarray
    uv: Array
    covariance: Array

    def take(self, chosen: np.ndarray) -> Centres:
        """Some of them, by index or mask."""
        return Centres(*(part[chosen] for part in self))


@dataclass(frozen=True, eq=False)
class Bundle:
    """The result of a bundle adjustment.

    Attributes
    ----------
    rig : Rig
        With its covariance.
    handle : Handle
        With each marker's own offset. Most of what is not known of the markers goes with what is not
        known of the rig; `placement_sigma_mm` is the rest, the rms standard deviation of their
        coordinates if the rig were known.
    poses : RigidTransform
        T_world_handle of the n instants, a batch.
    covariance : ndarray, shape (15 c + 3 m, 15 c + 3 m)
        The joint covariance of the cameras' parameters, as in `camera.RigCovariance`, and of the
        markers' centres (mm, handle frame).
    residuals_px : ndarray, shape (k, 2)
        Measured less predicted, one row a centre.
    sigma_factor : float
        Ratio of the residuals to their expected size by the centres' covariances, at least 1; the
        covariance includes it.
    """

    rig: Rig
    handle: Handle
    poses: RigidTransform
    covariance: Array
    residuals_px: Array
    sigma_factor: float


class _State(NamedTuple):
    """The state of an adjustment: the unknowns of unit variance, the rig and the markers' centres
    that they give, and the poses as rotations (n, 3, 3) and translations (n, 3).
    """

    u: Array
    delta: Array
    rig: Rig
    centres: Array
    rotations: Array
    translations: Array


class _Problem(NamedTuple):
    """The constants of an adjustment: rig and markers as they were, the centres seen, the prior and
    B.
    """

    rig: Rig
    centres: Array
    seen: Centres
    prior: Prior
    B: Array

    @property
    def of_cameras(self) -> int:
        """The number of camera parameters."""
        return len(self.rig.cameras) * len(self.rig.parameters)

    @property
    def instants(self) -> int:
        return int(self.seen.instant.max()) + 1


class _Linear(NamedTuple):
    """Residuals (k, 2) about a state, and the slopes of what is predicted by the common unknowns
    (k, 2, 15 c + 3 m) and by the instant's pose (k, 2, 6).
    """

    residual: Array
    by_common: Array
    by_pose: Array


def adjust(rig: Rig, handle: Handle, poses: RigidTransform, seen: Centres, prior: Prior) -> Bundle:
    """Adjust rig, markers and poses together to the images of the markers' centres.

    Parameters
    ----------
    rig, handle
        The start of the adjustment and the mean of the prior.
    poses : RigidTransform
        T_world_handle of n instants, a batch, right to about a degree.
    seen : Centres
        At least four of each instant, of three or more markers.
    prior : Prior
        See `prior_of`.

    Raises
    ------
    ValueError
        If the centres leave a pose free, or the steps lead away: no rig near this one explains
        them.
    """
    problem = _Problem(rig, handle.marker_centres, seen, prior, basis(handle, prior))
    matrices = poses.as_matrix()
    start = np.zeros(problem.B.shape[1])
    state = _placed(problem, start, matrices[:, :3, :3], matrices[:, :3, 3])
    factor = 1.0
    for _ in range(MOST_ROUNDS):  # the residuals say how large the noise is
        state, at = _minimised(problem, state, factor)
        reduced = _reduced(problem, state, at, factor)
        # nor are they better than that: errors that neighbours have in common do not show
        larger = max(factor * _noise(problem, at, reduced, factor), 1.0)
        if abs(larger / factor - 1) < 1e-3:
            break
        factor = larger
    return _as_bundle(problem, handle, state, at, reduced, factor)


def fit_poses(rig: Rig, handle: Handle, poses: RigidTransform, seen: Centres) -> Bundle:
    """The poses alone adjusted to the centres, with rig and markers as they are; see `adjust`."""
    size = len(rig.cameras) * len(rig.parameters)
    return adjust(rig, handle, poses, seen, Prior(np.zeros((size, size)), 0.0, None))


def _placed(problem: _Problem, u: Array, rotations: Array, translations: Array) -> _State:
    """The state with unknowns u and poses."""
    change = problem.B @ u
    delta, shift = np.split(change, [problem.of_cameras])
    return _State(
        u,
        delta,
        displaced(problem.rig, delta),
        problem.centres + shift.reshape(-1, 3),
        rotations,
        translations,
    )


def _minimised(problem: _Problem, state: _State, factor: float) -> tuple[_State, _Linear]:
    """The state of the lowest cost for a noise scaled by a factor, and its linearisation."""

    def linearised(state: _State) -> tuple[_Linear, float]:
        at = _linearised(problem, state)
        return at, _cost(problem, state, at, factor)

    def stepped(state: _State, at: _Linear, damping: float) -> _State:
        return _stepped(problem, state, _reduced(problem, state, at, factor, damping))

    descent = descended(state, linearised, stepped, SETTLED)
    if not np.isfinite(descent.cost):
        raise ValueError("centres: expected images of one handle, got some that no rig explains")
    return descent.state, descent.linear


def _cost(problem: _Problem, state: _State, at: _Linear, factor: float) -> float:
    """Half of the cost: Huber's function of the residuals, and the prior."""
    _, distance = _weights(problem.seen, at, factor)
    near = np.minimum(distance, HUBER)
    length = _length(problem, state)
    missed = 0.0 if length is None else (length[1] / length[2]) ** 2
    return float((near * (distance - near / 2)).sum() + (state.u @ state.u + missed) / 2)


def _linearised(problem: _Problem, state: _State) -> _Linear:
    seen = problem.seen
    q = len(problem.rig.parameters)
    R = state.rotations[seen.instant]
    arms = (R @ state.centres[seen.marker][..., None])[..., 0]
    world = arms + state.translations[seen.instant]
    by_common = np.zeros((len(arms), 2, problem.of_cameras + state.centres.size))
    by_pose = np.empty((len(arms), 2, 6))
    residual = np.empty((len(arms), 2))
    for c, camera in enumerate(state.rig.cameras):
        mine = np.flatnonzero(seen.camera == c)
        uv, by_camera, by_world = pixels_with_slopes(camera, world[mine])
        residual[mine] = seen.uv[mine] - uv
        # exp(delta) turns the camera: to first order by left_jacobian(delta) times its change
        turn = state.delta[q * (c + 1) - POSE :][:3]
        by_camera[:, :, -6:-3] = by_camera[:, :, -6:-3] @ left_jacobian(turn)
        by_common[mine, :, q * c : q * (c + 1)] = by_camera
        by_pose[mine] = np.concatenate([by_world, -by_world @ cross_matrices(arms[mine])], axis=2)
        at = problem.of_cameras + 3 * seen.marker[mine, None] + np.arange(3)
        by_common[mine[:, None, None], np.arange(2)[:, None], at[:, None]] = by_world @ R[mine]
    return _Linear(residual, by_common, by_pose)


def _reduced(
    problem: _Problem, state: _State, at: _Linear, factor: float, damping: float = 0.0
) -> Reduced:
    """The normal equations, the poses eliminated, the common unknowns brought to unit variance."""
    seen = problem.seen
    weight, distance = _weights(seen, at, factor)
    weight *= np.minimum(HUBER / np.maximum(distance, HUBER), 1.0)[:, None, None]
    common = at.by_common
    weighted = weight @ common
    poses = at.by_pose.transpose(0, 2, 1)
    A = rows(common).T @ rows(weighted)
    a = rows(weighted).T @ at.residual.ravel()
    n = problem.instants
    D, E, b = np.zeros((n, 6, 6)), np.zeros((n, 6, common.shape[2])), np.zeros((n, 6))
    np.add.at(D, seen.instant, poses @ weight @ at.by_pose)
    np.add.at(E, seen.instant, poses @ weighted)
    np.add.at(b, seen.instant, (poses @ weight @ at.residual[..., None])[..., 0])
    length = _length(problem, state)
    if length is not None:
        slope, missing, sigma = length
        A += np.outer(slope, slope) / sigma**2
        a += slope * missing / sigma**2
    try:
        reduced = eliminated(Normal(A, a, E, damped(D, damping), b))
    except np.linalg.LinAlgError:
        raise ValueError("centres: expected four or more of each instant; a pose is free") from None
    B = problem.B
    information = damped(B.T @ reduced.S @ B + np.eye(B.shape[1]), damping)
    return reduced._replace(S=information, s=B.T @ reduced.s - state.u)


def _weights(seen: Centres, at: _Linear, factor: float) -> tuple[Array, Array]:
    """Inverse covariances (k, 2, 2), and the length of each residual in standard deviations, (k,)."""
    weight = np.asarray(np.linalg.inv(seen.covariance), dtype=float) / factor**2
    square = np.einsum("ki,kij,kj->k", at.residual, weight, at.residual)
    return weight, np.sqrt(square)


def _length(problem: _Problem, state: _State) -> tuple[Array, float, float] | None:
    """Derivative of the stated length by the common unknowns, (15 c + 3 m,), the length that is
    missing, and its sigma, mm.
    """
    length = problem.prior.length
    if length is None:
        return None
    slope = np.zeros(len(problem.B))
    if length.of == "cameras":
        first, second = (state.rig.cameras[k] for k in (length.first, length.second))
        baseline = first.centre - second.centre
        for k, camera, sign in ((length.first, first, 1.0), (length.second, second, -1.0)):
            end = len(problem.rig.parameters) * (k + 1)
            slope[end - POSE : end] = sign * (baseline @ _centre_slopes(camera))
    else:
        baseline = state.centres[length.first] - state.centres[length.second]
        at = problem.of_cameras
        slope[at + 3 * length.first :][:3] = baseline
        slope[at + 3 * length.second :][:3] = -baseline
    now = float(np.linalg.norm(baseline))
    return slope / now, length.mm - now, LENGTH_SHARE * length.mm


def _centre_slopes(camera: Camera) -> Array:
    """Derivatives (3, 6) of a camera's centre -R^T t by a small rotation and a shift of
    T_cam_world.
    """
    R = camera.T_cam_world.as_matrix()[:3, :3]
    return np.concatenate([-R.T @ cross_matrices(camera.T_cam_world.translation), -R.T], axis=1)


def _stepped(problem: _Problem, state: _State, reduced: Reduced) -> _State:
    """The state after a Gauss-Newton step."""
    step = np.linalg.solve(reduced.S, reduced.s)
    moves = reduced.pose_steps(problem.B @ step)
    turns = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    return _placed(
        problem, state.u + step, turns @ state.rotations, state.translations + moves[:, :3]
    )


def _noise(problem: _Problem, at: _Linear, reduced: Reduced, factor: float) -> float:
    """The ratio of the residuals to the expected noise, corrected for the unknowns that they determine."""
    _, distance = _weights(problem.seen, at, factor)
    # of a common unknown the images decide the share that the prior does not
    decided = len(problem.B.T) - np.trace(np.linalg.inv(reduced.S))
    free = 2 * len(distance) - 6 * problem.instants - decided
    if free < 1:
        return 1.0
    return float(np.sqrt((np.minimum(distance, HUBER) * distance).sum() / free))


def _placement(problem: _Problem, reduced: Reduced) -> float:
    """See `Bundle.handle`."""
    split = problem.of_cameras
    of_markers = np.flatnonzero(problem.B[split:].any(axis=0))
    alone = np.linalg.inv(reduced.S[np.ix_(of_markers, of_markers)])
    B = problem.B[split:, of_markers]
    return float(np.sqrt(np.einsum("ij,jk,ik->i", B, alone, B).mean()))


def _as_bundle(
    problem: _Problem,
    handle: Handle,
    state: _State,
    at: _Linear,
    reduced: Reduced,
    factor: float,
) -> Bundle:
    B = problem.B
    covariance = B @ np.linalg.inv(reduced.S) @ B.T
    covariance = (covariance + covariance.T) / 2
    split = problem.of_cameras
    rig = replace(state.rig, covariance=RigCovariance(state.rig.names, covariance[:split, :split]))
    offsets = state.centres - handle.stated_centres
    moved = replace(
        handle,
        offsets_mm=tuple(map(tuple, offsets.tolist())),
        placement_sigma_mm=_placement(problem, reduced),
    )
    poses = RigidTransform.from_components(
        state.translations, Rotation.from_matrix(state.rotations)
    )
    return Bundle(rig, moved, poses, frozen(covariance), frozen(at.residual), factor)
