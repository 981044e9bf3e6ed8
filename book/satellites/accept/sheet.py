"""The sheet: a page that carries all that it shows, a table of the numbers, and the same as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader

from trinolab.datasets import load_sweep
from trinolab.files.inputs import read_json
from trinolab.methods import BEST
from workbench.studies.instant_times import by_film
from workbench.studies.second_renderer import side_by_side
from workbench.studies.stress import by_fault

from .numbers import LARGEST, OWN, Answer, Number, Picture, as_table

FORMAT = 1
PAGE, TABLE, NUMBERS = "index.html", "numbers.csv", "sheet.json"
AFTER = (
    "The tests are laid out after ASTM E2919 (static poses), ASTM F2554 (a pointer's tip), the "
    "withdrawn ASTM E3064 (a bar in motion), ISO 9283 (an arm's poses and paths) and Wiles, "
    "Thompson and Frantz 2004 (optical tracking systems, Proc. SPIE 5367, DOI 10.1117/12.536128). "
    "Their texts were not followed, and conformity with none of them is claimed."
)
CRIME = (
    "Numbers whose source is the own bench were measured on images drawn by this project's own "
    "renderer. It and the measurement share no code but cameras and handle, but both assume the "
    "same optics: sharp edges behind a Gaussian blur, matt surfaces, an exact rig and handle. These "
    "numbers are what the software adds under its own assumptions, the least that a real bench can "
    "show, and no promise of what it will show: there the errors of the calibration, of the "
    "markers' places and of the lens come on top, and usually decide."
)
# Under which conditions the numbers hold, and what was not varied.
RATED = (
    ("calibration", "as stated in A0; rigid since then, and at the temperature of it"),
    ("light", "markers of 220, body of 90, background of 45 grey levels of 255, none saturated"),
    ("image noise", "variance 0.05 x grey + 1.5^2 grey levels^2, white"),
    ("exposure", "10 ms in motion, all cameras together; none at rest"),
    ("speed", "up to 1 m/s without a turn (A3); a person's motion (A6)"),
    (
        "field",
        "all that all cameras see in common, from where a marker is twice as large as it has to be",
    ),
    ("not varied", "temperature, warm-up, vibration, flicker, focus, the lens over time"),
)
# What standards ask for that needs a physical reference.
NOT_APPLICABLE = (
    (
        "ASTM E2919",
        "a reference system with an uncertainty of its own: the true pose is exact here",
    ),
    ("ASTM F2554", "a calibrated artefact: the distances are exact here"),
    ("ISO 10360-13", "sphere spacing, flatness and probing of a calibrated ball bar"),
    ("ISO 14253-1", "a maximum permissible error and a rule of decision: nothing is sold here"),
)
# What is shown at the top: test, quantity, statistic, and what a reader would call it. First what a
# user gets, then how late; what the software alone adds comes below.
GLANCE = (
    ("A0", "depth: expanded, U = 2 u", "rms", "With a calibration of your own"),
    ("A0", "across: expanded, U = 2 u", "rms", ""),
    ("A0", "rotation: expanded, U = 2 u", "rms", ""),
    ("A5", "age of a pose when it is there", "median", "Latency"),
    ("A5", "age of a pose when it is there", "99 %", ""),
    ("A5", "age of a pose when it is there", LARGEST, ""),
    ("A6", "measured, of the possible instants", "share", "Availability"),
    ("A6", "measured, of all instants", "share", ""),
    ("A3", "relative position at 0.5 m/s", "rms", "In motion, exact files"),
    ("A3", "bar's length at 0.5 m/s", "rms", ""),
    ("A2", "position error", "rms", "The floor: static, exact files"),
    ("A2", "position error", "95 %", ""),
    ("A2", "angle error", "rms", ""),
    ("A2", "poses measured", "share", ""),
    ("A1", "jitter, position", "rms", "Jitter at rest"),
    ("A1", "jitter, rotation", "rms", ""),
    ("A4", "tip held at one point, scatter", "rms", "Pointer, exact files"),
    ("A7", "five poses, repeatability", "worst pose", "Arm"),
)
# Of the numbers in motion a page shows these; the table of numbers has all.
SPEEDS_SHOWN = ("at 0.1 m/s", "at 0.5 m/s")


@dataclass
class Sheet:
    """All that a sheet says.

    Attributes
    ----------
    about : dict
        Rig, handle, size, seed, code, computer: names and texts.
    answers : dict
        Of each test that was run, by its name.
    titles : dict
        Of every test.
    left_out : dict
        Why a test was not run, by its name.
    charts : list of Picture
        The control charts, if there are any.
    """

    about: dict[str, Any]
    answers: dict[str, Answer]
    titles: dict[str, str]
    left_out: dict[str, str] = field(default_factory=dict)
    charts: list[Picture] = field(default_factory=list)

    @property
    def numbers(self) -> list[Number]:
        """Of all tests, in their order."""
        return [number for name in sorted(self.answers) for number in self.answers[name].numbers]


def contents(sheet: Sheet) -> dict[str, str]:
    """What the files of a sheet say, by their names."""
    table = as_table(sheet.numbers)
    return {
        TABLE: table.to_csv(index=False, float_format="%.6g", lineterminator="\n"),
        NUMBERS: as_json(sheet),
        PAGE: as_page(sheet),
    }


def as_json(sheet: Sheet) -> str:
    """The numbers and notes; what is no number is null."""
    content = {
        "format": FORMAT,
        "about": sheet.about,
        "after": AFTER,
        "limits": CRIME,
        "notes": {name: answer.notes for name, answer in sorted(sheet.answers.items())},
        "left_out": sheet.left_out,
        "numbers": [plain_row(asdict(number)) for number in sheet.numbers],
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def plain_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """A number's fields for JSON, which has no NaN; empty ones are left out."""
    fields = {}
    for name, value in row.items():
        if isinstance(value, float):
            value = float(f"{value:.6g}") if np.isfinite(value) else None
        if value is not None and (value != "" or name == "unit"):
            fields[name] = value
    return fields


def read_sheet(path: str | Path) -> tuple[dict[str, Any], list[Number]]:
    """Read a sheet's JSON: what it says of itself, and its numbers.

    Raises
    ------
    ValueError
        Names the file that cannot be read, or that is no sheet.
    """
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"{path}: expected a sheet of format {FORMAT}")
    try:
        return content["about"], [Number(**row) for row in content["numbers"]]
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: expected the numbers of a sheet ({error})") from None


def shown(numbers: Sequence[Number]) -> list[Number]:
    """The numbers that a page shows: in motion, at two speeds, the share and the root mean squares."""
    return [
        number
        for number in numbers
        if number.test != "A3"
        or number.statistic == "count"
        or (number.statistic in ("share", "rms") and number.what.endswith(SPEEDS_SHOWN))
    ]


def readable(numbers: Sequence[Number]) -> pd.DataFrame:
    """Numbers as a table of texts for a reader: what, statistic, value, interval, n, seed."""
    rows = [
        (
            number.what,
            number.statistic,
            value_text(number),
            interval_text(number),
            number.n,
            "" if number.seed is None else number.seed,
            "; ".join(filter(None, (number.note, number.interval))),
        )
        for number in numbers
    ]
    columns = ["what", "statistic", "value", "95 %", "n", "seed", "note; interval by"]
    return pd.DataFrame(rows, columns=columns)


# --- the page, of which the template ``sheet.html.j2`` has the words


def as_page(sheet: Sheet) -> str:
    """The page, whole in one file: no script, no address that a browser would load."""
    return (
        _template()
        .render(
            sheet=sheet,
            title=f"Data sheet: {sheet.about['rig']}, {sheet.about['handle']}",
            links=[*sorted(sheet.titles), "A8", "other renderer", "limits"],
            glance=list(glance(sheet.numbers)),
            films=by_film(load_sweep("instant_films")),
            crime=CRIME,
            after=AFTER,
            rated=RATED,
            not_applicable=NOT_APPLICABLE,
            second=side_by_side(load_sweep("second_renderer")),
            limits=[
                (title, by_fault(load_sweep("stress"), rig, BEST))
                for rig, title in (("paper_pair", "Two cameras"), ("raised_40deg", "Three cameras"))
            ],
        )
        .lstrip()
    )


def figure_html(picture: Picture) -> str:
    """A picture as a piece of a page that carries it."""
    return str(_template().module.figure(picture)).strip()


def numbers_table(numbers: Sequence[Number]) -> str:
    """A table of four columns: what, statistic, value with its interval, n; notes below a row."""
    return str(_template().module.numbers_table(numbers)).strip()


@cache
def _template() -> Any:
    """The template of the page; its macros are those of `figure_html` and `numbers_table`."""
    folder = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=folder, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {
        "base64": lambda content: base64.b64encode(content).decode("ascii"),
        "by_quantity": _by_quantity,
        "cell_text": lambda cell: digits(cell) if isinstance(cell, float) else str(cell),
        "interval_text": interval_text,
        "shown": shown,
        "value_text": value_text,
    }
    return environment.get_template("sheet.html.j2", globals={"own": OWN})


def _by_quantity(numbers: Sequence[Number]) -> list[tuple[tuple[str, str], list[Number]]]:
    """Numbers that follow one another and are of one quantity and one source."""
    groups = groupby(numbers, key=lambda number: (number.what, number.source))
    return [(quantity, list(group)) for quantity, group in groups]


def glance(numbers: Sequence[Number]) -> Iterator[tuple[str, str, str, Number]]:
    """The few numbers that most readers look for: test, what a reader calls it, quantity, number."""
    by_name: dict[tuple[str, str, str], Number] = {}
    for number in numbers:  # of a rig's own recordings there may be several: the first
        by_name.setdefault((number.test, number.what, number.statistic), number)
    called = ""
    for test, what, statistic, name in GLANCE:
        called = name or called
        if (test, what, statistic) in by_name:
            yield test, called, f"{what}, {statistic}", by_name[test, what, statistic]


def value_text(number: Number) -> str:
    """A number's value with its unit."""
    if number.statistic == "count":
        return f"{number.value:.0f} {number.unit}".strip()
    return f"{digits(number.value)} {number.unit}".strip()


def interval_text(number: Number) -> str:
    """Its interval; empty if it has none."""
    if np.isfinite(number.low) and np.isfinite(number.high):
        return f"{digits(number.low)} to {digits(number.high)}"
    if np.isfinite(number.low):
        return f"from {digits(number.low)}"
    return f"to {digits(number.high)}" if np.isfinite(number.high) else ""


def digits(value: float) -> str:
    """Three digits, without powers of ten where that can be."""
    if not np.isfinite(value):
        return ""
    return np.format_float_positional(value, precision=3, fractional=False, trim="-")
