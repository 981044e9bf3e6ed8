"""Any input at all: a ValueError or a result that keeps its promises; warnings are errors here too.

Numbers include NaN, infinities, those beyond `checks.LARGEST`, and the smallest there are; arrays
have any shape. The examples are the same in every run.
"""

from dataclasses import replace

import hypothesis
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import kalman, matching, pose, triangulation
from trinolab.camera import Camera, Rig, T_between, epipolar_lines, fundamental_matrix
from trinolab.checks import LARGEST
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle, slants


def given(*strategies):
    """Run a test on 80 examples, the same in every run."""
    run = settings(
        max_examples=80, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
    )
    return lambda test: run(hypothesis.given(*strategies)(test))


EXTREMES = [0.0, -0.0, 5e-324, 1e-310, 1e-160, LARGEST, -LARGEST, float("nan")]
bounded = st.floats(-1e3, 1e3) | st.sampled_from(EXTREMES) | st.floats(-LARGEST, LARGEST)
numbers = bounded | st.sampled_from([1e37, 1e308, float("inf"), -float("inf")])
junk = st.sampled_from(
    [None, "text", {}, object(), True, [[1, 2], [3]], [[None, 1.0]], np.array(["a"]), [], 1.5]
)
any_array = arrays(float, st.lists(st.integers(0, 4), max_size=3).map(tuple), elements=numbers)
anything = any_array | junk | numbers


def rows(k, most=4, elements=bounded):
    return arrays(float, st.tuples(st.integers(0, most), st.just(k)), elements=elements)


def either(strategy):
    """What has the right shape, or anything."""
    return strategy | anything


LENS = [-0.25, 0.08, 0.003, -0.002, -0.01]
RIG = load_rig("paper_trinocular")
PAIR = load_rig("paper_pair")
HANDLE = load_handle("paper")
AHEAD = RigidTransform.from_components([5.0, -3.0, 560.0], Rotation.from_rotvec([0.3, -0.2, 0.5]))

tame = st.floats(-1.0, 1.0)
motions = arrays(float, 6, elements=tame).map(
    lambda v: RigidTransform.from_components(500 * v[:3], Rotation.from_rotvec(3 * v[3:]))
)
lenses = st.sampled_from([[0.0] * 5, LENS, [0.2, 0.05, 0, 0, 0], [-0.4, 0, 0, 0, 0]])
cameras = st.builds(
    lambda f, c, k, T: Camera(
        "c", (1280, 1024), [[f, 0, 600 + 50 * c], [0, 1.1 * f, 500], [0, 0, 1]], k, T
    ),
    st.floats(200.0, 4000.0),
    tame,
    lenses,
    motions,
)
shipped = st.sampled_from(
    [*RIG.cameras, load_rig("raised_40deg").cameras[2], replace(PAIR.cameras[1], distortions=LENS)]
)


def in_front(camera, spread=0.3):
    """Points before a camera, not too far aside: a strategy, shape (n, 3), world frame."""

    def placed(v):
        return camera.T_world_cam.apply(
            np.column_stack([spread * v[:, :2], np.ones(len(v))]) * (600 + 400 * v[:, 2:])
        )

    return rows(3, 6, tame).map(placed)


def points_or_missing(array, k):
    """Assert shape (n, k), no infinity, and rows that are there or missing as a whole."""
    assert array.ndim == 2
    assert array.shape[1] == k
    there = np.isfinite(array)
    np.testing.assert_array_equal(there.all(axis=1), there.any(axis=1))
    assert np.isnan(array[~there]).all()
    return there.all(axis=1)


def refused(function, *args):
    """Whether a call is refused with a ValueError. Any other exception, derived or a warning, is
    raised.
    """
    try:
        function(*args)
    except ValueError as error:
        if type(error) is not ValueError:  # LinAlgError, for one: it names no argument
            raise
        return True
    return False


@pytest.mark.parametrize(
    "call",
    [
        lambda x: RIG.cameras[0].project([[0, 0, x]]),
        lambda x: RIG.cameras[0].rays([[x, 0]]),
        lambda x: epipolar_lines(*PAIR.cameras, [[0, x]]),
        lambda x: slants(HANDLE, AHEAD, [0, 0, x]),
        lambda x: triangulation.triangulate(PAIR, np.full((2, 1, 2), x)),
        lambda x: triangulation.mean_point(np.full((2, 1, 3), x)),
        lambda x: pose.rigid_fit(x * np.eye(3), np.eye(3)),
        lambda x: matching.ncc(np.full((3, 3), x), np.eye(3)),
        lambda x: kalman.predict(kalman.State(np.zeros(6), np.eye(6)), F, x * np.eye(6)),
        lambda x: kalman.update(kalman.initial_state([0, 0]), [x, 0], H, R),
        lambda x: replace(RIG.cameras[0], T_cam_world=RigidTransform.from_translation([x, 0, 0])),
        lambda x: Handle("h", x, 200.0, 100.0, 2.0, [0.0], [[0.0]]),
    ],
)
@pytest.mark.parametrize("beyond", [1e37, -1e37, 1e160, 1e308, -1e308])
def test_numbers_beyond_any_bench_are_refused_in_one_line(call, beyond):
    with pytest.raises(ValueError, match=r"^[\w ]+: expected [^\n]+$"):
        call(beyond)


# --- camera


@given(
    junk | st.text(max_size=3),
    either(st.tuples(st.integers(-2, 2000), st.integers(1, 2000))),
    either(
        st.tuples(numbers, numbers, numbers).map(
            lambda v: [[v[0], 0, v[1]], [0, v[2], 5.0], [0, 0, 1]]
        )
    ),
    either(arrays(float, st.sampled_from([4, 5, 8]), elements=bounded)),
    st.just(AHEAD) | junk,
)
def test_a_camera_is_refused_or_usable(name, size, matrix, distortions, T):
    try:
        camera = Camera(name, size, matrix, distortions, T)
    except ValueError:
        return
    points_or_missing(camera.project(np.eye(3) * 1e3), 2)
    points_or_missing(camera.rays(np.eye(2) * 1e3), 3)


@given(
    st.floats(1e-6, 1e9),
    st.floats(-1e9, 1e9),
    arrays(float, st.sampled_from([5, 8]), elements=st.floats(-1e6, 1e6)),
    arrays(float, 3, elements=st.floats(-LARGEST, LARGEST)),
    rows(3),
    rows(2),
)
def test_a_camera_with_numbers_at_its_limits_gives_points_or_nan(f, c, lens, t, points, uv):
    T = RigidTransform.from_translation(t)
    camera = Camera("c", (1280, 1024), [[f, 0, c], [0, f, c], [0, 0, 1]], lens, T)
    points_or_missing(camera.project(points), 2)
    points_or_missing(camera.normalise(uv), 2)
    points_or_missing(camera.rays(uv), 3)


@given(shipped, either(rows(3)), either(rows(2)), numbers | junk)
def test_projection_and_rays_of_anything(camera, points, uv, margin):
    for function, value, k in (
        (camera.project, points, 2),
        (camera.to_pixels, uv, 2),
        (camera.normalise, uv, 2),
        (camera.ideal_pixels, uv, 2),
        (camera.rays, uv, 3),
    ):
        if not refused(function, value):
            found = points_or_missing(function(value), k)
            assert not found[~np.isfinite(np.asarray(value, dtype=float)).all(axis=1)].any()
    if not refused(camera.sees, points, margin):
        assert camera.sees(points, margin).dtype == bool


@given(lenses, rows(2, 6, tame))
def test_distortion_is_undone_within_the_fold(distortions, xy):
    matrix = [[800, 0, 300], [0, 700, 250], [0, 0, 1]]
    camera = Camera("c", (640, 480), matrix, distortions, RigidTransform.identity())
    radius2 = (xy**2).sum(axis=1)
    k1, k2, _, _, k3 = distortions
    # The slope of the radius on the way out: where it nears zero the inverse is as badly
    # determined.
    way = radius2[:, None] * np.linspace(0, 1, 20)
    steep = (1 + 3 * k1 * way + 5 * k2 * way**2 + 7 * k3 * way**3 > 0.2).all(axis=1)
    uv = camera.to_pixels(xy)
    assert np.isfinite(uv[steep]).all()
    np.testing.assert_allclose(camera.normalise(uv)[steep], xy[steep], atol=1e-10)


@given(st.data(), cameras, motions)
def test_a_camera_that_moves_with_the_world_sees_the_same(data, camera, T):
    points = data.draw(in_front(camera))
    moved = replace(camera, T_cam_world=camera.T_cam_world * T.inv())
    # px of some thousand
    np.testing.assert_allclose(moved.project(T.apply(points)), camera.project(points), atol=1e-7)


# --- two cameras


@given(shipped, shipped, either(rows(2)), either(rows(2)))
def test_epipolar_lines_of_anything(left, right, uv_left, uv_right):
    if left.centre.tolist() == right.centre.tolist():
        one = [[600.0, 500.0]]
        assert refused(fundamental_matrix, left, right)
        assert refused(epipolar_lines, left, right, one)
        assert refused(matching.epipolar_distances, left, right, one, one)
        assert refused(triangulation.triangulate_pair, left, right, one, one)
        assert refused(Rig, (left, left))
        return
    if not refused(epipolar_lines, left, right, uv_left):
        lines = epipolar_lines(left, right, uv_left)
        there = points_or_missing(lines, 3)
        np.testing.assert_allclose(np.linalg.norm(lines[there, :2], axis=1), 1, atol=1e-12)
    if not refused(matching.epipolar_distances, left, right, uv_left, uv_right):
        D = matching.epipolar_distances(left, right, uv_left, uv_right)
        assert D.shape == (len(uv_left), len(uv_right))
        assert (D[np.isfinite(D)] >= 0).all()


@given(st.data(), cameras, motions)
def test_true_pairs_lie_on_their_lines_wherever_the_cameras_stand(data, left, T):
    right = replace(left, name="r", T_cam_world=T * left.T_cam_world)
    assume(np.linalg.norm(T_between(right, left).translation) > 1.0)
    points = data.draw(in_front(left))
    uv_left, uv_right = left.project(points), right.project(points)
    seen = np.isfinite(right.normalise(uv_right)).all(axis=1)
    D = matching.epipolar_distances(left, right, uv_left, uv_right)[seen][:, seen]
    # px; 1e-10 in the direction of a ray, times a lever of up to a million pixels for points far
    # aside
    own = np.nan_to_num(np.diag(D))  # a point in the image of the other camera's centre has no line
    assert (own < 1e-4 + 1e-9 * np.abs(uv_right[seen]).max(axis=1, initial=0.0)).all()


# --- handle


row = either(st.lists(numbers, max_size=2))
marks = st.sampled_from(["bright", "dark", "grey", None])


markers = st.tuples(row, either(st.lists(row, max_size=3)), marks)


@given(st.tuples(st.just("h") | junk, *[anything] * 4), markers)
def test_a_handle_of_anything_is_refused_or_usable(body, markers):
    try:
        handle = Handle(*body, *markers)
    except ValueError:
        return
    assert np.isfinite(handle.marker_centres).all()
    assert len(handle.symmetries) >= 1


axial = st.sampled_from([-15.0, -5.0, 5.0, 15.5])
columns_of_markers = st.lists(axial, min_size=1, max_size=3, unique=True)
layouts = st.lists(columns_of_markers, min_size=1, max_size=4)


@given(layouts, st.floats(3.0, 50.0), st.floats(0.0, 360.0))
def test_any_layout_keeps_its_geometry(layout, radius, phase):
    columns = [phase + 90.0 * k for k in range(len(layout))]
    handle = Handle("h", radius, 200.0, 100.0, 2.0, columns, layout)
    centres, normals = handle.marker_centres, handle.marker_normals
    # mm; on the cylinder
    np.testing.assert_allclose(centres - radius * normals, centres * [0, 1, 0], atol=1e-12)
    # seen through the body, from the middle
    from_the_axis = np.pi - np.arctan2(np.abs(centres[:, 1]), radius)
    slant = slants(handle, RigidTransform.identity(), [0, 0, 0])
    np.testing.assert_allclose(slant, from_the_axis, atol=1e-7)
    for S in handle.symmetries:  # each carries the set of markers onto itself
        gaps = np.linalg.norm(S.apply(centres)[:, None] - centres, axis=2)
        assert gaps.min(axis=1).max() < 1e-6
        assert sorted(gaps.argmin(axis=1)) == list(range(len(centres)))


@given(motions, arrays(float, 3, elements=tame))
def test_slants_do_not_mind_where_the_world_is(T, viewpoint):
    seen = slants(HANDLE, AHEAD, 300 * viewpoint)
    there = slants(HANDLE, T * AHEAD, T.apply(300 * viewpoint))
    np.testing.assert_allclose(there, seen, atol=1e-7)  # rad; arccos near 1 halves the digits


# --- matching

small = st.tuples(st.integers(1, 30), st.integers(1, 30))
images = arrays(float, small, elements=numbers, fill=st.just(3.0)) | arrays(np.uint8, small)
TEXTURE = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)


@given(either(images), either(images))
def test_correlation_of_anything(template, window):
    if not refused(matching.ncc, template, window):
        assert abs(matching.ncc(template, window)) <= 1 + 1e-12
        own = matching.ncc(template, template)
        assert own == 0 or own == pytest.approx(1, abs=1e-12)


@given(
    either(images), either(images), either(rows(2)), either(rows(2)), st.integers(-3, 31) | anything
)
def test_correlation_matrix_of_anything(left, right, uv_left, uv_right, window_px):
    if not refused(matching.ncc_matrix, left, right, uv_left, uv_right, window_px):
        S = matching.ncc_matrix(left, right, uv_left, uv_right, window_px)
        assert S.shape == (len(uv_left), len(uv_right))
        assert (np.abs(S) <= 1 + 1e-9).all()
        assert (S[~np.isfinite(np.asarray(uv_left, dtype=float)).all(axis=1)] == 0).all()


@given(shipped, shipped, st.just(TEXTURE) | either(images), rows(2), rows(2) | anything)
def test_matches_of_anything_join_each_point_once(left, right, image, uv_left, uv_right):
    if refused(matching.match, left, right, image, image, uv_left, uv_right):
        return
    found = matching.match(left, right, image, image, uv_left, uv_right)
    for column in found.index.T:
        assert len(set(column)) == len(column)
    assert (found.distance_px < matching.MatchParameters().epipolar_gate_px).all()
    assert (found.ncc > matching.MatchParameters().ncc_threshold).all()


# --- triangulation


pixels = st.floats(0, 1300) | bounded


@given(shipped, shipped, rows(4, 8, pixels) | rows(4, 8, st.floats(0, 1300)), junk | st.none())
def test_points_from_any_pixels_are_before_both_cameras(left, right, uv, other):
    uv_left, uv_right = uv[:, :2], uv[:, 2:] if other is None else other
    if refused(triangulation.triangulate_pair, left, right, uv_left, uv_right):
        return
    points = triangulation.triangulate_pair(left, right, uv_left, uv_right)
    there = points_or_missing(points, 3)
    given_ = np.isfinite(np.column_stack([uv_left, uv_right]).astype(float)).all(axis=1)
    assert not there[~given_].any()
    # beyond, rounding may move a point behind a camera
    size = np.abs(points[there]).max(axis=1)
    near = size < 1e9
    # the way to the world's frame and back rounds, too
    rounding = 1e-14 * np.maximum(size, 1e3)
    for camera in (left, right):
        depth = camera.T_cam_world.apply(points[there])[:, 2]
        assert (depth > -rounding)[near].all()


@given(
    either(arrays(float, st.tuples(st.just(3), st.integers(0, 4), st.just(2)), elements=bounded)),
    numbers | junk,
    numbers | junk | st.floats(1e-6, 1.0),
)
def test_points_and_covariances_of_any_pixels(uv, sigma_px, step_px):
    if refused(triangulation.triangulate, RIG, uv):
        assert refused(triangulation.triangulation_covariance, RIG, uv, 0.1)
        return
    there = points_or_missing(triangulation.triangulate(RIG, uv), 3)
    if not refused(triangulation.triangulation_covariance, RIG, uv, sigma_px, step_px):
        C = triangulation.triangulation_covariance(RIG, uv, sigma_px, step_px)
        assert np.isnan(C[~there]).all()
        good = np.isfinite(C).all(axis=(1, 2))
        np.testing.assert_array_equal(C[good], C[good].transpose(0, 2, 1))
        values = np.linalg.eigvalsh(C[good])
        assert (values[:, 0] >= -1e-9 * np.abs(values).max(axis=1, initial=0.0)).all()


@given(st.data(), motions)
def test_points_come_back_and_move_along_with_the_world(data, T):
    points = data.draw(in_front(PAIR.cameras[0], 0.15))
    rig = Rig(tuple(replace(camera, distortions=LENS) for camera in RIG.cameras))
    moved = Rig(
        tuple(replace(camera, T_cam_world=camera.T_cam_world * T.inv()) for camera in rig.cameras)
    )
    uv = np.stack([camera.project(points) for camera in rig.cameras])
    found = triangulation.triangulate(rig, uv)
    # Two views side by side, 99 mm apart, lose a factor of up to a hundred; undistortion ends at
    # 1e-12 of 1 m.
    np.testing.assert_allclose(found, points, atol=1e-6)  # mm
    np.testing.assert_allclose(triangulation.triangulate(moved, uv), T.apply(found), atol=1e-6)


# --- pose


@given(either(rows(3, 6)), either(rows(3, 6)))
def test_a_fit_of_anything_is_a_rigid_motion_or_none(source, target):
    if refused(pose.rigid_fit, source, target):
        return
    T = pose.rigid_fit(source, target)
    if T is not None:
        assert np.isfinite(T.translation).all()
        R = T.rotation.as_matrix()
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) > 0


@given(arrays(float, (5, 3), elements=tame), motions, st.floats(-5, 35).map(lambda x: 10.0**x))
def test_a_fit_finds_the_motion_at_any_scale(points, T, scale):
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assume(spread[1] > 1e-2)
    rotation, shift = T.rotation, T.translation / 500
    target = scale * (rotation.apply(points) + shift)
    found = pose.rigid_fit(
        np.vstack([scale * points, np.zeros(3)]), np.vstack([target, [0, np.nan, 0]])
    )
    np.testing.assert_allclose(found.rotation.as_matrix(), rotation.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(found.translation / scale, shift, atol=1e-10)


# --- Kalman filter (tests/trinolab/test_kalman.py has more)

F, H, R = kalman.constant_acceleration(1 / 30), kalman.observation_matrix(), 4.0 * np.eye(2)
Q = kalman.white_jerk(1 / 30, 1e6)

wild_vectors, wild_matrices, wild_pairs = (
    either(arrays(float, shape, elements=bounded)) for shape in (6, (6, 6), 2)
)


@given(wild_vectors, wild_matrices, wild_matrices, wild_pairs, st.booleans())
def test_a_filter_of_anything_gives_a_state_or_refuses(mean, covariance, Phi, z, tamed):
    if tamed and isinstance(covariance, np.ndarray) and covariance.ndim == 2:
        covariance = np.diag(np.abs(np.diag(covariance)))
    state = kalman.State(mean, covariance)
    for step in (
        lambda: kalman.predict(state, Phi, Q),
        lambda: kalman.predict(state, F, covariance),
        lambda: kalman.update(state, z, H, R),
        lambda: kalman.update(kalman.State(mean, np.eye(6)), z, H, R),
        lambda: kalman.initial_state(z),
    ):
        if not refused(step):
            after = step()
            assert np.isfinite(after.mean).all()
            assert np.linalg.eigvalsh(after.covariance)[0] >= -1e-9 * np.abs(after.covariance).max()


@given(
    arrays(float, 6, elements=tame),
    arrays(float, 2, elements=tame),
    arrays(float, 2, elements=tame),
)
def test_a_filter_does_not_mind_where_the_image_begins(mean, z, shift):
    state = kalman.initial_state(500 * mean[:2])
    move = np.append(200 * shift, np.zeros(4))
    starts = (
        (state, 500 * z),
        (kalman.State(state.mean + move, state.covariance), 500 * z + move[:2]),
    )
    here, moved = (
        kalman.update(kalman.predict(start, F, Q), observed, H, R) for start, observed in starts
    )
    np.testing.assert_allclose(moved.mean, here.mean + move, atol=1e-8)
    np.testing.assert_allclose(moved.covariance, here.covariance, rtol=1e-12)


# --- what is no covariance and no noise

SQUARE = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 2]])
NONE = [
    -np.eye(2),
    [[1, 2], [2, 1]],
    [[1, 0.5], [0, 1]],
    np.full((2, 2), np.nan),
    1e200 * np.eye(2),
]
HERE = np.stack([camera.project([[0.0, 0.0, 560.0]]) for camera in PAIR.cameras])


@pytest.mark.parametrize("wrong", NONE)
def test_what_is_no_covariance_is_refused(wrong):
    state, good = kalman.initial_state([1.0, 2.0]), np.tile(np.eye(3), (4, 1, 1))
    pose.rigid_fit_covariance(SQUARE, AHEAD, good)
    good[2, :2, :2] = wrong
    for name, call in (
        ("R", lambda: kalman.update(state, [0, 0], H, wrong)),
        ("R", lambda: kalman.innovation(state, [0, 0], H, wrong)),
        ("Q", lambda: kalman.predict(state, F, np.kron(np.eye(3), wrong))),
        ("covariances", lambda: pose.rigid_fit_covariance(SQUARE, AHEAD, good)),
    ):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            call()


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("sigma_px", [0.0, -1.0, np.nan, 1e200]),
        ("step_px", [0.0, 1e-9, 10.0, np.nan]),
    ],
)
def test_a_covariance_refuses_noise_and_steps_that_are_none(name, wrong):
    for value in wrong:
        with pytest.raises(ValueError, match=f"{name}: expected"):
            triangulation.triangulation_covariance(PAIR, HERE, **{"sigma_px": 0.1, name: value})
