"""Table 1's poses under many noise seeds: every estimator's errors on every rig, beside the
Cramer-Rao bound.
"""

import numpy as np

from trinolab.datasets import load_handle, load_rig
from trinolab.metrics import geodesic_deg, pose_errors, position_errors
from workbench.studies.bound import RIGS, Bound, table1_bounds

from .draws import Draw, held, table1_draws

PAPER = load_handle("paper")


def report(arguments) -> None:
    print(
        f"Table 1's poses, {arguments.seeds} noise seeds each, handle `paper`, no prior, up to the handle's symmetry"
    )
    print(
        "E_t and geodesic: mean over all (standard deviation of the seeds' means). Ratios: rms error by rms bound,"
    )
    print(
        "and mean error by the mean that a Gaussian of the bound's covariance has; position, rotation. The bound is"
    )
    print("that of the markers' pixels, greys known; the other bounds: --only bound.")
    print(
        f"{'rig':17s} {'estimator':12s} {'n':>4s} lost  {'E_t mm':15s} {'geodesic deg':13s} alpha  beta gamma  "
        f"{'rms mm, deg':>13s} {'mean':>12s}"
    )
    for rig in RIGS:
        draws = table1_draws(load_rig(rig), PAPER, arguments.seeds)
        for estimator, found in draws.items():
            _line(rig, estimator, found, table1_bounds(rig))


def ratios(
    draws: list[Draw], bounds: list[Bound]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """(rms, mean) of the position's error by the bound's, and of the rotation's; poses weigh as
    often as measured.
    """
    rows = [draw.row for draw in draws if draw.pose.T_world_handle is not None]
    estimates, truths = held(draws, PAPER)
    errors = position_errors(estimates, truths), geodesic_deg(estimates, truths)
    found = []
    for error, rms, mean in zip(
        errors, ("rms_mm", "rms_deg"), ("mean_mm", "mean_deg"), strict=True
    ):
        least_square = np.mean([getattr(bounds[row], rms) ** 2 for row in rows])
        least_mean = np.mean([getattr(bounds[row], mean) for row in rows])
        found.append(
            (float(np.sqrt(np.mean(error**2) / least_square)), float(error.mean() / least_mean))
        )
    return found[0], found[1]


def _line(rig: str, estimator: str, draws: list[Draw], bounds: list[Bound]) -> None:
    e = pose_errors(*held(draws, PAPER))
    seeds = {draw.seed for draw in draws}
    each = [
        pose_errors(*held([draw for draw in draws if draw.seed == seed], PAPER)) for seed in seeds
    ]
    sd_mm, sd_deg = (
        np.std([getattr(s, name) for s in each]) for name in ("E_t_mm", "geodesic_mean_deg")
    )
    (rms_mm, mean_mm), (rms_deg, mean_deg) = ratios(draws, bounds)
    print(
        f"{rig:17s} {estimator:12s} {e.n:4d} {len(draws) - e.n:4d}  {e.E_t_mm:.4f} ({sd_mm:.4f}) "
        f"{e.geodesic_mean_deg:7.3f} ({sd_deg:.3f}) {e.E_alpha_deg:5.2f} {e.E_beta_deg:5.2f} {e.E_gamma_deg:5.2f}  "
        f"{rms_mm:6.1f} {rms_deg:6.1f} {mean_mm:6.1f} {mean_deg:5.1f}",
        flush=True,
    )
