"""The picture of the rig shows the cameras where they stand."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.plotting.structure import plot_rig


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_cameras_and_rod_are_where_they_are():
    corners = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    centres = {"left": np.zeros(3), "right": np.array([100.0, 0.0, 0.0])}
    views = {name: (centre, centre + corners) for name, centre in centres.items()}
    rod = [[0.0, -50.0, 500.0], [0.0, 50.0, 500.0]]
    axes = [[0.0, 0.0, 500.0], [60.0, 0.0, 500.0], [0.0, 60.0, 500.0], [0.0, 0.0, 560.0]]
    (ax,) = plot_rig(views, rod, [[5.0, 10.0, 495.0]], axes).axes
    drawn = [np.array(line.get_data_3d()).T[:, [0, 2, 1]] for line in ax.lines]  # x, y, z
    assert any(np.array_equal(line, rod) for line in drawn)
    for centre in centres.values():
        rays = [line for line in drawn if len(line) == 2 and np.array_equal(line[0], centre)]
        assert len(rays) == 5  # four edges of the pyramid, and the line of sight
        assert sum(np.allclose(line[1], axes[0]) for line in rays) == 1
    assert {text.get_text().strip() for text in ax.texts} == {"left", "right", "$x$", "$y$", "$z$"}
    assert ax.zaxis_inverted()  # the world's y points down
