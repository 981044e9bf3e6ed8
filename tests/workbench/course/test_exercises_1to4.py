"""Chapters 1 to 4: functions agree with the package's, and values and the numbers in the solutions'
texts with other ways to compute them.
"""

import math

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import RigidTransform
from scipy.stats import norm
from solutions import agrees, broken, says

from trinolab import background, datasets, kalman, workspace
from trinolab.camera import Camera
from trinolab.handle import Handle, facing_pixels
from trinolab.triangulation import triangulate_pair
from trinolab.workspace import cones
from workbench.course.exercises import exercise
from workbench.course.grading import call_of


def camera(f_px, x_mm=0.0):
    """At (x, 0, 0), along z."""
    matrix = np.array([[f_px, 0, 639.5], [0, f_px, 511.5], [0, 0, 1]])
    T_cam_world = RigidTransform.from_translation([-x_mm, 0, 0])
    return Camera("one", (1280, 1024), matrix, np.zeros(5), T_cam_world)


# Chapter 1


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


def test_a_stage_and_a_puppet():
    ends = np.array([[-1000.0, 0, 3000], [1000.0, 0, 3000]])
    focal = max(f for f in range(1800, 2100) if camera(f).sees(ends).all())
    left, right = camera(focal).project(np.array([[-7.5, 0, 3000], [7.5, 0, 3000]]))
    waits = 1000 / 30 / 2
    rest = 40 / 0.5 - 40 - waits
    agrees("01.6", focal_px=focal, marker_px=right[0] - left[0], delay_ms=40 / 0.5, left_ms=rest)


# Chapter 2


def test_the_pyramid_is_what_a_camera_sees():
    rng = np.random.default_rng(0)
    sees = exercise("02.3").solution
    for one in datasets.load_rig("paper_trinocular").cameras:
        points = rng.uniform(-900, 900, (200, 3))
        T = one.T_cam_world.as_matrix()
        ours = [sees(p, T, one.matrix, one.size) for p in points]
        assert np.array_equal(ours, one.sees(points))
        assert 0 < sum(ours) < len(ours)


def test_cones():
    trio = cones.paper_cones(100.0, *np.deg2rad([45, 45, 15]))
    p = np.array([50.0, 10.0, 50.0])
    off = [
        math.degrees(math.acos((p - c.apex) @ c.axis / np.linalg.norm(p - c.apex))) for c in trio
    ]
    inside = "yes" if cones.inside(trio, p[None])[0] else "no"
    agrees("02.1", ccd1_deg=off[0], ccd3_deg=off[2], inside=inside)
    for name, (width, height) in {"square": (1, 1), "rectangle": (1280, 1024)}.items():
        circle = math.pi * np.hypot(width / 2, height / 2) ** 2
        agrees("02.2", **{name: circle / (width * height)})
    volumes = {}
    for b in (45, 75):
        trio = cones.paper_cones(1.0, *np.deg2rad([b, b, 20]))
        volumes[b] = workspace.intersect(trio).volume
    # the axes meet where CCD3's is: at its apex's z
    agrees("02.4", meet_B=trio[2].apex[2], volume_B3=volumes[75])
    says("02.4", f"from {volumes[45]:.3f} to {volumes[75]:.3f} $B^3$")


def test_elevations_of_a_third_camera():
    rod, poses = datasets.load_handle("paper"), datasets.load_table1().set_poses
    litres, enough = [], []
    for elevation_deg in (10, 20, 30, 40, 60, 90):
        rig = datasets.paper_rig(elevation_deg)
        view = workspace.view_volume(rig)
        volume = f"{view.volume / 1e6:,.{0 if view.volume > 1e9 else 1}f}"
        litres.append(view.status if view.status == "unbounded" else volume)
        seen = np.array(
            [
                [
                    np.isfinite(facing_pixels(rod, one, T, 70.0)[:, 0])
                    & one.sees(T.apply(rod.marker_centres))
                    for one in rig.cameras
                ]
                for T in poses
            ]
        )
        shared = (seen[:, :2] & seen[:, 2:]).sum(axis=2).max(axis=1)
        enough.append(f"{(shared >= 4).sum()}")
        if elevation_deg == 10:
            agrees("02.5", at_10=view.status)
        if elevation_deg == 40:
            agrees("02.5", share=0.1, poses_40=(shared >= 4).sum(), litres_40=view.volume / 1e6)
        if elevation_deg == 90:
            agrees("02.5", share=0.2, poses_90=(shared >= 4).sum(), litres_90=view.volume / 1e6)
    says("02.5", f"| volume / l | {' | '.join(litres)} |")
    says("02.5", f"| poses of 20 | {' | '.join(enough)} |")


def test_a_bench_for_a_volume():
    corners = np.array([[x, 0, 600.0] for x in (-150, 150)])

    def pair(baseline):
        return camera(1500, -baseline / 2), camera(1500, baseline / 2)

    def depth_sigma(baseline):
        slopes = []
        for k in range(2):
            moved = []
            for by in (-0.01, 0.01):
                uv = [one.project([[0.0, 0.0, 800.0]]) for one in pair(baseline)]
                uv[k] = uv[k] + [by, 0]
                moved.append(triangulate_pair(*pair(baseline), *uv)[0, 2])
            slopes.append((moved[1] - moved[0]) / 0.02)
        return 0.1 * np.linalg.norm(slopes)

    longest = max(
        b for b in np.arange(150, 250, 0.25) if all(one.sees(corners).all() for one in pair(b))
    )
    shortest = optimize.brentq(lambda b: depth_sigma(b) - 0.4, 50, 400)
    best = depth_sigma(longest)
    agrees("02.7", longest_mm=longest, shortest_mm=shortest, best_mm=best)


# Chapter 3


def test_the_background_is_the_packages():
    rng = np.random.default_rng(0)
    film = rng.integers(0, 256, (20, 8, 9)).astype(np.uint8)
    first = rng.uniform(30, 60, (8, 9))
    B = first
    for frame in film:
        B = background.update(B, frame, 0.05)
    memory_s = -1 / 30 / np.log(0.95)
    ours = exercise("03.3").solution(film, np.arange(1, 21) / 30, first, memory_s)
    assert np.allclose(ours, B, atol=1e-9)
    says("03.3", f"has the memory $-1/(30 \\ln 0.95) = {memory_s:.2f}$ s")


def test_a_rate_forgets_and_remembers_in_time():
    """Counted frame by frame, at the two ends and beyond them."""
    one = exercise("03.4").solution

    def left(jump, rate, seconds):
        for _ in range(round(seconds * 30)):
            jump = background.update(np.zeros((1, 1)), np.full((1, 1), jump), 1 - rate).item()
        return jump

    low, high = one(22.5, 3.0, 45.0, 2.0, 15.0, 30.0)
    rates = np.array([low * 0.99, low * 1.01, high * 0.99, high * 1.01])
    fits = [left(22.5, rate, 3.0) <= 15.0 <= left(45.0, rate, 2.0) for rate in rates]
    assert fits == [False, True, True, False]
    least, _ = one(22.5, 1.0, 45.0, 0.1, 15.0, 30.0)
    _, most = one(22.5, 1e3, 45.0, 5.0, 15.0, 30.0)
    says("03.4", f"at least {least:.4f}, the hand at most {most:.4f}: there is no such rate")
    assert np.isnan(one(22.5, 1.0, 45.0, 5.0, 15.0, 30.0)).all()


def unseen(shadow, greys):
    """The darkest and the brightest grey that nobody sees on a bench of 45."""
    way = background.BackgroundParameters(0.01, 15.0, shadow, 0, compensate_light=False)
    bench = np.full((1, len(greys)), 45.0)
    mask = background.step(bench, greys[None].astype(np.uint8), way)[1].mask[0]
    return greys[~mask].min(), greys[~mask].max()


def test_thresholds_and_rates():
    greys = np.arange(256)
    low, high = unseen(0.3, greys)
    assert math.ceil(exercise("03.1").asked["lowest"].value) == low
    agrees("03.1", highest=high, lowest_plain=unseen(0.0, greys)[0])

    # the noise of a background that was renewed for long: the sum of its weights' squares
    weights = 0.01 * 0.99 ** np.arange(5000)
    sigma = math.sqrt(4.5 * (1 + (weights**2).sum()))
    at_start = math.sqrt(2 * (0.05 * 200 + 1.5**2))
    pixels = 1280 * 1024
    one = norm.isf(0.5 / pixels)  # beyond it lies one pixel of all
    agrees("03.2", T=one * sigma, T_at_200=one * at_start)
    agrees("03.2", false_at_8=2 * norm.sf(8 / sigma) * pixels)

    # a ramp, followed for long
    alpha = exercise("03.5").asked["alpha"].value
    light = B = 45.0
    for _ in range(5000):
        light = light + 0.03
        B = alpha * light + (1 - alpha) * B
    assert light - B == pytest.approx(3.0, abs=1e-3)
    for name, rate in (("rod_s", alpha), ("hand_s", 0.02)):
        frames = next(n for n in range(1000) if 45.0 * (1 - rate) ** n <= 15)
        agrees("03.5", share=1, **{name: frames / 30})


def test_half_of_an_empty_bench_moves():
    rng = np.random.default_rng(0)
    one, other = (np.rint(rng.normal(45, 2, (200, 200))).astype(np.uint8) for _ in range(2))
    share = broken("03.7")(one, other, 15).mean()
    assert share == pytest.approx((one < other).mean())
    assert 0.4 < share < 0.5
    apart = np.abs(np.subtract(one, other, dtype=int)) > 3
    assert np.array_equal(exercise("03.7").solution(one, other, 3), apart)


# Chapter 4


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
    one = exercise("04.2").solution
    seen = np.random.default_rng(0).normal(5, 2, 12)
    means = one(seen, 0.0, 1e6, 0.0, 1.0)
    assert math.isclose(means[-1], seen.mean(), rel_tol=1e-6)  # 1e6 is not infinite
    assert not any(one([10.0] * 1000, 0.0, 0.01, 0.0, 1.0))
    refused = np.array(one([10.0] * 40, 0.0, 0.01, 1.0, 1.0)) == 0
    assert refused.tolist() == [True] * 10 + [False] * 30


def test_a_search_window_is_three_sigmas_of_the_package_s_prediction():
    for x, P, dt, Q, frames in call_of(exercise("04.6")).cases:
        state = kalman.State(x, P)
        for _ in range(frames):
            state = kalman.predict(state, np.array([[1, dt], [0, 1]]), Q)
        ours = exercise("04.6").solution(x, P, dt, Q, frames)
        expected = state.mean[0], 3 * state.covariance[0, 0] ** 0.5
        assert ours == pytest.approx(expected, rel=1e-9)
