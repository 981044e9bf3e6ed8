"""The figures of the data sheet show what they are given, with what was computed from it."""

import numpy as np
from matplotlib.colors import to_rgba

from satellites.accept.figures import (
    plot_allan,
)
from workbench.plotting.basics import COLOURS


def lines(ax, colour):
    """The lines of a colour, x and y each."""
    return [line.get_data() for line in ax.lines if to_rgba(line.get_color()) == to_rgba(colour)]


def test_allan_deviations_of_all_places_are_their_rms_as_far_as_all_of_them_reach():
    long = np.array([1.0, 2.0, 4.0]), np.array([3.0, 2.0, 1.0])
    short = np.array([1.0, 2.0]), np.array([1.0, 2.0])
    (ax,) = plot_allan([long, short], "deviation / mm").axes
    places = lines(ax, "0.65")
    np.testing.assert_array_equal(places[0], long)
    np.testing.assert_array_equal(places[1], short)
    ((tau, together),) = lines(ax, COLOURS[0])
    np.testing.assert_array_equal(tau, [1, 2])
    np.testing.assert_allclose(together, [np.sqrt(5), 2], rtol=1e-12)
    ((tau, white),) = lines(ax, "black")
    np.testing.assert_allclose(white, together[0] / np.sqrt(tau), rtol=1e-12)
    assert (ax.get_xscale(), ax.get_yscale(), ax.get_ylabel()) == ("log", "log", "deviation / mm")
