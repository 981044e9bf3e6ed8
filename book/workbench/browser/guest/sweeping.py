"""A chapter at many values of a parameter, run after run in a session in the reader's browser.

The page writes what `workbench.browser.sweeps` has made of the chapter into ``/tmp/sweep.json``. The
cells tagged ``once`` run once, and each run begins with copies of their variables; where these
cannot be copied, the cells run again. Numbers and figures are those of `workbench.sweep`.
"""

from __future__ import annotations

import base64
import io
import json
import math
import pickle
import sys
import time
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from scipy.spatial.transform import RigidTransform, Rotation

from ...sweep import figures, outcome
from ...sweep.notebook import assignments
from . import door, session

SWEEP = Path("/tmp/sweep.json")
ROWS = Path("/tmp/rows.json")
SHOWN = 6  # results that have a panel and a column; all are in the file
# not copied; a copy of a rotation is normalised anew, and differs in the last digit
SHARED = (ModuleType, FunctionType, type, Rotation, RigidTransform)

_sweep: dict[str, Any] = {}
_state: Copies | None = None
_glued: dict[str, dict[str, Any]] = {}  # by cell


class Copies:
    """Variables of which copies can be had: these share what the variables share."""

    def __init__(self, variables: dict[str, Any]) -> None:
        same: list[Any] = []

        class Pickler(pickle.Pickler):
            def persistent_id(self, obj: Any) -> int | None:
                if not isinstance(obj, SHARED):
                    return None
                same.append(obj)
                return len(same) - 1

        class Unpickler(pickle.Unpickler):
            def persistent_load(self, pid: int) -> Any:
                return same[pid]

        file = io.BytesIO()
        Pickler(file, pickle.HIGHEST_PROTOCOL).dump(variables)
        self._content = file.getvalue()
        self._unpickler = Unpickler

    def load(self) -> dict[str, Any]:
        """Copies of the variables."""
        copies: dict[str, Any] = self._unpickler(io.BytesIO(self._content)).load()
        return copies


def prepare() -> None:
    """Run the cells that run once."""
    _sweep.update(json.loads(SWEEP.read_text()))
    sys.modules["myst_nb"].__dict__["glue"] = _glue
    _run_once()
    global _state
    variables = {name: it for name, it in session.namespace.items() if name[:2] != "__"}
    try:
        _state = Copies(variables)
    except Exception:  # whatever an object's own pickling raises
        _state = None


def run(value: Any) -> None:
    """Run the other cells at a value, and hand out their results."""
    parameter = _sweep["parameter"]
    given = assignments(_sweep["defaults"], {parameter: value}, _sweep["chapter"])
    start = time.perf_counter()
    cell = ""
    try:
        if _state is None:
            _run_once()
        else:
            _empty()
            session.namespace.update(_state.load())
        exec("\n".join(given), session.namespace)
        for cell, source in _sweep["each"].items():
            _run_cell(cell, source)
        by_cell = [_glued[number] for number in sorted(_glued, key=int)]
        values = {name: it for glued in by_cell for name, it in glued.items()}
        result = outcome.finished(values, time.perf_counter() - start)
    except Exception as error:
        why = f"{type(error).__name__}: {error} (code cell {cell})"
        result = outcome.failed(why, time.perf_counter() - start)
    finally:
        session.close_figures()
    finished_run = result._asdict() | {"results": _finite(result.results)}
    _hand_out({"type": "run", **finished_run})


def _run_once() -> None:
    _empty()
    for cell, source in _sweep["once"].items():
        _run_cell(cell, source)


def _run_cell(cell: str, source: str) -> None:
    _glued[cell] = {}
    _current[:] = [cell]
    exec(source, session.namespace)


_current: list[str] = []  # the cell that runs


def draw() -> None:
    """Hand out the figure and the table of the runs that the page has written."""
    runs = json.loads(ROWS.read_text())
    parameter = runs["parameter"]
    settings = [{parameter: row["value"]} for row in runs["rows"]]
    outcomes = {k: _outcome(row["outcome"]) for k, row in enumerate(runs["rows"])}
    found = outcome.table([parameter], settings, outcomes)
    found.attrs["verdicts"] = _sweep["verdicts"]
    shown = figures.results_of(found, [parameter])[:SHOWN]
    png = figures.as_png(figures.plot_sweep(found, shown or None, [parameter]))
    words = [name for name in _sweep["verdicts"] if name in found and name not in shown]
    columns = [parameter, *words, *shown, "seconds", "status"]
    _hand_out(
        {
            "type": "sweep",
            "png": base64.b64encode(png).decode(),
            "alt": f"Curves over {parameter} of {', '.join(shown)}. The table has their numbers.",
            "table": found[columns].to_html(index=False, border=0, float_format="%.4g"),
            "csv": found.to_csv(index=False, lineterminator="\n"),
        }
    )


def _empty() -> None:
    """Empty the session: its dictionary stays, because functions that ran once look into it."""
    session.namespace.clear()
    session.namespace.update({"__name__": "__main__", "__builtins__": __builtins__})


def _glue(name: str, value: Any, display: bool = True) -> None:
    """A glued number is a result here."""
    _glued[_current[0]][name] = value


def _finite(results: dict[str, float | str]) -> dict[str, float | str | None]:
    """Results as JSON has them: a number that is none is null."""
    return {
        name: it if isinstance(it, str) or math.isfinite(it) else None
        for name, it in results.items()
    }


def _outcome(about: dict[str, Any]) -> outcome.Outcome:
    results = {name: math.nan if it is None else it for name, it in about["results"].items()}
    return outcome.Outcome(results, about["seconds"], about["status"], about["error"])


def _hand_out(output: dict[str, Any]) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    door.ask({"asks": "output", "output": output})
