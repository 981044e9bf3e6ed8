"""Cameras: a pixel by hand, OpenCV, depth signs, epipolar geometry from its definition."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import (
    Camera,
    Rig,
    RigCovariance,
    T_world_oxyz,
    difference,
    displaced,
    epipolar_lines,
    fundamental_matrix,
)
from trinolab.datasets import load_rig

MATRIX = np.array([[800.0, 0, 300.0], [0, 700.0, 250.0], [0, 0, 1]])
LENS = np.array([-0.25, 0.08, 0.003, -0.002, -0.01])
RATIONAL = np.array([0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022])
CLOUD = np.random.default_rng(1).uniform(-100, 100, (200, 3))


def camera(name="a", distortions=LENS, seed=0):
    """A camera in general position that looks at the origin from about 500 mm."""
    rng = np.random.default_rng(seed)
    T = RigidTransform.from_components(
        [10.0, -20.0, 500.0], Rotation.from_rotvec(rng.normal(0, 0.3, 3))
    )
    return Camera(name, (640, 480), MATRIX, distortions, T)


def plain(T=None, name="a"):
    return Camera(
        name, (640, 480), MATRIX, np.zeros(5), RigidTransform.identity() if T is None else T
    )


def test_a_pixel_by_hand():
    # The camera stands at (100, 0, 0) and looks along world x; its x axis is world -z, its y axis
    # world y.
    turn = Rotation.from_matrix([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    seen = plain(RigidTransform.from_components([100.0, 0, 0], turn).inv())
    # In its frame the point is (8, 4, 400): u = 300 + 800 * 8 / 400, v = 250 + 700 * 4 / 400.
    np.testing.assert_allclose(seen.project([[500.0, 4.0, -8.0]]), [[316.0, 257.0]], atol=1e-9)
    np.testing.assert_allclose(seen.centre, [100, 0, 0], atol=1e-12)
    np.testing.assert_allclose(seen.axis, [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    "distortions", [np.zeros(5), LENS, RATIONAL], ids=["ideal", "lens", "rational"]
)
def test_pixels_are_opencvs_and_lead_back_to_the_points(distortions):
    a = camera(distortions=distortions)
    local = np.ascontiguousarray(a.T_cam_world.apply(CLOUD))
    uv = a.project(CLOUD)
    theirs = cv2.projectPoints(local, np.zeros(3), np.zeros(3), MATRIX, distortions)[0]
    # px; rounding of pixels in the hundreds
    np.testing.assert_allclose(uv, theirs.reshape(-1, 2), atol=1e-9)
    xy = local[:, :2] / local[:, 2:]
    np.testing.assert_allclose(a.normalise(uv), xy, atol=1e-11)
    np.testing.assert_allclose(a.to_pixels(xy), uv, atol=1e-9)
    np.testing.assert_allclose(a.ideal_pixels(uv), xy * [800, 700] + [300, 250], atol=1e-8)
    to_point = CLOUD - a.centre
    rays = to_point / np.linalg.norm(to_point, axis=1, keepdims=True)
    np.testing.assert_allclose(a.rays(uv), rays, atol=1e-11)


def test_points_behind_or_missing_have_no_pixel():
    uv = plain().project(
        [[1.0, 2.0, -400.0], [1.0, 2.0, 0.0], [np.nan, 0.0, 400.0], [1.0, 2.0, 400.0]]
    )
    assert np.isnan(uv[:3]).all()
    assert np.isfinite(uv[3]).all()


def test_sees_follows_the_image_s_edges():
    # Pixel centres are whole numbers, so the image ends half a pixel outside: u -0.5 to 639.5, v
    # -0.5 to 479.5.
    inside = [[-0.49, 100], [639.49, 100], [100, -0.49], [100, 479.49], [500.0, 479.0]]
    outside = [[-0.51, 100], [639.51, 100], [100, -0.51], [100, 479.51], [479.0, 500.0]]
    for uv, seen in ((inside, True), (outside, False)):
        points = np.column_stack([(np.array(uv) - [300, 250]) / [800, 700], np.ones(5)]) * 400
        assert (plain().sees(points) == seen).all()
        assert not plain().sees(points, margin_px=5).any()
    middle = np.array([[4.6, 300.0], [4.4, 300.0], [634.4, 300.0], [634.6, 300.0]])
    points = np.column_stack([(middle - [300, 250]) / [800, 700], np.ones(4)])
    assert plain().sees(points, margin_px=5).tolist() == [True, False, True, False]
    assert not plain().sees([[np.nan] * 3, [0, 0, -1]]).any()


# --- two cameras


def pair(distortions=LENS):
    moved = RigidTransform.from_components(
        [-90.0, 5.0, 12.0], Rotation.from_rotvec([0.05, -0.2, 0.03])
    )
    left = camera("left", distortions)
    return left, Camera(
        "right", (640, 480), MATRIX * [[1.1], [1.2], [1.0]], distortions, moved * left.T_cam_world
    )


def test_fundamental_matrix_from_projections():
    left, right = pair(np.zeros(5))
    F = fundamental_matrix(left, right)
    a, b = (np.column_stack([c.project(CLOUD), np.ones(200)]) for c in (left, right))
    np.testing.assert_allclose(np.einsum("ij,jk,ik->i", b, F, a), 0.0, atol=1e-10)
    assert np.linalg.norm(F) == pytest.approx(1.0)


def test_epipolar_lines_pass_through_the_other_image():
    left, right = pair()
    uv = left.project(CLOUD)
    lines = epipolar_lines(left, right, np.vstack([uv, [[np.nan, np.nan]]]))
    ideal = right.ideal_pixels(right.project(CLOUD))
    for away in (0.0, 3.0):  # px
        points = np.column_stack([ideal + away * lines[:-1, :2], np.ones(200)])
        np.testing.assert_allclose((points * lines[:-1]).sum(axis=1), away, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(lines[:-1, :2], axis=1), 1.0, atol=1e-12)
    assert np.isnan(lines[-1]).all()


def test_oxyz_looks_midway_between_axes_that_are_not_parallel():
    """The second camera looks 20 deg higher than the first one: Z is 10 deg high."""
    a = plain(RigidTransform.from_translation([-5.0, 0, 0]), "a")
    up = Rotation.from_euler("X", 20, degrees=True)  # y points down
    b = plain(RigidTransform.from_components([80.0, 0, 0], up).inv(), "b")
    c, s = np.cos(np.deg2rad(10)), np.sin(np.deg2rad(10))
    T = T_world_oxyz(Rig((a, b)))
    np.testing.assert_allclose(
        T.rotation.as_matrix(), [[1, 0, 0], [0, c, -s], [0, s, c]], atol=1e-15
    )
    np.testing.assert_allclose(T.translation, [5, 0, 0], atol=1e-12)


def test_the_difference_of_two_rigs_leads_from_one_to_the_other():
    rig = replace(
        load_rig("raised_40deg"), covariance=RigCovariance(["ccd1", "ccd2", "ccd3"], np.eye(45))
    )
    delta = 0.01 * np.random.default_rng(0).standard_normal(45)
    moved = displaced(rig, delta)
    # rotation vectors there and back
    np.testing.assert_allclose(difference(moved, rig).ravel(), delta, atol=1e-12)
    assert not difference(rig, rig).any()
    assert moved.covariance is rig.covariance


def test_a_part_of_a_rig_is_known_as_well_as_the_whole():
    whole = Rig(load_rig("raised_40deg").cameras)
    known = RigCovariance(whole.names, np.diag(np.arange(45.0)), 3.0)
    part = replace(whole, covariance=known, reprojection_px=0.2).part([2, 0])
    assert part.names == ("ccd3", "ccd1")
    expected = np.r_[np.arange(30.0, 45.0), np.arange(15.0)]
    np.testing.assert_array_equal(np.diag(part.covariance.matrix), expected)
    assert (part.covariance.freedom, part.reprojection_px) == (3.0, 0.2)
    assert whole.part([0, 1]).covariance is None


# --- a camera by where it looks, and from what OpenCV gives


def test_a_camera_that_looks_at_a_point_has_it_in_its_middle_and_up_is_up():
    camera = Camera.look_at("c", (640, 480), 700.0, [300, -200, 100], [10, 20, 600])
    assert camera.centre == pytest.approx(np.array([300, -200, 100]), abs=1e-9)
    # y of this world points down: what lies higher has a smaller v, and the horizon is level
    middle, above = camera.project([[10, 20, 600], [10, -30, 600]])
    assert middle == pytest.approx(np.array([319.5, 239.5]), abs=1e-9)
    assert above[1] < 239.5
    assert above[0] == pytest.approx(319.5, abs=1e-9)


K = np.array([[810.0, 0, 333], [0, 805, 251], [0, 0, 1]])
RODRIGUES, SHIFT = np.array([[0.2], [-0.4], [0.1]]), np.array([[30.0], [-12], [500]])


OPENCV_LENSES = [
    (None, 5),
    ([LENS[:4]], 5),
    (LENS, 5),
    ([*LENS, 0, 0, 0], 5),
    (RATIONAL, 8),
    ([*RATIONAL, 0, 0, 0, 0], 8),
]


@pytest.mark.parametrize("R", [RODRIGUES, cv2.Rodrigues(RODRIGUES)[0]], ids=["vector", "matrix"])
@pytest.mark.parametrize(("lens", "kept"), OPENCV_LENSES)
def test_opencv_s_numbers_give_opencv_s_pixels(R, lens, kept):
    points = np.random.default_rng(0).uniform(-80, 80, (20, 3))
    camera = Camera.from_opencv("c", (640, 480), K, R, SHIFT, lens)
    theirs, _ = cv2.projectPoints(
        points, RODRIGUES, SHIFT, K, np.zeros(5) if lens is None else np.ravel(lens)
    )
    assert np.abs(camera.project(points) - theirs.reshape(-1, 2)).max() < 1e-9  # px
    assert len(camera.distortions) == kept


def test_a_rig_has_one_model_of_lenses():
    first, second = camera(distortions=LENS[:4]), camera("b", RATIONAL, 1)
    rig = Rig((first, second), RigCovariance.exact("ab"))
    assert first.distortions.tolist() == [*LENS[:4], 0]
    assert rig.cameras[0].distortions.tolist() == [*LENS[:4], 0, 0, 0, 0]
    np.testing.assert_array_equal(rig.cameras[0].project(CLOUD), first.project(CLOUD))
    assert rig.covariance.is_exact
    assert [name for name, _ in rig.parameters][7:12] == ["p2", "k3", "k4", "k5", "k6"]
    delta = np.linspace(-1e-4, 1e-4, 36)
    np.testing.assert_allclose(difference(displaced(rig, delta), rig).ravel(), delta, atol=1e-12)


# --- what is refused


def make(**changes):
    return replace(plain(), **changes)


def look(**changes):
    given = {"size": (640, 480), "focal_px": 500.0, "centre": [0, 0, 0], "target": [0, 0, 500]}
    return Camera.look_at("c", **{**given, **changes})


def opencv(**changes):
    return Camera.from_opencv("c", (640, 480), **{"K": K, "R": RODRIGUES, "t": SHIFT, **changes})


def rig_of(names="ab", **changes):
    return Rig(tuple(plain(name=name) for name in names), **changes)


def covariance(first, upper=0.0, lower=0.0):
    """Of one camera: 1, but for the first two numbers."""
    matrix = np.eye(15)
    matrix[0, 0], matrix[0, 1], matrix[1, 0] = first, upper, lower
    return RigCovariance(("a",), matrix)


REFUSED = [
    (make, {"name": ""}, "name"),
    (make, {"size": (0, 480)}, "size"),
    (make, {"size": (65536, 480)}, "size"),
    (make, {"matrix": MATRIX * [[-1], [1], [1]]}, "matrix: fx"),
    (make, {"matrix": MATRIX * [[1], [1e8], [1]]}, "matrix: fy"),
    (make, {"matrix": MATRIX + 1e10 * np.eye(3, k=2)}, "matrix: cx"),
    (make, {"matrix": MATRIX.T}, "matrix"),
    (make, {"matrix": 2 * MATRIX}, "matrix"),
    (make, {"distortions": np.zeros(6)}, "distortions: expected 4, 5 or 8, got 6"),
    (make, {"distortions": [0, 0, 0, -1.1e6, 0]}, "distortions: the largest"),
    (look, {"target": [0, 0, 0]}, "target - centre: expected a direction"),
    (look, {"target": [0, 500, 0]}, "up: expected a direction across"),
    (look, {"focal_px": 0.0}, "focal_px"),
    (opencv, {"R": 2 * np.eye(3)}, r"R: .* whose R R\^T is off by 3 "),
    (opencv, {"R": np.diag([1.0, 1, -1])}, "whose determinant is -1"),
    (opencv, {"distortions": [0.1, 0, 0]}, "distortions: expected 0, 4, 5, 8, 12 or 14"),
    (opencv, {"distortions": [*[0] * 8, 0.1, 0, 0, 0]}, "distortions: expected k1, .*, k6"),
    (rig_of, {"names": "a"}, "cameras: expected two or more, got 1"),
    (rig_of, {"names": "aba"}, "cameras: expected different names"),
    (Rig, {"cameras": [1, 2]}, "cameras: expected values of Camera, got 1"),
    (rig_of, {"reprojection_px": 0.0}, "reprojection_px"),
    (rig_of, {"covariance": RigCovariance("ac", np.eye(30))}, "cameras a, b, got a, c"),
    (rig_of, {"covariance": RigCovariance("ab", np.eye(36))}, "15 parameters .*, got 18"),
    (covariance, {"first": -1.0}, "negative variance"),
    (covariance, {"first": 1.0, "upper": 1e-5}, "not symmetric"),
    (covariance, {"first": 1.0, "upper": 1.1, "lower": 1.1}, "negative eigenvalue"),
    (covariance, {"first": 0.0, "upper": 0.1, "lower": 0.1}, "a number without a variance"),
    (RigCovariance, {"names": "a", "matrix": np.eye(15), "freedom": 0}, "freedom"),
    (fundamental_matrix, {"left": plain(), "right": plain(name="b")}, "no baseline"),
    (T_world_oxyz, {"rig": rig_of()}, "baseline of a and b"),
    (T_world_oxyz, {"rig": rig_of(), "second": 2}, "first, second: expected 0 to 1"),
]


@pytest.mark.parametrize(("call", "changes", "message"), REFUSED)
def test_refuses(call, changes, message):
    with pytest.raises(ValueError, match=message):
        call(**changes)
