"""What the pictures of a filter show: densities, a gate in its image, a distribution."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from trinolab.window import Window
from workbench.plotting import plot_beliefs, plot_chain, plot_nis, plot_normals, plot_prediction


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


def test_nis_of_normal_numbers_follows_its_curve():
    nis = (np.random.default_rng(1).standard_normal((20_000, 2)) ** 2).sum(axis=1)
    ax = plot_nis(nis, 0.999)
    heights = np.array([bar.get_height() for bar in ax.patches[:6]])
    edges = 0.5 * np.arange(7)
    expected = -np.diff(np.exp(-edges / 2)) / 0.5
    np.testing.assert_allclose(heights, expected, rtol=0.1)


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
