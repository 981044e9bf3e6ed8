"""Arrays of layout and rig for the search for the handle's pose, computed once for each.

The centroid of a wrapped marker is not the image of the marker's centre. To first order in the
marker's size it is the image of another point, which wanders towards the viewer's side of the
marker as the marker turns away.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..camera import Rig
from ..checks import Array, frozen
from ..handle import Handle
from ..lens import distort
from .parameters import IdentityParameters


class Layout(NamedTuple):
    """A handle's n markers.

    Attributes
    ----------
    centres, normals, tangents : ndarray, shape (n, 3)
        Handle frame; the tangents point along the circumference, as the angle grows.
    distances : ndarray, shape (n, n)
        Between centres, mm; NaN where no viewpoint sees both, and on the diagonal.
    triplets : ndarray of bool, shape (n, n, n)
        Whether three markers can be seen together and are not on a line. Of a symmetric layout only
        those that start at the first marker of an orbit: the others give equivalent poses.
    slants : ndarray, shape (k,)
        Angles between a marker's normal and the direction to the viewer in the plane across the
        axis, rad.
    shift : ndarray, shape (2, k)
        For each of them the way from the marker's centre to the point seen as its centroid, along
        normal and tangent.
    marker_mm : float
        Diameter of a marker.
    limb : float
        Cosine of the slant beyond which too little of a marker shows.
    """

    centres: Array
    normals: Array
    tangents: Array
    distances: Array
    triplets: np.ndarray
    slants: Array
    shift: Array
    marker_mm: float
    limb: float


class Views(NamedTuple):
    """A rig's C cameras.

    Attributes
    ----------
    rotations, translations : ndarray, shapes (C, 3, 3), (C, 3)
        World to camera, mm.
    centres : ndarray, shape (C, 3)
        World frame, mm.
    focal, principal, sizes : ndarray, shape (C, 2)
        px.
    distortions : ndarray, shape (C, 5)
    """

    rotations: Array
    translations: Array
    centres: Array
    focal: Array
    principal: Array
    sizes: Array
    distortions: Array

    def only(self, camera: int) -> Views:
        """One camera alone."""
        return Views(*(part[camera : camera + 1] for part in self))

    def inside(self, uv: Array, margin_px: Array) -> np.ndarray:
        """Whether ideal pixels (h, C, 2, n) lie a margin (h, C, n) inside the images as they are
        taken, (h, C, n).
        """
        uv = self.as_taken(uv)
        from_edge = np.minimum(uv, self.sizes[:, :, None] - 1.0 - uv).min(axis=2)
        return np.asarray(from_edge >= margin_px)

    def as_taken(self, uv: Array) -> Array:
        """Ideal pixels (h, C, 2, n) as the images show them."""
        if not self.distortions.any():
            return uv
        return np.stack([self._distorted(uv[:, c], c) for c in range(len(self.sizes))], axis=1)

    def _distorted(self, uv: Array, c: int) -> Array:
        """Ideal pixels (h, 2, n) of one camera as its image shows them."""
        xy = (uv.transpose(0, 2, 1).reshape(-1, 2) - self.principal[c]) / self.focal[c]
        distorted = distort(xy, self.distortions[c])[0] * self.focal[c] + self.principal[c]
        return distorted.reshape(len(uv), -1, 2).transpose(0, 2, 1)


@lru_cache(maxsize=32)
def layout_of(handle: Handle, p: IdentityParameters) -> Layout:
    """The arrays of a handle."""
    centres = handle.marker_centres
    normals = handle.marker_normals
    tangents = np.column_stack([normals[:, 2], np.zeros(len(normals)), -normals[:, 0]])
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    together = normals @ normals.T > np.cos(np.deg2rad(p.max_apart_deg))
    together &= ~np.eye(len(centres), dtype=bool)
    # from a marker's middle to its edge, rad
    half = min(handle.marker_diameter_mm / 2 / handle.radius_mm, np.pi)
    slants = np.linspace(0.0, np.pi / 2 + 0.9 * half, 241)  # beyond, nothing of a marker shows
    return Layout(
        centres=centres,
        normals=normals,
        tangents=frozen(tangents),
        distances=frozen(np.where(together, distances, np.nan)),
        triplets=frozen(_triplets(handle, together)),
        slants=frozen(slants),
        shift=frozen(_shifts(handle.radius_mm, half, slants)),
        marker_mm=handle.marker_diameter_mm,
        limb=float(np.cos(np.pi / 2 + half / 2)),
    )


@lru_cache(maxsize=32)
def views_of(rig: Rig) -> Views:
    """The arrays of a rig."""
    cameras = rig.cameras
    return Views(
        rotations=frozen(np.stack([c.T_cam_world.rotation.as_matrix() for c in cameras])),
        translations=frozen(np.stack([c.T_cam_world.translation for c in cameras])),
        centres=frozen(np.stack([c.centre for c in cameras])),
        focal=frozen(np.stack([c.focal for c in cameras])),
        principal=frozen(np.stack([c.principal_point for c in cameras])),
        sizes=frozen(np.stack([np.array(c.size, dtype=float) for c in cameras])),
        distortions=frozen(np.stack([c.distortions for c in cameras])),
    )


def _triplets(handle: Handle, together: np.ndarray) -> np.ndarray:
    """See `Layout.triplets`."""
    X = handle.marker_centres
    sides = X[None] - X[:, None]
    area = np.linalg.norm(np.cross(sides[:, :, None], sides[:, None, :]), axis=3) / 2
    allowed = together[:, :, None] & together[:, None, :] & together[None]
    allowed &= area > 0.05 * handle.radius_mm**2
    images = np.stack([S.apply(X) for S in handle.symmetries])
    index = np.linalg.norm(images[:, :, None] - X, axis=3).argmin(axis=2)
    starts = index.min(axis=0) == np.arange(len(X))
    return allowed & starts[:, None, None]


def _shifts(radius_mm: float, half: float, slants: Array, samples: int = 400) -> Array:
    """See `Layout.shift`: the mean of a disc's points, each with the area that it shows to a far
    viewer.

    A strip of the disc at the angle phi from its middle is as long as the chord there and shows the
    cosine of its own slant; what is turned away shows nothing.
    """
    phi = half * (2 * np.arange(samples) + 1 - samples) / samples
    visible_share = np.sqrt(half**2 - phi**2) * np.maximum(np.cos(phi - slants[:, None]), 0.0)
    shift = np.stack([visible_share @ (np.cos(phi) - 1.0), visible_share @ np.sin(phi)])
    return radius_mm * shift / visible_share.sum(axis=1)
