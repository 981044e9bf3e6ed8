"""Exercises of chapter 9: Table 1."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker


def _wrapped_errors(measured_deg, set_deg):
    """Signed errors (k, 3) of the poses that are not lost."""
    kept = np.isfinite(measured_deg).all(axis=1)
    return 180 - (180 - (measured_deg - set_deg)[kept]) % 360


def _or_nan(errors, combine):
    return combine(errors) if len(errors) else np.full(3, np.nan)


ASKEW = "9, Is something mounted askew?"


mean_angle_errors_exercise = FunctionExerciseMaker(
    "09.3", "The errors of angles", "table1-wrap", points=4, within=1e-5
)


@mean_angle_errors_exercise.solution
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


@mean_angle_errors_exercise.cases
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


@mean_angle_errors_exercise.mistake("9, Two poses by hand")
def _no_wrap(measured_deg, set_deg):
    """The differences are not brought into (-180, 180]: 180 and -179 deg are one degree apart, and
    not 359.
    """
    kept = np.isfinite(measured_deg).all(axis=1)
    if not kept.any():
        return np.full(3, np.nan)
    return np.abs((measured_deg - set_deg)[kept]).mean(axis=0)


@mean_angle_errors_exercise.mistake("9, What the paper says")
def _signed_mean(measured_deg, set_deg):
    """The differences keep their signs, so that errors of both signs cancel. That is the offset.
    Eq. 27 takes the absolute value of each.
    """
    return _or_nan(_wrapped_errors(measured_deg, set_deg), lambda e: e.mean(axis=0))


@mean_angle_errors_exercise.mistake("9, What the paper says")
def _absolute_of_mean(measured_deg, set_deg):
    """The absolute value comes too late: it is taken of the mean, and belongs to each difference."""
    return np.abs(_signed_mean(measured_deg, set_deg))


@mean_angle_errors_exercise.mistake("9, What the paper says")
def _sum_for_mean(measured_deg, set_deg):
    """This is the sum over the poses. Eq. 27 divides by their number."""
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.abs(e).sum(axis=0))


@mean_angle_errors_exercise.mistake("9, Table 1 again")
def _root_mean_square(measured_deg, set_deg):
    """This is the root mean square. Eq. 27 is the mean of absolute values, which is smaller."""
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.sqrt((e**2).mean(axis=0)))


@mean_angle_errors_exercise.mistake("9, The algorithm")
def _one_mean(measured_deg, set_deg):
    """This is one mean over all three angles. Each angle has a mean of its own: take it over the
    rows, axis 0.
    """
    errors = _wrapped_errors(measured_deg, set_deg)
    return np.abs(errors).mean() if len(errors) else np.nan


@mean_angle_errors_exercise.mistake("9, The algorithm")
def _in_radians(measured_deg, set_deg):
    """The means are in radians. They are asked for in degrees."""
    return np.deg2rad(mean_angle_errors(measured_deg, set_deg))


@mean_angle_errors_exercise.mistake("9, Exercises")
def _lost_count_as_right(measured_deg, set_deg):
    """Lost poses count as if they had no error: divide by the number of poses that are left."""
    errors = _wrapped_errors(measured_deg, set_deg)
    return _or_nan(errors, lambda e: np.abs(e).sum(axis=0) / len(set_deg))


@mean_angle_errors_exercise.mistake("9, Exercises")
def _lost_spoil_all(measured_deg, set_deg):
    """One lost pose makes every mean NaN: leave its row out first."""
    wrapped = 180 - (180 - (measured_deg - set_deg)) % 360
    return np.abs(wrapped).mean(axis=0)


@mean_angle_errors_exercise.mistake("9, Two poses by hand")
def _neither_wrapped_nor_lost(measured_deg, set_deg):
    """The differences are not brought into (-180, 180], and one lost pose makes every mean NaN."""
    return np.abs(measured_deg - set_deg).mean(axis=0)


askew_differences_exercise = FunctionExerciseMaker(
    "09.4", "A handle clamped askew", "table1-askew", points=4, within=1e-5
)


@askew_differences_exercise.solution
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
        ``"handle"`` for a handle that is clamped askew, R' = R C; ``"world"`` for a reference that
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


@askew_differences_exercise.cases
def _askew_cases(rng):
    angles = rng.uniform(-70, 70, (3, 3))
    across = np.array([[179.6, 15.0, -20.0], [40.0, -35.0, 179.8]])
    turns = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.7, -1.2, 2.0])
    return [
        *[(angles, np.array(turn), side) for turn in turns for side in ("handle", "world")],
        (across, np.array([1.0, 0.0, 0.0]), "handle"),
        (across, np.array([0.0, 0.0, 1.0]), "world"),
    ]


@askew_differences_exercise.mistake(ASKEW)
def _other_side(angles_deg, turn_deg, side):
    """The sides are exchanged. A turn in the handle's frame stands on the right, R C; one in the
    world's on the left, C R.
    """
    other = {"handle": "world", "world": "handle"}[side]
    return askew_differences(angles_deg, turn_deg, other)


@askew_differences_exercise.mistake("9, Exercises")
def _turn_in_radians(angles_deg, turn_deg, side):
    """The rotation vector is taken for radians. It is given in degrees."""
    return askew_differences(angles_deg, np.rad2deg(turn_deg), side)


@askew_differences_exercise.mistake(ASKEW)
def _turned_back(angles_deg, turn_deg, side):
    """The turn goes backwards: you have C transposed in place of C."""
    return askew_differences(angles_deg, -turn_deg, side)


@askew_differences_exercise.mistake("9, Exercises")
def _set_less_turned(angles_deg, turn_deg, side):
    """You have set less turned. Turned less set is asked for."""
    return -askew_differences(angles_deg, turn_deg, side)


@askew_differences_exercise.mistake("9, Two poses by hand")
def _not_wrapped(angles_deg, turn_deg, side):
    """The differences are not brought into (-180, 180]."""
    R = Rotation.from_euler("ZYX", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    return turned.as_euler("ZYX", degrees=True) - angles_deg


@askew_differences_exercise.mistake(ASKEW)
def _small_letters(angles_deg, turn_deg, side):
    """In SciPy the small letters "zyx" turn about axes that stay, and give R_x R_y R_z. R = R_z
    R_y R_x is "ZYX", with capital letters.

    Angles about fixed axes, first z, then y, then x: R = R_x R_y R_z.
    """
    R = Rotation.from_euler("zyx", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    difference = turned.as_euler("zyx", degrees=True) - angles_deg
    return 180 - (180 - difference) % 360


@askew_differences_exercise.mistake("9, The algorithm")
def _other_order(angles_deg, turn_deg, side):
    """Alpha is taken about x and gamma about z. Alpha belongs to z, beta to y, gamma to x.

    Alpha about x and gamma about z: R = R_x R_y R_z with alpha, beta, gamma in this order.
    """
    R = Rotation.from_euler("XYZ", angles_deg, degrees=True)
    C = Rotation.from_rotvec(turn_deg, degrees=True)
    turned = R * C if side == "handle" else C * R
    difference = turned.as_euler("XYZ", degrees=True) - angles_deg
    return 180 - (180 - difference) % 360


EXERCISES = (
    mean_angle_errors_exercise.made(),
    askew_differences_exercise.made(),
)
