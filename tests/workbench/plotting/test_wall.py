"""Curves of the wall's figures."""

import matplotlib.pyplot as plt
import numpy as np

from trinolab.slave.wall import Loop, delayed_response, sampled_response
from workbench.plotting.wall import plot_limits, plot_nyquist


def test_figures_show_their_curves():
    omega, loop = np.geomspace(1, 90, 50), Loop(0.2, 2.0, 1 / 30, 0.05)
    figure = plot_nyquist({"a": (sampled_response(loop, omega), delayed_response(loop, omega))})
    lines = figure.axes[0].get_lines()
    np.testing.assert_allclose(lines[1].get_ydata(), sampled_response(loop, omega).imag)
    assert [line.get_linestyle() for line in lines[1:3]] == ["-", "--"]
    figure = plot_limits([0.0, 0.1], {"30 Hz": [100.0, 10.0]}, {"simulated": [np.nan, 10.0]})
    np.testing.assert_allclose(figure.axes[0].get_lines()[0].get_xdata(), [0.0, 100.0])
    plt.close("all")
