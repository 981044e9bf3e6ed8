"""Whether a notebook that runs by its tags gives what the whole notebook gives.

Names cannot show that an object is changed in place, or that a random generator is advanced, by a
cell that runs at another time or not at all. So two settings are run both ways before a sweep: the
first one, and one drawn at random. Each number that they glue must be the same to the last digit.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from trinolab.files.fetch import cache_folder
from trinolab.files.outputs import write_whole

from ..provenance import hash_text
from .cells import Plan, code_cells, tags_of
from .notebook import glued_in_cell
from .outcome import FAILED, Outcome


class Difference(NamedTuple):
    """A glued value that the two ways give differently; None where one of them does not glue it."""

    name: str
    tagged: Any
    whole: Any


def chosen_settings(settings: Sequence[Mapping[str, Any]], key: str) -> list[int]:
    """The numbers of the settings that are run both ways: the first, and one drawn at random among
    those that differ from it in the most parameters. `key` seeds the draw.
    """
    first = settings[0]
    changes = [sum(one[name] != first[name] for name in first) for one in settings]
    most = max(changes)
    if most == 0:
        return [0]
    others = [number for number, count in enumerate(changes) if count == most]
    return [0, random.Random(key).choice(others)]


def key_of(notebook: Any, made_from: Mapping[str, str], varying: Sequence[str]) -> str:
    """A hash of all that the comparison depends on: the cells with their tags, what they are made
    from, and which parameters vary.
    """
    cells = [(cell.source, tags_of(cell)) for cell in code_cells(notebook)]
    return hash_text(json.dumps([cells, sorted(made_from.items()), sorted(varying)]))


def has_agreed(key: str) -> bool:
    """Whether the comparison was made before, and the two ways agreed."""
    return _record(key).is_file()


def keep_agreed(key: str, about: Mapping[str, Any]) -> None:
    """Keep that the two ways agree, in the user's cache; where that cannot be written, the next
    sweep compares again.
    """
    with suppress(OSError, ValueError):
        _record(key).parent.mkdir(parents=True, exist_ok=True)
        write_whole(_record(key), json.dumps(about, indent=2, default=repr) + "\n")


def check_agreement(plan: Plan, tagged: Outcome, whole: Outcome) -> None:
    """Raise a ValueError if a run by the tags differs from a run of the whole notebook.

    The message names the value and the cells between which the difference arises: from the last
    cell whose values agree to the cell that glues it.

    Parameters
    ----------
    plan : Plan
    tagged, whole : Outcome
        Runs of one setting; the second one with its executed notebook.
    """
    if whole.status == tagged.status == FAILED:
        return
    if FAILED in (whole.status, tagged.status):
        raise ValueError(
            f"the notebook {_ended(tagged)} as tagged, and {_ended(whole)} as a whole; {WAY_OUT}"
        )
    different = difference(tagged, whole)
    if different is None:
        return
    first, last = _between(different.name, tagged, whole)
    suspects = [k for k in sorted({*plan.once, *plan.left_out}) if first <= k <= last]
    raise ValueError(
        f"{different.name} is {_shown(different.tagged)} as tagged, and "
        f"{_shown(different.whole)} in the whole notebook: the difference arises between code "
        f"cells {first} and {last} ({_listed(suspects)}); {WAY_OUT}"
    )


WAY_OUT = (
    "a tagged cell changes an object in place or draws random numbers: "
    "remove the tag, or run all cells (--whole, whole=True)"
)


def difference(tagged: Outcome, whole: Outcome) -> Difference | None:
    """The first value, in the order of the whole notebook, that differs."""
    for name in {**whole.results, **tagged.results}:
        values = tagged.results.get(name), whole.results.get(name)
        if not _same(*values):
            return Difference(name, *values)
    return None


def _same(one: Any, other: Any) -> bool:
    both_nan = all(isinstance(value, float) and math.isnan(value) for value in (one, other))
    return both_nan or (type(one) is type(other) and one == other)


def _between(name: str, tagged: Outcome, whole: Outcome) -> tuple[int, int]:
    """The cells between which the difference of a value arises."""
    import nbformat

    cells = code_cells(nbformat.reads(whole.notebook, as_version=4))
    gluing = {
        glued: number for number, cell in enumerate(cells, 1) for glued in glued_in_cell(cell)
    }
    last = gluing.get(name, len(cells))
    agreeing = [
        number
        for other, number in gluing.items()
        if number < last and _same(tagged.results.get(other), whole.results.get(other))
    ]
    return max(agreeing, default=0) + 1, last


def _ended(outcome: Outcome) -> str:
    return f"fails ({outcome.error})" if outcome.status == FAILED else "does not fail"


def _shown(value: Any) -> str:
    return "not glued" if value is None else repr(value)


def _listed(numbers: Sequence[int]) -> str:
    return f"tagged: {', '.join(map(str, numbers))}" if numbers else "none of them tagged"


def _record(key: str) -> Path:
    return cache_folder() / "sweeps" / f"{key}.json"
