"""The ledger of the paper's equations, ``data/equations.toml``, and the pages of the book that come
from it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trinolab.files.inputs import get, read_toml
from trinolab.files.shipped import data_path

ROUNDING = 2e-5  # of all quantities of the errata; none of them is meant to be so small
STATUSES = ("as printed", "misprint", "ambiguous")
# a status -> the title of its part of the errata, and what stands there
PARTS = {
    "misprint": (
        "Errors",
        "What is printed here is wrong: whoever computes by it gets another result than the text means.",
    ),
    "ambiguous": (
        "Ambiguities",
        "These may be right in one of several readings, or leave something undefined, and are no errors of "
        "the authors' as far as we can see. We give the reading that works.",
    ),
    "as printed": (
        "As printed, with a limit",
        "These hold as they stand, but not all that the text says of them.",
    ),
}


@dataclass(frozen=True)
class Entry:
    """One entry of the ledger: an equation, or a sentence or number of the text that cannot be
    right.

    Attributes
    ----------
    no : str
        "1" to "27", or "Sect. 6.2" for what has no number.
    section : str
    printed, corrected : str
        TeX; `corrected` is empty where the printed form holds.
    status : str
        One of `STATUSES`. Ambiguous is what can be read in several ways, or leaves something
        undefined.
    what : str
        A sentence: what is wrong, and how it shows.
    functions, tests : tuple of str
        "trinolab.workspace.cones.paper_cones", "tests/trinolab/workspace/test_intersection.py::test_inside_by_hand".
    chapter : str
        Of the book, "02_workspace".

    Raises
    ------
    ValueError
        If the status is another word, or a corrected form is there or missing against the status.
    """

    no: str
    section: str
    printed: str
    status: str
    corrected: str
    what: str
    functions: tuple[str, ...]
    tests: tuple[str, ...]
    chapter: str

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(
                f"{self.name}: expected a status of {', '.join(STATUSES)}, got {self.status!r}"
            )
        if bool(self.corrected) == (self.status == "as printed"):
            raise ValueError(
                f"{self.name}: expected a corrected form unless the status is 'as printed'"
            )

    @property
    def name(self) -> str:
        """As a reader calls it: "Eq. 20", or the section."""
        return f"Eq. {self.no}" if self.no.isdigit() else self.no

    @property
    def label(self) -> str:
        """Of its place on the page of errata."""
        return "erratum-" + re.sub(r"\W+", "-", self.name.lower())


@dataclass(frozen=True)
class Effect:
    """What a misprint does: one quantity, computed by the printed form and by the corrected one,
    and what it must be.

    Attributes
    ----------
    no : str
        The entry of the ledger.
    meaning : str
        The quantity, and the circumstances under which it was computed.
    unit : str
    printed, corrected : float
        The quantity by either form; infinite or NaN where a form gives no number.
    at_least, at_most : float
        The check: a right form's quantity lies between them.
    """

    no: str
    meaning: str
    unit: str
    printed: float
    corrected: float
    at_least: float = -math.inf
    at_most: float = math.inf

    def holds(self, value: float) -> bool:
        """Whether a value passes the check; NaN does not."""
        return self.at_least <= value <= self.at_most


def load_ledger() -> tuple[Entry, ...]:
    """Load the ledger: the equations in their order, then the entries that are no equation.

    Raises
    ------
    ValueError
        Names the entry and the field that is missing, unknown or wrong.
    """
    path = data_path("equations.toml")
    table = read_toml(path)
    rows = [*get(table, "equation", str(path)), *get(table, "text", str(path))]
    return tuple(
        _entry(row, f"{path}: entry {row.get('no', k)}") for k, row in enumerate(rows, start=1)
    )


def equations_named(text: str) -> set[str]:
    """The numbers of the equations in a docstring's summary: {"20", "21"} of "... (Eq. 20-21).".

    The summary is all that stands before the first empty line.
    """
    summary = " ".join(text.partition("\n\n")[0].split())
    match = re.search(r"\(Eq\. ([\d, -]+)\)", summary)
    if match is None:
        return set()
    spans = [part.partition("-") for part in match.group(1).replace(" ", "").split(",")]
    return {str(no) for first, _, last in spans for no in range(int(first), int(last or first) + 1)}


def index_page(
    entries: Sequence[Entry],
    effects: Mapping[str, Sequence[Effect]],
    labelled: Collection[str] = (),
) -> str:
    """The equation index, as MyST Markdown: a line to jump from, then a section an equation with its
    formula, its links, and its tests as a command.

    Parameters
    ----------
    entries : sequence of Entry
    effects : mapping
        From an entry's number to what its misprint does; without one there is no link to the errata.
    labelled : collection of str
        Labels that chapters have, "eq-20"; a chapter without one is linked as a whole.
    """
    equations = [entry for entry in entries if entry.no.isdigit()]
    jumps = " ".join(f"{{ref}}`{entry.no} <equation-{entry.no}>`" for entry in equations)
    sections = [_index_section(entry, bool(effects.get(entry.no)), labelled) for entry in equations]
    return "\n".join([f"**Eq.** {jumps}", "", *sections])


def errata_page(
    entries: Sequence[Entry],
    effects: Mapping[str, Sequence[Effect]],
    labelled: Collection[str] = (),
) -> str:
    """The errata, as MyST Markdown, in the three `PARTS`: every entry that is not as printed, or
    whose printed form has an effect.
    """
    lines = list[str]()
    for status, (title, meaning) in PARTS.items():
        of_status = [
            entry
            for entry in entries
            if entry.status == status and (status != "as printed" or effects.get(entry.no))
        ]
        if of_status:
            jumps = ", ".join(f"{{ref}}`{entry.name} <{entry.label}>`" for entry in of_status)
            lines += [f"## {title}", "", f"{meaning} {jumps}.", ""]
            lines += [_erratum(entry, effects.get(entry.no, ()), labelled) for entry in of_status]
    return "\n".join(lines)


def write_pages(
    folder: Path, effects: Mapping[str, Sequence[Effect]], labelled: Collection[str] = ()
) -> None:
    """Write ``equations.md`` and ``errata.md`` into a folder, made if need be; the pages of the
    book include them.
    """
    entries = load_ledger()
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in (("errata", errata_page), ("equations", index_page)):
        (folder / f"{name}.md").write_text(page(entries, effects, labelled), encoding="utf-8")


def _entry(row: Any, where: str) -> Entry:
    names = tuple(Entry.__dataclass_fields__)
    fields = {name: get(row, name, where) for name in names}
    if unknown := sorted(set(row) - set(names)):
        raise ValueError(f"{where}: '{unknown[0]}' is not a field of an entry ({', '.join(names)})")
    for name, value in fields.items():
        if name not in ("functions", "tests"):
            _check(isinstance(value, str), value, f"{where}: {name}", "a string")
        else:
            _check(
                isinstance(value, list) and all(isinstance(v, str) for v in value),
                value,
                f"{where}: {name}",
                "a list of strings",
            )
            fields[name] = tuple(value)
    return Entry(**fields)


def _check(good: bool, value: Any, where: str, wanted: str) -> None:
    if not good:
        raise ValueError(f"{where}: expected {wanted}, got {value!r}")


def _index_section(entry: Entry, has_effect: bool, labelled: Collection[str]) -> str:
    status = f"{{ref}}`{entry.status} <{entry.label}>`" if has_effect else entry.status
    remark = "; here corrected" if entry.corrected else ""
    functions = ", ".join(
        f"{{py:obj}}`{'.'.join(name.split('.')[-2:])} <{name}>`" for name in entry.functions
    )
    return "\n".join(
        [
            f"(equation-{entry.no})=",
            f"## {entry.name}",
            "",
            f"Sect. {entry.section}, {status}{remark}; derived in {_chapter_link(entry, labelled)}.",
            "",
            *_formula(entry.corrected or entry.printed, entry.no),
            f"Computed by {functions}. Tested by",
            "",
            "```sh",
            "pytest " + " \\\n    ".join(entry.tests),
            "```",
            "",
        ]
    )


def _chapter_link(entry: Entry, labelled: Collection[str]) -> str:
    """To the equation itself where the chapter has a label for it, else to the chapter."""
    chapter = f"chapter {int(entry.chapter[:2])}"
    label = f"eq-{entry.no}"
    if label in labelled:
        return f"{{ref}}`{chapter} <{label}>`"
    return f"{{doc}}`{chapter} </notebooks/{entry.chapter}>`"


def _formula(tex: str, no: str) -> list[str]:
    """A display with the paper's number; in $$ several lines would be put into an environment that
    takes no tag.
    """
    tag = f" \\tag{{{no}}}" if no.isdigit() else ""
    return [f"\\begin{{equation*}}\n{tex.strip()}{tag}\n\\end{{equation*}}", ""]


def _erratum(entry: Entry, effects: Sequence[Effect], labelled: Collection[str]) -> str:
    lines = [f"({entry.label})=", f"### {entry.name}", ""]
    where = f"*Sect. {entry.section}.* " if entry.no.isdigit() else ""
    lines += [where + entry.what, ""]
    for title, tex in (("As printed:", entry.printed), ("As we use it:", entry.corrected)):
        if tex:
            lines += [title, "", *_formula(tex, entry.no)]
    if effects:
        lines += ["What it does:", "", *map(effect_item, effects)]
    links = _chapter_link(entry, labelled)
    if entry.no.isdigit():
        links += f"; {{ref}}`functions and tests <equation-{entry.no}>`"
    return "\n".join([*lines, "", f"In the book: {links}.", ""])


def effect_item(effect: Effect) -> str:
    """An effect as an item of a list, which a narrow screen has room for."""
    unit = f" {effect.unit}" if effect.unit else ""
    printed, corrected = number_text(effect.printed), number_text(effect.corrected)
    return (
        f"- {effect.meaning}: **{printed}**{unit} as printed, {corrected}{unit} as corrected; it must be "
        f"{_wanted(effect)}."
    )


def number_text(value: float) -> str:
    """A number with three digits for a table; what is left of a zero by rounding is a zero."""
    if math.isnan(value):
        return "undefined"
    if math.isinf(value):
        return "infinite"
    if abs(value) < ROUNDING:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _wanted(effect: Effect) -> str:
    low = number_text(effect.at_least)
    high = number_text(effect.at_most)
    if math.isinf(effect.at_most):
        return f"at least {low}"
    if math.isinf(effect.at_least):
        return high if high == "0" else f"at most {high}"
    return low if low == high else f"{low} to {high}"
