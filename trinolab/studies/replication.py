"""Table 1 replicated: the poses rendered, measured by a method, and compared with the truth (Sect. 6)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from ..bench.optics import Bench
from ..bench.scene import render_rig
from ..camera import Rig
from ..checks import as_number
from ..datasets import load_table1
from ..handle import Handle
from ..measurement import Measurement, measure
from ..metrics import PoseErrors, nearest_equivalent, pose_errors
from ..parameters import Parameters


def replicate(poses: Iterable[RigidTransform], rig: Rig, handle: Handle, seed: int = 0, bench: Bench | None = None,
              parameters: Parameters | None = None, progress: bool = False) -> list[Measurement]:
    """Render each pose with the simulated bench and measure it, without a prior.

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
    progress : bool
        Show a progress bar on standard error.
    """
    rng = np.random.default_rng(int(as_number(seed, "seed", low=0)))
    bench = bench or Bench()
    return [measure(render_rig(rig, handle, T, bench, rng), rig, handle, parameters=parameters)
            for T in tqdm(list(poses), unit="instant", disable=not progress)]


def replicate_table1(rig: Rig, handle: Handle, seed: int = 0, rows: slice = slice(None), bench: Bench | None = None,
                     parameters: Parameters | None = None) -> PoseErrors:
    """The errors of the whole chain on rendered frames of Table 1's poses, up to the handle's symmetry (Eq. 26-27).

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


def replication_errors(measurements: list[Measurement], truths: RigidTransform, handle: Handle) -> PoseErrors:
    """Errors of measurements against their truths, each by its nearest equivalent; lost ones are left out of `n`."""
    held = [k for k, m in enumerate(measurements) if m.pose.T_world_handle is not None]
    if not held:
        raise ValueError(f"measurements: all {len(measurements)} are lost")
    estimates = RigidTransform.concatenate([measurements[k].pose.T_world_handle for k in held])
    return pose_errors(nearest_equivalent(estimates, truths[held], handle.symmetries), truths[held])
