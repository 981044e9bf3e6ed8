"""What a run of a sweep gives: results, time, status; and the table of all runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

OK = "ok"
FAILED = "failed"
NO_NUMBER = "no number"
LAST_COLUMNS = ("seconds", "status", "error")


class Outcome(NamedTuple):
    """What one run gave.

    Attributes
    ----------
    results : dict
        Numbers and words by name; arrays and the like are left out.
    seconds : float
        Wall time.
    status : str
        ``ok``; ``failed`` (it raised); ``no number`` (it gave no number at all, or something that
        is neither a number nor a text).
    error : str
        One line: what was raised, or which result is no number.
    notebook : str
        The executed notebook, where it is to be kept; else empty.
    """

    results: dict[str, float | str]
    seconds: float
    status: str
    error: str
    notebook: str = ""


def call(function: Callable[..., Any], values: Mapping[str, Any]) -> Outcome:
    """Run a function once. What it returns are its results: a mapping, a dataclass, a named tuple,
    or a number.
    """
    start = time.perf_counter()
    try:
        returned = function(**values)
    except (Exception, SystemExit) as error:
        return failed(error, time.perf_counter() - start)
    return finished(_named(returned), time.perf_counter() - start)


def each(
    run: Callable[[Mapping[str, Any]], Outcome], settings: Sequence[Mapping[str, Any]]
) -> list[Outcome]:
    """The outcomes of several runs, one after the other."""
    return [run(setting) for setting in settings]


def finished(results: Mapping[str, Any], seconds: float, notebook: str = "") -> Outcome:
    """The outcome of a run that has come to its end."""
    plain = {str(name): as_plain(value) for name, value in results.items()}
    kept = {name: value for name, value in plain.items() if value is not None}
    has_number = any(not isinstance(value, str) for value in kept.values())
    wrong = [
        f"{name} is no number: {_one_line(repr(value))}"
        for name, value in results.items()
        if plain[str(name)] is None or not has_number
    ]
    if not results:
        wrong = ["no result: nothing is glued"]
    return Outcome(kept, seconds, NO_NUMBER if wrong else OK, "; ".join(wrong), notebook)


def failed(error: BaseException | str, seconds: float, notebook: str = "") -> Outcome:
    """The outcome of a run that raised."""
    text = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
    return Outcome({}, seconds, FAILED, _one_line(text), notebook)


def table(
    names: Sequence[str], settings: Sequence[Mapping[str, Any]], outcomes: Mapping[int, Outcome]
) -> pd.DataFrame:
    """The tidy table of a sweep, a row for each outcome, in the order of the runs.

    Columns: the parameters `names`; the results in the order in which they first come, NaN where a
    run has none (a result named like another column is renamed ``..._result``); `LAST_COLUMNS`.
    ``attrs`` holds the parameters' names.
    """
    import pandas as pd

    rows = [(settings[k], outcomes[k]) for k in sorted(outcomes)]
    results = dict.fromkeys(name for _, outcome in rows for name in outcome.results)
    columns = {name: [values[name] for values, _ in rows] for name in names}
    for name in results:
        column = f"{name}_result" if name in (*names, *LAST_COLUMNS) else name
        columns[column] = [outcome.results.get(name, np.nan) for _, outcome in rows]
    for name in LAST_COLUMNS:
        columns[name] = [getattr(outcome, name) for _, outcome in rows]
    frame = pd.DataFrame(columns)
    frame.attrs["parameters"] = list(names)
    return frame


def as_plain(value: Any) -> float | str | None:
    """A Python number, 1 and 0 for True and False; a text in one line; None for anything else."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool):
        return int(value)
    if type(value) is str:  # and not what is displayed of another object
        return _one_line(value)
    return value if isinstance(value, (int, float)) else None


def _named(returned: Any) -> dict[str, Any]:
    if isinstance(returned, Mapping):
        return {str(name): value for name, value in returned.items()}
    if is_dataclass(returned) and not isinstance(returned, type):
        return {field.name: getattr(returned, field.name) for field in fields(returned)}
    return returned._asdict() if hasattr(returned, "_asdict") else {"result": returned}


def _one_line(text: str, longest: int = 300) -> str:
    line = " ".join(text.split())
    return line if len(line) <= longest else f"{line[: longest - 3]}..."
