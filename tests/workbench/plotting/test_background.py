"""What the pictures of the background show: histories, shares, verdicts."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.plotting.background import plot_pixel_histories, plot_shares, plot_verdicts
from workbench.plotting.basics import show_table


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_a_history_marks_the_frames_beyond_the_threshold():
    levels, backgrounds = [45.0, 60.0, 61.0, 29.0], [45.0] * 4
    figure = plot_pixel_histories([0, 1, 2, 3], {"lamp": (levels, backgrounds)}, 15.0)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    # a difference of T itself is no motion
    assert lines["frame $f_k$"].get_xydata().tolist() == [[0, 45], [1, 60]]
    assert lines["counts as moving"].get_xydata().tolist() == [[2, 61], [3, 29]]
    assert figure.axes[0].get_title("left") == "lamp"


def test_verdicts_show_what_is_found_false_and_missed():
    mask = np.array([[True, True, True, False, False]])
    inside = np.array([[True, False, False, True, False]])
    outside = np.array([[False, True, False, False, True]])
    figure = plot_verdicts({"one": mask, "all": ~mask}, inside, outside)
    one, other = (ax.images[0].get_array() for ax in figure.axes)
    # found, false, found on the seam, missed, background
    np.testing.assert_array_equal(one, [[1, 2, 1, 3, 0]])
    np.testing.assert_array_equal(other, [[3, 0, 0, 1, 2]])
    assert [ax.get_title() for ax in figure.axes] == ["one", "all"]


def test_a_table_shows_every_number_in_its_place():
    _, ax = plt.subplots()
    show_table([[1, 2.5, 99], [0, 30, 4]], (6, 10), (0.1, 0.2, 0.5), ("T", "alpha"), "", ax)
    assert [(*text.get_position(), text.get_text()) for text in ax.texts[:3]] == [
        (0, 0, "1.00"),
        (1, 0, "2.50"),
        (2, 0, "99.00"),
    ]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0.1", "0.2", "0.5"]
    assert (ax.get_ylabel(), ax.get_xlabel()) == ("T", "alpha")


def test_shares_are_drawn_as_per_cent():
    figure = plot_shares(
        [0, 1], {"left": {"a": [0.0, 0.5], "b": [1.0, 0.25]}, "right": {"a": [0.1, 0.1]}}, log=True
    )
    left, right = figure.axes
    np.testing.assert_array_equal([line.get_ydata() for line in left.lines], [[0, 50], [100, 25]])
    np.testing.assert_array_equal(right.lines[0].get_ydata(), [10, 10])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
