"""The numbers of the exam's solutions, computed again with the package."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import background, kalman, markers, matching, metrics, pose, triangulation
from trinolab.background import BackgroundParameters
from trinolab.camera import Camera
from trinolab.slave import bilateral, mapping, wall
from trinolab.workspace.cones import Cone, inside
from trinolab.workspace.intersection import intersect
from workbench.course import exam

SEEDS = [0, 1, 2, 3, 4]


@pytest.fixture(params=SEEDS)
def version(request):
    """The numbers of a version, its results, and the texts of its solutions by problem."""
    drawn = exam.draw(request.param)
    text = exam.exam(request.param, solutions=True)
    found = re.findall(r"^`{4}\{dropdown\} Solution to (\d+)[^\n]*\n(.*?)^`{4}$", text, re.M | re.S)
    return SimpleNamespace(**drawn, **exam.answers(drawn), text=text, solutions=dict(found))


def test_points_are_those_of_the_table(version):
    table = dict(re.findall(r"^\| (\d+) \| .* \| (\d+) \|$", version.text, re.M))
    heads = dict(re.findall(r"^## (\d+) .*\((\d+) points\)$", version.text, re.M))
    assert heads.items() <= table.items()
    assert set(heads) == set(version.solutions)
    assert sum(map(int, heads.values())) == 90
    for problem in re.split(r"^## ", version.text, flags=re.M)[1:]:
        number = problem.partition(" ")[0]
        parts = re.findall(r"\((\d+)\)$", problem.partition("````")[0], re.M)
        assert not parts or sum(map(int, parts)) == int(heads[number]), problem[:30]


def test_versions_differ_in_each_problem_and_a_student_gets_no_solution():
    a, b = (re.split(r"^## ", exam.exam(seed, solutions=False), flags=re.M)[1:] for seed in (0, 1))
    assert len(a) == len(b) == 11
    assert all(one != other for one, other in zip(a, b, strict=True))
    assert "Solution" not in "".join(a + b)


def camera_at(x_mm, name, f):
    K = [[f, 0, 640], [0, f, 512], [0, 0, 1]]
    T_cam_world = RigidTransform.from_translation([-x_mm, 0, 0])
    return Camera(name, (1280, 1024), K, np.zeros(5), T_cam_world)


def test_two_cameras(version):
    left = camera_at(0, "left", version.f)
    right = camera_at(version.baseline, "right", version.f)
    point = np.array([[version.x, version.y, version.z]], float)
    uv = [one.project(point) for one in (left, right)]
    assert_allclose(uv[0], [[version.u_left, version.v]])
    assert_allclose(uv[1], [[version.u_right, version.v]])
    off = triangulation.triangulate_pair(left, right, uv[0], uv[1] + [0.01, 0])
    assert_allclose(100 * (off[0, 2] - version.z), version.depth_a_pixel, rtol=0.01)
    moved = left.project(point + [version.across_a_pixel, 0, 0])
    assert_allclose(moved - uv[0], [[1, 0]], atol=1e-9)


def test_cones(version):
    half_angle = np.radians(version.half_angle)
    towards = Cone([0, 0, 0], [0, 0, 1], half_angle)
    assert inside([towards], [version.point, [0, 0, -200]]).tolist() == [True, False]
    both = intersect([towards, Cone([0, 0, version.apart], [0, 0, -1], half_angle)])
    assert_allclose(version.litres, both.volume / 1e6, rtol=1e-3)
    assert version.bound <= version.point[2]


def frames_until_gone(version, new, alpha):
    """How long the package's Eq. 6, as printed, takes a new grey for moving."""
    as_printed = BackgroundParameters(alpha, float(version.threshold), 0.0, 0, alpha, False)
    known, frame = np.full((8, 8), float(version.bench)), np.full((8, 8), new, np.uint8)
    count = 0
    # the frame that makes the difference small enough is followed by one that is quiet
    while background.step(known, frame, as_printed)[1].mask.any():
        known, _ = background.step(known, frame, as_printed)
        count += 1
    return count


def test_alpha(version):
    lit = int(1.5 * version.bench)
    assert frames_until_gone(version, version.rod, version.alpha) == version.rod_frames
    assert frames_until_gone(version, lit, version.alpha) == version.lamp_frames
    assert frames_until_gone(version, version.rod, 0.5) == version.quick_frames
    noise = np.random.default_rng(0).normal(0, version.noise, (4000, 500))
    known = np.zeros(500)
    for frame in noise:
        known = background.renewed(known, frame, version.alpha)
    assert_allclose(known.std(), version.noise_left, rtol=0.1)


def test_filter(version):
    one, R, Q = [[1.0]], [[version.R]], [[version.Q]]
    guess = kalman.State([version.guess], [[version.variance]])
    first = kalman.update(guess, [version.first], one, R)
    second = kalman.update(kalman.predict(first, one, Q), [version.second], one, R)
    assert_allclose([first.mean[0], first.covariance[0, 0]], [version.mean_1, version.variance_1])
    assert_allclose([second.mean[0], second.covariance[0, 0]], [version.mean_2, version.variance_2])
    certain = kalman.update(kalman.State([version.guess], [[0.0]]), [version.first], one, R)
    assert certain.mean[0] == version.guess
    assert_allclose(kalman.nis(kalman.innovation(guess, [version.first], one, R)), version.nis)


def tried(row, wanted):
    # one row of pixels, with dark rows about it
    image = np.full((3, len(row)), min(row), np.uint8)
    image[1] = row
    return [tuple(step) for step in markers.iterative_threshold(image, wanted)]


def test_threshold_and_centroid(version):
    assert tried(version.row, 3) == [(version.tried[0], 2), (version.tried[1], 3)]
    assert tried([10, 200, 120, 200, 10], 2)[-1][1] == 1
    assert tried([10, 100, 60, 200, 10], 2)[-1][1] == 1
    assert tried([10, 100, 40, 200, 10], 2)[-1] == (57.5, 2)
    # the centroid by adding up the disc, without the closed form
    reach, radius = version.marker_mm, version.rod_mm
    s, h = np.meshgrid(np.linspace(-reach, reach, 801), np.linspace(-reach, reach, 801))
    slant = np.radians(version.slant)
    angle = slant + s[s**2 + h**2 <= reach**2] / radius
    seen = np.cos(angle)
    bias = radius * np.sin(slant) - (radius * np.sin(angle) * seen).sum() / seen.sum()
    assert_allclose(bias, version.bias_mm, rtol=0.02)


def test_line_and_likeness(version):
    first = np.reshape(version.window_1, (2, 2)).astype(float)
    second = np.reshape(version.window_2, (2, 2)).astype(float)
    assert_allclose(matching.ncc(first, second), version.ncc)
    assert_allclose(matching.ncc(first, 2 * second + 10), version.ncc)
    assert version.off_line > 2


def test_pose(version):
    T = pose.rigid_fit(np.array(version.handle, float), np.array(version.seen, float))
    assert_allclose(metrics.euler_deg(T), [version.turn, 0, 0], atol=1e-9)
    assert_allclose(T.translation, version.shift, atol=1e-9)
    off = [version.off_1, version.off_2]
    places, moved = (
        metrics.pose_from_euler_deg(np.array(mm, float), np.zeros((2, 3)))
        for mm in (np.zeros((2, 3)), off)
    )
    assert_allclose(metrics.position_error(moved, places), version.E_t)
    was_set, measured = (
        metrics.pose_from_euler_deg(np.zeros((1, 3)), [[0.0, 0, gamma]])
        for gamma in (version.gamma_set, version.gamma_seen)
    )
    error = metrics.angle_errors_deg(measured, was_set)[..., 2]
    assert_allclose(np.abs(error), version.gamma_error)


def test_tool_and_wall(version):
    # the camera's x, y, z in the base: right, down, away
    R = Rotation.from_matrix([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    T_cam_world = RigidTransform.from_rotation(R).inv()
    K = np.diag([500.0, 500, 1])
    surveillance = Camera("s", (640, 480), K, np.zeros(5), T_cam_world)
    left, down, nearer = version.hand
    moved = version.scale * mapping.alignment(surveillance).apply([-left, down, -nearer])
    assert_allclose(moved, version.moved, atol=1e-9)
    for rate, stiffness in ((30, version.stiffness), (300, version.quick_stiffness)):
        loop = wall.Loop(1.0, version.damping, 1 / rate, version.age_ms / 1000)
        assert_allclose(version.damping / loop.lag_s, stiffness)
        assert wall.nyquist_limit(loop).stiffness > stiffness
    # pressed against the wall slowly, a master without dampers feels two springs in a row
    pair = bilateral.Teleoperator(1e-6, 1e-6, 1e-6, float(version.spring), 0.0)
    omega = np.array([1e-3])
    hybrid = bilateral.hybrid_matrix(pair, omega)
    felt = bilateral.felt_impedance(hybrid, version.wall / (1j * omega))
    assert_allclose((felt * 1j * omega).real, version.felt, rtol=1e-6)


def test_calibration_and_design(version):
    camera = camera_at(0, "one", version.focal)
    edges = camera.project([[0.0, 0, version.distance], [version.square, 0, version.distance]])
    assert_allclose(np.diff(edges[:, 0]), version.square_px)
    left = camera_at(0, "left", version.design_f)
    right = camera_at(version.design_baseline, "right", version.design_f)
    point = np.array([[0.5 * version.design_baseline, 0, version.reach_mm]])
    rng = np.random.default_rng(0)
    uv = [one.project(np.repeat(point, 4000, axis=0)) for one in (left, right)]
    seen = [one + rng.normal(0, version.centroid_px, one.shape) for one in uv]
    depths = triangulation.triangulate_pair(left, right, *seen)[:, 2]
    assert_allclose(depths.std(), version.wish_mm, rtol=0.05)


def test_the_failure_names_one_camera(version):
    suspects = {1, 2, 3}
    for pair, before, after in version.distances:
        suspects &= set(pair) if after > 2 * before else suspects - set(pair)
    assert suspects == {version.moved_camera}


def test_the_command_prints_a_version(capsys, tmp_path):
    assert exam.main(["--seed", "2"]) == 0
    assert capsys.readouterr().out == exam.exam(2, solutions=False)
    assert exam.main(["--solutions", "--out", str(tmp_path / "a.md")]) == 0
    assert (tmp_path / "a.md").read_text(encoding="utf-8") == exam.exam(0, solutions=True)
