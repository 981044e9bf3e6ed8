"""Exercises of chapter 11: from master to slave."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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


def _box_cases(rng):
    return [
        (np.array([150.0, 120.0, 100.0]), np.array([300.0, 60.0, 200.0])),
        (np.array([150.0, 120.0, 100.0]), np.array([30.0, 12.0, 40.0])),
        (np.array([200.0, 50.0, 100.0]), np.array([100.0, 200.0, 150.0])),
        (np.array([100.0, 100.0, 100.0]), np.array([250.0, 0.0, 10.0])),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3)),
        (rng.uniform(50, 200, 3), rng.uniform(20, 400, 3)),
    ]


def _smallest_ratio(hand_box, task_box):
    return min(np.divide(task_box, hand_box))


def _mean_ratio(hand_box, task_box):
    return np.mean(np.divide(task_box, hand_box))


def _first_direction(hand_box, task_box):
    return task_box[0] / hand_box[0]


def _hand_by_task(hand_box, task_box):
    return 1 / needed_scale(hand_box, task_box)


def _largest_by_largest(hand_box, task_box):
    return max(task_box) / max(hand_box)


def _diagonals(hand_box, task_box):
    return np.linalg.norm(task_box) / np.linalg.norm(hand_box)


def _volumes(hand_box, task_box):
    return (np.prod(task_box) / np.prod(hand_box)) ** (1 / 3)


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


def _always_from_the_start(hand, closed, tool, scale):
    """The hand's way is counted from the first instant, whatever the clutch does."""
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


def _back_to_the_first_tool(hand, closed, tool, scale):
    """The hand's place is kept at each closing, the tool's only at the first."""
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


def _step_while_open(hand, closed, tool, scale):
    """Steps are added up, also that from the last open instant to the first closed one."""
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


def _jumps_after_loss(hand, closed, tool, scale):
    return _goes_on(hand, closed, tool, scale, True)


def _closes_by_itself(hand, closed, tool, scale):
    return _goes_on(hand, closed, tool, scale, False)


def _never_released(hand, closed, tool, scale):
    """Once held, the tool holds for ever."""
    gone = np.isnan(hand).any(axis=1) & np.array(closed, bool)
    first = int(np.argmax(gone)) if gone.any() else len(hand)
    after = np.where(np.arange(len(hand)) < first, closed, False)
    return clutched(hand, after, tool, scale)


def _no_scale(hand, closed, tool, scale):
    return clutched(hand, closed, tool, 1.0)


def _one_array(hand, closed, tool, scale):
    """What is changed in place is in the list n times."""
    places = clutched(hand, closed, tool, scale)
    return np.tile(places[-1], (len(places), 1))


def _lost_is_followed(hand, closed, tool, scale):
    """The NaN of a lost pose goes into the tool's place."""
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


MAPPING = "11, The mapping"
CLUTCH = "11, Clutch, and a lost pose"
CUTOFF = "11, What happens if the cutoff changes?"

EXERCISES = (
    ValueExercise(
        "11.1",
        "pencil",
        "The other side of the table",
        "ex-slave-alignment",
        2,
        (
            Mistake(
                "This is where the tool goes with the old A, whose camera looks along +y.",
                "11, The smallest example",
                {"x": 60.0, "y": 12.0},
            ),
            Mistake(
                "Only right and left are turned round. Who walks round the table has near and away "
                "exchanged as well; else A would be a reflection, with the determinant -1.",
                MAPPING,
                {"y": 12.0},
            ),
            Mistake(
                "Down has become up. The camera still stands upright, so that down is -z.",
                "11, The smallest example",
                {"z": 20.0},
            ),
            Mistake(
                "Down and away are exchanged: down is -z of the base, and away is -y.",
                "11, The smallest example",
                {"y": -20.0, "z": -12.0},
            ),
            Mistake(
                "The scale is forgotten: the tool goes twice as far as the hand.",
                MAPPING,
                {"x": -30.0, "y": -6.0, "z": -10.0},
            ),
            Mistake(
                "With the old A more than one direction is wrong, and down is not among them: compare "
                "both matrices column by column.",
                MAPPING,
                {"exchanged": "left and right"},
            ),
        ),
        {
            "x": Asked(-60.0, "mm", 0.01),
            "y": Asked(-12.0, "mm", 0.01),
            "z": Asked(-20.0, "mm", 0.01),
            "exchanged": Asked(
                "left and right, near and away",
                choices=(
                    "left and right",
                    "near and away",
                    "left and right, near and away",
                    "left and right, up and down",
                ),
            ),
        },
    ),
    FunctionExercise(
        "11.2",
        "write",
        "From workspace to scale",
        "ex-slave-scale",
        4,
        (
            Mistake(
                "This is the smallest of the three ratios: in the other directions the hand does not "
                "reach. The largest decides.",
                MAPPING,
                _smallest_ratio,
            ),
            Mistake(
                "This is the mean of the three ratios. In the direction of the largest one the hand "
                "does not reach.",
                MAPPING,
                _mean_ratio,
            ),
            Mistake(
                "Only the direction to the right is looked at. The largest of all three ratios "
                "decides.",
                MAPPING,
                _first_direction,
            ),
            Mistake(
                "This is hand : task. The scale is tool : handle.",
                MAPPING,
                _hand_by_task,
            ),
            Mistake(
                "The largest side is divided by the largest side, though they may lie in different "
                "directions. Divide direction by direction.",
                MAPPING,
                _largest_by_largest,
            ),
            Mistake(
                "The diagonals are compared. A task may be long in a direction in which the hand's "
                "box is short: divide direction by direction.",
                MAPPING,
                _diagonals,
            ),
            Mistake(
                "The volumes are compared. A task may be long in a direction in which the hand's box "
                "is short: divide direction by direction.",
                MAPPING,
                _volumes,
            ),
        ),
        needed_scale,
        _box_cases,
    ),
    FunctionExercise(
        "11.3",
        "write",
        "A clutch",
        "ex-slave-clutch",
        4,
        (
            Mistake(
                "The hand's way is counted from the first instant: when the clutch is closed anew, "
                "the tool jumps to where the hand has gone meanwhile. Keep both places at each closing.",
                MAPPING,
                _always_from_the_start,
            ),
            Mistake(
                "At each closing the tool goes back to where it was at the first one. Keep the tool's "
                "place as well as the hand's.",
                MAPPING,
                _back_to_the_first_tool,
            ),
            Mistake(
                "The step from the last open instant to the first closed one is added, though the "
                "clutch was open during it.",
                MAPPING,
                _step_while_open,
            ),
            Mistake(
                "When the pose is back, the tool jumps to where the hand has gone. It has to hold "
                "until the clutch has been opened and is closed anew.",
                CLUTCH,
                _jumps_after_loss,
            ),
            Mistake(
                "When the pose is back, the tool goes on from where it is, though nobody has closed "
                "the clutch anew. It has to hold until then.",
                CLUTCH,
                _closes_by_itself,
            ),
            Mistake(
                "Once the pose was lost, the tool holds for ever. An open clutch ends the hold, so that "
                "the next closing lets it go on.",
                CLUTCH,
                _never_released,
            ),
            Mistake(
                "The scale is left out.",
                MAPPING,
                _no_scale,
            ),
            Mistake(
                "The NaN of a lost pose goes into the tool's place. An arm that is told NaN may go "
                "anywhere: the tool has to hold.",
                CLUTCH,
                _lost_is_followed,
            ),
            Mistake(
                "All rows are the last place: `tool += ...` changes the array that the list holds "
                "already. `tool = tool + ...` makes a new one.",
                MAPPING,
                _one_array,
            ),
        ),
        clutched,
        _clutch_cases,
    ),
    ValueExercise(
        "11.4",
        "predict",
        "A peg in a hole",
        "ex-slave-peg",
        3,
        (
            Mistake(
                "This is the clearance of the diameters. On each side there is half of it.",
                "11, Exercises",
                {"clearance_mm": 0.5},
            ),
            Mistake(
                "No cutoff makes the first chain quick enough: what is not the filter's takes more than "
                "100 ms already.",
                CUTOFF,
                {"first_chain": "yes"},
            ),
            Mistake(
                "These are the first chain's. Look at the curve for 60 Hz and 60/s.",
                CUTOFF,
                {"wander_mm": 0.1892, "delay_ms": 153.8},
            ),
            Mistake(
                "This cutoff is the calmest of the six, and the slowest: its delay is far above "
                "100 ms.",
                CUTOFF,
                {"slowest_hz": 0.5},
            ),
            Mistake(
                "This cutoff is quick enough, but it is not the smallest that is.",
                CUTOFF,
                {"slowest_hz": 8.0},
            ),
            Mistake(
                "This is one standard deviation. Three are to stay inside the clearance.",
                CUTOFF,
                {"wander_mm": 0.0483},
            ),
        ),
        {
            "clearance_mm": Asked(0.25, "mm", 0.001),
            "first_chain": Asked("no", choices=("yes", "no")),
            "slowest_hz": Asked(4.0, "Hz", 0.01),
            "wander_mm": Asked(0.1449, "mm", 0.006),
            "delay_ms": Asked(95.9, "ms", 1.0),
        },
    ),
    ValueExercise(
        "11.5",
        "project",
        "A loop of rotations",
        "ex-slave-loop",
        5,
        (
            Mistake(
                "Rotations do not commute: the four turns leave something, though each axis is turned "
                "there and back.",
                MAPPING,
                {"hand_deg": 0.0},
            ),
            Mistake(
                "This is half of what the hand is turned by. The mapping scales each step, and the "
                "loop's turn goes with the square of the steps.",
                MAPPING,
                {"tool_deg": 3.47},
            ),
            Mistake(
                "At r = 1/2 the tool makes the same loop with half the angle, and ends turned, too.",
                MAPPING,
                {"tool_deg": 0.0},
            ),
            Mistake(
                "These are radians. Degrees are asked for.",
                "11, Exercises",
                {"hand_deg": 0.1206, "tool_deg": 0.03038},
            ),
            Mistake(
                "Were it of first order, half the angle would give half of the turn, and the loop "
                "would not matter. Compare the turns at 10 and at 20 deg.",
                MAPPING,
                {"order": 1.0},
            ),
        ),
        {
            # exactly 6.912 and 1.741; epsilon^2 and epsilon^2/4 are 6.98 and 1.745
            "hand_deg": Asked(6.94, "deg", 0.06),
            "tool_deg": Asked(1.743, "deg", 0.015),
            "order": Asked(2.0, within=0.1),
        },
    ),
)
