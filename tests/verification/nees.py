"""Are the covariances honest: the mean NEES of many draws against its 95 % band, overall and pose
by pose.

The normalised estimation error squared e^T C^-1 e of an honest covariance is chi-square with six
degrees of freedom (Bar-Shalom, Li and Kirubarajan 2001, sect. 5.4.2), so that the mean of n draws
lies in chi2(6 n) / n.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from trinolab import metrics
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle
from trinolab.pose import Pose
from workbench.studies.bound import RIGS

from .draws import Draw, table1_draws


def band(n: int, dof: int = 6) -> tuple[float, float]:
    """The 95 % band of the mean NEES of n draws."""
    return tuple(chi2(dof * n).ppf([0.025, 0.975]) / n)


def nees(pose: Pose, truth: RigidTransform, handle: Handle) -> np.ndarray:
    """`metrics.nees` of a pose; the error is that from the truth's equivalent which is nearest to
    the pose.
    """
    return metrics.nees(
        pose.T_world_handle,
        pose.covariance,
        metrics.nearest_equivalent(truth, pose.T_world_handle, handle.symmetries)[0],
    )


def report(arguments) -> None:
    seeds = -(-arguments.draws // 20)
    print(
        f"NEES on Table 1's poses, {seeds} noise draws each, handle `paper`, the truth as prior; honest is 6"
    )
    print(
        "(3 for position or rotation alone). Then a pose after the other, with * outside its own 95 % band, where"
    )
    print("one in twenty lies by chance.")
    for rig in RIGS:
        for estimator, draws in table1_draws(
            load_rig(rig), load_handle("paper"), seeds, with_prior=True
        ).items():
            _lines(rig, estimator, draws)


def _lines(rig: str, estimator: str, draws: list[Draw]) -> None:
    kept = [draw for draw in draws if draw.pose.T_world_handle is not None]
    values = np.array([nees(draw.pose, draw.truth, load_handle("paper")) for draw in kept])
    low, high = band(len(kept))
    verdict = "inside" if low <= values[:, 0].mean() <= high else "outside"
    print(
        f"{rig:17s} {estimator:12s} n {len(kept)}, lost {len(draws) - len(kept)}: mean {values[:, 0].mean():.2f}, "
        f"{verdict} [{low:.2f}, {high:.2f}]; median {np.median(values[:, 0]):.2f} (5.35); position "
        f"{values[:, 1].mean():.2f}, rotation {values[:, 2].mean():.2f}; largest {values[:, 0].max():.0f}"
    )
    rows = np.array([draw.row for draw in kept])
    print("    " + " ".join(_mean(values[rows == row, 0]) for row in range(20)), flush=True)


def _mean(values: np.ndarray) -> str:
    if len(values) == 0:
        return "lost"
    low, high = band(len(values))
    return f"{values.mean():.1f}" + ("" if low <= values.mean() <= high else "*")
