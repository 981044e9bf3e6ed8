"""Q, R and the first covariance from data: the most likely ones, by what a filter expected and what came (Sect. 4.2).

In the model of `kalman` a coordinate does not know of the others, and coordinates that are observed at the same times
with the same noise share one covariance. So any number of tracks is one filter of three numbers, place, velocity and
acceleration, and its likelihood is quick enough to be maximised. The pose's filter (`posefilter`) is of the same kind,
but its acceleration fades.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtri

from .checks import Array, as_array, as_number, as_rng, as_whole, frozen
from .kalman import MIN_DT_S, KalmanParameters, white_jerk
from .posefilter import FADING_S, PoseFilterParameters, transition


class Model(NamedTuple):
    """How a coordinate moves and is observed; the unit is that of the coordinate.

    Attributes
    ----------
    jerk_intensity : float
        Of the white jerk, unit^2/s^5.
    sigma : float
        Standard deviation of the observed place.
    velocity_sigma, acceleration_sigma : float
        Standard deviations of the first velocity and acceleration.
    fading_s : float
        Time in which an acceleration fades (Singer 1970); infinite in Eq. 11.
    """

    jerk_intensity: float
    sigma: float
    velocity_sigma: float
    acceleration_sigma: float
    fading_s: float = np.inf


class Surprises(NamedTuple):
    """Observations less predictions, shape (k, m), and the variance that they should have, shape (k,)."""

    residuals: Array
    variances: Array

    @property
    def squared(self) -> Array:
        """Each residual squared by its variance, shape (k, m): of mean 1 if the model holds."""
        return self.residuals**2 / self.variances[:, None]

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the probability density of all observations but the first."""
        scale = np.log(2 * np.pi * self.variances).sum() * self.residuals.shape[1]
        return float(-(scale + self.squared.sum()) / 2)


def surprises(times_s: ArrayLike, z: ArrayLike, model: Model) -> Surprises:
    """Filter coordinates that are all observed at the same times, and keep what each observation was off (Eq. 9-15).

    Parameters
    ----------
    times_s : array_like, shape (k + 1,)
        s, increasing; the first instant starts the filter.
    z : array_like, shape (k + 1, m)
        A column a coordinate.
    model : Model

    Raises
    ------
    ValueError
        If there are not two instants or more, the times do not increase, or a shape does not fit.
    """
    times = as_array(times_s, "times_s", (None,))
    seen = as_array(z, "z", (len(times), None))
    if len(times) < 2 or not (np.diff(times) >= MIN_DT_S).all():
        raise ValueError("times_s: expected two increasing times or more")
    x, P = np.zeros((3, seen.shape[1])), np.diag(np.square(model[1:4]))
    x[0] = seen[0]
    residuals, variances = np.empty((len(times) - 1, seen.shape[1])), np.empty(len(times) - 1)
    for k, dt in enumerate(np.diff(times)):
        F = transition(float(dt), model.fading_s)
        x, P = F @ x, F @ P @ F.T + model.jerk_intensity * _unit_noise(float(dt))
        variances[k], residuals[k] = P[0, 0] + model.sigma**2, seen[k + 1] - x[0]
        K = P[:, 0] / variances[k]
        x, P = x + np.outer(K, residuals[k]), P - np.outer(K, K) * variances[k]
    return Surprises(frozen(residuals), frozen(variances))


def most_likely(data: Sequence[tuple[ArrayLike, ArrayLike]], start: Model, free: Sequence[str]) -> Model:
    """The model under which the observations were most likely.

    Parameters
    ----------
    data : sequence of (times_s, z)
        As for `surprises`; several if not all coordinates are observed at the same times.
    start : Model
        Where the search begins.
    free : sequence of str
        The fields to be found, all positive and finite at the start; the others are kept.

    Raises
    ------
    ValueError
        As `surprises`, or if a free field is not positive and finite.
    """
    first = np.log([as_number(getattr(start, name), name, 0.0, open_low=True) for name in free])

    def cost(logs: Array) -> float:
        model = start._replace(**dict(zip(free, np.exp(logs).tolist(), strict=True)))
        return -sum(surprises(times, z, model).log_likelihood for times, z in data)

    found = minimize(cost, first, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2}).x
    return start._replace(**dict(zip(free, np.exp(found).tolist(), strict=True)))


def image_model(p: KalmanParameters) -> Model:
    """The image's filter as a model of one coordinate, px."""
    return Model(p.jerk_intensity, p.sigma_px, p.velocity_sigma, p.acceleration_sigma)


def tune_image(data: Sequence[tuple[ArrayLike, ArrayLike]], start: KalmanParameters | None = None) -> KalmanParameters:
    """Q, R and the first covariance of the image's filter that make tracks of points most likely.

    Parameters
    ----------
    data : sequence of (times_s, uv)
        Times (k + 1,), s, and the coordinates seen then, px, shape (k + 1, m): of each point two columns.
    start : KalmanParameters, optional
        Where the search begins; its gate is kept.

    Raises
    ------
    ValueError
        As `most_likely`.
    """
    p = start or KalmanParameters()
    found = most_likely(data, image_model(p), Model._fields[:4])
    return KalmanParameters(*found[:4], gate_probability=p.gate_probability)


def nis_band(count: int, dof: int = 2, share: float = 0.95) -> tuple[float, float]:
    """Where the mean of `count` NIS lies with probability `share` if the model holds; each has `dof` coordinates.

    The sum of independent chi-squares is one. Raises ValueError if a count is not positive or the share not in (0, 1).
    """
    n, m = as_whole(count, "count", 1), as_whole(dof, "dof", 1)
    tail = (1 - as_number(share, "share", 1e-9, 1 - 1e-9)) / 2
    low, high = chdtri(n * m, [1 - tail, tail]) / n
    return float(low), float(high)


def pose_models(p: PoseFilterParameters, fading_s: float = FADING_S) -> tuple[Model, Model]:
    """The pose filter's model of one axis of the position (mm), and of one of the rotation (rad)."""
    position = Model(p.jerk_mm, p.floor_mm, p.speed_mm_s, 10 * p.speed_mm_s, fading_s)
    return position, Model(p.jerk_rad, p.floor_rad, p.turn_rad_s, 10 * p.turn_rad_s, fading_s)


def pose_paths(poses: RigidTransform, p: PoseFilterParameters, rng: np.random.Generator) -> tuple[Array, Array]:
    """What the pose filter observes, axis by axis: positions, mm, and angles turned, rad, shape (k, 3) each.

    The angles are the sums of the turns from pose to pose, in the world frame. Both get noise as large as the filter's
    floor, which is what it believes of poses without a covariance of their own.
    """
    turns = (poses.rotation[1:] * poses.rotation[:-1].inv()).as_rotvec()
    angles = np.vstack([np.zeros((1, 3)), turns.cumsum(axis=0)])
    noise = as_rng(rng).standard_normal((2, len(angles), 3))
    return poses.translation + p.floor_mm * noise[0], angles + p.floor_rad * noise[1]


def tune_pose(data: Sequence[tuple[ArrayLike, RigidTransform]], rng: np.random.Generator,
              p: PoseFilterParameters | None = None,
              free: Sequence[str] = ("jerk_intensity", "fading_s")) -> tuple[Model, Model]:
    """The pose filter's models of position and rotation under which motions were most likely.

    Parameters
    ----------
    data : sequence of (times_s, poses)
        Times (k + 1,), s, and the true poses then.
    rng : numpy.random.Generator
        Of the noise, see `pose_paths`.
    p : PoseFilterParameters, optional
        What the filter believes of the noise and of the start.
    free : sequence of str
        What is fitted of each model.

    Raises
    ------
    ValueError
        As `most_likely`.
    """
    p = p or PoseFilterParameters()
    paths = [(times, *pose_paths(poses, p, rng)) for times, poses in data]
    position, rotation = pose_models(p)
    return (most_likely([(times, places) for times, places, _ in paths], position, free),
            most_likely([(times, angles) for times, _, angles in paths], rotation, free))


@lru_cache(maxsize=4096)
def _unit_noise(dt: float) -> Array:
    """Q of one coordinate for a jerk of intensity 1, shape (3, 3)."""
    return white_jerk(dt, 1.0)[::2, ::2]
