"""Numbers of ours that the solutions of chapters 9 to 12 have typed, computed anew to the digit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import t as student
from solutions import says

from trinolab import datasets, estimators, identity, measurement, metrics
from trinolab.bench import optics, scene
from trinolab.camera import Rig
from trinolab.estimators import centroids
from trinolab.estimators.appearance import Views
from trinolab.parameters import Parameters
from trinolab.slave import bilateral, control, mapping, wall
from workbench import intervals
from workbench.course.exercises import exercise
from workbench.course.exercises.feedback import position_force
from workbench.studies import deviations, error_sources, pattern

# Chapter 9


def test_how_well_twenty_poses_know_an_offset():
    table1 = datasets.load_table1()
    differences = metrics.euler_deg(table1.measured) - metrics.euler_deg(table1.set_poses)
    wrapped = (differences + 180) % 360 - 180
    reach = student.ppf(0.975, 19) * wrapped.std(axis=0, ddof=1) / np.sqrt(20)
    says("09.2", f"Table 1's twenty give ±{reach.min():.2f}° to ±{reach.max():.2f}°")


def test_what_a_stricter_level_needs():
    patterns = datasets.load_sweep("patterns")
    tested = patterns[~patterns.fitted]
    tables = 19_999
    least = 2 / (tables + 1)  # of a two-sided p
    assert tested.p.min() == pytest.approx(least)
    says("09.5", f"with 19,999 tables a $p$ is at least {least:.4f}")
    says("09.5", f"by the number of tests, {len(tested)}, so that nothing falls below")
    says("09.5", f"nothing falls below {len(tested) * least:.3f}")
    asked = {name: one.value for name, one in exercise("09.5").asked.items()}
    says("09.5", f"{asked['clampings']} clampings in place of 6, and {asked['near']} poses beyond")
    usual = (tested.groupby("model").p_holm.min() >= 0.05).sum()
    (told,) = (one.gives["left"] for one in exercise("09.5").mistakes if one.gives.get("left"))
    assert told == usual


def test_a_camera_that_was_knocked_about_each_axis():
    """CCD2 really turned; the solution has the response to first order, and both ends."""
    truths = datasets.load_table1().set_poses
    rig, handle = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
    trial = error_sources.make_trial(rig, handle, truths)
    first, second = rig.cameras

    def errors_of(turn_deg):
        turn = Rotation.from_rotvec(turn_deg, degrees=True)
        T = RigidTransform.from_components(
            second.T_world_cam.translation, second.T_world_cam.rotation * turn
        )
        turned = Rig((first, replace(second, T_cam_world=T.inv())))
        return error_sources.response(trial, rig=turned)

    def before_and_after(errors):
        """The mean position error, mm, before and after the registration, and the smooth share."""
        after = deviations.registered(errors, truths, range(20))
        lengths = [np.linalg.norm(d[:, :3], axis=1).mean() for d in (errors, after)]
        return *lengths, pattern.smooth_share(truths.translation, errors[:, :3])

    sides = {
        axis: [errors_of(sign * 0.05 * unit) for sign in (1, -1)]
        for axis, unit in zip("xyz", np.eye(3), strict=True)
    }
    # half the difference of both sides is right to second order
    x, y, z = (before_and_after((one - other) / 2) for one, other in sides.values())
    says("09.6", f"{y[0]:.2f} mm before", f"After it {y[1]:.2f} mm", f"is {y[2]:.3f})")
    says("09.6", f"epipolar lines: {x[0]:.3f} mm before, {x[1]:.3f} after")
    says("09.6", f"About z it is {z[0]:.2f} mm before and {z[1]:.2f} after")
    says("09.6", f"with a smooth share of {z[2]:.2f}.")
    low, high = np.sort([before_and_after(one) for one in sides["y"]], axis=0)
    says(
        "09.6",
        f"gives {low[0]:.2f} to {high[0]:.2f} mm before and {low[1]:.3f} to {high[1]:.3f} mm after",
    )
    # a twentieth of a degree moves the image by f times it
    moved = first.focal.mean() * np.deg2rad(0.05)
    says("09.6", f"a knock that moves the image by {moved:.1f} px")


# Chapter 10


@pytest.mark.heavy
def test_plain_centroids_of_all_views():
    """Exercise 10.3 by SciPy's least squares, on the frames that the chapter renders."""
    rod, truths = datasets.load_handle("paper"), datasets.load_table1().set_poses
    pair, three = (datasets.load_rig(name) for name in ("paper_pair", "paper_trinocular"))
    ways = ("plain", "paper", "reprojection")
    errors = {(rig, way): [] for rig in (pair, three) for way in ways}

    def fitted(rig, uv, start):
        views = Views(*np.nonzero(np.isfinite(uv[..., 0])))

        def moved(six):
            turn = Rotation.from_rotvec(six[3:])
            return RigidTransform.from_components(
                start.translation + six[:3], turn * start.rotation
            )

        def off(six):
            predicted, _ = centroids.predict_centroids(rig, rod, moved(six), views)
            return (predicted - uv[views]).ravel() / 0.1

        return moved(least_squares(off, np.zeros(6), x_scale=[1, 1, 1, 0.01, 0.01, 0.01]).x)

    for row, truth in enumerate(truths):
        rng = np.random.default_rng([1705, row])
        images = list(scene.render_rig(pair, rod, truth, optics.Bench(), rng))
        images.append(scene.render(three.cameras[2], rod, truth, optics.Bench(), rng))
        for rig in (pair, three):
            seen = images[: len(rig.cameras)]
            found = measurement.measure(seen, rig, rod, truth, Parameters(estimator="paper"))
            uv = identity.labelled_pixels(found.labels, [one.uv for one in found.found], 12)
            instant = estimators.Identified(seen, uv, found.pose.T_world_handle, rig)
            poses = [fitted(rig, uv, found.pose.T_world_handle)]
            for way in ways[1:]:
                estimate = estimators.estimate(instant, rig, rod, Parameters(estimator=way))
                poses.append(estimate.T_world_handle)
            for way, T in zip(ways, poses, strict=True):
                mm = np.linalg.norm(T.translation - truth.translation)
                turn = (T.rotation * truth.rotation.inv()).magnitude()
                errors[rig, way].append((mm, np.rad2deg(turn)))

    def quoted(rig, way):
        mm, deg = np.transpose(errors[rig, way])
        (a, b, _), (c, d, _) = (intervals.of_mean(column) for column in (mm, deg))
        return (
            f"{mm.mean():.3f} mm ({a:.3f} to {b:.3f})",
            f"{deg.mean():.2f}° ({c:.2f} to {d:.2f})",
        )

    def plainly(rig):
        mm, deg = np.mean(errors[rig, "paper"], axis=0)
        return f"where the paper's fit has {mm:.3f} mm and {deg:.2f}°"

    two, all_three = (" and ".join(quoted(rig, "plain")) for rig in (pair, three))
    says("10.3", f"we get {two} for the pair, {plainly(pair)};")
    says("10.3", f"{all_three} with CCD3 above, {plainly(three)}.")
    by_registered = {
        rig: np.mean(errors[rig, "plain"], axis=0)[0]
        / np.mean(errors[rig, "reprojection"], axis=0)[0]
        for rig in (pair, three)
    }
    words = {9: "nine", 17: "seventeen"}
    says(
        "10.3",
        f"are {words[round(by_registered[pair])]} times those of registered centroids with the "
        f"pair, and {words[round(by_registered[three])]} times with CCD3 above",
    )


def test_what_the_third_camera_s_place_is_worth():
    asked = {name: one.value for name, one in exercise("10.5").asked.items()}
    says(
        "10.5",
        f"is known to {asked['pair_um']:.1f} µm, with CCD3 at 40° to {asked['third_um']:.1f}",
    )
    says("10.5", f"with CCD1 hidden then to {asked['hidden_um']:.1f} µm")


# Chapter 11


def test_the_first_chain_without_a_filter():
    """The stages added up by hand, at 20 mm/s. The tick's parts and the servo's cancel out."""
    p = control.ReferenceParameters(20.0)
    v, frame = 20.0, 1 / 30
    # each pose asks for rate * v * frame more speed, which the acceleration gives by and by
    climbing = p.rate * v * frame / (2 * (p.acceleration_mm_s2 + p.rate * v))
    stages = 0.005 + frame + 0.015 + frame / 2 + 1 / p.rate + climbing
    says("11.4", f"({1e3 * stages:.0f} ms at 20 mm/s)")


def test_a_loop_by_quaternions():
    def turned(epsilon_deg):
        s = np.sin(np.deg2rad(epsilon_deg) / 2)
        return 2 * np.rad2deg(np.arccos(1 - 2 * s**4))

    says("11.5", f"give {turned(20):.2f}° for the hand", f"and {turned(10):.2f}° for the tool")
    says("11.5", f"they give {turned(10):.2f}° and {turned(5):.2f}°, a quarter")


def test_the_moment_of_grace():
    says("11.3", f"missing for less than {mapping.MappingParameters().stale_s:g} s")


# Chapter 12


def test_the_two_masses_of_exercise_12_4():
    loop = wall.Loop(0.2, 2.0, 1 / 30, 0.05)
    limits, delays_ms = [], []
    for m in (0.2, 2.0):
        heavy = replace(loop, mass_kg=m)
        limits.append(wall.nyquist_limit(heavy).stiffness)
        assert wall.simulated_limit(heavy) == pytest.approx(limits[-1], rel=0.005)
        # where |L| = 1, by exercise 12.1; there the way to and fro must turn by a whole circle
        b, K, D = 2.0, 200.0, 2.0
        s = 1j * np.sqrt(2 * m * K - b**2 - 2 * b * D) / m
        C = D + K / s
        delays_ms.append(1e3 * (np.angle(C / (m * s + b + C)) % np.pi) / s.imag)
    says("12.4", f"with 0.2 kg $K_{{\\max}}$ is {limits[0]:.1f} N/m, with 2 kg {limits[1]:.1f} N/m")
    says("12.4", f"from {delays_ms[0]:.1f} to {delays_ms[1]:.1f} ms")


def test_delays_at_which_a_push_comes_to_rest():
    """Exercise 12.3: the hand pushes with 1 N, the wall of 1000 N/m is 50 mm away."""
    pair = bilateral.Teleoperator(0.2, 0.2, 2.0, 200.0, 2.0)
    push = np.ones(100_000)  # 20 s

    def with_force(delay_ms):
        return position_force(push, 5 * delay_ms, 0.05, 1000.0)[:, 0]

    def with_positions(delay_ms):
        late = replace(pair, delay_s=1e-3 * delay_ms)
        return bilateral.simulate(late, "position-position", push, 0.05, 1000.0, 2e-4).master_m

    def rests(places):
        return bool(np.ptp(places[-5000:]) < 1e-4)  # m

    assert [rests(with_force(ms)) for ms in (7, 8)] == [True, False]
    says("12.3", "comes to rest at a delay of 7 ms and no longer at 8 ms")
    assert [rests(with_positions(ms)) for ms in (30, 39, 40)] == [True, True, False]
    says("12.3", "and position-position does so up to 39 ms")
    thrown = with_force(50)[:4000].min()  # by the first blow
    says("12.3", f"out by {-thrown:.1f} m")


def test_the_best_share_of_a_period():
    """Exercise 12.5 by Nyquist; simulation, another algorithm, differs by less than a percent."""
    light = wall.Loop(0.05, 20.0, 1 / 30)
    limits = {}
    for hundredth in range(51):
        late = replace(light, delay_s=hundredth / 3000)
        limits[hundredth] = wall.nyquist_limit(late).stiffness
        if hundredth in (0, 17, 18, 25):
            assert wall.simulated_limit(late) == pytest.approx(limits[hundredth], rel=0.01)
    says("12.5", f"bears {limits[0]:.0f} N/m at once and {limits[25]:.0f} N/m a quarter")
    says("12.5", f"late, {limits[25] / limits[0]:.2f} times as much")
    best = max(limits.values())
    assert [k for k, limit in limits.items() if round(limit) == round(best)] == [17, 18]
    says("12.5", f"finds its best delay at 0.17 and 0.18, with {best:.0f} N/m.")
