"""How long an instant of a track takes, beside SimpleBlobDetector on the same images:
instant_times.csv.

    python -m workbench.studies instant_times

follows the standard motions again and renews what is `after`; what is `before` stays as it was taken
with the code of commit `BEFORE`, of which chapter 11b tells. A time is processor time of one core,
divided by the median that OpenCV's SimpleBlobDetector takes for the images of an instant of the same
film in the same run: the ratio hangs less on the machine, and on what else it does, than a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab import tracker
from trinolab.bench.motion import human_motion
from trinolab.bench.scenario import HOLDING, Job, Shot, calm, empty, hard, light_of, noisy
from trinolab.camera import Rig
from trinolab.checks import Array, as_whole
from trinolab.datasets import load_handle, load_rig, load_sweep
from trinolab.following import posetracker
from trinolab.following.parameters import FollowParameters
from trinolab.handle import Handle
from trinolab.methods import BEST
from trinolab.metrics import geodesic_deg, position_errors
from trinolab.pose import Pose

from ..sweep.engines import as_finished, processes
from ..teleop import task

BEFORE = "8d064b1"  # where each moving fit drew the handle at up to 20 times of the exposure
FPS = 30.0
USUAL_MS, SHORT_MS = 10.0, 6.0  # exposures
# to and fro, and about an axis that is no symmetry of anything
FAST_MM, FAST_HZ, FAST_WAY = 80.0, 1.6, np.array([1.0, 0.3, 0.2])
FAST_RAD_S, FAST_TURN_HZ = np.array([0.5, 2.0, 1.0]), 0.7
MIDDLE_MM = np.array([0.0, 0.0, 570.0])  # of the standard scene
WARM_UP = 3  # instants that are followed before time is taken: what is made once


class Film(NamedTuple):
    """A motion that is rendered and followed from its first instant on.

    Attributes
    ----------
    motion : str
        ``calm`` and ``hard``: see `bench.scenario`; ``fast``; ``task``: see `teleop.task`.
    exposure_ms : float
    seed : int
    instants : int
    """

    motion: str
    exposure_ms: float
    seed: int
    instants: int


# A second hand, the step of the light and a covered camera are in the first five seconds of `hard`,
# darkness, loss and return in the task. Nothing smears the images of `calm` and of the task: one
# exposure will do.
ROUND = (
    ("hard", USUAL_MS, 150),
    ("hard", SHORT_MS, 150),
    ("fast", USUAL_MS, 45),
    ("fast", SHORT_MS, 45),
    ("calm", USUAL_MS, 70),
    ("task", USUAL_MS, 225),
)
INSTANTS = sum(instants for _, _, instants in ROUND)


def films(instants: int = INSTANTS) -> list[Film]:
    """The standard motions in rounds, each with seeds of its own, until there are so many instants;
    each film of the last round is cut to its share.
    """
    left = as_whole(instants, "instants", low=len(ROUND))
    chosen = []
    for number in range(-(-left // INSTANTS)):
        share = min(left / INSTANTS, 1.0)
        for motion, exposure_ms, whole in ROUND:
            seed = 2 * number + (exposure_ms == SHORT_MS)
            chosen.append(Film(motion, exposure_ms, seed, max(round(share * whole), 1)))
        left -= INSTANTS
    return chosen


def job_of(film: Film) -> Job:
    """What is to be rendered for a film. ValueError for an unknown motion."""
    if film.motion == "task":
        whole = task.job(film.seed)
        shots, times = whole.shots[: film.instants], whole.times_s[: film.instants]
        return whole._replace(shots=shots, times_s=times)
    motions: dict[str, Callable[[Rig, Array, int], list[Shot]]] = {
        "calm": calm,
        "hard": hard,
        "fast": fast,
    }
    if film.motion not in motions:
        raise ValueError(f"motion: expected one of {', '.join(motions)}, task, got {film.motion}")
    rig = load_rig("raised_40deg")
    times = np.arange(film.instants) / FPS
    shots = motions[film.motion](rig, times, film.seed)
    # the bench's shutter is open for 10 ms: the way of a shorter time is that of a slower motion
    share = film.exposure_ms / USUAL_MS
    slower = [
        shot._replace(velocity=share * shot.velocity, turn_rate=share * shot.turn_rate)
        for shot in shots
    ]
    return Job(rig, load_handle("coded"), slower, times, film.seed)


def fast(rig: Rig, times_s: Array, seed: int) -> list[Shot]:
    """A hand that goes to and fro at up to 0.8 m/s, as fast as a hand can, and turns by up to 2.3
    rad/s.
    """
    phase = np.random.default_rng([seed, 7]).uniform(0, 2 * np.pi)
    first = human_motion(np.random.default_rng([seed, 9]), [0.5])[0].rotation
    way = FAST_MM * FAST_WAY / np.linalg.norm(FAST_WAY)
    omega, turning = 2 * np.pi * FAST_HZ, 2 * np.pi * FAST_TURN_HZ
    shots = []
    for t in times_s:
        turn = Rotation.from_rotvec(FAST_RAD_S * np.sin(turning * t) / turning)
        place = MIDDLE_MM + way * np.sin(omega * t + phase)
        pose = RigidTransform.from_components(place, turn * first)
        velocity = way * omega * np.cos(omega * t + phase)
        turn_rate = FAST_RAD_S * np.cos(turning * t)
        lights = (1.0,) * len(rig.cameras)
        shots.append(Shot(pose, HOLDING, lights, velocity, turn_rate, False))
    return shots


def taken(job: Job, draws: int = 1) -> Iterator[Iterator[list[np.ndarray]]]:
    """The images of each instant in each draw of their noise, made when they are asked for."""
    for k in range(len(job.shots)):
        lights = [light_of(job, k, index) for index in range(len(job.rig.cameras))]
        yield (
            [noisy(job, k, index, light, draw) for index, light in enumerate(lights)]
            for draw in range(draws)
        )


def blob_detector(
    rig: Rig, handle: Handle, lowest: float | None = None, distance_mm: float = 570.0
) -> cv2.SimpleBlobDetector:
    """Bright round blobs of a quarter to twice the area of a marker that faces a camera.

    OpenCV's own thresholds are 50, 60, ... 210; `lowest` leaves out those below it.
    """
    p = cv2.SimpleBlobDetector_Params()  # type: ignore[attr-defined]  # not in OpenCV's stubs
    area = np.pi * (handle.marker_diameter_mm / 2 * rig.cameras[0].focal[0] / distance_mm) ** 2
    p.minThreshold = p.minThreshold if lowest is None else lowest
    p.filterByColor, p.blobColor = True, 255
    p.filterByArea, p.minArea, p.maxArea = True, area / 4, 2 * area
    p.filterByInertia, p.minInertiaRatio, p.minDistBetweenBlobs = True, 0.1, 5
    p.filterByConvexity, p.minConvexity = True, 0.8
    return cv2.SimpleBlobDetector_create(p)  # type: ignore[attr-defined]


# From a state, images and a time to the next state and a pose.
Step = Callable[[Any, Sequence[np.ndarray], float], tuple[Any, Pose]]


def _best(job: Job, exposure_ms: float) -> tuple[Any, Step]:
    """The follower by pose, with the best estimator: state before the first instant, and step."""
    p = FollowParameters(estimator=BEST, exposure_s=exposure_ms / 1e3)

    def step(state: Any, images: Sequence[np.ndarray], t: float) -> tuple[Any, Pose]:
        state, one = posetracker.step(state, images, t, job.rig, job.handle, p)
        return state, one.measurement.pose

    return posetracker.start(float(job.times_s[0]) - 1.0), step


def _chain(job: Job, exposure_ms: float) -> tuple[Any, Step]:
    """The paper's chain, Eq. 5-24, which begins with images of the empty bench."""

    def step(state: Any, images: Sequence[np.ndarray], t: float) -> tuple[Any, Pose]:
        state, one = tracker.step(state, images, t, job.rig, job.handle)
        return state, one.pose

    background = [empty(job, index) for index in range(len(job.rig.cameras))]
    return tracker.start(background, job.rig, float(job.times_s[0]) - 1 / FPS), step


METHODS = {BEST: _best, "paper's chain": _chain}


def followed(film: Film, method: str = BEST, draws: int = 1) -> pd.DataFrame:
    """Follow a film: what each instant takes, and how far off its pose is.

    Parameters
    ----------
    film : Film
    method : str
        Of `METHODS`.
    draws : int
        How often the film is taken, each time with other noise.

    Returns
    -------
    DataFrame
        A row an instant and draw: `motion`, `exposure_ms`, `seed`, `frame`, `draw`; `ms` of processor
        time, `blobs_ms`, what SimpleBlobDetector takes for the images of the first draw, and `ratio`,
        of `ms` to its median over the film; `present`, whether there is a handle; `mm` and `deg` by
        which a measured pose is off, NaN where there is none.
    """
    cv2.setNumThreads(1)
    job = job_of(film)
    begin, step = METHODS[method](job, film.exposure_ms)
    detector = blob_detector(job.rig, job.handle)
    rows = []
    states = [begin] * draws
    for k, drawn in enumerate(taken(job, draws)):
        truth = job.shots[k].T_world_handle
        for draw, images in enumerate(drawn):
            if k == 0 and draw == 0:
                for ahead in range(WARM_UP):
                    step(begin, images, float(job.times_s[0]) + 1e-3 * ahead)
            started = time.process_time()
            states[draw], pose = step(states[draw], images, float(job.times_s[k]))
            ms = 1e3 * (time.process_time() - started)
            if draw == 0:
                blobs_ms = _blobs_ms(detector, images)
            rows.append(
                {
                    "motion": film.motion,
                    "exposure_ms": film.exposure_ms,
                    "seed": film.seed,
                    "frame": k,
                    "draw": draw,
                    "ms": ms,
                    "blobs_ms": blobs_ms,
                    "present": truth is not None,
                    **_errors(pose, truth),
                }
            )
    table = pd.DataFrame(rows)
    return table.assign(ratio=table["ms"] / table["blobs_ms"].median())


def _blobs_ms(detector: cv2.SimpleBlobDetector, images: Sequence[np.ndarray]) -> float:
    """Processor time that OpenCV's detector takes for the images of an instant, ms."""
    started = time.process_time()
    for image in images:
        detector.detect(image)
    return 1e3 * (time.process_time() - started)


def _errors(pose: Pose, truth: RigidTransform | None) -> dict[str, float]:
    """By how much a measured pose is off; infinite where there is no handle at all."""
    if pose.status != "measured" or pose.T_world_handle is None:
        return {"mm": np.nan, "deg": np.nan}
    if truth is None:
        return {"mm": np.inf, "deg": np.inf}
    estimate, true = (RigidTransform.concatenate([T]) for T in (pose.T_world_handle, truth))
    return {
        "mm": float(position_errors(estimate, true)[0]),
        "deg": float(geodesic_deg(estimate, true)[0]),
    }


def all_followed(chosen: Sequence[Film], method: str, workers: int, draws: int = 1) -> pd.DataFrame:
    """`followed` for many films, in their order, with a bar of the instants."""
    tables = {}
    total = sum(film.instants for film in chosen)
    with (
        processes(workers) as engine,
        tqdm(total=total, unit="instant", desc=method, disable=None) as bar,
    ):
        for film, future in as_finished(
            engine, ((film, partial(followed, method=method, draws=draws), film) for film in chosen)
        ):
            tables[film] = future.result()
            bar.update(film.instants)
    return pd.concat([tables[film] for film in chosen], ignore_index=True)


KEYS = ["motion", "exposure_ms", "seed", "frame"]


def make_table(workers: int = 1) -> pd.DataFrame:
    """A row an instant: the film and the frame; `blobs_ms`, the median that SimpleBlobDetector takes
    in this film; how many times as long the follower takes, `before` and `after`; and by how much
    its measured pose is off, `before_mm` and `after_mm`.
    """
    new = all_followed(films(), BEST, workers).rename(columns={"ratio": "after", "mm": "after_mm"})
    new["blobs_ms"] = new.groupby(KEYS[:3])["blobs_ms"].transform("median")
    before = load_sweep("instant_times")[[*KEYS, "before", "before_mm"]]
    table = new[[*KEYS, "blobs_ms", "after", "after_mm"]].merge(before, how="left", on=KEYS)
    columns = {"blobs_ms": 2, "before": 4, "after": 4, "before_mm": 5, "after_mm": 5}
    return table[[*KEYS, *columns]].round(columns)
