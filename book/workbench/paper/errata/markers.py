"""Errata of Sect. 5.1 and 5.2: threshold, epipolar distance and correlation as printed
(Eq. 16-18).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trinolab.camera import fundamental_matrix
from trinolab.checks import Array
from trinolab.datasets import load_rig, load_table1
from trinolab.markers import find_markers, iterative_threshold
from trinolab.matching import epipolar_distances, ncc, ncc_matrix

from ..ledger import Effect


def printed_bisection(image: Array, contours: float, most: int = 1000) -> tuple[float, float]:
    """The iteration of Sect. 5.1 as printed (Eq. 16): the number of steps, and of contours at its
    end.

    It ends when the number of contours *is* N; infinitely many steps if that has not come about
    after `most`.
    """
    t_min = float(image.min())
    t_max = float(image.max())
    n = 0
    for k in range(1, most + 1):
        threshold = (t_max + t_min) / 2
        n = cv2.connectedComponents((image > threshold).astype(np.uint8))[0] - 1
        if n == contours:
            return k, n
        t_min, t_max = (threshold, t_max) if n > contours else (t_min, threshold)
    return np.inf, n


def last_threshold_alone(image: ArrayLike, expected: int, surplus: float) -> Array:
    """The markers of the bisection's last binary image, which is all that Sect. 5.1 looks at, (n,
    2) px (Eq. 16).
    """
    grey = np.asarray(image)
    steps = iterative_threshold(grey, int(np.ceil(surplus * expected)))
    binary = (
        np.uint8(255) * (grey > steps[-1].threshold) if steps else np.zeros(grey.shape, np.uint8)
    )
    return find_markers(binary, 10 * expected).uv


def endless_bisection() -> Effect:
    """Steps of the bisection for N = 1.3 x 12 contours, no whole number (Eq. 16)."""
    image = _discs(bridge=60.0)
    printed, _ = printed_bisection(image, 1.3 * 12)
    return Effect(
        "16",
        "steps until the iteration ends, for lambda = 1.3 and N_0 = 12",
        "",
        printed,
        len(iterative_threshold(image, int(np.ceil(1.3 * 12)))),
        at_most=16,
    )


def wrong_way() -> Effect:
    """What is left at the end of eight markers that dimmer bridges join in pairs (Eq. 16)."""
    image = _discs(bridge=150.0)
    return Effect(
        "16",
        "contours at the end, or markers found, of eight that dimmer bridges join in pairs",
        "",
        printed_bisection(image, 8)[1],
        len(find_markers(image, 8).uv),
        8,
        8,
    )


def residual_for_a_distance() -> Effect:
    """What reads as the distance of points 1 px beside their epipolar lines, if f is the plain
    product (Eq. 17).
    """
    left, right = load_rig("paper_pair").cameras
    points = load_table1().set_poses.translation
    uv_left = left.project(points)
    uv_right = right.project(points)
    lines = np.column_stack([uv_left, np.ones(len(points))]) @ fundamental_matrix(left, right).T
    beside = uv_right + lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    residual = np.abs((lines * np.column_stack([beside, np.ones(len(points))])).sum(axis=1))
    distance = np.diag(epipolar_distances(left, right, uv_left, beside))
    return Effect(
        "17",
        "D of points 1 px beside their epipolar lines, if f is the product of P_j with the line",
        "px",
        float(residual.mean()),
        float(distance.mean()),
        1 - 1e-6,
        1 + 1e-6,
    )


def broken_bounds() -> Effect:
    """Correlation of a window with itself, if the last sum runs over y' alone as printed
    (Eq. 18).
    """
    window = np.random.default_rng(0).uniform(0, 255, (21, 21))
    centred = window - window.mean()
    printed = (centred**2).sum() / np.sqrt((centred**2).sum() * (centred[:, 0] ** 2).sum())
    return Effect(
        "18",
        "S of a window with itself, the last sum over y' alone",
        "",
        float(printed),
        ncc(window, window),
        1 - 1e-9,
        1 + 1e-9,
    )


def window_that_starts_at_its_point() -> Effect:
    """Correlation at the right pair of two equal images: T about its centroid, I from its centroid
    on (Eq. 18).
    """
    image = _discs(bridge=60.0)
    u, v = 44, 30  # centre of the second disc
    printed = ncc(image[v - 10 : v + 11, u - 10 : u + 11], image[v : v + 21, u : u + 21])
    corrected = ncc_matrix(image, image, [[u, v]], [[u, v]], 21)[0, 0]
    return Effect(
        "18",
        "S of a marker with itself, T about its centroid and I from there on; epsilon_0 is 0.5",
        "",
        printed,
        float(corrected),
        at_least=0.5,
    )


def _discs(bridge: float) -> Array:
    """Eight discs of grey 200 on a ground of 60, joined in pairs by bars of another grey level."""
    v, u = np.indices((110, 140))
    image = np.full(u.shape, 60.0)
    for y in (30, 80):
        for x in (20, 90):
            image[y - 2 : y + 3, x : x + 24] = bridge
    for y in (30, 80):
        for x in (20, 44, 90, 114):
            image[np.hypot(u - x, v - y) <= 5] = 200.0
    return image
