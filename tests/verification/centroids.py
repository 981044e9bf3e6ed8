"""The centroid beside a prediction of it, by slant: bias along the slant and across it, and scatter.

A signed mean over all directions would hide a bias: what a model leaves over points along the slant, towards the limb
or away from it.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab.appearance import Views
from trinolab.camera import Camera, Rig
from trinolab.centroids import predict_centroids
from trinolab.checks import Array
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle, slants
from trinolab.imagemodel import first_state
from trinolab.markers import find_markers
from trinolab.parameters import Parameters
from trinolab.patches import patches
from trinolab.raycast import marker_outline
from trinolab.registration import register
from trinolab.reprojection import fit_pixels
from trinolab.scene import Bench, digitise, random_pose

from .draws import expected_frames

BINS_DEG = (0, 10, 20, 30, 40, 50, 60, 65)
SAME_PX = 4.0  # a found marker further off is another thing, or badly broken: it counts as missed
# From the frames of an instant and its true pose: the centroids found, an array (m, 2) a camera, and those predicted
# for every marker, (cameras, markers, 2).
Method = Callable[[Sequence[np.ndarray], Rig, Handle, RigidTransform], tuple[Sequence[Array], Array]]


def centres(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> Array:
    """Images of the markers' centres, shape (n, 2)."""
    return camera.project(T_world_handle.apply(handle.marker_centres))


def detected(images: Sequence[np.ndarray], handle: Handle) -> list[Array]:
    """Centroids of the package's detector, an array (m, 2) a camera."""
    return [find_markers(image, len(handle.marker_centres), handle.markers, Parameters().markers).uv
            for image in images]


def plain(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform) -> tuple[Sequence[Array], Array]:
    """The paper's: intensity centroids, taken for the images of the markers' centres."""
    return detected(images, handle), np.stack([centres(camera, handle, T) for camera in rig.cameras])


def modelled(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform
             ) -> tuple[Sequence[Array], Array]:
    """Intensity centroids beside those of wrapped markers of even brightness."""
    return detected(images, handle), _predicted(rig, handle, T, _every(rig, handle))


def registered(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T: RigidTransform
               ) -> tuple[Sequence[Array], Array]:
    """Centroids registered as in `reprojection.fit_centroids`, from a pose 0.05 mm and half a degree off."""
    off = RigidTransform.from_components([0.03, -0.03, 0.03], Rotation.from_rotvec(np.deg2rad([0.3, -0.3, 0.3])))
    start = T * off
    here = patches(images, rig, handle, start, BINS_DEG[-1] + 1.0)
    state = first_state(start, rig)
    for _ in range(3):
        state, found = register(state, here, rig, handle)
        shading = found.at.greys[:, 2:5]
        pose, _ = fit_pixels(found.uv, found.covariance, rig, handle, here.views, state.T_world_handle, shading)
        state = state._replace(T_world_handle=pose)
    uv = [found.uv[here.views.camera == c] for c in range(len(rig.cameras))]
    return uv, _predicted(rig, handle, T, here.views, shading)


METHODS: dict[str, Method] = {"plain": plain, "modelled": modelled, "registered": registered}


def centroid_errors(camera: Camera, handle: Handle, T: RigidTransform, found: Array, predicted: Array) -> pd.DataFrame:
    """Found minus predicted centroid of every marker up to 65 deg of slant that lies 10 px inside the image.

    Columns: `marker`, `slant_deg`, `along` (px, positive towards the limb: where the outward normal leans away from the
    line of sight) and `across` (90 deg clockwise from it on the screen); NaN where the marker was not found.
    """
    slant, rows = np.rad2deg(slants(handle, T, camera.centre)), []
    for k, (u, v) in enumerate(_slant_directions(camera, handle, T)):
        if slant[k] <= BINS_DEG[-1] and camera.sees(T.apply(marker_outline(handle, k)), 10).all():
            rows.append((k, slant[k], *(_nearest(found, predicted[k]) @ np.array([[u, -v], [v, u]]))))
    return pd.DataFrame(rows, columns=["marker", "slant_deg", "along", "across"])


def centroid_report(errors: pd.DataFrame) -> pd.DataFrame:
    """By bins of slant: number, missed, bias along and across with their standard errors, scatter, and its noise, px.

    `errors` is as of `centroid_errors`, with a column `view` that tells poses and cameras apart, and two draws or more
    of each: their differences give the noise alone.
    """
    errors = errors.assign(bin=pd.cut(errors["slant_deg"], BINS_DEG, include_lowest=True))
    rows = []
    for name, group in errors.groupby("bin", observed=True):
        found = group.dropna()
        within = found.groupby(["view", "marker"])[["along", "across"]].var(ddof=1)
        row = {"slant_deg": f"{max(name.left, 0):.0f}-{name.right:.0f}", "n": len(group),
               "missed": len(group) - len(found)}
        for axis in ("along", "across"):
            views = found.groupby("view")[axis].mean()  # draws of one view share their bias
            row[f"bias_{axis}"], row[f"se_{axis}"] = found[axis].mean(), views.std(ddof=1) / np.sqrt(max(len(views), 1))
            row[f"scatter_{axis}"], row[f"noise_{axis}"] = found[axis].std(ddof=1), np.sqrt(within[axis].mean())
        rows.append(row)
    return pd.DataFrame(rows)


def drawn_errors(methods: dict[str, Method], poses: int, draws: int = 2, rig_name: str = "raised_40deg",
                 handle_name: str = "coded", seed: int = 11) -> dict[str, pd.DataFrame]:
    """Errors of each method on rendered frames of random poses, the same for all of them."""
    rig, handle, rng, bench = load_rig(rig_name), load_handle(handle_name), np.random.default_rng(seed), Bench()
    errors: dict[str, list[pd.DataFrame]] = {name: [] for name in methods}
    for k in tqdm(range(poses), leave=False, unit="pose"):
        T = random_pose(rng)
        expected = expected_frames(rig, handle, T, bench)
        for _ in range(draws):
            images = [digitise(image, bench, rng) for image in expected]
            for name, method in methods.items():
                for camera, found, predicted in zip(rig.cameras, *method(images, rig, handle, T), strict=True):
                    one = centroid_errors(camera, handle, T, found, predicted)
                    errors[name].append(one.assign(view=f"{k} {camera.name}"))
    return {name: pd.concat(parts, ignore_index=True) for name, parts in errors.items()}


def report(arguments) -> None:
    print(f"Found minus predicted centroid, px, {arguments.centroid_poses} random poses, three cameras, two draws, by")
    print("slant: bias along it and across it (se: standard error), scatter, and the part of the scatter that is noise")
    for handle in ("coded", "paper"):
        for name, errors in drawn_errors(METHODS, arguments.centroid_poses, handle_name=handle).items():
            print(f"{name}, handle `{handle}`")
            print(centroid_report(errors).to_string(index=False, float_format="{:.4f}".format), flush=True)


def _every(rig: Rig, handle: Handle) -> Views:
    return Views(*np.indices((len(rig.cameras), len(handle.marker_centres))).reshape(2, -1))


def _predicted(rig: Rig, handle: Handle, T: RigidTransform, views: Views, shading: Array | None = None) -> Array:
    """Predicted centroids, shape (cameras, markers, 2); NaN for markers that are not among the views."""
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    uv[views] = predict_centroids(rig, handle, T, views, shading)[0]
    return uv


def _slant_directions(camera: Camera, handle: Handle, T: RigidTransform) -> Array:
    """Image of the normals' part across the lines of sight, shape (n, 2), length 1."""
    points, normals = T.apply(handle.marker_centres), handle.marker_normals @ T.rotation.as_matrix().T
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
