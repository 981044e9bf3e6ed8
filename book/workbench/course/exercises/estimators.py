"""Exercises of chapter 10: estimators."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

VIEWS = "10, The algorithm: all views at once"


variance_without_exercise = FunctionExerciseMaker(
    "10.3", "Which view is missed most?", "est-sixth", points=4
)


@variance_without_exercise.solution
def variance_without(J, C):
    """How sure the position is without each of the views, one at a time.

    Parameters
    ----------
    J
        (k, 2, 6), how each of the k predicted centroids moves with the pose: px by a shift of 1 mm
        along x, y, z and by a turn of 1 rad about them.
    C
        (k, 2, 2), covariance of each found centroid, px^2.

    Returns
    -------
    array
        (k,), the trace of the position's covariance when that view is left out, mm^2. Infinite if
        fewer than three views are left, since two have four numbers for six unknowns.
    """
    information = np.array(
        [J_i.T @ np.linalg.inv(C_i) @ J_i for J_i, C_i in zip(J, C, strict=True)]
    )
    traces = []
    for k in range(len(J)):
        left = np.delete(information, k, axis=0)
        if len(left) < 3:
            traces.append(np.inf)
        else:
            covariance = np.linalg.inv(left.sum(axis=0))
            traces.append(np.trace(covariance[:3, :3]))
    return np.array(traces)


@variance_without_exercise.cases
def _view_cases(rng):
    def views(count):
        J = rng.normal(0, 1, (count, 2, 6)) * [5.0, 5.0, 5.0, 80.0, 80.0, 80.0]
        roots = rng.normal(0, 0.1, (count, 2, 2)) + [[0.3, 0.0], [0.0, 0.15]]
        return J, roots @ roots.transpose(0, 2, 1)

    J, _ = views(6)
    return [
        (J, np.tile(0.04 * np.eye(2), (6, 1, 1))),
        views(5),
        views(8),
        views(3),
        views(4),
        views(12),
    ]


def _information(J, C):
    return J.transpose(0, 2, 1) @ np.linalg.inv(C) @ J


def _of_each(J, C, say):
    """What `say` makes of the information that is left without each view."""
    whole = _information(J, C)
    if len(J) < 4:
        return np.full(len(J), np.inf)
    return np.array([say(np.delete(whole, k, axis=0).sum(axis=0)) for k in range(len(J))])


@variance_without_exercise.mistake(VIEWS)
def _angles_known(J, C):
    """The angles are taken for known: the upper left part of the information is inverted. Invert the
    whole 6 x 6, and take the upper left part of that.
    """
    return _of_each(J, C, lambda left: np.trace(np.linalg.inv(left[:3, :3])))


@variance_without_exercise.mistake(VIEWS)
def _with_the_angles(J, C):
    """The trace is that of all six unknowns. mm^2 and rad^2 do not add up: take the first three."""
    return _of_each(J, C, lambda left: np.trace(np.linalg.inv(left)))


@variance_without_exercise.mistake(VIEWS)
def _no_inverse(J, C):
    """This is the trace of the information. The covariance is its inverse."""
    return _of_each(J, C, lambda left: np.trace(left[:3, :3]))


@variance_without_exercise.mistake(VIEWS)
def _deviation(J, C):
    """This is the root of what is asked for: the trace itself, in mm^2."""
    return np.sqrt(variance_without(J, C))


@variance_without_exercise.mistake(VIEWS)
def _weight_of_covariance(J, C):
    """The weight is the covariance itself. It has to be its inverse: who scatters much counts
    little.
    """
    return variance_without(J, np.linalg.inv(C))


@variance_without_exercise.mistake(VIEWS)
def _no_weights(J, C):
    """The centroids count alike, whatever their covariances: weight each by the inverse of its
    own.
    """
    return variance_without(J, np.tile(np.eye(2), (len(C), 1, 1)))


@variance_without_exercise.mistake("10, Exercises")
def _nothing_left_out(J, C):
    """No view is left out: each time all of them are summed."""
    covariance = np.linalg.inv(_information(J, C).sum(axis=0))
    few = np.inf if len(J) < 4 else np.trace(covariance[:3, :3])
    return np.full(len(J), few)


@variance_without_exercise.mistake("10, Exercises")
def _growth(J, C):
    """This is by how much the variance grows. The variance itself is asked for."""
    return variance_without(J, C) - np.trace(np.linalg.inv(_information(J, C).sum(axis=0))[:3, :3])


EXERCISES = (variance_without_exercise.made(),)
