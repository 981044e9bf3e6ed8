"""The sensitivity of pixels, and so of a pose, to errors of the calibration and of the marker layout.

An error d of the rig's parameters, or of the markers' places, moves the image of a marker from
where the rig says that it is. In a measurement with that rig it is an error of the pixel, the same
in every instant. For every estimator its effect on the pose is therefore the derivative of the pose
by the pixels, times the derivative of the pixels by d (error propagation to first order; Hartley
and Zisserman 2004, ch. 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtri, stdtrit

from .camera import Camera, Rig, pixels_with_slopes
from .checks import Array, frozen
from .default_covariance import known_covariance, known_placement_mm, known_scale_share
from .handle import Handle
from .rigid import cross_matrices

CHANCE = 0.01  # of a contradiction where there is none
ONE_SIGMA = 0.841345  # share of a normal distribution below one standard deviation
NOTHING = frozen(np.zeros((6, 6)))  # the systematic covariance of a pose where all is exact


class Response(NamedTuple):
    """The sensitivity of a pose to the pixels that it was measured from.

    Attributes
    ----------
    gain : ndarray, shape (6, k, 2)
        Change of position (mm) and rotation vector (rad; both in the world frame) per pixel by
        which the image of one place moves.
    camera : ndarray of int, shape (k,)
        The image in which each place was seen.
    points : ndarray, shape (k, 3)
        The places, world frame, mm.
    marker : ndarray of int, shape (k,)
        The marker at each place; -1 where there is none.
    """

    gain: Array
    camera: np.ndarray
    points: Array
    marker: np.ndarray

    def part(self, chosen: np.ndarray) -> Response:
        """The response to some of the places, bool (k,)."""
        return Response(self.gain[:, chosen], *(part[chosen] for part in self[1:]))

    def covariance_by(self, places: Array) -> Array:
        """Covariance of the pose (6, 6) by one of the places (2 k, 2 k), px^2; u and v of the first
        place come first.
        """
        gain = self.gain.reshape(6, -1)
        return np.asarray(gain @ places @ gain.T)


def is_uncertain(rig: Rig, handle: Handle) -> bool:
    """Whether rig or layout may be off: unless both are stated to be exact."""
    return not known_covariance(rig).is_exact or known_placement_mm(handle) > 0


def response(
    gain: Array, camera: np.ndarray, marker: np.ndarray, handle: Handle, T: RigidTransform
) -> Response:
    """The response of a pose that was measured from markers alone."""
    points = T.apply(handle.marker_centres)[marker]
    return Response(gain, camera, points, marker)


def contradict(chi_square: float, freedom: int) -> bool:
    """Whether a chi-square is more than what noise alone makes of it."""
    return freedom > 0 and bool(chi_square > chdtri(freedom, CHANCE))


def students_factor(freedom: float) -> float:
    """The factor by which a variance of some degrees of freedom is enlarged, so that one standard
    deviation holds as large a share as it always does.
    """
    return float(stdtrit(freedom, ONE_SIGMA) ** 2) if np.isfinite(freedom) else 1.0


def systematic_covariance(response: Response, rig: Rig, handle: Handle) -> Array:
    """Covariance of a pose by the errors of the rig and of the markers' places, which every instant
    has in common.

    Parameters
    ----------
    response : Response
    rig, handle
        Their stated uncertainties count, else the defaults of `default_covariance`.

    Returns
    -------
    ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame.
    """
    if not is_uncertain(rig, handle):
        return NOTHING
    return response.covariance_by(known_errors(response, rig, handle))


def known_errors(response: Response, rig: Rig, handle: Handle) -> Array:
    """Covariance of the pixels of a response by the errors of the rig and of the markers' places,
    (2 k, 2 k), px^2; u and v of the first place come first.
    """
    k = len(response.points)
    by_points = slopes_at(rig, response.camera, response.points)[1]
    moved = by_points.reshape(2 * k, 3)
    same = (response.marker[:, None] == response.marker) & (response.marker >= 0)
    by_layout = known_placement_mm(handle) ** 2 * (moved @ moved.T)
    total = by_layout * same.repeat(2, 0).repeat(2, 1)
    # About the middle of what is seen: about the handle's origin the pose would be shifted by some
    # hundredths of a millimetre besides.
    grown = known_scale_share(handle) * (response.points - response.points.mean(axis=0))
    by_scale = (by_points @ grown[..., None]).ravel()
    total += np.outer(by_scale, by_scale)
    known = known_covariance(rig)
    by_rig = by_parameters(response, rig)
    return total + students_factor(known.freedom) * (by_rig @ known.matrix @ by_rig.T)


def by_parameters(places: Response, rig: Rig) -> Array:
    """Derivatives of the places by all parameters of a rig, (2 k, 15 C)."""
    k = len(places.points)
    by_camera = np.zeros((k, 2, len(rig.cameras), len(rig.parameters)))
    by_camera[np.arange(k), :, places.camera] = slopes_at(rig, places.camera, places.points)[0]
    return by_camera.reshape(2 * k, -1)


def slopes_at(rig: Rig, camera: np.ndarray, points: Array) -> tuple[Array, Array]:
    """`pixel_slopes` of points (k, 3), each in a camera (k,) of its own; read-only."""
    return _slopes_at(rig.cameras, camera.tobytes(), camera.dtype, points.tobytes())


@lru_cache(maxsize=4)  # all that is asked of an instant asks for those of the same points
def _slopes_at(
    cameras: tuple[Camera, ...], camera_bytes: bytes, dtype: np.dtype, points_bytes: bytes
) -> tuple[Array, Array]:
    """`slopes_at` by what can be a key."""
    camera = np.frombuffer(camera_bytes, dtype)
    points = np.frombuffer(points_bytes).reshape(-1, 3)
    by_parameters = np.empty((len(points), 2, len(cameras[0].parameters)))
    by_points = np.empty((len(points), 2, 3))
    for c, one in enumerate(cameras):
        mine = camera == c
        by_parameters[mine], by_points[mine] = pixel_slopes(one, points[mine])
    by_parameters.setflags(write=False)
    by_points.setflags(write=False)
    return by_parameters, by_points


def motion_slopes(rig: Rig, camera: np.ndarray, points: Array, origin: Array) -> Array:
    """Derivatives (k, 2, 6) of the pixels of points (k, 3), each in a camera (k,) of its own, by a
    motion of the body that they belong to: of its origin (3,), mm, and its rotation vector, world
    frame.
    """
    by_points = slopes_at(rig, camera, points)[1]
    return np.concatenate([by_points, -by_points @ cross_matrices(points - origin)], axis=2)


class ImageOffsets(NamedTuple):
    """Possible shifts of the cameras' images against each other where a handle is.

    A handle is small compared with its distance: an error of the rig shifts each image of it as a
    whole.

    Attributes
    ----------
    covariance : ndarray, shape (2 C, 2 C)
        Of the shifts, by the rig's covariance, px^2; u and v of the first camera come first.
    by_parameters : ndarray, shape (2 C, 15 C)
        The shifts by the rig's parameters.
    by_position : ndarray, shape (2 C, 3)
        The shifts that a motion of the handle makes, world frame, px/mm.
    """

    covariance: Array
    by_parameters: Array
    by_position: Array

    def apart_px(self, i: int, j: int) -> float:
        """Standard deviation of the distance of a pixel from its epipolar line, between two
        cameras.
        """
        rows = np.r_[2 * i : 2 * i + 2, 2 * j : 2 * j + 2]
        across = contradicting(self.by_position[rows])[:, 0]
        return float(np.sqrt(2 * across @ self.covariance[np.ix_(rows, rows)] @ across))


def contradicting(by_position: Array) -> Array:
    """The offsets that no motion of the handle makes: an orthonormal basis (..., 2 C, 2 C - 3) across
    `ImageOffsets.by_position` (..., 2 C, 3).
    """
    return np.linalg.svd(by_position)[0][..., 3:]


def offsets_at(rig: Rig, point: Array) -> ImageOffsets | None:
    """The offsets of a rig's images at a point (3,), world frame; None where the rig is exact, or a
    camera does not look there.
    """
    known = known_covariance(rig)
    if known.is_exact:
        return None
    slopes = [pixel_slopes(camera, point[None]) for camera in rig.cameras]
    by_parameters = block_diag(*(part[0][0] for part in slopes))
    by_position = np.concatenate([part[1][0] for part in slopes])
    if not (np.isfinite(by_parameters).all() and np.isfinite(by_position).all()):
        return None
    covariance = by_parameters @ known.matrix @ by_parameters.T * students_factor(known.freedom)
    return ImageOffsets(covariance, by_parameters, by_position)


def offsets_of(rig: Rig, spots: Sequence[Array]) -> ImageOffsets | None:
    """The offsets where the middles of spots pixels, (n, 2) a camera, meet best; None also where
    fewer than two cameras see any.
    """
    seen = [k for k, uv in enumerate(spots) if len(uv)]
    if known_covariance(rig).is_exact or len(seen) < 2:
        return None
    middles = [np.median(spots[k], axis=0)[None] for k in seen]
    cameras = [rig.cameras[k] for k in seen]
    rays = np.concatenate([camera.rays(uv) for camera, uv in zip(cameras, middles, strict=True)])
    centres = np.stack([camera.centre for camera in cameras])
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    # the point nearest to all rays
    right = (across @ centres[..., None]).sum(axis=0)[:, 0]
    return offsets_at(rig, np.linalg.lstsq(across.sum(axis=0), right, rcond=None)[0])


def pixel_slopes(camera: Camera, points: Array) -> tuple[Array, Array]:
    """`camera.pixels_with_slopes` without the pixels."""
    return pixels_with_slopes(camera, points)[1:]
