"""What a student's function returns, as plain data: to be written as JSON, and to be compared."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

__all__ = ["MOST_NUMBERS", "described", "equal", "is_array", "plain", "shown"]

MOST_NUMBERS = 1_000_000


def plain(value: Any) -> Any:
    """Return a value as None, text, ``{"shape": ..., "numbers": ...}`` or a list of these.

    Truth values are the numbers 0 and 1, motions their matrices. Of what is something else the name
    of its type is kept.
    """
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, Rotation | RigidTransform):
        value = value.as_matrix()
    numbers = _numbers(value)
    if numbers is not None:
        if numbers.size > MOST_NUMBERS:
            return f"an array of {numbers.size} numbers"
        return {"shape": list(numbers.shape), "numbers": numbers.ravel().tolist()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return f"a value of the type {type(value).__name__}"


def _numbers(value: Any) -> np.ndarray | None:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            return None
        return array.astype(float)
    except (TypeError, ValueError, RuntimeError):  # ragged, or something else altogether
        return None


def equal(one: Any, other: Any, within: float) -> bool:
    """Whether two plain values are equal. Nothing is equal to nothing, whatever its shape.

    Parameters
    ----------
    one, other
        As `plain` returns them.
    within
        How far numbers may lie apart, as a share of the largest finite one of `other`; as it is
        where these are all zero.
    """
    if is_array(one) and is_array(other):
        if one["shape"] != other["shape"]:
            return not one["numbers"] and not other["numbers"]
        a, b = np.array(one["numbers"], float), np.array(other["numbers"], float)
        finite = np.abs(b[np.isfinite(b)])
        scale = finite.max(initial=0.0) or 1.0
        return bool(np.allclose(a, b, rtol=0.0, atol=within * scale, equal_nan=True))
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(
            equal(a, b, within) for a, b in zip(one, other, strict=True)
        )
    return type(one) is type(other) and one == other


def is_array(value: Any) -> bool:
    """Whether a plain value is a number or an array of numbers."""
    return isinstance(value, dict)


def described(value: Any) -> str:
    """What kind of thing a plain value is, in words."""
    if value is None:
        return "None"
    if is_array(value):
        if not value["shape"]:
            return "a number"
        return f"an array of the shape {tuple(value['shape'])}"
    if isinstance(value, list):
        return f"{len(value)} things: {', '.join(map(described, value))}"
    return str(value) if value.startswith(("a ", "an ")) else f"the text {value!r}"


def shown(value: Any) -> str:
    """A plain value in few characters."""
    if is_array(value):
        numbers = np.array(value["numbers"], float).reshape(value["shape"])
        if not value["shape"]:
            return f"{float(numbers):.6g}"
        text = np.array2string(numbers, precision=4, threshold=12, edgeitems=2, separator=", ")
        return " ".join(text.split())
    if isinstance(value, list):
        return f"({', '.join(map(shown, value))})"
    return str(value)
