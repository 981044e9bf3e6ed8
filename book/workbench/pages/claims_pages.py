"""Parts of the scoreboard's page and of the protocol's page: the two boards, the trials, the criteria, the
log of deviations.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from trinolab.files.outputs import write_whole

from ..cli import digits
from ..studies.protocol import Claim, can_show, load_claims, load_deviations, load_trials
from ..studies.scoreboard import essential_rows

VERDICTS = ("match", "differs", "undecided", "cannot be tested")
IS_OF_THE_PAPER = ("re-computation", "replication as printed", "replication as corrected")


def write_pages(scoreboard: Path, folder: Path) -> None:
    """Write all parts, from the board as `make book` has stored it and from the ledger."""
    folder.mkdir(parents=True, exist_ok=True)
    board = read_board(scoreboard)
    of_paper = board["kind"].isin(IS_OF_THE_PAPER)
    first = board["no"].isin([no for rows in essential_rows(board).values() for no in rows["no"]])
    parts = {
        "essential": essential_table(board),
        "paper": board_table(board[of_paper & ~first]),
        "own": board_table(board[~of_paper & ~first]),
        "trials": trials_table(),
        "criteria": criteria_table(),
        "deviations": deviations_list(),
    }
    for name, text in parts.items():
        write_whole(folder / f"{name}.md", text + "\n")


def read_board(path: Path) -> pd.DataFrame:
    """The stored board, its numbers as numbers."""
    numbers = ("ours", "low", "high", "n")
    return pd.read_csv(
        path, dtype={"no": str}, keep_default_na=False, na_values={name: [""] for name in numbers}
    )


def signed(verdict: str) -> str:
    """A verdict behind its sign, which is seen before the word is read."""
    signs = {"match": "✓ ", "met": "✓ ", "differs": "✗ "}
    return signs.get(verdict, "") + verdict


def board_table(board: pd.DataFrame) -> str:
    """A board as a table of three columns, which a narrow screen has room for: the row; claim,
    verdict and reason; both numbers and the criterion.
    """
    rows = [
        (
            str(row.no),
            f"{row.claim} <br> **{signed(row.verdict)}**: {row.reason} {row.sensitivity}".rstrip(),
            f"{numbers_of(row)} <br> *{row.kind}*: {row.criterion}",
        )
        for row in board.itertuples()
    ]
    head = ("No", "Claim, and how it fares", "Paper, ours, and what decides")
    return list_table(head, rows, "6 47 47", "scoreboard", anchor="claim")


def essential_table(board: pd.DataFrame) -> str:
    """The board that a reader sees first: a line per question, its rows' criteria and reasons folded
    away below it.
    """
    rows = []
    for question, some in essential_rows(board).items():
        numbers, reasons = [], []
        for row in some.itertuples():
            paper = "" if row.paper == "yes" else f"paper {row.paper}, ours "
            numbers.append(f"{row.no} **{signed(row.verdict)}**: {paper}{value_of(row)}")
            reason = escaped(f"{row.reason} {row.sensitivity}".rstrip())
            reasons.append(
                f"{row.no}. {escaped(row.claim)} *{row.kind}*: {escaped(row.criterion)} "
                f"**{signed(row.verdict)}** ({sampled(row)}): {reason}"
            )
        folded = "\n\n".join(
            ["<details><summary>Criterion and reason</summary>", *reasons, "</details>"]
        )
        rows.append(
            (
                " ".join(placed("claim", no) for no in some["no"]),
                f"{escaped(question)}\n\n{folded}",
                escaped(" <br> ".join(numbers)),
            )
        )
    head = ("No", "Question", "Verdict, and ours (interval of 95 %)")
    return list_table(head, rows, "8 40 52", "essential", raw=True)


def value_of(row: Any) -> str:
    """A row's value with its unit, which a share and a ratio have none of, and its interval."""
    unit = "" if row.unit in ("", "share", "ratio") else f" {row.unit}"
    interval = f" ({digits(row.low)} to {digits(row.high)})" if row.low == row.low else ""
    return f"{digits(row.ours)}{unit}{interval}" if row.ours == row.ours else "no number"


def sampled(row: Any) -> str:
    """How many draws a row has, and from which seed."""
    if row.n != row.n:
        return "nothing drawn"
    return f"n {row.n:.0f}" + (f", seed {row.seed}" if row.seed else "")


def numbers_of(row: Any) -> str:
    """The paper's number and ours, with interval, n and seed."""
    lines = [] if row.paper in ("", "yes") else [f"paper {row.paper} {row.unit}"]
    if row.ours == row.ours:
        lines.append(f"ours **{digits(row.ours)}** {row.unit}".rstrip())
    if row.low == row.low and row.high == row.high:
        lines[-1] += f" ({digits(row.low)} to {digits(row.high)})"
    if row.n == row.n:
        lines.append(sampled(row))
    return " <br> ".join(lines) or "no number"


def trials_table() -> str:
    """What each trial draws at random."""
    rows = [
        (f"{name} <br> {t.draws} draws, seed {t.seed}", f"{t.drawn}.")
        for name, t in load_trials().items()
    ]
    return list_table(("Trial", "What is drawn"), rows, "35 65", "trials")


def criteria_table() -> str:
    """Each row's words of the paper, kind and sample; its number leads to its criterion, which is
    printed beside the result.
    """
    rows = [(claim.no, in_words(claim), f"{sample_of(claim)}.") for claim in load_claims()]
    head = ("No", "Claim, and the paper's words", "Sample")
    return list_table(head, rows, "6 60 34", "criteria", anchor="criterion")


def in_words(claim: Claim) -> str:
    """A claim with the paper's words, or as a requirement of ours."""
    source = f"“{claim.quote}” (Sect. {claim.section})" if claim.quote else "Ours."
    return f"{claim.claim} <br> {source} <br> *{claim.kind}*"


def sample_of(claim: Claim) -> str:
    """Trial and statistic of a claim, and what they can show."""
    if claim.trial is None:
        return "nothing drawn"
    most = can_show(claim, load_trials())
    return f"{claim.trial}, {claim.statistic}" + (f"; {most}" if most else "")


def deviations_list() -> str:
    """The log, an item each."""
    return "\n".join(
        f"- **{entry.date}**, claim {', '.join(map(claim_link, entry.claims))}. *Was:* {entry.was} *Now:* {entry.now} "
        f"{entry.why}"
        for entry in load_deviations()
    )


def claim_link(no: str) -> str:
    """A claim's number as a link to its row of the scoreboard."""
    return f"{{ref}}`{no} <claim-{no}>`"


def list_table(
    head: tuple[str, ...],
    rows: list[tuple[str, ...]],
    widths: str,
    kind: str,
    anchor: str = "",
    raw: bool = False,
) -> str:
    """A table whose cells may be long, in MyST.

    Parameters
    ----------
    anchor : str
        The first cell of a row is a number, to which links may lead: "claim" makes "claim-17a".
    raw : bool
        Whether cells are markup already.
    """
    lines = ["````{list-table}", ":header-rows: 1", f":widths: {widths}", f":class: {kind}", ""]
    for row in [head, *rows]:
        cells = list(row) if raw else [escaped(cell) for cell in row]
        if anchor and row is not head:
            cells[0] = placed(anchor, row[0])
        cells = [cell.replace("\n", "\n    ").replace("\n    \n", "\n\n") for cell in cells]
        lines += [f"{'* -' if k == 0 else '  -'} {cell}" for k, cell in enumerate(cells)]
    return "\n".join([*lines, "````"])


def placed(anchor: str, no: str) -> str:
    """A row's number as a place to link to, and a link to the other page that has the row."""
    other = {"claim": "criterion", "criterion": "claim"}[anchor]
    return f"[{{ref}}`{no} <{other}-{no}>`]{{#{anchor}-{no}}}"


def escaped(text: str) -> str:
    """Text in which no character is markup that a sentence can have by chance."""
    return text.replace("_", "\\_").replace("^", "\\^").replace("[", "\\[").replace("]", "\\]")
