"""The paper's claims against what is computed here: one row per claim of ``data/claims.toml``.

What is drawn comes from ``data/claims_results.csv``, which `claims` makes; the rest is computed at
once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import data_path, load_handle, load_rig, load_sweep, load_table1
from trinolab.files.fetch import why_not
from trinolab.measurement import measure
from trinolab.methods import BEST
from trinolab.metrics import PoseErrors, pose_errors

from ..intervals import of_quantile
from ..paper.errata.pose import printed_rotation_error
from ..paper.errata.workspace import printed_workspace_volume
from . import ranges, real_recordings, second_renderer
from .protocol import Claim, Trial, can_show, load_claims, load_trials
from .replication import CHECKED, EVERY

COLUMNS = (
    "no",
    "claim",
    "paper",
    "ours",
    "unit",
    "verdict",
    "reason",
    "low",
    "high",
    "n",
    "seed",
    "kind",
    "criterion",
    "can_show",
    "sensitivity",
)
RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")
NOT_RUN = "not run"
WHENCE = "data/real.toml says which recordings it should have, and where they come from"
NOT_DRAWN = (
    "not run: data/claims_results.csv has no row; `python -m workbench.studies claims` makes it"
)


class Result(NamedTuple):
    """What a check gives: a value, its interval, how many draws, and their seed; NaN and "" where
    nothing is drawn.
    """

    value: float
    low: float = np.nan
    high: float = np.nan
    n: float = np.nan
    seed: float | str = ""


def scoreboard(progress: bool = False) -> pd.DataFrame:
    """Compute every claim that can be computed, and its verdict by the criterion of the ledger.

    Parameters
    ----------
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`, one row per claim; `ours` is NaN where nothing is computed. The verdict is
        then the declared one ("cannot be tested", "not tested yet"), or "not run" where it takes a
        recording that is not here.

    Raises
    ------
    ValueError
        Before anything is computed: a claim names a check that is not in `CHECKS`.
    """
    ledger = load_claims()
    trials = load_trials()
    for claim in ledger:
        if claim.check is not None and claim.trial is None and claim.check not in CHECKS:
            raise ValueError(
                f"claims.toml: claim {claim.no}: check: expected one of {', '.join(CHECKS)} "
                f"(CHECKS in book/workbench/studies/scoreboard.py), got {claim.check!r}"
            )
        if claim.trial is not None and claim.trial not in trials:
            raise ValueError(
                f"claims.toml: claim {claim.no}: trial: expected one of {', '.join(trials)}, "
                f"got {claim.trial!r}"
            )
    with tqdm(ledger, unit="claim", disable=None if progress else True) as claims:
        results = drawn_results()
        rows = [score(claim, results, trials) for claim in claims]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def essential_rows(board: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The rows of a board that answer a question of the ledger, by question, in its order."""
    questions = {claim.no: claim.question for claim in load_claims()}
    asked = board.assign(question=board["no"].map(questions)).dropna(subset="question")
    return {str(name): rows for name, rows in asked.groupby("question", sort=False)}


def drawn_results() -> dict[str, Result]:
    """What the run of the protocol has given, by check; nothing where it was not run."""
    try:
        path = data_path("claims_results.csv")
    except ValueError:
        return {}
    return {
        row.check: Result(row.value, row.low, row.high, row.n, row.seed)
        for row in pd.read_csv(path).itertuples()
    }


def quoted(no: str) -> str:
    """The value of a claim that is drawn, as every page quotes it: with its unit, interval and number
    of draws.

    Raises
    ------
    ValueError
        If there is no such claim, or nothing was drawn for it.
    """
    rows = {claim.no: claim for claim in load_claims()}
    result = drawn_results().get(str(rows[no].check)) if no in rows else None
    if result is None:
        raise ValueError(f"no: expected a claim that is drawn, got {no!r}")
    value, low, high = (f"{number:.3g}" for number in result[:3])
    return f"{value} {rows[no].unit} ({low} to {high}, {result.n:.0f} draws)"


def score(claim: Claim, results: Mapping[str, Result], trials: dict[str, Trial]) -> tuple:
    """One row of the scoreboard, with what was drawn and what it was drawn by."""
    result = None
    decides = ""
    why = f"{NOT_RUN}: {why_not()}; {WHENCE}"
    if claim.trial is not None:
        result = results.get(str(claim.check))
        why = NOT_DRAWN
    elif claim.check is not None:
        value = CHECKS[claim.check]()
        result = Result(value) if isinstance(value, int | float) else value
    if claim.check is None:
        verdict, reason, result = claim.verdict, claim.reason, Result(np.nan)
    elif result is None or np.isnan(result.value):
        verdict, reason, result = NOT_RUN, why, Result(np.nan)
    else:
        verdict = claim.computed_verdict(result.value, result.low, result.high)
        if claim.question is not None:
            others = ranges.elsewhere(claim, result, results)
            decides = ranges.deciding(verdict, others)
            verdict = ranges.over_range(verdict, others)
        same = verdict == claim.verdict
        reason = claim.reason if same else f"The ledger declares '{claim.verdict}'."
    return (
        claim.no,
        claim.claim,
        claim.paper,
        result.value,
        claim.unit,
        verdict,
        reason,
        *result[1:],
        claim.kind,
        claim.criterion,
        can_show(claim, trials),
        decides,
    )


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


def _mean_of_table1(name: str) -> Result:
    """A mean of the printed table. It has no interval: its rounding is in the criterion's
    tolerance.
    """
    return Result(float(getattr(_table1(), name)), n=_table1().n)


def seconds_an_instant(count: int = 7) -> Result:
    """Median time of the paper's measurement of two rendered images on this machine now, s, with
    its interval; whole images, one process.
    """
    rig = load_rig("paper_pair")
    handle = load_handle("paper")
    frames = render_rig(
        rig, handle, load_table1().set_poses[0], Bench(), np.random.default_rng(1716)
    )
    seconds = []
    for _ in range(count + 1):
        begin = time.perf_counter()
        measure(frames, rig, handle, parameters=EVERY["paper"])
        seconds.append(time.perf_counter() - begin)
    later = np.array(seconds[1:])  # the first one warms up
    interval = of_quantile(later, 0.5)
    return Result(float(np.median(later)), interval.low, interval.high, count)


def _on_second(rig: str, unit: str) -> Result:
    """The best estimator's mean error on the second renderer's images, mm or deg, of the worse of
    the handles.
    """
    table = load_sweep("second_renderer")
    rows = second_renderer.stills(table, BEST)
    rows = rows[rows["rig"] == rig]
    worse = rows.loc[rows[f"mean_{unit}"].idxmax()]
    return Result(
        worse[f"mean_{unit}"],
        worse[f"low_{unit}"],
        worse[f"high_{unit}"],
        worse["n"],
        worse["seed"],
    )


def _sigma_factor_on_second(estimator: str) -> Result:
    """See `second_renderer.largest_sigma_factor`."""
    return Result(*second_renderer.largest_sigma_factor(load_sweep("second_renderer"), estimator))


def _false_when_broken() -> float:
    """Wrong poses of the best estimator in the table of faults."""
    table = load_sweep("stress")
    return float(table[(table["estimator"] == BEST) & (table["fault"] != "none")]["wrong"].sum())


CHECKS: dict[str, Callable[[], Result | float | None]] = {  # None: not run
    "table1_position": partial(_mean_of_table1, "E_t_mm"),
    "table1_alpha": partial(_mean_of_table1, "E_alpha_deg"),
    "table1_beta": partial(_mean_of_table1, "E_beta_deg"),
    "table1_gamma": partial(_mean_of_table1, "E_gamma_deg"),
    "printed_rotation": lambda: printed_rotation_error()[0],
    "printed_workspace": lambda: printed_workspace_volume(np.deg2rad(20.0)),
    "seconds_an_instant": seconds_an_instant,
    **{f"second_position_{rig}": partial(_on_second, rig, "mm") for rig in RIGS},
    **{f"second_geodesic_{rig}": partial(_on_second, rig, "deg") for rig in RIGS},
    "second_sigma_best": partial(_sigma_factor_on_second, BEST),
    "second_sigma_checked": partial(_sigma_factor_on_second, CHECKED),
    "broken_false_poses": _false_when_broken,
    "real_photographs": real_recordings.baseline_difference_mm,
    "real_leds": real_recordings.led_median_px,
    "real_board": real_recordings.board_fit_mm,
    "real_particles": real_recordings.particle_median_px,
}
