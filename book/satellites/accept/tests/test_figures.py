"""The figures of the data sheet show what they are given, with what was computed from it."""

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from satellites.accept.figures import (
    plot_allan,
    plot_control_chart,
    plot_explained,
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


def test_shares_stand_in_their_cells_and_what_is_sure_has_a_frame():
    shares = np.array([[1.4, -3.0, 90.0], [20.0, 55.0, 0.0]])
    sure = np.array([[False, False, True], [False, True, False]])
    (ax,) = plot_explained(shares, sure, ["x", "y"], ["a", "b", "c"]).axes
    texts = {text.get_position(): (text.get_text(), text.get_color()) for text in ax.texts}
    written = [texts[column, row][0] for row in range(2) for column in range(3)]
    assert written == ["1", "0", "90", "20", "55", "0"]  # no share is below none
    assert {at for at, (_, colour) in texts.items() if colour == "w"} == {(2, 0), (1, 1)}
    frames = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    framed = {(round(one.get_x() + 0.46), round(one.get_y() + 0.46)) for one in frames}
    assert framed == {(2, 0), (1, 1)}


def test_a_control_chart_has_its_intervals_the_first_as_a_band_and_names_for_ten_at_most():
    names = [f"c{k}" for k in range(23)]
    values = 1 + 0.01 * np.arange(23)
    limits = np.column_stack([values - 0.1, values + 0.2])
    (ax,) = plot_control_chart(names, values, limits, "jitter / mm").axes
    (bars,) = ax.containers
    np.testing.assert_array_equal(bars.lines[0].get_ydata(), values)
    ends = np.array([segment[:, 1] for segment in bars.lines[2][0].get_segments()])
    np.testing.assert_allclose(ends, limits, rtol=1e-12)
    (band,) = ax.patches
    np.testing.assert_allclose([band.get_y(), band.get_y() + band.get_height()], [0.9, 1.2])
    shown = [label.get_text() for label in ax.get_xticklabels()]
    assert shown == names[::3]
