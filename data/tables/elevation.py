"""CCD3's elevation from 10 to 90 deg: what the cameras share, how accurate they are, what a hidden one
costs. CCD1 and CCD2 stay where Sect. 6.2 calibrated them; every estimator measures the same frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import islice

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import Arm, true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_table1, paper_rig
from trinolab.handle import Handle
from trinolab.measurement import Measurement
from trinolab.methods import ESTIMATORS
from trinolab.metrics import PoseErrors
from trinolab.parameters import Parameters
from workbench.studies.carrier import Row, Table
from workbench.studies.claim_trials import share_close
from workbench.studies.replication import measure_frames, replication_errors, shared_poses

ELEVATIONS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
SETTINGS: Mapping[str, Parameters] = {name: Parameters(estimator=name) for name in ESTIMATORS}
HANDLE = "paper"
POSES = 100  # random ones, for the shared markers
HIDDEN_POSES = 15  # the first of them at which CCD1 and CCD2 share four markers
SEED = 40  # of the random poses


def cell(elevation_deg: float, settings: Mapping[str, Parameters] = SETTINGS) -> list[Row]:
    """A row an estimator at one elevation."""
    rig = paper_rig(elevation_deg)
    shared = shared_markers(rig, load_handle(HANDLE), random_poses())
    errors = accuracy(rig, settings)
    shares = [kept(rig, hidden, settings) for hidden in range(len(rig.cameras))]
    return [
        {
            "estimator": name,
            **shared,
            "n": e.n,
            "E_t_mm": e.E_t_mm,
            "geodesic_mean_deg": e.geodesic_mean_deg,
            **{
                f"kept_{camera}": share[name]
                for camera, share in zip(rig.names, shares, strict=True)
            },
        }
        for name, e in errors.items()
    ]


def accuracy(rig: Rig, settings: Mapping[str, Parameters] = SETTINGS) -> dict[str, PoseErrors]:
    """Errors of every estimator on rendered frames of Table 1's poses, up to the handle's
    symmetry.
    """
    measurements_of = measured(rig, "table1", None, settings)
    return {
        name: replication_errors(measurements, load_table1().set_poses, load_handle(HANDLE))
        for name, measurements in measurements_of.items()
    }


def kept(rig: Rig, hidden: int, settings: Mapping[str, Parameters] = SETTINGS) -> dict[str, float]:
    """Share of poses that each estimator still measures when a hand hides the view of the camera
    `hidden`.

    Of random poses at which CCD1 and CCD2 share four markers, as long as nobody hides them;
    measured is within 1 mm and 5 deg, up to the handle's symmetry.
    """
    measurements_of = measured(rig, "random", hidden, settings)
    return {
        name: share_close(measurements, poses_of("random"), load_handle(HANDLE), equivalents=True)
        for name, measurements in measurements_of.items()
    }


def shared_markers(rig: Rig, handle: Handle, poses: Sequence[RigidTransform]) -> dict[str, float]:
    """Mean number of markers that both cameras of a pair truly see, by the pair: `shared_12` for
    CCD1 and CCD2.
    """
    seen = np.array([[true_visibility(camera, handle, T) for camera in rig.cameras] for T in poses])
    return {
        f"shared_{i + 1}{j + 1}": float((seen[:, i] & seen[:, j]).sum(axis=1).mean())
        for i, j in rig.pairs
    }


@cache
def random_poses() -> list[RigidTransform]:
    rng = np.random.default_rng(SEED)
    return [random_pose(rng) for _ in range(POSES)]


@cache
def poses_of(which: str) -> list[RigidTransform]:
    """Table 1's poses, or random ones at which CCD1 and CCD2 truly see the same four markers."""
    if which == "table1":
        return list(load_table1().set_poses)
    return list(
        islice(
            shared_poses(paper_rig(), load_handle(HANDLE), np.random.default_rng(SEED)),
            HIDDEN_POSES,
        )
    )


def measured(
    rig: Rig, which: str, hidden: int | None, settings: Mapping[str, Parameters]
) -> dict[str, list[Measurement]]:
    """Measurements of the poses by every estimator, a hand hiding one camera's view."""
    taken = (frames(rig, which, k, hidden) for k in range(len(poses_of(which))))
    return measure_frames(taken, rig, load_handle(HANDLE), settings)


def frames(rig: Rig, which: str, k: int, hidden: int | None) -> list[np.ndarray]:
    """Frames of an instant; those of CCD1 and CCD2 are rendered once for all elevations."""
    if hidden == 2:
        return [frame(rig, c, which, k, hidden) for c in range(3)]
    return [*pair_frames(which, k, hidden), frame(rig, 2, which, k, hidden)]


@cache
def pair_frames(which: str, k: int, hidden: int | None) -> tuple[np.ndarray, ...]:
    return tuple(frame(paper_rig(), c, which, k, hidden) for c in range(2))


def frame(rig: Rig, c: int, which: str, k: int, hidden: int | None) -> np.ndarray:
    x, y, z = rig.cameras[hidden or 0].centre
    arm = None if hidden is None else Arm(hides_from=(float(x), float(y), float(z)))
    return render(
        rig.cameras[c],
        load_handle(HANDLE),
        poses_of(which)[k],
        Bench(),
        np.random.default_rng([k, c]),
        arm,
    )


TABLES = [
    Table(
        "elevation",
        cell,
        [{"elevation_deg": ELEVATIONS_DEG}],
        by=("elevation_deg", "estimator"),
        again={"elevation_deg": 50.0},
    )
]
