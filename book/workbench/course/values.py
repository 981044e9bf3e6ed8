"""Exercises that are answered with values, as ``data/exercises`` has them, a TOML file per chapter."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trinolab.files.inputs import get, read_toml

from .exercise import Asked, Mistake, ValueExercise


def read_values(path: Path) -> tuple[ValueExercise, ...]:
    """The exercises of a file, in its order.

    Raises
    ------
    ValueError
        Names the file, the exercise and the field that is missing, unknown or wrong.
    """
    rows = get(read_toml(path), "exercise", str(path))
    return tuple(_exercise(row, f"{path}: {row.get('number', '?')}") for row in rows)


def _exercise(row: Mapping[str, Any], where: str) -> ValueExercise:
    _known(row, ("number", "kind", "title", "label", "points", "asked", "mistake"), where)
    asked = {
        name: _asked(field, f"{where}: {name}") for name, field in get(row, "asked", where).items()
    }
    mistakes = tuple(
        _mistake(field, asked, f"{where}: mistake {k}")
        for k, field in enumerate(get(row, "mistake", where), start=1)
    )
    return ValueExercise(
        number=get(row, "number", where),
        kind=get(row, "kind", where),
        title=get(row, "title", where),
        label=get(row, "label", where),
        points=get(row, "points", where),
        mistakes=mistakes,
        asked=asked,
    )


def _asked(field: Mapping[str, Any], where: str) -> Asked:
    _known(field, ("value", "unit", "within", "choices"), where)
    value = get(field, "value", where)
    choices = tuple(field.get("choices", ()))
    if choices and value not in choices:
        raise ValueError(f"{where}: expected one of the choices, got {value!r}")
    return Asked(value, field.get("unit", ""), field.get("within", 0.0), choices)


def _mistake(field: Mapping[str, Any], asked: Mapping[str, Asked], where: str) -> Mistake:
    _known(field, ("gives", "says", "read"), where)
    gives = get(field, "gives", where)
    _known(gives, tuple(asked), f"{where}: gives")
    return Mistake(get(field, "says", where), get(field, "read", where), gives)


def _known(table: Mapping[str, Any], names: tuple[str, ...], where: str) -> None:
    if unknown := sorted(set(table) - set(names)):
        raise ValueError(f"{where}: {unknown[0]!r} is none of {', '.join(names)}")
