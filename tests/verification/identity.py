"""Random poses of the standard scene without a prior: is every used marker the right one, how far
off is the pose.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle
from trinolab.measurement import Measurement
from trinolab.metrics import geodesic_deg, pose_errors
from workbench.studies.bound import RIGS
from workbench.studies.claim_trials import true_labels
from workbench.studies.replication import EVERY, estimates_and_truths, measure_frames


def report(arguments) -> None:
    print(
        f"{arguments.poses} random poses, four markers truly seen by each of two cameras, no prior. Right: a pose,"
    )
    print(
        "and every used marker identified, up to the handle's symmetry; wrong: reported as measured with another one"
    )
    print(
        f"{'rig':17s} {'handle':7s} {'estimator':12s}  right %  wrong   E_t mm  geodesic deg  worst mm, deg   "
        "rms error / sigma  status"
    )
    for rig in RIGS:
        for handle in ("coded", "paper"):
            _report(rig, handle, arguments.poses)


def _report(rig_name: str, handle_name: str, poses: int) -> None:
    rig, handle, rng = load_rig(rig_name), load_handle(handle_name), np.random.default_rng(7)
    truths: list[RigidTransform] = []

    def rendered() -> Iterator[list[np.ndarray]]:
        for _ in tqdm(range(poses), leave=False, unit="instant"):
            truths.append(seen_pose(rig, handle, rng))
            yield render_rig(rig, handle, truths[-1], Bench(), rng)

    found = measure_frames(rendered(), rig, handle, EVERY)
    for name, measurements in found.items():
        _line(f"{rig_name:17s} {handle_name:7s} {name:12s}", measurements, truths, rig, handle)


def _line(
    label: str, found: list[Measurement], truths: list[RigidTransform], rig: Rig, handle: Handle
) -> None:
    right = np.array(
        [rightly_labelled(m, T, rig, handle) for m, T in zip(found, truths, strict=True)]
    )
    wrong = sum(m.pose.status == "measured" and not ok for m, ok in zip(found, right, strict=True))
    estimate, truth = estimates_and_truths([m.pose.T_world_handle for m in found], truths, handle)
    e = pose_errors(estimate, truth)
    sigma = np.array([m.pose.sigma_mm for m in found if m.pose.T_world_handle is not None])
    ratio = np.sqrt(
        np.mean((np.linalg.norm(estimate.translation - truth.translation, axis=1) / sigma) ** 2)
    )
    print(
        f"{label} {100 * right.mean():8.2f} {wrong:6d} {e.E_t_mm:8.4f} {e.geodesic_mean_deg:10.3f} "
        f"{e.position_max_mm:12.2f} {e.geodesic_max_deg:6.2f} {ratio:12.2f}         "
        f"{dict(Counter(m.pose.status for m in found))}",
        flush=True,
    )


def rightly_labelled(
    measurement: Measurement, truth: RigidTransform, rig: Rig, handle: Handle
) -> bool:
    """Whether there is a pose, and every labelled marker is the one that is there by the equivalent
    truth.
    """
    T = measurement.pose.T_world_handle
    if T is None:
        return False
    turns = [geodesic_deg(truth * S, T)[0] for S in handle.symmetries]
    near = truth * handle.symmetries[int(np.argmin(turns))]
    for camera, found, labels in zip(
        rig.cameras, measurement.found, measurement.labels, strict=True
    ):
        used = labels >= 0
        if (true_labels(camera, handle, near, found.uv)[used] != labels[used]).any():
            return False
    return True


def seen_pose(rig: Rig, handle: Handle, rng: np.random.Generator) -> RigidTransform:
    """A random pose at which each of two cameras truly sees four markers."""
    while True:
        pose = random_pose(rng)
        if sorted(true_visibility(camera, handle, pose).sum() for camera in rig.cameras)[-2] >= 4:
            return pose
