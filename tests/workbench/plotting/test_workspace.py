"""What the plan of the cones shows: where they look, where they are cut, and the paper's letters."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from trinolab.workspace.cones import inside, paper_cones
from workbench.plotting.workspace import show_cones_from_above

NAMES = ("CCD1", "CCD2", "CCD3")


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_points_of_the_plan_are_inside_the_wedge_when_they_are_inside_the_cone():
    cones = paper_cones(1.0, np.deg2rad(60), np.deg2rad(50), 0.3)
    _, ax = plt.subplots()
    show_cones_from_above(cones, NAMES, "", ax, reach=3.0)
    plan = np.random.default_rng(0).uniform(-0.2, 1.2, (500, 2))
    points = np.column_stack([plan[:, 0], np.zeros(500), plan[:, 1]])
    filled = {patch.get_label(): patch for patch in ax.patches}
    for cone, name in zip(cones, NAMES, strict=True):
        shown = filled[name].get_path().contains_points(plan)
        assert np.mean(shown == inside([cone], points)) > 0.99  # the circle is a polygon of 72
        assert 0 < shown.sum() < 500


def test_the_letters_stand_where_the_axes_meet():
    _, ax = plt.subplots()
    B, beta1, beta2 = 1.0, np.deg2rad(60), np.deg2rad(45)
    show_cones_from_above(paper_cones(B, beta1, beta2, 0.3), NAMES, "", ax, 2.0, letters=True)
    x0 = B * np.tan(beta2) / (np.tan(beta1) + np.tan(beta2))
    meeting = ax.lines[-1].get_xydata()[0]
    np.testing.assert_allclose(meeting, [x0, x0 * np.tan(beta1)])
    said = {text.get_text().strip() for text in ax.texts}
    assert said >= {"$B$", "$x_0$", "$z_0$", r"$\beta_1$", r"$\beta_2$"}
