"""What the pictures of a calibration show: boards where they were, grids, errors with their bars."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.calibration.target import Board
from trinolab.datasets import load_rig
from workbench.plotting import (
    plot_boards,
    plot_chi_square,
    plot_grids,
    plot_with_intervals,
)


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_every_position_of_the_board_is_drawn_and_both_ways_lead_to_it():
    rig = load_rig("paper_pair")
    poses = RigidTransform.from_translation([[-60.0, -40, 560], [-50, -40, 600], [0, 0, 500]])
    ax = plot_boards(rig, Board().outline, poses).axes[0]
    assert len(ax.patches) == 3
    said = {text.get_text().strip() for text in ax.texts}
    assert said >= {"CCD1", "CCD2", "$R_l, T_l$", "$R_r, T_r$", "$R_{rl}, T_{rl}$"}
    dotted = [line.get_xydata() for line in ax.lines if line.get_linestyle() == ":"]
    # z to the right, y down, x obliquely: the first board's corner, and CCD1 in the origin
    np.testing.assert_allclose(dotted[0], [[560 + 24, -27 + 40], [0, 0]])
    np.testing.assert_allclose(dotted[0][0], dotted[1][0])


def test_grids_are_laid_over_each_other():
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1)
    figure = plot_grids({"one": {"a": grid, "b": grid + 0.1}, "two": {"a": grid}})
    first, second = figure.axes
    dots = [line for line in first.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dots[0].get_xydata(), (grid + 0.1).reshape(-1, 2))
    assert [line for line in second.lines if line.get_marker() == "o"] == []
    # three rows and four columns in lines, and an empty one for the legend
    assert len(second.lines) == 8
    assert first.yaxis_inverted()


def test_the_chi_square_curve_has_its_mean_and_encloses_one():
    ax = plot_chi_square([2.0, 5, 6, 9], 6, "chi-square")
    curve = next(line for line in ax.lines if "degrees" in str(line.get_label()))
    x, density = curve.get_xydata().T
    assert np.trapezoid(density, x) == pytest.approx(1, abs=1e-3)
    assert np.trapezoid(x * density, x) == pytest.approx(6, abs=0.02)
    # 95 % of chi-square with 6 degrees of freedom lie between 1.237 and 14.449 (any table)
    edges = [line.get_xdata()[0] for line in ax.lines if line.get_linestyle() == "--"]
    np.testing.assert_allclose(edges, [1.237, 14.449], atol=1e-3)


def test_intervals_reach_from_end_to_end_and_may_be_missing():
    curves = {"a": ([1, 2], [[3.0, 2.0, 5.0], [4.0, np.nan, np.nan]])}
    ax = plot_with_intervals(curves, "n", "mm", "xy", level=(0.3, "limit"))
    bars = ax.collections[0].get_segments()
    np.testing.assert_allclose(bars[0][:, 1], [2, 5])
    np.testing.assert_allclose(bars[1][:, 1], [4, 4])
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["1", "2"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["limit", "a"]
