"""Stills of the handle: what makes a threshold fail, and where a turned marker's centroid lies (Sect. 5.1)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .bench import Bench, blurred, digitise
from .camera import Camera
from .checks import Array, frozen
from .datasets import load_handle, load_rig, load_table1
from .handle import slants
from .markers import find_markers
from .scene import radiance

DISTANCE_MM = 570.0
SHOWN_DEG = 85.0  # a marker turned further away does not show
SEEN_DEG = 77.0  # nor is its centroid asked for beyond this
NEAR_PX = 3.0  # a spot further from a marker's centre is another thing
DISC, BRIDGE, BEHIND = 220.0, 120.0, 45.0  # greys of the bridged discs


class Still(NamedTuple):
    """An image, its markers' centres (n, 2), px, and how far each is turned away, deg (n,): the least turned first."""

    image: np.ndarray
    uv: Array
    slants_deg: Array


def still_view() -> Camera:
    """CCD1, its image cut to 320 px about the axis."""
    camera = load_rig("paper_pair").cameras[0]
    matrix = np.array(camera.matrix)
    matrix[:2, 2] = 160
    return replace(camera, size=(320, 320), matrix=matrix)


def still(rotation: Rotation, bench: Bench, rng: np.random.Generator) -> Still:
    """Take an image of the paper's handle with a given orientation, in the middle of the image."""
    lit = _lit(rotation, bench)
    return lit._replace(image=digitise(lit.image, bench, rng))


def hostile_stills(bench: Bench, rng: np.random.Generator) -> dict[str, Still]:
    """The handle of Table 1's eighth pose, and what makes thresholds fail, by name.

    Eight discs, in pairs joined by a dimmer bridge; a textured background brighter than the rod; a glint along the
    column that faces the camera.
    """
    rotation = load_table1().set_poses.rotation[7]
    plain = still(rotation, bench, rng)
    wall = still(rotation, replace(bench, background_grey=150, texture_contrast=0.25), rng)
    ends = np.array([[1.7, -0.7], [-0.7, 1.7]]) @ plain.uv[:2]
    (x0, y0), (x1, y1) = ends.astype(int).tolist()
    glint = cv2.line(plain.image.copy(), (x0, y0), (x1, y1), 255, 5, cv2.LINE_AA)
    return {"standard scene": plain, "bridges": _bridged_discs(), "bright background": wall,
            "glint": plain._replace(image=glint)}


def inward(turn_deg: float, bench: Bench, rng: np.random.Generator, draws: int = 1) -> tuple[Array, Array]:
    """How far the centroids of a turned, upright rod lie inwards of the markers' centres, towards the rod's axis.

    Parameters
    ----------
    turn_deg : float
        Of the rod about its axis; 0 turns a column to the camera.
    bench : Bench
    rng : numpy.random.Generator
        For the noise.
    draws : int
        Images taken, with other noise each.

    Returns
    -------
    slants_deg : ndarray, shape (n,)
    shifts_px : ndarray, shape (draws, n)
        NaN where no spot is near the marker.
    """
    lit = _lit(Rotation.from_euler("Y", 180 + turn_deg, degrees=True), bench)
    asked = lit.slants_deg < SEEN_DEG
    shifts = [_shifts(lit._replace(image=digitise(lit.image, bench, rng))) for _ in range(draws)]
    return frozen(lit.slants_deg[asked]), frozen(np.array(shifts)[:, asked])


def _lit(rotation: Rotation, bench: Bench) -> Still:
    """A still before the noise."""
    view, handle = still_view(), load_handle("paper")
    T = RigidTransform.from_components([0.0, 0.0, DISTANCE_MM], rotation)
    slant = np.rad2deg(slants(handle, T, view.centre))
    shown = np.argsort(slant)[:np.count_nonzero(slant < SHOWN_DEG)]
    uv = view.project(T.apply(handle.marker_centres[shown]))
    return Still(blurred(radiance(view, handle, T, bench), bench), frozen(uv), frozen(slant[shown]))


def _shifts(taken: Still) -> Array:
    """Along u towards the middle of the image, px; NaN where no spot is near."""
    uv = np.vstack([find_markers(taken.image, 12).uv, [[1e9, 1e9]]])  # the last is near no marker
    nearest = uv[np.linalg.norm(uv - taken.uv[:, None], axis=2).argmin(axis=1)]
    shift = ((taken.uv - nearest) * np.sign(taken.uv - 160))[:, 0]
    return np.where(np.abs(shift) < NEAR_PX, shift, np.nan)


def _bridged_discs() -> Still:
    image, centres = np.full((200, 320), BEHIND), [(u, v) for u in (50, 125, 195, 270) for v in (60, 140)]
    for u, v in centres:
        cv2.circle(cv2.line(image, (u, 72), (u, 128), BRIDGE, 5), (u, v), 9, DISC, -1)
    return Still(image, frozen(np.array(centres, float)), frozen(np.zeros(len(centres))))
