"""What a student's function returns, as plain data: to be written as JSON, and to be compared."""

from __future__ import annotations

import contextlib
import numbers
import re
from decimal import Decimal
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

MOST_NUMBERS = 100_000
MOST_LETTERS = 1_000  # of what is said of an answer
MOST_SHOWN = 12  # numbers of an array: a camera's matrix of 3 x 4 is shown whole
DEEPEST = 20  # lists in lists
# what a terminal takes for an order, then all else that is no letter: controls, and signs that
# turn the direction of writing
ESCAPES = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)?|\x1b.?")
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]+")


def plain(value: Any) -> Any:
    """Return a value as None, text, ``{"shape": ..., "numbers": ...}`` or a list of these.

    Truth values are the numbers 0 and 1, motions their matrices. Of what is something else the name
    of its type is kept.
    """
    if value is None:
        return None
    if isinstance(value, str):
        return str(value[:MOST_LETTERS])
    if isinstance(value, Rotation | RigidTransform):
        value = value.as_matrix()
    numbers = _numbers(value)
    if numbers is not None:
        if numbers.size > MOST_NUMBERS:
            return f"an array of {numbers.size} numbers"
        return {"shape": list(numbers.shape), "numbers": numbers.ravel().tolist()}
    if isinstance(value, list | tuple):
        items = [plain(item) for item in value]
        if all(is_array(item) and len(item["numbers"]) == 1 for item in items):
            # a number may be an array of one as well, also beside one that is none
            return {"shape": [len(items)], "numbers": [item["numbers"][0] for item in items]}
        return items
    return f"a value of the type {type(value).__name__}"


def checked_plain(value: Any, depth: int = DEEPEST) -> Any:
    """Return what another process says is a plain value as one, whatever it is."""
    match value:
        case None | str():
            return value and value[:MOST_LETTERS]
        case list() if depth:
            return [checked_plain(item, depth - 1) for item in value]
        case {"mapping": dict(items)} if depth:
            return {"mapping": {name: checked_plain(it, depth - 1) for name, it in items.items()}}
        case {"shape": list(shape), "numbers": list(numbers)}:
            with contextlib.suppress(TypeError, ValueError, OverflowError):
                array = np.array(numbers, float).reshape(shape)
                return {"shape": list(array.shape), "numbers": array.ravel().tolist()}
    return f"a value of the type {type(value).__name__}"


def printable(text: str) -> str:
    """Return a text of a student's, for a line of a terminal or a field of a table: without orders
    to the terminal, and no longer than can be read.
    """
    clean = CONTROLS.sub(" ", ESCAPES.sub("", text))
    return clean if len(clean) <= MOST_LETTERS else f"{clean[: MOST_LETTERS - 4]} ..."


def _numbers(value: Any) -> np.ndarray | None:
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O" and array.size <= MOST_NUMBERS:
            # fractions, and whatever else is a number and no float yet
            if not array.size or not all(map(_is_number, array.ravel())):
                return None
        elif array.dtype.kind not in "biuf":
            return None
        return array.astype(float)
    except (TypeError, ValueError, RuntimeError, OverflowError):  # ragged, or something else
        return None


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real | Decimal)


def equal(one: Any, other: Any, within: float) -> bool:
    """Whether two plain values are equal. Nothing is equal to nothing, whatever its shape; a row is
    equal to a column of the same numbers.

    Parameters
    ----------
    one, other
        As `plain` returns them.
    within
        How far numbers may lie apart, as a share of the largest finite one of `other`; as it is
        where these are all zero.
    """
    if is_array(one) and is_array(other):
        if _sides(one) != _sides(other):
            return not one["numbers"] and not other["numbers"]
        return not wrong_numbers(one, other, within).any()
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(
            equal(a, b, within) for a, b in zip(one, other, strict=True)
        )
    return type(one) is type(other) and one == other


def wrong_numbers(one: Any, other: Any, within: float) -> np.ndarray:
    """Which numbers of an array are not those of `other`, in the shape of that: as in `equal`."""
    a, b = (np.array(it["numbers"], float).reshape(other["shape"]) for it in (one, other))
    finite = np.abs(b[np.isfinite(b)])
    scale = finite.max(initial=0.0) or 1.0
    return ~np.isclose(a, b, rtol=0.0, atol=within * scale, equal_nan=True)


def _sides(value: dict[str, Any]) -> list[int]:
    """The sides of an array along which there is more than one number."""
    return [side for side in value["shape"] if side != 1]


def same_form(one: Any, other: Any) -> bool:
    """Whether two plain values are of one kind, so that their numbers can be compared: what `equal`
    says of rows and columns counts here, too.
    """
    if is_array(one) and is_array(other):
        return _sides(one) == _sides(other)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same_form, one, other))
    return described(one) == described(other)


def is_array(value: Any) -> bool:
    """Whether a plain value is a number or an array of numbers."""
    return isinstance(value, dict) and "numbers" in value


def described(value: Any) -> str:
    """What kind of thing a plain value is, in words."""
    if value is None:
        return "None"
    if is_array(value):
        if not value["shape"]:
            return "a number"
        return f"an array of the shape {tuple(value['shape'])}"
    if isinstance(value, list):
        first = ", ".join(map(described, value[:6]))
        return f"{len(value)} things: {first}{', ...' if len(value) > 6 else ''}"
    if isinstance(value, dict):
        return "a dictionary"
    return str(value) if value.startswith(("a ", "an ")) else f"the text {value!r}"


def shown(value: Any) -> str:
    """A plain value in few characters."""
    if is_array(value):
        numbers = np.array(value["numbers"], float).reshape(value["shape"])
        if not value["shape"]:
            return f"{float(numbers):.6g}"
        largest = np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0)
        # what is left of rounding is shown as 0, and -0.0 as well
        tidy = np.where(np.abs(numbers) < 1e-9 * largest, 0.0, numbers) + 0.0
        text = np.array2string(
            tidy,
            threshold=MOST_SHOWN,
            edgeitems=2,
            separator=", ",
            formatter={"float_kind": "{:.6g}".format},
        )
        return " ".join(text.split())
    if isinstance(value, list):
        return f"({', '.join(map(shown, value[:6]))}{', ...' if len(value) > 6 else ''})"
    return str(value)
