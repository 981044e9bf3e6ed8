"""Experiments that would decide what Table 1 leaves open, and how large they have to be.

Scatter is compared by the F test of two variances; whose angles the constants are in, by which of
two fits leaves less. Chapter 9.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import as_number, as_whole

from .accounts import columns, fit_constants

MOST = 1000  # of anything that an experiment may repeat


def power_of_ratio(ratio: float, free: int, free_of_other: int, level: float = 0.05) -> float:
    """Chance that the one-sided F test finds one variance larger than another.

    Parameters
    ----------
    ratio : float
        Of the true variances, the larger by the other.
    free, free_of_other : int
        Degrees of freedom of the larger one's estimate and of the other's.
    level : float
        Of the test.
    """
    true = as_number(ratio, "ratio", low=0.0, open_low=True)
    limit = stats.f.isf(level, free, free_of_other)
    return float(stats.f.sf(limit / true, free, free_of_other))


def fewest(power: Callable[[int], float], wanted: float, start: int = 2) -> int:
    """The smallest number from `start` on whose power is the wanted one.

    Raises
    ------
    ValueError
        If a thousand are not enough.
    """
    for n in range(start, MOST + 1):
        if power(n) >= wanted:
            return n
    raise ValueError(f"wanted: expected a power that {MOST} reach, got {wanted}")


def told_apart(
    truths: RigidTransform,
    turn_deg: float,
    index_deg: tuple[float, float, float],
    repeat_deg: float,
    draws: int,
    rng: np.random.Generator,
) -> float:
    """How often a turned platform tells whose angles the constants are in: those of the fixture, or
    those that the cameras' frame defines.

    The platform stands turned about the vertical, and the fixture with it. Its angles have constant
    errors and scatter. Constants are fitted in the fixture's angles and in the cameras'; the smaller
    sum of squares wins.

    Parameters
    ----------
    truths : RigidTransform of length n
        Set poses as they are before the platform is turned.
    turn_deg : float
        About the world's y axis, which points down.
    index_deg : tuple of float
        Constant errors of the fixture's alpha, beta, gamma.
    repeat_deg : float
        Their standard deviation from pose to pose.
    draws : int
    rng : Generator

    Returns
    -------
    float
        Share of the draws in which the fixture's angles win, as they should.
    """
    n = as_whole(draws, "draws", low=1)
    turn = Rotation.from_euler("y", turn_deg, degrees=True)
    turned = RigidTransform.from_components(truths.translation, turn * truths.rotation)
    # a rotation vector in the fixture's own frame, carried to the cameras'
    of_fixture = turn.as_matrix() @ columns(truths, ["angles"])
    of_cameras = columns(turned, ["angles"])
    won = 0
    for _ in range(n):
        off = np.asarray(index_deg) + repeat_deg * rng.standard_normal((len(truths), 3))
        turns = np.einsum("nij,nj->ni", of_fixture, off)
        fits = [fit_constants(turns, design) for design in (of_fixture, of_cameras)]
        won += fits[0].square < fits[1].square
    return won / n
