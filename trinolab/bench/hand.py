"""The hand and forearm that hold the handle: capsules that hide what lies behind them, and what a
camera truly sees.

Four fingers and a thumb round the body, a palm, a wrist and a forearm are enough to hide what a
hand hides, and to move as it does. A capsule is all points within a radius of a line segment; a ray
meets it in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera
from ..checks import Array, as_array, as_transform, as_unit, check_numbers
from ..handle import Handle, on_cylinder, slants
from .rays import facing, hull_region, marker_area, marker_outline

_FINGER_DEG = (100.0, 175.0, 250.0)  # from the palm: knuckle, middle joint, tip
# a second hand before a camera: its distance from the handle, its radius
_HIDING_MM, _HIDING_RADIUS_MM = 250.0, 20.0
# of the skin's texture, 1/mm
_WAVES = np.array(
    [
        [0.31, 0.11, 0.23],
        [-0.19, 0.37, 0.13],
        [0.12, -0.52, 0.41],
        [-0.08, 0.13, 0.21],
        [0.17, 0.07, -0.11],
        [0.05, -0.11, 0.14],
    ]
)


class Capsules(NamedTuple):
    """Points within ``radii`` (m,) of the segments from ``starts`` (m, 3) to ``ends`` (m, 3), mm,
    in one frame.
    """

    starts: Array
    ends: Array
    radii: Array


class CapsuleHits(NamedTuple):
    """First points where rays meet capsules: ``depths`` (n,), infinite for a miss, and the outward
    ``normals`` (n, 3).
    """

    depths: Array
    normals: Array


def in_camera(camera: Camera, solids: Capsules) -> Capsules:
    """Capsules of the world frame in a camera's frame."""
    T = camera.T_cam_world
    return Capsules(T.apply(solids.starts), T.apply(solids.ends), solids.radii)


def capsule_region(camera: Camera, local: Capsules) -> np.ndarray:
    """Pixels that may see capsules of the camera's frame, bool (height, width); see
    `rays.hull_region`.
    """
    region = np.zeros(camera.size[::-1], bool)
    for corners in capsule_corners(local):
        region |= hull_region(camera, corners)
    return region


def cast_capsules(local: Capsules, directions: Array) -> CapsuleHits:
    """Intersect rays from a camera's centre with capsules.

    Parameters
    ----------
    local : Capsules
        In the camera's frame.
    directions : ndarray, shape (3, n)
        In the camera's frame, of any length, z > 0. A depth counts in lengths of the direction: it
        is z where the direction's z is 1.
    """
    depths = np.full(directions.shape[1], np.inf)
    normals = np.zeros((directions.shape[1], 3))
    x, y, z = directions
    for start, end, radius, low, high in zip(*local, *_boxes(local), strict=True):
        near = np.flatnonzero(
            (x >= low[0] * z) & (x <= high[0] * z) & (y >= low[1] * z) & (y <= high[1] * z)
        )
        if not near.size:
            continue
        rays = directions[:, near]
        depth = _meet_capsule(start, end, radius, rays)
        closer = depth < depths[near]
        chosen = near[closer]
        depths[chosen] = depth[closer]
        normals[chosen] = _normals(start, end, radius, (depth[closer] * rays[:, closer]).T)
    return CapsuleHits(depths, normals)


def _ball(count: int = 100) -> Array:
    """Corners of a polyhedron that holds the unit ball, evenly spaced (Fibonacci's lattice), shape
    (count, 3).
    """
    height = (2 * np.arange(count) + 1) / count - 1
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - height**2)
    return 1.08 * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


_BALL = _ball()


def capsule_corners(local: Capsules) -> Array:
    """Points whose convex hull holds each capsule, shape (m, n, 3), mm."""
    ball = local.radii[:, None, None] * _BALL
    return np.concatenate([local.starts[:, None] + ball, local.ends[:, None] + ball], axis=1)


def _boxes(local: Capsules) -> tuple[Array, Array]:
    """Lowest and highest x/z, y/z of each capsule, shapes (m, 2); no limits where one reaches
    behind the camera.
    """
    corners = capsule_corners(local)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = corners[..., :2] / corners[..., 2:]
    low = xy.min(axis=1)
    high = xy.max(axis=1)
    low[(corners[..., 2] <= 0).any(axis=1)] = -np.inf
    high[(corners[..., 2] <= 0).any(axis=1)] = np.inf
    return low, high


def _meet_capsule(start: Array, end: Array, radius: float, rays: Array) -> Array:
    """Depth at which rays from the origin enter a capsule, shape (n,); infinity for a miss, or from
    within.
    """
    axis = end - start
    squared = (rays**2).sum(axis=0)
    along, towards = axis @ rays, start @ rays
    length2, offset = axis @ axis, -start @ axis
    with np.errstate(divide="ignore", invalid="ignore"):
        a = length2 * squared - along**2
        b = -length2 * towards - offset * along
        c = length2 * (start @ start - radius**2) - offset**2
        depth = (-b - np.sqrt(b**2 - a * c)) / a
        height = offset + depth * along
        on_side = (height >= 0) & (height <= length2)
    depth[~on_side] = np.inf
    for centre in (start, end):
        depth = np.minimum(depth, _meet_ball(centre, radius, rays, squared))
    share = np.clip(offset / max(float(length2), 1e-12), 0, 1)
    within = np.linalg.norm(start + share * axis) < radius
    depth[~(depth > 0) | within] = np.inf
    return depth


def _meet_ball(centre: Array, radius: float, rays: Array, squared: Array) -> Array:
    """Depth at which rays from the origin enter a ball, shape (n,); infinity for a miss."""
    towards = centre @ rays
    with np.errstate(invalid="ignore"):
        depth = (towards - np.sqrt(towards**2 - squared * (centre @ centre - radius**2))) / squared
    depth[~(depth > 0)] = np.inf
    return depth


def _normals(start: Array, end: Array, radius: float, points: Array) -> Array:
    """Outward normals of a capsule at points of its surface, shape (n, 3)."""
    axis = end - start
    share = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0, 1)
    return (points - start - share[:, None] * axis) / radius


@dataclass(frozen=True)
class Arm:
    """A hand that holds the handle: its grip and its looks.

    Attributes
    ----------
    grip_mm : (float, float)
        Axial coordinates between which the hand holds the body.
    palm_deg : float
        Where the palm lies about the handle's axis, as a column of markers would.
    forearm : tuple of 3 floats
        Where the operator stands: the forearm leaves the hand in this direction of the world frame
        as far as the handle lets it, and away from the free end always. The default is away from
        CCD1 and below it.
    forearm_length_mm, forearm_radius_mm : float
    grey : float
        Of skin that faces the light, grey levels.
    texture_contrast : float
        Largest departure of the skin from `grey`, as a share of it.
    hides_from : tuple of 3 floats or None
        A point of the world, mm, such as a camera's centre: a second hand passes 250 mm before the
        handle (half-way where it is nearer) and hides the markers from there.
    """

    grip_mm: tuple[float, float] = (-110.0, -40.0)
    palm_deg: float = 0.0
    forearm: tuple[float, float, float] = (0.2, 0.75, 0.63)
    forearm_length_mm: float = 400.0
    forearm_radius_mm: float = 26.0
    grey: float = 110.0
    texture_contrast: float = 0.08
    hides_from: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        low, high = sorted(as_array(self.grip_mm, "grip_mm", (2,)))
        if high - low < 1:
            raise ValueError(
                f"grip_mm: expected two coordinates at least 1 mm apart, got {self.grip_mm!r}"
            )
        object.__setattr__(self, "grip_mm", (float(low), float(high)))
        object.__setattr__(
            self, "forearm", tuple(float(c) for c in as_unit(self.forearm, "forearm"))
        )
        check_numbers(self, "forearm_length_mm", low=0.0, high=1e4, open_low=True)
        check_numbers(self, "forearm_radius_mm", low=0.0, high=1e3, open_low=True)
        check_numbers(self, "grey", low=0.0, high=255, open_low=True)
        check_numbers(self, "palm_deg")
        check_numbers(self, "texture_contrast", low=0.0, high=1.0)
        if self.hides_from is not None:
            point = as_array(self.hides_from, "hides_from", (3,))
            object.__setattr__(self, "hides_from", tuple(float(c) for c in point))


def capsules(arm: Arm, handle: Handle, T_world_handle: RigidTransform) -> Capsules:
    """The arm's capsules around a handle, world frame.

    Fingers, thumb and palm move rigidly with the handle. Raises ValueError if the handle lies at
    the arm's `hides_from` or in the direction of its `forearm` from there.
    """
    as_transform(T_world_handle, "T_world_handle")
    low, high = arm.grip_mm
    radius = (high - low) / 7.4  # four fingers that overlap a little
    segments = _fingers(arm, handle, radius) + _palm_and_thumb(arm, handle, radius)
    starts, ends, radii = (np.array(part) for part in zip(*segments, strict=True))
    world = [
        (T_world_handle.apply(a), T_world_handle.apply(b), r)
        for a, b, r in zip(starts, ends, radii, strict=True)
    ]
    world += _wrist_and_forearm(arm, T_world_handle)
    if arm.hides_from is not None:
        world.append(_hiding_hand(arm, T_world_handle))
    return Capsules(*(np.array(part) for part in zip(*world, strict=True)))


def skin_grey(arm: Arm, points: Array) -> Array:
    """Grey of skin that faces the light at points of the handle's frame, (n, 3): smooth blotches;
    shape (n,).
    """
    bent = points @ _WAVES[:3].T + 2 * np.sin(points @ _WAVES[3:].T)
    return arm.grey * (1 + arm.texture_contrast * np.sin(bent).mean(axis=1))


def true_visibility(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform, arm: Arm | None = None
) -> np.ndarray:
    """The markers that a camera truly sees, bool (markers,).

    Truly seen: slant at most 62 deg, at least 80 % of the marker not hidden by the body or by an
    arm, and all of it at least 10 px inside the image.
    """
    as_transform(T_world_handle, "T_world_handle")
    steep = slants(handle, T_world_handle, camera.centre) > np.deg2rad(62)
    solids = None if arm is None else in_camera(camera, capsules(arm, handle, T_world_handle))
    seen = ~steep
    for k in np.flatnonzero(seen).tolist():
        inside = camera.sees(T_world_handle.apply(marker_outline(handle, k)), 10).all()
        seen[k] = inside and _shown_share(camera, handle, T_world_handle, solids, k) >= 0.8
    return seen


def _shown_share(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    solids: Capsules | None,
    index: int,
) -> float:
    """Share of a marker's area that neither the body nor capsules of the camera's frame hide from a
    camera.

    The body is convex: what looks towards a viewpoint outside it is not hidden by it.
    """
    points = marker_area(handle, index)
    facing_points = facing(handle, points, T_world_handle.inv().apply(camera.centre))
    local = camera.T_cam_world.apply(T_world_handle.apply(points))
    if solids is not None and (local[:, 2] > 0).all():
        facing_points &= cast_capsules(solids, local.T).depths >= 1
    return float(facing_points.mean())


def _fingers(arm: Arm, handle: Handle, radius: float) -> list[tuple[Array, Array, float]]:
    """Two capsules a finger, bent round the body, handle frame."""
    angles = np.deg2rad(arm.palm_deg + np.array(_FINGER_DEG))
    fingers = []
    for axial in np.linspace(arm.grip_mm[1] - radius, arm.grip_mm[0] + radius, 4):
        joints = on_cylinder(handle.radius_mm + radius, angles, axial)
        fingers += [(joints[0], joints[1], radius), (joints[1], joints[2], radius)]
    return fingers


def _palm_and_thumb(arm: Arm, handle: Handle, radius: float) -> list[tuple[Array, Array, float]]:
    """A palm along the body and a thumb across it, handle frame."""
    low, high = arm.grip_mm
    palm = on_cylinder(
        handle.radius_mm + 1.4 * radius,
        np.deg2rad(arm.palm_deg) + np.zeros(2),
        np.array([high - 1.8 * radius, low + 1.4 * radius]),
    )
    angles = np.deg2rad(arm.palm_deg + np.array([-40.0, -120.0]))
    thumb = on_cylinder(
        handle.radius_mm + 1.2 * radius, angles, np.array([(low + high) / 2, high - 1.4 * radius])
    )
    return [(palm[0], palm[1], 1.4 * radius), (thumb[0], thumb[1], 0.9 * radius)]


def _wrist_and_forearm(
    arm: Arm, T_world_handle: RigidTransform
) -> list[tuple[Array, Array, float]]:
    """Capsules from the middle of the hand, across the axis towards the operator and away from the
    free end, world frame.
    """
    axis = T_world_handle.rotation.as_matrix()[:, 1]
    towards = np.array(arm.forearm)
    across = towards - (towards @ axis) * axis
    # fades out, and does not jump, where the two are parallel
    across /= np.sqrt(across @ across + 0.01)
    leaving = 0.8 * across - 0.6 * axis
    leaving /= np.linalg.norm(leaving)
    hand = T_world_handle.apply([0.0, np.mean(arm.grip_mm) - 10, 0.0])
    begin = hand + 1.4 * arm.forearm_radius_mm * leaving
    return [
        (hand, begin, 0.8 * arm.forearm_radius_mm),
        (begin, begin + arm.forearm_length_mm * leaving, arm.forearm_radius_mm),
    ]


def _hiding_hand(arm: Arm, T_world_handle: RigidTransform) -> tuple[Array, Array, float]:
    """A second hand between the handle's origin and `hides_from`, reaching in from the operator's
    side.
    """
    origin = T_world_handle.translation
    towards = np.array(arm.forearm)
    direction = np.array(arm.hides_from) - origin
    sight = as_unit(direction, "hides_from, seen from the handle")
    begin = origin + min(_HIDING_MM, 0.5 * float(np.linalg.norm(direction))) * sight
    across = as_unit(towards - (towards @ sight) * sight, "forearm, across the line of sight")
    return begin, begin + arm.forearm_length_mm * across, _HIDING_RADIUS_MM
