"""Centroids measured to a hundredth of a pixel: by shifting what an image model predicts until it lies on the pixels.

The intensity centroid of Sect. 5.1 is pulled by the body's shading, by what lies beyond the body's outline, by
neighbours and by saturation. Here these are in the model, or their pixels have no weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .appearance import Views
from .camera import Rig
from .centroids import predict_centroids
from .checks import Array
from .handle import Handle
from .imagemodel import (
    Linear,
    State,
    advanced,
    first_state,
    inverse,
    limited,
    linearise,
    marker_is_shown,
    misfit,
    noise_of,
    reduce,
)
from .patches import Patches, patches


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
        What they were measured with.
    """

    uv: Array
    shift: Array
    covariance: Array
    at: Linear


class CentrePixels(NamedTuple):
    """Pixels of markers' centres, (cameras, markers, 2), NaN where unseen, and their standard deviations, px, (cameras,
    markers)."""

    uv: Array
    sigma_px: Array


def register(state: State, here: Patches, rig: Rig, handle: Handle) -> tuple[State, Registered]:
    """Measure the centroids of markers in their windows by one Gauss-Newton step of shift, blur and greys each.

    The background beside the body, the body's shading, saturated pixels and neighbours are in the model or without
    weight, so that they do not pull at the centroid as they do at a plain one.

    Returns
    -------
    state : State
        With greys, blur and noise renewed; the pose stays.
    registered : Registered
    """
    at = linearise(state, here, rig, handle)
    uv, by_motion = predict_centroids(rig, handle, state.T_world_handle, here.views, at.greys[:, 2:5])
    shift = np.linalg.pinv(by_motion[:, :, :3]).transpose(0, 2, 1)  # (k, 2, 3): the motion that moves it by a pixel
    by_other = np.concatenate([shift @ at.by_pose[:, :3], at.by_pose[:, 6:]], axis=1)
    normal = reduce(by_other, at)
    covariance = inverse(normal.information + 1e-9 * np.eye(3))
    step = (covariance @ normal.gradient[..., None])[..., 0]
    after = advanced(at, by_other, normal, step)
    blur = [np.median(step[here.views.camera == c, 2]) if (here.views.camera == c).any() else 0.0
            for c in range(len(rig.cameras))]
    noise = noise_of(after)
    renewed = State(state.T_world_handle, after.greys, limited(state.blur_px2, np.array(blur)), noise)
    return renewed, Registered(uv + step[:, :2], step[:, :2], covariance[:, :2, :2], after)


def centre_pixels(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T_world_handle: RigidTransform,
                  max_slant_deg: float, rounds: int = 2) -> CentrePixels | None:
    """Where the centres of markers are in the images: where a pose predicts them, shifted as the centroids are.

    Parameters as for `refine.fit_centroids`; windows that show no marker are left out. None if all do not.
    """
    here = patches(images, rig, handle, T_world_handle, max_slant_deg)
    state = first_state(T_world_handle, rig)
    for _ in range(rounds if len(here.grey) else 0):
        state, found = register(state, here, rig, handle)
    shown = marker_is_shown(found.at, handle) if len(here.grey) else np.zeros(0, bool)
    if not shown.any():
        return None
    views = Views(here.views.camera[shown], here.views.marker[shown])
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    centres = T_world_handle.apply(handle.marker_centres)
    uv[views] = np.stack([camera.project(centres) for camera in rig.cameras])[views] + found.shift[shown]
    sigma = np.full(uv.shape[:2], np.nan)
    variance = np.trace(found.covariance[shown], axis1=1, axis2=2) / 2
    sigma[views] = np.sqrt(variance * np.maximum(misfit(found.at)[shown], 1.0))
    return CentrePixels(uv, sigma)
