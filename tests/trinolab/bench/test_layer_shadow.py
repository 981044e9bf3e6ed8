"""Shadows against where a straight line from the light through the rod meets the wall, by hand."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import Arm
from trinolab.bench.layer import WALL_MM, shadow
from trinolab.bench.optics import Bench
from trinolab.camera import Camera
from trinolab.handle import Handle

MATRIX = [[850.0, 0, 150], [0, 850, 150], [0, 0, 1]]  # one pixel a mm on the wall
CAMERA = Camera("one", (400, 300), MATRIX, np.zeros(5), RigidTransform.identity())
ROD = Handle("rod", 10.0, 60.0, 30.0, 3.0, (180.0,), ((0.0,),))
# 300 mm before the wall
AT = RigidTransform.from_components([0.0, 0.0, 550.0], Rotation.identity())
LIT = Bench(light=(-0.5, 0.1, -1.0))  # the shadow is 150 mm further right, 30 mm further up


def middle(dark):
    v, u = np.indices(dark.shape)
    return [np.average(u, weights=dark), np.average(v, weights=dark)]


def test_a_shadow_lies_where_the_light_is_missing():
    dark = shadow(CAMERA, ROD, AT, LIT)
    assert dark.shape == (300, 400)
    assert WALL_MM == 850.0
    np.testing.assert_allclose(middle(dark), [300, 120], atol=0.5)
    assert dark[120, 300] > 0.95
    assert dark.max() <= 1 + 1e-6
    # the shadow of a cylinder along y: its width over the cosine of the slant, its length more by
    # what tilts the ends
    assert 60 * 20 < dark.sum() < 1.3 * 60 * 24 + 400  # two pixels to spare around it
    assert dark[:, :250].max() == 0


def test_an_arm_throws_one_too_and_no_light_throws_none():
    rod = shadow(CAMERA, ROD, AT, LIT)
    both = shadow(CAMERA, ROD, AT, LIT, Arm(grip_mm=(-25.0, -5.0)))
    assert both.sum() > 1.5 * rod.sum()
    assert (both >= rod - 1e-6).all()
    assert not shadow(CAMERA, ROD, AT, Bench(light=(0.0, -1.0, 0.2))).any()


def test_what_stands_behind_the_wall_throws_none_before_it():
    beyond = shadow(CAMERA, ROD, RigidTransform.from_translation([0.0, 0, 900]), LIT)
    np.testing.assert_allclose(middle(beyond > 0.5), [150, 150], atol=1)  # behind itself
