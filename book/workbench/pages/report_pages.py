"""Parts of the replication report: the answer in a sentence, the rows by kind, what each assumption is
worth, and what the book was built with.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from trinolab.datasets import load_sweep
from trinolab.files.outputs import write_whole

from ..cli import digits
from ..studies import answer as cause
from ..studies.pattern import holm
from ..studies.protocol import load_claims
from ..studies.scoreboard import essential_rows
from . import ranges_pages
from .claims_pages import (
    IS_OF_THE_PAPER,
    VERDICTS,
    claim_link,
    escaped,
    list_table,
    read_board,
)
from .hour import read_chapters
from .howmade import commit_said

ROOT = Path(__file__).resolve().parents[3]

# Assumptions that no row of data/sensitivity.csv varies, and why.
NOT_VARIED = {
    "A26": "the markers of all thresholds on the way are kept, so that they hardly depend on where the "
    "search begins and ends; {doc}`chapter 5 </notebooks/05_markers>` shows what the last threshold "
    "alone would give",
    "A32": "a choice of directions and scale: no number of the paper depends on it",
    "A33": "the delay and the trembling that it exchanges are in {doc}`chapter 11 </notebooks/11_master_slave>`",
    "A34": "the delay of claim 20 changes by as much as the age",
    "A35": "{doc}`chapter 12 </notebooks/12_force_feedback>` sweeps it; nothing of the paper depends on it",
}
NAMES = {
    "E_t": "$E_t$",
    "E_alpha": "$E_\\alpha$",
    "E_beta": "$E_\\beta$",
    "E_gamma": "$E_\\gamma$",
    "angle": "angle $\\vartheta$",
    "E_t best": "best $E_t$",
    "angle best": "best $\\vartheta$",
    "told apart": "poses that are the true one",
    "measured": "measured poses",
    "E_t printed": "$E_t$ of the printed table",
    "angle printed": "$\\vartheta$ of the printed table",
    "E_t of a calibration": "$E_t$ of a calibration",
    "workspace": "workspace",
    "false_percent_cured": "bench taken for moving",
    "window_percent_calm": "image searched",
}
# Verdict of all rows of a question -> its heading.
FARES = {
    "match": "The paper is confirmed, however the gaps are filled",
    "differs": "The paper is contradicted, however the gaps are filled",
    "mixed": "The paper is confirmed in part",
    "undecided": "Undecided",
}
PAPER_MM = 0.31  # E_t as the paper has it
POSES, CALIBRATIONS = 20, 30  # of a number that nothing was left out of
PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "pandas", "jupyter-book")
FILES = (
    "data/claims.toml",
    "data/claims_results.csv",
    "data/sensitivity.csv",
    "environment.txt",
)


def write_pages(scoreboard: Path, seconds: Path, executed: Path, folder: Path) -> None:
    """Write all parts, from the stored board, the stored run times and a folder of executed
    notebooks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    board = read_board(scoreboard)
    table = pd.read_csv(ROOT / "data" / "sensitivity.csv", keep_default_na=False, na_values=[""])
    parts = {
        "cause": cause.sentence(),
        "front": front(board),
        "ranges": ranges_pages.ranges_table(board),
        "flatness": ranges_pages.flatness_table(),
        "rates": ranges_pages.rates_table(),
        "errors": ranges_pages.errors_table(board, read_chapters(executed)),
        "kinds": kinds(board),
        "untestable": untestable(board),
        "headline": headline(table),
        "sensitivity": sensitivity(table),
        "environment": environment(seconds),
    }
    for name, text in parts.items():
        write_whole(folder / f"{name}.md", text + "\n")


def front(board: pd.DataFrame) -> str:
    """The answers of the front by how their claims fare, as a list."""
    answers = {claim.question: claim.answer for claim in load_claims() if claim.answer}
    fares: dict[str, list[str]] = {verdict: [] for verdict in FARES}
    for question, rows in essential_rows(board).items():
        verdicts = set(rows["verdict"])
        group = verdicts.pop() if len(verdicts) == 1 else "mixed"
        links = ", ".join(claim_link(no) for no in rows["no"])
        fares.setdefault(group, []).append(f"{escaped(answers[question])} ({links}).")
    return "\n".join(
        f"- **{FARES.get(group, group)}:** {' '.join(some)}"
        for group, some in fares.items()
        if some
    )


def kinds(board: pd.DataFrame) -> str:
    """For each kind of row how many fare how, and which."""
    rows = []
    for kind in (*IS_OF_THE_PAPER, "ours beyond"):
        some = board[board["kind"] == kind]
        fares = []
        for verdict in dict.fromkeys([*VERDICTS, "met", "missed", *some["verdict"]]):
            chosen = some[some["verdict"] == verdict]
            if len(chosen):
                links = ", ".join(claim_link(no) for no in chosen["no"])
                fares.append(f"{len(chosen)} {verdict}: {links}")
        rows.append((f"{kind} <br> {len(some)} rows", " <br> ".join(fares)))
    return list_table(("Kind", "How its rows fare"), rows, "28 72", "kinds", raw=True)


def untestable(board: pd.DataFrame) -> str:
    """What cannot be tested, and why."""
    some = board[board["verdict"] == "cannot be tested"]
    return "\n".join(
        f"- {claim_link(row.no)}: {row.claim} {row.reason}" for row in some.itertuples()
    )


def headline(table: pd.DataFrame) -> str:
    """The headline numbers as assumed, and how far the position error moves."""
    drawn = table[table["source"] == "rendered"]
    first = drawn.drop_duplicates("number")
    base = ", ".join(
        f"{NAMES[row.number]} {quantity(row.as_assumed, row.unit)} ({claim_link(row.claim)})"
        for row in first.itertuples()
    )
    seed, draws = (int(first[name].iloc[0]) for name in ("seed", "draws"))
    return (
        f"As assumed ({POSES} poses, {draws} draws of the noise each, seed {seed}; these are this "
        f"page's own draws, *the* values are the board's): {base}.\n\n"
        f"{conclusion(drawn)} {by_chance(table)}"
    )


def sensitivity(table: pd.DataFrame) -> str:
    """What each change of an assumption does to the headline numbers: those with a difference that is
    not chance's, and which changes show none.
    """
    rows, none = [], list[str]()
    table = table.assign(sure=after_holm(table))
    for (assumption, instead), some in table.groupby(["assumption", "instead"], sort=False):
        changed = [row for row in some.itertuples() if is_shown(row)]
        name = f"[{assumption}](assumptions.md#{assumption.lower()})"
        if changed:
            rows.append((f"{name} {instead}", "; ".join(map(change_text, changed))))
        else:
            none.append(f"{name} ({instead})")
    head = ("Assumption, and what holds instead", "What changes, with its interval")
    not_varied = "\n".join(
        f"- [{no}](assumptions.md#{no.lower()}): {why}." for no, why in NOT_VARIED.items()
    )
    return "\n".join(
        [
            list_table(head, rows, "34 66", "sensitivity", raw=True),
            "",
            f"No change shows for {', '.join(none)}." if none else "",
            "",
            "Not varied here:",
            "",
            not_varied,
        ]
    )


def tested(table: pd.DataFrame) -> pd.Series:
    """Which rows have an interval that may leave out zero: something was drawn, and it changed."""
    return (table["high"] > table["low"]) & (table["difference"] != 0)


def after_holm(table: pd.DataFrame) -> pd.Series:
    """Which differences stay beyond chance if one corrects for how many intervals were looked at
    (Holm, 5 %), an interval of 95 % being that of a normal distribution; what is not drawn stays.
    """
    drawn = tested(table)
    sigma = (table["high"] - table["low"])[drawn] / (2 * stats.norm.ppf(0.975))
    p = 2 * stats.norm.sf(np.abs(table["difference"][drawn]) / sigma)
    sure = ~drawn
    sure[drawn] = holm(p) < 0.05
    return sure


def by_chance(table: pd.DataFrame) -> str:
    """How many intervals were looked at, how many of those shown may be chance, and how many stay."""
    drawn = tested(table)
    shown = [row for row in table[drawn].itertuples() if is_shown(row)]
    sure = sum(bool(after_holm(table)[row.Index]) for row in shown)
    looked, chance = int(drawn.sum()), 0.05 * int(drawn.sum())
    return (
        f"In all {int(table['low'].notna().sum())} intervals were looked at. Of these {looked} have a "
        f"width, since something changed, and {len(shown)} are shown because they leave out zero. By "
        f"chance alone about {chance:.0f} would do so: that many of those shown may be nothing. After "
        f"Holm's correction {sure} stay; the others are marked "
        "with a question mark. And as only large differences are shown, their sizes are on average "
        "too large."
    )


def conclusion(drawn: pd.DataFrame) -> str:
    """How far the position error of the replication moves, and which changes bring it to the paper's."""
    some = drawn[drawn["number"] == "E_t"].dropna(subset="changed")
    reach = some[some["changed"] >= PAPER_MM]
    links = ", ".join(
        f"[{row.assumption}](assumptions.md#{row.assumption.lower()}) ({digits(row.changed)} mm)"
        for row in reach.itertuples()
    )
    which = "None takes it"
    if len(reach):
        which = f"Only {links} take{'s' if len(reach) == 1 else ''} it"
    registered = ""
    if "A4" in set(reach["assumption"]):
        rows = load_sweep("budget").set_index(["registration", "source"]).E_t_mm
        left = digits(rows["20 poses", "R_rl as printed"])
        registered = (
            f" Nothing is registered here: of A4 a registration by Table 1's poses leaves {left} mm "
            "({doc}`chapter 9 </notebooks/09_table1>`)."
        )
    return (
        f"Over all changes {NAMES['E_t']} lies between {digits(some['changed'].min())} and "
        f"{digits(some['changed'].max())} mm. {which} to the paper's {PAPER_MM} mm or beyond."
        f"{registered}"
    )


def is_shown(row: object) -> bool:
    """Whether a difference is one: more than a hundredth, and its interval leaves out zero where
    anything was drawn.
    """
    if not abs(row.difference) > 1e-2 * abs(row.as_assumed):
        return False
    return row.low != row.low or row.low > 0 or row.high < 0


def change_text(row: object) -> str:
    """Before and after, and the interval of the difference."""
    scale = 100 if row.unit == "share" else 1
    after = quantity(row.changed, row.unit)
    text = f"{NAMES[row.number]} {digits(scale * row.as_assumed)} → **{after}**"
    if row.low == row.low:
        fewer = "" if row.n in (POSES, CALIBRATIONS) else f", n {row.n}"
        text += f" ({signed(scale * row.low)} to {signed(scale * row.high)}{fewer})"
    return text if getattr(row, "sure", True) else f"{text} ?"


def quantity(value: float, unit: str) -> str:
    """A number with its unit; a share in percent."""
    return f"{100 * value:.0f} %" if unit == "share" else f"{digits(value)} {unit}"


def signed(value: float) -> str:
    """Two digits, or whole numbers, with a sign."""
    text = f"{value:+.0f}" if abs(value) >= 10 else f"{value:+.2g}"
    return text.replace("-", "−")


def environment(seconds: Path) -> str:
    """Versions, machine, times and hashes of this build."""
    took = json.loads(seconds.read_text(encoding="utf-8")) if seconds.exists() else {}
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    rows = [
        (
            "Software",
            f"trinolab {version('trinolab')}, commit {commit_said()}; Python "
            f"{platform.python_version()}; {packages}; the rest in `environment.txt`, with hashes",
        ),
        (
            "Machine",
            f"{processor()}, {os.cpu_count()} cores, {platform.system()}; no graphics card is used",
        ),
        (
            "Run time",
            f"chapters, scoreboard and ledger {sum(took.values()) / 60:.1f} min of two jobs at a "
            "time, one thread each"
            if took
            else "not measured: nothing was stale",
        ),
        *((f"`{name}`", f"SHA-256 {sha256(ROOT / name)[:16]}…") for name in FILES),
    ]
    return list_table(("What", "In this build"), rows, "28 72", "environment", raw=True)


def processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    match = re.search(r"model name\s*:\s*(.+)", text)
    return match[1] if match else platform.machine()


def sha256(path: Path) -> str:
    """The hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
