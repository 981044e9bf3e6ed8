"""The heavy counts, as a report: the chain on random poses, and Table 1's poses under several seeds.

    python tests/verify.py [--poses 200] [--seeds 5]
"""

import argparse
from collections import Counter

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.datasets import load_handle, load_rig
from trinolab.metrics import nearest_equivalent, pose_errors
from trinolab.scene import Bench, random_pose, render_rig, true_visibility
from trinolab.tracker import measure
from trinolab.workflows import replicate_table1

RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")


def table1(seeds: int) -> None:
    print("Table 1's poses, paper's method, handle `paper`, a line a seed")
    print(f"{'rig':18s} seed   n  E_t mm  alpha   beta  gamma  geodesic deg")
    for rig in RIGS:
        for seed in range(seeds):
            e = replicate_table1(load_rig(rig), load_handle("paper"), seed=seed)
            print(f"{rig:18s} {seed:4d} {e.n:3d} {e.E_t_mm:7.3f} {e.E_alpha_deg:6.2f} {e.E_beta_deg:6.2f} "
                  f"{e.E_gamma_deg:6.2f} {e.geodesic_mean_deg:7.2f}", flush=True)


def random_poses(poses: int) -> None:
    print(f"\n{poses} random poses of the standard scene, four markers truly seen by each of two cameras, no prior")
    print(f"{'rig':18s} {'handle':8s} E_t mm  geodesic deg  worst mm, deg   rms error / sigma  status")
    for rig in RIGS:
        for handle in ("coded", "paper"):
            _random_poses(rig, handle, poses)


def _random_poses(rig_name: str, handle_name: str, poses: int) -> None:
    rig, handle, rng = load_rig(rig_name), load_handle(handle_name), np.random.default_rng(7)
    found, truths = [], []
    for _ in tqdm(range(poses), leave=False):
        truths.append(_seen_pose(rig, handle, rng))
        found.append(measure(render_rig(rig, handle, truths[-1], Bench(), rng), rig, handle).pose)
    held = [k for k, pose in enumerate(found) if pose.T_world_handle is not None]
    truth = RigidTransform.concatenate([truths[k] for k in held])
    estimate = RigidTransform.concatenate([found[k].T_world_handle for k in held])
    e = pose_errors(nearest_equivalent(estimate, truth, handle.symmetries), truth)
    sigma = np.array([found[k].sigma_mm for k in held])
    ratio = np.sqrt(np.mean((np.linalg.norm(estimate.translation - truth.translation, axis=1) / sigma) ** 2))
    print(f"{rig_name:18s} {handle_name:8s} {e.E_t_mm:6.3f} {e.geodesic_mean_deg:8.2f} {e.position_max_mm:12.2f} "
          f"{e.geodesic_max_deg:6.2f} {ratio:12.2f}        {dict(Counter(pose.status for pose in found))}", flush=True)


def _seen_pose(rig, handle, rng) -> RigidTransform:
    while True:
        pose = random_pose(rng)
        if sorted(true_visibility(camera, handle, pose).sum() for camera in rig.cameras)[-2] >= 4:
            return pose


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=200, help="random poses for each rig and handle (%(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="noise seeds for each rig (%(default)s)")
    arguments = parser.parse_args()
    table1(arguments.seeds)
    random_poses(arguments.poses)
