"""The bounds of the open designs, by another way than their solutions, and what these say."""

import numpy as np
import pytest
from scipy import optimize, stats
from scipy.spatial.transform import RigidTransform
from solutions import says

from trinolab.camera import Camera
from trinolab.triangulation import triangulate_pair
from workbench.course.exercises import exercise
from workbench.course.exercises.slave import strokes_needed


def agrees(number, **values):
    asked = exercise(number).asked
    assert set(values) == set(asked)
    for name, value in values.items():
        assert abs(value - asked[name].value) <= asked[name].within, (name, value)


def camera(f_px, x_mm=0.0, width=1280):
    """At (x, 0, 0), along z."""
    matrix = np.array([[f_px, 0, (width - 1) / 2], [0, f_px, 511.5], [0, 0, 1]])
    return Camera(
        "one", (width, 1024), matrix, np.zeros(5), RigidTransform.from_translation([-x_mm, 0, 0])
    )


def test_a_stage_and_a_puppet():
    def sees_both_ends(f_px):
        ends = np.array([[-1000.0, 0, 3000], [1000.0, 0, 3000]])
        return camera(f_px).sees(ends).all()

    focal = max(f for f in range(500, 3000) if sees_both_ends(f))
    left, right = camera(focal).project(np.array([[-7.5, 0, 3000], [7.5, 0, 3000]]))
    period_ms = 1000 / 30
    waits = np.mean(np.arange(0, period_ms, 0.001))
    delay = 40 / 0.5
    agrees(
        "01.6",
        focal_px=focal,
        marker_px=right[0] - left[0],
        delay_ms=delay,
        left_ms=delay - 40 - waits,
    )
    says("01.6", f"A marker of 15 mm is then {right[0] - left[0]:.1f} px wide")
    says("01.6", f"the robot takes 40 ms and the wait {waits:.1f} ms: {delay - 40 - waits:.0f} ms")
    says(
        "01.6",
        f"and a quarter less at the far side, {3000 / (1 - 0.25) / 1000:.0f} m away",
    )
    says("01.6", f"an exposure of 10 ms leave {delay - 40 - waits - 10:.0f} ms")
    says("01.6", f"doubling the rate gives {waits / 2:.0f} ms back")


def test_a_bench_for_a_volume():
    corners = np.array([[x, 0, 600.0] for x in (-150, 150)])

    def both_see(baseline):
        pair = camera(1500, -baseline / 2), camera(1500, baseline / 2)
        return all(one.sees(corners).all() for one in pair)

    longest = max(b for b in np.arange(50, 400, 0.25) if both_see(b))
    rng = np.random.default_rng(0)

    def depth_sigma(baseline):
        pair = camera(1500, -baseline / 2), camera(1500, baseline / 2)
        point = np.array([[0.0, 0.0, 800.0]])
        slopes = []
        for k in range(2):
            moved = []
            for by in (-0.01, 0.01):
                uv = [one.project(point) for one in pair]
                uv[k] = uv[k] + [by, 0]
                moved.append(triangulate_pair(*pair, *uv)[0, 2])
            slopes.append((moved[1] - moved[0]) / 0.02)
        return 0.1 * np.linalg.norm(slopes)

    shortest = optimize.brentq(lambda b: depth_sigma(b) - 0.4, 50, 400)
    best = depth_sigma(longest)
    agrees("02.7", longest_mm=longest, shortest_mm=shortest, best_mm=best)
    pair = camera(1500, -longest / 2), camera(1500, longest / 2)
    uv = [
        one.project(np.tile([0.0, 0, 800], (4000, 1))) + rng.normal(0, 0.1, (4000, 2))
        for one in pair
    ]
    assert triangulate_pair(*pair, *uv)[:, 2].std() == pytest.approx(best, rel=0.05)
    says(
        "02.7",
        f"there requires $B \\ge {shortest:.1f}$ mm",
        f"there are {longest - shortest:.0f} mm",
    )
    says("02.7", f"the far end is known to {best:.3f} mm")


def test_a_calibration_in_half_an_hour():
    """Means of drawn numbers, of which one of 14 scatters as the chapter's cost."""
    rng = np.random.default_rng(0)
    noise = 0.165 * np.sqrt(14)

    def cost(positions, photographs):
        drawn = rng.normal(0, noise, (8000, positions, photographs))
        return drawn.mean(axis=(1, 2)).std()

    assert cost(28, 1) == pytest.approx(exercise("07.8").asked["single_mm"].value, rel=0.03)
    assert cost(20, 4) == pytest.approx(exercise("07.8").asked["averaged_mm"].value, rel=0.03)
    single, averaged = noise / np.sqrt(28), noise / np.sqrt(20 * 4)
    agrees("07.8", single_mm=single, averaged_mm=averaged, factor=np.hypot(1, 1))
    says(
        "07.8",
        f"= {single:.3f}$ mm; 20 positions",
        f"= {averaged:.3f}$ mm",
        f"{np.hypot(1, 1):.2f}",
    )


def test_an_experiment_that_finds_an_offset():
    """The smallest number whose power is enough, by the normal distribution itself."""

    def power(n, offset, scatter):
        limit = stats.norm.isf(0.025)
        mean = offset / (scatter / np.sqrt(n))
        return stats.norm.sf(limit - mean) + stats.norm.cdf(-limit - mean)

    def needed(offset, scatter, wanted):
        return next(n for n in range(2, 500) if power(n, offset, scatter) >= wanted)

    found = {
        "poses": needed(0.1, 0.28, 0.8),
        "half_power": needed(0.1, 0.28, 0.5),
        "pairs": needed(0.2, np.hypot(0.28, 0.28), 0.8),
    }
    agrees("09.8", **found)
    both = stats.norm.isf(0.025), stats.norm.isf(0.2)
    exact = (sum(both) * 0.28 / 0.1) ** 2
    says("09.8", f"({both[0]:.3f} + {both[1]:.3f})", f"= {exact:.1f}$: {found['poses']} poses")
    says("09.8", f"and {found['half_power']} for 50 %", f"({sum(both):.3f}")
    says("09.8", f"= {exact / 2:.1f}$: {found['pairs']} pairs")


def test_a_mapping_for_a_fine_task():
    scale, strokes = strokes_needed([120.0] * 3, [300.0, 0.0, 0.0], 0.31, 0.2)
    after, slow = 100 * 0.12, 0.2 / 0.12
    agrees("11.8", scale=scale, strokes=strokes, after_mm=after, slow_mm_s=slow)
    says("11.8", f"$0.2/0.31 = {scale:.3f}$", f"a stroke is {scale * 120:.0f} mm of the tool")
    says("11.8", f"travels {after:.0f} mm at 100 mm/s, and 0.2 mm at {slow:.1f} mm/s")


def test_a_force_that_is_shown():
    """By a tool that goes on in steps of 0.1 ms until the answer comes."""
    age = 66.7 + 40
    t, depth = 0.0, 0.0
    while t < age + 200:
        depth += 0.05 * 0.1
        t += 0.1
    agrees("12.6", depth_mm=0.5 / 0.8, age_ms=age, deep_mm=depth, force_n=0.8 * depth)
    says("12.6", f"0.5 N at 800 N/m are {0.5 / 0.8:.3f} mm", f"is {age:.1f} ms old")
    says(
        "12.6",
        f"comes {age + 200:.0f} ms after the contact: {depth:.1f} mm deep, {0.8 * depth:.1f} N",
    )
