"""The four factors that Sect. 6.5 names, each swept on Table 1's poses: rendered, measured,
compared. ``data/tables/factors.py`` makes the tables.

Everything but the one factor is that of the standard scene. A cell is drawn from its own generator, so
that it can be computed alone, and every method measures the same frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import exposed
from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.datasets import load_table1
from trinolab.handle import Handle
from trinolab.measurement import Measurement
from trinolab.parameters import Parameters

from .replication import measure_frames, replication_errors

MEAN_DISTANCE_MM = 570.0  # of Table 1's positions from the middle of CCD1 and CCD2

DISTANCES_MM = (430.0, 500.0, MEAN_DISTANCE_MM, 650.0, 750.0, 900.0, 1100.0)

MARGIN_PX = 10.0  # the handle's markers stay that far inside the images

ERRORS = (
    "E_t_mm",
    "E_alpha_deg",
    "E_beta_deg",
    "E_gamma_deg",
    "geodesic_mean_deg",
    "position_median_mm",
    "geodesic_median_deg",
)


class Setup(NamedTuple):
    """What is rendered, and what the measurement takes for granted.

    Attributes
    ----------
    true_rig, rig : Rig
        The cameras that take the frames, and those of the measurement.
    handle : Handle
    poses : RigidTransform of length n
        T_world_handle at mid-exposure.
    velocity, turn_rate : ndarray, shape (n, 3)
        Of the handle's origin, mm/s, and about it, rad/s, world frame.
    bench : Bench
    """

    true_rig: Rig
    rig: Rig
    handle: Handle
    poses: RigidTransform
    velocity: Array
    turn_rate: Array
    bench: Bench = Bench()


class Factor(NamedTuple):
    """One factor of Sect. 6.5.

    Attributes
    ----------
    column : str
        Name and unit of the parameter.
    values : tuple of float
    paper : float
        The paper's working point, or what we assume for it.
    change : callable
        Takes a setup and a value, and gives the changed setup.
    """

    column: str
    values: tuple[float, ...]
    paper: float
    change: Callable[[Setup, float], Setup]


def table1_setup(rig: Rig, handle: Handle) -> Setup:
    """Table 1's set poses at rest before a known rig."""
    poses = load_table1().set_poses
    return Setup(rig, rig, handle, poses, np.zeros((len(poses), 3)), np.zeros((len(poses), 3)))


def with_distortion(setup: Setup, k1: float) -> Setup:
    """Lenses with a radial distortion k1 of which the measurement knows nothing."""
    cameras = [replace(camera, distortions=k1 * np.eye(5)[0]) for camera in setup.true_rig.cameras]
    return setup._replace(true_rig=replace(setup.true_rig, cameras=tuple(cameras)))


def at_distance(setup: Setup, distance_mm: float) -> Setup:
    """Each pose moved along its line of sight from the middle of the cameras; 570 mm leaves
    Table 1's where they are.

    Orientations stay, and the ratio of any two distances. Poses with a marker outside an image at
    one of `DISTANCES_MM` are left out at all of them.
    """
    moved = _scaled(setup, distance_mm)
    seen = in_view_everywhere(setup) & _in_view(setup.true_rig, setup.handle, moved)
    return setup._replace(
        poses=moved[seen], velocity=setup.velocity[seen], turn_rate=setup.turn_rate[seen]
    )


def in_view_everywhere(setup: Setup) -> np.ndarray:
    """Which poses have all markers inside the images at every one of `DISTANCES_MM`, bool (n,)."""
    moved = [_scaled(setup, distance) for distance in DISTANCES_MM]
    return np.all([_in_view(setup.true_rig, setup.handle, poses) for poses in moved], axis=0)


def with_markers(setup: Setup, diameter_mm: float) -> Setup:
    """The handle with markers of another size."""
    return setup._replace(handle=replace(setup.handle, marker_diameter_mm=diameter_mm))


def at_speed(setup: Setup, speed_mm_s: float) -> Setup:
    """The handle moves, in a direction of its own in each pose."""
    return setup._replace(velocity=speed_mm_s * _directions(len(setup.poses), 1))


def at_turn_rate(setup: Setup, turn_deg_s: float) -> Setup:
    """The handle turns about its origin, about an axis of its own in each pose."""
    return setup._replace(turn_rate=np.deg2rad(turn_deg_s) * _directions(len(setup.poses), 2))


FACTORS = {
    "distortion": Factor("k1", (-0.2, -0.1, -0.05, -0.02, 0.0, 0.05, 0.1), 0.0, with_distortion),
    "distance": Factor("distance_mm", DISTANCES_MM, MEAN_DISTANCE_MM, at_distance),
    "marker_size": Factor(
        "marker_diameter_mm", (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0), 3.0, with_markers
    ),
    "speed": Factor("speed_mm_s", (0.0, 25.0, 50.0, 100.0, 200.0, 400.0, 800.0), 0.0, at_speed),
    "turn": Factor("turn_deg_s", (0.0, 50.0, 100.0, 200.0, 400.0, 800.0), 0.0, at_turn_rate),
}


def measured(
    setup: Setup, methods: Mapping[str, Parameters], rng: np.random.Generator
) -> dict[str, list[Measurement]]:
    """What each method measures in the same frames, a measurement a pose; `rng` draws the noise."""
    taken = (frames(setup, k, rng) for k in range(len(setup.poses)))
    return measure_frames(taken, setup.rig, setup.handle, methods)


def frames(setup: Setup, k: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The frames of pose `k`; those of `scene.render_rig` if it is at rest."""
    lights = [
        exposed(
            camera, setup.handle, setup.poses[k], setup.bench, setup.velocity[k], setup.turn_rate[k]
        )
        for camera in setup.true_rig.cameras
    ]
    return [digitise(blurred(light, setup.bench), setup.bench, rng) for light in lights]


def errors_of(measurements: list[Measurement], setup: Setup) -> dict[str, float | int]:
    """Counts and errors of a cell; NaN if nothing was measured."""
    n = sum(m.pose.T_world_handle is not None for m in measurements)
    errors = replication_errors(measurements, setup.poses, setup.handle) if n else None
    return {
        "poses": len(setup.poses),
        "n": n,
        **{field: getattr(errors, field, np.nan) for field in ERRORS},
    }


def _scaled(setup: Setup, distance_mm: float) -> RigidTransform:
    """The poses moved along their lines of sight from the middle of the cameras, to a mean
    distance.
    """
    middle = np.mean([camera.centre for camera in setup.rig.cameras], axis=0)
    sight = setup.poses.translation - middle
    moved = middle + distance_mm / MEAN_DISTANCE_MM * sight
    return RigidTransform.from_components(moved, setup.poses.rotation)


def _in_view(rig: Rig, handle: Handle, poses: RigidTransform) -> np.ndarray:
    """Whether all markers lie inside all images, hidden ones too, bool (n,)."""
    return np.array(
        [
            all(
                camera.sees(T.apply(handle.marker_centres), MARGIN_PX).all()
                for camera in rig.cameras
            )
            for T in poses
        ]
    )


def _directions(n: int, seed: int) -> Array:
    vectors = np.random.default_rng(seed).standard_normal((n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
