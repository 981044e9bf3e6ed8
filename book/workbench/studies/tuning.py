"""Q, R and the first covariance from data: the most likely ones, by what a filter expected and what
came (Sect. 4.2).

In the model of `kalman` a coordinate does not know of the others, and coordinates that are observed
at the same times with the same noise share one covariance. So any number of tracks is one filter of
three numbers, place, velocity and acceleration, and its likelihood is quick enough to be maximised.
The pose's filter (`posefilter`) is of the same kind, but its acceleration fades. The motions are a
person's, as drawn by `bench.motion` and as recorded, seen without a single image. Chapter 4.
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

from trinolab.bench.motion import human_motion
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_array, as_number, as_rng, as_whole, frozen
from trinolab.datasets import load_handle, load_real_sets, load_rig
from trinolab.files.fetch import why_not
from trinolab.following.posefilter import FADING_S, PoseFilterParameters, transition
from trinolab.handle import Handle, slants
from trinolab.kalman import (
    MIN_DT_S,
    KalmanParameters,
    compare,
    correct,
    propagate,
    white_jerk,
)
from trinolab.window import Window

from .real_recordings import load_trajectories

FPS = 30.0
# a marker is found up to this slant, give or take, anew at each instant
FOUND_DEG, SCATTER_DEG = 91.0, 2.7
SETTLED_S = 2.0  # each motion begins in the middle of its ranges


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


class Innovations(NamedTuple):
    """Observations less predictions, shape (k, m), and the variance that they should have, shape
    (k,).
    """

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


def innovations(times_s: ArrayLike, z: ArrayLike, model: Model) -> Innovations:
    """Filter coordinates that are all observed at the same times, and keep what each observation
    was off (Eq. 9-15).

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
    # a column a coordinate, one P for all
    x = np.zeros((3, seen.shape[1]))
    P = np.diag(np.square(model[1:4]))
    x[0] = seen[0]
    H = np.eye(1, 3)
    R = np.array([[model.sigma**2]])
    residuals = np.empty((len(times) - 1, seen.shape[1]))
    variances = np.empty(len(times) - 1)
    for k, dt in enumerate(np.diff(times).tolist()):
        x, P = propagate(
            x, P, transition(dt, model.fading_s), model.jerk_intensity * _unit_noise(dt)
        )
        r, S = compare(x, P, seen[k + 1], H, R)
        x, P = correct(x, P, r, S, H, R)
        residuals[k], variances[k] = r[0], S[0, 0]
    return Innovations(frozen(residuals), frozen(variances))


def most_likely(
    data: Sequence[tuple[ArrayLike, ArrayLike]], start: Model, free: Sequence[str]
) -> Model:
    """The model under which the observations were most likely.

    Parameters
    ----------
    data : sequence of (times_s, z)
        As for `innovations`; several if not all coordinates are observed at the same times.
    start : Model
        Where the search begins.
    free : sequence of str
        The fields to be found, all positive and finite at the start; the others are kept.

    Raises
    ------
    ValueError
        As `innovations`, or if a free field is not positive and finite.
    """
    first = np.log([as_number(getattr(start, name), name, 0.0, open_low=True) for name in free])

    def cost(logs: Array) -> float:
        model = start._replace(**dict(zip(free, np.exp(logs).tolist(), strict=True)))
        return -sum(innovations(times, z, model).log_likelihood for times, z in data)

    optimum = minimize(cost, first, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2}).x
    return start._replace(**dict(zip(free, np.exp(optimum).tolist(), strict=True)))


def image_model(p: KalmanParameters) -> Model:
    """The image's filter as a model of one coordinate, px."""
    return Model(p.jerk_intensity, p.sigma_px, p.velocity_sigma, p.acceleration_sigma)


def tune_image(
    data: Sequence[tuple[ArrayLike, ArrayLike]], start: KalmanParameters | None = None
) -> KalmanParameters:
    """Q, R and the first covariance of the image's filter that make tracks of points most likely.

    Parameters
    ----------
    data : sequence of (times_s, uv)
        Times (k + 1,), s, and the coordinates seen then, px, shape (k + 1, m): of each point two
        columns.
    start : KalmanParameters, optional
        Where the search begins; its gate is kept.

    Raises
    ------
    ValueError
        As `most_likely`.
    """
    p = start or KalmanParameters()
    likeliest = most_likely(data, image_model(p), Model._fields[:4])
    return KalmanParameters(*likeliest[:4], gate_probability=p.gate_probability)


def nis_band(count: int) -> tuple[float, float]:
    """Where the mean of `count` NIS of two coordinates lies with a probability of 95 % if the model
    holds: the sum of independent chi-squares is one. Raises ValueError for a count below 1.
    """
    n = as_whole(count, "count", 1)
    low, high = chdtri(2 * n, [0.975, 0.025]) / n
    return float(low), float(high)


def pose_models(p: PoseFilterParameters) -> tuple[Model, Model]:
    """The pose filter's model of one axis of the position (mm), and of one of the rotation
    (rad).
    """
    position = Model(p.jerk_mm, p.floor_mm, p.speed_mm_s, 10 * p.speed_mm_s, FADING_S)
    return position, Model(p.jerk_rad, p.floor_rad, p.turn_rad_s, 10 * p.turn_rad_s, FADING_S)


def pose_paths(
    poses: RigidTransform, p: PoseFilterParameters, rng: np.random.Generator
) -> tuple[Array, Array]:
    """What the pose filter observes, axis by axis: positions, mm, and angles turned, rad, shape (k,
    3) each.

    The angles are the sums of the turns from pose to pose, in the world frame. Both get noise as
    large as the filter's floor, which is what it believes of poses without a covariance of their
    own.
    """
    turns = (poses.rotation[1:] * poses.rotation[:-1].inv()).as_rotvec()
    angles = np.vstack([np.zeros((1, 3)), turns.cumsum(axis=0)])
    noise = as_rng(rng).standard_normal((2, len(angles), 3))
    return poses.translation + p.floor_mm * noise[0], angles + p.floor_rad * noise[1]


def tune_pose(
    data: Sequence[tuple[ArrayLike, RigidTransform]],
    rng: np.random.Generator,
    free: Sequence[str] = ("jerk_intensity", "fading_s"),
) -> tuple[Model, Model]:
    """The pose filter's models of position and rotation under which motions were most likely.

    Parameters
    ----------
    data : sequence of (times_s, poses)
        Times (k + 1,), s, and the true poses then.
    rng : numpy.random.Generator
        Of the noise, see `pose_paths`.
    free : sequence of str
        What is fitted of each model.

    Raises
    ------
    ValueError
        As `most_likely`.
    """
    p = PoseFilterParameters()
    paths = [(times, *pose_paths(poses, p, rng)) for times, poses in data]
    position, rotation = pose_models(p)
    return (
        most_likely([(times, places) for times, places, _ in paths], position, free),
        most_likely([(times, angles) for times, _, angles in paths], rotation, free),
    )


@lru_cache(maxsize=4096)
def _unit_noise(dt: float) -> Array:
    """Q of one coordinate for a jerk of intensity 1, shape (3, 3)."""
    return white_jerk(dt, 1.0)[::2, ::2]


def found_centres(
    camera: Camera, handle: Handle, poses: RigidTransform, rng: np.random.Generator
) -> Array:
    """Centres of the rectangles around the markers that a camera finds, shape (k, 2), px; NaN where
    it finds none.

    Nothing is rendered. Of the markers at the limb some are found at one instant and not at the
    next, so that the rectangle changes though the handle hardly does: each is found up to a slant
    of 91 deg, with a standard deviation of 2.7 deg. So it was in the windows of `markertrack`, over
    5 s of the calm recordings with the seeds 1 and 2.
    """
    limits = np.deg2rad(
        as_rng(rng).normal(FOUND_DEG, SCATTER_DEG, (len(poses), len(handle.marker_centres)))
    )
    boxes = [
        Window.around(
            camera.project(T.apply(handle.marker_centres))[slants(handle, T, camera.centre) < limit]
        )
        for T, limit in zip(poses, limits, strict=True)
    ]
    return np.array([(np.nan, np.nan) if box is None else box.centre for box in boxes])


def drawn_poses(seed: int, seconds: float) -> tuple[Array, RigidTransform]:
    """Times, s, at 30 instants per second, and poses of a person's motion, other than those of a
    standard recording.
    """
    times = np.arange(round(as_number(seconds, "seconds", 0.1) * FPS)) / FPS
    return times, human_motion(np.random.default_rng(seed), times + SETTLED_S)


def drawn_tracks(
    rig: Rig,
    handle: Handle,
    seeds: Sequence[int],
    rng: np.random.Generator,
    seconds: float = 2.0,
    stretches: int = 5,
) -> tuple[Array, Array]:
    """Times, s, and the coordinates that all cameras see of persons' motions, cut into stretches;
    for `tune_image`.
    """
    columns = []
    for seed in seeds:
        times, poses = drawn_poses(seed, seconds * stretches)
        for camera in rig.cameras:
            columns += np.split(found_centres(camera, handle, poses, rng), stretches)
    return times[: len(columns[0])], np.hstack(columns)


def seconds_nis(
    rig: Rig, handle: Handle, p: KalmanParameters, seeds: Sequence[int], rng: np.random.Generator
) -> Array:
    """Mean NIS of single seconds of persons' motions, ten a seed, as each camera sees them.

    The cameras watch the same motion: their innovations are not independent of each other, and a
    band for one camera is none for the mean of all.

    Returns
    -------
    ndarray, shape (10 * seeds, cameras)
    """
    times, z = drawn_tracks(rig, handle, seeds, rng, seconds=1.0, stretches=10)
    squared = innovations(times, z, image_model(p)).squared
    # instant, seed, camera, stretch, coordinate
    each = squared.reshape(len(times) - 1, len(seeds), len(rig.cameras), 10, 2)
    means = 2 * each.mean(axis=(0, 4))
    return means.swapaxes(1, 2).reshape(-1, len(rig.cameras))


def handheld_poses() -> tuple[Array, RigidTransform] | None:
    """Times and poses of the recorded handheld motion, every third of its 100 per second; None if it
    is not here.
    """
    recorded = load_trajectories()
    return None if recorded is None else (recorded.t_s[::3], recorded.poses[::3])


def judge(data: Sequence[tuple[Array, RigidTransform]], models: tuple[Model, Model]) -> list[str]:
    """A line each for the position and the rotation: log-likelihood an observation, and mean NIS of
    the three axes.
    """
    p = PoseFilterParameters()
    lines = []
    rng = np.random.default_rng(1)  # one source: each motion has noise of its own
    paths = [(times, pose_paths(poses, p, rng)) for times, poses in data]
    for kind, (name, model) in enumerate(zip(("position", "rotation"), models, strict=True)):
        runs = [innovations(times, both[kind], model) for times, both in paths]
        axes = np.concatenate([one.squared for one in runs]).mean(axis=0)
        likely = sum(one.log_likelihood for one in runs) / sum(one.residuals.size for one in runs)
        lines.append(
            f"{name}: jerk {model.jerk_intensity:9.3g}, fading {model.fading_s:5.3g} s; log-likelihood "
            f"{likely:6.3f}, NIS {axes.sum():5.2f} of 3, by axes {np.round(axes, 2)}"
        )
    return lines


def print_most_likely() -> None:
    """Print what is most likely for the image's filter and the pose's."""
    tracks = drawn_tracks(
        load_rig("raised_40deg"), load_handle("coded"), range(1, 9), np.random.default_rng(0)
    )
    print("image:", tune_image([tracks]))
    sets = {"drawn": [drawn_poses(seed, 10.0) for seed in range(1, 9)]}
    if (held := handheld_poses()) is not None:
        sets["handheld"] = [held]
    models = {"as it is": pose_models(PoseFilterParameters())}
    for name, data in sets.items():
        models[f"fitted to {name}"] = tune_pose(data, np.random.default_rng(0))
        models[f"fitted to {name}, fading kept"] = tune_pose(
            data, np.random.default_rng(0), free=("jerk_intensity",)
        )
    for name, data in sets.items():
        for which, both in models.items():
            print(f"pose, {name} motion, {which}:", *judge(data, both), sep="\n    ")
    if "handheld" not in sets:
        print("handheld motion: not here,", why_not(load_real_sets()["trajectories"]))
