"""Delays of cameras that are not triggered together, from their disagreement about a moving target
(Sect. 6.2).

Camera c takes its image of view v at the time t_v + d_c + e_cv: with a delay d_c of its own, and
with one that differs from view to view, of standard deviation tau. By then the target, which moves
with the velocity V_v (shift and turn about its middle), is displaced by V_v (d_c + e_cv), and all its
points in the image with it. V_v is known from the views before and after. Its direction at the very
instant is not, because a hand turns round between two views; so the second part is taken to lead in
any direction, with a third of the mean square along each axis. With J_cv the slopes of the image by
the target's pose, and the pixel noise sigma,

    measured = projected + J_cv V_v d_c + noise,    C_cv = sigma^2 (I + s^2 B_cv B_cv^T)
    B_cv = J_cv diag(v, v, v, w, w, w) / sqrt(3),   s = tau / sigma

is the covariance of an image's points; v and w are the sizes of shift and turn. This is least
squares, with the delays among the common unknowns, of residuals that are whitened by C^-1/2 image by
image: the faster the target, the less an image says, and there is no threshold. The s taken is that of
the largest restricted likelihood (Patterson and Thompson 1971, Biometrika 58:545), in which N
coordinates and p unknowns stand for

    -2 log L = (N - p) log(r^T C^-1 r) + log det C + log det(J^T C^-1 J)

Cameras that are triggered together have neither delays nor s. Nothing is changed unless the
likelihood rises by more than the new unknowns cost (Schwarz's criterion: log N for each).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import RigidTransform

from ..checks import Array, frozen
from ..rigid import cross_matrices
from .adjust import REST, Calibrated, camera_of, inverse, lenses_of, matrices
from .model import Images, State, images, normal_equations, stepped
from .normal import Normal, descended, eliminated, solved

FEWEST_VIEWS = 5  # that say something of a motion
# Displacements of the target's points that are looked for in the middle of the images, by the pixel
# noise: far below it nothing shows, and far above it the images say nothing.
SMALLEST, LARGEST = 0.03, 30.0
CLOSE = 0.03  # of log s


class Synchrony(NamedTuple):
    """The times at which cameras take their images of a view.

    Attributes
    ----------
    delays : ndarray, shape (cameras,)
        After the first camera, in the unit of the views' times.
    sigma : float
        Standard deviation of what differs from view to view.
    """

    delays: Array
    sigma: float


class _Fit(NamedTuple):
    """A fit: the state, the delays (cameras - 1,) or none, its normal equations of what is not held,
    and half the sum of the whitened squares.
    """

    state: State
    delays: Array
    linear: Normal
    cost: float


class _Motion(NamedTuple):
    """The motion of the target's points in the images.

    Attributes
    ----------
    velocity : ndarray, shape (cameras, views, n, 2)
        px per unit of time.
    axes : ndarray, shape (cameras, views, 2 n, 6)
        Left singular vectors of B: the ways in which the points of an image move together.
    squares : ndarray, shape (cameras, views, 6)
        Squares of its singular values.
    """

    velocity: Array
    axes: Array
    squares: Array

    def whitened(self, camera: int, columns: Array, s: float) -> Array:
        """Columns (views, 2 n, k) of an image's coordinates, by (I + s^2 B B^T)^-1/2."""
        shrunk = 1 - 1 / np.sqrt(1 + s**2 * self.squares[camera])
        along = self.axes[camera].transpose(0, 2, 1) @ columns
        return columns - self.axes[camera] @ (shrunk[..., None] * along)


class _Problem(NamedTuple):
    """The constants of a fit: the target, the points that are used (NaN: none), how many of the
    common unknowns are held, and the motion.
    """

    target: Array
    uv: Array
    held: int
    motion: _Motion

    def fit(self, start: State, delays: Array, s: float) -> _Fit:
        """The least-squares fit with this s, from a state and delays, if there are any."""
        known = len(delays) == 0

        def linearised(at: tuple[State, Array]) -> tuple[Normal, float]:
            seen = self.seen(*at)
            whole = normal_equations(
                seen,
                self.uv,
                None if known else self.motion.velocity,
                lambda camera, columns: self.motion.whitened(camera, columns, s),
            )
            return whole.without(self.held), self.cost(seen.uv, s)

        def further(at: tuple[State, Array], linear: Normal, damping: float) -> tuple[State, Array]:
            state, delays = at
            steps, views = solved(linear, damping)
            common, later = np.split(np.pad(steps, (self.held, 0)), [state.common])
            return stepped(state, common, views), delays + later

        with np.errstate(all="ignore"):
            descent = descended((start, delays), linearised, further, REST)
        state, delays = descent.state
        return _Fit(state, delays, descent.linear, descent.cost)

    def seen(self, state: State, delays: Array) -> Images:
        """The images of the points at the cameras' own times."""
        at = images(state, self.target)
        if not len(delays):
            return at
        every = np.concatenate([[0.0], delays])
        return at._replace(uv=at.uv + self.motion.velocity * every[:, None, None, None])

    def cost(self, uv: Array, s: float) -> float:
        """Half the sum of the whitened squares; NaN if a measured point is outside a camera's model."""
        missing = np.where(np.isfinite(self.uv), uv - self.uv, 0.0).reshape(*uv.shape[:2], -1, 1)
        white = [self.motion.whitened(c, of, s) for c, of in enumerate(missing)]
        return float(np.square(white).sum()) / 2

    @property
    def measured(self) -> int:
        return int(np.isfinite(self.uv).sum())

    def unknowns(self, fit: _Fit) -> int:
        return len(fit.linear.A) + 6 * len(fit.linear.D)

    def restricted(self, fit: _Fit, s: float) -> float:
        """-2 log L of the module's docstring, up to a constant."""
        schur, poses = eliminated(fit.linear).S, fit.linear.D
        information = np.linalg.slogdet(schur)[1] + np.linalg.slogdet(poses)[1].sum()
        freedoms = self.measured - self.unknowns(fit)
        return float(freedoms * np.log(fit.cost) + self.spread(s) + information)

    def schwarz(self, fit: _Fit, s: float, extra: int) -> float:
        """Schwarz's criterion for a number of unknowns beyond those of the plain fit."""
        return float(
            self.measured * np.log(fit.cost) + self.spread(s) + extra * np.log(self.measured)
        )

    def spread(self, s: float) -> float:
        """log det C without the pixel noise."""
        return float(np.log1p(s**2 * self.motion.squares).sum())

    def variance(self, fit: _Fit) -> float:
        """sigma^2 of a coordinate."""
        return 2 * fit.cost / (self.measured - self.unknowns(fit))


def synchronised(
    target: Array, uv: Array, calibrated: Calibrated, times: Array, held: bool
) -> tuple[Calibrated, Synchrony] | None:
    """A calibration that allows for cameras that take a view's images at different times.

    Parameters
    ----------
    target : ndarray, shape (n, 3)
    uv : ndarray, shape (cameras, views, n, 2)
        The measured pixels of its points.
    calibrated : Calibrated
        The calibration that takes all cameras for simultaneous. Views that it does not use stay unused.
    times : ndarray, shape (views,)
        Of the views, rising; in any unit.
    held : bool
        Whether the lenses are held.

    Returns
    -------
    Calibrated, Synchrony
        Its residuals are those at the cameras' own times. None if the views give no evidence for
        delays, or determine too little of the motion.
    """
    used: Array = np.array([T is not None for T in calibrated.T_world_target])
    if len(calibrated.cameras) < 2 or used.sum() < FEWEST_VIEWS:
        return None
    measured = np.where(np.isfinite(calibrated.residuals_px), uv, np.nan)[:, used]
    start = State(
        lenses_of(calibrated.cameras, calibrated.distortion_terms),
        matrices(camera.T_world_cam for camera in calibrated.cameras),
        matrices(T for T in calibrated.T_world_target if T is not None),
    )
    motion = _motion(start, target, measured, times[used])
    if not motion.squares.any():
        return None
    problem = _Problem(target, measured, start.lenses.size if held else 0, motion)
    try:
        plain = problem.fit(start, np.empty(0), 0.0)
        if not plain.cost > 0:  # points without any noise
            return None
        timed, s = _most_likely(problem, start)
        cost_of_delays = len(calibrated.cameras)  # the delays of all but the first, and s
        if problem.schwarz(timed, s, cost_of_delays) >= problem.schwarz(plain, 0.0, 0):
            return None
        return _calibrated(problem, calibrated, used, plain, timed, s)
    except (np.linalg.LinAlgError, ValueError):  # they leave something free
        return None


def _most_likely(problem: _Problem, start: State) -> tuple[_Fit, float]:
    """The fit with delays and the s of the largest restricted likelihood."""
    largest = problem.motion.squares[..., 0]
    middle = float(np.sqrt(np.median(largest[largest > 0])))
    none = np.zeros(len(problem.uv) - 1)
    latest = [problem.fit(start, none, SMALLEST / middle)]

    def unlikely(log_s: float) -> float:
        before = latest[-1]
        latest.append(problem.fit(before.state, before.delays, float(np.exp(log_s))))
        return problem.restricted(latest[-1], float(np.exp(log_s)))

    bounds = (np.log(SMALLEST / middle), np.log(LARGEST / middle))
    best = minimize_scalar(unlikely, bounds=bounds, method="bounded", options={"xatol": CLOSE})
    s = float(np.exp(best.x))
    return problem.fit(latest[-1].state, latest[-1].delays, s), s


def _motion(state: State, target: Array, uv: Array, times: Array) -> _Motion:
    """The motion of the target from view to view, in its images."""
    at = images(state, target)
    middle = target.mean(axis=0)
    arms = state.T_world_target[:, :3, :3] @ middle
    places = arms + state.T_world_target[:, :3, 3]
    turns = RigidTransform.from_matrix(state.T_world_target).rotation
    every = np.arange(len(times))
    before, after = np.maximum(every - 1, 0), np.minimum(every + 1, every[-1])
    between = times[after] - times[before]
    velocity = (places[after] - places[before]) / between[:, None]
    rotation = (turns[after] * turns[before].inv()).as_rotvec() / between[:, None]
    # from slopes by a turn about the target's origin to those by one about its middle
    by_shift, by_turn = at.by_view[..., :3], at.by_view[..., 3:]
    by_turn = by_turn + by_shift @ cross_matrices(arms)[:, None]
    valid = np.asarray(np.isfinite(uv).all(axis=-1))[..., None]
    in_image = by_shift @ velocity[:, None, :, None] + by_turn @ rotation[:, None, :, None]
    steps = np.diff(times)
    shift = _by_both_sides(np.linalg.norm(np.diff(places, axis=0), axis=1) / steps)
    turn = _by_both_sides((turns[1:] * turns[:-1].inv()).magnitude() / steps)
    shape = (1, len(times), 1, 1, 1)
    B = np.concatenate([by_shift * shift.reshape(shape), by_turn * turn.reshape(shape)], axis=-1)
    B = np.where(valid[..., None], B, 0.0).reshape(*uv.shape[:2], -1, 6) / np.sqrt(3)
    axes, values, _ = np.linalg.svd(B, full_matrices=False)
    return _Motion(np.where(valid, in_image[..., 0], 0.0), axes, values**2)


def _by_both_sides(speeds: Array) -> Array:
    """Speeds at views (v,) from those between them (v - 1,): the rms of before and after."""
    before, after = np.r_[speeds[:1], speeds], np.r_[speeds, speeds[-1:]]
    return np.sqrt((before**2 + after**2) / 2)


def _calibrated(
    problem: _Problem, calibrated: Calibrated, used: Array, plain: _Fit, timed: _Fit, s: float
) -> tuple[Calibrated, Synchrony]:
    state, held = timed.state, problem.held
    q = state.common - held
    variance = problem.variance(timed)
    covariance = np.array(calibrated.covariance)
    # what the calibration says beside its noise stays
    covariance[held:, held:] -= problem.variance(plain) * inverse(plain.linear)
    covariance[held:, held:] += variance * inverse(timed.linear)[:q, :q]
    residuals = np.full(calibrated.residuals_px.shape, np.nan)
    residuals[:, used] = problem.seen(state, timed.delays).uv - problem.uv
    T_world_cam = RigidTransform.from_matrix(state.T_world_cam)
    cameras = tuple(
        camera_of(camera.name, camera.size, lens, T)
        for camera, lens, T in zip(calibrated.cameras, state.lenses, T_world_cam, strict=True)
    )
    poses = iter(RigidTransform.from_matrix(state.T_world_target))
    calibrated = replace(
        calibrated,
        cameras=cameras,
        T_world_target=tuple(next(poses) if of_view else None for of_view in used),
        covariance=frozen(covariance),
        residuals_px=frozen(residuals),
        sigma_px=float(np.sqrt(variance)),
    )
    delays = frozen(np.concatenate([[0.0], timed.delays]))
    return calibrated, Synchrony(delays, s * float(np.sqrt(variance)))
