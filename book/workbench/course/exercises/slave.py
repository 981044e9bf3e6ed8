"""Exercises of chapter 11: from master to slave."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

__all__ = ["clutched", "needed_scale"]


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


needed_scale_exercise = FunctionExerciseMaker(
    "11.2", "From workspace to scale", "ex-slave-scale", points=4
)


@needed_scale_exercise.solution
def needed_scale(hand_box, task_box):
    """The smallest motion scale with which a hand reaches all of a task without indexing.

    Parameters
    ----------
    hand_box
        (3,), how far the hand moves comfortably to the right, down and away, mm.
    task_box
        (3,), how far the tool has to go in the same directions of the picture, mm.

    Returns
    -------
    float
        Tool : handle, of distances.
    """
    return max(np.divide(task_box, hand_box))


@needed_scale_exercise.cases
def _box_cases(rng):
    return [
        (np.array([150.0, 120.0, 100.0]), np.array([300.0, 60.0, 200.0])),
        (np.array([150.0, 120.0, 100.0]), np.array([30.0, 12.0, 40.0])),
        # the longest side of the task is not where it is hardest
        (np.array([200.0, 50.0, 100.0]), np.array([250.0, 200.0, 150.0])),
        (np.array([100.0, 100.0, 100.0]), np.array([250.0, 0.0, 10.0])),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3)),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3)),
    ]


@needed_scale_exercise.mistake(MAPPING)
def _smallest_ratio(hand_box, task_box):
    """This is the smallest of the three ratios: in the other directions the hand does not reach.
    The largest decides.
    """
    return min(np.divide(task_box, hand_box))


@needed_scale_exercise.mistake(MAPPING)
def _mean_ratio(hand_box, task_box):
    """This is the mean of the three ratios. In the direction of the largest one the hand does not
    reach.
    """
    return np.mean(np.divide(task_box, hand_box))


@needed_scale_exercise.mistake(MAPPING)
def _first_direction(hand_box, task_box):
    """Only the direction to the right is looked at. The largest of all three ratios decides."""
    return task_box[0] / hand_box[0]


@needed_scale_exercise.mistake(MAPPING)
def _hand_by_task(hand_box, task_box):
    """This is hand : task. The scale is tool : handle."""
    return 1 / needed_scale(hand_box, task_box)


@needed_scale_exercise.mistake(MAPPING)
def _largest_by_largest(hand_box, task_box):
    """The largest side is divided by the largest side, though they may lie in different
    directions. Divide direction by direction.
    """
    return max(task_box) / max(hand_box)


@needed_scale_exercise.mistake(MAPPING)
def _where_the_task_is_longest(hand_box, task_box):
    """This is the ratio in the direction in which the task is longest. In another direction the
    hand may be shorter still: the largest ratio decides.
    """
    longest = int(np.argmax(task_box))
    return task_box[longest] / hand_box[longest]


@needed_scale_exercise.mistake(MAPPING)
def _diagonals(hand_box, task_box):
    """The diagonals are compared. A task may be long in a direction in which the hand's box is
    short: divide direction by direction.
    """
    return np.linalg.norm(task_box) / np.linalg.norm(hand_box)


@needed_scale_exercise.mistake(MAPPING)
def _volumes(hand_box, task_box):
    """The volumes are compared. A task may be long in a direction in which the hand's box is
    short: divide direction by direction.
    """
    return (np.prod(task_box) / np.prod(hand_box)) ** (1 / 3)


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


EXERCISES = (
    needed_scale_exercise.made(),
    clutched_exercise.made(),
)
