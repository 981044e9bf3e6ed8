"""What the sweep gallery runs: one trial at one setting, all numbers in, named numbers out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from . import markertrack
from .background import BackgroundParameters
from .camera import Camera, Rig
from .checks import Array, as_number, as_whole
from .covertruth import Clip, standard_clip, watch
from .datasets import load_handle, load_table1, paper_rig
from .factors import Setup, at_distance, errors_of, measured, table1_setup, with_markers
from .kalman import KalmanParameters
from .known import KnownRecording, known_recording
from .parameters import Parameters
from .scene import Bench
from .window import Window

METHODS: Mapping[str, Parameters] = {name: Parameters(estimator=name) for name in ("paper", "patches")}


def background_pixels(update_rate: float = 0.01, difference_threshold: float = 15.0) -> dict[str, float]:
    """Wrong pixels of CCD3 in the first two seconds of `hard`, whose light drifts and steps, per cent (Eq. 5, 6).

    Returns
    -------
    dict
        `false_percent_*` of the background that counts as moving, and `missed_percent_*` of handle, hand and forearm
        that do not; means over the frames. `*_printed` is the equations as they stand, `*_cured` with shadows, a factor
        of the light, and no update where something moves (chapter 3).
    """
    cured = BackgroundParameters(update_rate, difference_threshold)
    printed = replace(cured, shadow_share=0.0, masked_rate=None, compensate_light=False)
    clip, found = _hard_light(), dict[str, float]()
    for name, way in {"printed": printed, "cured": cured}.items():
        seen = watch(list(clip.frames), clip.empty, clip.truths, way)
        found[f"false_percent_{name}"] = 100 * float(np.nanmean(seen.false))
        found[f"missed_percent_{name}"] = 100 * float(np.nanmean(seen.missed))
    return found


def search_window(jerk_intensity: float = 9.5e8, sigma_px: float = 1.5) -> dict[str, float]:
    """The search windows of the paper's filter in the first two seconds of the standard recordings (Eq. 9-15).

    Parameters
    ----------
    jerk_intensity : float
        q of the process noise, px^2/s^5.
    sigma_px : float
        Of the observation, px.

    Returns
    -------
    dict
        For `calm` and `hard`, of the images in which a camera truly sees markers: `window_percent_*`, the mean window
        as a share of the image; `lost_*`, how many the filter loses: a marker is outside the window, nothing is found,
        or the gate refuses what is.
    """
    kalman = replace(KalmanParameters(), jerk_intensity=jerk_intensity, sigma_px=sigma_px)
    found: dict[str, float] = {}
    for name in ("calm", "hard"):
        seen = [one for camera in range(3) for one in _followed(name, camera, Parameters(kalman=kalman))]
        found |= {f"window_percent_{name}": 100 * float(np.mean([share for share, _ in seen])),
                  f"lost_{name}": float(sum(lost for _, lost in seen))}
    return found


def accuracy(read_noise: float = 1.5, blur_px: float = 0.7, marker_diameter_mm: float = 3.0,
             distance_mm: float | None = None, baseline_mm: float | None = None, vergence_deg: float | None = None,
             elevation_deg: float | None = None, seed: int = 0) -> dict[str, float]:
    """Errors of the paper's estimator and of the image model on rendered frames of Table 1's poses (Eq. 26, 27).

    Parameters
    ----------
    read_noise : float
        Standard deviation of the camera's noise in the dark, grey levels.
    blur_px : float
        Standard deviation of the lens's blur.
    marker_diameter_mm : float
    distance_mm : float, optional
        Mean distance from the cameras, see `factors.at_distance`; all poses where Table 1 has them without it.
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
        `E_t_mm_*`, `geodesic_deg_*` (mean), and `n_*`, how many of the poses were measured, for `paper`, `patches`.

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
    setup = setup if distance_mm is None else at_distance(setup, as_number(distance_mm, "distance_mm", 1.0))
    return _errors(setup, as_whole(seed, "seed", low=0))


def with_baseline(rig: Rig, baseline_mm: float) -> Rig:
    """CCD2 moved along the line from CCD1, and turned so that the middle of Table 1's positions stays in its image.

    Raises ValueError for a distance that is not above 0.
    """
    length = as_number(baseline_mm, "baseline_mm", low=0.0, open_low=True)
    first, second, *others = rig.cameras
    line = second.centre - first.centre
    centre = first.centre + length * line / np.linalg.norm(line)
    middle = load_table1().set_poses.translation.mean(axis=0)
    return Rig((first, _placed(second, centre, _turning(middle - second.centre, middle - centre)), *others))


def with_vergence(rig: Rig, vergence_deg: float) -> Rig:
    """CCD1 and CCD2 turned where they stand, by the same angle, until their axes make an angle.

    They turn about the common normal of their axes. Raises ValueError for an angle that is not in [0, 90].
    """
    angle = np.deg2rad(as_number(vergence_deg, "vergence_deg", 0.0, 90.0))
    first, second, *others = rig.cameras
    axes = [camera.T_world_cam.rotation.as_matrix()[:, 2] for camera in (first, second)]
    normal = np.cross(*axes)
    now = np.arctan2(np.linalg.norm(normal), axes[0] @ axes[1])
    half = Rotation.from_rotvec((angle - now) / 2 * normal / np.linalg.norm(normal))
    return Rig((_placed(first, first.centre, half.inv()), _placed(second, second.centre, half), *others))


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
    found: dict[str, float] = {}
    for name, measurements in measured(setup, METHODS, np.random.default_rng(seed)).items():
        errors = errors_of(measurements, setup)
        found |= {f"E_t_mm_{name}": errors["E_t_mm"], f"geodesic_deg_{name}": errors["geodesic_mean_deg"],
                  f"n_{name}": errors["n"]}
    return found


def _followed(name: str, index: int, parameters: Parameters) -> list[tuple[float, bool]]:
    """For each image in which a camera truly sees markers, the window's share of it, and whether they were lost."""
    recording, regions = _recording(name), _regions(name)[index]
    camera, instants = recording.rig.cameras[index], recording.instants
    looks = markertrack.follow([now.images[index] for now in instants], [now.t_s for now in instants],
                               recording.handle, regions, parameters)
    found = []
    for now, look in zip(instants, looks, strict=True):
        if now.T_world_handle is not None and (seen := now.seen[index]).any():
            uv = camera.project(now.T_world_handle.apply(recording.handle.marker_centres[seen]))
            area = 0 if look.window is None else look.window.area
            held = look.window is not None and bool(look.window.contains(uv).all())
            found.append((area / (camera.size[0] * camera.size[1]), not (held and look.used)))
    return found


@cache
def _recording(name: str) -> KnownRecording:
    return known_recording(name)


@cache
def _regions(name: str) -> list[list[Window | None]]:
    """What moves, for each camera at each instant: there the markers are looked for as long as nothing is known."""
    recording = _recording(name)
    return [markertrack.moving_regions([now.images[k] for now in recording.instants], recording.empty[k])
            for k in range(len(recording.rig.cameras))]


@cache
def _hard_light() -> Clip:
    return standard_clip("hard", 2)
