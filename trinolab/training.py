"""Motions to tune the filters on: a person's, as drawn by `motion` and as recorded, seen without a single image.

    python -m trinolab.training

prints the most likely parameters of the image's filter and of the pose's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Camera, Rig
from .checks import Array, as_number, as_rng
from .datasets import load_handle, load_real_sets, load_rig
from .fetch import why_not
from .handle import Handle, slants
from .image_track import draw, nees, run, track
from .kalman import (
    KalmanParameters,
    State,
    constant_acceleration,
    initial_state,
    observation_matrix,
    white_jerk,
)
from .motion import human_motion
from .posefilter import PoseFilterParameters
from .realsets import load_trajectories
from .tuning import Model, image_model, pose_models, pose_paths, surprises, tune_image, tune_pose
from .window import Window

FPS = 30.0
FOUND_DEG, SCATTER_DEG = 91.0, 2.7  # a marker is found up to this slant, give or take, anew at each instant
SETTLED_S = 2.0  # each motion begins in the middle of its ranges


def found_centres(camera: Camera, handle: Handle, poses: RigidTransform, rng: np.random.Generator) -> Array:
    """Centres of the rectangles around the markers that a camera finds, shape (k, 2), px; NaN where it finds none.

    Nothing is rendered. Of the markers at the limb some are found at one instant and not at the next, so that the
    rectangle changes though the handle hardly does: each is found up to a slant of 91 deg, with a standard deviation of
    2.7 deg. So it was in the windows of `markertrack`, over 5 s of the calm recordings with the seeds 1 and 2.
    """
    limits = np.deg2rad(as_rng(rng).normal(FOUND_DEG, SCATTER_DEG, (len(poses), len(handle.marker_centres))))
    boxes = [Window.around(camera.project(T.apply(handle.marker_centres))[slants(handle, T, camera.centre) < limit])
             for T, limit in zip(poses, limits, strict=True)]
    return np.array([(np.nan, np.nan) if box is None else box.centre for box in boxes])


def drawn_poses(seed: int, seconds: float) -> tuple[Array, RigidTransform]:
    """Times, s, at 30 instants a second, and poses of a person's motion, other than those of a standard recording."""
    times = np.arange(round(as_number(seconds, "seconds", 0.1) * FPS)) / FPS
    return times, human_motion(np.random.default_rng(seed), times + SETTLED_S)


def drawn_tracks(rig: Rig, handle: Handle, seeds: Sequence[int], rng: np.random.Generator, seconds: float = 2.0,
                 stretches: int = 5) -> tuple[Array, Array]:
    """Times, s, and the coordinates that all cameras see of persons' motions, cut into stretches; for `tune_image`."""
    columns = []
    for seed in seeds:
        times, poses = drawn_poses(seed, seconds * stretches)
        for camera in rig.cameras:
            columns += np.split(found_centres(camera, handle, poses, rng), stretches)
    return times[:len(columns[0])], np.hstack(columns)


def seconds_nis(rig: Rig, handle: Handle, p: KalmanParameters, seeds: Sequence[int],
                rng: np.random.Generator) -> Array:
    """Mean NIS of single seconds of persons' motions, ten a seed, over all cameras; shape (10 * seeds,)."""
    times, z = drawn_tracks(rig, handle, seeds, rng, seconds=1.0, stretches=10)
    squared = surprises(times, z, image_model(p)).squared  # columns: seed, camera, stretch, coordinate
    return 2 * squared.reshape(len(times) - 1, len(seeds), len(rig.cameras), 10, 2).mean(axis=(0, 2, 4)).ravel()


def model_nees(p: KalmanParameters, believed: ArrayLike, rng: np.random.Generator, draws: int = 25,
               frames: int = 30) -> Array:
    """Mean NEES of position and velocity, four numbers, over motions drawn from the model itself; shape (frames,).

    The motion starts as `p` has it; the filter starts with the covariance `believed`, shape (6, 6).
    """
    start, H, R = initial_state([0, 0], p), observation_matrix(), p.sigma_px**2 * np.eye(2)
    F, Q = constant_acceleration(1 / FPS), white_jerk(1 / FPS, p.jerk_intensity)
    values = []
    for _ in range(draws):
        truth, z = draw(start, frames, F, Q, H, R, rng)
        states = run(State(start.mean, np.asarray(believed)), z, F, Q, H, R).updated
        values.append(_nees_of_four(states, truth[:, :4]))
    return np.mean(values, axis=0)


def person_nees(camera: Camera, p: KalmanParameters, seeds: Sequence[int], rng: np.random.Generator,
                seconds: float = 10.0) -> float:
    """Mean NEES of position and velocity, four numbers, where a camera sees the origin of a person's handle with noise.

    The noise is as large as the filter believes, so that only the motion can be other than its model. The velocity is
    the true one, over 2 ms; the first second is left out.
    """
    values = []
    for seed in seeds:
        times = np.arange(round(seconds * FPS)) / FPS
        before, now, after = (camera.project(human_motion(np.random.default_rng(seed), times + SETTLED_S + step)
                                             .translation) for step in (-1e-3, 0.0, 1e-3))
        states = track(times, now + rng.normal(0.0, p.sigma_px, now.shape), p, gated=False).updated
        truth = np.hstack([now, (after - before) / 2e-3])
        values.append(_nees_of_four(states, truth)[round(FPS):])
    return float(np.mean(values))


def handheld_poses(every: int = 3) -> tuple[Array, RigidTransform] | None:
    """Times and poses of the recorded handheld motion, one of `every` of its 100 a second; None if it is not here."""
    recorded = load_trajectories()
    return None if recorded is None else (recorded.t_s[::every], recorded.poses[::every])


def _nees_of_four(states: State, truth: Array) -> Array:
    """NEES of position and velocity alone."""
    return nees(State(states.mean[:, :4], states.covariance[:, :4, :4]), truth)


def judge(data: Sequence[tuple[Array, RigidTransform]], models: tuple[Model, Model]) -> list[str]:
    """A line each for the position and the rotation: log-likelihood an observation, and mean NIS of the three axes."""
    p, lines = PoseFilterParameters(), []
    paths = [(times, pose_paths(poses, p, np.random.default_rng(1))) for times, poses in data]
    for kind, (name, model) in enumerate(zip(("position", "rotation"), models, strict=True)):
        found = [surprises(times, both[kind], model) for times, both in paths]
        axes = np.concatenate([one.squared for one in found]).mean(axis=0)
        likely = sum(one.log_likelihood for one in found) / sum(one.residuals.size for one in found)
        lines.append(f"{name}: jerk {model.jerk_intensity:9.3g}, fading {model.fading_s:5.3g} s; log-likelihood "
                     f"{likely:6.3f}, NIS {axes.sum():5.2f} of 3, by axes {np.round(axes, 2)}")
    return lines


def main() -> int:
    """Print what is most likely for the image's filter and the pose's."""
    tracks = drawn_tracks(load_rig("raised_40deg"), load_handle("coded"), range(1, 9), np.random.default_rng(0))
    print("image:", tune_image([tracks]))
    sets = {"drawn": [drawn_poses(seed, 10.0) for seed in range(1, 9)]}
    if (held := handheld_poses()) is not None:
        sets["handheld"] = [held]
    models = {"as it is": pose_models(PoseFilterParameters())}
    for name, data in sets.items():
        models[f"fitted to {name}"] = tune_pose(data, np.random.default_rng(0))
        models[f"fitted to {name}, fading kept"] = tune_pose(data, np.random.default_rng(0), free=("jerk_intensity",))
    for name, data in sets.items():
        for which, both in models.items():
            print(f"pose, {name} motion, {which}:", *judge(data, both), sep="\n    ")
    if "handheld" not in sets:
        print("handheld motion: not here,", why_not(load_real_sets()["trajectories"]))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
