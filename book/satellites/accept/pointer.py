"""A4: the handle as a pointer whose tip is 100 mm from its origin: the tip found by pivoting, its
scatter in one place, and distances that it takes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import Array
from workbench.intervals import by_bootstrap, rms

from . import tracks
from .numbers import OWN, Answer, Number, distribution, share
from .setup import Setup
from .tracks import Row, Track

NAME = "A4"
TITLE = "A pointer's tip"
TIP_MM = np.array([0.0, 100.0, 0.0])  # in the handle's frame, beyond the free end
CONE_DEG = 40.0  # of the axis about the middle direction
PIVOTED, FEWEST = 64 / 512, 8  # poses about one point, and pairs of touched points
PAIRS, FEWEST_PAIRS = 32 / 512, 4
TOGETHER = 4  # poses of a part
# A recording in which the handle turns about one point: so far its axis turns, so little the point
# scatters (rms).
PIVOT_DEG, PIVOT_MM = 20.0, 1.0


class Touches(NamedTuple):
    """Poses that hold the tip at points: n poses, and the points (n, 3), mm. The first `pivoted`
    hold it at one; then come pairs.
    """

    poses: RigidTransform
    points: Array
    pivoted: int


def touches(setup: Setup) -> Touches:
    """Draw the points and the poses; the handle's origin is in the field, its tip need not be.

    The pointer's middle direction is the first camera's downwards, so that its axis lies across the
    sight.
    """
    rng = setup.rng(NAME)
    pivoted = setup.part(PIVOTED, FEWEST)
    pairs = setup.part(PAIRS, FEWEST_PAIRS)
    down = setup.rig.cameras[0].T_world_cam.rotation.as_matrix()[:, 1]
    reach = float(np.linalg.norm(TIP_MM))
    inside = setup.field.points
    drawn = inside[rng.integers(len(inside), size=2 * pairs)]
    below = reach * np.cos(np.deg2rad(CONE_DEG / 2)) * down
    points = np.vstack([np.repeat(setup.field.centre[None], pivoted, axis=0), drawn]) + below
    poses = [touching(setup, point, down, rng) for point in points]
    return Touches(RigidTransform.concatenate(poses), points, pivoted)


def touching(
    setup: Setup, point: Array, down: Array, rng: np.random.Generator, tries: int = 1000
) -> RigidTransform:
    """A pose whose tip is at a point, its axis even in the cone, any turn, its origin in the field."""
    up = np.array([0.0, 1.0, 0.0])  # the handle's axis
    stand = Rotation.align_vectors(down[None], up[None])[0]
    for _ in range(tries):
        tilt = np.arccos(rng.uniform(np.cos(np.deg2rad(CONE_DEG)), 1.0))
        azimuth, turn = rng.uniform(0, 2 * np.pi, 2)
        side = np.array([np.cos(azimuth), 0.0, np.sin(azimuth)])
        R = stand * Rotation.from_rotvec(tilt * side) * Rotation.from_rotvec(turn * up)
        position = point - R.apply(TIP_MM)
        if setup.field.holds(position[None])[0]:
            return RigidTransform.from_components(position, R)
    raise ValueError("rig: the common field of view has no room to pivot the handle")


def parts(setup: Setup) -> int:
    """How many groups of poses. ValueError if the field has no room to pivot."""
    return -(-len(touches(setup).points) // TOGETHER)


def run(setup: Setup, k: int) -> list[Row]:
    """Render and measure a few poses, each with its own noise."""
    poses = touches(setup).poses
    part = range(k * TOGETHER, min((k + 1) * TOGETHER, len(poses)))
    return tracks.rows_at_rest(setup, NAME, poses, part)


class Pivot(NamedTuple):
    """What poses about one point say.

    Attributes
    ----------
    tip : ndarray, shape (3,)
        In the handle's frame, mm.
    point : ndarray, shape (3,)
        World frame, mm.
    off : ndarray, shape (n, 3)
        Of each pose's tip from the point, mm.
    """

    tip: Array
    point: Array
    off: Array


def calibrate_pivot(poses: RigidTransform) -> Pivot | None:
    """The point of a handle that rests while it turns: R_i tip + t_i = point for all poses, solved
    by least squares (Yaniv 2015, DOI 10.1117/12.2081348, the algebraic one-step method).

    Parameters
    ----------
    poses : RigidTransform
        n poses T_world_handle.

    Returns
    -------
    Pivot or None
        None if the poses do not turn about two axes, so that the point is not determined.
    """
    pivot, determined = _pivot(poses.as_matrix().reshape(-1, 4, 4))
    return pivot if determined else None


def _pivot(matrices: Array) -> tuple[Pivot, bool]:
    """The shortest solution, and whether it is the only one."""
    R, t = matrices[:, :3, :3], matrices[:, :3, 3]
    A = np.concatenate([R, np.broadcast_to(-np.eye(3), R.shape)], axis=2).reshape(-1, 6)
    solution, _, rank, singular = np.linalg.lstsq(A, -t.ravel(), rcond=None)
    tip, point = solution[:3], solution[3:]
    determined = rank == 6 and singular[-1] > 1e-3 * singular[0]
    return Pivot(tip, point, R @ tip + t - point), bool(determined)


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """The tip from the pivoted poses, and with it the distances between the touched points."""
    drawn = touches(setup)
    track = tracks.as_track([row for part in rows for row in part])
    off, measured = tracks.errors(track, drawn.poses, setup, one_track=False)
    seed = setup.seed
    answer = Answer([share(NAME, "poses measured", int(measured.sum()), len(measured), seed)])
    answer.notes.append(
        f"The tip is {np.linalg.norm(TIP_MM):g} mm from the handle's origin, on its axis beyond "
        f"the free end. {drawn.pivoted} poses hold it at one point, the axis even in a cone of "
        f"{CONE_DEG:g} deg; {(len(measured) - drawn.pivoted) // 2} pairs of points anywhere in the "
        "field are touched once each, and their distance is compared with the true one. The tip "
        "is taken from the pivoting, as one would."
    )
    estimates = _estimates(drawn.poses, off, measured)
    pivoted = [T for T, one in zip(estimates, measured, strict=True) if one][
        : int(measured[: drawn.pivoted].sum())
    ]
    pivot = calibrate_pivot(RigidTransform.concatenate(pivoted)) if len(pivoted) >= 3 else None
    if pivot is None:
        answer.notes.append("Too few poses were measured for the tip.")
        return answer
    answer.numbers += _pivot_numbers(pivoted, seed, OWN)
    wrong = float(np.linalg.norm(pivot.tip - TIP_MM))
    number = Number(NAME, "tip from pivoting, error", "distance", wrong, "mm", len(pivoted), seed)
    far = by_bootstrap(np.array([T.as_matrix() for T in pivoted]), _tip_error)
    answer.numbers.append(number.within(far))
    answer.numbers += distribution(
        NAME,
        "distance between two points, error",
        _distances(drawn, estimates, measured, pivot.tip),
        "mm",
        seed,
    )
    return answer


def _estimates(truths: RigidTransform, off: Array, found: np.ndarray) -> list[RigidTransform]:
    """The measured poses, each as its equivalent nearest to the truth; the true one where there is
    none.
    """
    shift = np.where(found[:, None], off, 0.0)
    turns = Rotation.from_rotvec(shift[:, 3:]) * truths.rotation
    return list(RigidTransform.from_components(truths.translation + shift[:, :3], turns))


def _distances(
    drawn: Touches, estimates: list[RigidTransform], found: np.ndarray, tip: Array
) -> Array:
    """Errors of the distances of the pairs of which both are measured, mm."""
    off = []
    for i in range(drawn.pivoted, len(found) - 1, 2):
        if found[i] and found[i + 1]:
            taken = np.linalg.norm(estimates[i].apply(tip) - estimates[i + 1].apply(tip))
            off.append(abs(taken - np.linalg.norm(drawn.points[i] - drawn.points[i + 1])))
    return np.array(off)


def _pivot_numbers(poses: list[RigidTransform], seed: int | None, source: str) -> list[Number]:
    """How far the tip scatters about its point."""
    pivot = calibrate_pivot(RigidTransform.concatenate(poses))
    if pivot is None:
        return []
    return distribution(
        NAME,
        "tip held at one point, scatter",
        np.linalg.norm(pivot.off, axis=1),
        "mm",
        seed,
        source,
    )


def _tip_error(matrices: Array) -> float:
    return float(np.linalg.norm(_pivot(matrices)[0].tip - TIP_MM))


def judge_recording(track: Track, source: str) -> Answer:
    """The scatter of the point about which a recorded handle turns, if it turns about one."""
    answer = Answer()
    if track.found.sum() < 8:
        return answer
    poses = track.poses()
    axes = poses.rotation.as_matrix()[:, :, 1]
    spread = np.rad2deg(np.arccos(np.clip(axes @ axes.mean(axis=0), -1, 1)).max())
    pivot = calibrate_pivot(poses)
    if pivot is None or 2 * spread < PIVOT_DEG or rms(np.linalg.norm(pivot.off, axis=1)) > PIVOT_MM:
        return answer
    answer.numbers += _pivot_numbers(list(poses), None, source)
    length = float(np.linalg.norm(pivot.tip))
    answer.notes.append(
        f"{source}: the handle turns about a point {length:.2f} mm from its origin, its axis by "
        f"{spread:.0f} deg to either side. Instants that follow one another are not independent: "
        "the intervals are too narrow."
    )
    return answer
