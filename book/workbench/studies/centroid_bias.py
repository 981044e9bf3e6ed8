"""Centroids on trial: what makes a threshold fail, and a centroid beside a prediction of it, by
slant (Sect. 5.1).

A signed mean over all directions would hide a bias: what a model leaves over points along the
slant, towards the limb or away from it. Chapters 5 and 10.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.rays import marker_outline
from trinolab.bench.scene import radiance
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, frozen
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids, register
from trinolab.estimators.imagemodel import first_state, marker_shading
from trinolab.estimators.patches import patches
from trinolab.estimators.reprojection import fit_pixels
from trinolab.handle import Handle, slants
from trinolab.markers import find_markers
from trinolab.parameters import Parameters

DISTANCE_MM = 570.0
SHOWN_DEG = 85.0  # a marker turned further away does not show
SEEN_DEG = 77.0  # nor is its centroid asked for beyond this
NEAR_PX = 3.0  # a spot further from a marker's centre is another thing
# greys of the bridged discs
DISC = 220.0
BRIDGE = 120.0
BEHIND = 45.0
DISC_DISTANCE_MM = 570.0  # of the axis of `turned_marker`
BINS_DEG = (0, 10, 20, 30, 40, 50, 60, 65)
SAME_PX = 4.0  # a found marker further off is another thing, or badly broken: it counts as missed
# From the frames of an instant and its true pose: the centroids found, an array (m, 2) a camera,
# and those predicted for every marker, (cameras, markers, 2).
Method = Callable[
    [Sequence[np.ndarray], Rig, Handle, RigidTransform], tuple[Sequence[Array], Array]
]


class Still(NamedTuple):
    """An image, its markers' centres (n, 2), px, and how far each is turned away, deg (n,): the
    least turned first.
    """

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

    Eight discs, in pairs joined by a dimmer bridge; a textured background brighter than the rod; a
    glint along the column that faces the camera.
    """
    rotation = load_table1().set_poses.rotation[7]
    plain = still(rotation, bench, rng)
    wall = still(rotation, replace(bench, background_grey=150, texture_contrast=0.25), rng)
    ends = np.array([[1.7, -0.7], [-0.7, 1.7]]) @ plain.uv[:2]
    (x0, y0), (x1, y1) = ends.astype(int).tolist()
    glint = cv2.line(plain.image.copy(), (x0, y0), (x1, y1), 255, 5, cv2.LINE_AA)
    return {
        "standard scene": plain,
        "bridges": _bridged_discs(),
        "bright background": wall,
        "glint": plain._replace(image=glint),
    }


def inward(
    turn_deg: float, bench: Bench, rng: np.random.Generator, draws: int = 1
) -> tuple[Array, Array]:
    """How far the centroids of a turned, upright rod lie inwards of the markers' centres, towards
    the rod's axis.

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
    view = still_view()
    handle = load_handle("paper")
    T = RigidTransform.from_components([0.0, 0.0, DISTANCE_MM], rotation)
    slant = np.rad2deg(slants(handle, T, view.centre))
    visible = np.argsort(slant)[: np.count_nonzero(slant < SHOWN_DEG)]
    uv = view.project(T.apply(handle.marker_centres[visible]))
    return Still(
        blurred(radiance(view, handle, T, bench), bench), frozen(uv), frozen(slant[visible])
    )


def _shifts(taken: Still) -> Array:
    """Along u towards the middle of the image, px; NaN where no spot is near."""
    uv = np.vstack([find_markers(taken.image, 12).uv, [[1e9, 1e9]]])  # the last is near no marker
    nearest = uv[np.linalg.norm(uv - taken.uv[:, None], axis=2).argmin(axis=1)]
    shift = ((taken.uv - nearest) * np.sign(taken.uv - 160))[:, 0]
    return np.where(np.abs(shift) < NEAR_PX, shift, np.nan)


def _bridged_discs() -> Still:
    image = np.full((200, 320), BEHIND)
    centres = [(u, v) for u in (50, 125, 195, 270) for v in (60, 140)]
    for u, v in centres:
        cv2.circle(cv2.line(image, (u, 72), (u, 128), BRIDGE, 5), (u, v), 9, DISC, -1)
    return Still(image, frozen(np.array(centres, float)), frozen(np.zeros(len(centres))))


def centres(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> Array:
    """Images of the markers' centres, shape (n, 2)."""
    return camera.project(T_world_handle.apply(handle.marker_centres))


def detected(images: Sequence[np.ndarray], handle: Handle) -> list[Array]:
    """Centroids of the package's detector, an array (m, 2) a camera."""
    return [
        find_markers(image, len(handle.marker_centres), handle.markers, Parameters().markers).uv
        for image in images
    ]


def plain(
    images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform
) -> tuple[Sequence[Array], Array]:
    """The paper's: intensity centroids, taken for the images of the markers' centres."""
    return detected(images, handle), np.stack(
        [centres(camera, handle, T) for camera in rig.cameras]
    )


def modelled(
    images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform
) -> tuple[Sequence[Array], Array]:
    """Intensity centroids beside those of wrapped markers of even brightness."""
    every = Views(*np.indices((len(rig.cameras), len(handle.marker_centres))).reshape(2, -1))
    return detected(images, handle), _predicted(rig, handle, T, every)


def registered(
    images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform
) -> tuple[Sequence[Array], Array]:
    """Centroids registered as in `reprojection.fit_centroids`, from a pose 0.05 mm and half a
    degree off.
    """
    off = RigidTransform.from_components(
        [0.03, -0.03, 0.03], Rotation.from_rotvec(np.deg2rad([0.3, -0.3, 0.3]))
    )
    start = T * off
    windows = patches(images, rig, handle, start, BINS_DEG[-1] + 1.0)
    state = first_state(start, rig)
    for _ in range(3):
        state, fit = register(state, windows, rig, handle)
        shading = marker_shading(fit.at.greys)
        pose, _ = fit_pixels(
            fit.uv, fit.covariance, rig, handle, windows.views, state.T_world_handle, shading
        )
        state = state._replace(T_world_handle=pose)
    uv = [fit.uv[windows.views.camera == c] for c in range(len(rig.cameras))]
    return uv, _predicted(rig, handle, T, windows.views, shading)


METHODS: dict[str, Method] = {"plain": plain, "modelled": modelled, "registered": registered}


def turned_marker(
    turn_deg: float, rig: Rig, handle: Handle, bench: Bench
) -> tuple[float, float, float, float]:
    """Where the centroid of a single marker is that is turned away from a rig's first camera about
    the vertical.

    Returns
    -------
    slant_deg : float
    integral, light, detector : float
        How far along u the centroid lies beside the image of the marker's centre, px: as predicted;
        of rendered light, where only the marker shines, evenly; and as the detector finds it on the
        bench without noise, NaN where it finds none.
    """
    single = replace(handle, columns_deg=(0.0,), rows_mm=((0.0,),))
    camera = rig.cameras[0]
    turn = Rotation.from_euler("y", 180.0 + turn_deg, degrees=True)
    T = camera.T_world_cam * RigidTransform.from_components([0.0, 0.0, DISC_DISTANCE_MM], turn)
    bare = replace(bench, background_grey=0.0, body_grey=0.0, shading=0.0, marker_supersampling=32)
    light, frame = (blurred(radiance(camera, single, T, b), b) for b in (bare, bench))
    predicted, _ = predict_centroids(rig, single, T, Views(np.array([0]), np.array([0])))
    drawn = light.sum(axis=0) @ np.arange(light.shape[1]) / light.sum()
    slants_seen = np.append(detected([frame], single)[0][:, 0], np.nan)[0]
    u = centres(camera, single, T)[0, 0]
    slant = np.rad2deg(slants(single, T, camera.centre)[0])
    return float(slant), float(predicted[0, 0] - u), float(drawn - u), float(slants_seen - u)


def centroid_errors(
    camera: Camera, handle: Handle, T: RigidTransform, found: Array, predicted: Array
) -> pd.DataFrame:
    """Found minus predicted centroid of every marker up to 65 deg of slant that lies 10 px inside
    the image.

    Columns: `marker`, `slant_deg`, `along` (px, positive towards the limb: where the outward normal
    leans away from the line of sight) and `across` (90 deg clockwise from it on the screen); NaN
    where the marker was not found.
    """
    slant = np.rad2deg(slants(handle, T, camera.centre))
    rows = []
    for k, (u, v) in enumerate(_slant_directions(camera, handle, T)):
        if slant[k] <= BINS_DEG[-1] and camera.sees(T.apply(marker_outline(handle, k)), 10).all():
            rows.append(
                (k, slant[k], *(_nearest(found, predicted[k]) @ np.array([[u, -v], [v, u]])))
            )
    return pd.DataFrame(rows, columns=["marker", "slant_deg", "along", "across"])


def instant_errors(
    method: Method,
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T: RigidTransform,
    name: str | int,
) -> pd.DataFrame:
    """`centroid_errors` of all cameras at one instant, whose name and camera make up the column
    `view`.
    """
    return pd.concat(
        [
            centroid_errors(camera, handle, T, markers, predicted).assign(
                view=f"{name} {camera.name}"
            )
            for camera, markers, predicted in zip(
                rig.cameras, *method(images, rig, handle, T), strict=True
            )
        ],
        ignore_index=True,
    )


def centroid_report(errors: pd.DataFrame) -> pd.DataFrame:
    """By bins of slant: number, missed, bias along and across with their standard errors, scatter,
    and its noise, px.

    `errors` is as of `centroid_errors`, with a column `view` that tells poses and cameras apart,
    and two draws or more of each: their differences give the noise alone.
    """
    errors = errors.assign(bin=pd.cut(errors["slant_deg"], BINS_DEG, include_lowest=True))
    rows = []
    for name, group in errors.groupby("bin", observed=True):
        detected_ones = group.dropna()
        within = detected_ones.groupby(["view", "marker"])[["along", "across"]].var(ddof=1)
        row = {
            "slant_deg": f"{max(name.left, 0):.0f}-{name.right:.0f}",
            "n": len(group),
            "missed": len(group) - len(detected_ones),
        }
        for axis in ("along", "across"):
            views = detected_ones.groupby("view")[axis].mean()  # draws of one view share their bias
            row[f"bias_{axis}"] = detected_ones[axis].mean()
            row[f"se_{axis}"] = views.std(ddof=1) / np.sqrt(max(len(views), 1))
            row[f"scatter_{axis}"] = detected_ones[axis].std(ddof=1)
            row[f"noise_{axis}"] = np.sqrt(within[axis].mean())
        rows.append(row)
    return pd.DataFrame(rows)


def _predicted(
    rig: Rig, handle: Handle, T: RigidTransform, views: Views, shading: Array | None = None
) -> Array:
    """Predicted centroids, shape (cameras, markers, 2); NaN for markers that are not among the
    views.
    """
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    uv[views] = predict_centroids(rig, handle, T, views, shading)[0]
    return uv


def _slant_directions(camera: Camera, handle: Handle, T: RigidTransform) -> Array:
    """Image of the normals' part across the lines of sight, shape (n, 2), length 1."""
    points = T.apply(handle.marker_centres)
    normals = handle.marker_normals @ T.rotation.as_matrix().T
    sight = points - camera.centre
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    leaning = normals - (normals * sight).sum(axis=1, keepdims=True) * sight
    ahead = camera.project(points + 1e-3 * leaning) - camera.project(points)
    return ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def _nearest(found: Array, predicted: Array) -> Array:
    """Difference of the nearest found pixel, shape (2,); NaN where none is near."""
    difference = np.reshape(found, (-1, 2)) - predicted
    distance = np.linalg.norm(difference, axis=1)
    if len(distance) == 0 or not distance.min() <= SAME_PX:
        return np.full(2, np.nan)
    return difference[distance.argmin()]
