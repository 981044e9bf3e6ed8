"""Cameras: a pixel by hand, OpenCV, depth signs, epipolar geometry from its definition."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import (
    Camera,
    Rig,
    RigCovariance,
    T_between,
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


def cloud(n=200):
    return np.random.default_rng(1).uniform(-100, 100, (n, 3))


def test_a_pixel_by_hand():
    # u = 800 * 20 / 400 + 300, v = 700 * (-40) / 400 + 250; x right, y down, so the point is above
    # the middle.
    np.testing.assert_allclose(
        plain().project([[20.0, -40.0, 400.0]]), [[340.0, 180.0]], atol=1e-12
    )


def test_a_pixel_by_hand_of_a_camera_elsewhere():
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
def test_project_equals_opencv(distortions):
    a = camera(distortions=distortions)
    rotation, translation = a.T_cam_world.rotation.as_rotvec(), a.T_cam_world.translation
    theirs = cv2.projectPoints(
        cloud().reshape(-1, 1, 3),
        rotation.reshape(3, 1),
        translation.reshape(3, 1),
        MATRIX,
        distortions.reshape(-1, 1),
    )[0].reshape(-1, 2)
    # px; rounding of pixels in the hundreds
    np.testing.assert_allclose(a.project(cloud()), theirs, atol=1e-9)


def test_rotation_vector_is_opencv_s():
    rotation = camera().T_cam_world.rotation
    np.testing.assert_allclose(
        cv2.Rodrigues(rotation.as_rotvec().reshape(3, 1))[0], rotation.as_matrix(), atol=1e-14
    )


def test_normalise_equals_opencv():
    a = camera()
    uv = np.random.default_rng(2).uniform([100, 80], [540, 400], (200, 2))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    theirs = cv2.undistortPoints(
        uv.reshape(-1, 1, 2), MATRIX, LENS.reshape(-1, 1), criteria=criteria
    ).reshape(-1, 2)
    np.testing.assert_allclose(a.normalise(uv), theirs, atol=1e-9)
    np.testing.assert_allclose(a.ideal_pixels(uv), theirs * [800, 700] + [300, 250], atol=1e-6)


def test_points_behind_or_missing_have_no_pixel():
    uv = plain().project(
        [[1.0, 2.0, -400.0], [1.0, 2.0, 0.0], [np.nan, 0.0, 400.0], [1.0, 2.0, 400.0]]
    )
    assert np.isnan(uv[:3]).all()
    assert np.isfinite(uv[3]).all()


def test_rays_start_at_the_centre_and_go_through_the_points():
    a, points = camera(), cloud()
    rays = a.rays(a.project(points))
    to_point = points - a.centre
    depth = np.einsum("ij,ij->i", to_point, rays)
    assert (depth > 0).all()
    np.testing.assert_allclose(depth[:, None] * rays, to_point, atol=1e-8)  # mm
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-14)


def test_sees_follows_the_image_s_edges():
    # Pixel centres are whole numbers, so the image ends half a pixel outside: u -0.5 to 639.5, v
    # -0.5 to 479.5.
    uv = np.array(
        [
            [-0.49, 100],
            [-0.51, 100],
            [639.49, 100],
            [639.51, 100],
            [100, -0.49],
            [100, 479.49],
            [100, 479.51],
            [500.0, 479.0],
            [479.0, 500.0],
        ]
    )
    points = np.column_stack([(uv - [300, 250]) / [800, 700], np.ones(len(uv))]) * 400
    assert plain().sees(points).tolist() == [
        True,
        False,
        True,
        False,
        True,
        True,
        False,
        True,
        False,
    ]
    assert plain().sees(points, margin_px=5).tolist() == [False] * 9
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
    a, b = (np.column_stack([c.project(cloud()), np.ones(200)]) for c in (left, right))
    np.testing.assert_allclose(np.einsum("ij,jk,ik->i", b, F, a), 0.0, atol=1e-10)
    assert np.linalg.norm(F) == pytest.approx(1.0)
    assert abs(np.linalg.det(F)) < 1e-12
    # estimated from the points alone
    theirs = cv2.findFundamentalMat(a[:, :2], b[:, :2], cv2.FM_8POINT)[0]
    theirs /= np.linalg.norm(theirs)
    np.testing.assert_allclose(F, theirs * np.sign(np.vdot(F, theirs)), atol=1e-7)


def test_fundamental_matrix_from_its_definition():
    # The epipoles are the images of the other centre: F e_left = 0 and e_right F = 0.
    left, right = pair(np.zeros(5))
    F = fundamental_matrix(left, right)
    for camera_, other, M in ((left, right, F), (right, left, F.T)):
        local = camera_.T_cam_world.apply(other.centre)
        epipole = camera_.matrix @ local
        np.testing.assert_allclose(M @ (epipole / np.linalg.norm(epipole)), 0.0, atol=1e-12)


def test_epipolar_lines_pass_through_the_other_image():
    left, right = pair()
    uv = left.project(cloud())
    lines = epipolar_lines(left, right, np.vstack([uv, [[np.nan, np.nan]]]))
    ideal = right.ideal_pixels(right.project(cloud()))
    distances = np.einsum("ij,ij->i", lines[:-1, :2], ideal) + lines[:-1, 2]
    np.testing.assert_allclose(distances, 0.0, atol=1e-6)  # px
    np.testing.assert_allclose(np.linalg.norm(lines[:-1, :2], axis=1), 1.0, atol=1e-12)
    assert np.isnan(lines[-1]).all()
    off = ideal + 3.0 * lines[:-1, :2]
    np.testing.assert_allclose(
        np.einsum("ij,ij->i", lines[:-1, :2], off) + lines[:-1, 2], 3.0, atol=1e-6
    )


def test_transform_between_cameras_cancels():
    left, right = pair()
    there = T_between(right, left).apply(left.T_cam_world.apply(cloud()))
    np.testing.assert_allclose(there, right.T_cam_world.apply(cloud()), atol=1e-10)
    round_trip = T_between(left, right) * T_between(right, left)
    np.testing.assert_allclose(round_trip.as_matrix(), np.eye(4), atol=1e-12)


def test_oxyz_of_a_pair_by_hand():
    # Two parallel cameras along world y that look along x: X = y, Z = x, Y = Z x X = x cross y = z.
    looking = Rotation.from_matrix(np.column_stack([[0, 1, 0], [0, 0, 1], [1, 0, 0]]))
    a, b = (
        plain(RigidTransform.from_components(c, looking).inv(), name)
        for c, name in (([5.0, 0, 0], "a"), ([5.0, 80.0, 0], "b"))
    )
    T = T_world_oxyz(Rig((a, b)))
    np.testing.assert_allclose(
        T.rotation.as_matrix(), np.column_stack([[0, 1, 0], [0, 0, 1], [1, 0, 0]]), atol=1e-15
    )
    np.testing.assert_allclose(T.translation, [5, 0, 0], atol=1e-12)


def test_oxyz_looks_midway_between_axes_that_are_not_parallel():
    """The second camera looks 20 deg higher than the first one: Z is 10 deg high."""
    a = plain(name="a")
    up = Rotation.from_euler("X", 20, degrees=True)  # y points down
    b = plain(RigidTransform.from_components([80.0, 0, 0], up).inv(), "b")
    tenth = np.deg2rad(10)
    z = T_world_oxyz(Rig((a, b))).rotation.as_matrix()[:, 2]
    np.testing.assert_allclose(z, [0, -np.sin(tenth), np.cos(tenth)], atol=1e-15)


@pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])
def test_oxyz_of_the_shipped_rigs(name):
    rig = load_rig(name)
    T = T_world_oxyz(rig)
    there = T.inv().apply(rig.cameras[1].centre)
    np.testing.assert_allclose(there, [99.19, 0, 0], atol=0.005)
    assert T.rotation.as_matrix()[1, 1] > 0.99  # y still points down
    assert np.linalg.det(T.rotation.as_matrix()) == pytest.approx(1.0)


# --- what is refused


def make(**changes):
    fields = {
        "name": "a",
        "size": (640, 480),
        "matrix": MATRIX,
        "distortions": np.zeros(5),
        "T_cam_world": RigidTransform.identity(),
    }
    return Camera(**{**fields, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": ""}, "name"),
        ({"name": 3}, "name"),
        ({"size": (640.5, 480)}, "size"),
        ({"size": (0, 480)}, "size"),
        ({"size": (640,)}, "size"),
        ({"matrix": np.eye(4)}, "matrix"),
        ({"matrix": MATRIX * [[-1], [1], [1]]}, "matrix: fx"),
        ({"matrix": MATRIX.T}, "matrix"),
        ({"matrix": MATRIX * np.nan}, "matrix"),
        ({"distortions": np.zeros(6)}, "distortions: expected 4, 5 or 8, got 6"),
        ({"distortions": np.full(5, np.nan)}, "distortions"),
        ({"T_cam_world": np.eye(4)}, "T_cam_world"),
        ({"T_cam_world": RigidTransform.identity(2)}, "T_cam_world"),
    ],
)
def test_refuses(changes, message):
    with pytest.raises(ValueError, match=message):
        make(**changes)


def test_refuses_shapes_and_rigs():
    for call in (plain().project, plain().sees):
        with pytest.raises(ValueError, match="points"):
            call([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="uv"):
        plain().rays([[1.0, 2.0, 3.0]])
    with pytest.raises(ValueError, match="two or more"):
        Rig((plain(),))
    with pytest.raises(ValueError, match="different names"):
        Rig((plain(), camera()))
    with pytest.raises(ValueError, match="no baseline"):
        fundamental_matrix(plain(), plain(name="b"))
    with pytest.raises(ValueError, match="baseline of a and b"):
        T_world_oxyz(Rig((plain(), plain(name="b"))))


def test_cameras_cannot_be_changed():
    a, given = camera(), MATRIX.copy()
    b = make(matrix=given)
    given[0, 0] = 1.0
    assert b.matrix[0, 0] == 800.0
    for array in (a.matrix, a.distortions, a.centre, a.axis):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0


def test_pairs_are_in_order():
    assert load_rig("paper_trinocular").pairs == ((0, 1), (0, 2), (1, 2))
    assert load_rig("paper_pair").pairs == ((0, 1),)


def test_a_displaced_camera_by_hand():
    """Each number of the vector alone, seen in the pixel of a point."""
    a = plain()
    rig = Rig((a, plain(RigidTransform.from_translation([0.0, 0.0, 100.0]), "b")))
    point = np.array([[10.0, 20.0, 400.0]])  # of the world: 500 mm in front of camera b
    before = rig.cameras[1].project(point)[0]

    def moved(k, by):
        delta = np.zeros(30)
        delta[15 + k] = by
        other = displaced(rig, delta)
        np.testing.assert_array_equal(other.cameras[0].project(point), a.project(point))
        return other.cameras[1].project(point)[0] - before

    x, y, z = 10.0, 20.0, 500.0
    f = a.focal
    np.testing.assert_allclose(moved(0, 2.0), [2.0 * x / z, 0.0], atol=1e-12)
    np.testing.assert_allclose(moved(1, 2.0), [0.0, 2.0 * y / z], atol=1e-12)
    np.testing.assert_allclose(moved(2, 0.3), [0.3, 0.0], atol=1e-12)
    np.testing.assert_allclose(moved(3, 0.3), [0.0, 0.3], atol=1e-12)
    r2 = (x * x + y * y) / z**2
    np.testing.assert_allclose(moved(4, 0.1), f * [x / z, y / z] * 0.1 * r2, atol=1e-9)
    # the turn is of what the camera has turned already, not of the shift: z is 400 for it
    np.testing.assert_allclose(
        moved(11, 1e-6), f * [-y / z * 1e-6, x / z * 1e-6], rtol=1e-5, atol=1e-12
    )
    turned = f * np.array([400.0 / z + x / z * x / z, x * y / z**2]) * 1e-6
    np.testing.assert_allclose(moved(10, 1e-6), turned, rtol=1e-4)
    np.testing.assert_allclose(moved(12, 0.5), [f[0] * 0.5 / z, 0.0], atol=1e-9)
    np.testing.assert_allclose(moved(14, -100.0), f * [x / 400 - x / z, y / 400 - y / z], atol=1e-9)


def test_a_displaced_rig_keeps_what_is_known_of_it():
    covariance = RigCovariance(("a", "b"), np.eye(30))
    rig = Rig((plain(), plain(name="b")), covariance)
    assert displaced(rig, np.zeros(30)).covariance is covariance
    with pytest.raises(ValueError, match=r"delta: expected shape \(30,\), got \(15,\)"):
        displaced(rig, np.zeros(15))
    with pytest.raises(ValueError, match="covariance: expected one of the cameras a, c, got a, b"):
        Rig((plain(), plain(name="c")), covariance)


def test_the_difference_of_two_rigs_leads_from_one_to_the_other():
    rig = load_rig("raised_40deg")
    delta = 0.01 * np.random.default_rng(0).standard_normal(45)
    moved = displaced(rig, delta)
    # rotation vectors there and back
    np.testing.assert_allclose(difference(moved, rig).ravel(), delta, atol=1e-12)
    assert not difference(rig, rig).any()


# --- a camera by where it looks, and from what OpenCV gives


def test_a_camera_that_looks_at_a_point_has_it_in_its_middle_and_up_is_up():
    camera = Camera.look_at("c", (640, 480), 700.0, [300, -200, 100], [10, 20, 600])
    assert camera.project([[10, 20, 600]]) == pytest.approx(np.array([[319.5, 239.5]]), abs=1e-9)
    assert camera.centre == pytest.approx(np.array([300, -200, 100]), abs=1e-9)
    # y of this world points down: what lies higher has a smaller v, and the horizon is level
    (above,) = camera.project([[10, -30, 600]])
    assert above[1] < 239.5
    assert above[0] == pytest.approx(319.5, abs=1e-9)


def test_a_world_whose_z_points_upwards():
    """By hand: from (0, -1000, 0) along +y with z up, x of the image is x of the world."""
    camera = Camera.look_at("c", (641, 481), 500.0, [0, -1000, 0], [0, 0, 0], up=(0, 0, 1))
    uv = camera.project([[100, 0, 0], [0, 0, 100]])
    assert uv == pytest.approx(np.array([[370, 240], [320, 190]]), abs=1e-9)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"target": [0, 0, 0]}, "target - centre: expected a direction, got the zero vector"),
        ({"target": [0, 500, 0]}, "up: expected a direction across that from centre to target"),
        ({"centre": [0, 0, np.nan]}, "centre: expected finite numbers"),
        ({"focal_px": 0.0}, "focal_px"),
        ({"size": (640, 0)}, "size"),
    ],
)
def test_a_camera_that_looks_nowhere_is_refused(changed, said):
    given = {"size": (640, 480), "focal_px": 500.0, "centre": [0, 0, 0], "target": [0, 0, 500]}
    with pytest.raises(ValueError, match=said):
        Camera.look_at("c", **{**given, **changed})


K = np.array([[810.0, 0, 333], [0, 805, 251], [0, 0, 1]])
RODRIGUES, SHIFT = np.array([[0.2], [-0.4], [0.1]]), np.array([[30.0], [-12], [500]])


@pytest.mark.parametrize("as_matrix", [False, True])
@pytest.mark.parametrize(
    "lens",
    [
        None,
        [[-0.2, 0.05, 1e-3, -2e-3]],
        [-0.2, 0.05, 1e-3, -2e-3, 0.01],
        [0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022],
        [0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022, 0, 0, 0, 0],
    ],
)
def test_opencv_s_numbers_give_opencv_s_pixels(as_matrix, lens):
    points = np.random.default_rng(0).uniform(-80, 80, (20, 3))
    R = cv2.Rodrigues(RODRIGUES)[0] if as_matrix else RODRIGUES
    camera = Camera.from_opencv("c", (640, 480), K, R, SHIFT, lens)
    theirs, _ = cv2.projectPoints(
        points, RODRIGUES, SHIFT, K, np.zeros(5) if lens is None else np.ravel(lens)
    )
    assert np.abs(camera.project(points) - theirs.reshape(-1, 2)).max() < 1e-9  # px


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"R": 2 * np.eye(3)}, r"R: expected a rotation matrix .* R R\^T is off by 3 "),
        ({"R": np.diag([1.0, 1, -1])}, "whose determinant is -1"),
        ({"R": np.eye(4)}, r"R: expected shape \(3, 3\), got \(4, 4\)"),
        ({"t": [1, 2]}, "t: expected shape"),
        ({"t": [1, 2, np.nan]}, "t: expected finite numbers"),
        ({"distortions": [0.1, 0, 0]}, "distortions: expected 0, 4, 5, 8, 12 or 14, got 3"),
        ({"distortions": [*[0] * 8, 0.1, 0, 0, 0]}, "distortions: expected k1, .*, k6, got others"),
        ({"K": np.eye(2)}, "matrix"),
    ],
)
def test_what_opencv_does_not_give_is_refused(changed, said):
    given = {"K": K, "R": RODRIGUES, "t": SHIFT}
    with pytest.raises(ValueError, match=said):
        Camera.from_opencv("c", (640, 480), **{**given, **changed})


def test_a_lens_of_eight_numbers_whose_last_are_zero_is_one_of_five():
    lens = [-0.2, 0.05, 1e-3, -2e-3, 0.01, 0, 0, 0]
    camera = Camera.from_opencv("c", (640, 480), K, RODRIGUES, SHIFT, lens)
    assert camera.distortions.tolist() == lens[:5]


def test_a_rig_has_one_model_of_lenses():
    first, second = camera(distortions=LENS[:4]), camera("b", RATIONAL, 1)
    rig = Rig((first, second), RigCovariance.exact("ab"))
    assert first.distortions.tolist() == [*LENS[:4], 0]
    assert rig.cameras[0].distortions.tolist() == [*LENS[:4], 0, 0, 0, 0]
    np.testing.assert_array_equal(rig.cameras[0].project(cloud()), first.project(cloud()))
    assert rig.covariance.is_exact
    assert [name for name, _ in rig.parameters][7:12] == ["p2", "k3", "k4", "k5", "k6"]
    delta = np.linspace(-1e-4, 1e-4, 36)
    np.testing.assert_allclose(difference(displaced(rig, delta), rig).ravel(), delta, atol=1e-12)
    with pytest.raises(ValueError, match="expected one of 18 parameters per camera, got 15"):
        Rig((first, second), RigCovariance(("a", "b"), np.eye(30)))
