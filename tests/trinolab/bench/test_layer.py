"""The layer before the background: cropped windows see the same, and a layer may reach beyond its
image.
"""

from dataclasses import replace

import numpy as np
import pytest

from trinolab.bench.hand import Arm
from trinolab.bench.layer import Layer, cropped, foreground, over
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import scaled
from trinolab.datasets import load_handle, load_rig

CAMERA, CODED = scaled(load_rig("paper_pair").cameras[1], 0.25), load_handle("coded")
BENT = replace(CAMERA, distortions=[-0.2, 0.1, 0.001, -0.001, 0.0])


def test_over_covers_by_shares_and_leaves_the_background_alone():
    behind = np.full((4, 5), 10.0)
    layer = Layer(np.array([[3.0, 100.0]]), np.array([[0.25, 1.0]]), (2, 1))
    image = over(layer, behind)
    assert image[1].tolist() == [10.0, 10.0, 10.5, 100.0, 10.0]
    assert (np.delete(image, 1, axis=0) == 10).all()
    assert (behind == 10).all()


@pytest.mark.parametrize(
    ("corner", "kept"), [((-1, -1), (0, 0)), ((4, 3), (3, 4)), ((9, 9), None), ((-5, 0), None)]
)
def test_a_layer_may_reach_beyond_its_image_or_lie_outside(corner, kept):
    layer = Layer(np.full((2, 2), 7.0), np.ones((2, 2)), corner)
    image = over(layer, np.zeros((4, 5)))
    assert list(zip(*np.nonzero(image), strict=True)) == ([] if kept is None else [kept])


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["plain", "bent"])
def test_a_window_sees_what_the_image_sees(camera):
    window, uv = cropped(camera, (40, -20), (100, 90)), np.array([[3.0, 30.0], [77.5, 60.25]])
    np.testing.assert_allclose(window.rays(uv), camera.rays(uv + [40, -20]), atol=1e-12)
    assert window.size == (100, 90)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["plain", "bent"])
def test_a_wider_camera_has_the_same_layer(camera):
    rng = np.random.default_rng(3)
    for arm in (None, Arm()):
        T = random_pose(rng)
        wide = cropped(camera, (-30, -30), (camera.size[0] + 60, camera.size[1] + 60))
        outer = foreground(wide, CODED, T, Bench(), arm)
        moved = outer._replace(corner=(outer.corner[0] - 30, outer.corner[1] - 30))
        flat = np.full(camera.size[::-1], 45.0)
        inner = over(foreground(camera, CODED, T, Bench(), arm), flat)
        inside = np.s_[2:-2, 2:-2]  # at the image's border fewer neighbours tell of edges
        np.testing.assert_allclose(over(moved, flat)[inside], inner[inside], atol=1e-9)
