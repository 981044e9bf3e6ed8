"""The checks of shapes and ranges that all public functions share, so that a mistake reads the same
everywhere.

Each function returns a read-only array (or the value) and raises ``ValueError`` with the argument's
name, what was expected and what was given. Numbers beyond `LARGEST`, in whatever unit, are refused,
and a computed point beyond it counts as missing (`whole_rows`), so that no later product overflows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

Array = NDArray[np.float64]

# Of any unit. Far beyond any bench, and beyond what is computed from one: a point whose rays are
# almost parallel has a covariance of 1e20 mm^2. Its eighth power is still a float, and it is one
# itself in single precision.
LARGEST = 1e36


def frozen(array: np.ndarray) -> np.ndarray:
    """Return a read-only copy of an array."""
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


def as_array(
    value: ArrayLike, name: str, shape: tuple[int | None, ...], finite: bool = True
) -> Array:
    """Check a float array of a given shape; ``None`` in `shape` stands for any length.

    Without `finite`, NaN stands for what is missing; infinity, and what is beyond `LARGEST`, is a
    mistake all the same.
    """
    wanted = (
        "("
        + ", ".join("n" if n is None else str(n) for n in shape)
        + ("," if len(shape) == 1 else "")
        + ")"
    )
    try:
        array = _as_floats(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{name}: expected numbers of shape {wanted}, got {type(value).__name__}"
        ) from None
    if array.ndim != len(shape) or any(
        n not in (None, m) for n, m in zip(shape, array.shape, strict=True)
    ):
        raise ValueError(f"{name}: expected shape {wanted}, got {array.shape}")
    wrong = ~(np.abs(array) <= LARGEST) if finite else np.abs(array) > LARGEST
    if wrong.any():
        count = np.count_nonzero(wrong)
        raise ValueError(
            f"{name}: expected finite numbers of at most {LARGEST:g}, got {count} that are not"
        )
    return frozen(array)


def _as_floats(value: ArrayLike) -> np.ndarray:
    """The numbers as floats. NumPy would read text like "1.5" and true as numbers: here they are a
    TypeError.
    """
    array = np.asarray(value)
    if array.dtype.kind in "bSU":
        raise TypeError
    return array.astype(float, copy=False)


def as_points(value: ArrayLike, name: str, dim: int, finite: bool = False) -> Array:
    """Check points as rows, shape (n, dim). NaN rows stand for missing points unless `finite` is
    set.
    """
    return as_array(value, name, (None, dim), finite=finite)


def as_image(
    value: ArrayLike, name: str, size: tuple[int, int] | None = None, highest: float | None = None
) -> np.ndarray:
    """Check a grey image, shape (height, width), of a number type; `size` is (width, height).

    With `highest`, grey levels must lie between 0 and that value, whatever the type's range.
    """
    try:
        image = np.asarray(value)
    except ValueError:  # rows of different lengths
        image = np.empty(0, object)
    if image.ndim != 2 or image.size == 0 or image.dtype.kind not in "uif":
        raise ValueError(
            f"{name}: expected a grey image of shape (height, width), got {image.dtype} {image.shape}"
        )
    if size is not None and image.shape != (size[1], size[0]):
        raise ValueError(
            f"{name}: expected {size[0]} x {size[1]} pixels, got {image.shape[1]} x {image.shape[0]}"
        )
    if image.dtype.kind == "f" and not (image.min() >= -LARGEST and image.max() <= LARGEST):
        raise ValueError(
            f"{name}: expected finite grey values of at most {LARGEST:g}, got others, or NaN"
        )
    if (
        highest is not None
        and image.dtype != np.uint8
        and (image.min() < 0 or image.max() > highest)
    ):
        raise ValueError(
            f"{name}: expected grey levels from 0 to {highest:g}, got {image.min():g} to {image.max():g}"
        )
    return image


def as_number(
    value: Any, name: str, low: float = -np.inf, high: float = np.inf, open_low: bool = False
) -> float:
    """Check one number in [low, high], or in (low, high] when `open_low` is set, and not beyond
    `LARGEST`.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise ValueError(f"{name}: expected a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:  # a whole number too large for a float
        number = np.inf
    if not low <= number <= high or (open_low and number == low):
        raise ValueError(f"{name}: expected a number {_range(low, high, open_low)}, got {value!r}")
    if abs(number) > LARGEST:
        raise ValueError(f"{name}: expected a number of at most {LARGEST:g}, got {value!r}")
    return number


def _range(low: float, high: float, open_low: bool) -> str:
    """A range in words, or between brackets if it has two ends."""
    if high < np.inf:
        return f"in {'(' if open_low else '['}{low:g}, {high:g}]"
    return f"above {low:g}" if open_low else f"of {low:g} or more"


def check_numbers(
    data: object, *names: str, low: float = -np.inf, high: float = np.inf, open_low: bool = False
) -> None:
    """Check fields of a frozen dataclass by `as_number`, all with the same range, and store them as
    floats.
    """
    for name in names:
        object.__setattr__(data, name, as_number(getattr(data, name), name, low, high, open_low))


def as_whole(value: Any, name: str, low: float = -np.inf, high: float = np.inf) -> int:
    """Check one whole number in [low, high]."""
    if as_number(value, name, low, high) % 1:
        raise ValueError(f"{name}: expected a whole number, got {value!r}")
    return int(value)


def as_unit(value: ArrayLike, name: str) -> Array:
    """Check a direction, shape (3,), and return it with length 1."""
    vector = as_array(value, name, (3,))
    length = np.linalg.norm(vector)
    if length < 1e-12:
        raise ValueError(f"{name}: expected a direction, got the zero vector")
    return frozen(vector / length)


def as_transform(value: Any, name: str) -> RigidTransform:
    """Check a single rigid motion whose numbers are finite."""
    if not isinstance(value, RigidTransform) or not value.single:
        raise ValueError(f"{name}: expected one RigidTransform, got {type(value).__name__}")
    if not (np.abs(value.as_matrix()) <= LARGEST).all():
        raise ValueError(
            f"{name}: expected a finite motion, got a translation of {value.translation.tolist()}"
        )
    return value


def whole_rows(points: np.ndarray) -> np.ndarray:
    """Make each row (n, k) that is not finite, or beyond `LARGEST`, a missing point, NaN
    throughout; in place.
    """
    finite = np.abs(points) <= LARGEST
    if not finite.all():  # row by row is slow, and seldom needed
        points[~finite.all(axis=1)] = np.nan
    return points


def as_rng(value: Any) -> np.random.Generator:
    """Check a source of random numbers; the argument's name is `rng` everywhere."""
    if not isinstance(value, np.random.Generator):
        raise ValueError(f"rng: expected a numpy.random.Generator, got {type(value).__name__}")
    return value
