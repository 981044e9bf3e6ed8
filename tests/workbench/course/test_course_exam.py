"""The numbers of the exam's solutions, computed again with the package."""

import re
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import background, kalman, markers, matching, metrics, pose, triangulation
from trinolab.background import BackgroundParameters
from trinolab.camera import Camera
from trinolab.slave import bilateral, mapping, wall
from trinolab.workspace.cones import Cone, inside
from trinolab.workspace.intersection import intersect

TEXT = (Path(__file__).resolve().parents[3] / "book" / "teaching" / "exam.md").read_text()
TEXT = TEXT.replace(",\\ ", ", ")
SOLUTIONS = {
    int(number): text
    for number, text in re.findall(
        r"^`{4}\{dropdown\} Solution to (\d)\n(.*?)^`{4}$", TEXT, re.M | re.S
    )
}


def says(problem, *numbers):
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d|\.\d)", SOLUTIONS[problem]), number


def test_points_are_those_of_the_table():
    table = dict(re.findall(r"^\| (\d) \|.*\| (\d+) \|$", TEXT, re.M))
    heads = dict(re.findall(r"^## (\d) .*\((\d+) points\)$", TEXT, re.M))
    assert table == heads
    assert set(map(int, table)) == set(SOLUTIONS)
    assert sum(map(int, table.values())) == 90
    for problem in re.split(r"^## ", TEXT, flags=re.M)[1:]:
        asked = problem.partition("````")[0]
        parts = re.findall(r"\((\d+)\)$", asked, re.M)
        assert sum(map(int, parts)) == int(heads[problem[0]]), problem[:30]


def camera_at(x_mm, name):
    K = [[2000, 0, 640], [0, 2000, 512], [0, 0, 1]]
    T_cam_world = RigidTransform.from_translation([-x_mm, 0, 0])
    return Camera(name, (1280, 1024), K, np.zeros(5), T_cam_world)


def test_two_cameras():
    left, right = camera_at(0, "left"), camera_at(120, "right")
    point = np.array([[30.0, -20, 600]])
    uv = [one.project(point) for one in (left, right)]
    assert_allclose(uv, [[[740, 445.333]], [[340, 445.333]]], atol=1e-3)
    says(1, "740", "445.33", "340", "400", "600", "1.5", "0.3")
    off = triangulation.triangulate_pair(left, right, uv[0], uv[1] + [1, 0])
    assert_allclose(off[0, 2] - 600, 1.5, rtol=0.01)


def test_cones():
    towards = Cone([0, 0, 0], [0, 0, 1], np.radians(15))
    assert inside([towards], [[40, 30, 200], [0, 0, -200]]).tolist() == [True, False]
    both = intersect([towards, Cone([0, 0, 400], [0, 0, -1], np.radians(15))])
    assert f"{both.volume / 1e6:.3f}" == "1.203"
    says(2, "206.2", "199.1", "14.04", "1.203")


def frames_until_gone(new, alpha):
    """How long the package's Eq. 6, as printed, takes a new grey for moving."""
    as_printed = BackgroundParameters(alpha, 20.0, 0.0, 0, alpha, False)
    known, frame = np.full((8, 8), 50.0), np.full((8, 8), new, np.uint8)
    count = 0
    # the frame that makes the difference small enough is followed by one that is quiet
    while background.step(known, frame, as_printed)[1].mask.any():
        known, _ = background.step(known, frame, as_printed)
        count += 1
    return count


def test_alpha():
    assert [frames_until_gone(110, 0.05), frames_until_gone(75, 0.05)] == [22, 5]
    assert frames_until_gone(110, 0.5) == 2
    says(3, "22 frames", "0.73 s", "5 frames", "2 frames", "0.32")
    noise = np.random.default_rng(0).normal(0, 2, (4000, 500))
    known = np.zeros(500)
    for frame in noise:
        known = background.renewed(known, frame, 0.05)
    assert_allclose(known.std(), 0.32, rtol=0.1)


def test_filter():
    one = [[1.0]]
    first = kalman.update(kalman.State([10.0], [[9.0]]), [16.0], one, [[3.0]])
    second = kalman.update(kalman.predict(first, one, [[0.75]]), [13.0], one, [[3.0]])
    assert_allclose([first.mean[0], first.covariance[0, 0]], [14.5, 2.25])
    assert_allclose([second.mean[0], second.covariance[0, 0]], [13.75, 1.5])
    certain = kalman.update(kalman.State([10.0], [[0.0]]), [16.0], one, [[3.0]])
    assert certain.mean[0] == 10
    seen = kalman.innovation(kalman.State([10.0], [[9.0]]), [16.0], one, [[3.0]])
    assert_allclose(kalman.nis(seen), 3)
    says(4, "0.75", "14.5", "2.25", "0.5", "13.75", "1.5")


def tried(row, wanted):
    # one row of pixels, with dark rows about it
    image = np.full((3, len(row)), min(row), np.uint8)
    image[1] = row
    return [tuple(step) for step in markers.iterative_threshold(image, wanted)]


def test_threshold_and_centroid():
    assert tried([20, 220, 20, 140, 20, 100, 20], 3) == [(120, 2), (70, 3)]
    assert tried([10, 200, 120, 200, 10], 2)[-1][1] == 1
    assert tried([10, 100, 60, 200, 10], 2)[-1][1] == 1
    assert tried([10, 100, 40, 200, 10], 2)[-1] == (57.5, 2)
    # the centroid by adding up the disc, without the closed form
    s, h = np.meshgrid(np.linspace(-1, 1, 801), np.linspace(-1, 1, 801))
    angle = np.radians(30) + s[s**2 + h**2 <= 1] / 4
    seen = np.cos(angle)
    bias = 4 * np.sin(np.radians(30)) - (4 * np.sin(angle) * seen).sum() / seen.sum()
    assert_allclose(bias, 0.047, rtol=0.02)
    assert_allclose(4 * bias, 0.19, rtol=0.02)
    says(5, "120", "70", "0.047", "0.19")


def test_line_and_likeness():
    first, second = np.array([[1.0, 2], [3, 6]]), np.array([[2.0, 2], [4, 8]])
    assert f"{matching.ncc(first, second):.3f}" == "0.982"
    assert_allclose(matching.ncc(first, 2 * second + 10), matching.ncc(first, second))
    cosine = (first * second).sum() / np.sqrt((first**2).sum() * (second**2).sum())
    assert f"{cosine:.3f}" == "0.995"
    says(6, "4", "0.982", "0.995")


def test_pose():
    handle = np.array([[0.0, 0, 0], [10, 0, 0], [0, 20, 0], [0, 0, 5]])
    seen = np.array([[5.0, 5, 5], [5, 15, 5], [-15, 5, 5], [5, 5, 10]])
    T = pose.rigid_fit(handle, seen)
    assert_allclose(T.apply(handle), seen, atol=1e-12)
    assert_allclose(metrics.euler_deg(T), [90, 0, 0], atol=1e-9)
    places = metrics.pose_from_euler_deg(np.zeros((2, 3)), np.zeros((2, 3)))
    off = metrics.pose_from_euler_deg([[2.0, 1, 2], [0, 3, 4]], np.zeros((2, 3)))
    assert_allclose(metrics.position_error(off, places), 4)
    was_set, measured = (
        metrics.pose_from_euler_deg(np.zeros((1, 3)), [[0.0, 0, gamma]])
        for gamma in (179.5, -179.0)
    )
    assert_allclose(metrics.angle_errors_deg(measured, was_set)[..., 2], 1.5)
    says(7, "(5, 5, 5)", "90°", "(3 + 5)/2 = 4", "1.5°", "3.7")


def test_tool_and_wall():
    # the camera's x, y, z in the base: right, down, away
    R = Rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T)
    surveillance = Camera(
        "s",
        (640, 480),
        np.diag([500.0, 500, 1]),
        np.zeros(5),
        RigidTransform.from_rotation(R).inv(),
    )
    moved = 3 * mapping.alignment(surveillance).apply([-20, 10, -5])
    assert_allclose(moved, [-60, -15, -30], atol=1e-9)
    slow, fast = wall.Loop(1.0, 3.0, 1 / 30, 0.04), wall.Loop(1.0, 3.0, 1 / 300, 0.04)
    assert [f"{3 / loop.lag_s:.0f}" for loop in (slow, fast)] == ["53", "72"]
    assert wall.nyquist_limit(slow).stiffness > 3 / slow.lag_s
    # pressed against the wall slowly, a master without dampers feels two springs in a row
    pair = bilateral.Teleoperator(1e-6, 1e-6, 1e-6, 300.0, 0.0)
    omega = np.array([1e-3])
    felt = bilateral.felt_impedance(bilateral.hybrid_matrix(pair, omega), 600 / (1j * omega))
    assert_allclose((felt * 1j * omega).real, 200, rtol=1e-6)
    says(8, "(-60, -15, -30)", "56.7", "53", "200", "41.7", "72")


def test_the_table_of_the_lesson():
    """The plans' table of four rates: how long lamp and rod count as moving."""
    plans = (Path(__file__).resolve().parents[3] / "book" / "teaching" / "plans.md").read_text()
    rows = re.findall(
        r"^\| (0\.\d+) \| (\d+) \| (\d+) frames, ([\d.]+) s \| (\d+) frames, ([\d.]+) s \|$",
        plans,
        re.M,
    )
    assert len(rows) == 4
    for alpha, memory, *cells in rows:
        rate = float(alpha)
        assert float(memory) == 1 / rate
        for (frames, seconds), jump in zip((cells[:2], cells[2:]), (22.5, 45.0), strict=True):
            # a jump counts until it has faded to T = 15
            left = jump * (1 - rate) ** np.arange(1000)
            assert int(frames) == np.argmax(left <= 15)
            assert seconds == f"{int(frames) / 30:.1f}"
