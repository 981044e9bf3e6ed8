"""The sheet: a page that carries all that it shows, a table of the numbers, and the same as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trinolab.datasets import load_sweep
from trinolab.files.inputs import read_json
from trinolab.methods import BEST

from ..studies.second_renderer import side_by_side
from ..studies.stress import by_fault
from .numbers import OWN, Answer, Number, Picture, as_table

__all__ = [
    "AFTER",
    "CRIME",
    "GLANCE",
    "NUMBERS",
    "PAGE",
    "TABLE",
    "Sheet",
    "as_json",
    "as_page",
    "contents",
    "digits",
    "figure_html",
    "interval_text",
    "numbers_table",
    "read_sheet",
    "readable",
    "value_text",
]

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
# What is shown at the top: test, quantity, statistic, and what a reader would call it.
GLANCE = (
    ("A1", "jitter, position", "rms", "Jitter at rest"),
    ("A1", "jitter, rotation", "rms", ""),
    ("A2", "position error", "rms", "Static error"),
    ("A2", "position error", "95 %", ""),
    ("A2", "angle error", "rms", ""),
    ("A2", "poses measured", "share", ""),
    ("A3", "bar's length at 0.5 m/s", "rms", "In motion"),
    ("A4", "tip held at one point, scatter", "rms", "Pointer"),
    ("A5", "age of a pose when it is there", "median", "Latency"),
    ("A6", "measured, of the possible instants", "share", "Availability"),
    ("A6", "measured, of all instants", "share", ""),
    ("A7", "five poses, repeatability", "worst pose", "Arm"),
)


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
    found = {
        "format": FORMAT,
        "about": sheet.about,
        "after": AFTER,
        "limits": CRIME,
        "notes": {name: answer.notes for name, answer in sorted(sheet.answers.items())},
        "left_out": sheet.left_out,
        "numbers": [_plain(asdict(number)) for number in sheet.numbers],
    }
    return json.dumps(found, indent=1, ensure_ascii=False) + "\n"


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """A number's fields for JSON, which has no NaN; empty ones are left out."""
    kept = {}
    for name, value in row.items():
        if isinstance(value, float):
            value = float(f"{value:.6g}") if np.isfinite(value) else None
        if value is not None and (value != "" or name == "unit"):
            kept[name] = value
    return kept


def read_sheet(path: str | Path) -> tuple[dict[str, Any], list[Number]]:
    """Read a sheet's JSON: what it says of itself, and its numbers.

    Raises
    ------
    ValueError
        Names the file that cannot be read, or that is no sheet.
    """
    found = read_json(path)
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise ValueError(f"{path}: expected a sheet of format {FORMAT}")
    try:
        return found["about"], [Number(**row) for row in found["numbers"]]
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: expected the numbers of a sheet ({error})") from None


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
            number.interval or number.note,
        )
        for number in numbers
    ]
    columns = ["what", "statistic", "value", "95 %", "n", "seed", "interval by, or note"]
    return pd.DataFrame(rows, columns=columns)


# --- the page

_STYLE = """
:root { color-scheme: light dark; --line: #ccc; --soft: #555; --card: #f4f6f8; --link: #0b5cad }
@media (prefers-color-scheme: dark) {
  :root { --line: #444; --soft: #aaa; --card: #1d2126; --link: #7ab8ff }
  body { background: #121417; color: #e8e8e8 }
}
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 60rem; padding: 1rem }
h1 { font-size: 1.6rem; line-height: 1.2; margin: .5rem 0 }
h2 { font-size: 1.25rem; margin: 2.2rem 0 .4rem; border-top: 1px solid var(--line);
     padding-top: 1rem }
p, li { max-width: 46rem }
a { color: var(--link) }
table { border-collapse: collapse; width: 100%; font-size: .9rem; margin: .8rem 0 }
th, td { text-align: left; padding: .22rem .5rem .22rem 0; vertical-align: top;
         border-bottom: 1px solid var(--line) }
th { font-weight: 600 }
.conditions td { overflow-wrap: anywhere }
td.number { white-space: nowrap; font-variant-numeric: tabular-nums }
small, .soft { color: var(--soft) }
.wide { overflow-x: auto }
.card { background: var(--card); padding: .6rem .9rem; border-radius: .4rem; margin: 1rem 0 }
.figures { display: flex; flex-wrap: wrap; gap: .8rem; margin: .8rem 0 }
figure { margin: 0; max-width: 100% }
figure img { background: #fff; border-radius: .3rem; width: 360px; max-width: 100%; height: auto;
             display: block }
figcaption { color: var(--soft); font-size: .85rem; line-height: 1.35; width: 360px;
             max-width: 100% }
nav { display: flex; flex-wrap: wrap; gap: 0 .8rem }
"""


def as_page(sheet: Sheet) -> str:
    """The page, whole in one file: no script, no address that a browser would load."""
    title = f"Data sheet: {sheet.about['rig']}, {sheet.about['handle']}"
    names = sorted(sheet.titles)
    links = [*names, "A8", "other renderer", "limits"]
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="soft">{escape(sheet.about["summary"])}</p>',
        "<nav>" + "".join(f'<a href="#{_anchor(name)}">{name}</a>' for name in links) + "</nav>",
        _glance(sheet.numbers),
        f'<div class="card"><p><strong>What these numbers are.</strong> {escape(CRIME)}</p>'
        f"<p>{escape(AFTER)}</p></div>",
        _conditions(sheet.about),
        *(_test(sheet, name) for name in names),
        _chart(sheet.charts),
        _second(),
        _limits(),
        _reading(),
    ]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _anchor(name: str) -> str:
    return name.replace(" ", "-")


def _glance(numbers: Sequence[Number]) -> str:
    """The few numbers that most readers look for."""
    by_name: dict[tuple[str, str, str], Number] = {}
    for number in numbers:  # of a rig's own recordings there may be several: the first
        by_name.setdefault((number.test, number.what, number.statistic), number)
    rows = []
    called = ""
    for test, what, statistic, name in GLANCE:
        called = name or called
        found = by_name.get((test, what, statistic))
        if found is None:
            continue
        rows.append(
            f'<tr><td><a href="#{test}">{escape(called)}</a></td>'
            f"<td>{escape(what)}, {escape(statistic)}</td>"
            f'<td class="number">{value_text(found)}<br><small>{interval_text(found)}</small></td></tr>'
        )
    return f'<div class="wide"><table>{"".join(rows)}</table></div>'


def _conditions(about: Mapping[str, Any]) -> str:
    rows = [
        f"<tr><th>{escape(str(name))}</th><td>{escape(str(value))}</td></tr>"
        for name, value in about.items()
        if name != "summary"
    ]
    return f'<h2>Conditions</h2><table class="conditions">{"".join(rows)}</table>'


def _test(sheet: Sheet, name: str) -> str:
    head = f'<h2 id="{name}">{name} {escape(sheet.titles[name])}</h2>'
    if name not in sheet.answers:
        return f"{head}<p>Not run: {escape(sheet.left_out.get(name, 'nothing was measured'))}.</p>"
    answer = sheet.answers[name]
    notes = "".join(f"<p>{escape(note)}</p>" for note in answer.notes)
    figures = "".join(figure_html(picture) for picture in answer.pictures)
    return f'{head}{notes}<div class="figures">{figures}</div>{numbers_table(answer.numbers)}'


def figure_html(picture: Picture) -> str:
    """A picture as a piece of a page that carries it."""
    return (
        f'<figure><img alt="{escape(picture.alt, quote=True)}" '
        f'src="data:image/png;base64,{base64.b64encode(picture.png).decode("ascii")}">'
        f'<figcaption aria-hidden="true">{escape(picture.alt)}</figcaption></figure>'
    )


def numbers_table(numbers: Sequence[Number]) -> str:
    """A table of four columns: what, statistic, value with its interval, n; notes below a row."""
    rows = []
    for (what, source), group in groupby(numbers, key=lambda one: (one.what, one.source)):
        lines = list(group)
        for k, number in enumerate(lines):
            note = f"<br><small>{escape(number.note)}</small>" if number.note else ""
            by = "" if source == OWN else f"<br><small>{escape(source)}</small>"
            first = f'<td rowspan="{len(lines)}">{escape(what)}{by}</td>' if k == 0 else ""
            rows.append(
                f"<tr>{first}<td>{escape(number.statistic)}{note}</td>"
                f'<td class="number">{value_text(number)}<br><small>{interval_text(number)}</small></td>'
                f'<td class="number">{number.n}</td></tr>'
            )
    if not rows:
        return ""
    head = "<tr><th>what</th><th>statistic</th><th>value <small>95 %</small></th><th>n</th></tr>"
    methods = sorted({number.interval for number in numbers if number.interval})
    how = f"<p><small>Intervals: {escape('; '.join(methods))}.</small></p>" if methods else ""
    return f'<div class="wide"><table>{head}{"".join(rows)}</table></div>{how}'


def value_text(number: Number) -> str:
    """A number's value with its unit."""
    if number.statistic == "count":
        return f"{number.value:.0f} {escape(number.unit)}".strip()
    return f"{digits(number.value)} {escape(number.unit)}".strip()


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


def _chart(charts: Sequence[Picture]) -> str:
    head = '<h2 id="A8">A8 Control chart</h2>'
    if not charts:
        return f"{head}<p>No chart was named (<code>--chart</code>).</p>"
    figures = "".join(map(figure_html, charts))
    return (
        f"{head}<p>The same poses and the same noise at each commit: two dots differ by the code "
        "alone. The band is the interval of the first one, in which another draw would lie as "
        f'well.</p><div class="figures">{figures}</div>'
    )


def _second() -> str:
    table = side_by_side(load_sweep("second_renderer"))
    return (
        '<h2 id="other-renderer">On images of another renderer</h2>'
        "<p>Measured on images of a path tracer that shares no line and no model with the own "
        "bench: a lens that focuses, varnish, interreflection, textured lamps. Beside it "
        "(<em>own</em>) the own bench at the same poses. Means of the errors; <em>by sigma</em> is "
        "the root mean square of error by reported sigma, which is 1 where the sigma is honest. "
        "Rigs and handles are those of the table, not necessarily the ones of this sheet.</p>"
        f"{_table(table)}"
    )


def _limits() -> str:
    table = load_sweep("stress")
    parts = [
        f"<h3>{escape(title)}</h3>{_table(by_fault(table, rig, BEST))}"
        for rig, title in (("paper_pair", "Two cameras"), ("raised_40deg", "Three cameras"))
    ]
    return (
        '<h2 id="limits">Limits</h2>'
        "<p>The own bench was broken on purpose, one thing at a time, while rig and handle file said "
        "what they had said before. Both shipped handles together, by the estimator of this "
        "sheet. A pose is <em>wrong</em> if it was called measured and is more than 2 mm or 5 deg "
        "off, <em>unforeseen</em> if that is more than five of its own sigmas as well; "
        "<em>wrong, at most</em> is the upper 95 % bound of their share. What shows in an image is "
        "borne or refused. What is wrong with where and when the cameras look is not: it moves depth "
        "along the epipolar lines, where two cameras agree on the wrong place. <em>Stated</em>: the "
        "rig file says how far off it may be, as a calibration does.</p>" + "".join(parts)
    )


def _table(table: pd.DataFrame) -> str:
    names = "".join(f"<th>{escape(str(name))}</th>" for name in table)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(_cell(value))}</td>" for value in row) + "</tr>"
        for row in table.itertuples(index=False)
    )
    return f'<div class="wide"><table><tr>{names}</tr>{rows}</table></div>'


def _cell(value: Any) -> str:
    return digits(value) if isinstance(value, float) else str(value)


def _reading() -> str:
    return (
        "<h2>How to read it</h2><ul>"
        "<li>An interval holds the number with 95 % confidence if the poses were drawn anew; it "
        "says nothing of what a model leaves out.</li>"
        "<li>A rigid registration takes away what a fixed mounting would. Where that makes the "
        "error much smaller, the rig's place was wrong and not its shape.</li>"
        "<li>A mean says what to expect, 95 % what to design for, the largest what has happened "
        "once in n.</li>"
        "<li>An error counts for nothing without the share that was measured: who refuses the "
        "hard poses has small errors.</li></ul>"
    )
