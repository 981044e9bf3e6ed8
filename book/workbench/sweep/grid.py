"""Which runs a sweep has: the values of its parameters, each with each, or a Latin hypercube sample
of them.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, product
from numbers import Number
from typing import Any, NamedTuple

import numpy as np

from trinolab.checks import as_whole
from trinolab.files.inputs import read_csv

MANY = 100_000  # runs: more of them are rather a mistake
MOST_POINTS = 1_000_000  # of one range
FORMS = "expected a:b:n, log:a:b:n, a list like 0,1,2, or @file.csv"
_RANGE = re.compile(r"(?P<log>log:)?(?P<low>[^:]*):(?P<high>[^:]*)(?::(?P<count>[^:]*))?")
_WORD = re.compile(r"[A-Za-z_][\w.-]*")


class Axis(NamedTuple):
    """Parameters that change together, and their values: one tuple a setting."""

    names: tuple[str, ...]
    settings: Sequence[tuple[Any, ...]]


class Interval(NamedTuple):
    """All that lies between two numbers, for a sample; with `log` as many below the geometric mean
    as above it.
    """

    low: float
    high: float
    log: bool = False

    def at(self, u: float, whole: bool = False) -> float:
        """The value at the share `u` of the way, 0 <= u < 1; of the whole numbers, both ends
        included, if `whole`.
        """
        if whole:
            low = math.ceil(self.low)
            high = math.floor(self.high)
            return min(math.floor(Interval(low, high + 1, self.log).at(u)), high)
        if self.log:
            return _rounded(self.low * (self.high / self.low) ** u)
        return _rounded(self.low + (self.high - self.low) * u)


class Between(NamedTuple):
    """A parameter that is drawn from an interval."""

    names: tuple[str]
    interval: Interval


def parse(texts: Sequence[str]) -> list[Axis | Between]:
    """The axes of a grid from what was typed: ``name=0.5:0.95:10``, ``name=log:1:100:3``,
    ``name=0,1``, ``@runs.csv``.

    Values are TOML literals, and nothing is evaluated; a text of letters may go without quotes.
    ``name=0.5:0.95``, an interval without a number of points, is for samples. The file has a column
    a parameter, and a row per setting.

    Raises
    ------
    ValueError
        Repeats what was typed, and says what was expected.
    """
    axes = [_from_file(text[1:]) if text.startswith("@") else _from_text(text) for text in texts]
    return _checked(axes)


def axes_of(values: Mapping[str, Any]) -> list[Axis | Between]:
    """The axes of a grid from Python values: an iterable, an `Interval`, or one value (a text is
    one value).

    Raises
    ------
    ValueError
        If a parameter has no value.
    """
    return _checked(
        [
            Between((name,), value)
            if isinstance(value, Interval)
            else Axis((name,), _listed(value))
            for name, value in values.items()
        ]
    )


def count(axes: Sequence[Axis | Between], sample: int | None = None) -> int:
    """How many runs a grid has."""
    if sample is None:
        return math.prod(len(axis.settings) for axis in axes if isinstance(axis, Axis))
    return sample


def runs(
    axes: Sequence[Axis | Between],
    sample: int | None = None,
    sample_seed: int = 0,
    whole: Iterable[str] = (),
    yes: bool = False,
) -> list[dict[str, Any]]:
    """The settings of all runs, a mapping from names to values for each; the last parameter changes
    fastest.

    Parameters
    ----------
    axes : sequence
        As `parse` or `axes_of` gives them.
    sample : int, optional
        So many runs, a Latin hypercube of the axes: each one's values, or parts of its interval,
        come equally often.
    sample_seed : int
        Of that draw.
    whole : iterable of str
        Parameters of which an interval means its whole numbers.
    yes : bool
        More than `MANY` runs are meant.

    Raises
    ------
    ValueError
        For a sample of no run, an interval without a sample, too many runs.
    """
    if sample is not None and sample < 1:
        raise ValueError(f"sample: expected at least 1 run, got {sample}")
    as_whole(sample_seed, "sample_seed", low=0)
    for axis in axes:
        if sample is None and isinstance(axis, Between):
            raise ValueError(
                f"{axis.names[0]}: an interval needs a number of points (a:b:n), or a sample"
            )
    if (total := count(axes, sample)) > MANY and not yes:
        raise ValueError(
            f"the grid has {total:,} runs; more than {MANY:,} must be confirmed (--yes, yes=True)"
        )
    names = list(chain.from_iterable(axis.names for axis in axes))
    settings = _crossed(axes) if sample is None else _sampled(axes, sample, sample_seed, set(whole))
    return [dict(zip(names, chain.from_iterable(parts), strict=True)) for parts in settings]


def _crossed(axes: Sequence[Axis | Between]) -> Iterable[tuple[tuple[Any, ...], ...]]:
    return product(*(axis.settings for axis in axes if isinstance(axis, Axis)))


def _sampled(
    axes: Sequence[Axis | Between], sample: int, seed: int, whole: set[str]
) -> Iterable[list[tuple[Any, ...]]]:
    from scipy.stats import qmc

    for row in qmc.LatinHypercube(len(axes), rng=seed).random(sample) if axes else [()] * sample:
        yield [
            (axis.interval.at(u, axis.names[0] in whole),)
            if isinstance(axis, Between)
            else axis.settings[int(u * len(axis.settings))]
            for axis, u in zip(axes, row, strict=True)
        ]


def _checked(axes: list[Axis | Between]) -> list[Axis | Between]:
    """The axes, if no parameter comes twice, and each has a value."""
    names = list(chain.from_iterable(axis.names for axis in axes))
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name}: given more than once")
    for axis in axes:
        if isinstance(axis, Axis) and not axis.settings:
            raise ValueError(f"{', '.join(axis.names)}: expected at least one value, got none")
    return axes


def _from_text(text: str) -> Axis | Between:
    name, equals, values = (part.strip() for part in text.partition("="))
    if not (equals and name.isidentifier()):
        raise ValueError(f"-p {text}: expected NAME=VALUES or @file.csv")
    if (range_match := _RANGE.fullmatch(values)) and not re.search(r"[\"'\[,]", values):
        return _range(name, range_match, f"-p {text}")
    return Axis((name,), [(value,) for value in _values(values, f"-p {text}")])


def _range(name: str, found: re.Match[str], where: str) -> Axis | Between:
    low, high = (_number(found[part], where) for part in ("low", "high"))
    if found["log"] and not (low > 0 and high > 0):
        raise ValueError(f"{where}: log needs numbers above 0")
    if found["count"] is None:
        if not low < high:
            raise ValueError(f"{where}: expected an interval that goes up")
        return Between((name,), Interval(low, high, bool(found["log"])))
    n = _number(found["count"], where)
    if not (isinstance(n, int) and 2 <= n <= MOST_POINTS):
        raise ValueError(f"{where}: expected 2 to {MOST_POINTS:,} points, got {found['count']}")
    points = [
        _rounded(x) for x in (np.geomspace if found["log"] else np.linspace)(low, high, n).tolist()
    ]
    if isinstance(low, int) and isinstance(high, int) and all(x == int(x) for x in points):
        points = [int(x) for x in points]
    return Axis((name,), [(x,) for x in points])


def _from_file(path: str) -> Axis:
    table = read_csv(path, dtype=str, keep_default_na=False)
    for name in table.columns:
        if not name.isidentifier():
            raise ValueError(
                f"{path}: expected names of parameters in the first line, got {name!r}"
            )
    rows = [
        tuple(
            _one(cell, f"{path}: row {k}, {name}")
            for name, cell in zip(table.columns, cells, strict=True)
        )
        for k, cells in enumerate(table.itertuples(index=False, name=None), 1)
    ]
    if not rows:
        raise ValueError(f"{path}: expected a row per run, got none")
    return Axis(tuple(table.columns), rows)


def _values(text: str, where: str) -> list[Any]:
    """The values of a list without its brackets."""
    listed = _toml_list(text)  # None for a text without quotes, or what is no literal at all
    values = [_one(part, where) for part in text.split(",")] if listed is None else listed
    if not (values and all(map(_is_plain, values))):
        raise ValueError(f"{where}: {FORMS}")
    return values


def _one(text: str, where: str) -> Any:
    """One value: a TOML literal, or a text of letters."""
    if (found := _toml_list(text)) is None and _WORD.fullmatch(text.strip()):
        return text.strip()
    if found is None or len(found) != 1:
        raise ValueError(f"{where}: {text.strip()!r} is no value; {FORMS}")
    if not _is_plain(found[0]):
        raise ValueError(
            f"{where}: {text.strip()!r} is no number, text, true, false, or list of these"
        )
    return found[0]


def _toml_list(text: str) -> list[Any] | None:
    """The values of a TOML list that is given without its brackets; None if it is no such list."""
    try:
        table = tomllib.loads(f"values = [{text}]")
    except tomllib.TOMLDecodeError:
        return None
    return table["values"] if set(table) == {"values"} else None


def _is_plain(value: Any) -> bool:
    """Whether a value is a finite number, a text, a truth or a list of these."""
    if isinstance(value, list):
        return all(map(_is_plain, value))
    return isinstance(value, (str, bool, int)) or (
        isinstance(value, float) and math.isfinite(value)
    )


def _number(text: str, where: str) -> float:
    value = _one(text, where)
    if isinstance(value, (str, bool, list)):
        raise ValueError(f"{where}: {text.strip()!r} is no number; {FORMS}")
    return value


def _listed(value: Any) -> list[tuple[Any, ...]]:
    """The values of a parameter, one tuple each; Python's numbers in place of NumPy's."""
    value = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
    if isinstance(value, (str, bytes, Number, Mapping)) or not isinstance(value, Iterable):
        return [(value,)]
    return [(entry.item() if isinstance(entry, np.generic) else entry,) for entry in value]


def _rounded(x: float) -> float:
    """Twelve digits: 0.7 rather than 0.7000000000000001."""
    return float(f"{x:.12g}")
