"""The paper's claims against what is computed here: one row a claim of ``data/claims.toml``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pandas as pd
from tqdm import tqdm

from .datasets import Claim, load_calibration, load_claims, load_handle, load_rig, load_table1, nearest_rotation
from .errata import printed_cones
from .metrics import PoseErrors, pose_errors
from .workflows import replicate_table1
from .workspace import intersect

COLUMNS = ("no", "claim", "paper", "ours", "unit", "verdict", "reason")


def scoreboard(progress: bool = False) -> pd.DataFrame:
    """Compute every claim that can be computed, and its verdict by the criterion of the ledger.

    Parameters
    ----------
    progress : bool
        Show a progress bar on standard error.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`, one row a claim; `ours` is NaN where nothing is computed, and the verdict is then the
        declared one ("cannot be tested", "not tested yet").
    """
    rows = [score(claim) for claim in tqdm(load_claims(), unit="claim", disable=not progress)]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def score(claim: Claim) -> tuple:
    """One row of the scoreboard."""
    if claim.check is None:
        return claim.no, claim.claim, claim.paper, np.nan, claim.unit, claim.verdict, claim.reason
    value = CHECKS[claim.check]()
    verdict = claim.computed_verdict(value)
    reason = claim.reason if verdict == claim.verdict else f"The ledger declares '{claim.verdict}'."
    return claim.no, claim.claim, claim.paper, value, claim.unit, verdict, reason


def disagreements(board: pd.DataFrame) -> list[str]:
    """The numbers of the claims whose computed verdict is not the declared one."""
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return [no for no, verdict in zip(board["no"], board["verdict"], strict=True) if declared[no] != verdict]


@cache
def _table1() -> PoseErrors:
    table = load_table1()
    return pose_errors(table.measured, table.set_poses)


@cache
def _replication() -> PoseErrors:
    errors = replicate_table1(load_rig("paper_pair"), load_handle("paper"))
    if errors.n < 20:
        raise RuntimeError(f"the replication measured {errors.n} of Table 1's 20 poses: its means would flatter")
    return errors


def _printed_rotation() -> float:
    """Frobenius distance of the printed R_rl from the nearest rotation."""
    R_rl = load_calibration().R_rl
    return float(np.linalg.norm(R_rl - nearest_rotation(R_rl).as_matrix()))


def _printed_workspace() -> float:
    """Largest volume of the printed Eq. 4 at 45 deg and a half angle of 20 deg, over the nappes of the cones; B^3."""
    cones = printed_cones(1.0, np.pi / 4, np.pi / 4, np.deg2rad(20.0))
    nappes = ([replace(cone, axis=sign * cone.axis) for cone, sign in zip(cones, signs, strict=True)]
              for signs in product((1, -1), repeat=3))
    return max(float(intersect(some).volume) for some in nappes)


def _field(errors: Callable[[], PoseErrors], name: str) -> Callable[[], float]:
    return lambda: float(getattr(errors(), name))


CHECKS: dict[str, Callable[[], float]] = {
    "table1_position": _field(_table1, "E_t_mm"),
    "table1_alpha": _field(_table1, "E_alpha_deg"),
    "table1_beta": _field(_table1, "E_beta_deg"),
    "table1_gamma": _field(_table1, "E_gamma_deg"),
    "replication_position": _field(_replication, "E_t_mm"),
    "replication_alpha": _field(_replication, "E_alpha_deg"),
    "replication_beta": _field(_replication, "E_beta_deg"),
    "replication_gamma": _field(_replication, "E_gamma_deg"),
    "replication_geodesic": _field(_replication, "geodesic_mean_deg"),
    "printed_rotation": _printed_rotation,
    "printed_workspace": _printed_workspace,
}
