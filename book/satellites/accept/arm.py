"""A7: the arm that follows the handle: five poses thirty times, and a circle and a square, led by a
handle as noisy as it was measured at rest.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import Array
from trinolab.slave.arm import load_robot
from workbench.intervals import by_bootstrap
from workbench.studies.master_slave import STILL_S
from workbench.studies.master_slave import run as run_trial

from . import figures
from .numbers import SIMULATED, Answer, Number, Picture
from .setup import Setup

NAME = "A7"
TITLE = "The arm"
CORNERS_MM = np.array([[0, 0, 0], [60, 60, 60], [-60, 60, 60], [-60, -60, -60], [60, -60, -60.0]])
MOVE_S, DWELL_S = 0.8, 0.6
CYCLES, TOGETHER = 30, 5  # of the five poses, and those of a part
FEWEST = 2 * TOGETHER
SPEED_MM_S = 100.0
RADIUS_MM, SIDE_MM = 50.0, 80.0
ROUNDS, LEAD_S = 10, 1.0  # of a path, behind one that is not counted, and the rest before it
STATIONS = 72  # of a path, at which its rounds are compared
SHAPES = ("circle", "square")
_ORIGIN = np.zeros(3)
AWAY_MM = 8.0  # from a corner of the square, where stations begin: its corners are cut


class Noise(NamedTuple):
    """Of the handle's measured pose about each axis, mm and deg, and where it comes from."""

    mm: float
    deg: float
    source: str


def why_not() -> str:
    """Why the test cannot be run; empty if it can."""
    missing = [name for name in ("mujoco", "mink") if find_spec(name) is None]
    return f"needs the package {missing[0]} (extra 'slave')" if missing else ""


def parts(setup: Setup) -> int:
    """Groups of cycles, and the two paths."""
    return cycles(setup) // TOGETHER + len(SHAPES)


def cycles(setup: Setup) -> int:
    """How often the five poses are taken."""
    return CYCLES if setup.poses >= 64 else FEWEST


def run(setup: Setup, k: int, noise: Noise) -> dict[str, Any]:
    """Lead the arm through a group of cycles, or along a path."""
    robot = load_robot()
    groups = cycles(setup) // TOGETHER
    rng = setup.rng(NAME, k)
    options: Any = {"noise_mm": noise.mm, "noise_deg": noise.deg, "rng": rng}
    if k < groups:
        duration = TOGETHER * len(CORNERS_MM) * (MOVE_S + DWELL_S)
        trial = run_trial(robot, five_poses, duration_s=duration, **options)
        ends = STILL_S + (np.arange(TOGETHER * len(CORNERS_MM)) + 1) * (MOVE_S + DWELL_S)
        rows = np.searchsorted(trial.t_s, ends - 1e-6) - 1
        stages = {name: trial.stages[name] for name in ("hand", "tool")}
        return {
            name: {
                "positions": poses.translation[rows].tolist(),
                "quaternions": poses.rotation.as_quat()[rows].tolist(),
            }
            for name, poses in stages.items()
        }
    shape = SHAPES[k - groups]
    duration = LEAD_S + (1 + ROUNDS) * length_of(shape) / SPEED_MM_S + 0.5
    trial = run_trial(robot, lambda t: along(shape, t), duration_s=duration, **options)
    fine = slice(None, None, 5)  # a hundred a second
    return {
        "t_s": trial.t_s[fine].tolist(),
        **{name: trial.stages[name].translation[fine].tolist() for name in ("hand", "tool")},
    }


def five_poses(times: Array) -> RigidTransform:
    """A hand that goes from one of five poses to the next, smoothly (minimum jerk), and rests
    there.

    Beside its place each has a turn of its own, up to 15 deg.
    """
    since = np.maximum(times - STILL_S, 0.0)
    number, part = np.divmod(since, MOVE_S + DWELL_S)
    s = np.clip(part / MOVE_S, 0.0, 1.0)
    share = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
    count = len(CORNERS_MM)
    before, after = number.astype(int) % count, (number.astype(int) + 1) % count
    turns = np.deg2rad(15.0) * CORNERS_MM[:, [1, 2, 0]] / np.abs(CORNERS_MM).max()

    def between(values: Array) -> Array:
        return values[before] + share * (values[after] - values[before])

    return RigidTransform.from_components(
        between(CORNERS_MM) + [0.0, 0.0, 570.0], Rotation.from_rotvec(between(turns))
    )


def length_of(shape: str) -> float:
    """Of one round, mm."""
    return 2 * np.pi * RADIUS_MM if shape == "circle" else 4 * SIDE_MM


def along(shape: str, times: Array) -> RigidTransform:
    """A hand that goes along a circle or a square in the plane across the sight, at one speed, once
    it has rested.
    """
    distance = SPEED_MM_S * np.maximum(times - STILL_S - LEAD_S, 0.0)
    place = place_on(shape, distance)
    turn = Rotation.identity(len(place))
    return RigidTransform.from_components(place + [0.0, 0.0, 570.0], turn)


def place_on(shape: str, way: Array) -> Array:
    """The point of a path that is so far along it, mm; (n, 3), the path begins at the origin."""
    if shape == "circle":
        angle = way / RADIUS_MM
        return RADIUS_MM * np.column_stack([np.cos(angle) - 1, np.sin(angle), 0 * angle])
    side, rest = np.divmod(way, SIDE_MM)
    side = side.astype(int) % 4
    corners = SIDE_MM * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    steps = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]])
    return corners[side] + rest[:, None] * steps[side]


class Attained(NamedTuple):
    """What is said of n attained positions about a commanded one, mm.

    Attributes
    ----------
    accuracy : float
        Distance of their mean from the commanded one.
    repeatability : float
        Mean distance from their mean, and three of its standard deviations more.
    """

    accuracy: float
    repeatability: float


def attained(positions: Array, commanded: Array) -> Attained:
    """Accuracy and repeatability in the form of ISO 9283 (AP and RP; its text was not followed)."""
    mean = positions.mean(axis=0)
    away = np.linalg.norm(positions - mean, axis=1)
    return Attained(
        float(np.linalg.norm(mean - commanded)), float(away.mean() + 3 * away.std(ddof=1))
    )


def crossings(path: Array, times: Array, point: Array, forward: Array, due: Array) -> Array:
    """Where a path crosses the plane through a point across a direction, once a round.

    Parameters
    ----------
    path : ndarray, shape (n, 3)
        mm, at `times`, s.
    times : ndarray, shape (n,)
    point, forward : ndarray, shape (3,)
        Of the commanded path, and its direction there.
    due : ndarray, shape (k,)
        When each round is commanded to be there; it comes up to half a second later.

    Returns
    -------
    ndarray, shape (k, 3)
        NaN where it does not come.
    """
    ahead = (path - point) @ forward
    places = np.full((len(due), 3), np.nan)
    for i, t in enumerate(due):
        near = np.flatnonzero((times >= t - 0.02) & (times <= t + 0.5))
        crossed = [j for j in near[:-1] if ahead[j] <= 0 < ahead[j + 1]]
        if crossed:
            j = crossed[0]
            share = -ahead[j] / (ahead[j + 1] - ahead[j])
            places[i] = path[j] + share * (path[j + 1] - path[j])
    return places


def judge(setup: Setup, found: list[dict[str, Any]], noise: Noise) -> Answer:
    """Accuracy and repeatability of the five poses, and of the two paths."""
    groups = cycles(setup) // TOGETHER
    answer = Answer(pose_numbers(setup, found[:groups]))
    for shape, trial in zip(SHAPES, found[groups:], strict=True):
        numbers, picture = path_numbers(setup, shape, trial)
        answer.numbers += numbers
        answer.pictures.append(picture)
    answer.notes.append(
        "A simulated six-axis arm with its servos follows a hand through mapping, reference and "
        f"inverse kinematics, 30 poses per second, with the noise that {noise.source} "
        f"({1e3 * noise.mm:.2g} µm and {1e3 * noise.deg:.2g} mdeg about each axis, one standard "
        f"deviation). Five poses, {cycles(setup)} times each, read {DWELL_S:g} s after the hand "
        f"has come to rest; a circle of {RADIUS_MM:g} mm radius and a square of {SIDE_MM:g} mm, "
        f"{ROUNDS} rounds each at {SPEED_MM_S:g} mm/s. In the form of ISO 9283: accuracy is the "
        "distance of the mean from the commanded pose or path, repeatability the mean distance "
        "from that mean and three standard deviations more; of a path the largest of "
        f"{STATIONS} stations, {AWAY_MM:g} mm or more from a corner. The arm's gears, joints and "
        "its own calibration are ideal: a real arm adds its own errors."
    )
    return answer


def pose_numbers(setup: Setup, groups: list[dict[str, Any]]) -> list[Number]:
    def stacked(stage: str, what: str) -> Array:
        return np.concatenate([np.array(group[stage][what]) for group in groups])

    tool, hand = stacked("tool", "positions"), stacked("hand", "positions")
    turned = Rotation.from_quat(stacked("tool", "quaternions"))
    wanted = Rotation.from_quat(stacked("hand", "quaternions"))
    angles = np.rad2deg((turned * wanted.inv()).magnitude())
    off = tool - hand
    count = len(CORNERS_MM)
    each = [off[k::count] for k in range(count)]
    n = len(off)

    def worst(kind: str) -> Number:
        values = [getattr(attained(rows, _ORIGIN), kind) for rows in each]
        k = int(np.argmax(values))
        number = Number(
            NAME, f"five poses, {kind}", "worst pose", values[k], "mm", n, setup.seed, SIMULATED
        )
        return number.within(
            by_bootstrap(each[k], lambda rows: getattr(attained(rows, _ORIGIN), kind))
        )

    mean = Number(
        NAME,
        "five poses, angle error",
        "mean",
        float(angles.mean()),
        "deg",
        n,
        setup.seed,
        SIMULATED,
    )
    return [
        worst("accuracy"),
        worst("repeatability"),
        mean.within(by_bootstrap(angles, lambda rows: float(rows.mean()))),
    ]


def path_numbers(setup: Setup, shape: str, trial: dict[str, Any]) -> tuple[list[Number], Picture]:
    """Accuracy and repeatability of a path, and its picture."""
    points, off = off_path(shape, trial)
    rounds = np.moveaxis(off, 0, 1)  # the rounds are what is independent

    def largest(kind: str, chosen: Array) -> float:
        return max(getattr(attained(one, _ORIGIN), kind) for one in np.moveaxis(chosen, 0, 1))

    numbers = []
    for kind in ("accuracy", "repeatability"):
        statistic = partial(largest, kind)
        number = Number(
            NAME,
            f"{shape}, path {kind}",
            "worst station",
            statistic(rounds),
            "mm",
            off.shape[0] * off.shape[1],
            setup.seed,
            SIMULATED,
        )
        numbers.append(number.within(by_bootstrap(rounds, statistic)))
    mean = off.mean(axis=1)
    longest = float(np.linalg.norm(mean, axis=1).max())
    factor = 10.0 ** np.floor(np.log10(0.2 * RADIUS_MM / max(longest, 1e-9)))
    # two directions of the path's plane
    flat = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][:2]
    picture = Picture(
        shape,
        f"The commanded {shape} as dots, and the mean way of the tool, whose distance from it is "
        f"drawn {factor:g} times as large.",
        figures.as_png(figures.plot_path(points @ flat.T, mean @ flat.T, factor)),
    )
    return numbers, picture


def off_path(shape: str, trial: dict[str, Any]) -> tuple[Array, Array]:
    """The stations of a commanded path (k, 3) and how far the tool is from each in each round,
    (k, rounds, 3), mm; those at which it does not come by in some round are left out.
    """
    times = np.array(trial["t_s"])
    tool, hand = np.array(trial["tool"]), np.array(trial["hand"])
    points, off = [], []
    for at in stations(shape):
        rounds = 1 + np.arange(ROUNDS)  # the first one begins at rest
        due = (at + rounds * length_of(shape)) / SPEED_MM_S + STILL_S + LEAD_S
        point, ahead = np.stack(
            [np.interp([due[0], due[0] + 0.01], times, column) for column in hand.T], axis=1
        )
        forward = (ahead - point) / np.linalg.norm(ahead - point)
        away = crossings(tool, times, point, forward, due) - point
        if np.isfinite(away).all():
            points.append(point)
            off.append(away)
    return np.array(points), np.array(off)


def stations(shape: str) -> Array:
    """Ways along one round at which rounds are compared, mm; none near a corner."""
    distance = (np.arange(STATIONS) + 0.5) / STATIONS * length_of(shape)
    if shape == "circle":
        return distance
    from_corner = np.abs((distance + SIDE_MM / 2) % SIDE_MM - SIDE_MM / 2)
    return distance[from_corner >= AWAY_MM]
