"""Errata of Sect. 3: the cones as printed turn apart, and share nothing (Eq. 1-4)."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from trinolab.checks import Array, as_number
from trinolab.datasets import load_rig
from trinolab.workspace import intersect
from trinolab.workspace.cones import Cone, corners, half_angle, paper_cones

from ..ledger import Effect

# B, beta_1, beta_2, omega: axes that meet at 90 deg
RIGHT_ANGLED = (1.0, np.pi / 4, np.pi / 4, np.deg2rad(20.0))
ROUNDING_DEG = 1e-5


def printed_cones(
    baseline: float, beta1: float, beta2: float, half_angle: float
) -> tuple[Cone, Cone, Cone]:
    """The cones of CCD1, CCD2, CCD3 with the matrices and shifts exactly as printed (Eq. 1-3).

    The first two turn the wrong way, so that the cameras look away from each other; the third one
    turns about Y where the text says X, and lies along -X. `cones.paper_cones` is what the text
    means.

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
    turns = [
        np.pi / 2 - as_number(beta, name, low=0.0, high=np.pi / 2, open_low=True)
        for beta, name in ((beta1, "beta1"), (beta2, "beta2"))
    ]
    axes = [_printed_turn(angle)[:, 2] for angle in (turns[0], -turns[1], np.pi / 2)]
    apexes = [np.zeros(3), np.array([B, 0.0, 0.0]), np.array([B / 2, B / np.sqrt(2), B / 2])]
    first, second, third = (
        Cone(apex, axis, half_angle) for apex, axis in zip(apexes, axes, strict=True)
    )
    return first, second, third


def printed_workspace_volume(half_angle: float, beta: float = np.pi / 4) -> float:
    """The largest volume that the printed cones share, whichever nappe of each is meant, in B^3
    (Eq. 4).

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


def turn_of_ccd1() -> Effect:
    """How far CCD1's axis points beside the place where the axes of CCD1 and CCD2 are to meet
    (Eq. 1).
    """
    return _turn("1", 0)


def turn_of_ccd2() -> Effect:
    """How far CCD2's axis points beside that place (Eq. 2)."""
    return _turn("2", 1)


def turn_of_ccd3() -> Effect:
    """How far CCD3's axis is from perpendicular to the plane XOZ (Eq. 3)."""
    printed, corrected = (
        _between_deg(cones(*RIGHT_ANGLED)[2].axis, np.array([0.0, -1.0, 0.0]))
        for cones in (printed_cones, paper_cones)
    )
    return Effect(
        "3",
        "angle between CCD3's axis and the perpendicular of the plane XOZ",
        "deg",
        printed,
        corrected,
        at_most=ROUNDING_DEG,
    )


def shift_of_ccd3() -> Effect:
    """How far a CCD3 that looks along Y passes the place where the other axes meet, by the
    calibration (Eq. 3).
    """
    left, right = load_rig("paper_pair").cameras
    baseline = right.centre - left.centre
    B = float(np.linalg.norm(baseline))
    beta1, beta2 = (
        float(np.arccos(cosine / B)) for cosine in (left.axis @ baseline, -right.axis @ baseline)
    )
    x0 = B * np.tan(beta2) / (np.tan(beta1) + np.tan(beta2))
    printed, corrected = (
        float(np.hypot(cone.apex[0] - x0, cone.apex[2] - x0 * np.tan(beta1)))
        for cone in (printed_cones(B, beta1, beta2, 0.3)[2], paper_cones(B, beta1, beta2, 0.3)[2])
    )
    meaning = (
        "distance at which a CCD3 that looks along Y passes the place where the axes of CCD1 and CCD2 meet, "
        "with the baseline and the angles of Sect. 6.2"
    )
    return Effect("3", meaning, "mm", printed, corrected, at_most=1e-6)


def workspace_volume() -> Effect:
    """The volume that the three cones share at angles of 45 deg and a half angle of 20 deg
    (Eq. 4).
    """
    return Effect(
        "4",
        "volume of the workspace, at angles of 45 deg and a half angle of 20 deg",
        "B^3",
        printed_workspace_volume(RIGHT_ANGLED[3]),
        intersect(paper_cones(*RIGHT_ANGLED)).volume,
        at_least=0.001,
    )


def whole_sides() -> Effect:
    """The half angle from whole sides of the sensor, where it is to reach the image's corner
    (Sect. 3.2).
    """
    camera = load_rig("paper_pair").cameras[0]
    width, height = camera.size
    matrix = np.array(
        [[camera.focal[0], 0, (width - 1) / 2], [0, camera.focal[1], (height - 1) / 2], [0, 0, 1]]
    )
    central = replace(camera, matrix=matrix)
    corner = _between_deg(central.rays(corners(central))[0], central.axis)
    printed = np.rad2deg(np.arctan(np.hypot(*(camera.size / camera.focal))))
    return Effect(
        "Sect. 3.2",
        "half angle of the cone around CCD1's image, which its corner asks for",
        "deg",
        float(printed),
        float(np.rad2deg(half_angle(camera.size, camera.focal))),
        corner - ROUNDING_DEG,
        corner + ROUNDING_DEG,
    )


def _turn(no: str, camera: int) -> Effect:
    cones = paper_cones(*RIGHT_ANGLED)
    place = np.array([0.5, 0.0, 0.5]) - cones[camera].apex
    printed, corrected = (
        _between_deg(chosen[camera].axis, place) for chosen in (printed_cones(*RIGHT_ANGLED), cones)
    )
    meaning = (
        f"angle between CCD{camera + 1}'s axis and the direction to (B/2, 0, B/2), "
        "where the axes are to meet at angles of 45 deg"
    )
    return Effect(no, meaning, "deg", printed, corrected, at_most=ROUNDING_DEG)


def _between_deg(a: Array, b: Array) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _printed_turn(angle: float) -> np.ndarray:
    """The matrix that Sect. 3.2 prints three times, shape (3, 3)."""
    return np.array(
        [[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]]
    )
