"""What the figures of a calibration show: boards where they were, residuals, bars."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.calibration.target import Board
from trinolab.datasets import load_rig
from workbench.plotting.basics import plot_with_intervals
from workbench.plotting.calibration import plot_boards, plot_residuals


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


def test_intervals_reach_from_end_to_end_and_may_be_missing():
    curves = {"a": ([1, 2], [[3.0, 2.0, 5.0], [4.0, np.nan, np.nan]])}
    ax = plot_with_intervals(curves, "n", "mm", "xy", level=(0.3, "limit"))
    bars = ax.collections[0].get_segments()
    np.testing.assert_allclose(bars[0][:, 1], [2, 5])
    np.testing.assert_allclose(bars[1][:, 1], [4, 4])
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["1", "2"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["limit", "a"]


def test_a_camera_s_title_has_the_rms_of_what_was_used():
    """Lengths of 0.3 and 0.4 px, and a point that was not used."""
    uv = np.array([[[[100.0, 50.0], [200.0, 80.0], [300.0, 90.0]]]])
    residuals = np.array([[[[0.3, 0.0], [0.0, -0.4], [np.nan, np.nan]]]])
    figure = plot_residuals(uv, residuals, [(640, 480)], ["left"], ["0001"])
    title = figure.axes[0].get_title()
    assert title.startswith("left: 0.354 px rms")  # the root of (0.09 + 0.16) / 2
    (bar,) = figure.axes[1].patches
    np.testing.assert_allclose(bar.get_height(), np.sqrt(0.125), atol=1e-12)
