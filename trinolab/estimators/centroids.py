"""Centroids of wrapped markers: predicted from a pose, and measured to a hundredth of a pixel.

The centroid is the mean of the image over the marker's visible part. A piece of the surface counts
by the area of its image, which falls with the cosine between normal and line of sight and with the
square of the distance, and by its brightness. The integral is a sum over points of the disc, taken
on the unrolled surface.

The intensity centroid of Sect. 5.1 is biased by the body's shading, by the background beyond the
body's outline, by neighbours and by saturation. `register` shifts the image that a model predicts
until it lies on the pixels: these effects are in the model, or their pixels have no weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle
from ..lens import distort
from ..rigid import cross_matrices
from .appearance import Views, shading_basis
from .imagemodel import (
    Linear,
    State,
    advanced,
    first_state,
    inverse,
    limited,
    linearise,
    marker_is_shown,
    marker_shading,
    misfit,
    noise_of,
    reduce,
    shows_gloss,
    with_gloss,
)
from .patches import Patches, patches
from .rows import BLUR, EXPOSURE, POSE

# of the sum; twice as many of both change a centroid by less than 0.001 px up to 70 deg
RINGS, SPOKES = 8, 24
NEAR_PX = 0.1  # a shift below which what the model leaves is not that markers are elsewhere


def predict_centroids(
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    views: Views,
    shading: Array | None = None,
) -> tuple[Array, Array]:
    """Centroids of markers' images at a pose, and how they move with it.

    Parameters
    ----------
    rig : Rig
    handle : Handle
    T_world_handle : RigidTransform
    views : Views
        k markers in cameras' images.
    shading : ndarray, shape (k, 3), optional
        Brightness is 1 plus these multiples of `appearance.shading_basis`; uniform without it.

    Returns
    -------
    uv : ndarray, shape (k, 2)
        Pixels of the distorted image; NaN where nothing of the marker is visible or
        `Camera.project` gives no pixel.
    jacobian : ndarray, shape (k, 2, 6)
        By a small motion (nu mm, omega rad) of the handle in its own frame: ``T_world_handle *
        exp(nu, omega)``.
    """
    turn, X = _disc_points(handle)  # (n,), (markers, n, 3)
    uv = np.empty((len(views.camera), 2))
    jacobian = np.empty((len(views.camera), 2, 6))
    for c, camera in enumerate(rig.cameras):
        mine = views.camera == c
        bright = 1.0 if shading is None else 1 + shading[mine] @ shading_basis(turn)[1:]
        markers = views.marker[mine]
        uv[mine], jacobian[mine] = _centroids(
            camera, T_world_handle, X[markers], handle.marker_radii[markers], bright
        )
    return uv, jacobian


def _centroids(
    camera: Camera, T_world_handle: RigidTransform, X: Array, radii: Array, bright: Array | float
) -> tuple[Array, Array]:
    """Centroids (k, 2) and Jacobians (k, 2, 6) from points X (k, n, 3) of markers, handle frame,
    that lie at their radii (k,) from the axis.

    With the weight w of a point and its pixel p the centroid is sum(w p) / sum(w), and its
    derivative (sum(w dp) + sum((p - centroid) dw)) / sum(w).
    """
    T_cam_handle = camera.T_cam_world * T_world_handle
    viewpoint = T_cam_handle.inv().translation
    p, d_p, z, d_z, area = _projection(camera, T_cam_handle, X)
    normal = X * np.array([1.0, 0.0, 1.0]) / radii[:, None, None]
    facing = (normal * (viewpoint - X)).sum(axis=2)  # cosine times distance
    per_facing = np.where(facing > 0, area * bright / z**3, 0.0)
    weight = per_facing * facing
    # seen from the handle the viewpoint moves, by -nu - omega x viewpoint
    d_facing = -np.concatenate(
        [normal, np.cross(np.broadcast_to(viewpoint, X.shape), normal)], axis=2
    )
    d_weight = per_facing[..., None] * d_facing - 3 * (weight / z)[..., None] * d_z
    total = weight.sum(axis=1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        centroid = (weight[..., None] * p).sum(axis=1) / total
        d_centroid = np.einsum("kn,kndj->kdj", weight, d_p) + np.einsum(
            "knd,knj->kdj", p - centroid[:, None], d_weight
        )
        return centroid, d_centroid / total[..., None]


def _projection(
    camera: Camera, T_cam_handle: RigidTransform, X: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Pixels (k, n, 2) and depths (k, n) of points X (k, n, 3), their derivatives, and the lens's
    change of area.

    The derivatives are by a small motion of the handle; that of the lens's area, a millionth of it,
    is left out.
    """
    R = T_cam_handle.rotation.as_matrix()
    local = X @ R.T + T_cam_handle.translation
    d_local = R @ np.concatenate(
        [np.broadcast_to(np.eye(3), (*X.shape, 3)), -cross_matrices(X)], axis=3
    )
    z = local[..., 2]
    xy = local[..., :2] / z[..., None]
    d_xy = (d_local[..., :2, :] - xy[..., None] * d_local[..., 2:, :]) / z[..., None, None]
    distorted, lens = distort(xy.reshape(-1, 2), camera.distortions)
    lens = lens.reshape(*z.shape, 2, 2)
    pixels = distorted.reshape(xy.shape) * camera.focal + camera.principal_point
    return pixels, camera.focal[:, None] * (lens @ d_xy), z, d_local[..., 2, :], np.linalg.det(lens)


def _disc_points(handle: Handle) -> tuple[Array, Array]:
    """Angles (n,) from the middle and points (markers, n, 3) of discs, each for an equal share of
    the area.
    """
    radius = np.sqrt((np.arange(RINGS) + 0.5) / RINGS) * handle.marker_diameter_mm / 2
    phi = 2 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES
    around = handle.marker_radii[:, None]
    ring = np.repeat(radius, SPOKES)
    angle = handle.marker_angles[:, None] + ring / around * np.tile(np.cos(phi), RINGS)
    axial = handle.marker_centres[:, 1, None] + np.outer(radius, np.sin(phi)).ravel()
    # the light around the body does not ask for a marker's own radius
    turn = np.outer(radius / handle.radius_mm, np.cos(phi)).ravel()
    return turn, np.stack([around * np.sin(angle), axial, around * np.cos(angle)], axis=2)


class Registered(NamedTuple):
    """Centroids measured by shifting what an image model predicts until it lies on the pixels.

    Attributes
    ----------
    uv : ndarray, shape (k, 2)
        px.
    shift : ndarray, shape (k, 2)
        From where the state predicts them, px.
    covariance : ndarray, shape (k, 2, 2)
        px^2.
    at : Linear
        The model that they were measured with.
    """

    uv: Array
    shift: Array
    covariance: Array
    at: Linear

    @property
    def more_px2(self) -> Array:
        """Covariance by greys that are not as predicted, (k, 2, 2), px^2, as if they were noise."""
        more = np.maximum(misfit(self.at) - 1, 0.0)
        return np.asarray(more[:, None, None] * self.covariance)

    @property
    def usual_shift_px(self) -> float:
        """The median length of the shifts, px."""
        return float(np.median(np.linalg.norm(self.shift, axis=1)))


class CentrePixels(NamedTuple):
    """Pixels of markers' centres, (cameras, markers, 2), NaN where unseen, and their covariances,
    px^2, (cameras, markers, 2, 2).
    """

    uv: Array
    covariance: Array


def register(state: State, here: Patches, rig: Rig, handle: Handle) -> tuple[State, Registered]:
    """Measure the centroids of markers in their windows by one Gauss-Newton step of shift, blur and
    greys each.

    The background beside the body, the body's shading, saturated pixels and neighbours are in the
    model or have no weight, so that they do not bias the centroid as they bias a plain one.

    Returns
    -------
    state : State
        With updated greys, blur and noise, and with gloss once the windows show some; the pose is
        unchanged.
    registered : Registered
    """
    at = linearise(state, here, rig, handle)
    uv, by_motion = predict_centroids(
        rig, handle, state.T_world_handle, here.views, marker_shading(at.greys)
    )
    # (k, 2, 3): the motion that moves it by a pixel
    shift = np.linalg.pinv(by_motion[:, :, :3]).transpose(0, 2, 1)
    # shifts along u and v, in rows that a still handle leaves free
    at.rows[:, EXPOSURE : EXPOSURE + 2] = shift @ at.rows[:, POSE : POSE + 3]
    at = at._replace(unknowns=np.array([EXPOSURE, EXPOSURE + 1, BLUR]))
    normal = reduce(at, at.unknowns)
    covariance = inverse(normal.information + 1e-9 * np.eye(3))
    step = (covariance @ normal.gradient[..., None])[..., 0]
    after = advanced(at, normal, step)
    blur = [
        np.median(step[here.views.camera == c, 2]) if (here.views.camera == c).any() else 0.0
        for c in range(len(rig.cameras))
    ]
    noise = noise_of(after, here.at.pixels)
    renewed = State(
        state.T_world_handle, after.greys, limited(state.blur_px2, np.array(blur)), noise
    )
    registered = Registered(uv + step[:, :2], step[:, :2], covariance[:, :2, :2], after)
    # what is left of a long step is no gloss
    if registered.usual_shift_px < NEAR_PX and shows_gloss(after, handle):
        renewed = with_gloss(renewed)
    return renewed, registered


def centre_pixels(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    max_slant_deg: float,
    rounds: int = 2,
) -> CentrePixels | None:
    """Images of the markers' centres: predicted by a pose, and shifted as the centroids are.

    Parameters as for `reprojection.fit_centroids`; windows that show no marker are omitted. None if
    no window shows one.
    """
    windows = patches(images, rig, handle, T_world_handle, max_slant_deg)
    state = first_state(T_world_handle, rig)
    for _ in range(rounds if len(windows.grey) else 0):
        state, registered = register(state, windows, rig, handle)
    visible = marker_is_shown(registered.at, handle) if len(windows.grey) else np.zeros(0, bool)
    if not visible.any():
        return None
    views = Views(windows.views.camera[visible], windows.views.marker[visible])
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    centres = T_world_handle.apply(handle.marker_centres)
    uv[views] = (
        np.stack([camera.project(centres) for camera in rig.cameras])[views]
        + registered.shift[visible]
    )
    covariance = np.full((*uv.shape, 2), np.nan)
    covariance[views] = (
        registered.covariance[visible]
        * np.maximum(misfit(registered.at)[visible], 1.0)[:, None, None]
    )
    return CentrePixels(uv, covariance)
