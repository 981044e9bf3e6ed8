"""What the pictures of the pose show: rays that meet in their point, frames where they are."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from trinolab.datasets import load_rig, load_table1
from workbench.plotting.pose import plot_frames, plot_two_rays
from workbench.plotting.structure import plot_chain


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_two_rays_cross_in_the_marker_they_come_from():
    left, right = load_rig("paper_pair").cameras
    point = np.array([20.0, -30.0, 560.0])  # of CCD1's frame, which is the world
    uv_left, uv_right = left.project([point])[0], right.project([point])[0]
    ax = plot_two_rays(left, right, uv_left, uv_right, 50.0)
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    np.testing.assert_allclose(lines["the marker"], [[560, 20]], atol=1e-6)  # z, x
    np.testing.assert_allclose(lines["baseline"][1], right.centre[[2, 0]], atol=1e-9)
    *wedges, overlap = ax.patches
    for wedge, name in zip(wedges, ("CCD1", "CCD2"), strict=True):
        start, end = lines[f"{name}'s ray"]
        corners = wedge.get_xy()[:3]
        np.testing.assert_allclose(corners[0], start)
        # the ray lies within its wedge
        along = end - start
        sides = [np.linalg.det([corner - start, along]) for corner in corners[1:]]
        assert sides[0] * sides[1] < 0
    low, high = overlap.get_xy().min(axis=0), overlap.get_xy().max(axis=0)
    assert (low < [560, 20]).all()
    assert (high > [560, 20]).all()
    assert (high - low)[0] > 5 * (high - low)[1]  # a lozenge along z


def test_every_frame_has_its_name_and_three_axes():
    rig = load_rig("raised_40deg")
    T = load_table1().set_poses[9]
    ax = plot_frames(rig, T).axes[0]
    said = [text.get_text().strip() for text in ax.texts]
    names = ["CCD1", "CCD2", "CCD3", "handle"]
    assert [name for name in said if name in names] == names
    assert [said.count(f"${letter}$") for letter in "xyz"] == [4, 4, 4]
    ways = dict(
        zip(
            ("Eq. 21", "Eq. 23"),
            (line for line in ax.lines if line.get_linestyle() == ":"),
            strict=True,
        )
    )
    x, y, z = T.translation
    # z to the right, y down, x obliquely; CCD1 is the world's origin
    np.testing.assert_allclose(ways["Eq. 23"].get_xydata(), [[z - 0.4 * x, 0.45 * x - y], [0, 0]])


def test_two_stages_of_the_chain_are_lit():
    boxes = [text for text in plot_chain("points", "pose").axes[0].texts if text.get_text()]
    colours = [box.get_bbox_patch().get_facecolor() for box in boxes]
    lit = [
        box.get_text().split("\n")[0]
        for box, colour in zip(boxes, colours, strict=True)
        if colour != colours[0]
    ]
    assert lit == ["points", "pose"]
