"""Three webcams and a printed rod, by the rod, its markers and the lens.

Two webcams stand side by side and look at the place where the rod is held, a third one 40 deg above
them; poses are drawn around that place, and each is measured by itself. The calibration is exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.classkit.wrap import wrapped
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Camera, Rig, RigCovariance
from trinolab.checks import Array
from trinolab.datasets import load_handle
from trinolab.handle import Handle
from trinolab.measurement import measure
from trinolab.methods import BEST
from trinolab.metrics import geodesic_deg, position_errors
from workbench.intervals import of_mean, of_share
from workbench.studies.carrier import Row, Table, columns_of_mean
from workbench.studies.replication import CHECKED, EVERY

DISTANCE_MM, BASELINE_MM, ELEVATION_DEG = 500.0, 200.0, 40.0
SEED = 27
POSES = 60
ESTIMATORS = (CHECKED, BEST)
WRONG_MM = 3.0  # further off, a pose is of another identity of the markers
# Half as many samples a side as elsewhere: a marker's centre is off by 0.016 px at worst.
BENCH = Bench(supersampling=4, marker_supersampling=8)


class Webcam(NamedTuple):
    """A webcam's image, px, and its focal length, px."""

    size: tuple[int, int]
    focal_px: float


WEBCAMS = (Webcam((640, 480), 600.0), Webcam((1280, 720), 950.0))
RODS_MM = ((10.0, 3.0), (15.0, 4.0), (20.0, 5.0), (20.0, 6.0), (25.0, 8.0))


def webcam_rig(webcam: Webcam, baseline_mm: float = BASELINE_MM) -> Rig:
    """Three webcams that look at one place, half a metre before the first two; the world is the
    first one's frame.
    """
    half = baseline_mm / 2
    rise = np.deg2rad(ELEVATION_DEG)
    centres = {
        "ccd1": np.array([-half, 0.0, 0.0]),
        "ccd2": np.array([half, 0.0, 0.0]),
        "ccd3": DISTANCE_MM * np.array([0.0, -np.sin(rise), 1.0 - np.cos(rise)]),
    }
    placed = {name: _looking(centre) for name, centre in centres.items()}
    first = placed["ccd1"]
    width, height = webcam.size
    matrix = np.array(
        [
            [webcam.focal_px, 0.0, (width - 1) / 2],
            [0.0, webcam.focal_px, (height - 1) / 2],
            [0.0, 0.0, 1.0],
        ]
    )
    cameras = tuple(
        Camera(name, webcam.size, matrix, np.zeros(5), (first.inv() * T).inv())
        for name, T in placed.items()
    )
    return Rig(cameras, RigCovariance.exact(list(placed)))


def _looking(centre: Array) -> RigidTransform:
    """The pose of a camera that looks from a place at the rod's; its x axis stays level."""
    forward = np.array([0.0, 0.0, DISTANCE_MM]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(forward, right), forward])
    return RigidTransform.from_components(centre, Rotation.from_matrix(axes))


def rod_poses(rig: Rig, count: int = POSES, seed: int = SEED) -> RigidTransform:
    """Poses of a rod around the place that the cameras look at, upright to lying, in the rig's world
    frame.
    """
    rng = np.random.default_rng(seed)
    drawn = [
        random_pose(rng, (-60, 60), (-45, 45), (DISTANCE_MM - 50, DISTANCE_MM + 50))
        for _ in range(count)
    ]
    # the place is given before the middle of the first two cameras
    T_bench_ccd1 = _looking(np.array([-np.linalg.norm(rig.cameras[1].centre) / 2, 0.0, 0.0]))
    return RigidTransform.concatenate([T_bench_ccd1.inv() * T for T in drawn])


def cell(webcam: int, rod: int) -> list[Row]:
    """A row per estimator of one of `WEBCAMS` and one of `RODS_MM`.

    Columns: the setting; `marker_px`, the marker's diameter in the image at the distance of the
    place; `n`, poses; `measured`, the share that has a pose, and `wrong`, the share of those that is
    more than 3 mm off; mean errors of the others; 95 % intervals.
    """
    size, focal_px = WEBCAMS[webcam]
    rod_mm, marker_mm = RODS_MM[rod]
    rig = webcam_rig(WEBCAMS[webcam])
    handle = wrapped(load_handle("coded"), rod_mm, marker_mm)
    poses = rod_poses(rig)
    rng = np.random.default_rng([SEED, round(focal_px), round(10 * rod_mm)])
    taken = [render_rig(rig, handle, poses[k], BENCH, rng) for k in range(len(poses))]
    rows: list[Row] = []
    for estimator in ESTIMATORS:
        errors = [
            _error(frames, rig, handle, estimator, poses[k]) for k, frames in enumerate(taken)
        ]
        measured = np.array([one for one in errors if one is not None]).reshape(-1, 2)
        right = measured[measured[:, 0] < WRONG_MM]
        share = of_share(len(measured), len(poses))
        row: dict[str, float | str] = {
            "width_px": size[0],
            "focal_px": focal_px,
            "rod_mm": rod_mm,
            "marker_mm": marker_mm,
            "marker_px": focal_px * marker_mm / DISTANCE_MM,
            "estimator": estimator,
            "n": len(poses),
            "seed": SEED,
            "measured": len(measured) / len(poses),
            "measured_low": share.low,
            "measured_high": share.high,
            "wrong": len(measured) - len(right),
        }
        for name, values in zip(("E_t_mm", "geodesic_deg"), right.T, strict=True):
            row |= columns_of_mean(name, values, of_mean(values))
        rows.append(row)
    return rows


def _error(
    frames: list[np.ndarray], rig: Rig, handle: Handle, estimator: str, truth: RigidTransform
) -> tuple[float, float] | None:
    """How far a pose is off, mm and deg; None without one.

    Every pose counts, a doubtful one as well, since a class sees both.
    """
    pose = measure(frames, rig, handle, parameters=EVERY[estimator]).pose
    if pose.T_world_handle is None:
        return None
    estimated, true = (RigidTransform.concatenate([T]) for T in (pose.T_world_handle, truth))
    return float(position_errors(estimated, true)[0]), float(geodesic_deg(estimated, true)[0])


TABLES = [
    Table(
        "webcams",
        cell,
        [{"webcam": range(len(WEBCAMS)), "rod": range(len(RODS_MM))}],
        by=("width_px", "rod_mm", "marker_mm", "estimator"),
        again={"webcam": 0, "rod": 4},
    )
]
