"""Parts of pages about what the paper leaves open: each row's other choices, the assumptions that matter
most, the flatness of the board, the rate of the background; and every E_t of the paper's method.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from trinolab.datasets import data_path

from ..cli import digits
from ..intervals import of_ratio, of_share, of_student
from ..studies import claim_draws, ranges
from ..studies.protocol import Claim, load_claims
from ..studies.scoreboard import drawn_results
from .claims_pages import claim_link, escaped, list_table
from .hour import Quoted

ROOT = Path(__file__).resolve().parents[3]
MATTER = 10  # assumptions of the table


class Moved(NamedTuple):
    """A row of the front with another choice: the row, its value as assumed, and `ranges.Elsewhere`."""

    row: Any
    other: ranges.Elsewhere

    @property
    def turned(self) -> bool:
        """Whether the verdict there is the opposite one."""
        return {self.as_assumed, self.other.verdict} == {"match", "differs"}

    @property
    def as_assumed(self) -> str:
        return _claims()[self.row.no].computed_verdict(self.row.ours, self.row.low, self.row.high)

    @property
    def grows(self) -> float:
        """The change relative to the value as assumed."""
        return abs(self.other.value - self.row.ours) / max(abs(self.row.ours), 1e-9)


def moved(board: pd.DataFrame) -> list[Moved]:
    """Each row of the front with each other choice that was run."""
    rows = {str(row.no): row for row in board.itertuples()}
    results = drawn_results()
    found = []
    for claim in _claims().values():
        if claim.question is None or claim.no not in rows:
            continue
        row = rows[claim.no]
        base = ranges.Elsewhere("", "", row.ours, row.low, row.high, row.verdict)
        for other in ranges.elsewhere(claim, base, results):
            if other.verdict != "not run":
                found.append(Moved(row, other))
    return found


def ranges_table(board: pd.DataFrame) -> str:
    """Each row of the front that has ranges: its verdict as assumed, and with each other choice."""
    lines = []
    for no, some in _grouped(moved(board), lambda one: str(one.row.no)).items():
        row = some[0].row
        others = "; ".join(
            f"{escaped(one.other.instead)} ({_assumption(one.other.assumption)}): "
            f"{_value(one.other.value, one.other.low, one.other.high)}, {one.other.verdict}"
            for one in some
        )
        base = f"{_value(row.ours, row.low, row.high)}, {some[0].as_assumed}"
        lines.append((claim_link(no), f"{base}; over the range **{row.verdict}**", others))
    head = ("No", "As assumed", "With another choice")
    return list_table(head, lines, "8 30 62", "ranges", raw=True)


def assumptions_table(board: pd.DataFrame) -> str:
    """The assumptions that matter most: those that turn most verdicts round, then those that move a
    row of the front most.
    """
    by_assumption = _grouped(moved(board), lambda one: one.other.assumption)

    def weight(name: str) -> tuple[int, float]:
        some = by_assumption[name]
        turned = {one.row.no for one in some if one.turned}
        return len(turned), max(one.grows for one in some)

    lines = []
    for name in sorted(by_assumption, key=weight, reverse=True)[:MATTER]:
        some = by_assumption[name]
        strongest = []
        for _, of_row in _grouped(some, lambda one: str(one.row.no)).items():
            strongest.append(max(of_row, key=lambda one: (one.turned, one.grows)))
        strongest.sort(key=lambda one: (one.turned, one.grows), reverse=True)
        effects = "; ".join(
            f"{claim_link(one.row.no)}: {digits(one.row.ours)} to {digits(one.other.value)} "
            f"{_unit(one.row.unit)}({escaped(one.other.instead)}), {one.other.verdict}"
            for one in strongest[:3]
        )
        choices = ", ".join(dict.fromkeys(escaped(one.other.instead) for one in some))
        lines.append((f"{_assumption(name)} {_said(name)}", choices, effects))
    head = ("Assumption", "Range", "Effect: as assumed, and at the end that moves it most")
    return list_table(head, lines, "30 28 42", "assumptions", raw=True)


def flatness_table() -> str:
    """What the flatness of the board does to the method's error and to a calibration alone."""
    draws = _draws("flatness")
    lines = []
    for name, bend_mm in claim_draws.FLATNESS_MM.items():
        means = [
            of_student(draws[f"{quantity}_{name}"].a)
            for quantity in ("calibration_cost", "position", "registered")
        ]
        values = [
            draws[f"{quantity}_{name}"].a.mean()
            for quantity in ("calibration_cost", "position", "registered")
        ]
        cells = [_value(v, m.low, m.high) for v, m in zip(values, means, strict=True)]
        lines.append((f"{bend_mm:g}", *cells))
    head = (
        "Board bent by, mm",
        "Calibration alone, mm",
        "$E_t$ of the method, mm",
        "The same after a registration, mm",
    )
    return list_table(head, lines, "19 27 27 27", "flatness", raw=True)


def rates_table() -> str:
    """Clips and instants that the printed background tracks, by its rate."""
    draws = _draws("long_clip")
    standard = claim_draws.PRINTED.background.update_rate
    ends = {rate: f"_rate_{rate:g}" for rate in claim_draws.RATES} | {standard: ""}
    lines = []
    for rate, end in sorted(ends.items()):
        clips = draws[f"long_share_tracked_printed{end}"]
        instants = draws[f"long_instants_tracked_printed{end}"]
        share = of_share(int(clips.a.sum()), len(clips))
        around = of_ratio(instants.a, instants.b)
        lost = instants.a.sum() < instants.b.sum()
        lines.append(
            (
                f"{rate:g}",
                f"{clips.a.sum():.0f} of {len(clips)} ({share.low:.2f} to {share.high:.2f})",
                f"{instants.a.sum():.0f} of {instants.b.sum():.0f}"
                + (f" ({around.low:.3f} to {around.high:.3f})" if lost else ""),
            )
        )
    head = ("$\\alpha$ per frame", "Clips of a second without a loss", "Instants")
    return list_table(head, lines, "24 42 34", "rates", raw=True)


# Where an E_t of the paper's method stands, and why it is not the first one: chapter -> the words.
ENDINGS = {
    1: "the chapter's rig, which has a third camera, and some of Table 1's rows: more pairs are averaged",
    2: "three cameras, and positions at the edge of the workspace as well",
    3: "the pair; markers are found in windows that the background cuts out, after half a second of rest",
    4: "the pair; instants of a recording with a hand, at other poses than Table 1's",
    5: "the pair; some of the rows, so that single poses weigh more",
    6: "the pair; instants of recordings with a hand, identified by the paper's pairs, some of them wrong",
    7: "the pair, with rigs that are calibrated from a flat board",
    8: "the pair; one draw of the noise",
    9: "the pair; one draw of the noise",
    12: "three cameras, and some of the rows",
}


def errors_table(board: pd.DataFrame, chapters: Mapping[int, Quoted]) -> str:
    """Every E_t of the paper's method: the board's, those at the ends of the chapters, and why they
    differ.
    """
    rows = {str(row.no): row for row in board.itertuples()}
    lines = [
        (
            f"claim {claim_link('5j')}",
            _value(*(getattr(rows["5j"], name) for name in ("ours", "low", "high"))),
            "the pair with its exact calibration, all rows, many draws of the noise: what images do",
        ),
        (
            f"claim {claim_link('5')}",
            _value(*(getattr(rows["5"], name) for name in ("ours", "low", "high"))),
            "the same images with a new calibration from a flat board in each draw",
        ),
    ]
    for chapter, why in ENDINGS.items():
        values = chapters[chapter].values if chapter in chapters else {}
        if "E_t_mm" in values:
            lines.append((f"chapter {chapter}", f"{values['E_t_mm']:.3f}", why))
    head = ("Where", "$E_t$, mm", "What differs")
    return list_table(head, lines, "16 24 60", "every-error", raw=True)


@cache
def _claims() -> dict[str, Claim]:
    return {claim.no: claim for claim in load_claims()}


def _draws(trial: str) -> dict[str, pd.DataFrame]:
    table = pd.read_csv(data_path("claims_draws.csv"))
    return dict(tuple(table[table["trial"] == trial].groupby("check")))


def _grouped(some: list[Moved], key: Any) -> dict[str, list[Moved]]:
    groups: dict[str, list[Moved]] = {}
    for one in some:
        groups.setdefault(key(one), []).append(one)
    return groups


def _assumption(name: str) -> str:
    return f"[{name}](assumptions.md#{name.lower()})"


def _said(name: str) -> str:
    """What an assumption says: the bold sentence of the page of assumptions."""
    page = (ROOT / "book" / "assumptions.md").read_text(encoding="utf-8")
    entry = page.split(f"[{name}]{{#{name.lower()}}}")[1]
    match = re.search(r"\*\*(.+?)\*\*", entry)
    assert match is not None  # each entry has one
    return re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", match[1])  # links of another page


def _value(value: float, low: float, high: float) -> str:
    return f"{digits(value)} ({digits(low)} to {digits(high)})" if low == low else digits(value)


def _unit(unit: str) -> str:
    return "" if unit in ("", "share", "ratio") else f"{unit} "
