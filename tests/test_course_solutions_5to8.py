"""The exercises of chapters 5 to 8: what the chapters print as solutions is right, and so are the
numbers that the graders know, by another way.
"""

import json
import re
import textwrap
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import j1

from trinolab import datasets, identity, matching, measurement
from trinolab.bench import optics, scene
from trinolab.calibration import eq25, start
from trinolab.camera import Camera, epipolar_lines, fundamental_matrix
from trinolab.course.child import outcome
from trinolab.course.exercise import FunctionExercise
from trinolab.course.exercises import exercise, of_chapter
from trinolab.course.grading import call_of, judge_outcomes

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"
CHAPTERS = ("05", "06", "07", "08")
KINDS = {
    "pencil": "Pencil",
    "write": "Write it yourself",
    "predict": "Change and predict",
    "project": "Project",
}


def text_of(chapter):
    """All markdown of a chapter."""
    (file,) = NOTEBOOKS.glob(f"{chapter}_*.ipynb")
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    return "\n\n".join("".join(one["source"]) for one in cells if one["cell_type"] == "markdown")


def block(text, kind, title):
    """What stands in a directive."""
    found = re.findall(rf"```{{{kind}}} {re.escape(title)}\n(.*?)\n```\n", text, re.DOTALL)
    assert len(found) == 1, title
    return found[0]


def function_in(solution, name):
    """The function that a solution's indented lines define."""
    lines = [line for line in solution.splitlines() if line.startswith("    ") or not line]
    namespace = {}
    exec(compile(textwrap.dedent("\n".join(lines)), name, "exec"), namespace)
    return namespace[name]


def judged(asked, function):
    return judge_outcomes(asked, [outcome(function, case) for case in call_of(asked).cases])


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_a_chapter_has_what_its_graders_have(chapter):
    text = text_of(chapter)
    headings = {line.lstrip("# ") for line in text.splitlines() if line.startswith("#")}
    assert {one.kind for one in of_chapter(chapter)} == set(KINDS)
    for one in of_chapter(chapter):
        number = one.number.lstrip("0")
        title = f"{KINDS[one.kind]}: {one.title[0].lower()}{one.title[1:]}"
        statement = block(text, "exercise", f"{number} {title}")
        assert statement.startswith(f":label: {one.label}\n:nonumber:\n")
        assert f'check("{one.number}", ' in statement
        names = [one.name] if isinstance(one, FunctionExercise) else list(one.asked)
        assert [name for name in names if name not in statement] == [], one.number
        for which in ("First", "Second"):
            assert block(text, "hint", f"{which} hint to {number}")
        solution = block(text, "solution", one.label)
        if isinstance(one, FunctionExercise):
            assert judged(one, function_in(solution, one.name)).right, one.number
        for mistake in one.mistakes:
            read, _, heading = mistake.read.partition(", ")
            assert read == chapter.lstrip("0")
            assert heading in headings, mistake.read


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
    seen = measurement.measure(frames, rig, handle, prior=truth)
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


def test_epipolar_lines_and_distances_are_the_package_s():
    line, distance = exercise("06.3").solution, exercise("06.5").solution
    rng = np.random.default_rng(1)
    for K_left, K_right, R, T, uv in call_of(exercise("06.3")).cases:
        left, right = two_cameras(K_left, K_right, R, T)
        ours, theirs = line(K_left, K_right, R, T, uv), epipolar_lines(left, right, [uv])[0]
        assert np.allclose(ours, np.sign(ours @ theirs) * theirs, rtol=0, atol=1e-6)  # px
        other = rng.uniform(0, 1000, 2)
        there = matching.epipolar_distances(left, right, [uv], [other])
        back = matching.epipolar_distances(right, left, [other], [uv])
        ours = distance(fundamental_matrix(left, right), uv, other)
        assert abs(ours - max(there, back)) < 1e-6


def test_the_map_of_the_correlation_is_opencv_s():
    asked = exercise("06.4")
    flat = 0
    for template, image in call_of(asked).cases:
        ours = asked.solution(template, image)
        as_floats = np.float32(image), np.float32(template)
        if np.ptp(template):
            opencv = cv2.matchTemplate(*as_floats, cv2.TM_CCOEFF_NORMED)
            assert np.allclose(ours[ours != 0], opencv[ours != 0], rtol=0, atol=1e-4)
        flat += (ours == 0).sum()
        n, m = np.shape(template)
        assert abs(ours[0, 0] - matching.ncc(template, np.array(image)[:n, :m])) < 1e-12
    assert flat > 1


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
    assert compared == 2


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
