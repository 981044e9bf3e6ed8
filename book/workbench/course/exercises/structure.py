"""Exercises of chapter 1: the structure."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker


def _even(columns, half_mm):
    """As many columns at equal angles, each with a marker at + and - half_mm."""
    angles = np.repeat(np.arange(columns) * 360.0 / columns, 2)
    return angles, np.tile([half_mm, -half_mm], columns)


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


look_alikes_exercise = FunctionExerciseMaker(
    "01.3", "How many look alike", "ex-structure-write", points=4
)


@look_alikes_exercise.solution
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
            matches = (np.abs(apart) < 1e-6) & (np.abs(rows_mm - row) < 1e-6)
            if not matches.any():
                return False
        return True

    count = 0
    for sense in (1, -1):  # upside down the angles run the other way
        turns = {round((angle - sense * angles_deg[0]) % 360, 6) % 360 for angle in angles_deg}
        for turn in turns:
            if covers(sense * angles_deg + turn, sense * rows_mm):
                count = count + 1
    return count


@look_alikes_exercise.cases
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
        # beyond a whole turn, and not in their order
        (np.roll(six[0], 5) + 207.0, np.roll(six[1], 5)),
        (-six[0] - 13.0, six[1]),
        # a turn just short of a whole one, and markers of a column that rounding sets apart
        (six[0] - 0.25 - 1e-9 * (np.arange(12) == 1), six[1]),
        # nearly alike: one marker off by a little
        (six[0] + 0.3 * (np.arange(12) == 4), six[1]),
        (six[0], six[1] + 0.3 * (np.arange(12) == 4)),
    ]


@look_alikes_exercise.mistake("1, The bench: three cameras and a rod")
def _turns_only(angles_deg, rows_mm):
    """You count the turns alone. A rod may be upside down as well."""
    return _counted(angles_deg, rows_mm, senses=(1,))


@look_alikes_exercise.mistake("1, The bench: three cameras and a rod")
def _mirrored(angles_deg, rows_mm):
    """Upside down is a rotation: it takes the row s to -s and the angle a to -a. With the angles
    as they were it is a mirror image, and no rod can be held like that.
    """
    return _counted(angles_deg, rows_mm, angle_sense=1)


@look_alikes_exercise.mistake("1, The bench: three cameras and a rod")
def _no_wrap(angles_deg, rows_mm):
    """Angles are compared without their wrap: 350 deg and -10 deg are one place."""
    return _counted(angles_deg, rows_mm, period=None)


@look_alikes_exercise.mistake("1, The bench: three cameras and a rod")
def _each_by_itself(angles_deg, rows_mm):
    """Angles and rows are compared each by itself. A marker has to lie where another one was, with
    its angle and with its row at once.
    """
    return _counted(angles_deg, rows_mm, both=False)


@look_alikes_exercise.mistake("1, The bench: three cameras and a rod")
def _columns_alone(angles_deg, rows_mm):
    """Two poses for each column are right where all columns are alike. A marker that is missing or
    lies elsewhere forbids most of them: try each pose.
    """
    return 2 * len(np.unique(np.round(angles_deg, 6)))


EXERCISES = (look_alikes_exercise.made(),)
