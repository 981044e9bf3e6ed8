"""The paper's misprints as printed, each beside what shows that it is one. Nothing here is for use."""

from __future__ import annotations

from itertools import product

import numpy as np

from .checks import as_number
from .cones import Cone
from .datasets import load_calibration, nearest_rotation
from .workspace import intersect


def printed_cones(baseline: float, beta1: float, beta2: float, half_angle: float) -> tuple[Cone, Cone, Cone]:
    """The cones of CCD1, CCD2, CCD3 with the matrices and shifts exactly as printed (Eq. 1-3).

    The first two turn the wrong way, so that the cameras look away from each other; the third one turns about Y where
    the text says X, and lies along -X. `cones.paper_cones` is what the text means.

    Parameters
    ----------
    baseline : float
        B, mm, positive.
    beta1, beta2 : float
        rad, in (0, pi/2].
    half_angle : float
        omega, rad, in (0, pi/2).

    Raises
    ------
    ValueError
        For a number out of its range.
    """
    B = as_number(baseline, "baseline", low=0.0, open_low=True)
    turns = [np.pi / 2 - as_number(beta, name, low=0.0, high=np.pi / 2, open_low=True)
             for beta, name in ((beta1, "beta1"), (beta2, "beta2"))]
    axes = [_printed_turn(angle)[:, 2] for angle in (turns[0], -turns[1], np.pi / 2)]
    apexes = [np.zeros(3), np.array([B, 0.0, 0.0]), np.array([B / 2, B / np.sqrt(2), B / 2])]
    first, second, third = (Cone(apex, axis, half_angle) for apex, axis in zip(apexes, axes, strict=True))
    return first, second, third


def printed_workspace_volume(half_angle: float, beta: float = np.pi / 4) -> float:
    """The largest volume that the printed cones share, whichever nappe of each is meant, in B^3 (Eq. 4).

    Parameters
    ----------
    half_angle, beta : float
        omega and beta_1 = beta_2, rad.

    Returns
    -------
    float
        0 where they share none, infinite where what they share has no end.

    Raises
    ------
    ValueError
        As `printed_cones` does.
    """
    cones = printed_cones(1.0, beta, beta, half_angle)
    nappes = product(*((cone, Cone(cone.apex, -cone.axis, cone.half_angle)) for cone in cones))
    return max(intersect(chosen).volume for chosen in nappes)


def printed_rotation_error() -> tuple[float, float]:
    """How far the printed R_rl is from the nearest rotation: Frobenius norm, and the largest entry (Sect. 6.2).

    Rounding a rotation to four decimals moves it by at most 1.5e-4 in the Frobenius norm, so that the nearest rotation
    would be no farther than that.
    """
    R_rl = load_calibration().R_rl
    difference = R_rl - nearest_rotation(R_rl).as_matrix()
    return float(np.linalg.norm(difference)), float(np.abs(difference).max())


def _printed_turn(angle: float) -> np.ndarray:
    """The matrix that Sect. 3.2 prints three times, shape (3, 3)."""
    return np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]])
