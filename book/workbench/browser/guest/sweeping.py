"""A chapter at many values of a parameter, run after run in a session in the reader's browser.

The page writes what `workbench.browser.sweeps` has made of the chapter into ``/tmp/sweep.json``. As
in a kernel (`workbench.sweep.warmkernel`) the part that no swept value reaches runs once, and each
run begins with copies of what it has left. Numbers and figures are those of `workbench.sweep`.
"""

from __future__ import annotations

import base64
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

from ...sweep import figures, outcome
from ...sweep.kernelstate import Kept
from ...sweep.notebook import assignments
from . import door, session

__all__ = ["draw", "prepare", "run"]

SWEEP = Path("/tmp/sweep.json")
ROWS = Path("/tmp/rows.json")
SHOWN = 6  # results that have a panel and a column; all are in the file

_sweep: dict[str, Any] = {}
_held = Kept({})
_glued: dict[str, Any] = {}
_glued_once: dict[str, Any] = {}


def prepare() -> None:
    """Run what runs once."""
    _sweep.update(json.loads(SWEEP.read_text()))
    sys.modules["myst_nb"].__dict__["glue"] = _glue
    _begin()
    for source in _sweep["once"]:
        exec(source, session.namespace)
    global _held
    names = [name for name in _sweep["held"] if name in session.namespace]
    _held = Kept({name: session.namespace[name] for name in names})
    _glued_once.update(_glued)


def run(value: Any) -> None:
    """Run the rest at a value, and hand out what it gave."""
    parameter = _sweep["parameter"]
    given = assignments(_sweep["defaults"], {parameter: value}, _sweep["chapter"])
    _begin()
    _glued.update(_glued_once)
    session.namespace.update(_held.copies())
    start = time.perf_counter()
    cell = 0
    try:
        for cell, source in enumerate(_sweep["each"], start=1):
            exec(source, session.namespace)
            if cell == _sweep["parameters"]:
                exec("\n".join(given), session.namespace)
        # what it says in words is for its readers
        numbers = {name: it for name, it in _glued.items() if not isinstance(it, str)}
        result = outcome.finished(numbers, time.perf_counter() - start)
    except Exception as error:
        why = f"{type(error).__name__}: {error} (code cell {cell})"
        result = outcome.failed(why, time.perf_counter() - start)
    finally:
        session.close_figures()
    finished_run = result._asdict() | {"results": _finite(result.results)}
    _hand_out({"type": "run", **finished_run})


def draw() -> None:
    """Hand out the figure and the table of the runs that the page has written."""
    runs = json.loads(ROWS.read_text())
    parameter = runs["parameter"]
    settings = [{parameter: row["value"]} for row in runs["rows"]]
    outcomes = {k: _outcome(row["outcome"]) for k, row in enumerate(runs["rows"])}
    found = outcome.table([parameter], settings, outcomes)
    shown = figures.results_of(found, [parameter])[:SHOWN]
    png = figures.as_png(figures.plot_sweep(found, shown or None, [parameter]))
    columns = [parameter, *shown, "seconds", "status"]
    _hand_out(
        {
            "type": "sweep",
            "png": base64.b64encode(png).decode(),
            "alt": f"Curves over {parameter} of {', '.join(shown)}. The table has their numbers.",
            "table": found[columns].to_html(index=False, border=0, float_format="%.4g"),
            "csv": found.to_csv(index=False, lineterminator="\n"),
        }
    )


def _begin() -> None:
    """Empty the session: its dictionary stays, because functions that ran once look into it."""
    session.namespace.clear()
    session.namespace.update({"__name__": "__main__", "__builtins__": __builtins__})
    _glued.clear()


def _glue(name: str, value: Any, display: bool = True) -> None:
    """A glued number is a result here."""
    _glued[name] = value


def _finite(results: dict[str, float]) -> dict[str, float | None]:
    """Results as JSON has them: a number that is none is null."""
    return {name: it if math.isfinite(it) else None for name, it in results.items()}


def _outcome(about: dict[str, Any]) -> outcome.Outcome:
    results = {name: math.nan if it is None else it for name, it in about["results"].items()}
    return outcome.Outcome(results, about["seconds"], about["status"], about["error"])


def _hand_out(output: dict[str, Any]) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    door.ask({"asks": "output", "output": output})
