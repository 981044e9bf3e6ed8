"""Render, measure, compare: the experiment of most studies, and with Table 1's poses the
replication (Sect. 6).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.checks import as_number
from trinolab.datasets import load_table1
from trinolab.handle import Handle
from trinolab.measurement import Measurement, measure
from trinolab.methods import ESTIMATORS
from trinolab.metrics import (
    PoseErrors,
    geodesic_deg,
    nearest_equivalent,
    nees,
    pose_errors,
    position_errors,
)
from trinolab.parameters import Parameters
from trinolab.pose import Pose

PAPER: Mapping[str, Parameters] = {"paper": Parameters()}  # the paper's estimator alone
CHECKED = "paper, checked"
# the estimators, and the paper's with its check
EVERY: Mapping[str, Parameters] = {
    "paper": Parameters(estimator="paper"),
    CHECKED: Parameters(estimator="paper", check=True),
    **{name: Parameters(estimator=name) for name in ESTIMATORS[1:]},
}
WRONG_MM, WRONG_DEG = 2.0, 5.0  # a pose called measured that is further off is a false one


class Deviation(NamedTuple):
    """How far a measured pose is off, and how far by its own word; a lost or ambiguous one has NaN.

    Attributes
    ----------
    mm, deg : float
        Distance of the origins, geodesic angle, up to the handle's symmetry.
    sigma_mm, sigma_deg : float
        As `Pose` reports them.
    nees : float
        Joint, see `metrics.nees`.
    """

    mm: float
    deg: float
    sigma_mm: float
    sigma_deg: float
    nees: float

    @property
    def measured(self) -> bool:
        return not np.isnan(self.mm)

    @property
    def wrong(self) -> bool:
        """Whether the pose is called measured and is a false one."""
        return self.mm > WRONG_MM or self.deg > WRONG_DEG


def shared_poses(rig: Rig, handle: Handle, rng: np.random.Generator) -> Iterator[RigidTransform]:
    """Random poses of the standard scene, without end, at which some two cameras truly see the same
    four markers.
    """
    while True:
        T = random_pose(rng)
        visible = [true_visibility(camera, handle, T) for camera in rig.cameras]
        if any((visible[i] & visible[j]).sum() >= 4 for i, j in rig.pairs):
            yield T


def measure_frames(
    frames: Iterable[Sequence[np.ndarray]],
    rig: Rig,
    handle: Handle,
    methods: Mapping[str, Parameters] = PAPER,
    priors: Sequence[RigidTransform] | None = None,
) -> dict[str, list[Measurement]]:
    """Measure each instant on its own by several methods.

    Parameters
    ----------
    frames : iterable of sequence of ndarray
        The images of each instant. They may be rendered as they are asked for: measuring draws no
        random numbers.
    rig : Rig
    handle : Handle
    methods : mapping
        From a name to the parameters of the measurement; the paper's alone without it.
    priors : sequence of RigidTransform, optional
        T_world_handle that is expected at each instant.

    Returns
    -------
    dict
        For each method a measurement an instant.
    """
    measurements: dict[str, list[Measurement]] = {name: [] for name in methods}
    for k, images in enumerate(frames):
        prior = None if priors is None else priors[k]
        for name, parameters in methods.items():
            measurements[name].append(
                measure(images, rig, handle, prior, parameters.with_default("paper"))
            )
    return measurements


def measure_instant(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    methods: Mapping[str, Parameters],
    truth: RigidTransform,
) -> dict[str, Pose]:
    """The pose of one instant by each method. Where the handle has look-alikes its true pose chooses
    among them, and nothing else.
    """
    priors = [truth] if len(handle.symmetries) > 1 else None
    found = measure_frames([images], rig, handle, methods, priors)
    return {name: measurement.pose for name, (measurement,) in found.items()}


def replicate(
    poses: Iterable[RigidTransform],
    rig: Rig,
    handle: Handle,
    seed: int = 0,
    bench: Bench | None = None,
    parameters: Parameters | None = None,
    with_prior: bool = False,
) -> list[Measurement]:
    """Render each pose with the simulated bench and measure it.

    Parameters
    ----------
    poses : iterable of RigidTransform
        T_world_handle of each instant.
    rig : Rig
    handle : Handle
    seed : int
        Of the noise.
    bench : Bench, optional
    parameters : Parameters, optional
    with_prior : bool
        Whether the true pose is given as the one that is expected, which tells poses that look
        alike apart.
    """
    rng = np.random.default_rng(int(as_number(seed, "seed", low=0)))
    truths = list(poses)
    bench = bench or Bench()
    frames = (render_rig(rig, handle, T, bench, rng) for T in truths)
    method = {"the one": parameters or Parameters()}
    return measure_frames(frames, rig, handle, method, truths if with_prior else None)["the one"]


def replicate_table1(
    rig: Rig,
    handle: Handle,
    seed: int = 0,
    rows: slice = slice(None),
    bench: Bench | None = None,
    parameters: Parameters | None = None,
) -> PoseErrors:
    """The errors of the whole chain on rendered frames of Table 1's poses, up to the handle's
    symmetry (Eq. 26-27).

    Parameters
    ----------
    rows : slice
        Of Table 1; all twenty by default. The other parameters are those of `replicate`.

    Raises
    ------
    ValueError
        If not one of the poses was measured.
    """
    truths = load_table1().set_poses[rows]
    measurements = replicate(truths, rig, handle, seed, bench, parameters)
    return replication_errors(measurements, truths, handle)


def replication_errors(
    measurements: Sequence[Measurement], truths: RigidTransform, handle: Handle
) -> PoseErrors:
    """Errors of measurements against their truths, each by its nearest equivalent; lost ones are
    left out of `n`.

    Raises ValueError if all of them are lost.
    """
    return pose_errors(
        *estimates_and_truths([m.pose.T_world_handle for m in measurements], truths, handle)
    )


def estimates_and_truths(
    estimates: Sequence[RigidTransform | None],
    truths: Sequence[RigidTransform] | RigidTransform,
    handle: Handle,
) -> tuple[RigidTransform, RigidTransform]:
    """The estimates that there are, each as its equivalent nearest to the truth, and their truths.

    Raises ValueError if there are none.
    """
    pairs = [
        (estimate, truth)
        for estimate, truth in zip(estimates, truths, strict=True)
        if estimate is not None
    ]
    if not pairs:
        raise ValueError(f"measurements: all {len(truths)} are lost")
    estimated, true = (RigidTransform.concatenate(side) for side in zip(*pairs, strict=True))
    return nearest_equivalent(estimated, true, handle.symmetries), true


def deviation(pose: Pose, truth: RigidTransform, handle: Handle) -> Deviation:
    """Hold a pose against its truth."""
    if pose.status != "measured" or pose.T_world_handle is None:
        return Deviation(np.nan, np.nan, np.nan, np.nan, np.nan)
    estimate = nearest_equivalent(pose.T_world_handle, truth, handle.symmetries)
    return Deviation(
        float(position_errors(estimate, truth)[0]),
        float(geodesic_deg(estimate, truth)[0]),
        pose.sigma_mm,
        pose.sigma_deg,
        float(nees(estimate[0], pose.covariance, truth)[0]),
    )
