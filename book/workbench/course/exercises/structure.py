"""Exercises of chapter 1: the structure."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


def look_alikes(angles_deg, rows_mm):
    """Count the poses of a rod that give the same image.

    The rod may be turned about its axis, and it may be put upside down as well. A pose counts if
    it brings each marker to the place of one. The pose at the start is one of them.

    Parameters
    ----------
    angles_deg
        (n,) of the markers about the rod's axis, deg; each marker lies at a place of its own.
    rows_mm
        (n,) of the markers along the axis, mm, from the point about which the rod is turned upside
        down.

    Returns
    -------
    int
        The number of poses.
    """
    angles_deg = np.asarray(angles_deg, dtype=float)
    rows_mm = np.asarray(rows_mm, dtype=float)

    def covers(angles, rows):
        for angle, row in zip(angles, rows, strict=True):
            apart = (angles_deg - angle + 180) % 360 - 180
            there = (np.abs(apart) < 1e-6) & (np.abs(rows_mm - row) < 1e-6)
            if not there.any():
                return False
        return True

    count = 0
    for sense in (1, -1):  # upside down the angles run the other way
        turns = {round((angle - sense * angles_deg[0]) % 360, 6) % 360 for angle in angles_deg}
        for turn in turns:
            if covers(sense * angles_deg + turn, sense * rows_mm):
                count = count + 1
    return count


def _even(columns, half_mm):
    """As many columns at equal angles, each with a marker at + and - half_mm."""
    angles = np.repeat(np.arange(columns) * 360.0 / columns, 2)
    return angles, np.tile([half_mm, -half_mm], columns)


def _structure_cases(rng):
    six, five = _even(6, 10.0), _even(5, 8.0)
    by = float(rng.uniform(5, 40))
    # four pairs; the two markers of a pair lie 20 deg from each other
    twisted = np.sort(np.concatenate([np.arange(4) * 90.0, np.arange(4) * 90.0 + 20]))
    return [
        six,
        ((six[0] + by) % 360, six[1]),
        (six[0][1:], six[1][1:]),
        five,
        (twisted, np.tile([10.0, -10.0], 4)),
        (np.arange(6) * 60.0, np.full(6, 10.0)),
        (np.repeat(np.arange(6) * 60.0, 2), np.tile([10.0, -10.0, 10.0, -4.0], 3)),
        (np.array([0.0, 40.0, 170.0]), np.array([10.0, -10.0, 3.0])),
    ]


def _counted(angles_deg, rows_mm, senses=(1, -1), angle_sense=None, period=360.0, both=True):
    """`look_alikes` with a line or two that may be wrong."""
    angles_deg, rows_mm = np.asarray(angles_deg, float), np.asarray(rows_mm, float)
    count = 0
    for sense in senses:
        way = sense if angle_sense is None else angle_sense
        for turn in {round((angle - way * angles_deg[0]) % 360, 6) % 360 for angle in angles_deg}:
            apart = angles_deg[:, None] - (way * angles_deg + turn)
            if period:
                apart = (apart + 180) % period - 180
            near = np.abs(apart) < 1e-6
            level = np.abs(rows_mm[:, None] - sense * rows_mm) < 1e-6
            fits = (near & level).any(axis=0) if both else near.any(axis=0) & level.any(axis=0)
            count = count + int(fits.all())
    return count


def _turns_only(angles_deg, rows_mm):
    return _counted(angles_deg, rows_mm, senses=(1,))


def _mirrored(angles_deg, rows_mm):
    return _counted(angles_deg, rows_mm, angle_sense=1)


def _no_wrap(angles_deg, rows_mm):
    return _counted(angles_deg, rows_mm, period=None)


def _each_by_itself(angles_deg, rows_mm):
    return _counted(angles_deg, rows_mm, both=False)


def _columns_alone(angles_deg, rows_mm):
    return 2 * len(np.unique(np.round(angles_deg, 6)))


STAGES = ("background", "markers", "matches", "points", "identity", "pose")
NEEDS = ("neither", "the rig", "the layout", "both")
STATUSES = ("measured", "ambiguous", "predicted", "lost")
HIDDEN = ("all before the robot's pose", "the computation alone", "the video's alone", "all four")

EXERCISES = (
    ValueExercise(
        "01.1",
        "pencil",
        "The loop's delay",
        "ex-structure-delay",
        2,
        (
            Mistake(
                "You have left out the time for which a frame waits until it is read. The robot is "
                "behind by all that happens after the light has come in.",
                "1, What the paper says",
                {"robot_mm": 20.0, "picture_mm": 40.0},
            ),
            Mistake(
                "This is the video's own delay alone. The picture shows the robot, and the robot is "
                "behind already: the delays add up along the loop.",
                "1, What the paper says",
                {"picture_mm": 20.0},
            ),
            Mistake(
                "The delays are in ms, the speed in mm/s: divide by 1000.",
                "1, With pencil and paper",
                {"robot_mm": 23400.0, "picture_mm": 43400.0},
            ),
            Mistake(
                "A prediction of the handle is sent to the robot. Nobody predicts for the "
                "operator's eyes, so that the video's delay stays.",
                "1, What the paper says",
                {"hidden": "all four"},
            ),
            Mistake(
                "A filter may predict as far ahead as you ask it to: over the computation, and over "
                "the frame's wait and the robot's delay as well.",
                "1, With pencil and paper",
                {"hidden": "the computation alone"},
            ),
        ),
        {
            "robot_mm": Asked(23.4, "mm", within=0.5),
            "picture_mm": Asked(43.4, "mm", within=0.5),
            "hidden": Asked("all before the robot's pose", choices=HIDDEN),
        },
    ),
    ValueExercise(
        "01.2",
        "pencil",
        "Who needs what",
        "ex-structure-needs",
        2,
        (
            Mistake(
                "The look of the surroundings (Eq. 18) needs no rig, but the epipolar line "
                "(Eq. 17) on which a partner is looked for does.",
                "1, Matches",
                {"matches": "neither"},
            ),
            Mistake(
                "A point is where two rays meet. Which marker it is, nobody has asked so far: the "
                "layout is not needed.",
                "1, Matches",
                {"points": "both"},
            ),
            Mistake(
                "The identity does try poses of the layout. But it judges them by the spots that "
                "they explain in all images, and for that it has to know the cameras.",
                "1, Points, identity, pose",
                {"identity": "the layout"},
            ),
            Mistake(
                "More is left than that: markers are looked for in each image by itself, and that "
                "needs no camera's place.",
                "1, Markers",
                {"last_right": "background"},
            ),
            Mistake(
                "After the knock the epipolar lines are those of a rig that is no longer there, and "
                "they miss the partners.",
                "1, Matches",
                {"last_right": "matches"},
            ),
        ),
        {
            "background": Asked("neither", choices=NEEDS),
            "matches": Asked("the rig", choices=NEEDS),
            "points": Asked("the rig", choices=NEEDS),
            "identity": Asked("both", choices=NEEDS),
            "last_right": Asked("markers", choices=STAGES),
        },
    ),
    FunctionExercise(
        "01.3",
        "write",
        "How many look alike",
        "ex-structure-write",
        4,
        (
            Mistake(
                "You count the turns alone. A rod may be upside down as well.",
                "1, The bench: three cameras and a rod",
                _turns_only,
            ),
            Mistake(
                "Upside down is a rotation: it takes the row s to -s and the angle a to -a. With "
                "the angles as they were it is a mirror image, and no rod can be held like that.",
                "1, The bench: three cameras and a rod",
                _mirrored,
            ),
            Mistake(
                "Angles are compared without their wrap: 350 deg and -10 deg are one place.",
                "1, The bench: three cameras and a rod",
                _no_wrap,
            ),
            Mistake(
                "Angles and rows are compared each by itself. A marker has to lie where another one "
                "was, with its angle and with its row at once.",
                "1, The bench: three cameras and a rod",
                _each_by_itself,
            ),
            Mistake(
                "Two poses for each column are right where all columns are alike. A marker that is "
                "missing or lies elsewhere forbids most of them: try each pose.",
                "1, The bench: three cameras and a rod",
                _columns_alone,
            ),
        ),
        look_alikes,
        _structure_cases,
    ),
    ValueExercise(
        "01.4",
        "predict",
        "The other rod",
        "ex-structure-change",
        3,
        (
            Mistake(
                "The staggered rod has one pose for each image. Between which poses would it be "
                "ambiguous?",
                "1, The bench: three cameras and a rod",
                {"told_nothing": "ambiguous"},
            ),
            Mistake(
                "Two cameras are enough for the pose, and the layout leaves no choice between poses. "
                "A dark camera does not bring the look-alikes back.",
                "1, What happens if cameras go dark?",
                {"one_dark": "ambiguous"},
            ),
            Mistake(
                "Two cameras are enough as long as they see four markers in common. Nothing is lost.",
                "1, What happens if cameras go dark?",
                {"one_dark": "lost"},
            ),
            Mistake(
                "A single camera gives no point in space, and the paper's method starts from points. "
                "Which marker a spot is does not help.",
                "1, Limits, and a broken case",
                {"all_but_first": "measured"},
            ),
            Mistake(
                "This is the number for the paper's rod. Change the parameter, and run the chapter "
                "again from its first cell.",
                "1, Points, identity, pose",
                {"points": 14.0},
            ),
        ),
        {
            "told_nothing": Asked("measured", choices=STATUSES),
            "one_dark": Asked("measured", choices=STATUSES),
            "all_but_first": Asked("lost", choices=STATUSES),
            "points": Asked(15.0, within=0.4),
        },
    ),
    ValueExercise(
        "01.5",
        "project",
        "A film with fewer frames",
        "ex-structure-film",
        5,
        (
            Mistake(
                "You have counted all instants. Those that are `predicted` have a pose, too, but it "
                "comes from the motion and not from the images.",
                "1, Check: the package does the same",
                {"measured_4": 15.0, "measured_6": 10.0},
            ),
            Mistake(
                "You have used every frame each time. A step of 4 leaves 15 of 60 instants.",
                "1, Two seconds of it",
                {"measured_4": 60.0},
            ),
            Mistake(
                "The position is off by this much in m. Millimetres are asked for.",
                "1, Two seconds of it",
                {"mm_4": 4.56e-5},
            ),
            Mistake(
                "This is the largest error. The mean is asked for.",
                "1, Two seconds of it",
                {"mm_4": 0.20},
            ),
        ),
        {
            "measured_1": Asked(60.0, within=0.4),
            "measured_2": Asked(30.0, within=0.4),
            "measured_4": Asked(13.0, within=0.4),
            "measured_6": Asked(9.0, within=0.4),
            "mm_4": Asked(0.046, "mm", within=0.012),
        },
    ),
)
