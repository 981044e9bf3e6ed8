"""What a wrapped marker's image looks like: windows of pixels about markers, and what each pixel
shows before the blur.

A pixel's ray meets the cylinder in closed form; distances from the marker's edge and from the
body's outline give the share of the pixel's area that each covers. A view is a marker in a camera's
image; arrays have one row a view, vectors their three components first.

After a small motion of the handle (nu mm, omega rad, handle frame) the point X of a ray lies, seen
from the handle, at X - nu - omega x X. With the gradient g of a distance there, that distance
changes by -g.nu - (X x g).omega.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle

__all__ = ["Layers", "Views", "Windows", "by_motion", "layers", "shading_basis", "windows"]

# cosine of ray and normal: a surface that is turned away further counts as this oblique
GRAZING = 0.05


class Views(NamedTuple):
    """Which markers in which images: index of the camera and of the marker, each of shape (k,)."""

    camera: np.ndarray
    marker: np.ndarray


class Windows(NamedTuple):
    """Windows of cells, one a view, all of one shape. A cell is a pixel, or a block of pixels whose
    mean is looked at.

    Attributes
    ----------
    corner : ndarray of int, shape (k, 2)
        Column and row of the first pixel.
    shape : (int, int)
        Rows and columns of cells.
    cell : (int, int)
        Pixels of a cell along u and along v.
    xy : ndarray, shape (2, k, p)
        Normalised ideal coordinates of the cells' centres, row by row.
    xy_per_cell : ndarray, shape (k, 2, 2)
        Their derivatives by the cells along u and v in the middle of the window.
    """

    corner: np.ndarray
    shape: tuple[int, int]
    cell: tuple[int, int]
    xy: np.ndarray
    xy_per_cell: np.ndarray

    @property
    def pixels(self) -> int:
        """How many a cell has."""
        return self.cell[0] * self.cell[1]

    @property
    def size_px(self) -> np.ndarray:
        """Width and height of a window, px, shape (2,)."""
        return np.array(self.shape[::-1]) * self.cell


class Layers(NamedTuple):
    """What the cells of windows show, before the blur.

    Attributes
    ----------
    marker, body : ndarray, shape (k, p)
        Share of the cell's area that the view's marker covers (or any marker), and that all of the
        body does.
    marker_by_body : ndarray, shape (k, p)
        How fast the marker's share grows with the body's.
    marker_point, body_point : ndarray, shape (3, k, p)
        Where the ray meets the body, and where it is nearest to the axis; handle frame, mm.
    marker_push, body_push : ndarray, shape (3, k, p)
        How fast the shares grow as the handle moves there, 1/mm: the marker's by its own edge, the
        body's.
    turn : ndarray, shape (k, p)
        Angle about the axis from the marker's column, rad.
    clear : ndarray, shape (k, p)
        Distance from whatever else is there, the body's end or another marker's edge, in cells;
        negative inside it.
    """

    marker: Array
    body: Array
    marker_by_body: Array
    marker_point: Array
    body_point: Array
    marker_push: Array
    body_push: Array
    turn: Array
    clear: Array


class _Rays(NamedTuple):
    """Rays in the handle's frame: start (3, k, 1), direction (3, k, p), its derivatives by u and v
    (3, k, 1).
    """

    start: Array
    direction: Array
    by_u: Array
    by_v: Array


class _Place(NamedTuple):
    """Points of the body beside a marker's middle: angle about the axis, rad; along it, and
    distance, mm; (k, p).
    """

    turn: Array
    along: Array
    distance: Array


def windows(
    rig: Rig, views: Views, uv: Array, shape: tuple[int, int], cell: tuple[int, int] = (1, 1)
) -> Windows:
    """Windows with pixels uv, shape (k, 2), in their middle. They may reach beyond the image."""
    rows, columns = shape
    size = np.array([columns, rows]) * cell
    corner = np.round(uv).astype(int) - size // 2
    grid = np.stack(np.divmod(np.arange(rows * columns), columns)[::-1])  # (2, p): column, row
    scale = np.array(cell)[:, None]
    grid = scale * grid + (scale - 1) / 2
    xy = np.empty((2, len(uv), rows * columns))
    xy_per_px = np.empty((len(uv), 2, 2))
    for c, camera in enumerate(rig.cameras):
        mine = np.flatnonzero(views.camera == c)
        pixels = corner[mine].T[:, :, None] + grid[:, None]  # (2, k, p)
        if camera.distortions.any():
            xy[:, mine], xy_per_px[mine] = _through_lens(camera, pixels, uv[mine])
        else:
            xy[:, mine] = (pixels - camera.principal_point[:, None, None]) / camera.focal[
                :, None, None
            ]
            xy_per_px[mine] = np.diag(1 / camera.focal)
    return Windows(corner, shape, cell, xy, xy_per_px * cell)


def _through_lens(camera: Camera, pixels: Array, uv: Array) -> tuple[Array, Array]:
    """Ideal coordinates (2, k, p), and their derivatives by pixels (k, 2, 2), of windows with pixels
    (2, k, p) and middles uv (k, 2), for a lens with distortion.
    """
    steps = 0.5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    every = np.concatenate([pixels.transpose(1, 2, 0), uv[:, None] + steps], axis=1)
    ideal = camera.normalise(every.reshape(-1, 2)).reshape(len(uv), -1, 2)
    # central differences over a pixel: exact but for the lens's curvature
    by_px = np.stack([ideal[:, -4] - ideal[:, -3], ideal[:, -2] - ideal[:, -1]], axis=2)
    return ideal[:, :-4].transpose(2, 0, 1), by_px


def layers(
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    views: Views,
    at: Windows,
    any_marker: bool = False,
) -> Layers:
    """What each cell of windows shows of the handle at a pose (see `Layers`).

    With `any_marker` the neighbours of a view's marker count as it does, and are nothing else that
    is in the way.
    """
    rays = _rays(rig, T_world_handle, views, at)
    depth, P, outward, distance = _nearest_to_axis(rays)
    body, body_rate, width = _edge(handle.radius_mm - distance, depth, outward, rays)
    radius = handle.marker_radii[views.marker, None]
    inside = _within_outline(radius, distance, width)
    depth, X, normal = _surface(inside, radius, rays, depth, P)
    clear = np.minimum(handle.top_mm - X[1], X[1] - handle.bottom_mm)
    angle = np.arctan2(X[0], X[2])
    edge = handle.marker_diameter_mm / 2
    own = nearest = _place(handle, views.marker, angle, X[1])
    for others in _neighbours(handle)[views.marker].T:
        beside = _place(handle, others, angle, X[1])
        if any_marker:
            nearer = beside.distance < nearest.distance
            nearest = _Place(
                *(np.where(nearer, *pair) for pair in zip(beside, nearest, strict=True))
            )
        else:
            clear = np.minimum(clear, beside.distance - edge)
    gradient = _inwards(nearest, X)
    facing = np.minimum(_dot(normal, rays.direction), -GRAZING)
    # as the ray's point slides along the surface
    gradient -= normal * (_dot(gradient, rays.direction) / facing)
    covered, marker_rate, width = _edge(edge - nearest.distance, depth, gradient, rays)
    marker_push = gradient * -(body * marker_rate)
    body_push = outward * body_rate
    return Layers(
        covered * body, body, covered, X, P, marker_push, body_push, own.turn, clear / width
    )


def by_motion(shown: Layers, marker: Array, body: Array) -> Array:
    """Derivative of ``marker * shown.marker + body * shown.body`` by a motion (nu mm, omega rad),
    shape (k, 6, p).

    `marker` and `body` are weights of shape (k, p).
    """
    F = marker * shown.marker_push
    G = (marker * shown.marker_by_body + body) * shown.body_push
    result = np.empty((len(marker), 6, marker.shape[1]), marker.dtype)
    X, P = shown.marker_point, shown.body_point
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[:, i] = F[i] + G[i]
        result[:, 3 + i] = X[j] * F[k] - X[k] * F[j] + P[j] * G[k] - P[k] * G[j]
    return result


def shading_basis(turn: Array) -> Array:
    """Functions of the angle from a marker's middle that make up the brightness around the body,
    (4, ``*turn.shape``).

    The first is 1, the others vanish in the middle. With the next two any distant light is met,
    with the last nearly so where that light ends within the window.
    """
    s = np.sin(turn)
    c = 1 - np.cos(turn)
    return np.stack([np.ones_like(turn), s, c, s * c])


def _rays(rig: Rig, T_world_handle: RigidTransform, views: Views, at: Windows) -> _Rays:
    R_handle_world = T_world_handle.as_matrix()[:3, :3].T
    turns = [R_handle_world @ camera.T_world_cam.as_matrix()[:3, :3] for camera in rig.cameras]
    starts = [
        R_handle_world @ (camera.centre - T_world_handle.translation) for camera in rig.cameras
    ]
    R = np.stack(turns)[views.camera].transpose(2, 1, 0)[..., None]
    start = np.stack(starts)[views.camera].T[..., None]
    by_u, by_v = (
        R[0] * at.xy_per_cell[:, 0, k, None] + R[1] * at.xy_per_cell[:, 1, k, None] for k in (0, 1)
    )
    return _Rays(start, R[0] * at.xy[0] + R[1] * at.xy[1] + R[2], by_u, by_v)


def _nearest_to_axis(rays: _Rays) -> tuple[Array, Array, Array, Array]:
    """Depth (k, p), point (3, k, p), direction from the axis and distance, mm, where rays pass the
    axis nearest by.
    """
    (ox, _, oz), (dx, _, dz) = rays.start, rays.direction
    depth = -(ox * dx + oz * dz) / (dx * dx + dz * dz)
    P = rays.start + depth * rays.direction
    outward = P.copy()
    outward[1] = 0
    distance = np.maximum(_length(P[0], P[2]), 1e-6)
    return depth, P, outward / distance, distance


def _within_outline(radius: Array, distance: Array, width: Array) -> Array:
    """How far within the outline that lies, in the mean, which a cell shows of the body, mm, (k, p);
    0 where it shows nothing. The ray of the cell's middle passes the axis at a distance (k, p), and
    the cell is some mm wide.

    Towards the outline the surface turns away ever faster: a cell that the outline cuts shows
    another part of it than its middle's ray meets.
    """
    inside = radius - distance
    in_cut_cell = np.clip((inside + width / 2) / 2, 0.0, radius)
    return np.where(inside > width / 2, inside, in_cut_cell)


def _surface(
    inside: Array, radius: Array, rays: _Rays, depth: Array, P: Array
) -> tuple[Array, Array, Array]:
    """Depth (k, p), point (3, k, p) and normal where a ray that passes the outline `inside` mm
    within meets the cylinder that the view's marker is wrapped on, of a radius (k, 1); where it
    passes that nearest by if `inside` is 0.
    """
    dx, _, dz = rays.direction
    half = np.sqrt(inside * (2 * radius - inside) / (dx * dx + dz * dz))
    X = P - half * rays.direction
    normal = X / _length(X[0], X[2])
    normal[1] = 0
    return depth - half, X, normal


def _place(handle: Handle, markers: np.ndarray, angle: Array, axial: Array) -> _Place:
    """Where points of the body, by angle and axial coordinate (k, p), lie beside the middle of a
    marker each (k,).
    """
    turn = _wrapped(angle - handle.marker_angles[markers, None])
    along = axial - handle.marker_centres[markers, 1, None]
    across = handle.marker_radii[markers, None] * turn
    return _Place(turn, along, np.maximum(_length(across, along), 1e-9))


def _inwards(place: _Place, X: Array) -> Array:
    """Gradient (3, k, p) of the distance into the marker, at points X of the body."""
    across = place.turn * X[2], -place.turn * X[0]
    return -np.stack([across[0], place.along, across[1]]) / place.distance


def _neighbours(handle: Handle, nearest: int = 2) -> np.ndarray:
    """Indices (markers, nearest) of each marker's nearest neighbours on the surface."""
    theta = handle.marker_angles
    axial = handle.marker_centres[:, 1]
    gap = np.hypot(handle.radius_mm * _wrapped(theta[:, None] - theta), axial[:, None] - axial)
    np.fill_diagonal(gap, np.inf)
    return gap.argsort(axis=1)[:, :nearest]


def _edge(inside: Array, depth: Array, gradient: Array, rays: _Rays) -> tuple[Array, Array, Array]:
    """Share (k, p) of a cell's area on the inner side of an edge, how fast it grows with `inside`,
    1/mm, and mm to a cell.

    The edge is straight within a cell: `inside` mm away, with a gradient (3, k, p) at the ray's
    point, `depth` along the ray. The share is then the integral of a trapezoid.
    """
    by_u, by_v = (np.abs(depth * _dot(gradient, step)) for step in (rays.by_u, rays.by_v))
    # zero in the very middle
    long, short = (np.maximum(part(by_u, by_v), 1e-6) for part in (np.maximum, np.minimum))
    away = np.abs(inside)
    remainder = np.maximum((long + short) / 2 - away, 0.0)  # to where the edge leaves the cell
    corner = remainder < short  # it cuts off no more than a corner
    outer = np.where(corner, remainder**2 / (2 * long * short), 0.5 - away / long)
    rate = np.where(corner, remainder / short, 1.0) / long
    return np.where(inside > 0, 1 - outer, outer), rate, _length(long, short)


def _length(a: Array, b: Array) -> Array:
    """Of vectors by their two components; `numpy.hypot`, which no size overflows, takes three times
    as long.
    """
    return np.sqrt(a * a + b * b)


def _wrapped(angle: Array) -> Array:
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def _dot(a: Array, b: Array) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
