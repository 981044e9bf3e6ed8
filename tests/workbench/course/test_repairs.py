"""Code that is broken by one defect: what is handed out is broken, shows as its text says, and is
mended in one line.
"""

import difflib
import textwrap

import numpy as np
import pytest
from chapters import LESSONS
from scipy.spatial.transform import Rotation
from solutions import says

from trinolab import kalman
from workbench.course.child import outcome
from workbench.course.exercises import CHAPTERS, exercise, of_chapter
from workbench.course.grading import call_of, judge_outcomes
from workbench.course.stubs import body_of, stub
from workbench.course.texts import read_texts

REPAIRS = [one for chapter in CHAPTERS for one in of_chapter(chapter) if one.kind == "repair"]
TOLD = {one.number: one for path in LESSONS for one in read_texts(path)}


def handed_out(asked):
    """The function that a student gets, from its text."""
    namespace = {}
    exec(stub(asked), namespace)
    return namespace[asked.name]


def test_there_are_six():
    assert len(REPAIRS) == 6
    assert len({one.number[:2] for one in REPAIRS}) == 6


@pytest.mark.parametrize("asked", REPAIRS, ids=lambda one: one.number)
def test_what_is_handed_out_is_broken_and_told_so(asked):
    found = [outcome(handed_out(asked), case) for case in call_of(asked).cases]
    assert not any("raised" in one for one in found), "it runs"
    verdict = judge_outcomes(asked, found)
    assert not verdict.right
    assert verdict.says.startswith(f"{asked.name} is still to be repaired")


@pytest.mark.parametrize("asked", REPAIRS, ids=lambda one: one.number)
def test_the_chapter_shows_the_code_that_is_handed_out(asked):
    told = TOLD[asked.number].statement
    code = [line for line in told.splitlines() if line.startswith("    ")]
    head, *body = textwrap.dedent("\n".join(code)).splitlines()
    assert head in stub(asked)
    assert "\n".join(body) == body_of(asked.broken)


@pytest.mark.parametrize("asked", REPAIRS, ids=lambda one: one.number)
def test_one_line_mends_it(asked):
    before, after = (body_of(one).splitlines() for one in (asked.broken, asked.solution))
    changed = [line for line in difflib.ndiff(before, after) if line.startswith("- ")]
    assert len(changed) == 1, changed


def broken(number):
    return handed_out(exercise(number))


def test_half_of_an_empty_bench_moves():
    rng = np.random.default_rng(0)
    one, other = (np.rint(rng.normal(45, 2, (200, 200))).astype(np.uint8) for _ in range(2))
    share = broken("03.7")(one, other, 15).mean()
    assert share == pytest.approx((one < other).mean())
    assert 0.4 < share < 0.5
    assert not broken("03.7")(one, other.astype(float), 15).any()


def test_the_target_leaves_the_window_that_stays_small():
    """Drawn as the filter's own model has it: 1 px, 15 px/s, and a random push in each frame."""
    rng = np.random.default_rng(0)
    dt, n = 1 / 30, 4000
    P, Q = np.diag([1.0, 225.0]), np.diag([0.01, 4.0])
    missed = {}
    for frames in (1, 6):
        X = rng.normal(0, [1.0, 15.0], (n, 2)) + [320.0, 90.0]
        for _ in range(frames):
            X[:, 0] += dt * X[:, 1]
            X += rng.normal(0, np.sqrt(np.diag(Q)), (n, 2))
        for name, function in (("broken", broken("04.6")), ("right", exercise("04.6").solution)):
            place, half = function(np.array([320.0, 90.0]), P, dt, Q, frames)
            missed[name, frames] = np.mean(np.abs(X[:, 0] - place) > half)
            assert abs(X[:, 0].mean() - place) < 4 * X[:, 0].std() / np.sqrt(n)
    assert max(missed["right", 1], missed["right", 6]) < 0.006
    assert missed["broken", 6] > 0.25
    assert missed["broken", 1] < 0.02
    state = kalman.State(np.array([1.0, 2.0]), P)
    Phi = np.array([[1, dt], [0, 1]])
    package = kalman.predict(state, Phi, Q)
    place, half = exercise("04.6").solution(state.mean, P, dt, Q, 1)
    assert (place, half) == pytest.approx((package.mean[0], 3 * package.covariance[0, 0] ** 0.5))


def test_centroids_to_the_upper_left():
    v, u = np.indices((31, 31))

    def off(radius, noise=0.0):
        inside = np.clip(radius + 0.5 - np.hypot(u - 15, v - 15), 0, 1)
        ground = noise * np.random.default_rng(0).random(u.shape)
        return broken("05.6")(45 + ground + 175 * inside, 15, 15, 6) - 15

    assert np.allclose(off(3.0), 0)
    assert np.all((off(6.0) < -0.05) & (off(6.0) > -0.5))
    assert np.all(off(3.0, noise=12.0) < -0.01)


def test_lines_miss_when_the_world_is_not_the_left_camera():
    rng = np.random.default_rng(0)
    R, T = Rotation.from_rotvec([0.02, -0.17, 0.01]).as_matrix(), np.array([-97.0, 2.0, 9.0])
    world = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
    shift = np.array([30.0, -200.0, 560.0])
    on_table = (world, shift, R @ world, R @ shift + T)
    for function, right in ((broken("06.8"), False), (exercise("06.8").solution, True)):
        assert np.allclose(function(np.eye(3), np.zeros(3), R, T)[1], T)
        assert np.allclose(function(*on_table)[1], T) is right
        assert np.allclose(function(*on_table)[0], R)


def test_a_camera_that_is_turned_by_5_degrees_is_off_by_10():
    turn = Rotation.from_rotvec([0, 5, 0], degrees=True)
    points = np.random.default_rng(0).normal(0, 50, (6, 3)) + [0, 0, 560]
    wrong = broken("08.8")(points, turn.as_matrix(), np.zeros(3))
    right = exercise("08.8").solution(points, turn.as_matrix(), np.zeros(3))
    between, _ = Rotation.align_vectors(wrong, right)
    assert np.rad2deg(between.magnitude()) == pytest.approx(10)
    assert np.allclose(
        np.diff(wrong, axis=0) ** 2 @ np.ones(3), np.diff(right, axis=0) ** 2 @ np.ones(3)
    )


def test_a_tool_that_jumps():
    def angle_deg(turn):
        made = broken("11.6")(np.eye(3), np.array([0, 0, turn]), 1.0)
        return np.rad2deg(Rotation.from_matrix(made).magnitude())

    says("11.6", f"a tenth of a degree became {angle_deg(0.1):.1f}°")
    says("11.6", f"and {2 * np.pi:.1f}° a whole turn")
    assert angle_deg(2 * np.pi) == pytest.approx(0, abs=1e-9)
