"""Table 1's poses under many noise seeds: every estimator's errors on every rig, up to the handle's
symmetry, beside the Cramer-Rao bound, and whether its covariances hold.

The normalised estimation error squared e^T C^-1 e of a covariance that holds is chi-square with six
degrees of freedom (Bar-Shalom, Li and Kirubarajan 2001, sect. 5.4.2), so that the mean of n draws
lies in chi2(6 n) / n.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2
from tqdm import tqdm

from trinolab import metrics
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle
from trinolab.pose import Pose
from workbench.studies.bound import RIGS, Bound, table1_bounds
from workbench.studies.replication import EVERY, estimates_and_truths, measure_frames

PAPER = load_handle("paper")
POSES = load_table1().set_poses


def expected_frames(rig: Rig, handle: Handle, T: RigidTransform, bench: Bench) -> list[np.ndarray]:
    """What the cameras would see without noise, a float image a camera."""
    return [blurred(radiance(camera, handle, T, bench), bench) for camera in rig.cameras]


def frames(rig: Rig, seeds: int) -> Iterator[list[np.ndarray]]:
    """The frames of each pose under each noise; for a seed those of `replication.replicate_table1`."""
    rngs, bench = [np.random.default_rng(seed) for seed in range(seeds)], Bench()
    for T in tqdm(POSES, leave=False, unit="pose"):
        expected = expected_frames(rig, PAPER, T, bench)
        for rng in rngs:
            yield [digitise(image, bench, rng) for image in expected]


def report(arguments) -> None:
    seeds = arguments.seeds
    print(
        f"Table 1's poses, {seeds} noise seeds each, handle `paper`, no prior. Errors: means, mm and deg, and rms\n"
        "by the rms of the bound from the markers' pixels, greys known. NEES: mean, and its 95 % band if the\n"
        "covariances hold; those of the position and the rotation alone (3)"
    )
    truths = [T for T in POSES for _ in range(seeds)]
    rows = []
    for name in RIGS:
        rig = load_rig(name)
        bounds = [bound for bound in table1_bounds(name) for _ in range(seeds)]
        for estimator, found in measure_frames(frames(rig, seeds), rig, PAPER, EVERY).items():
            poses = [measurement.pose for measurement in found]
            rows.append({"rig": name, "estimator": estimator, **judged(poses, truths, bounds)})
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3f}".format), flush=True)


def judged(
    poses: Sequence[Pose], truths: Sequence[RigidTransform], bounds: Sequence[Bound]
) -> dict[str, float | str]:
    """The errors of poses, beside their bounds, and their NEES; for poses whose errors are drawn from
    the bound, ratios of 1 and 6, 3 and 3.
    """
    T, true = estimates_and_truths([pose.T_world_handle for pose in poses], truths, PAPER)
    kept = [k for k, pose in enumerate(poses) if pose.T_world_handle is not None]
    errors = metrics.pose_errors(T, true)
    least = np.array([(bounds[k].rms_mm, bounds[k].rms_deg) for k in kept])
    rms = [metrics.position_errors(T, true), metrics.geodesic_deg(T, true)]
    by_bound = np.sqrt(np.square(rms).mean(axis=1) / np.square(least).mean(axis=0))
    covariances = [poses[k].covariance for k in kept]
    nees = np.mean([metrics.nees(*one) for one in zip(T, covariances, true, strict=True)], axis=0)
    low, high = chi2(6 * len(kept)).ppf([0.025, 0.975]) / len(kept)
    return {
        "lost": len(poses) - len(kept),
        "E_t": errors.E_t_mm,
        "alpha": errors.E_alpha_deg,
        "beta": errors.E_beta_deg,
        "gamma": errors.E_gamma_deg,
        "angle": errors.geodesic_mean_deg,
        "E_t by bound": by_bound[0],
        "angle by bound": by_bound[1],
        "NEES": nees[0],
        "band": f"{low:.2f} to {high:.2f}",
        "position": nees[1],
        "rotation": nees[2],
    }
