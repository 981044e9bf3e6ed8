"""The paper's claims against what is computed here: one row a claim of ``data/claims.toml``."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from . import evidence, slave_trial, trials
from .boardtrial import calibration_cost_mm
from .datasets import Claim, load_claims, load_handle, load_rig, load_table1
from .errata import printed_rotation_error, printed_workspace_volume
from .fetch import why_not
from .metrics import PoseErrors, pose_errors
from .parameters import BEST, Parameters
from .workflows import replicate, replication_errors

COLUMNS = ("no", "claim", "paper", "ours", "unit", "verdict", "reason")
NOT_RUN = "not run"
RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")


def scoreboard(progress: bool = False) -> pd.DataFrame:
    """Compute every claim that can be computed, and its verdict by the criterion of the ledger.

    Parameters
    ----------
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`, one row a claim; `ours` is NaN where nothing is computed. The verdict is then the declared
        one ("cannot be tested", "not tested yet"), or "not run" where it takes a recording that is not here.
    """
    with tqdm(load_claims(), unit="claim", disable=None if progress else True) as claims:
        rows = [score(claim) for claim in claims]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def score(claim: Claim) -> tuple:
    """One row of the scoreboard."""
    if claim.check is None:
        return claim.no, claim.claim, claim.paper, np.nan, claim.unit, claim.verdict, claim.reason
    value = CHECKS[claim.check]()
    if value is None:
        return claim.no, claim.claim, claim.paper, np.nan, claim.unit, NOT_RUN, f"{NOT_RUN}: {why_not()}"
    verdict = claim.computed_verdict(value)
    reason = claim.reason if verdict == claim.verdict else f"The ledger declares '{claim.verdict}'."
    return claim.no, claim.claim, claim.paper, value, claim.unit, verdict, reason


def disagreements(board: pd.DataFrame) -> list[str]:
    """The numbers of the claims whose computed verdict is not the declared one; what was not run says nothing."""
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return [no for no, verdict in zip(board["no"], board["verdict"], strict=True)
            if verdict not in (declared[no], NOT_RUN)]


@cache
def _table1() -> PoseErrors:
    table = load_table1()
    return pose_errors(table.measured, table.set_poses)


@cache
def _replication(draws: int = 5) -> PoseErrors:
    """Errors over Table 1's poses, each under several draws of the noise: one draw's alpha varies by a third."""
    handle = load_handle("paper")
    truths = RigidTransform.concatenate([load_table1().set_poses] * draws)
    errors = replication_errors(replicate(truths, load_rig("paper_pair"), handle), truths, handle)
    if errors.n < len(truths):
        raise RuntimeError(f"the replication measured {errors.n} of {len(truths)} poses: its means would flatter")
    return errors


@cache
def _best(rig: str) -> PoseErrors:
    """Errors of the best estimator over Table 1's poses, one draw of the noise."""
    handle, truths = load_handle("paper"), load_table1().set_poses
    errors = replication_errors(replicate(truths, load_rig(rig), handle, parameters=Parameters(estimator=BEST)), truths,
                                handle)
    if errors.n < len(truths):
        raise RuntimeError(f"the best estimator measured {errors.n} of {len(truths)} poses: its means would flatter")
    return errors


def _field(errors: Callable[[], PoseErrors], name: str) -> Callable[[], float]:
    return lambda: float(getattr(errors(), name))


CHECKS: dict[str, Callable[[], float | None]] = {  # None: not run
    "table1_position": _field(_table1, "E_t_mm"),
    "table1_alpha": _field(_table1, "E_alpha_deg"),
    "table1_beta": _field(_table1, "E_beta_deg"),
    "table1_gamma": _field(_table1, "E_gamma_deg"),
    "replication_position": _field(_replication, "E_t_mm"),
    "replication_alpha": _field(_replication, "E_alpha_deg"),
    "replication_beta": _field(_replication, "E_beta_deg"),
    "replication_gamma": _field(_replication, "E_gamma_deg"),
    "replication_geodesic": _field(_replication, "geodesic_mean_deg"),
    **{f"best_position_{rig}": _field(partial(_best, rig), "E_t_mm") for rig in RIGS},
    **{f"best_geodesic_{rig}": _field(partial(_best, rig), "geodesic_mean_deg") for rig in RIGS},
    "printed_rotation": lambda: printed_rotation_error()[0],
    "printed_workspace": lambda: printed_workspace_volume(np.deg2rad(20.0)),
    "share_measured": trials.share_measured,
    "share_tracked": trials.share_tracked,
    "share_kept_under_light": trials.share_kept_under_light,
    "share_of_wrong_matches": trials.share_of_wrong_matches,
    "share_searched": trials.share_searched,
    "share_saved_by_the_third": trials.share_saved_by_the_third,
    "centroid_error_px": trials.centroid_error_px,
    "calibration_cost": calibration_cost_mm,
    "real_photographs": evidence.baseline_difference_mm,
    "real_leds": evidence.led_median_px,
    "real_board": evidence.board_fit_mm,
    "real_particles": evidence.particle_median_px,
    "slave_at_rest": slave_trial.slave_at_rest,
}
