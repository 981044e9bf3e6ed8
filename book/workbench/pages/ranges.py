"""Numbers of what the paper leaves open: each row's other choices, the assumptions that matter most, the
flatness of the board, the rate of the background.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pandas as pd

from trinolab.datasets import data_path

from ..intervals import of_ratio, of_share, of_student
from ..studies import claim_draws
from ..studies import ranges as studied
from ..studies.protocol import load_claims
from ..studies.scoreboard import drawn_results

ROOT = Path(__file__).resolve().parents[3]
MATTER = 10  # assumptions of the table
EFFECTS = 3  # rows that are named for each


def ranges(board: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of the front that have ranges: the number, the verdict as assumed, and each other choice that
    was run, with its verdict, whether that is the opposite one, and the relative change.
    """
    rows = {str(row.no): row for row in board.itertuples()}
    results = drawn_results()
    found = []
    for claim in load_claims():
        if claim.question is None or claim.no not in rows:
            continue
        row = rows[claim.no]
        as_assumed = claim.computed_verdict(row.ours, row.low, row.high)
        base = studied.Elsewhere("", "", row.ours, row.low, row.high, as_assumed)
        others = [
            {
                **other._asdict(),
                **_interval(other.low, other.high),
                "turned": {as_assumed, other.verdict} == {"match", "differs"},
                "change": abs(other.value - row.ours) / max(abs(row.ours), 1e-9),
            }
            for other in studied.elsewhere(claim, base, results)
            if other.verdict != "not run"
        ]
        if others:
            found.append({"no": claim.no, "as_assumed": as_assumed, "others": others})
    return found


def _interval(low: float, high: float) -> dict[str, float | None]:
    return {"low": None, "high": None} if math.isnan(low) else {"low": low, "high": high}


def decisive(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Assumptions that matter most: those that reverse most verdicts, then those that move a row of the front
    most. Each has its choices and its effects on the rows that it moves most; an unmoved row is left out.
    """
    effects: dict[str, list[dict[str, Any]]] = {}
    for one in found:
        for other in one["others"]:
            effects.setdefault(other["assumption"], []).append({"no": one["no"], **other})

    def strength(effect: dict[str, Any]) -> tuple[bool, float]:
        return effect["turned"], effect["change"]

    def weight(name: str) -> tuple[int, float]:
        some = effects[name]
        turned = {effect["no"] for effect in some if effect["turned"]}
        return len(turned), max(effect["change"] for effect in some)

    table = []
    for name in sorted(effects, key=weight, reverse=True)[:MATTER]:
        strongest: dict[str, dict[str, Any]] = {}
        for effect in (one for one in effects[name] if one["change"] > 0):
            before = strongest.get(effect["no"], effect)
            strongest[effect["no"]] = max(before, effect, key=strength)
        table.append(
            {
                "assumption": name,
                "sentence": sentence(name),
                "choices": list(dict.fromkeys(effect["instead"] for effect in effects[name])),
                "effects": sorted(strongest.values(), key=strength, reverse=True)[:EFFECTS],
                "turned": weight(name)[0],
            }
        )
    return table


def sentence(name: str) -> str:
    """The sentence of an assumption, which is bold on its page."""
    page = (ROOT / "book" / "assumptions.md").read_text(encoding="utf-8")
    entry = page.split(f"[{name}]{{#{name.lower()}}}")[1]
    match = re.search(r"\*\*(.+?)\*\*", entry)
    assert match is not None  # each entry has one
    return re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", match[1])  # links of another page


def flatness() -> list[dict[str, Any]]:
    """Mean errors by the flatness of the board: of a calibration alone, of the method, and of the method
    after a registration.
    """
    draws = _draws("flatness")
    rows = []
    for name, bend_mm in claim_draws.FLATNESS_MM.items():
        means = []
        for quantity in ("calibration_cost", "position", "registered"):
            values = draws[f"{quantity}_{name}"]["a"]
            interval = of_student(values)
            means.append({"value": values.mean(), "low": interval.low, "high": interval.high})
        rows.append({"bend_mm": bend_mm, "means": means})
    return rows


def rates() -> list[dict[str, Any]]:
    """Clips and instants that the printed background tracks, by its rate."""
    draws = _draws("long_clip")
    standard = claim_draws.PRINTED.background.update_rate
    ends = {rate: f"_rate_{rate:g}" for rate in claim_draws.RATES} | {standard: ""}
    rows = []
    for rate, end in sorted(ends.items()):
        clips = draws[f"long_share_tracked_printed{end}"]["a"]
        instants = draws[f"long_instants_tracked_printed{end}"]
        share = of_share(int(clips.sum()), len(clips))
        ratio = of_ratio(instants["a"], instants["b"])
        rows.append(
            {
                "rate": rate,
                "clips": _counted(clips.sum(), len(clips), share),
                "instants": _counted(instants["a"].sum(), instants["b"].sum(), ratio),
            }
        )
    return rows


def _counted(tracked: float, count: float, interval: Any) -> dict[str, float]:
    return {
        "tracked": round(tracked),
        "count": round(count),
        "low": interval.low,
        "high": interval.high,
    }


def _draws(trial: str) -> dict[str, pd.DataFrame]:
    table = pd.read_csv(data_path("claims_draws.csv"))
    return dict(tuple(table[table["trial"] == trial].groupby("check")))
