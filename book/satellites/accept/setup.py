"""What all tests of a sheet share: cameras, handle, the field that the cameras have in common, how
many poses, the seed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import qmc

from trinolab.bench.motion import orientation
from trinolab.camera import Rig
from trinolab.checks import Array, as_array, as_points
from trinolab.following.parameters import FollowParameters
from trinolab.handle import Handle
from trinolab.markers import MarkerParameters
from trinolab.methods import DEFAULT, estimator_of
from trinolab.workspace import view_volume

from .size import POSES, checked_size

# a marker is at least so many times as large as the least that is found, where the field ends
TIMES_THE_LEAST = 2.0
TILT_DEG = (60.0, 120.0)  # of the handle's axis from the first camera's, as in the standard scene
DRAWN = 12  # 2^12 points of the field's box
CENTRE_MM = np.array([0.0, 0.0, 570.0])  # of the standard scene


class Setup:
    """Cameras, handle, size and seed of a sheet, and the field of view that follows from them when
    it is asked for.

    Parameters
    ----------
    rig : Rig
    handle : Handle
    poses : int
        Of the test of static accuracy; the other tests grow and shrink with it.
    seed : int
        Of every pose and every noise.

    Raises
    ------
    ValueError
        If the numbers are out of range.
    """

    def __init__(self, rig: Rig, handle: Handle, poses: int = POSES, seed: int = 0) -> None:
        self.rig = rig
        self.handle = handle
        self.poses, self.seed = checked_size(poses, seed)
        self.parameters = FollowParameters(estimator=estimator_of(DEFAULT))

    @cached_property
    def field(self) -> Field:
        """The common field of view, see `field_of`. ValueError if there is none."""
        return field_of(self.rig, self.handle, self.seed)

    def part(self, share: float, least: int) -> int:
        """So many of a test that has `share` times as many as there are poses."""
        return max(least, round(share * self.poses))

    def number(self, test: str, k: int) -> int:
        """A seed for the k-th part of a test: the same whoever computes it, and in which order."""
        return int(np.random.SeedSequence([self.seed, *test.encode(), k]).generate_state(1)[0])

    def rng(self, test: str, k: int = 0) -> np.random.Generator:
        """Random numbers of the k-th part of a test."""
        return np.random.default_rng(self.number(test, k))


class Field(NamedTuple):
    """What all cameras see of the handle's markers, whichever way it is turned.

    Attributes
    ----------
    rig : Rig
    reach_mm : float
        Of the markers from the handle's origin: so far the origin is inside each image.
    farthest_mm : float
        Depth at which it ends before each camera.
    box : ndarray, shape (2, 3)
        Lowest and highest x, y, z, mm, world frame.
    points : ndarray, shape (m, 3)
        Points of it, evenly spread (Sobol).
    volume_mm3 : float
        Of the whole field that the images' edges bound, without the margin of `reach_mm`.
    """

    rig: Rig
    reach_mm: float
    farthest_mm: float
    box: Array
    points: Array
    volume_mm3: float

    def holds(self, points: Array) -> np.ndarray:
        """Whether handles with their origins at points (n, 3) have all markers inside, bool (n,)."""
        at = as_points(points, "points", 3)
        inside = np.ones(len(at), bool)
        for camera in self.rig.cameras:
            depth = camera.T_cam_world.apply(at)[:, 2]
            uv = camera.project(at)
            margin = camera.focal * self.reach_mm / np.maximum(depth, 1e-9)[:, None]
            low = (uv >= margin).all(axis=1)
            high = (uv <= np.array(camera.size) - 1 - margin).all(axis=1)
            inside &= low & high & (depth <= self.farthest_mm)
        return inside

    @property
    def centre(self) -> Array:
        """Mean of its points, mm, shape (3,)."""
        return self.points.mean(axis=0)

    @property
    def axes(self) -> Array:
        """Its principal directions as rows, the longest first, shape (3, 3).

        The largest component of each is positive, since the signs of singular vectors hang on how a
        processor rounds.
        """
        directions = np.linalg.svd(self.points - self.centre, full_matrices=False)[2]
        largest = np.abs(directions).argmax(axis=1)
        return directions * np.sign(directions[range(3), largest])[:, None]


def field_of(rig: Rig, handle: Handle, seed: int = 0) -> Field:
    """The common field of view of a rig for a handle.

    It ends at the images' edges, less the reach of the markers about the handle's origin, and where
    a marker that faces the camera has twice the least diameter that is looked for.

    Raises
    ------
    ValueError
        If there is none.
    """
    reach = float(np.linalg.norm(handle.marker_centres, axis=1).max())
    reach += handle.marker_diameter_mm / 2
    least = TIMES_THE_LEAST * MarkerParameters().diameter_px[0]
    farthest = min(
        float(camera.focal.max()) * handle.marker_diameter_mm / least for camera in rig.cameras
    )
    undistorted = Rig(tuple(replace(one, distortions=np.zeros(5)) for one in rig.cameras))
    view = view_volume(undistorted, farthest)
    if view.status != "bounded":
        raise ValueError(f"rig: the cameras have no field of view in common (it is {view.status})")
    box = np.array([view.vertices.min(axis=0), view.vertices.max(axis=0)])
    field = Field(rig, reach, farthest, box, np.empty((0, 3)), view.volume)
    drawn = _spread(box, qmc.Sobol(3, rng=np.random.default_rng(seed)).random_base2(DRAWN))
    inside = drawn[field.holds(drawn)]
    if len(inside) < 32:
        raise ValueError(
            "rig: the field of view that the cameras have in common is too small for the handle"
        )
    return field._replace(points=inside)


def _spread(box: Array, unit: Array) -> Array:
    return box[0] + unit[:, :3] * (box[1] - box[0])


class Drawn(NamedTuple):
    """Poses that fill the field and its orientations.

    Attributes
    ----------
    poses : RigidTransform
        n poses T_world_handle.
    freedoms : ndarray, shape (n, 6)
        x, y, z of the origin, mm, world frame; tilt of the axis from the first camera's, its
        azimuth about that, the turn about itself, deg.
    """

    poses: RigidTransform
    freedoms: Array


FREEDOMS = ("x / mm", "y / mm", "z / mm", "tilt / deg", "azimuth / deg", "turn / deg")


def sobol_poses(field: Field, n: int, seed: int) -> Drawn:
    """The first n poses of a Sobol sequence whose origins are inside a field (Owen 2020,
    arXiv:2008.08051).

    Positions are even in volume, the handle's axis is even over the band `TILT_DEG` of the sphere,
    the turn about it even.
    """
    rng = np.random.default_rng([seed, 6])
    sequence = qmc.Sobol(6, rng=rng)
    rows = np.empty((0, 6))
    power = int(np.ceil(np.log2(n))) + 1
    while len(rows) < n:
        unit = sequence.random_base2(power) if not len(rows) else sequence.random(2**power)
        rows = np.vstack([rows, unit[field.holds(_spread(field.box, unit))]])
    return drawn_at(field, rows[:n])


def drawn_at(field: Field, unit: Array) -> Drawn:
    """Poses from six numbers of 0 to 1 each, shape (n, 6)."""
    unit = as_array(unit, "unit", (None, 6))
    low, high = np.sort(np.cos(np.deg2rad(TILT_DEG)))
    polar = np.arccos(low + unit[:, 3] * (high - low))
    azimuth, turn = 2 * np.pi * unit[:, 4], 2 * np.pi * unit[:, 5]
    position = _spread(field.box, unit)
    first = field.rig.cameras[0].T_world_cam.rotation
    poses = RigidTransform.from_components(position, first * orientation(azimuth, polar, turn))
    angles = np.rad2deg(np.column_stack([polar, azimuth, turn]))
    return Drawn(poses, np.column_stack([position, angles]))
