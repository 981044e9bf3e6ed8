"""Exercises of chapter 11: from master to slave."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker


def _goes_on(hand, closed, tool, scale, keep_origin):
    """After a loss the tool goes on without the clutch."""
    places = []
    origin = None
    for now, is_closed in zip(hand, closed, strict=True):
        lost = np.isnan(now).any()
        if not is_closed or (lost and not keep_origin):
            origin = None
        if is_closed and not lost:
            if origin is None:
                origin = (now, tool)
            tool = origin[1] + scale * (now - origin[0])
        places.append(tool)
    return np.array(places)


MAPPING = "11, The mapping"
CLUTCH = "11, Clutch, and a lost pose"


strokes_needed_exercise = FunctionExerciseMaker(
    "11.2", "From accuracy to strokes", "ex-slave-scale", points=4
)


@strokes_needed_exercise.solution
def strokes_needed(hand_box, task_box, error_mm, tolerance_mm):
    """The largest scale that a task's tolerance allows, and what it costs in strokes.

    Parameters
    ----------
    hand_box
        (3,), how far the hand moves comfortably to the right, down and away, mm.
    task_box
        (3,), how far the tool has to go in the same directions of the picture, mm.
    error_mm
        The error of the hand's measured place.
    tolerance_mm
        What the tool's place may be off.

    Returns
    -------
    scale
        Tool : hand, of distances.
    strokes
        How often the hand has to move, at this scale, to take the tool from one corner of the task's
        box to the opposite one. In a stroke the hand moves in all three directions at once.
    """
    scale = tolerance_mm / error_mm
    strokes = max(
        math.ceil(task / (scale * hand)) for hand, task in zip(hand_box, task_box, strict=True)
    )
    return scale, strokes


@strokes_needed_exercise.cases
def _box_cases(rng):
    return [
        (np.array([150.0, 120.0, 100.0]), np.array([300.0, 60.0, 200.0]), 0.25, 0.5),  # just one
        (np.array([150.0, 120.0, 100.0]), np.array([300.0, 60.0, 200.0]), 0.3, 0.1),
        # the longest side of the task is not where it is hardest
        (np.array([200.0, 50.0, 100.0]), np.array([250.0, 200.0, 150.0]), 0.31, 0.4),
        (np.array([100.0, 100.0, 100.0]), np.array([250.0, 0.0, 10.0]), 0.02, 0.05),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3), 0.4, 0.1),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3), 0.1, 0.03),
    ]


def _strokes(hand_box, task_box, error_mm, tolerance_mm, count):
    """`strokes_needed` with another count of the strokes, from those that each direction asks for."""
    scale = tolerance_mm / error_mm
    return scale, count(np.divide(task_box, scale * np.asarray(hand_box)))


@strokes_needed_exercise.mistake(MAPPING)
def _error_by_tolerance(hand_box, task_box, error_mm, tolerance_mm):
    """The scale is the other way round: the tool's error is the scale times the hand's."""
    return strokes_needed(hand_box, task_box, tolerance_mm, error_mm)


@strokes_needed_exercise.mistake(MAPPING)
def _not_rounded(hand_box, task_box, error_mm, tolerance_mm):
    """Strokes come in whole numbers: what is begun counts."""
    return _strokes(hand_box, task_box, error_mm, tolerance_mm, np.max)


@strokes_needed_exercise.mistake(MAPPING)
def _rounded_down(hand_box, task_box, error_mm, tolerance_mm):
    """The number of strokes is rounded down or to the nearest: the tool does not get to the corner."""
    return _strokes(hand_box, task_box, error_mm, tolerance_mm, lambda ways: np.floor(np.max(ways)))


@strokes_needed_exercise.mistake(MAPPING)
def _one_too_many(hand_box, task_box, error_mm, tolerance_mm):
    """There is a stroke too many where the way is a whole number of strokes."""
    return _strokes(
        hand_box, task_box, error_mm, tolerance_mm, lambda ways: np.floor(np.max(ways)) + 1
    )


@strokes_needed_exercise.mistake(MAPPING)
def _sum_of_directions(hand_box, task_box, error_mm, tolerance_mm):
    """The strokes of the three directions are added up. The hand moves in all three at once, so that
    the slowest direction decides.
    """
    return _strokes(hand_box, task_box, error_mm, tolerance_mm, lambda ways: np.ceil(ways).sum())


@strokes_needed_exercise.mistake(MAPPING)
def _fewest(hand_box, task_box, error_mm, tolerance_mm):
    """This is the direction that needs the fewest strokes. The one that needs the most decides."""
    return _strokes(hand_box, task_box, error_mm, tolerance_mm, lambda ways: np.ceil(min(ways)))


@strokes_needed_exercise.mistake(MAPPING)
def _scale_left_out(hand_box, task_box, error_mm, tolerance_mm):
    """The strokes are those of scale 1. A smaller scale makes each stroke of the tool shorter."""
    strokes = np.ceil(np.max(np.divide(task_box, hand_box)))
    return tolerance_mm / error_mm, strokes


@strokes_needed_exercise.mistake(MAPPING)
def _diagonals(hand_box, task_box, error_mm, tolerance_mm):
    """The diagonals are compared. A task may be long in a direction in which the hand's box is
    short: divide direction by direction.
    """
    scale = tolerance_mm / error_mm
    ways = np.linalg.norm(task_box) / (scale * np.linalg.norm(hand_box))
    return scale, np.ceil(ways)


clutched_exercise = FunctionExerciseMaker("11.3", "A clutch", "ex-slave-clutch", points=4)


@clutched_exercise.solution
def clutched(hand, closed, tool, scale):
    """Where the tool goes while a hand moves, strokes with a clutch and loses its pose.

    The tool follows from where it was when the clutch was closed. While the clutch is open it
    rests. When the pose is lost with the clutch closed, the tool holds until the clutch has been
    opened and is closed anew.

    Parameters
    ----------
    hand
        (n, 3), the hand's place at n instants, mm, in the directions of the arm's base; a row of
        NaN where the pose is lost.
    closed
        (n,), whether the clutch is closed.
    tool
        (3,), where the tool is before, mm.
    scale
        Tool : hand, of distances.

    Returns
    -------
    array
        (n, 3), the tool's place after each instant, mm.
    """
    places = []
    origin = None  # hand and tool when the clutch was closed
    held = False
    for now, is_closed in zip(hand, closed, strict=True):
        if not is_closed:
            origin = None
            held = False
        elif np.isnan(now).any():
            origin = None
            held = True
        elif not held:
            if origin is None:
                origin = (now, tool)
            tool = origin[1] + scale * (now - origin[0])
        places.append(tool)
    return np.array(places)


@clutched_exercise.cases
def _clutch_cases(rng):
    def way(count):
        return np.cumsum(rng.normal(0, 8, (count, 3)), axis=0) + [20.0, -30.0, 560.0]

    def lost(places, *rows):
        places = places.copy()
        places[list(rows)] = np.nan
        return places

    tool = np.array([400.0, -100.0, 250.0])
    strokes = [False, True, True, False, False, True, True, True]
    again = [True, True, True, True, True, True, False, True, True, True]
    return [
        (way(5), [True] * 5, tool, 1.0),
        (way(4), [False] * 4, tool, 2.0),
        (way(8), strokes, tool, 3.0),
        (lost(way(10), 2, 3), again, tool, 0.5),
        # lost while the clutch is open: that asks for nothing
        (lost(way(8), 3, 4), strokes, tool, 2.0),
        # closed while the pose is lost
        (lost(way(8), 4, 5), strokes, tool, 1.5),
        (lost(way(10), 2, 7), again, tool, 1.0),
    ]


@clutched_exercise.mistake(MAPPING)
def _always_from_the_start(hand, closed, tool, scale):
    """The hand's way is counted from the first instant: when the clutch is closed anew, the tool
    jumps to where the hand has gone meanwhile. Keep both places at each closing.

    The hand's way is counted from the first instant, whatever the clutch does.
    """
    known = hand[np.isfinite(hand).all(axis=1)]
    places = []
    now_at = tool
    held = False
    for now, is_closed in zip(hand, closed, strict=True):
        if not is_closed:
            held = False
        elif np.isnan(now).any():
            held = True
        elif not held:
            now_at = tool + scale * (now - known[0])
        places.append(now_at)
    return np.array(places)


@clutched_exercise.mistake(MAPPING)
def _back_to_the_first_tool(hand, closed, tool, scale):
    """At each closing the tool goes back to where it was at the first one. Keep the tool's place
    as well as the hand's.

    The hand's place is kept at each closing, the tool's only at the first.
    """
    places = []
    now_at = tool
    origin = None
    held = False
    for now, is_closed in zip(hand, closed, strict=True):
        if not is_closed:
            origin = None
            held = False
        elif np.isnan(now).any():
            origin = None
            held = True
        elif not held:
            origin = now if origin is None else origin
            now_at = tool + scale * (now - origin)
        places.append(now_at)
    return np.array(places)


@clutched_exercise.mistake(MAPPING)
def _step_while_open(hand, closed, tool, scale):
    """The step from the last open instant to the first closed one is added, though the clutch was
    open during it.

    Steps are added up, also that from the last open instant to the first closed one.
    """
    places = []
    before = None
    held = False
    for now, is_closed in zip(hand, closed, strict=True):
        lost = np.isnan(now).any()
        if not is_closed:
            held = False
        elif lost:
            held = True
        elif not held and before is not None:
            tool = tool + scale * (now - before)
        before = None if lost else now
        places.append(tool)
    return np.array(places)


@clutched_exercise.mistake(CLUTCH)
def _jumps_after_loss(hand, closed, tool, scale):
    """When the pose is back, the tool jumps to where the hand has gone. It has to hold until the
    clutch has been opened and is closed anew.
    """
    return _goes_on(hand, closed, tool, scale, True)


@clutched_exercise.mistake(CLUTCH)
def _closes_by_itself(hand, closed, tool, scale):
    """When the pose is back, the tool goes on from where it is, though nobody has closed the
    clutch anew. It has to hold until then.
    """
    return _goes_on(hand, closed, tool, scale, False)


@clutched_exercise.mistake(CLUTCH)
def _never_released(hand, closed, tool, scale):
    """Once the pose was lost, the tool holds for ever. An open clutch ends the hold, so that the
    next closing lets it go on.

    Once held, the tool holds for ever.
    """
    gone = np.isnan(hand).any(axis=1) & np.array(closed, bool)
    first = int(np.argmax(gone)) if gone.any() else len(hand)
    after = np.where(np.arange(len(hand)) < first, closed, False)
    return clutched(hand, after, tool, scale)


@clutched_exercise.mistake(MAPPING)
def _no_scale(hand, closed, tool, scale):
    """The scale is left out."""
    return clutched(hand, closed, tool, 1.0)


@clutched_exercise.mistake(CLUTCH)
def _lost_is_followed(hand, closed, tool, scale):
    """The NaN of a lost pose goes into the tool's place. An arm that is told NaN may go anywhere:
    the tool has to hold.

    The NaN of a lost pose goes into the tool's place.
    """
    places = []
    origin = None
    for now, is_closed in zip(hand, closed, strict=True):
        if not is_closed:
            origin = None
        else:
            if origin is None:
                origin = (now, tool)
            tool = origin[1] + scale * (now - origin[0])
        places.append(tool)
    return np.array(places)


@clutched_exercise.mistake(MAPPING)
def _one_array(hand, closed, tool, scale):
    """All rows are the last place: `tool += ...` changes the array that the list holds already.
    `tool = tool + ...` makes a new one.

    What is changed in place is in the list n times.
    """
    places = clutched(hand, closed, tool, scale)
    return np.tile(places[-1], (len(places), 1))


turned_tool_exercise = FunctionExerciseMaker(
    "11.6", "A tool that jumps", "ex-slave-repair", points=3
)


def _turned(tool, turn, from_the_left=True):
    return turn.as_matrix() @ tool if from_the_left else tool @ turn.as_matrix()


@turned_tool_exercise.solution
def turned_tool(tool, turn_deg, ratio):
    """The tool's orientation after a turn of the hand.

    Parameters
    ----------
    tool
        (3, 3), the tool's rotation before, in the base.
    turn_deg
        (3,), the hand's turn since the last instant as a rotation vector in the axes of the base: its
        direction is the axis, its length the angle in degrees.
    ratio
        The tool's angle : the hand's.

    Returns
    -------
    array
        (3, 3), the tool's rotation after it.
    """
    turn = Rotation.from_rotvec(ratio * turn_deg, degrees=True)
    return turn.as_matrix() @ tool


@turned_tool_exercise.broken
def _degrees_for_radians(tool, turn_deg, ratio):
    """Degrees are taken for radians."""
    turn = Rotation.from_rotvec(ratio * turn_deg)
    return turn.as_matrix() @ tool


@turned_tool_exercise.cases
def _turn_cases(rng):
    tools = [Rotation.from_rotvec(rng.normal(0, 1, 3)).as_matrix() for _ in range(3)]
    return [
        (np.eye(3), np.array([0.0, 0.0, 0.1]), 1.0),
        (np.eye(3), np.array([20.0, 0.0, 0.0]), 0.5),
        (tools[0], np.zeros(3), 1.0),
        (tools[0], np.array([3.0, -1.0, 2.0]), 1.0),
        (tools[1], np.array([-15.0, 40.0, 5.0]), 0.5),
        (tools[2], rng.normal(0, 30, 3), 2.0),
    ]


@turned_tool_exercise.mistake(MAPPING)
def _other_conversion(tool, turn_deg, ratio):
    """The angle is multiplied by 180 / pi. A degree is pi / 180, the smaller number."""
    return _turned(tool, Rotation.from_rotvec(ratio * np.rad2deg(turn_deg)))


@turned_tool_exercise.mistake(MAPPING)
def _about_the_tool(tool, turn_deg, ratio):
    """The turn is multiplied from the right, about the tool's own axes. It is given in those of the
    base.
    """
    return _turned(tool, Rotation.from_rotvec(ratio * turn_deg, degrees=True), False)


@turned_tool_exercise.mistake(MAPPING)
def _three_angles(tool, turn_deg, ratio):
    """The three numbers are taken for three turns one after the other. A rotation vector is one turn,
    about its own direction.
    """
    return _turned(tool, Rotation.from_euler("xyz", ratio * turn_deg, degrees=True))


@turned_tool_exercise.mistake(MAPPING)
def _no_ratio(tool, turn_deg, ratio):
    """The ratio is left out."""
    return turned_tool(tool, turn_deg, 1.0)


@turned_tool_exercise.mistake(MAPPING)
def _turned_back(tool, turn_deg, ratio):
    """The tool turns the other way."""
    return turned_tool(tool, -turn_deg, ratio)


EXERCISES = (
    strokes_needed_exercise.made(),
    clutched_exercise.made(),
    turned_tool_exercise.made(),
)
