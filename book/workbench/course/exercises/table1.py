"""Exercises of chapter 9: Table 1."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


def mean_angle_errors(measured_deg, set_deg):
    """Mean absolute errors of the three angles, lost poses left out (Eq. 27).

    Parameters
    ----------
    measured_deg, set_deg
        (n, 3), alpha, beta, gamma of n poses, deg. A lost pose is a row of NaN in `measured_deg`.

    Returns
    -------
    array
        (3,), E_alpha, E_beta, E_gamma, deg; three NaN if every pose is lost.
    """
    kept = np.isfinite(measured_deg).all(axis=1)
    if not kept.any():
        return np.full(3, np.nan)
    difference = (measured_deg - set_deg)[kept]
    wrapped = 180 - (180 - difference) % 360
    return np.abs(wrapped).mean(axis=0)


def _angle_cases(rng):
    near = rng.uniform(-60, 60, (5, 3))
    off = rng.normal(0.3, 0.8, (5, 3))
    across = np.array([[179.7, 10.0, -179.0], [-179.9, 20.0, 179.5], [30.0, -40.0, 178.9]])
    beyond = np.array([[-179.8, 10.4, 180.0], [179.6, 19.1, -179.7], [29.5, -41.0, -179.4]])
    some_lost = near + off
    some_lost[[1, 4]] = np.nan
    opposite = np.array([[0.0, 10.0, -90.0], [20.0, -30.0, 10.0]])
    return [
        (near + off, near),
        (near - off, near),
        (beyond, across),
        (some_lost, near),
        (opposite + [[180.0, 1.0, 170.0], [-170.0, 2.0, -175.0]], opposite),
        (np.full((2, 3), np.nan), near[:2]),
    ]


def _no_wrap(measured_deg, set_deg):
    kept = np.isfinite(measured_deg).all(axis=1)
    if not kept.any():
        return np.full(3, np.nan)
    return np.abs((measured_deg - set_deg)[kept]).mean(axis=0)


def _wrapped_errors(measured_deg, set_deg):
    """Signed errors (k, 3) of the poses that are not lost."""
    kept = np.isfinite(measured_deg).all(axis=1)
    return 180 - (180 - (measured_deg - set_deg)[kept]) % 360


def _or_nan(errors, combine):
    return combine(errors) if len(errors) else np.full(3, np.nan)


def _signed_mean(measured_deg, set_deg):
    return _or_nan(_wrapped_errors(measured_deg, set_deg), lambda e: e.mean(axis=0))


def _absolute_of_mean(measured_deg, set_deg):
    return np.abs(_signed_mean(measured_deg, set_deg))


def _sum_for_mean(measured_deg, set_deg):
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.abs(e).sum(axis=0))


def _root_mean_square(measured_deg, set_deg):
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.sqrt((e**2).mean(axis=0)))


def _lost_count_as_right(measured_deg, set_deg):
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.abs(e).sum(axis=0) / len(set_deg))


def _one_mean(measured_deg, set_deg):
    errors = _wrapped_errors(measured_deg, set_deg)
    return np.abs(errors).mean() if len(errors) else np.nan


def _in_radians(measured_deg, set_deg):
    return np.deg2rad(mean_angle_errors(measured_deg, set_deg))


def _lost_spoil_all(measured_deg, set_deg):
    wrapped = 180 - (180 - (measured_deg - set_deg)) % 360
    return np.abs(wrapped).mean(axis=0)


def _neither_wrapped_nor_lost(measured_deg, set_deg):
    return np.abs(measured_deg - set_deg).mean(axis=0)


def askew_differences(angles_deg, turn_deg, side):
    """How a fixed turn changes the angles of poses.

    Parameters
    ----------
    angles_deg
        (n, 3), alpha, beta, gamma of n set poses, deg; R = R_z(alpha) R_y(beta) R_x(gamma) turns
        the handle's frame into the world's.
    turn_deg
        (3,), a rotation vector, deg.
    side
        ``"handle"`` for a handle that is mounted askew, R' = R C; ``"world"`` for a reference that
        stands askew, R' = C R.

    Returns
    -------
    array
        (n, 3), angles of the turned poses less the set ones, deg, in (-180, 180].
    """
    R = Rotation.from_euler("ZYX", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    difference = turned.as_euler("ZYX", degrees=True) - angles_deg
    return 180 - (180 - difference) % 360


def _askew_cases(rng):
    angles = rng.uniform(-70, 70, (3, 3))
    across = np.array([[179.6, 15.0, -20.0], [40.0, -35.0, 179.8]])
    turns = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.7, -1.2, 2.0])
    return [
        *[(angles, np.array(turn), side) for turn in turns for side in ("handle", "world")],
        (across, np.array([1.0, 0.0, 0.0]), "handle"),
        (across, np.array([0.0, 0.0, 1.0]), "world"),
    ]


def _other_side(angles_deg, turn_deg, side):
    other = {"handle": "world", "world": "handle"}[side]
    return askew_differences(angles_deg, turn_deg, other)


def _turn_in_radians(angles_deg, turn_deg, side):
    return askew_differences(angles_deg, np.rad2deg(turn_deg), side)


def _turned_back(angles_deg, turn_deg, side):
    return askew_differences(angles_deg, -turn_deg, side)


def _set_less_turned(angles_deg, turn_deg, side):
    return -askew_differences(angles_deg, turn_deg, side)


def _not_wrapped(angles_deg, turn_deg, side):
    R = Rotation.from_euler("ZYX", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    return turned.as_euler("ZYX", degrees=True) - angles_deg


def _other_order(angles_deg, turn_deg, side):
    """Alpha about x and gamma about z: R = R_x R_y R_z with alpha, beta, gamma in this order."""
    R = Rotation.from_euler("XYZ", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    difference = turned.as_euler("XYZ", degrees=True) - angles_deg
    return 180 - (180 - difference) % 360


def _small_letters(angles_deg, turn_deg, side):
    """Angles about fixed axes, first z, then y, then x: R = R_x R_y R_z."""
    R = Rotation.from_euler("zyx", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    difference = turned.as_euler("zyx", degrees=True) - angles_deg
    return 180 - (180 - difference) % 360


ASKEW = "9, Is something mounted askew?"
BUDGET = "9, The budget"
PATTERN = "9, The pattern"
SPACE = "9, Where do the position errors lie?"
UNDECIDED = "9, What remains undecided"

EXERCISES = (
    ValueExercise(
        "09.1",
        "pencil",
        "One offset, two rotations",
        "table1-offset",
        2,
        (
            Mistake(
                "You have taken the root of the sum of squares, as if the three axes stood at right "
                "angles. Those of alpha and gamma do not: near 90 deg they fall together.",
                PATTERN,
                {"at_80": 0.6 * 3**0.5, "at_minus_80": 0.6 * 3**0.5},
            ),
            Mistake(
                "The sign of sin(beta) is the wrong way round: near +90 deg errors of alpha and gamma "
                "that are alike cancel, near -90 deg they add up.",
                PATTERN,
                {
                    "at_80": 0.6 * (3 + 2 * np.sin(np.deg2rad(80))) ** 0.5,
                    "at_minus_80": 0.6 * (3 - 2 * np.sin(np.deg2rad(80))) ** 0.5,
                },
            ),
            Mistake(
                "This is the sum of the three errors. Rotations about different axes add up as "
                "vectors.",
                PATTERN,
                {"at_0": 1.8},
            ),
            Mistake(
                "You have a cosine where the sine belongs: at beta = 0 the three axes stand at right "
                "angles, and at 90 deg two of them fall together.",
                PATTERN,
                {"at_0": 0.6, "at_80": 0.6 * (3 - 2 * np.cos(np.deg2rad(80))) ** 0.5},
            ),
        ),
        {
            "at_80": Asked(0.6 * (3 - 2 * np.sin(np.deg2rad(80))) ** 0.5, "deg", 0.01),
            "at_0": Asked(0.6 * 3**0.5, "deg", 0.01),
            "at_minus_80": Asked(0.6 * (3 + 2 * np.sin(np.deg2rad(80))) ** 0.5, "deg", 0.01),
        },
    ),
    ValueExercise(
        "09.2",
        "pencil",
        "How many poses for an offset?",
        "table1-count",
        2,
        (
            Mistake(
                "This is one standard error. An interval of 95 % reaches about twice as far to either "
                "side.",
                "9, Offset or scatter?",
                {"poses": 0.28**2 / 0.1**2, "of_twenty": 0.28 / 20**0.5},
            ),
            Mistake(
                "The standard error falls with the root of the number, not with the number: "
                "half the error needs four times as many poses.",
                "9, Offset or scatter?",
                {"poses": 5.8},  # 5.5, or a whole number of poses
            ),
            Mistake(
                "This is the interval of a single pose. That of a mean is narrower by the root of the "
                "number of poses.",
                "9, Offset or scatter?",
                {"of_twenty": 1.96 * 0.28},
            ),
            Mistake(
                "Plus or minus 0.1 deg is half the width of the interval, and not the whole.",
                "9, Offset or scatter?",
                {"poses": (1.96 * 0.28 / 0.05) ** 2},
            ),
        ),
        {
            # 30.1 with the normal distribution's 1.96, 33 with Student's factor
            "poses": Asked(31.5, within=2.2),
            "of_twenty": Asked(0.127, "deg", 0.0085),
        },
    ),
    FunctionExercise(
        "09.3",
        "write",
        "The errors of angles",
        "table1-wrap",
        4,
        (
            Mistake(
                "The differences are not brought into (-180, 180]: 180 and -179 deg are one degree "
                "apart, and not 359.",
                "9, Two poses by hand",
                _no_wrap,
            ),
            Mistake(
                "The differences keep their signs, so that errors of both signs cancel. That is the "
                "offset. Eq. 27 takes the absolute value of each.",
                "9, What the paper says",
                _signed_mean,
            ),
            Mistake(
                "The absolute value comes too late: it is taken of the mean, and belongs to each "
                "difference.",
                "9, What the paper says",
                _absolute_of_mean,
            ),
            Mistake(
                "This is the sum over the poses. Eq. 27 divides by their number.",
                "9, What the paper says",
                _sum_for_mean,
            ),
            Mistake(
                "This is the root mean square. Eq. 27 is the mean of absolute values, which is "
                "smaller.",
                "9, Table 1 again",
                _root_mean_square,
            ),
            Mistake(
                "This is one mean over all three angles. Each angle has a mean of its own: take it "
                "over the rows, axis 0.",
                "9, The algorithm",
                _one_mean,
            ),
            Mistake(
                "The means are in radians. They are asked for in degrees.",
                "9, The algorithm",
                _in_radians,
            ),
            Mistake(
                "Lost poses count as if they had no error: divide by the number of poses that are "
                "left.",
                "9, Exercises",
                _lost_count_as_right,
            ),
            Mistake(
                "One lost pose makes every mean NaN: leave its row out first.",
                "9, Exercises",
                _lost_spoil_all,
            ),
            Mistake(
                "The differences are not brought into (-180, 180], and one lost pose makes every mean "
                "NaN.",
                "9, Two poses by hand",
                _neither_wrapped_nor_lost,
            ),
        ),
        mean_angle_errors,
        _angle_cases,
    ),
    FunctionExercise(
        "09.4",
        "write",
        "A handle mounted askew",
        "table1-askew",
        4,
        (
            Mistake(
                "The sides are exchanged. A turn in the handle's frame stands on the right, R C; one "
                "in the world's on the left, C R.",
                ASKEW,
                _other_side,
            ),
            Mistake(
                "The rotation vector is taken for radians. It is given in degrees.",
                "9, Exercises",
                _turn_in_radians,
            ),
            Mistake(
                "The turn goes backwards: you have C transposed in place of C.",
                ASKEW,
                _turned_back,
            ),
            Mistake(
                "You have set less turned. Turned less set is asked for.",
                "9, Exercises",
                _set_less_turned,
            ),
            Mistake(
                "The differences are not brought into (-180, 180].",
                "9, Two poses by hand",
                _not_wrapped,
            ),
            Mistake(
                'In SciPy the small letters "zyx" turn about axes that stay, and give R_x R_y R_z. '
                'R = R_z R_y R_x is "ZYX", with capital letters.',
                ASKEW,
                _small_letters,
            ),
            Mistake(
                "Alpha is taken about x and gamma about z. Alpha belongs to z, beta to y, gamma to x.",
                "9, The algorithm",
                _other_order,
            ),
        ),
        askew_differences,
        _askew_cases,
        within=1e-8,
    ),
    ValueExercise(
        "09.5",
        "predict",
        "A stricter judge",
        "table1-level",
        3,
        (
            Mistake(
                "That many are left at 0.05. At 0.001 a corrected p has to be below 0.001, and the "
                "smallest that 19,999 tables can give is 0.0001 times the number of tests.",
                PATTERN,
                {"left": 3},
            ),
            Mistake(
                "These are the models that are refused. Asked are those that are left.",
                PATTERN,
                {"left": 0},
            ),
            Mistake(
                "A rarer false alarm costs power: the test has to see more before it says anything, "
                "so that the experiments have to be larger.",
                UNDECIDED,
                {"experiments": "smaller"},
            ),
            Mistake(
                "These are the sizes for level = 0.05. Change the parameter and run the chapter "
                "again.",
                UNDECIDED,
                {"clampings": 6, "near": 8},
            ),
        ),
        {
            "experiments": Asked("larger", choices=("smaller", "the same", "larger")),
            "left": Asked(19, within=0.1),
            "clampings": Asked(12, within=0.1),
            "near": Asked(27, within=0.1),
        },
    ),
    ValueExercise(
        "09.6",
        "project",
        "A source of your own",
        "table1-source",
        5,
        (
            Mistake(
                "This is a turn about x, the first axis: the image moves across the epipolar lines. "
                "About y it moves along them.",
                BUDGET,
                {"before_mm": 0.0143, "after_mm": 0.01156},
            ),
            Mistake(
                "This is a turn about z, the last axis. About y it is the second column of the roots.",
                BUDGET,
                {"before_mm": 0.1412, "after_mm": 0.03667},
            ),
            Mistake(
                "The errors are not registered: take away the rigid motion that all poses have in "
                "common.",
                BUDGET,
                {"after_mm": 2.87},
            ),
            Mistake(
                "This is the share that is not smooth. The smooth one is what is missing to 1.",
                SPACE,
                {"smooth_share": 0.006},
            ),
            Mistake(
                "A knock about y is not missed: it is vergence, and moves depth by millimetres.",
                BUDGET,
                {"missed": "y"},
            ),
            Mistake(
                "A knock about z is not missed by both: its errors are small, but nearly all of what "
                "is left is smooth.",
                SPACE,
                {"missed": "z"},
            ),
        ),
        {
            # to first order 2.869 and 0.3325; really turned to either side 2.853 to 2.883 and
            # 0.330 to 0.334, about the camera's y or the world's
            "before_mm": Asked(2.868, "mm", 0.03),
            "after_mm": Asked(0.3325, "mm", 0.005),
            "smooth_share": Asked(0.994, within=0.005),
            "missed": Asked("x", choices=("x", "y", "z")),
        },
    ),
)
