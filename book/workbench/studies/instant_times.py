"""How long an instant of a track takes, beside SimpleBlobDetector on the same images, and how far
off its pose is: instant_times.csv, instant_films.csv.

    python -m workbench.studies instant_times

follows the standard films again, each in many draws of its noise. A time is processor time of one
core, divided by the median that OpenCV's SimpleBlobDetector takes for the images of an instant of the
same film in the same run: the ratio hangs less on the machine, and on what else it does, than a time.
Of instant_times.csv, the instants of chapter 11b, what is `after` is renewed; what is `before` stays
as it was taken with the code of commit 8d064b1, where each moving fit drew the handle at up to 20 times
of the exposure.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import tracker
from trinolab.bench.motion import human_motion
from trinolab.bench.scenario import (
    HOLDING,
    Job,
    Shot,
    calm,
    empty,
    hard,
    light_of,
    noisy,
    seen_markers,
)
from trinolab.bench.scene import EXPOSURE_S
from trinolab.camera import Rig
from trinolab.checks import Array, as_whole
from trinolab.datasets import load_handle, load_real_sets, load_rig, load_sweep
from trinolab.files.fetch import why_not
from trinolab.following import posetracker
from trinolab.following.look import prepare
from trinolab.following.parameters import FollowParameters
from trinolab.handle import Handle
from trinolab.methods import BEST
from trinolab.metrics import can_be_measured, geodesic_deg, nees, position_errors
from trinolab.pose import Pose

from ..intervals import TOGETHER, of_series, ratio
from ..teleop import task
from .carrier import results_of
from .real_recordings import at_times, before_the_cameras, load_trajectories
from .replication import WRONG_DEG, WRONG_MM

FPS = 30.0
USUAL_MS, SHORT_MS = 10.0, 6.0  # exposures
# to and fro, and about an axis that is no symmetry of anything
FAST_MM, FAST_HZ, FAST_WAY = 80.0, 1.6, np.array([1.0, 0.3, 0.2])
FAST_RAD_S, FAST_TURN_HZ = np.array([0.5, 2.0, 1.0]), 0.7
MIDDLE_MM = np.array([0.0, 0.0, 570.0])  # of the standard scene
LENS = np.array([-0.2, 0.1, 1e-3, -1e-3, 0.0])  # of `silent`: 12 px in an image's corner
KEYS = ["motion", "exposure_ms", "seed", "frame"]
WARM_UP = 3  # instants that are followed before time is taken: what is made once


class Film(NamedTuple):
    """A motion that is rendered and followed from its first instant on.

    Attributes
    ----------
    motion : str
        ``calm`` and ``hard``: see `bench.scenario`; ``fast``; ``task``: see `teleop.task`;
        ``silent``: `calm` before lenses with distortion, with a rig file that says nothing of its
        errors; ``real``: a recorded motion, see `real`.
    exposure_ms : float
    seed : int
    instants : int
    draws : int
        How often each instant is taken, each time with other noise.
    """

    motion: str
    exposure_ms: float
    seed: int
    instants: int
    draws: int = 1


# A second hand, the step of the light and a covered camera are in the first five seconds of `hard`,
# darkness, loss and return in the task. Nothing smears the images of `calm` and of the task: one
# exposure will do. The last one is the whole of the longest real recording of a motion.
FILMS = (
    Film("hard", USUAL_MS, 0, 150),
    Film("hard", SHORT_MS, 1, 150),
    Film("fast", USUAL_MS, 0, 45),
    Film("fast", SHORT_MS, 1, 45),
    Film("calm", USUAL_MS, 0, 70),
    Film("task", USUAL_MS, 0, 225),
    Film("silent", USUAL_MS, 0, 70),
    Film("real", USUAL_MS, 0, 900),
)
IN_CHAPTER = FILMS[:6]  # 11b


def films(instants: int = 10_000) -> list[Film]:
    """The standard films with so many draws of their noise that each has its share of the instants;
    one that has more instants than that is cut. `real` is left out, with a line that says why, where
    its recording is not on this machine.
    """
    share = -(-as_whole(instants, "instants", low=len(FILMS)) // len(FILMS))
    chosen = [
        film._replace(instants=min(film.instants, share), draws=-(-share // film.instants))
        for film in FILMS
    ]
    if load_trajectories() is not None:
        return chosen
    print(f"real: left out, {why_not(load_real_sets()['trajectories'])}", file=sys.stderr)
    return [film for film in chosen if film.motion != "real"]


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
        "silent": calm,
        "real": real,
    }
    if film.motion not in motions:
        raise ValueError(f"motion: expected one of {', '.join(motions)}, task, got {film.motion}")
    rig = load_rig("raised_40deg")
    if film.motion == "silent":
        cameras = tuple(replace(camera, distortions=LENS) for camera in rig.cameras)
        rig = replace(rig, cameras=cameras, covariance=None)
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


def real(rig: Rig, times_s: Array, seed: int) -> list[Shot]:
    """A hand that a motion capture recorded for 30 s, at its true pace and size, before the bench's
    cameras: its way is wider than the images, which it leaves and enters again. Nothing is drawn by
    `seed`.

    Raises
    ------
    ValueError
        If the recording is not on this machine.
    """
    recorded = load_trajectories()
    if recorded is None:
        raise ValueError(f"real: {why_not(load_real_sets()['trajectories'])}")
    moved = before_the_cameras(recorded)
    begin, middle, end = (
        at_times(moved, times_s + share * EXPOSURE_S) for share in (0.0, 0.5, 1.0)
    )
    velocities = (end.translation - begin.translation) / EXPOSURE_S
    turns = (end.rotation * begin.rotation.inv()).as_rotvec() / EXPOSURE_S
    lights = (1.0,) * len(rig.cameras)
    return [
        Shot(pose, HOLDING, lights, velocity, turn_rate, False)
        for pose, velocity, turn_rate in zip(middle, velocities, turns, strict=True)
    ]


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
    prepare()  # not at the expense of the first instant

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


def followed(film: Film, method: str = BEST) -> pd.DataFrame:
    """Follow a film: what each instant takes, and how far off its pose is.

    Parameters
    ----------
    film : Film
    method : str
        Of `METHODS`.

    Returns
    -------
    DataFrame
        One row per instant and draw: `motion`, `exposure_ms`, `seed`, `frame`, `draw`; `ms` of processor
        time, `blobs_ms`, what SimpleBlobDetector takes for the images of the first draw, and `ratio`,
        of `ms` to its median over the film; `possible`, whether enough markers are seen to measure
        (`can_be_measured`); `mm` and `deg` by which a measured pose is off, and `nees`, its normalised
        error squared, NaN where there is none.
    """
    cv2.setNumThreads(1)
    job = job_of(film)
    begin, step = METHODS[method](job, film.exposure_ms)
    detector = blob_detector(job.rig, job.handle)
    possible = can_be_measured([seen_markers(job, k) for k in range(len(job.shots))])
    rows = []
    states = [begin] * film.draws
    for k, drawn in enumerate(taken(job, film.draws)):
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
                    "possible": bool(possible[k]),
                    **_errors(pose, job.shots[k].T_world_handle),
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
    if pose.status != "measured" or pose.T_world_handle is None or pose.covariance is None:
        return {"mm": np.nan, "deg": np.nan, "nees": np.nan}
    if truth is None:
        return {"mm": np.inf, "deg": np.inf, "nees": np.nan}
    estimate, true = (RigidTransform.concatenate([T]) for T in (pose.T_world_handle, truth))
    return {
        "mm": float(position_errors(estimate, true)[0]),
        "deg": float(geodesic_deg(estimate, true)[0]),
        "nees": float(nees(pose.T_world_handle, pose.covariance, truth)[0]),
    }


def all_followed(
    chosen: Sequence[Film], method: str, workers: int, kept: Path | None = None
) -> list[pd.DataFrame]:
    """`followed` for many films, in their order; `kept` is a file for finished ones."""
    order = sorted(chosen, key=lambda film: -film.instants)
    settings = [{"film": film, "method": method} for film in order]
    columns = results_of(method, _columns, settings, workers, kept)
    tables = dict(zip(order, map(pd.DataFrame, columns), strict=True))
    return [tables[film] for film in chosen]


def _columns(film: Film, method: str) -> dict:
    return followed(film, method).to_dict("list")


# --- the tables


SHARES = {"median": 0.5, "99": 0.99, "999": 0.999, "worst": 1.0}


def make_tables(instants: int, workers: int, kept: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The instants of chapter 11b, and one row per film.

    Parameters
    ----------
    instants : int
        Of all films, see `films`.
    workers : int
        Processes.
    kept : Path
        Folder for finished films.
    """
    tables = all_followed(films(instants), BEST, workers, kept / "films.jsonl")
    new = pd.concat(tables, ignore_index=True)
    return chapter_rows(new), film_rows(new)


def chapter_rows(new: pd.DataFrame) -> pd.DataFrame:
    """One row per instant of the films of chapter 11b, in their first draw: the film and the frame;
    `blobs_ms`, the median that SimpleBlobDetector takes in this film; how many times as long the
    follower takes, `before` and `after`; and by how much its measured pose is off, `before_mm` and
    `after_mm`.
    """
    motions = {film.motion for film in IN_CHAPTER}
    rows = new[(new["draw"] == 0) & new["motion"].isin(motions)]
    rows = rows.rename(columns={"ratio": "after", "mm": "after_mm"})
    rows["blobs_ms"] = rows.groupby(KEYS[:3])["blobs_ms"].transform("median")
    before = load_sweep("instant_times")[[*KEYS, "before", "before_mm"]]
    table = rows[[*KEYS, "blobs_ms", "after", "after_mm"]].merge(before, how="left", on=KEYS)
    columns = {"blobs_ms": 2, "before": 4, "after": 4, "before_mm": 5, "after_mm": 5}
    return table[[*KEYS, *columns]].round(columns)


def film_rows(table: pd.DataFrame) -> pd.DataFrame:
    """One row per film, and one of all together: `numbers` and `statistics` of their instants.

    The ends of an interval of 95 % (``..._low``, ``..._high``) are by the bootstrap over blocks of
    half a second, all draws of an instant together; of a film of less than two blocks they are NaN.
    """
    parts = [*table.groupby(KEYS[:3], sort=False), (("all", np.nan, None), table)]
    rows = []
    for key, part in parts:
        row = dict(zip(KEYS[:3], key, strict=True)) | numbers(part)
        for name, (values, statistic) in statistics(part).items():
            low, high, _ = of_series(values, statistic, TOGETHER)
            row |= {name: statistic(values), f"{name}_low": low, f"{name}_high": high}
        rows.append(row)
    return pd.DataFrame(rows).astype({"seed": "Int64"}).round(5)


def numbers(rows: pd.DataFrame) -> dict[str, float]:
    """Of some instants: how many, the `draws` of their noise, `wrong` poses, off by more than 2 mm or
    5 deg; median, 99 %, 99.9 % and worst of the processor time, ms, the median that SimpleBlobDetector
    takes, `blobs_ms`, and the worst ratio to that.
    """
    times = {f"ms_{name}": np.quantile(rows["ms"], share) for name, share in SHARES.items()}
    return {
        "n": len(rows),
        "draws": rows["draw"].nunique(),
        "wrong": int(((rows["mm"] > WRONG_MM) | (rows["deg"] > WRONG_DEG)).sum()),
        "blobs_ms": rows["blobs_ms"].median(),
        **times,
        "ratio_worst": rows["ratio"].max(),
    }


def statistics(rows: pd.DataFrame) -> dict[str, tuple[Array, Callable[[Array], float]]]:
    """Statistics that are given with an interval, and the values, one row per instant, that each is taken
    of: quantiles of the ratio, the share that is `measured` of the possible instants, %, mean and root mean
    square of the errors, the mean NEES (6 if the covariances are right).
    """
    ratios = rows.pivot_table(index=KEYS, columns="draw", values="ratio", sort=False).to_numpy()
    computed: dict[str, tuple[Array, Callable[[Array], float]]] = {
        f"ratio_{name}": (ratios, partial(np.nanquantile, q=share))
        for name, share in SHARES.items()
        if share < 1
    }
    is_measured = np.isfinite(rows["mm"])

    def sums(values: pd.Series, counted: pd.Series) -> Array:
        pairs = rows[KEYS].assign(total=values.where(counted, 0.0), count=counted)
        return pairs.groupby(KEYS, sort=False)[["total", "count"]].sum().to_numpy(float)

    computed["measured"] = sums(100.0 * is_measured, rows["possible"]), ratio
    for unit in ("mm", "deg"):
        computed[f"mean_{unit}"] = sums(rows[unit], is_measured), ratio
        computed[f"rms_{unit}"] = (
            sums(rows[unit] ** 2, is_measured),
            lambda pairs: ratio(pairs) ** 0.5,
        )
    computed["nees"] = sums(rows["nees"], is_measured), ratio
    return computed


def by_film(table: pd.DataFrame) -> pd.DataFrame:
    """The shipped table of the films for a reader: times in ms, errors as root mean squares."""
    exposures = table["exposure_ms"].map(lambda ms: "" if np.isnan(ms) else f", {ms:g} ms")
    return pd.DataFrame(
        {
            "film": table["motion"] + exposures,
            "n": table["n"],
            "median / ms": table["ms_median"],
            "99 %": table["ms_99"],
            "99.9 %": table["ms_999"],
            "worst": table["ms_worst"],
            "rms mm": table["rms_mm"],
            "rms deg": table["rms_deg"],
            "NEES": table["nees"],
            "measured / %": table["measured"],
            "wrong": table["wrong"],
        }
    )
