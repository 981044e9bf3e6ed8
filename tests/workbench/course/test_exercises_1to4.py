"""The solutions of chapters 1 to 4: the code in the text is right, functions agree with the package's,
and values with another way to compute them.
"""

import json
import math
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from solutions import says

from trinolab import background, datasets, kalman, workspace
from trinolab.handle import Handle, facing_pixels
from trinolab.workspace import cones
from workbench.course.child import outcome
from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import exercise, of_chapter
from workbench.course.grading import call_of, judge_outcomes

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"
WRITTEN = [
    one.number
    for chapter in ("01", "02", "03", "04")
    for one in of_chapter(chapter)
    if isinstance(one, FunctionExercise)
]


def code_of(number):
    """The indented code of an exercise's solution in its chapter."""
    asked = exercise(number)
    (path,) = NOTEBOOKS.glob(f"{number[:2]}_*.ipynb")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n\n".join("".join(cell["source"]) for cell in cells)
    found = re.search(
        rf"\{{solution\}} {asked.label}\n:class: dropdown\n(.*?)\n```", text, re.DOTALL
    )
    lines = found[1].splitlines()
    ends = next((k for k, line in enumerate(lines) if line and line[0] != " "), len(lines))
    return textwrap.dedent("\n".join(lines[:ends]))


@pytest.mark.parametrize("number", WRITTEN)
def test_the_code_in_the_text_is_right(number):
    asked = exercise(number)
    namespace = {}
    exec(code_of(number), namespace)
    outcomes = [outcome(namespace[asked.name], case) for case in call_of(asked).cases]
    verdict = judge_outcomes(asked, outcomes)
    assert verdict.right, verdict
    assert "prints" not in verdict.says


def test_look_alikes_are_the_symmetries_of_a_handle():
    count = exercise("01.3").solution
    for name in ("paper", "coded"):
        rod = datasets.load_handle(name)
        assert count(np.rad2deg(rod.marker_angles), rod.marker_centres[:, 1]) == len(rod.symmetries)
    for angles, rows in call_of(exercise("01.3")).cases:
        # a column for each marker
        rod = Handle("one", 5.0, 60.0, 30.0, 1.0, tuple(angles), tuple((row,) for row in rows))
        # the package lets a rod be shifted along its axis as well
        in_place = [T for T in rod.symmetries if np.abs(T.translation).max() < 1e-6]
        assert count(angles, rows) == len(in_place)


def test_the_pyramid_is_what_a_camera_sees():
    rng = np.random.default_rng(0)
    sees = exercise("02.3").solution
    for camera in datasets.load_rig("paper_trinocular").cameras:
        points = rng.uniform(-900, 900, (200, 3))
        T = camera.T_cam_world.as_matrix()
        ours = [sees(p, T, camera.matrix, camera.size) for p in points]
        assert np.array_equal(ours, camera.sees(points))
        assert 0 < sum(ours) < len(ours)


def test_the_background_is_the_packages():
    rng = np.random.default_rng(0)
    film = rng.integers(0, 256, (20, 8, 9)).astype(np.uint8)
    first = rng.uniform(30, 60, (8, 9))
    B = first
    for frame in film:
        B = background.update(B, frame, 0.05)
    memory_s = -1 / 30 / np.log(0.95)
    even = np.arange(1, 21) / 30
    ours = exercise("03.3").solution(film, even, first, memory_s)
    assert np.allclose(ours, B, atol=1e-9)
    says("03.3", f"has the memory $-1/(30 \\ln 0.95) = {memory_s:.2f}$ s")


def test_a_rate_forgets_and_remembers_in_time():
    """Counted frame by frame, at the two ends and beyond them."""
    lamp, lamp_s, hand, hand_s, T, fps = 22.5, 3.0, 45.0, 2.0, 15.0, 30.0
    low, high = exercise("03.4").solution(lamp, lamp_s, hand, hand_s, T, fps)

    def left(jump, rate, seconds):
        for _ in range(round(seconds * fps)):
            jump = background.update(np.zeros((1, 1)), np.full((1, 1), jump), 1 - rate).item()
        return jump

    for rate, fits in (
        (low * 0.99, False),
        (low * 1.01, True),
        (high * 0.99, True),
        (high * 1.01, False),
    ):
        assert (left(lamp, rate, lamp_s) <= T and left(hand, rate, hand_s) >= T) is fits
    one = exercise("03.4").solution
    least, _ = one(22.5, 1.0, 45.0, 0.1, 15.0, 30.0)
    _, most = one(22.5, 1e3, 45.0, 5.0, 15.0, 30.0)
    says("03.4", f"at least {least:.4f}, the hand at most {most:.4f}: there is no such rate")
    assert np.isnan(one(22.5, 1.0, 45.0, 5.0, 15.0, 30.0)).all()
    seen_s = max(
        s for s in np.arange(0.1, 5, 0.01) if np.isfinite(one(22.5, 1, 45, s, 15, 30)).all()
    )
    says("03.4", f"the hand is seen for $\\ln 3 / \\ln 1.5 = {seen_s:.1f}$ s")


def test_a_step_is_the_packages():
    """Whose Eq. 14 is Joseph's form, and which solves where ours inverts."""
    step = exercise("04.3").solution
    for X, P, Z, dt, Q, R in call_of(exercise("04.3")).cases:
        state = kalman.predict(kalman.State(X, P), kalman.constant_acceleration(dt), Q)
        state = kalman.update(state, Z, kalman.observation_matrix(), R)
        ours = step(X, P, Z, dt, Q, R)
        assert np.allclose(ours[0], state.mean, atol=1e-8)
        assert np.allclose(ours[1], state.covariance, atol=1e-8)


def test_a_vague_filter_of_one_number_takes_the_mean():
    seen = np.random.default_rng(0).normal(5, 2, 12)
    means = exercise("04.2").solution(seen, 0.0, 1e6, 0.0, 1.0)
    assert math.isclose(means[-1], seen.mean(), rel_tol=1e-6)  # 1e6 is not infinite
    one = exercise("04.2").solution
    certain = one([10.0] * 1000, 0.0, 0.01, 0.0, 1.0)
    assert not any(certain)
    refused = np.array(one([10.0] * 40, 0.0, 0.01, 1.0, 1.0)) == 0
    assert refused.sum() == 10
    assert not refused[10:].any()
    says("04.2", "ten observations are refused, and the eleventh is accepted")


def asked(number):
    return {name: one.value for name, one in exercise(number).asked.items()}


def test_values_of_chapter_2():
    trio = cones.paper_cones(100.0, *np.deg2rad([45, 45, 15]))
    p = np.array([50.0, 10.0, 50.0])
    off = [
        math.degrees(math.acos((p - c.apex) @ c.axis / np.linalg.norm(p - c.apex))) for c in trio
    ]
    assert asked("02.1")["ccd1_deg"] == pytest.approx(off[0], abs=0.01)
    assert asked("02.1")["ccd3_deg"] == pytest.approx(off[2], abs=0.01)
    assert bool(cones.inside(trio, p[None])[0]) == (asked("02.1")["inside"] == "yes")
    for name, (width, height) in {"square": (1, 1), "rectangle": (1280, 1024)}.items():
        circle = math.pi * np.hypot(width / 2, height / 2) ** 2
        assert asked("02.2")[name] == pytest.approx(circle / (width * height), abs=1e-9)
    trio = cones.paper_cones(1.0, *np.deg2rad([75, 75, 20]))
    # the axes meet where CCD3's is: at its apex's z
    assert asked("02.4")["meet_B"] == pytest.approx(trio[2].apex[2], abs=1e-9)
    assert asked("02.4")["volume_B3"] == pytest.approx(workspace.intersect(trio).volume, abs=1e-3)


def test_values_of_the_project_of_chapter_2():
    rod, poses = datasets.load_handle("paper"), datasets.load_table1().set_poses
    for elevation_deg in (40, 90):
        rig = datasets.paper_rig(elevation_deg)
        enough = 0
        for T in poses:
            seen = [
                np.isfinite(facing_pixels(rod, one, T, 70.0)[:, 0])
                & one.sees(T.apply(rod.marker_centres))
                for one in rig.cameras
            ]
            enough += any((seen[k] & seen[2]).sum() >= 4 for k in (0, 1))
        assert asked("02.5")[f"poses_{elevation_deg}"] == enough
        litres = workspace.view_volume(rig).volume / 1e6
        assert asked("02.5")[f"litres_{elevation_deg}"] == pytest.approx(litres, abs=0.01)
    assert workspace.view_volume(datasets.paper_rig(10)).status == asked("02.5")["at_10"]


def test_values_of_chapter_3():
    p = background.BackgroundParameters(0.01, 15.0, 0.3, 0, compensate_light=False)

    def unseen(way, greys):
        bench = np.full((1, len(greys)), 45.0)
        mask = background.step(bench, greys[None].astype(np.uint8), way)[1].mask[0]
        return greys[~mask].min(), greys[~mask].max()

    greys = np.arange(256)
    low, high = unseen(p, greys)
    assert math.ceil(asked("03.1")["lowest"]) == low
    assert asked("03.1")["highest"] == high
    plain = background.BackgroundParameters(0.01, 15.0, 0.0, 0, compensate_light=False)
    assert unseen(plain, greys) == (asked("03.1")["lowest_plain"], high)

    # the noise of a background that was renewed for long: the sum of its weights' squares
    weights = 0.01 * 0.99 ** np.arange(5000)
    sigma = math.sqrt(4.5 * (1 + (weights**2).sum()))
    pixels = 1280 * 1024
    assert 2 * norm.sf(asked("03.2")["T"] / sigma) * pixels == pytest.approx(1, abs=0.05)
    assert 2 * norm.sf(8 / sigma) * pixels == pytest.approx(asked("03.2")["false_at_8"], abs=1)
    at_start = math.sqrt(2 * (0.05 * 200 + 1.5**2))
    assert 2 * norm.sf(asked("03.2")["T_at_200"] / at_start) * pixels == pytest.approx(1, abs=0.05)

    # a ramp, followed for long
    light = B = 45.0
    alpha = asked("03.5")["alpha"]
    for _ in range(5000):
        light = light + 0.03
        B = alpha * light + (1 - alpha) * B
    assert light - B == pytest.approx(3.0, abs=1e-3)
    for name, alpha in (("rod_s", asked("03.5")["alpha"]), ("hand_s", 0.02)):
        difference, frames = 45.0, 0
        while difference > 15:
            difference, frames = difference * (1 - alpha), frames + 1
        one = exercise("03.5").asked[name]
        assert one.value == pytest.approx(frames / 30, abs=one.within)
