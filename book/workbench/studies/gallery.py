"""The sweep gallery: which sweeps it has, and what each runs at one setting. ``data/tables/gallery.py``
makes its tables.

Each sweep is a function of this module, or a chapter, at the settings of a grid as `trinolab sweep`
takes it.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.background import BackgroundParameters
from trinolab.bench.optics import Bench
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_number, as_whole
from trinolab.datasets import load_handle, load_sweep, load_table1, paper_rig
from trinolab.kalman import KalmanParameters
from trinolab.parameters import Parameters
from trinolab.window import Window

from ..sweep.grid import parse, runs
from . import markertrack
from .factors import Setup, at_distance, errors_of, measured, table1_setup, with_markers
from .ground_truth import Recorded, Regions, held, moving, read_recording, watch

METHODS: Mapping[str, Parameters] = {
    name: Parameters(estimator=name) for name in ("paper", "patches")
}
SEEDS = "seed=0,1,2"
PAIRS = ("wrong_matches", "missing_matches", "due_matches")
SPOTS = (
    *("last_missed_calm", "last_missed_hard", "missed_calm_windows", "missed_hard_windows"),
    *("shown_calm", "shown_hard"),
)


def background_pixels(
    update_rate: float = 0.01, difference_threshold: float = 15.0
) -> dict[str, float]:
    """Wrong pixels of CCD3 in the first two seconds of `hard`, whose light drifts and steps, per
    cent (Eq. 5, 6).

    Returns
    -------
    dict
        `false_percent_*` of the background that counts as moving, and `missed_percent_*` of handle,
        hand and forearm that do not; means over the frames. `*_printed` is the equations as they
        stand, `*_cured` with shadows, a factor of the light, and no update where something moves
        (chapter 3).
    """
    cured = BackgroundParameters(update_rate, difference_threshold)
    printed = replace(cured, shadow_share=0.0, masked_rate=None, compensate_light=False)
    (frames, empty, truths) = hard_light()
    counts = dict[str, float]()
    for name, step in {"printed": printed, "cured": cured}.items():
        seen = watch(frames, empty, truths, step)
        counts[f"false_percent_{name}"] = 100 * float(np.nanmean(seen.false))
        counts[f"missed_percent_{name}"] = 100 * float(np.nanmean(seen.missed))
    return counts


def search_window(jerk_intensity: float = 9.5e8, sigma_px: float = 1.5) -> dict[str, float]:
    """The search windows of the paper's filter in the first two seconds of the standard recordings
    (Eq. 9-15).

    Parameters
    ----------
    jerk_intensity : float
        q of the process noise, px^2/s^5.
    sigma_px : float
        Of the observation, px.

    Returns
    -------
    dict
        For `calm` and `hard`, of the images in which a camera truly sees markers:
        `window_percent_*`, the mean window as a share of the image; `lost_*`, how many the filter
        loses: a marker is outside the window, nothing is found, or the gate refuses what is;
        `images_*`, how many there are.
    """
    kalman = replace(KalmanParameters(), jerk_intensity=jerk_intensity, sigma_px=sigma_px)
    results: dict[str, float] = {}
    images: dict[str, float] = {}
    for name in ("calm", "hard"):
        seen = [
            one for camera in range(3) for one in followed(name, camera, Parameters(kalman=kalman))
        ]
        results |= {
            f"window_percent_{name}": 100 * float(np.mean([share for share, _ in seen])),
            f"lost_{name}": float(sum(lost for _, lost in seen)),
        }
        images[f"images_{name}"] = float(len(seen))
    return results | images


def accuracy(
    read_noise: float = 1.5,
    blur_px: float = 0.7,
    marker_diameter_mm: float = 3.0,
    distance_mm: float | None = None,
    baseline_mm: float | None = None,
    vergence_deg: float | None = None,
    elevation_deg: float | None = None,
    seed: int = 0,
) -> dict[str, float]:
    """Errors of the paper's estimator and of the image model on rendered frames of Table 1's poses
    (Eq. 26, 27).

    Parameters
    ----------
    read_noise : float
        Standard deviation of the camera's noise in the dark, grey levels.
    blur_px : float
        Standard deviation of the lens's blur.
    marker_diameter_mm : float
    distance_mm : float, optional
        Mean distance from the cameras, see `factors.at_distance`; all poses where Table 1 has them
        without it.
    baseline_mm : float, optional
        From CCD1 to CCD2, see `with_baseline`; the paper's without it.
    vergence_deg : float, optional
        Between the axes of CCD1 and CCD2, see `with_vergence`; the paper's without it.
    elevation_deg : float, optional
        Of a third camera, see `datasets.paper_rig`; none without it.
    seed : int
        Of the noise.

    Returns
    -------
    dict
        `E_t_mm_*`, `geodesic_deg_*` (mean), and `n_*`, how many of the poses were measured, for
        `paper`, `patches`.

    Raises
    ------
    ValueError
        For a setting that is out of range.
    """
    rig = paper_rig(elevation_deg)
    rig = rig if baseline_mm is None else with_baseline(rig, baseline_mm)
    rig = rig if vergence_deg is None else with_vergence(rig, vergence_deg)
    setup = with_markers(table1_setup(rig, load_handle("paper")), marker_diameter_mm)
    setup = setup._replace(bench=Bench(read_noise=read_noise, blur_px=blur_px))
    setup = (
        setup
        if distance_mm is None
        else at_distance(setup, as_number(distance_mm, "distance_mm", 1.0))
    )
    return _errors(setup, as_whole(seed, "seed", low=0))


def with_baseline(rig: Rig, baseline_mm: float) -> Rig:
    """CCD2 moved along the line from CCD1, and turned so that the middle of Table 1's positions
    stays in its image.

    Raises ValueError for a distance that is not above 0.
    """
    length = as_number(baseline_mm, "baseline_mm", low=0.0, open_low=True)
    first, second, *others = rig.cameras
    line = second.centre - first.centre
    centre = first.centre + length * line / np.linalg.norm(line)
    middle = load_table1().set_poses.translation.mean(axis=0)
    moved = _placed(second, centre, _turning(middle - second.centre, middle - centre))
    return replace(rig, cameras=(first, moved, *others))


def with_vergence(rig: Rig, vergence_deg: float) -> Rig:
    """CCD1 and CCD2 turned where they stand, by the same angle, until their axes make an angle.

    They turn about the common normal of their axes. Raises ValueError for an angle that is not in
    [0, 90].
    """
    angle = np.deg2rad(as_number(vergence_deg, "vergence_deg", 0.0, 90.0))
    first, second, *others = rig.cameras
    axes = [camera.T_world_cam.rotation.as_matrix()[:, 2] for camera in (first, second)]
    normal = np.cross(*axes)
    now = np.arctan2(np.linalg.norm(normal), axes[0] @ axes[1])
    half = Rotation.from_rotvec((angle - now) / 2 * normal / np.linalg.norm(normal))
    turned = _placed(first, first.centre, half.inv()), _placed(second, second.centre, half)
    return replace(rig, cameras=(*turned, *others))


def _placed(camera: Camera, centre: Array, turn: Rotation) -> Camera:
    """The camera at another place, turned in the world."""
    T_world_cam = RigidTransform.from_components(centre, turn * camera.T_world_cam.rotation)
    return replace(camera, T_cam_world=T_world_cam.inv())


def _turning(before: Array, after: Array) -> Rotation:
    """The least rotation from one direction to another."""
    axis = np.cross(before, after)
    angle = np.arctan2(np.linalg.norm(axis), before @ after)
    return Rotation.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-300))


def _errors(setup: Setup, seed: int) -> dict[str, float]:
    results: dict[str, float] = {}
    for name, measurements in measured(setup, METHODS, np.random.default_rng(seed)).items():
        errors = errors_of(measurements, setup)
        results |= {
            f"E_t_mm_{name}": errors["E_t_mm"],
            f"geodesic_deg_{name}": errors["geodesic_mean_deg"],
            f"n_{name}": errors["n"],
        }
    return results


def followed(name: str, index: int, parameters: Parameters) -> list[tuple[float, bool]]:
    """For each image in which a camera truly sees markers, the window's share of it, and whether
    they were lost.
    """
    recording = kept_recording(name)
    width, height = recording.rig.cameras[index].size
    looks = markertrack.follow(
        recording.images_of(index),
        recording.times_s,
        recording.handle,
        regions(name)[index],
        parameters,
    )
    holds = held([look.window for look in looks], recording, index)
    windows = []
    for now, look, whole in zip(recording.instants, looks, holds, strict=True):
        if now.seen[index].any():
            area = 0 if look.window is None else look.window.area
            windows.append((area / (width * height), not (whole and look.used)))
    return windows


@cache
def kept_recording(name: str) -> Recorded:
    return read_recording(name)


@cache
def regions(name: str) -> list[list[Window | None]]:
    """What moves, for each camera at each instant: there the markers are looked for as long as
    nothing is known.
    """
    recording = kept_recording(name)
    return [
        markertrack.moving_regions(recording.images_of(k), empty)
        for k, empty in enumerate(recording.empty)
    ]


@cache
def hard_light() -> tuple[list[np.ndarray], np.ndarray, list[Regions]]:
    """CCD3's images of `hard`, a fourth of the rows and columns; that of the empty bench; and what
    truly moves.
    """
    recording = read_recording("hard", every=4)
    return recording.images_of(2), recording.empty[2], moving(recording, 2, seam_px=2)


class Exhibit(NamedTuple):
    """One sweep.

    Attributes
    ----------
    what : callable or str
        A function, or a chapter's name.
    grid : tuple of str
        As behind ``-p``.
    results : tuple of str
        What the table keeps of a chapter's results; empty for all that a function gives.
    """

    what: Callable[..., dict[str, float]] | str
    grid: tuple[str, ...]
    results: tuple[str, ...] = ()


GALLERY = {
    "update_rate": Exhibit(background_pixels, ("update_rate=log:0.001:0.512:10",)),
    "difference_threshold": Exhibit(
        background_pixels, ("difference_threshold=3,5,7,10,15,20,30,45,60,90",)
    ),
    "background": Exhibit(
        background_pixels, ("update_rate=log:0.001:0.256:5", "difference_threshold=5,10,15,30,60")
    ),
    "process_noise": Exhibit(search_window, ("jerk_intensity=log:1e4:1e13:10",)),
    "surplus": Exhibit("05_markers", ("surplus=1.0,1.25,1.5,2.0,3.0,5.0",), SPOTS),
    "ncc_threshold": Exhibit("06_matching", ("ncc_threshold=0.5:0.95:10", SEEDS), PAIRS),
    "epipolar_gate": Exhibit("06_matching", ("epipolar_gate_px=log:0.25:16.0:7", SEEDS), PAIRS),
    "noise": Exhibit(accuracy, ("read_noise=log:0.5:32.0:7", SEEDS)),
    "blur": Exhibit(accuracy, ("blur_px=0.3,0.5,0.7,1.0,1.5,2.0,3.0,4.0", SEEDS)),
    "marker_size": Exhibit(accuracy, ("marker_diameter_mm=1.0,1.5,2.0,2.5,3.0,4.0,5.0", SEEDS)),
    "distance": Exhibit(
        accuracy, ("distance_mm=430.0,500.0,570.0,650.0,750.0,900.0,1100.0", SEEDS)
    ),
    "baseline": Exhibit(accuracy, ("baseline_mm=25.0,50.0,75.0,100.0,150.0,200.0,300.0", SEEDS)),
    "vergence": Exhibit(accuracy, ("vergence_deg=0.0,4.0,7.0,10.5,14.0,18.0,22.0", SEEDS)),
    "elevation": Exhibit(accuracy, ("elevation_deg=10.0:90.0:9", SEEDS)),
}


def settings(name: str) -> list[dict[str, Any]]:
    """The parameters of each run of a sweep, in the table's order. ValueError for an unknown
    name.
    """
    return runs(parse(_exhibit(name).grid))


def command(name: str) -> str:
    """What makes a table again, for a shell. ValueError for an unknown name."""
    what, grid, _ = _exhibit(name)
    if callable(what):
        return f"python -m workbench.studies gallery {name}"
    grids = [part for text in grid for part in ("-p", text)]
    return shlex.join(
        ["trinolab", "sweep", f"notebooks/{what}.ipynb", *grids, "--out", f"sweeps/{name}"]
    )


def load(name: str) -> pd.DataFrame:
    """A shipped table, a row per run: the parameters, then the results. ValueError for an unknown
    name.
    """
    names = list(settings(name)[0])
    table = load_sweep(f"gallery/{name}")
    table.attrs["parameters"] = names
    return table


def _exhibit(name: str) -> Exhibit:
    if name not in GALLERY:
        raise ValueError(f"name: expected one of {', '.join(GALLERY)}, got {name!r}")
    return GALLERY[name]
