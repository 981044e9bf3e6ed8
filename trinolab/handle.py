"""The master handle: a cylinder with round markers wrapped on it, its symmetries, and the handle
file (Sect. 6.3).

The handle's frame: y along the axis towards the free end. A column at angle theta has the outward
normal (sin theta, 0, cos theta); a marker at axial coordinate s has its centre at (r sin theta, s,
r cos theta). Markers are numbered column by column, in the order of the rows. A real marker may be
offset from the place that its column and row state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Camera
from .checks import Array, as_array, as_number, as_transform, check_numbers, frozen
from .rigid import apart

_LARGEST = 1e6  # mm or deg


@dataclass(frozen=True)
class Handle:
    """A cylindrical handle and its marker layout.

    Attributes
    ----------
    name : str
    radius_mm, length_mm : float
        Of the cylindrical body.
    top_mm : float
        Axial coordinate of the free end; the body runs from ``top_mm - length_mm`` to ``top_mm``.
    marker_diameter_mm : float
        Of the flat disc that is wrapped on the body.
    columns_deg : tuple of float
        Angle of each column of markers about the axis.
    rows_mm : tuple of tuple of float
        Axial coordinates of the markers, one tuple per column.
    markers : {"bright", "dark"}
        Against the body.
    placement_sigma_mm : float or None
        Standard deviation of each coordinate of each marker's centre, mm; 0 for an exact layout.
        None, where it is unknown, stands for a handle of usual quality (`default_covariance`).
    offsets_mm : tuple of (float, float, float)
        Offset of each marker's centre from the place that its column and row state, handle frame,
        one per marker; empty if there is none. A marker is wrapped on a coaxial cylinder through
        its centre.

    Raises
    ------
    ValueError
        If there is no marker, the rows do not fit the columns, an offset is larger than half a
        marker, or markers overlap or leave the body.
    """

    name: str
    radius_mm: float
    length_mm: float
    top_mm: float
    marker_diameter_mm: float
    columns_deg: tuple[float, ...]
    rows_mm: tuple[tuple[float, ...], ...]
    markers: str = "bright"
    placement_sigma_mm: float | None = None
    offsets_mm: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"name: expected a handle's name, got {self.name!r}")
        check_numbers(
            self,
            "radius_mm",
            "length_mm",
            "marker_diameter_mm",
            low=0.0,
            high=_LARGEST,
            open_low=True,
        )
        if self.placement_sigma_mm is not None:
            check_numbers(self, "placement_sigma_mm", low=0.0, high=_LARGEST)
        check_numbers(self, "top_mm", low=-_LARGEST, high=_LARGEST)
        object.__setattr__(self, "columns_deg", _as_numbers(self.columns_deg, "columns_deg"))
        if not isinstance(self.rows_mm, Sequence) or len(self.rows_mm) != len(self.columns_deg):
            raise ValueError(
                f"rows_mm: expected {len(self.columns_deg)} lists, one per column, got {self.rows_mm!r}"
            )
        rows = tuple(_as_numbers(row, f"rows_mm[{k}]") for k, row in enumerate(self.rows_mm))
        object.__setattr__(self, "rows_mm", rows)
        if self.markers not in ("bright", "dark"):
            raise ValueError(f"markers: expected 'bright' or 'dark', got {self.markers!r}")
        object.__setattr__(self, "offsets_mm", _as_offsets(self))
        _check_layout(self)

    @property
    def bottom_mm(self) -> float:
        return self.top_mm - self.length_mm

    @cached_property
    def stated_angles(self) -> Array:
        """Angle of each marker's column, shape (n,), rad."""
        counts = [len(row) for row in self.rows_mm]
        return frozen(np.repeat(np.deg2rad(self.columns_deg), counts))

    @cached_property
    def stated_centres(self) -> Array:
        """The markers' centres by columns and rows, handle frame, shape (n, 3), mm."""
        axial = np.concatenate([np.array(row) for row in self.rows_mm])
        return frozen(on_cylinder(self.radius_mm, self.stated_angles, axial))

    @cached_property
    def marker_centres(self) -> Array:
        """Centres of the markers, handle frame, shape (n, 3), mm."""
        if not self.offsets_mm:
            return self.stated_centres
        return frozen(self.stated_centres + self.offsets_mm)

    @cached_property
    def marker_angles(self) -> Array:
        """Angle of each marker about the axis, shape (n,), rad."""
        if not self.offsets_mm:
            return self.stated_angles
        x, _, z = self.marker_centres.T
        turn = np.arctan2(x, z) - self.stated_angles
        return frozen(self.stated_angles + turn - 2 * np.pi * np.round(turn / (2 * np.pi)))

    @cached_property
    def marker_radii(self) -> Array:
        """Distance of each marker's centre from the axis, shape (n,), mm."""
        if not self.offsets_mm:
            return frozen(np.full(len(self.stated_angles), self.radius_mm))
        x, _, z = self.marker_centres.T
        return frozen(np.hypot(x, z))

    @cached_property
    def marker_normals(self) -> Array:
        """Outward normals, handle frame, shape (n, 3)."""
        theta = self.marker_angles
        return frozen(np.column_stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)]))

    @cached_property
    def symmetries(self) -> tuple[RigidTransform, ...]:
        """Motions T with ``T.apply(stated_centres)`` the same set of markers; the identity is the
        first.

        ``T_world_handle * T`` for each of them shows the same markers: 12 for the paper's layout, 1
        for a coded one. The markers' own offsets are too small to tell such poses apart.
        """
        motions = [RigidTransform.identity()]
        for T in _candidate_symmetries(self):
            if _keeps_markers(self, T) and all(apart(T, other, 1e-6, 1e-6) for other in motions):
                motions.append(T)
        return tuple(motions)


def slants(handle: Handle, T_world_handle: RigidTransform, viewpoint: Array) -> Array:
    """Angle between each marker's normal and the direction to a viewpoint, shape (n,), rad.

    Parameters
    ----------
    handle : Handle
    T_world_handle : RigidTransform
    viewpoint : ndarray, shape (3,)
        A camera's centre, world frame, mm.
    """
    as_transform(T_world_handle, "T_world_handle")
    normals = handle.marker_normals @ T_world_handle.as_matrix()[:3, :3].T
    viewpoint = as_array(viewpoint, "viewpoint", (3,))
    return angles_to(T_world_handle.apply(handle.marker_centres), normals, viewpoint)


def facing_pixels(
    handle: Handle, camera: Camera, T_world_handle: RigidTransform, max_slant_deg: float
) -> Array:
    """Images of the markers' centres that are turned from a camera by at most `max_slant_deg`,
    shape (n, 2), px.

    NaN for the others, and where `Camera.project` gives no pixel; markers that the body hides are
    included.
    """
    uv = camera.project(T_world_handle.apply(handle.marker_centres))
    uv[slants(handle, T_world_handle, camera.centre) > np.deg2rad(max_slant_deg)] = np.nan
    return uv


def slant_angles(centres: Array, normals: Array, viewpoint: Array) -> Array:
    """Angle between normals and the directions to a viewpoint, rad.

    Parameters
    ----------
    centres, normals : ndarray, shape (..., 3)
        One frame for all; the normals have length 1.
    viewpoint : ndarray, shape (3,)

    Returns
    -------
    ndarray, shape (...)
        NaN where a centre or a normal is missing, or the viewpoint lies in the centre.
    """
    centres = as_array(centres, "centres", (*np.shape(centres)[:-1], 3), finite=False)
    normals = as_array(normals, "normals", centres.shape, finite=False)
    return angles_to(centres, normals, as_array(viewpoint, "viewpoint", (3,)))


def angles_to(centres: Array, normals: Array, viewpoint: Array) -> Array:
    """`slant_angles` of arrays that need no check."""
    to_camera = viewpoint - centres
    distance = np.linalg.norm(to_camera, axis=-1)
    cosine = (normals * to_camera).sum(axis=-1) / np.where(distance > 0, distance, np.nan)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def on_cylinder(radius: float, theta: Array | float, axial: Array | float) -> Array:
    """Points at a distance from the axis, angles about it and axial coordinates, handle frame,
    shape (n, 3), mm.
    """
    theta, axial = np.broadcast_arrays(theta, axial)
    return np.column_stack([radius * np.sin(theta), axial, radius * np.cos(theta)])


def _as_numbers(value: Any, name: str) -> tuple[float, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) == 0:
        raise ValueError(f"{name}: expected a list of numbers, got {value!r}")
    numbers = as_array(list(value), name, (None,))
    as_number(np.abs(numbers).max(), f"{name}: the largest", high=_LARGEST)
    return tuple(float(v) for v in numbers)


def _as_offsets(handle: Handle) -> tuple[tuple[float, float, float], ...]:
    """The offsets as numbers; refuse another number of them, and large ones."""
    value = handle.offsets_mm
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 0:
        return ()
    offsets = as_array(value, "offsets_mm", (len(handle.stated_angles), 3))
    most = handle.marker_diameter_mm / 2
    largest = float(np.linalg.norm(offsets, axis=1).max())
    as_number(largest, "offsets_mm: the largest", high=most)
    return tuple((float(x), float(y), float(z)) for x, y, z in offsets)


def _check_layout(handle: Handle) -> None:
    """Refuse markers that leave the body or overlap, measured on the unrolled surface."""
    radius = handle.marker_diameter_mm / 2
    axial = handle.marker_centres[:, 1]
    if (axial + radius > handle.top_mm).any() or (axial - radius < handle.bottom_mm).any():
        body = f"{handle.bottom_mm:g} to {handle.top_mm:g} mm"
        raise ValueError(f"rows_mm: a marker leaves the body, which runs from {body}")
    turn = handle.marker_angles[:, None] - handle.marker_angles
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    distance = np.hypot(turn * handle.radius_mm, axial[:, None] - axial)
    distance[np.diag_indices_from(distance)] = np.inf
    if distance.min() < handle.marker_diameter_mm:
        i, j = np.unravel_index(distance.argmin(), distance.shape)
        raise ValueError(
            f"columns_deg, rows_mm: markers {i} and {j} overlap, {distance.min():.3g} mm apart"
        )


def _candidate_symmetries(handle: Handle) -> list[RigidTransform]:
    """Turns about the axis, and half turns across it, that carry marker 0 to some marker; some of
    them may be there twice.
    """
    turns = handle.stated_angles - handle.stated_angles[0]
    motions = [
        RigidTransform.from_rotation(Rotation.from_rotvec([0.0, turn, 0.0])) for turn in turns
    ]
    for theta, s in zip(handle.stated_angles, handle.stated_centres[:, 1], strict=True):
        azimuth = (handle.stated_angles[0] + theta) / 2
        half_turn = Rotation.from_rotvec(np.pi * np.array([np.sin(azimuth), 0.0, np.cos(azimuth)]))
        shift = [0.0, s + handle.stated_centres[0, 1], 0.0]
        motions.append(RigidTransform.from_components(shift, half_turn))
    return motions


def _keeps_markers(handle: Handle, T: RigidTransform, atol_mm: float = 1e-6) -> bool:
    moved = T.apply(handle.stated_centres)
    distance = np.linalg.norm(moved[:, None] - handle.stated_centres, axis=2)
    return bool((distance.min(axis=1) < atol_mm).all())
