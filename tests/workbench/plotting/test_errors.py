"""Residuals as arrows: what the titles say, by hand."""

import numpy as np

from workbench.plotting import plot_residuals


def test_a_camera_s_title_has_the_rms_of_what_was_used():
    """Lengths of 0.3 and 0.4 px, and a point that was not used."""
    uv = np.array([[[[100.0, 50.0], [200.0, 80.0], [300.0, 90.0]]]])
    residuals = np.array([[[[0.3, 0.0], [0.0, -0.4], [np.nan, np.nan]]]])
    figure = plot_residuals(uv, residuals, [(640, 480)], ["left"], ["0001"])
    title = figure.axes[0].get_title()
    assert title.startswith("left: 0.354 px rms")  # the root of (0.09 + 0.16) / 2
    (bar,) = figure.axes[1].patches
    np.testing.assert_allclose(bar.get_height(), np.sqrt(0.125), atol=1e-12)
