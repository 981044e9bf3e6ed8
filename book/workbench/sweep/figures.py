"""Figures of a sweep's table: curves, heat maps, small multiples.

The results that a notebook names as its verdicts come first, those in words as a row of colours.
Then comes what changed most: the range of a result's means, less the mean range of its repeats,
divided by the largest mean, without signs. A result that repeats the parameter's value comes last.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from trinolab.checks import Array

from ..plotting.basics import COLOURS, subplots
from .quantities import PAPER, count_of, is_count, labelled, paper_value

REPEATS = ("seed",)  # parameters that repeat a run rather than change it
MOST_PANELS = 12
MOST_COLUMNS = 4
MOST_ROWS = 3
MOST_ALIKE = 2  # names of results that are the same as a drawn one
MOST_CELLS = (8, 12)  # of a map that has room for its values: across, up
NOT_RESULTS = ("seconds", "status", "error")


class Levels(NamedTuple):
    """The different values of a parameter, in order, and for each row of the table which of them it
    has.
    """

    name: str
    values: list[Any]
    which: np.ndarray

    @property
    def numbers(self) -> Array | None:
        """The values as numbers; None if they are something else."""
        numeric = all(
            isinstance(value, (int, float)) and not isinstance(value, bool) for value in self.values
        )
        return np.array(self.values, float) if numeric else None

    @property
    def labels(self) -> list[str]:
        """The values as short texts."""
        return [
            f"{value:.4g}" if isinstance(value, float) else str(value)[:20] for value in self.values
        ]


def plot_sweep(
    table: pd.DataFrame,
    results: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
) -> Figure:
    """Show what a sweep gave: curves over one parameter, heat maps over two, one for each further
    setting.

    A parameter named ``seed`` repeats a run: shown are the mean over its values and, about a curve,
    the range. Runs that are no full grid, such as a sample, are shown as points. Failed runs are
    gaps. The dashed line is the paper's value. A hollow marker is a mean over fewer poses than there
    were: what was not measured is not in it, and it may be small for that reason.

    Parameters
    ----------
    table : pandas.DataFrame
        As `runs.sweep` or `sweep.read_sweep` gives it.
    results : sequence of str, optional
        The columns to show; without it the verdicts in ``table.attrs``, the errors of Eq. 26 and
        27, and what changes with more than the seed, what changed most first, as many as there is
        room.
    parameters : sequence of str, optional
        The columns that were swept, where ``table.attrs`` does not say it.

    Raises
    ------
    ValueError
        For a column that is not there, or is no number.
    """
    names = list(parameters if parameters is not None else table.attrs.get("parameters", []))
    every = results_of(table, names, results)
    levels = varied(table, names)
    several = len(levels) > 2 or (len(levels) == 2 and not is_grid(levels))
    alike = dict[str, list[str]]()
    words = list[str]()
    if results is None:
        every, alike = _without_duplicates(table, every)
        words = [] if several else _verdicts_in_words(table)
    rows_shown = every
    if several or results is None:
        most = MOST_ROWS if several else MOST_PANELS - len(words)
        rows_shown = [*words, *_with_errors(every, most)]
    if not rows_shown:
        return _text_only("no result is a number", table)
    if len(levels) > 1 and not is_grid(levels):
        figure = _scattered(table, rows_shown, levels)
    elif len(levels) > 2:
        figure = _multiples(table, rows_shown, levels)
    else:
        figure, axes = _panels(len(rows_shown))
        for ax, name in zip(axes, rows_shown, strict=True):
            if name in words:
                _word_map(ax, table[name], levels or [_runs(table)], name)
            else:
                _draw_result(ax, table, name, levels or [_runs(table)])
            _name_alike(ax, alike.get(name, []))
    _name_what_is_missing(figure, table, len(every) + len(words) - len(rows_shown))
    return figure


def _draw_result(ax: Axes, table: pd.DataFrame, name: str, levels: Sequence[Levels]) -> None:
    """A result as a curve over one parameter, or as a map over two."""
    counted = counts_of(table, name, levels)
    if len(levels) == 1:
        draw_curve(ax, table[name].to_numpy(float), levels[0], name, counted)
    else:
        _heat_map(ax, table[name].to_numpy(float), levels, name)
        _describe_map(ax, name, len(levels[1].values), counted)


def _verdicts_in_words(table: pd.DataFrame) -> list[str]:
    """The verdicts of a table that are words."""
    return [
        name
        for name in table.attrs.get("verdicts", [])
        if name in table and table[name].map(lambda value: isinstance(value, str)).any()
    ]


def _word_map(ax: Axes, column: pd.Series, levels: Sequence[Levels], name: str) -> None:
    """A verdict in words over one or two parameters, a colour for each word; white where there is
    none, hatched where repeats disagree.
    """
    across = levels[0]
    rows = len(levels[1].values) if len(levels) > 1 else 1
    words = list(dict.fromkeys(word for word in column if isinstance(word, str)))
    given = column.groupby(_flat(levels)).agg(lambda part: list(part.dropna().unique()))
    for place, words_here in given.items():
        i, j = divmod(int(place), rows)
        colour = COLOURS[words.index(words_here[0]) % len(COLOURS)] if words_here else "white"
        hatch = "//" if len(words_here) > 1 else None
        ax.add_patch(
            Rectangle((i - 0.5, j - 0.5), 1, 1, facecolor=colour, edgecolor="white", hatch=hatch)
        )
    for k, word in enumerate(words):
        ax.plot([], [], "s", color=COLOURS[k % len(COLOURS)], label=word)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, fontsize=9)
    ax.set(xlim=(-0.5, len(across.values) - 0.5), ylim=(-0.5, rows - 0.5))
    ax.set_xticks(range(len(across.values)), across.labels)
    ax.set(xlabel=labelled(across.name))
    if len(levels) > 1:
        ax.set_yticks(range(rows), levels[1].labels)
        ax.set(ylabel=f"{name} over {labelled(levels[1].name)}")
    else:
        ax.set(yticks=[], ylabel=name)


def _without_duplicates(
    table: pd.DataFrame, names: Sequence[str]
) -> tuple[list[str], dict[str, list[str]]]:
    """The results without those that are the same as an earlier one in each run, and of each that
    stays the names of these.
    """
    alike = dict[str, list[str]]()
    for name in names:
        same = [
            other for other in alike if table[name].equals(table[other].astype(table[name].dtype))
        ]
        if same:
            alike[same[0]].append(name)
        else:
            alike[name] = []
    return list(alike), alike


def _with_errors(names: Sequence[str], most: int) -> list[str]:
    """The first so many results, of which those that the paper states a value for are not left out."""
    shown = list(names)
    for name in reversed(names):
        if len(shown) > most and name not in PAPER:
            shown.remove(name)
    return shown[:most]


def _name_alike(ax: Axes, names: Sequence[str]) -> None:
    """Say which results are the same as the one that is drawn."""
    if names:
        more = f" and {len(names) - MOST_ALIKE} more" if len(names) > MOST_ALIKE else ""
        text = f"the same: {', '.join(names[:MOST_ALIKE])}{more}"
        ax.set_title("\n".join(filter(None, [text, ax.get_title()])), fontsize=9)


def as_png(figure: Figure) -> bytes:
    """The figure as a PNG file; it is closed."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100)
    plt.close(figure)
    return file.getvalue()


def results_of(
    table: pd.DataFrame, parameters: Sequence[str], wanted: Sequence[str] | None = None
) -> list[str]:
    """The columns to show, in their order; errors as for `plot_sweep`."""
    if missing := [name for name in (*parameters, *(wanted or ())) if name not in table]:
        raise ValueError(f"{missing[0]}: no such column; there are {', '.join(table.columns)}")
    others = [name for name in table if name not in (*parameters, *NOT_RESULTS)]
    numeric = [
        name
        for name in others
        if pd.api.types.is_numeric_dtype(table[name]) and table[name].notna().any()
    ]
    if wanted is not None:
        if wrong := [name for name in wanted if name not in numeric]:
            raise ValueError(
                f"{wrong[0]}: no result that is a number; there are {', '.join(numeric) or 'none'}"
            )
        return list(wanted)
    levels = varied(table, parameters)
    means = (
        table[numeric].groupby(_flat(levels)).mean()
        if levels and is_grid(levels)
        else table[numeric]
    )
    swept = [table[name].tolist() for name in parameters]
    changing = [
        name for name in numeric if (table if name.startswith("E_") else means)[name].nunique() > 1
    ] or numeric
    repeats = (
        table[changing].groupby(_flat(levels)).agg(np.ptp).mean()
        if levels and is_grid(levels)
        else pd.Series(0.0, changing)
    )
    change = {name: _change(means[name], float(repeats[name])) for name in changing}
    ordered = sorted(changing, key=lambda name: (table[name].tolist() in swept, -change[name]))
    verdicts = [name for name in table.attrs.get("verdicts", []) if name in numeric]
    return [*verdicts, *(name for name in ordered if name not in verdicts)]


def _change(means: pd.Series, repeats: float) -> float:
    """How much a result changes, less what its repeats do, as a share of its largest value."""
    largest = float(means.abs().max())
    return (float(means.max() - means.min()) - repeats) / largest if largest else 0.0


def varied(table: pd.DataFrame, parameters: Sequence[str]) -> list[Levels]:
    """The parameters that change; those that repeat a run only if there are no others."""
    levels = [level for name in parameters if len((level := _levels(table[name])).values) > 1]
    return [level for level in levels if level.name not in REPEATS] or levels


def _levels(column: pd.Series) -> Levels:
    if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
        values, index = np.unique(column.to_numpy(), return_inverse=True)
        return Levels(str(column.name), values.tolist(), index)
    index, names = pd.factorize(column.map(str))
    return Levels(str(column.name), list(names), index)


def _runs(table: pd.DataFrame) -> Levels:
    return Levels("run", list(range(len(table))), np.arange(len(table)))


def is_grid(levels: Sequence[Levels]) -> bool:
    """Whether there is a row for each combination."""
    shape = [len(level.values) for level in levels]
    rows = len(levels[0].which)
    return np.prod(shape, dtype=float) <= rows and len(set(_flat(levels).tolist())) == np.prod(
        shape
    )


def _flat(levels: Sequence[Levels]) -> np.ndarray:
    """The combination of each row, as one number."""
    return np.ravel_multi_index(
        [level.which for level in levels], [len(level.values) for level in levels]
    )


def _statistics(y: Array, levels: Sequence[Levels]) -> pd.DataFrame:
    """Mean, least and greatest value of each combination; NaN where there is none."""
    grouped = pd.Series(y).groupby(_flat(levels)).agg(["mean", "min", "max"])
    return grouped.reindex(range(int(np.prod([len(level.values) for level in levels]))))


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    figure, axes = subplots(
        rows,
        columns,
        figsize=(max(4.0 * columns, 5.0), 2.8 * rows + 0.4),
        squeeze=False,
    )
    for ax in axes.flat[count:]:
        ax.remove()
    return figure, list(axes.flat[:count])


class Counted(NamedTuple):
    """The least number of poses behind each mean, and how many there were."""

    measured: Array
    all: Array


def counts_of(table: pd.DataFrame, name: str, levels: Sequence[Levels]) -> Counted | None:
    """The numbers of poses behind a result at each combination; None if the table has none."""
    if (columns := count_of(name, table.columns)) is None:
        return None
    measured = _statistics(table[columns.measured].to_numpy(float), levels)["min"].to_numpy()
    if columns.measured == columns.all:
        return Counted(measured, measured)
    every = columns.all if columns.all in table else columns.measured
    there = _statistics(table[every].to_numpy(float), levels)["max"].to_numpy()
    if every == columns.measured:
        there = np.full(len(there), np.nanmax(there))
    return Counted(measured, there)


def _number_of(counted: Counted) -> str:
    """How many poses there were, in words."""
    least, most = np.nanmin(counted.all), np.nanmax(counted.all)
    return f"n = {most:g}" if least == most else f"n = {least:g} to {most:g}"


def _label(name: str, y: Array) -> str:
    """A result's name with its unit."""
    known = y[np.isfinite(y)]
    return labelled(name, is_count(name, bool((known == np.round(known)).all())))


def draw_curve(
    ax: Axes, y: Array, level: Levels, name: str, counted: Counted | None = None
) -> None:
    """A result over one parameter: its mean, and its range where a value comes more than once; the
    paper's value, and the means that are over fewer poses than there were.
    """
    statistics = _statistics(y, [level])
    x = level.numbers
    at = np.arange(len(level.values), dtype=float) if x is None else x
    ax.plot(at, statistics["mean"], "o-" if len(at) <= 50 else "-", color=COLOURS[0], markersize=4)
    if len(y) > len(at):
        ax.fill_between(
            at, statistics["min"], statistics["max"], color=COLOURS[0], alpha=0.2, linewidth=0
        )
    paper = paper_value(name)
    if paper is not None:
        ax.axhline(paper, color=COLOURS[4], linestyle="--", linewidth=1)
        ax.annotate(
            f"paper {paper:g}",
            (1.0, paper),
            (-2, 2),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            ha="right",
            color=COLOURS[4],
            fontsize=9,
        )
    if counted is not None:
        _mark_dropped(ax, at, statistics["mean"].to_numpy(), counted)
    if x is None:
        ax.set_xticks(at, level.labels, rotation=30 if max(map(len, level.labels)) > 8 else 0)
    elif _is_geometric(x):
        ax.set_xscale("log")
    ax.set(xlabel=labelled(level.name), ylabel=_label(name, y))
    ax.grid(alpha=0.3)


def _mark_dropped(ax: Axes, at: Array, means: Array, counted: Counted) -> None:
    """Say how many poses are behind the means: of those over fewer than there were by hollow
    markers, each with its number if there is room.
    """
    few = (counted.measured < counted.all) & np.isfinite(means)
    ax.set_title(_number_of(counted) + (", hollow: fewer" if few.any() else ""), fontsize=9)
    ax.plot(
        at[few], means[few], "o", color=COLOURS[0], markerfacecolor="white", markersize=6, zorder=3
    )
    if len(at) > MOST_CELLS[1]:
        return
    ax.margins(x=0.1, y=0.12)
    for k in np.flatnonzero(few):
        ax.annotate(
            f"{counted.measured[k]:g} of {counted.all[k]:g}",
            (at[k], means[k]),
            (0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=9,
        )


def _heat_map(
    ax: Axes,
    y: Array,
    levels: Sequence[Levels],
    name: str,
    limits: tuple[float | None, float | None] = (None, None),
) -> None:
    """The means over two parameters, the first one to the right; grey where there is none."""
    across, up = levels
    means = _statistics(y, levels)["mean"].to_numpy().reshape(len(across.values), len(up.values)).T
    image = ax.imshow(
        means,
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        vmin=limits[0],
        vmax=limits[1],
    )
    ax.figure.colorbar(image, ax=ax, label=_label(name, y))
    if len(across.values) <= MOST_CELLS[0] and len(up.values) <= MOST_CELLS[1]:
        _write_values(ax, means, image)
    for axis, level in ((ax.xaxis, across), (ax.yaxis, up)):
        ticks = np.unique(np.linspace(0, len(level.values) - 1, 6).round().astype(int))
        axis.set_ticks(ticks, [level.labels[k] for k in ticks])
    ax.set(xlabel=labelled(across.name), ylabel=labelled(up.name), facecolor="lightgrey")


def _describe_map(ax: Axes, name: str, rows: int, counted: Counted | None) -> None:
    """The paper's value and the number of poses behind the means, above a map; a cell with a mean over
    fewer poses than there were is framed.
    """
    paper = paper_value(name)
    said = [] if paper is None else [f"paper {paper:g}"]
    if counted is not None:
        few = counted.measured < counted.all
        fewest = f", framed: fewer, at least {np.nanmin(counted.measured):g}" if few.any() else ""
        said.append(_number_of(counted) + fewest)
        for column, row in (divmod(int(k), rows) for k in np.flatnonzero(few)):
            frame = Rectangle((column - 0.46, row - 0.46), 0.92, 0.92, fill=False, linewidth=1.5)
            frame.set_edgecolor(COLOURS[4])
            ax.add_patch(frame)
    ax.set_title("; ".join(said), fontsize=9)


def _write_values(ax: Axes, means: Array, image: AxesImage) -> None:
    """The values of a map in its cells, light on dark and dark on light."""
    for (row, column), value in np.ndenumerate(means):
        if np.isfinite(value):
            # of the colours that go from dark to light
            dark = np.asarray(image.norm(np.array([value])))[0] < 0.6
            text = f"{value:.3g}"
            colour = "white" if dark else "black"
            ax.text(column, row, text, ha="center", va="center", color=colour, fontsize=9)


def _multiples(table: pd.DataFrame, shown: Sequence[str], levels: Sequence[Levels]) -> Figure:
    """Heat maps over the first two parameters: a row per result, a column per setting of the others
    (some, if many).
    """
    first, others = levels[:2], levels[2:]
    flat = _flat(others)
    columns = np.unique(np.linspace(0, flat.max(), MOST_COLUMNS).round().astype(int))
    figure, axes = subplots(
        len(shown),
        len(columns),
        figsize=(3.6 * len(columns), 2.8 * len(shown) + 0.4),
        squeeze=False,
    )
    for ax, (name, combination) in zip(
        axes.flat, ((name, k) for name in shown for k in columns), strict=True
    ):
        y = table[name].to_numpy(float)
        matching = flat == combination
        part = [level._replace(which=level.which[matching]) for level in first]
        _heat_map(ax, y[matching], part, name, (np.nanmin(y), np.nanmax(y)))
        setting = np.unravel_index(combination, [len(level.values) for level in others])
        ax.set_title(
            ", ".join(
                f"{level.name} {level.labels[k]}" for level, k in zip(others, setting, strict=True)
            ),
            fontsize=9,
        )
    return figure


def _scattered(table: pd.DataFrame, shown: Sequence[str], levels: Sequence[Levels]) -> Figure:
    """Each result over each parameter, as points."""
    columns = levels[:MOST_COLUMNS]
    figure, axes = subplots(
        len(shown),
        len(columns),
        figsize=(3.6 * len(columns), 2.8 * len(shown) + 0.4),
        sharey="row",
        squeeze=False,
    )
    for ax, (name, level) in zip(
        axes.flat, ((name, level) for name in shown for level in columns), strict=True
    ):
        x = level.numbers
        at = np.arange(len(level.values)) if x is None else x
        ax.plot(
            at[level.which],
            table[name],
            ".",
            color=COLOURS[0],
            markersize=5 if len(table) < 500 else 2,
        )
        if x is None:
            ax.set_xticks(at, level.labels)
        elif _is_geometric(x):
            ax.set_xscale("log")
        ax.set(xlabel=labelled(level.name), ylabel=labelled(name))
    return figure


def _is_geometric(x: Array) -> bool:
    """Whether values in order that do not lie close together have their middle where equal ratios
    would have it, rather than equal steps.
    """
    if len(x) < 3 or x[0] <= 0 or x[-1] < 10 * x[0]:
        return False
    middle = float(np.median(x))
    by_ratios = np.log(middle / x[0]) / np.log(x[-1] / x[0])
    by_steps = (middle - x[0]) / (x[-1] - x[0])
    return bool(abs(by_ratios - 0.5) < abs(by_steps - 0.5))


def _name_what_is_missing(figure: Figure, table: pd.DataFrame, left_out: int = 0) -> None:
    """Say in the figure which runs failed, and how many results have no room in it."""
    failed = int((table["status"] == "failed").sum()) if "status" in table else 0
    said = [f"{failed} of {len(table)} runs failed"] * bool(failed)
    said += [f"{left_out} more results are in the table"] * bool(left_out)
    if said:
        figure.suptitle("; ".join(said), fontsize=10)


def _text_only(text: str, table: pd.DataFrame) -> Figure:
    figure = plt.figure(figsize=(5, 2), facecolor="white")
    figure.text(0.5, 0.5, text, ha="center")
    _name_what_is_missing(figure, table)
    return figure
