"""The exercises of chapters 5 to 8: what the chapters print as solutions is right, and so are the
numbers that the graders know, by another way.
"""

import json
import re
import textwrap
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import j1
from solutions import says

from trinolab import datasets, identity, matching, measurement, metrics, pose, triangulation
from trinolab.bench import optics, scene
from trinolab.calibration import eq25, start
from trinolab.camera import Camera, epipolar_lines, fundamental_matrix
from trinolab.handle import facing_pixels
from trinolab.parameters import Parameters
from workbench.course.child import outcome
from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import exercise, of_chapter
from workbench.course.grading import call_of, judge_outcomes
from workbench.studies import centroid_bias

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"


def printed(chapter, asked):
    """The function that the chapter prints as the solution of an exercise."""
    (file,) = NOTEBOOKS.glob(f"{chapter}_*.ipynb")
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    text = "\n\n".join("".join(one["source"]) for one in cells)
    (solution,) = re.findall(rf"```{{solution}} {asked.label}\n(.*?)\n```\n", text, re.DOTALL)
    lines = [line for line in solution.splitlines() if line.startswith("    ") or not line]
    namespace = {}
    exec(textwrap.dedent("\n".join(lines)), namespace)
    return namespace[asked.name]


@pytest.mark.parametrize("chapter", ["05", "06", "07", "08"])
def test_the_printed_code_is_right(chapter):
    for asked in of_chapter(chapter):
        if isinstance(asked, FunctionExercise):
            function = printed(chapter, asked)
            outcomes = [outcome(function, case) for case in call_of(asked).cases]
            assert judge_outcomes(asked, outcomes).right, asked.number


def test_the_longest_plateau_by_another_labelling():
    """SciPy's labels, and a plain search for the longest run."""

    def by_scipy(image):
        image = np.array(image)
        counts = [ndimage.label(image > t, np.ones((3, 3)))[1] for t in range(image.max())]
        runs = [
            (first - last, first)  # the longest, and of these the lowest, is the smallest
            for first in range(len(counts))
            for last in range(first, len(counts))
            if len(set(counts[first : last + 1])) == 1 and counts[first] >= 4
        ]
        if not runs:
            return np.nan
        negative, first = min(runs)
        return first - negative / 2

    asked = exercise("05.3")
    for (image,) in call_of(asked).cases:
        assert np.array_equal(asked.solution(image), by_scipy(image), equal_nan=True)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_before_a_bright_background_no_plateau_is_long(seed):
    """The solution says so: three thresholds at most, where the standard scene has dozens."""

    def longest(image):
        counts = [ndimage.label(image > t, np.ones((3, 3)))[1] for t in range(image.max())]
        return max(len(list(run)) for count, run in groupby(counts) if count >= 4)

    cases = centroid_bias.hostile_stills(optics.Bench(read_noise=1.5), np.random.default_rng(seed))
    assert longest(cases["bright background"].image) <= 3
    assert longest(cases["standard scene"].image) > 24


def test_the_values_of_chapter_5():
    """The bias by adding up strips, the search step by step, the better centres in an image."""
    rho, radius, theta = 0.75, 5.0, np.deg2rad(65)
    a = np.linspace(-rho, rho, 100_001)
    weight = np.sqrt(rho**2 - a**2) * np.cos(theta + a / radius)
    place = radius * np.sin(theta + a / radius)
    off_mm = radius * np.sin(theta) - (place * weight).sum() / weight.sum()
    asked = exercise("05.1").asked
    assert abs(off_mm * 5.214 - asked["bias_px"].value) < asked["bias_px"].within / 2

    low, high, thresholds, counts = 45.0, 220.0, [], []
    while high - low >= 1:
        thresholds.append((low + high) / 2)
        counts.append(8 if thresholds[-1] > 120 else 4)
        high = thresholds[-1]
    right = exercise("05.2").answer
    assert [counts[0], counts[-1], len(counts)] == [
        right["first_count"],
        right["last_count"],
        right["thresholds"],
    ]
    assert abs(thresholds[-1] - right["last_threshold"]) < 1e-3


def test_the_better_centres():
    """Exercise 5.5, in the frames that it names."""
    rig, handle = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
    truth = datasets.load_table1().set_poses[9]
    frames = scene.render_rig(rig, handle, truth, optics.Bench(), np.random.default_rng(0))
    seen = measurement.measure(frames, rig, handle, truth, Parameters(estimator="paper"))
    uv = identity.labelled_pixels(seen.labels, [one.uv for one in seen.found], 12)
    T = seen.pose.T_world_handle
    epsilon = 0.3
    share = 1 - (j1(2 * epsilon) / (2 * epsilon)) / (j1(epsilon) / epsilon)
    centres = T.apply(handle.marker_centres)
    for k, camera in enumerate(rig.cameras):
        e = np.cross(T.rotation.apply([0, 1, 0]), camera.centre - centres)
        e /= np.linalg.norm(e, axis=1, keepdims=True)
        sine = (T.rotation.apply(np.array(handle.marker_normals)) * e).sum(axis=1, keepdims=True)
        moved = uv[k] + camera.project(centres) - camera.project(centres - 5 * sine * share * e)
        true = camera.project(truth.apply(handle.marker_centres))
        uv[k] = np.linalg.norm([uv[k] - true, moved - true], axis=2).T  # before, after
    rms = np.sqrt(np.nanmean(uv**2, axis=(0, 1)))
    for value, asked in zip(rms, exercise("05.5").asked.values(), strict=True):
        assert abs(value - asked.value) < asked.within


def two_cameras(K_left, K_right, R, T):
    """The package's cameras, the left one's frame the world."""
    motions = RigidTransform.identity(), RigidTransform.from_components(T, Rotation.from_matrix(R))
    pairs = zip(("left", "right"), (K_left, K_right), motions, strict=True)
    return [Camera(name, (1280, 1024), K, np.zeros(5), motion) for name, K, motion in pairs]


def test_epipolar_lines_are_the_package_s_and_scatter_as_expected():
    """Noise is drawn for the scatter, on a pair that is right but for it."""
    line, scatter = exercise("06.3").solution, exercise("06.5").solution
    rng = np.random.default_rng(1)
    for K_left, K_right, R, T, uv in call_of(exercise("06.3")).cases:
        left, right = two_cameras(K_left, K_right, R, T)
        ours, theirs = line(K_left, K_right, R, T, uv), epipolar_lines(left, right, [uv])[0]
        assert np.allclose(ours, np.sign(ours @ theirs) * theirs, rtol=0, atol=1e-6)  # px
        a, b, c = ours
        other = np.array([-a * c, -b * c]) + rng.uniform(-300, 300) * np.array([-b, a])
        sigma = 0.1
        drawn = [place + rng.normal(0, sigma, (4000, 2)) for place in (uv, other)]
        lines = epipolar_lines(left, right, drawn[0])
        off = (lines * np.column_stack([drawn[1], np.ones(4000)])).sum(axis=1)
        expected = scatter(fundamental_matrix(left, right), uv, other, sigma)
        assert abs(off.std() / expected - 1) < 0.05
    rows = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    beside = scatter(rows, [50.0, 60.0], [30.0, 60.0], 0.3)
    says("06.5", f"it is $\\sqrt2\\,\\sigma$, {beside:.2f} px", f"are {2 / beside:.1f} standard")


def test_noise_costs_the_correlation_that_is_expected():
    rng = np.random.default_rng(0)
    solution = exercise("06.4").solution
    for scatter, left, right in ((9.0, 3.0, 3.0), (20.0, 5.0, 30.0)):
        patch = rng.normal(120, scatter, (400, 400))
        views = [patch + rng.normal(0, sigma, patch.shape) for sigma in (left, right)]
        assert abs(matching.ncc(*views) - solution(patch, left, right)) < 0.005
    assert abs(solution([[9.0, -9.0]], 3.0, 3.0) - 0.9) < 1e-12
    says("06.4", "a patch whose grey levels have a standard deviation of 9")


def test_the_values_of_chapter_6():
    """Spots drawn at random, and nails seen by cameras."""
    rng = np.random.default_rng(0)
    beside = np.abs(rng.uniform(0, 320, (100_000, 5)) - 160)
    wrong = exercise("06.1").asked["wrong"].value
    assert abs((beside < 2).sum(axis=1).mean() - wrong) < 4 * np.sqrt(wrong / 100_000)

    left, right = two_cameras(np.eye(3), np.eye(3), np.eye(3), [-100, 0, 0])
    nails = [[50, 0, 550], [50, 0, 570]]
    steps = [np.diff(camera.project(nails)[:, 0])[0] for camera in (left, right)]
    right_ones = exercise("06.2").answer
    assert np.allclose(steps, [right_ones["left_step"], right_ones["right_step"]], atol=1e-12)


def test_the_square_lens_agrees_with_zhang_s():
    """With three positions and exact corners the lens with two focal lengths is the same."""
    asked = exercise("07.3")
    compared = 0
    for homographies, size in call_of(asked).cases:
        K = asked.solution(homographies, size)
        for H in homographies:  # what defines it: the columns become perpendicular, of one length
            a, b = (np.linalg.inv(K) @ H)[:, :2].T
            assert abs(a @ b) < 1e-9 * (a @ a)
            assert abs(a @ a - b @ b) < 1e-9 * (a @ a)
        if len(homographies) > 2:
            assert np.allclose(K, start.intrinsics(homographies, size), rtol=1e-6)
            compared += 1
    assert compared >= 2


def test_the_values_of_chapter_7():
    """The motion by the package, the number of positions by search."""
    answer = exercise("07.1").answer
    for degrees, names in ((0, ("T_x",)), (30, ("turned_x", "turned_z"))):
        left = RigidTransform.identity()  # of the board, which is the left camera's frame
        rotation = Rotation.from_euler("y", degrees, degrees=True)
        right = RigidTransform.from_components([100, 0, 0], rotation).inv()
        T = eq25.relative_pose(right, left).translation[[0, 2]]  # of the left in the right
        assert np.allclose(T[: len(names)], [answer[name] for name in names], rtol=0, atol=1e-2)

    positions = np.arange(14, 1000)
    enough = positions[0.165 * np.sqrt(14 / positions) <= 0.031][0]
    asked = exercise("07.2").asked
    assert abs(enough - asked["positions"].value) <= 1
    assert abs(np.sqrt(enough / 14) - asked["noise_factor"].value) < 0.01


def test_a_point_and_a_fit_are_the_package_s():
    """Points where there is one, and NaN where there is none; motions with the missing rows."""
    asked = exercise("08.3")
    found = []
    for xy_left, xy_right, R, T in call_of(asked).cases:
        left, right = two_cameras(np.eye(3), np.eye(3), R, T)
        theirs = triangulation.triangulate_pair(left, right, [xy_left], [xy_right])[0]
        ours = asked.solution(xy_left, xy_right, R, T)
        assert np.allclose(ours, theirs, rtol=0, atol=1e-9, equal_nan=True)  # mm
        found.append(bool(np.isfinite(ours).all()))
    assert (sum(found), len(found)) == (8, 13)

    asked = exercise("08.4")
    for on_rod, measured in call_of(asked).cases:
        theirs = pose.rigid_fit(on_rod, measured).as_matrix()
        assert np.allclose(asked.solution(on_rod, measured), theirs, rtol=0, atol=1e-9)


def test_the_midpoint_is_nearest_to_both_rays():
    """The point with the least sum of squared distances from both rays, by their projections."""
    asked = exercise("08.5")
    for rays in call_of(asked).cases:
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for centre, ray in (rays[:2], rays[2:]):
            across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            normal, right = normal + across, right + across @ centre
        nearest = np.linalg.solve(normal, right)
        assert np.allclose(asked.solution(*rays), nearest, rtol=0, atol=1e-6)  # mm


def test_the_values_of_chapter_8():
    """Scatter drawn at random, the point with the wrong baseline, the mirrored fits."""
    rng = np.random.default_rng(0)
    f, baseline, depth = 2950.0, 99.0, 570.0
    noise = rng.normal(0, 0.1, (2, 200_000))
    z = f * baseline / (f * baseline / depth + noise[0] - noise[1])
    x = z * noise[0] / f
    asked = exercise("08.1").asked
    assert abs(z.std() - asked["sigma_z"].value) < asked["sigma_z"].within
    assert abs(x.std() - asked["sigma_x"].value) < asked["sigma_x"].within

    K = np.diag([1000.0, 1000, 1])
    file = two_cameras(K, K, np.eye(3), [100, 0, 0])  # as it is in the file: at x = -100
    answer = exercise("08.2").answer
    point = [answer["x"], 30, answer["z"]]
    images = [(K @ one.T_cam_world.apply(point)) for one in file]
    assert np.allclose([uv[:2] / uv[2] for uv in images], [[50, -75], [-200, -75]])

    rod = datasets.load_handle("paper").marker_centres
    mirrored = {}
    for count in (4, 12):
        mirrored[count] = 0
        for turn in Rotation.random(100, rng=rng):
            measured = rod[:count] @ turn.as_matrix().T + rng.normal(0, 0.05, (count, 3))
            of, on = (points - points.mean(axis=0) for points in (measured, rod[:count]))
            U, S, Vt = np.linalg.svd(of.T @ on)
            mirrored[count] += np.linalg.det(U @ Vt) < 0
            assert (S[2] < 1e-9 * S[0]) == (count == 4)
    asked = exercise("08.6").asked
    assert abs(mirrored[4] - asked["of_four"].value) < asked["of_four"].within
    assert mirrored[12] == 0
    assert asked["of_twelve"].value == "none"


def test_weights_help_against_noise_alone():
    """Exercise 8.7, in fewer draws."""
    rig, handle = datasets.load_rig("raised_40deg"), datasets.load_handle("paper")
    truths = datasets.load_table1().set_poses
    rng = np.random.default_rng(0)
    fits = [], []
    for T in truths:
        uv = np.stack([facing_pixels(handle, camera, T, 70.0) for camera in rig.cameras])
        for _ in range(3):
            noisy = uv + rng.normal(0, 0.1, uv.shape)
            plain = triangulation.triangulate(rig, noisy)
            weighted, _ = triangulation.triangulate_weighted(rig, noisy, 0.1)
            for some, points in zip(fits, (plain, weighted), strict=True):
                some.append(pose.rigid_fit(handle.marker_centres, points))
    repeated = truths[np.repeat(np.arange(20), 3)]
    plain, weighted = (
        metrics.pose_errors(RigidTransform.concatenate(some), repeated).geodesic_mean_deg
        for some in fits
    )
    # 60 fits scatter twice as much as the 200 of the exercise
    asked = exercise("08.7").asked["noise_ratio"]
    assert abs(weighted / plain - asked.value) < 2 * asked.within
