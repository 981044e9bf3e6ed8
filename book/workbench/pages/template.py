"""Pages as Jinja templates over ``_build/generated/numbers.json``. A Sphinx extension.

Each page of ``book`` is a template, whose names are those of `workbench.pages.numbers`. A name that is not
there stops the build.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from ..cli import digits
from ..course.exam import exam

NUMBERS = Path("_build", "generated", "numbers.json")  # below the folder of the pages
SIGNS = {"match": "✓ ", "met": "✓ ", "differs": "✗ "}


class Missing(StrictUndefined):
    """A name that is not there; in a format as well it is the error that says so."""

    __format__ = StrictUndefined._fail_with_undefined_error  # type: ignore[assignment]


def setup(app: Any) -> dict[str, bool]:
    """Connect the extension to Sphinx."""
    app.connect("source-read", render_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def render_page(app: Any, docname: str, source: list[str]) -> None:
    """Put the numbers into a page of ``book``; notebooks are no templates."""
    from sphinx.errors import ExtensionError

    path = Path(app.env.doc2path(docname))
    if docname.startswith("book/") and path.suffix == ".md":
        try:
            source[0] = render(source[0], _read(Path(app.srcdir) / NUMBERS))
        except (TemplateError, OSError) as error:
            raise ExtensionError(f"{path}: {error}") from error


def render(text: str, numbers: dict[str, Any]) -> str:
    """Text of a template with its numbers."""
    return environment().from_string(text).render(numbers)


@cache
def environment() -> Environment:
    """Templates with the filters below; ``{#-`` begins a comment, since ``{#`` begins an anchor of MyST."""
    made = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=Missing,
        trim_blocks=True,
        lstrip_blocks=True,
        comment_start_string="{#-",
        comment_end_string="-#}",
    )
    filters = (assumption, claim, digits, escaped, interval, placed, sampled, signed, value)
    made.filters.update({one.__name__: one for one in filters})
    made.globals["exam"] = exam
    return made


@cache
def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def assumption(name: str) -> str:
    """An assumption's name as a link."""
    return f"[{name}](assumptions.md#{name.lower()})"


def claim(no: str) -> str:
    """A claim's number as a link to its row of the scoreboard."""
    return f"{{ref}}`{no} <claim-{no}>`"


def escaped(text: str) -> str:
    """Text in which no character is markup that a sentence can have by chance."""
    return text.replace("_", "\\_").replace("^", "\\^").replace("[", "\\[").replace("]", "\\]")


def interval(row: dict[str, Any]) -> str:
    """The interval of a row, in parentheses; "" without one."""
    if row["low"] is None:
        return ""
    return f" ({digits(row['low'])} to {digits(row['high'])})"


def placed(no: str, anchor: str) -> str:
    """A row's number as a place to link to, and a link to the other page that has the row."""
    other = {"claim": "criterion", "criterion": "claim"}[anchor]
    return f"[{{ref}}`{no} <{other}-{no}>`]{{#{anchor}-{no}}}"


def sampled(row: dict[str, Any]) -> str:
    """How many draws a row has, and from which seed."""
    if row["n"] is None:
        return "nothing drawn"
    return f"n {row['n']:.0f}" + (f", seed {row['seed']}" if row["seed"] else "")


def signed(verdict: str) -> str:
    """A verdict behind its sign, which is seen before the word is read."""
    return SIGNS.get(verdict, "") + verdict


def value(row: dict[str, Any]) -> str:
    """A row's value with its unit, which a share and a ratio have none of, and its interval."""
    if row["ours"] is None:
        return "no number"
    unit = "" if row["unit"] in ("", "share", "ratio") else f" {row['unit']}"
    return f"{digits(row['ours'])}{unit}{interval(row)}"
