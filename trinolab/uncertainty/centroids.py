"""The errors of the centroids of wrapped markers: their noise, and a bias that all views of all
markers have in common.

Each piece of a marker has the weight of its image's area, so that the side which is turned to the
camera has more. Seen from afar, the centroid is the image of the mean of all pieces, each weighted by
the cosine between its normal and the line of sight. On a disc of radius a, wrapped on a cylinder of
radius r and seen at an angle phi around the axis, that mean lies from the marker's centre, with ``A(k)
= 2 J1(k a / r) / (k a / r)``,

    along the normal        r ((1 + A(2)) / (2 A(1)) - 1)        about -a^2 / 8 r
    around the axis         r (1 - A(2)) / (2 A(1)) tan(phi)     about a^2 / 4 r tan(phi)

wherever along the axis the camera stands. This is not noise: two cameras side by side have nearly the
same bias, and so have neighbouring columns. It makes the cylinder appear thinner by a thirtieth.

Light has the same effect: the centroid of a marker that is brighter on one side lies nearer to that
side. For distant light on a Lambertian surface, the tangent of the light's angle replaces tan(phi); its
direction is unknown, and the same for all markers.

A highlight on varnish is narrower: it lies on one column of markers and not on the next, and shifts all
views of that column around the axis alike. (On path-traced frames of a varnished handle the product of
the pulls of two neighbouring views is 0.94 of their square, of the two rows of a column 0.95, and of a
view 40 or 90 deg higher 0.54; 270 to 360 pairs each.) Different columns are independent.

The sizes of both shifts depend on the light and on the varnish, which are not stated; they have a wide
prior and are averaged over, given the images (`components.LIGHT`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import j1

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..sensitivity import Response, slopes_at
from .components import Component

NOISE_PX = 0.015  # of a centroid, in each direction, where nothing says that it is more
# The pull of the light by that of an angle of 45 deg, and of what a column mirrors alike: of diffuse
# light it is little, of a lamp in a dark room more than 1.
# Chosen for two renderers, beside 0.3 and 0.27; of a fixed size 0.4 would do for one, 0.7 for the other.
LIGHT = 0.25
# Greys that are not as predicted pull by so much more than noise of the same chi-square, as a variance:
# chosen on path-traced frames.
PULL = 8.0


class Bias(NamedTuple):
    """The bias of centroids from the images of the markers' centres, px.

    Attributes
    ----------
    foreshortening : ndarray, shape (k, 2)
        The known part: by the angle at which each marker is seen.
    light : ndarray, shape (k, 2, 2)
        The unknown part: one standard deviation of light from each of two directions across the axis.
    around : ndarray, shape (k, 2)
        The shift of each around the axis: one standard deviation of light from 45 deg.
    """

    foreshortening: Array
    light: Array
    around: Array


def centroid_bias(
    camera: np.ndarray, marker: np.ndarray, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Bias:
    """The bias of the centroids of k views of markers, shapes (k,) and (k,)."""
    R = T_world_handle.as_matrix()[:3, :3]
    normal = handle.marker_normals[marker] @ R.T
    tangent = np.cross(R[:, 1], normal)
    points = T_world_handle.apply(handle.marker_centres)[marker]
    towards = np.stack([one.centre for one in rig.cameras])[camera] - points
    radius = handle.marker_radii[marker]
    share = handle.marker_diameter_mm / 2 / radius
    first, second = (2 * j1(k * share) / (k * share) for k in (1, 2))
    # a marker that is turned away further is cut off by the outline
    facing = np.maximum((towards * normal).sum(axis=1), 1e-9)
    slope = np.clip((towards * tangent).sum(axis=1) / facing, -1 / share, 1 / share)
    inwards = radius * ((1 + second) / (2 * first) - 1)
    aside = radius * (1 - second) / (2 * first)
    offset = inwards[:, None] * normal + (aside * slope)[:, None] * tangent
    by_points = slopes_at(rig, camera, points)[1]
    around = handle.marker_angles[marker]
    two_lights = np.stack([np.cos(around), np.sin(around)], axis=1)
    by_tangent = np.einsum("kij,kj->ki", by_points, LIGHT * aside[:, None] * tangent)
    return Bias(
        np.einsum("kij,kj->ki", by_points, offset),
        by_tangent[:, :, None] * two_lights[:, None],
        by_tangent,
    )


def by_slant(places: Response, T_world_handle: RigidTransform, rig: Rig, handle: Handle) -> Array:
    """The known bias of the places of a response, (2 k,), px: one standard deviation."""
    bias = centroid_bias(places.camera, places.marker, T_world_handle, rig, handle)
    return bias.foreshortening.ravel()


def by_light(
    places: Response, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Component:
    """The effect of light on the places of a response: on all of them from two directions, and on each
    column by itself.
    """
    bias = centroid_bias(places.camera, places.marker, T_world_handle, rig, handle)
    around = np.round(handle.marker_angles[places.marker], 6)
    columns = around[:, None] == np.unique(around)
    alone = bias.around[:, :, None] * columns[:, None]
    return Component(np.concatenate([bias.light, alone], axis=2).reshape(2 * len(around), -1))


def pulled_alike(
    camera: np.ndarray,
    marker: np.ndarray,
    more_px2: Array,
    T_world_handle: RigidTransform,
    rig: Rig,
    handle: Handle,
) -> Array:
    """Covariance of places by errors of the predicted greys: smooth errors, such as those of a
    highlight, shift all views of a column around the axis alike.

    Parameters
    ----------
    camera, marker : ndarray of int, shape (k,)
        Of each place.
    more_px2 : ndarray, shape (k, 2, 2)
        Covariance of each place if these errors were noise, px^2.
    T_world_handle : RigidTransform
    rig, handle

    Returns
    -------
    ndarray, shape (2 k, 2 k)
        px^2; u and v of the first place come first.
    """
    R = T_world_handle.as_matrix()[:3, :3]
    tangent = np.cross(R[:, 1], handle.marker_normals[marker] @ R.T)
    points = T_world_handle.apply(handle.marker_centres[marker])
    around = (slopes_at(rig, camera, points)[1] @ tangent[..., None])[..., 0]
    around = around / np.linalg.norm(around, axis=1, keepdims=True)
    size = np.sqrt(np.einsum("ki,kij,kj->k", around, np.nan_to_num(PULL * more_px2), around))
    pulls = (size[:, None] * around).ravel()
    alike = same_column(marker, handle).repeat(2, 0).repeat(2, 1)
    return np.asarray(alike * np.outer(pulls, pulls))


def same_column(marker: np.ndarray, handle: Handle) -> np.ndarray:
    """Whether two markers (k,) are in one column, bool (k, k)."""
    around = handle.marker_angles[marker]
    return np.asarray(np.isclose(np.cos(around[:, None] - around), 1.0))
