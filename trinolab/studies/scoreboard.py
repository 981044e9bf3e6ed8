"""The paper's claims against what is computed here: one row a claim of ``data/claims.toml``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from ..checks import as_number
from ..datasets import data_path, load_handle, load_rig, load_sweep, load_table1
from ..files.fetch import why_not
from ..files.inputs import get, read_toml
from ..methods import BEST
from ..metrics import PoseErrors, pose_errors
from ..paper.errata.pose import printed_rotation_error
from ..paper.errata.workspace import printed_workspace_volume
from ..parameters import Parameters
from . import claim_trials, master_slave, real_recordings, second_renderer
from .replication import replicate, replication_errors
from .simulated_calibration import calibration_cost_mm

COLUMNS = ("no", "claim", "paper", "ours", "unit", "verdict", "reason")
NOT_RUN = "not run"
WHENCE = "data/real.toml says which recordings it should have, and where they come from"
RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")


@dataclass(frozen=True)
class Claim:
    """One row of the ledger of claims; the fields are explained at the top of
    ``data/claims.toml``.
    """

    no: str
    claim: str
    section: str
    paper: float | str
    unit: str
    criterion: str
    verdict: str
    reason: str
    check: str | None = None
    match_within: float | None = None
    same_order_factor: float | None = None
    at_most: float | None = None
    at_least: float | None = None

    def computed_verdict(self, value: float) -> str:
        """What a computed value makes of the claim, by the criterion's numbers.

        Returns
        -------
        str
            "match", "same order" or "differs" where the paper says something; "met" or "missed"
            where it does not.
        """
        number = as_number(value, "value")
        if self.match_within is not None:
            return self._against_number(number)
        low = -np.inf if self.at_least is None else self.at_least
        high = np.inf if self.at_most is None else self.at_most
        yes, no = ("met", "missed") if self.paper == "" else ("match", "differs")
        return yes if low <= number <= high else no

    def _against_number(self, number: float) -> str:
        paper = as_number(self.paper, f"claim {self.no}: paper")
        if abs(number - paper) <= (self.match_within or 0.0):
            return "match"
        factor = self.same_order_factor
        same_order = (
            factor is not None and number > 0 and paper / factor <= number <= paper * factor
        )
        return "same order" if same_order else "differs"


def load_claims() -> tuple[Claim, ...]:
    """Load the ledger of the paper's claims, in its order.

    Raises
    ------
    ValueError
        Names the row and the field that is missing or unknown.
    """
    path = data_path("claims.toml")
    return tuple(
        _claim_from(row, f"{path}: claim {row.get('no', k)}")
        for k, row in enumerate(get(read_toml(path), "claim", str(path)), start=1)
    )


def _claim_from(row: dict[str, Any], where: str) -> Claim:
    fields = Claim.__dataclass_fields__
    unknown = sorted(set(row) - set(fields))
    if unknown:
        raise ValueError(f"{where}: '{unknown[0]}' is not a field of a claim ({', '.join(fields)})")
    for name in ("no", "claim", "section", "paper", "unit", "criterion", "verdict", "reason"):
        get(row, name, where)
    return Claim(**row)


def scoreboard(progress: bool = False) -> pd.DataFrame:
    """Compute every claim that can be computed, and its verdict by the criterion of the ledger.

    Parameters
    ----------
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`, one row a claim; `ours` is NaN where nothing is computed. The verdict is
        then the declared one ("cannot be tested", "not tested yet"), or "not run" where it takes a
        recording that is not here.

    Raises
    ------
    ValueError
        Before anything is computed: a claim names a check that is not in `CHECKS`.
    """
    ledger = load_claims()
    for claim in ledger:
        if claim.check is not None and claim.check not in CHECKS:
            raise ValueError(
                f"claims.toml: claim {claim.no}: check: expected one of {', '.join(CHECKS)} "
                f"(CHECKS in trinolab/studies/scoreboard.py), got {claim.check!r}"
            )
    with tqdm(ledger, unit="claim", disable=None if progress else True) as claims:
        rows = [score(claim) for claim in claims]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def score(claim: Claim) -> tuple:
    """One row of the scoreboard."""
    if claim.check is None:
        return claim.no, claim.claim, claim.paper, np.nan, claim.unit, claim.verdict, claim.reason
    value = CHECKS[claim.check]()
    if value is None:
        return (
            claim.no,
            claim.claim,
            claim.paper,
            np.nan,
            claim.unit,
            NOT_RUN,
            f"{NOT_RUN}: {why_not()}; {WHENCE}",
        )
    verdict = claim.computed_verdict(value)
    reason = claim.reason if verdict == claim.verdict else f"The ledger declares '{claim.verdict}'."
    return claim.no, claim.claim, claim.paper, value, claim.unit, verdict, reason


def disagreements(board: pd.DataFrame) -> list[str]:
    """The numbers of the claims whose computed verdict is not the declared one; what was not run
    says nothing.
    """
    declared = {claim.no: claim.verdict for claim in load_claims()}
    return [
        no
        for no, verdict in zip(board["no"], board["verdict"], strict=True)
        if verdict not in (declared[no], NOT_RUN)
    ]


@cache
def _table1() -> PoseErrors:
    table = load_table1()
    return pose_errors(table.measured, table.set_poses)


@cache
def _replication(draws: int = 5) -> PoseErrors:
    """Errors over Table 1's poses, each under several draws of the noise: one draw's alpha varies
    by a third.
    """
    handle = load_handle("paper")
    truths = RigidTransform.concatenate([load_table1().set_poses] * draws)
    errors = replication_errors(replicate(truths, load_rig("paper_pair"), handle), truths, handle)
    if errors.n < len(truths):
        raise RuntimeError(
            f"the replication measured {errors.n} of {len(truths)} poses: its means would flatter"
        )
    return errors


@cache
def _best(rig: str) -> PoseErrors:
    """Errors of the best estimator over Table 1's poses, one draw of the noise."""
    handle = load_handle("paper")
    truths = load_table1().set_poses
    errors = replication_errors(
        replicate(truths, load_rig(rig), handle, parameters=Parameters(estimator=BEST)),
        truths,
        handle,
    )
    if errors.n < len(truths):
        raise RuntimeError(
            f"the best estimator measured {errors.n} of {len(truths)} poses: its means would flatter"
        )
    return errors


def _on_second(rig: str, column: str) -> float:
    """The best estimator on the second renderer's images, by the worse of the handles."""
    table = load_sweep("second_renderer")
    return float(table[_rows_of(table, BEST) & (table["rig"] == rig)][column].max())


def _honesty_on_second(estimator: str) -> float:
    """The largest factor, either way, between the rms error and the sigma of a rig, a handle and a
    unit, on the second renderer's images.
    """
    table = load_sweep("second_renderer")
    rows = table[_rows_of(table, estimator)]
    ratios = rows[["error_by_sigma_mm", "error_by_sigma_deg"]].to_numpy().ravel()
    return float(np.maximum(ratios, 1 / ratios).max())


def _rows_of(table: pd.DataFrame, estimator: str) -> pd.Series:
    return (table["renderer"] == second_renderer.SECOND) & (table["estimator"] == estimator)


def _false_when_broken() -> float:
    """Wrong poses of the best estimator in the table of faults."""
    table = load_sweep("stress")
    return float(table[(table["estimator"] == BEST) & (table["fault"] != "none")]["wrong"].sum())


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
    **{f"second_position_{rig}": partial(_on_second, rig, "mean_mm") for rig in RIGS},
    **{f"second_geodesic_{rig}": partial(_on_second, rig, "mean_deg") for rig in RIGS},
    "second_honesty_best": partial(_honesty_on_second, BEST),
    "second_honesty_checked": partial(_honesty_on_second, "paper_checked"),
    "broken_false_poses": _false_when_broken,
    "printed_rotation": lambda: printed_rotation_error()[0],
    "printed_workspace": lambda: printed_workspace_volume(np.deg2rad(20.0)),
    "share_measured": claim_trials.share_measured,
    "share_tracked": claim_trials.share_tracked,
    "share_kept_under_light": claim_trials.share_kept_under_light,
    "share_of_wrong_matches": claim_trials.share_of_wrong_matches,
    "share_searched": claim_trials.share_searched,
    "share_saved_by_the_third": claim_trials.share_saved_by_the_third,
    "centroid_error_px": claim_trials.centroid_error_px,
    "calibration_cost": calibration_cost_mm,
    "real_photographs": real_recordings.baseline_difference_mm,
    "real_leds": real_recordings.led_median_px,
    "real_board": real_recordings.board_fit_mm,
    "real_particles": real_recordings.particle_median_px,
    "slave_at_rest": master_slave.slave_at_rest,
}
