"""What the pictures of Table 1 show: arrows, bars and cells at their values."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from workbench.plotting.basics import COLOURS
from workbench.plotting.table1 import (
    plot_budget,
    plot_errors_in_space,
    plot_null,
    plot_over_beta,
    plot_power,
    plot_refused,
)

SMALLEST_PT, WIDEST_IN = 9, 6.9


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def legible(figure):
    """Whether it fits the page's column, and no text is smaller than 9 pt."""
    figure.canvas.draw()
    texts = [t for t in figure.findobj(plt.Text) if t.get_text() and t.get_visible()]
    return (
        figure.get_figwidth() <= WIDEST_IN and min(t.get_fontsize() for t in texts) >= SMALLEST_PT
    )


def test_arrows_start_at_their_positions_and_are_magnified():
    x, e = np.arange(12.0).reshape(4, 3), np.ones((4, 3)) * [0.1, -0.2, 0.3]
    figure = plot_errors_in_space(x, e, 100)
    for ax, (i, j) in zip(figure.axes, ((0, 1), (0, 2)), strict=True):
        (arrows,) = ax.collections
        np.testing.assert_allclose(arrows.get_offsets(), x[:, [i, j]])
        np.testing.assert_allclose(np.column_stack([arrows.U, arrows.V]), 100 * e[:, [i, j]])
    assert figure.axes[0].yaxis_inverted()  # y points down
    assert legible(figure)


def test_bars_have_their_lengths_and_numbers():
    table = pd.DataFrame(
        {"group": ["certain", "certain", "sum"], "mm": [0.1, 0.2, 0.22], "deg": [1.0, np.nan, 1.5]},
        index=["a", "b", "both"],
    )
    figure = plot_budget(table, {"mm": "E_t / mm", "deg": "angle / deg"})
    left, right = figure.axes
    assert sorted(bar.get_width() for bar in left.patches) == [0.1, 0.2, 0.22]
    assert [text.get_text() for text in right.texts] == ["1", "1.5"]
    assert [label.get_text() for label in left.get_yticklabels()] == ["a", "b", "both"]
    assert legible(figure)


def test_refused_cells_are_coloured_and_fitted_ones_are_not_tested():
    table = pd.DataFrame(
        {
            "model": ["noise", "noise", "clamp", "clamp"],
            "statistic": ["offset", "smooth"] * 2,
            "p_holm": [0.0004, 0.5, np.nan, 0.04],
            "fitted": [False, False, True, False],
        }
    )
    ax = plot_refused(table, {"offset": "mean", "smooth": "smooth"}, 0.05)
    assert [t.get_text() for t in ax.texts] == ["< 0.001", "0.50", "fitted", "0.04"]
    refused = [plt.matplotlib.colors.to_hex(p.get_facecolor()) for p in ax.patches]
    assert [colour == COLOURS[1].lower() for colour in refused] == [True, False, False, True]
    assert legible(ax.figure)
    few = plot_refused(table, {"offset": "mean", "smooth": "smooth"}, 0.01)
    assert sum(plt.matplotlib.colors.to_hex(p.get_facecolor()) == COLOURS[1].lower()
               for p in few.patches) == 1  # fmt: skip


def test_curves_of_beta_and_null():
    figure = plot_over_beta([30, 60], {"alpha": {"Table 1": [0.5, 0.6], "model": [0.1, 2]}}, "ox")
    np.testing.assert_allclose(figure.axes[0].lines[1].get_ydata(), [0.1, 2])
    assert legible(figure)
    ax = plot_null({"white": np.full(10, 0.1)}, 0.08, "share", (0, 1))
    assert sum(bar.get_height() for bar in ax.patches) == pytest.approx(1.0)
    assert ax.lines[0].get_xdata()[0] == 0.08
    assert legible(ax.figure)


def test_power_is_drawn_over_the_distance_beside_what_the_clamp_moves():
    distances = [0.0, 10.0, 20.0]
    figure = plot_power(
        distances, [0.0, 0.1, 0.2], 0.31, {"three": [0.05, 0.7, 1], "one": [0.05, 0.9, 1]}
    )
    left, right = figure.axes
    line, table1 = left.lines
    np.testing.assert_allclose(line.get_xydata(), np.column_stack([distances, [0, 0.1, 0.2]]))
    assert set(table1.get_ydata()) == {0.31}
    assert [one.get_label() for one in right.lines] == ["three", "one"]
    np.testing.assert_allclose(right.lines[1].get_ydata(), [0.05, 0.9, 1])
    assert legible(figure)
