"""Exercises of chapter 10: estimators."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


def step_of_all_views(J, C, off):
    """One step of the fit of a pose to all views at once.

    Parameters
    ----------
    J
        (k, 2, 6), how each of the k predicted centroids moves with the pose: px by a shift of 1 mm
        along x, y, z and by a turn of 1 rad about them.
    C
        (k, 2, 2), covariance of each found centroid, px^2.
    off
        (k, 2), found less predicted centroids, px; a row of NaN where a camera does not see the
        marker.

    Returns
    -------
    step
        (6,), by how much the pose has to move: mm, then rad.
    covariance
        (6, 6), of the pose that is reached.
    """
    information = np.zeros((6, 6))
    right = np.zeros(6)
    for J_i, C_i, off_i in zip(J, C, off, strict=True):
        if np.isnan(off_i).any():
            continue
        W = np.linalg.inv(C_i)
        information += J_i.T @ W @ J_i
        right += J_i.T @ W @ off_i
    return np.linalg.solve(information, right), np.linalg.inv(information)


def _views(rng, count, unseen=()):
    J = rng.normal(0, 1, (count, 2, 6)) * [5.0, 5.0, 5.0, 80.0, 80.0, 80.0]
    roots = rng.normal(0, 0.1, (count, 2, 2)) + [[0.3, 0.0], [0.0, 0.15]]
    off = rng.normal(0, 0.4, (count, 2))
    off[list(unseen)] = np.nan
    return J, roots @ roots.transpose(0, 2, 1), off


def _step_cases(rng):
    alike = np.tile(0.04 * np.eye(2), (6, 1, 1))
    J, _, off = _views(rng, 6)
    return [
        (J, alike, off),
        _views(rng, 5),
        _views(rng, 8),
        _views(rng, 9, (0, 4)),
        _views(rng, 7, (6,)),
        _views(rng, 12, (1, 2, 3)),
    ]


def _without_unseen(J, C, off):
    seen = np.isfinite(off).all(axis=1)
    return J[seen], C[seen], off[seen]


def _no_weights(J, C, off):
    J, C, off = _without_unseen(J, C, off)
    return step_of_all_views(J, np.tile(np.eye(2), (len(C), 1, 1)), off)


def _weight_of_covariance(J, C, off):
    J, C, off = _without_unseen(J, C, off)
    return step_of_all_views(J, np.linalg.inv(C), off)


def _predicted_less_found(J, C, off):
    step, covariance = step_of_all_views(J, C, off)
    return -step, covariance


def _information_for_covariance(J, C, off):
    step, covariance = step_of_all_views(J, C, off)
    return step, np.linalg.inv(covariance)


def _mean_information(J, C, off):
    step, covariance = step_of_all_views(J, C, off)
    return step, covariance * np.isfinite(off).all(axis=1).sum()


def _unseen_as_exact(J, C, off):
    return step_of_all_views(J, C, np.nan_to_num(off))


def _unseen_spoil_all(J, C, off):
    if np.isnan(off).any():
        return np.full(6, np.nan), step_of_all_views(J, C, np.nan_to_num(off))[1]
    return step_of_all_views(J, C, off)


def _mean_of_steps(J, C, off):
    """Each view is solved by itself, as far as it goes, and the steps are averaged."""
    J, C, off = _without_unseen(J, C, off)
    steps = [np.linalg.lstsq(J_i, off_i)[0] for J_i, off_i in zip(J, off, strict=True)]
    return np.mean(steps, axis=0), step_of_all_views(J, C, off)[1]


CENTROID = "10, The centroid of a wrapped marker"
VIEWS = "10, The algorithm: all views at once"
PIXELS = "10, The algorithm: no centroids at all"
HONEST = "10, Is a covariance honest?"
ELSEWHERE = "10, What happens if CCD3 stands elsewhere?"

EXERCISES = (
    ValueExercise(
        "10.1",
        "pencil",
        "Smaller markers",
        "est-smaller",
        2,
        (
            Mistake(
                "The bias is taken to go with the radius. The formula has its square.",
                CENTROID,
                {"bias": 0.5},
            ),
            Mistake(
                "The information is taken to go with the area. Only the edge tells of a shift: a disc "
                "has pi d pixels of it.",
                VIEWS,
                {"scatter": 2.0},
            ),
            Mistake(
                "A shorter edge holds less information, so that the scatter grows; yours shrinks.",
                VIEWS,
                {"scatter": 0.5**0.5},
            ),
            Mistake(
                "This is the factor of the information. The scatter goes with one over its root.",
                VIEWS,
                {"scatter": 0.5},
            ),
        ),
        {"bias": Asked(0.25, within=0.005), "scatter": Asked(2**0.5, within=0.015)},
    ),
    ValueExercise(
        "10.2",
        "pencil",
        "What a known grey is worth",
        "est-greys",
        2,
        (
            Mistake(
                "The second term is added. It is the price for not knowing the grey, and is "
                "subtracted.",
                PIXELS,
                {"unknown": 6.8},
            ),
            Mistake(
                "The square of the mixed term is not divided by the information on the grey, "
                "K^T W K.",
                PIXELS,
                {"unknown": 2.75},
            ),
            Mistake(
                "The weights are left out: the second pixel counts by a quarter.",
                PIXELS,
                {"known": 8.0},
            ),
            Mistake(
                "The weights are squared. W holds inverse variances already, and stands once in each "
                "term.",
                PIXELS,
                {"known": 4.25, "unknown": 4.25 - 1.875**2 / 1.0625},
            ),
            Mistake(
                "Both slopes have been given the same sign. A shift makes one edge brighter and the "
                "other one darker.",
                PIXELS,
                {"lost_even": 8.0},
            ),
        ),
        {
            "known": Asked(5.0, "px^-2", 0.01),
            "unknown": Asked(3.2, "px^-2", 0.01),
            "lost_even": Asked(0.0, "px^-2", 0.01),
        },
    ),
    FunctionExercise(
        "10.3",
        "write",
        "Plain centroids, all views at once",
        "est-sixth",
        4,
        (
            Mistake(
                "The centroids count alike, whatever their covariances: weight each by the inverse of "
                "its own.",
                VIEWS,
                _no_weights,
            ),
            Mistake(
                "The weight is the covariance itself. It has to be its inverse: who scatters much "
                "counts little.",
                VIEWS,
                _weight_of_covariance,
            ),
            Mistake(
                "The step goes the wrong way. `off` is found less predicted, and the pose moves along "
                "J towards what was found.",
                VIEWS,
                _predicted_less_found,
            ),
            Mistake(
                "The second result is the information. The covariance is its inverse.",
                VIEWS,
                _information_for_covariance,
            ),
            Mistake(
                "The information is averaged. It adds up: each view makes the pose surer.",
                VIEWS,
                _mean_information,
            ),
            Mistake(
                "A view that is not seen counts as if it had been found exactly where it was "
                "predicted. It has to be left out, its information as well.",
                "10, Exercises",
                _unseen_as_exact,
            ),
            Mistake(
                "One view that is not seen makes the step NaN: leave it out.",
                "10, Exercises",
                _unseen_spoil_all,
            ),
            Mistake(
                "Each view is solved by itself and the steps are averaged. One view has two numbers "
                "for six unknowns: sum the equations first, and solve once.",
                VIEWS,
                _mean_of_steps,
            ),
        ),
        step_of_all_views,
        _step_cases,
        within=1e-7,
    ),
    ValueExercise(
        "10.4",
        "predict",
        "An honest NEES, spoilt",
        "est-spoilt",
        3,
        (
            Mistake(
                "A common factor of all covariances stands on both sides of the equation for the "
                "step, and cancels: the pose stays.",
                VIEWS,
                {"pose": "moves"},
            ),
            Mistake(
                "This is the factor of the sigmas. The covariance has the square of it.",
                VIEWS,
                {"covariance": 2.0},
            ),
            Mistake(
                "In the NEES the covariance is inverted: one that is too large makes it smaller.",
                HONEST,
                {"nees": 4.0},
            ),
            Mistake(
                "The NEES is a square: it falls by the same factor as the covariance grows, and not "
                "by its root.",
                HONEST,
                {"nees": 0.5},
            ),
            Mistake(
                "With those of CCD3 alone nothing cancels: its views lose weight against the others', "
                "so that the pose moves, though little.",
                VIEWS,
                {"pose_ccd3": "stays"},
            ),
        ),
        {
            "pose": Asked("stays", choices=("stays", "moves")),
            "covariance": Asked(4.0, within=0.02),
            "nees": Asked(0.25, within=0.005),
            "pose_ccd3": Asked("moves", choices=("stays", "moves")),
        },
    ),
    ValueExercise(
        "10.5",
        "project",
        "A third camera, anywhere",
        "est-place",
        5,
        (
            Mistake(
                "These are means over the poses. The worst pose is asked for.",
                "10, Exercises",
                {"pair_um": 10.06, "third_um": 3.537, "hidden_um": 4.305},
            ),
            Mistake(
                "The trace runs over all six numbers, and adds rad^2 to mm^2. Take the three of the "
                "position.",
                HONEST,
                {"pair_um": 19.83, "third_um": 5.690, "hidden_um": 7.572},
            ),
            Mistake(
                "You have inverted the upper left part of the information. That is for a handle whose "
                "orientation is known. Invert all of it first, then take the part.",
                PIXELS,
                {"pair_um": 10.645, "third_um": 2.649, "hidden_um": 3.131},
            ),
            Mistake(
                "Only markers that two cameras share are counted. Without pairs a view of one camera "
                "counts as well.",
                VIEWS,
                {"third_um": 8.432},
            ),
            Mistake(
                "These are millimetres. Micrometres are asked for.",
                "10, Exercises",
                {"pair_um": 0.01941, "third_um": 0.005567, "hidden_um": 0.007403},
            ),
            Mistake(
                "That many poses have three shared markers with CCD3 at 40 deg. At 90 deg it looks "
                "from above, and shares hardly any.",
                ELSEWHERE,
                {"shared_90": 16},
            ),
        ),
        {
            "pair_um": Asked(19.41, "um", 0.1),
            "third_um": Asked(5.567, "um", 0.05),
            "hidden_um": Asked(7.403, "um", 0.04),
            "shared_90": Asked(2, within=0.1),
        },
    ),
)
