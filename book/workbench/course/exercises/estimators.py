"""Exercises of chapter 10: estimators."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

__all__ = ["step_of_all_views"]


def _views(rng, count, unseen=()):
    J = rng.normal(0, 1, (count, 2, 6)) * [5.0, 5.0, 5.0, 80.0, 80.0, 80.0]
    roots = rng.normal(0, 0.1, (count, 2, 2)) + [[0.3, 0.0], [0.0, 0.15]]
    off = rng.normal(0, 0.4, (count, 2))
    off[list(unseen)] = np.nan
    return J, roots @ roots.transpose(0, 2, 1), off


def _without_unseen(J, C, off):
    seen = np.isfinite(off).all(axis=1)
    return J[seen], C[seen], off[seen]


VIEWS = "10, The algorithm: all views at once"


step_of_all_views_exercise = FunctionExerciseMaker(
    "10.3", "Plain centroids, all views at once", "est-sixth", points=4
)


@step_of_all_views_exercise.solution
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


@step_of_all_views_exercise.cases
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


@step_of_all_views_exercise.mistake(VIEWS)
def _no_weights(J, C, off):
    """The centroids count alike, whatever their covariances: weight each by the inverse of its
    own.
    """
    J, C, off = _without_unseen(J, C, off)
    return step_of_all_views(J, np.tile(np.eye(2), (len(C), 1, 1)), off)


@step_of_all_views_exercise.mistake(VIEWS)
def _weight_of_covariance(J, C, off):
    """The weight is the covariance itself. It has to be its inverse: who scatters much counts
    little.
    """
    J, C, off = _without_unseen(J, C, off)
    return step_of_all_views(J, np.linalg.inv(C), off)


@step_of_all_views_exercise.mistake(VIEWS)
def _predicted_less_found(J, C, off):
    """The step goes the wrong way. `off` is found less predicted, and the pose moves along J
    towards what was found.
    """
    step, covariance = step_of_all_views(J, C, off)
    return -step, covariance


@step_of_all_views_exercise.mistake(VIEWS)
def _information_for_covariance(J, C, off):
    """The second result is the information. The covariance is its inverse."""
    step, covariance = step_of_all_views(J, C, off)
    return step, np.linalg.inv(covariance)


@step_of_all_views_exercise.mistake(VIEWS)
def _mean_information(J, C, off):
    """The information is averaged. It adds up: each view makes the pose surer."""
    step, covariance = step_of_all_views(J, C, off)
    return step, covariance * np.isfinite(off).all(axis=1).sum()


@step_of_all_views_exercise.mistake("10, Exercises")
def _unseen_as_exact(J, C, off):
    """A view that is not seen counts as if it had been found exactly where it was predicted. It
    has to be left out, its information as well.
    """
    return step_of_all_views(J, C, np.nan_to_num(off))


@step_of_all_views_exercise.mistake("10, Exercises")
def _unseen_spoil_all(J, C, off):
    """One view that is not seen makes the step NaN: leave it out."""
    if np.isnan(off).any():
        return np.full(6, np.nan), step_of_all_views(J, C, np.nan_to_num(off))[1]
    return step_of_all_views(J, C, off)


@step_of_all_views_exercise.mistake(VIEWS)
def _mean_of_steps(J, C, off):
    """Each view is solved by itself and the steps are averaged. One view has two numbers for six
    unknowns: sum the equations first, and solve once.

    Each view is solved by itself, as far as it goes, and the steps are averaged.
    """
    J, C, off = _without_unseen(J, C, off)
    steps = [np.linalg.lstsq(J_i, off_i)[0] for J_i, off_i in zip(J, off, strict=True)]
    return np.mean(steps, axis=0), step_of_all_views(J, C, off)[1]


EXERCISES = (step_of_all_views_exercise.made(),)
