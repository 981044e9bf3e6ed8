"""Motion blur against what a moving spot's moments must be, and against the scene at rest."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import Arm
from trinolab.bench.layer import over
from trinolab.bench.optics import Bench, background, blurred
from trinolab.bench.scene import EXPOSURE_S, exposed, radiance, scaled, smeared
from trinolab.camera import Camera
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle, slants

MATRIX = np.array([[1500.0, 0, 80], [0, 1500, 60], [0, 0, 1]])
CAMERA = Camera("one", (160, 120), MATRIX, np.zeros(5), RigidTransform.identity())
PAIR, PAPER, T4 = load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses[4]
STILL = np.zeros(3)
# one marker, turned towards the camera
ROD = Handle("rod", 5.0, 60.0, 30.0, 3.0, (180.0,), ((0.0,),))
MARKERS_ALONE = Bench(background_grey=0.0, body_grey=0.0, marker_grey=200.0, shading=0.0)
AT = RigidTransform.from_translation([0.0, 0.0, 505.0])


def moments(image):
    """Sum, mean (u, v) and covariance (2, 2) of an image's light."""
    v, u = np.indices(image.shape)
    points, weights = np.column_stack([u.ravel(), v.ravel()]), image.ravel()
    return (
        weights.sum(),
        np.average(points, axis=0, weights=weights),
        np.cov(points.T, aweights=weights, ddof=0),
    )


def test_at_rest_it_is_the_scene():
    camera = PAIR.cameras[1]
    image = exposed(camera, PAPER, T4, Bench(), STILL, STILL)
    # a quaternion's rounding
    np.testing.assert_allclose(image, radiance(camera, PAPER, T4, Bench()), rtol=0, atol=1e-11)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)])
def test_a_moving_marker_is_smeared_about_its_place_at_mid_exposure(direction):
    velocity = 310.0 * np.array([*direction, 0.0])
    path_px = 310.0 * EXPOSURE_S * 1500.0 / 500.0 * np.array(direction)  # the marker is 500 mm away
    still, moving = (
        moments(exposed(CAMERA, ROD, AT, MARKERS_ALONE, v, STILL)) for v in (STILL, velocity)
    )
    assert moving[0] == pytest.approx(still[0], rel=0.002)  # no light is lost
    np.testing.assert_allclose(moving[1], still[1], atol=0.005)
    spread = np.outer(path_px, path_px) / 12  # of a uniform distribution along the path
    np.testing.assert_allclose(moving[2] - still[2], spread, atol=0.02 * spread.max())


def test_a_turn_smears_across_the_axis_it_is_about():
    turn = np.array([0.0, 40.0, 0.0])  # rad/s about the rod, by 0.2 rad either way
    still, moving = (
        moments(exposed(CAMERA, ROD, AT, MARKERS_ALONE, STILL, w)) for w in (STILL, turn)
    )
    growth = moving[2] - still[2]
    across = np.linspace(-1.5, 1.5, 301)  # mm on the wrapped disc, by its chords
    chord, angles = np.sqrt(1.5**2 - across**2), np.linspace(-0.2, 0.2, 201)[:, None]
    # 3 px/mm, foreshortened
    u, light = 15.0 * np.sin(angles + across / 5.0), chord * np.cos(angles + across / 5.0)
    wide = np.average(u**2, weights=light)
    narrow = np.average(u[100] ** 2, weights=light[100])
    assert growth[0, 0] == pytest.approx(wide - narrow, rel=0.02)
    assert abs(growth[1, 1]) < 0.03  # px^2 of 5, by 6 x 6 samples a pixel


def test_refuses_what_is_no_motion():
    with pytest.raises(ValueError, match="velocity"):
        exposed(CAMERA, ROD, AT, Bench(), np.zeros(2), STILL)
    with pytest.raises(ValueError, match="exposure_s"):
        exposed(CAMERA, ROD, AT, Bench(), STILL, STILL, -1.0)


# --- drawn once and moved


def centroid(image, uv, half=26):
    """Centroid of the light around a pixel, which `uv` names; shape (2,)."""
    u, v = np.round(uv).astype(int)
    _, mean, _ = moments(image[v - half : v + half + 1, u - half : u + half + 1])
    return mean + [u - half, v - half]


def drawn(camera, handle, T, bench, *motion, arm=None):
    return over(smeared(camera, handle, T, bench, *motion, arm), background(camera, bench))


@pytest.mark.slow
def test_smeared_is_exposed():
    camera = PAIR.cameras[1]
    velocity, turn = np.array([-250.0, 180.0, 120.0]), np.deg2rad([25.0, -15.0, 20.0])
    bench = Bench(background_grey=0.0, body_grey=0.0, shading=0.0)
    slow = exposed(camera, PAPER, T4, bench, velocity, turn)
    fast = drawn(camera, PAPER, T4, bench, velocity, turn)
    facing = slants(PAPER, T4, camera.centre) < np.deg2rad(50)
    uv = camera.project(T4.apply(PAPER.marker_centres))[facing]
    assert len(uv) >= 2
    for pixel in uv:
        # px; worst seen 0.05
        np.testing.assert_allclose(centroid(fast, pixel), centroid(slow, pixel), atol=0.06)
    assert fast.sum() == pytest.approx(slow.sum(), rel=0.003)
    # of 220 grey levels
    assert np.sqrt(np.mean((blurred(fast, bench) - blurred(slow, bench))[slow > 1] ** 2)) < 3


@pytest.mark.slow
def test_arm_and_handle_are_smeared_alike():
    camera, bench, arm = scaled(PAIR.cameras[0], 0.25), Bench(), Arm()
    still = drawn(camera, PAPER, T4, bench, STILL, STILL, arm=arm)
    assert (still == radiance(camera, PAPER, T4, bench, arm)).all()
    velocity = np.array([400.0, 0, 0])
    moving = drawn(camera, PAPER, T4, bench, velocity, STILL, arm=arm)
    ways = velocity * EXPOSURE_S * ((np.arange(12)[:, None] + 0.5) / 12 - 0.5)
    poses = [RigidTransform.from_translation(way) * T4 for way in ways]
    exact = np.mean([radiance(camera, PAPER, T, bench, arm) for T in poses], axis=0)
    assert np.abs(moving - exact).mean() < 0.2 * np.abs(still - exact).mean()


def test_what_leaves_the_image_has_no_edge_at_its_border():
    bench = Bench(background_grey=0.0, shading=0.0)
    above = RigidTransform.from_translation([0.0, -35, 505])
    image = drawn(CAMERA, ROD, above, bench, np.array([0.0, 600, 0]), STILL)
    # the rod comes in over the upper border
    assert image[0, 80] == pytest.approx(image[6, 80], abs=1)


@pytest.mark.parametrize(
    ("place", "arm"), [([900.0, 0, 505], None), ([0, 0, -505.0], Arm())], ids=["beside", "behind"]
)
def test_a_smeared_handle_outside_the_image_is_nothing(place, arm):
    T = RigidTransform.from_translation(place)
    assert not smeared(CAMERA, ROD, T, Bench(), np.array([300.0, 0, 0]), STILL, arm).light.size
