"""What the rod's section shows: the marker on the rod, and its image below it."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.plotting.markers import plot_rod_section


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_the_section_has_the_marker_on_the_rod_and_its_image_below():
    ax = plot_rod_section(5.0, 3.0, 55.0, 3.96)
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    marker = lines["marker"]
    np.testing.assert_allclose(np.linalg.norm(marker, axis=1), 5.0)  # on the rod
    steps = np.linalg.norm(np.diff(marker, axis=0), axis=1).sum()
    assert steps == pytest.approx(3.0, rel=1e-3)  # as long as wide when it was flat
    middle, centroid = lines["its middle"][0], lines["centroid of its image"][0]
    assert middle[0] == pytest.approx(5 * np.sin(np.deg2rad(55)))
    assert centroid[0] == 3.96
    assert marker[:, 0].min() < centroid[0] < middle[0] < marker[:, 0].max()
