"""What the pictures of a filter show: densities, a gate in its image, a distribution."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from trinolab.window import Window
from workbench.plotting.kalman import (
    plot_beliefs,
    plot_learning,
    plot_normals,
    plot_prediction,
    plot_tracks,
)
from workbench.plotting.structure import plot_chain


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_densities_have_the_area_one_and_their_peak_at_the_mean():
    ax = plot_normals({"guess": (2.0, 4.0), "observation": (7.0, 1.0)}, "place")
    curves = [line for line in ax.lines if not line.get_label().startswith("_")]
    for line, mean in zip(curves, (2.0, 7.0), strict=True):
        x, y = line.get_data()
        assert np.trapezoid(y, x) == pytest.approx(1.0, abs=2e-3)  # 3.5 standard deviations
        assert x[y.argmax()] == pytest.approx(mean, abs=np.diff(x).max())


def test_a_belief_is_drawn_one_standard_deviation_from_its_mean():
    mean, P = np.array([1.0, -2.0]), np.array([[13.0, 9.0], [9.0, 9.0]])
    ax = plot_beliefs({"predicted": (mean, P)}, "place", "speed")
    away = np.column_stack(ax.lines[0].get_data()) - mean
    squared = np.einsum("ki,ij,kj->k", away, np.linalg.inv(P), away)
    assert squared == pytest.approx(np.ones(len(away)))
    assert np.abs(away).max(axis=0) == pytest.approx(np.sqrt(np.diag(P)), rel=1e-3)


def test_the_gate_is_an_ellipse_that_holds_its_share_of_the_innovations():
    S = np.array([[9.0, 4.0], [4.0, 16.0]])
    image = np.zeros((100, 120), np.uint8)
    found = [[50.0, 40.0], [60.0, 50.0]]
    places = Window(30, 20, 60, 60), Window(45, 35, 20, 20), (55.0, 45.0)
    ax = plot_prediction(image, *places, S, 0.9, found)
    gate = next(patch for patch in ax.patches if patch.get_label() == "gate, 90 %")
    drawn = np.random.default_rng(0).multivariate_normal(places[2], S, 4000)
    inside = gate.get_patch_transform().inverted().transform(drawn)
    share = np.mean((inside**2).sum(axis=1) <= 1)
    assert share == pytest.approx(0.9, abs=0.02)  # four standard errors of 4,000 draws
    assert {patch.get_label() for patch in ax.patches} >= {"search window"}


def test_one_stage_of_the_chain_is_lit():
    ax = plot_chain("window").axes[0]
    colours = {
        text.get_text(): text.get_bbox_patch().get_facecolor()
        for text in ax.texts
        if text.get_text()
    }
    lit = [name for name in colours if list(colours.values()).count(colours[name]) == 1]
    assert lit == ["window\nEq. 7-15"]
    with pytest.raises(ValueError, match=r"stage: expected one of frames, .*, got 'windows'"):
        plot_chain("windows")


def test_learning_shows_each_frame_s_belief_and_the_truth():
    wide, narrow = np.diag([4.0, 9.0]), np.diag([1.0, 2.0])
    ax = plot_learning([([0, 0], wide)] * 3, [([1, 2], narrow)] * 3, "place", "speed", 2.5)
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3"]
    reach = [np.ptp(line.get_ydata()) / 2 for line in ax.lines]
    assert reach[:6] == pytest.approx([3.0] * 3 + [np.sqrt(2.0)] * 3, rel=1e-3)
    assert set(ax.lines[-1].get_ydata()) == {2.5}


def test_tracks_stand_above_their_innovations_in_the_gate():
    t, truth = np.arange(4) / 30, np.array([0.0, 5.0, 12.0, 20.0])
    filtered = {
        "small": (truth + 3, np.full(4, 5.0), np.full(4, 4.0)),
        "large": (truth - 1, np.full(4, -2.0), np.full(4, 400.0)),
    }
    figure = plot_tracks(t, truth, truth + 0.5, filtered)
    above, below = np.reshape(figure.axes, (2, 2))
    for ax, (title, (mean, _, _)) in zip(above, filtered.items(), strict=True):
        assert ax.get_title() == title
        assert np.array_equal(ax.lines[2].get_ydata(), mean)
    for ax, off, gate in zip(below, (5.0, -2.0), (4.0, 400.0), strict=True):
        assert ax.lines[0].get_ydata() == pytest.approx([off] * 4)
        edges = ax.collections[0].get_paths()[0].vertices[:, 1]
        assert (edges.min(), edges.max()) == (-gate, gate)
