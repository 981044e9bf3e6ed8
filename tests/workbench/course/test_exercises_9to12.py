"""Chapters 9 to 12: functions agree with the package's, and values with other algorithms and hand
numbers.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import norm
from solutions import agrees

from trinolab import datasets, metrics
from trinolab.camera import Rig
from trinolab.estimators import centroids, reprojection
from trinolab.estimators.appearance import Views
from trinolab.handle import facing_pixels
from trinolab.parameters import Parameters
from trinolab.slave import bilateral, mapping, wall
from trinolab.slave.oneeuro import OneEuroParameters
from workbench.course.exercises import exercise
from workbench.course.exercises.estimators import variance_without
from workbench.course.exercises.feedback import position_force
from workbench.course.exercises.slave import clutched, strokes_needed
from workbench.course.exercises.table1 import askew_differences, mean_angle_errors
from workbench.course.grading import call_of
from workbench.studies import accounts, deviations, error_sources, experiment, pattern

TABLE1 = datasets.load_table1()
PLACES = TABLE1.set_poses
RIG, ROD = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
PAIR = bilateral.Teleoperator(0.2, 0.2, 2.0, 200.0, 2.0)


def value(number, name):
    return exercise(number).asked[name].value


def views_of(seen):
    """The views (camera, marker) in which there is a pixel."""
    return Views(*np.nonzero(np.isfinite(seen[..., 0])))


def facing(rig, handle, T, slant_deg):
    return np.stack([facing_pixels(handle, camera, T, slant_deg) for camera in rig.cameras])


# Chapter 9


def test_angle_errors_are_the_package_s():
    errors = mean_angle_errors(metrics.euler_deg(TABLE1.measured), metrics.euler_deg(PLACES))
    expected = metrics.angle_errors_deg(TABLE1.measured, PLACES)
    np.testing.assert_allclose(errors, expected, atol=1e-12)
    lost = np.array([[180.0, 0, 0], [np.nan, 0, 0]])
    np.testing.assert_allclose(mean_angle_errors(lost, np.full((2, 3), -179.0))[0], 1.0)


def test_a_small_turn_goes_through_the_jacobian_of_the_angles():
    """To first order d(alpha, beta, gamma) is a matrix times the rotation vector."""
    turn = np.array([1e-4, -2e-4, 1.5e-4])  # deg
    angles, jacobian = metrics.euler_deg(PLACES), deviations.euler_jacobian(PLACES)
    for where, turns in (("world", [turn] * 20), ("handle", PLACES.rotation.apply(turn))):
        expected = np.einsum("nij,nj->ni", jacobian, turns)
        np.testing.assert_allclose(askew_differences(angles, turn, where), expected, atol=1e-7)


def test_offsets_of_table_1():
    for name, beta in (("at_80", 80), ("at_0", 0), ("at_minus_80", -80)):
        ends = Rotation.from_euler("ZYX", [[20, beta, -30], [20.006, beta + 0.006, -29.994]], True)
        agrees("09.1", **{name: 100 * np.rad2deg((ends[1] * ends[0].inv()).magnitude())})
    errors = deviations.exact([TABLE1.measured], PLACES)
    clamp = accounts.clamping(errors, PLACES)
    assert clamp.repeat_deg.value == pytest.approx(0.28, abs=0.005)
    for factor in (2.093, 1.96):
        agrees("09.2", share=1, of_twenty=factor * 0.28 / np.sqrt(20))
    for poses, factor in ((30.1, 1.96), (33, 2.037)):  # Student's for 32 degrees of freedom
        assert factor * 0.28 / np.sqrt(poses) == pytest.approx(0.1, abs=0.001)
        agrees("09.2", share=1, poses=poses)


def test_a_stricter_judge():
    patterns = datasets.load_sweep("patterns")
    tested = patterns[~patterns.fitted]
    least = tested.groupby("model").p_holm.min()
    agrees("09.5", left=(least >= 0.001).sum())
    assert (least >= 0.001).all()
    growth = patterns.set_index(["model", "statistic"]).model_median["certain", "growth_alpha"]

    def needed(level):
        """Clampings, and poses beyond the table."""
        return (
            experiment.fewest(lambda m: power(2.0, 15 * m - 6, 15 * (m - 1), level), 0.9),
            experiment.fewest(lambda n: power(growth**2, n - 1, 19, level), 0.9),
        )

    power = experiment.power_of_ratio
    assert needed(0.05) == (6, 8)
    clampings, poses = needed(0.001)
    agrees("09.5", clampings=clampings, near=poses)


def test_a_camera_that_was_knocked_about_each_axis():
    """CCD2 really turned; the solution has the response to first order, and both ends."""
    trial = error_sources.make_trial(RIG, ROD, PLACES)
    first, second = RIG.cameras

    def errors_of(turn_deg):
        turn = Rotation.from_rotvec(turn_deg, degrees=True)
        T = RigidTransform.from_components(
            second.T_world_cam.translation, second.T_world_cam.rotation * turn
        )
        turned = Rig((first, replace(second, T_cam_world=T.inv())))
        return error_sources.response(trial, rig=turned)

    def before_and_after(errors):
        """The mean position error, mm, before and after the registration, and the smooth share."""
        after = deviations.registered(errors, PLACES, range(20))
        lengths = [np.linalg.norm(d[:, :3], axis=1).mean() for d in (errors, after)]
        return *lengths, pattern.smooth_share(PLACES.translation, errors[:, :3])

    sides = [[errors_of(sign * 0.05 * unit) for sign in (1, -1)] for unit in np.eye(3)]
    # half the difference of both sides is right to second order
    axes = np.array([before_and_after((one - other) / 2) for one, other in sides])
    before, after, smooth = axes[1]
    missed = "xyz"[axes[:, 2].argmin()]
    agrees("09.6", before_mm=before, after_mm=after, smooth_share=smooth, missed=missed)


def test_an_experiment_that_finds_an_offset():
    """The smallest number whose power is enough, by the normal distribution itself."""

    def power(n, offset, scatter):
        limit = norm.isf(0.025)
        mean = offset / (scatter / np.sqrt(n))
        return norm.sf(limit - mean) + norm.cdf(-limit - mean)

    def needed(offset, scatter, wanted):
        return next(n for n in range(2, 500) if power(n, offset, scatter) >= wanted)

    poses, half = needed(0.1, 0.28, 0.8), needed(0.1, 0.28, 0.5)
    pairs = needed(0.2, np.hypot(0.28, 0.28), 0.8)
    agrees("09.8", poses=poses, half_power=half, pairs=pairs)


# Chapter 10


def test_what_is_left_without_a_view_is_the_package_s():
    rng = np.random.default_rng(3)
    rig, T = datasets.load_rig("raised_40deg"), PLACES[9]
    views = views_of(facing(rig, ROD, T, 62.0))
    predicted, J = centroids.predict_centroids(rig, ROD, T, views)
    roots = rng.normal(0, 0.02, (len(J), 2, 2)) + 0.1 * np.eye(2)
    C = roots @ roots.mT
    found = predicted + rng.normal(0, 0.05, predicted.shape)
    ours = variance_without(J, C)
    for k in (0, len(J) - 1):
        rest = np.arange(len(J)) != k
        fewer = Views(views.camera[rest], views.marker[rest])
        _, package = reprojection.fit_pixels(
            found[rest], C[rest], rig, ROD, fewer, T, steps=1, huber=np.inf
        )
        assert ours[k] == pytest.approx(np.trace(package[:3, :3]), rel=1e-3)

    # four times all covariances, and then those of CCD3 alone
    def fitted(factor):
        return reprojection.fit_pixels(
            found, factor * C, rig, ROD, views, T, steps=10, huber=np.inf
        )

    once, fourfold = fitted(1.0), fitted(4.0)
    agrees("10.4", pose="stays", pose_ccd3="moves")
    np.testing.assert_allclose(once[0].as_matrix(), fourfold[0].as_matrix(), atol=1e-7)
    np.testing.assert_allclose(fourfold[1], value("10.4", "covariance") * once[1], rtol=1e-4)
    nees = [metrics.nees(*fit, T)[0] for fit in (once, fourfold)]
    agrees("10.4", share=1, nees=nees[1] / nees[0])
    spoilt = fitted(np.where(views.camera == 2, 4.0, 1.0)[:, None, None])
    assert np.linalg.norm(spoilt[0].translation - once[0].translation) > 1e-4  # mm


def test_a_known_grey_is_worth_its_share():
    """The upper left of the inverse of the whole normal equations, in place of its complement."""
    J, K = np.array([2.0, -2.0]), np.array([1.0, 1.0])
    columns = np.column_stack([J, K])
    for weights, known, unknown in (([1, 0.25], 5.0, 3.2), ([1, 1], 8.0, 8.0)):
        normal = columns.T @ np.diag(weights) @ columns
        assert normal[0, 0] == known
        assert 1 / np.linalg.inv(normal)[0, 0] == pytest.approx(unknown)
    agrees("10.2", known=5.0, unknown=3.2, lost_even=0.0)


def test_half_a_marker():
    """A centroid by the integral, at 40 degrees, with markers of 3 and of 1.5 mm."""
    T = PLACES[9]
    bias = []
    for factor in (1.0, 0.5):
        one = replace(ROD, marker_diameter_mm=factor * ROD.marker_diameter_mm)
        seen = facing(RIG, one, T, 62.0)
        views = views_of(seen)
        uv, _ = centroids.predict_centroids(RIG, one, T, views)
        bias.append(np.linalg.norm(uv - seen[views], axis=1).max())
    assert bias[1] / bias[0] == pytest.approx(value("10.1", "bias"), rel=0.03)  # the third order
    # what the blurred edge of a disc tells of a shift along u, by the sum over its pixels
    u, v = np.mgrid[-15:15:0.23, -15:15:0.23]
    r = np.hypot(u, v)
    information = [((norm.pdf(r, a, 0.76) * u / r) ** 2).sum() for a in (7.75, 7.75 / 2)]
    scatter = (information[1] / information[0]) ** -0.5
    assert scatter == pytest.approx(value("10.1", "scatter"), rel=0.02)


def test_a_third_camera_anywhere():
    """By the package's centroids."""
    slant = Parameters().max_slant_deg

    def worst_um(rig, hidden):
        sigmas = []
        for T in PLACES:
            uv = facing(rig, ROD, T, slant)
            uv[list(hidden)] = np.nan
            _, J = centroids.predict_centroids(rig, ROD, T, views_of(uv))
            rows = J.reshape(-1, 6) / 0.012
            covariance = np.linalg.inv(rows.T @ rows)
            sigmas.append(1e3 * np.sqrt(np.trace(covariance[:3, :3])))
        return max(sigmas)

    def with_three_shared(rig):
        shared = [np.isfinite(facing(rig, ROD, T, slant)[1:, :, 0]).all(axis=0) for T in PLACES]
        return sum(one.sum() >= 3 for one in shared)

    ours = datasets.paper_rig(40.0)
    assert with_three_shared(ours) == 16
    agrees("10.5", pair_um=worst_um(RIG, ()), third_um=worst_um(ours, ()))
    agrees("10.5", hidden_um=worst_um(ours, (0,)))
    agrees("10.5", shared_90=with_three_shared(datasets.paper_rig(90.0)))


# Chapter 11


def test_the_clutch_is_the_package_s():
    """With a filter that does nothing, and losses that are longer than the moment of grace."""
    rng = np.random.default_rng(0)
    period, count = 1 / 30, 60
    hand = np.cumsum(rng.normal(0, 2, (count, 3)), axis=0)
    closed = np.ones(count, bool)
    closed[[0, 1, 20, 21, 22, 40, 55]] = False
    hand[[10, 11, 12, 30, 31, 32, 33, 38, 39, 40, 41]] = np.nan
    start = RigidTransform.from_translation([400.0, 0, 300])
    parameters = mapping.MappingParameters(
        scale=1.7, filtering=OneEuroParameters(1e9, 1e9), stale_s=1.5 * period
    )
    state, places = mapping.State(0.0, start), []
    for k, (place, is_closed) in enumerate(zip(hand, closed, strict=True)):
        pose = None if np.isnan(place[0]) else RigidTransform.from_translation(place)
        sample = mapping.Sample(
            (k + 1) * period, pose, "lost" if pose is None else "measured", is_closed
        )
        state = mapping.step(state, sample, parameters)
        places.append(state.target.translation)
    ours = clutched(hand, closed, start.translation, 1.7)
    np.testing.assert_allclose(ours, places, atol=1e-5)  # mm; what is left of the filter
    assert np.ptp(ours[33:40], axis=0).max() == 0


def test_scale_and_alignment():
    scale, strokes = strokes_needed([150, 120, 100], [300, 60, 200], 0.31, 0.1)
    assert strokes == 7
    assert strokes_needed([150, 120, 100], [300, 60, 200], 0.31, 2 * 0.31) == (2, 1)
    for hand, task, error, tolerance in call_of(exercise("11.2")).cases:
        scale, strokes = strokes_needed(hand, task, error, tolerance)
        ways = scale * np.multiply(hand, [[strokes], [strokes - 1]])
        assert scale == pytest.approx(tolerance / error)
        reached = (ways >= np.multiply(task, 1 - 1e-12)).all(axis=1)
        assert reached.tolist() == [True, False] or strokes == 0
    old = Rotation.from_euler("x", -90, degrees=True)  # down becomes -z, away becomes +y
    np.testing.assert_allclose(2 * old.apply([30, 10, 6]), [60, 12, -20], atol=1e-9)
    round_the_table = Rotation.from_euler("z", 180, degrees=True) * old
    x, y, z = 2 * round_the_table.apply([30, 10, 6])
    agrees("11.1", x=x, y=y, z=z)


def test_a_peg_in_a_hole():
    """By the formulas, and the stages added up by hand."""
    frame, take = 1 / 60, 1 / (1 + 60 / (2 * np.pi * 4))
    left = 3 * np.sqrt(take / (2 - take))
    wander = left * np.hypot(0.05, 20 * np.deg2rad(0.3))
    agrees("11.4", share=1, wander_mm=wander, clearance_mm=(20.5 - 20) / 2)
    assert wander < (20.5 - 20) / 2
    f = OneEuroParameters()
    filtered = 1 / (2 * np.pi * (4 + f.slope * 20))
    others = 0.005 + frame + 0.015 + frame / 2 + 0.001 + 0.001
    # the reference's time constant is 1/60 s; it climbs a little after each pose
    agrees("11.4", share=1, delay_ms=1e3 * (others + filtered + 1 / 60))
    slower = 1 / (2 * np.pi * (2 + f.slope * 20))
    assert others + slower + 1 / 60 > 0.1
    assert 0.005 + 1 / 30 + 0.015 + 1 / 60 + 0.001 + 0.001 + 1 / 20 > 0.1  # without a filter


def test_a_loop_of_rotations():
    """By quaternions: the scalar part of the commutator of two turns by epsilon."""

    def turned(epsilon_deg):
        s = np.sin(np.deg2rad(epsilon_deg) / 2)
        return 2 * np.rad2deg(np.arccos(1 - 2 * s**4))

    order = np.log2(turned(2) / turned(1))
    agrees("11.5", share=1, hand_deg=turned(20), tool_deg=turned(10), order=order)


def test_a_tool_that_jumps():
    for tool, turn_deg, ratio in call_of(exercise("11.6")).cases:
        turn = Rotation.from_rotvec(ratio * np.array(turn_deg), degrees=True)
        ours = exercise("11.6").solution(tool, turn_deg, ratio)
        np.testing.assert_allclose(ours, turn.as_matrix() @ tool, atol=1e-12)


def test_a_mapping_for_a_fine_task():
    scale, strokes = strokes_needed([120.0] * 3, [300.0, 0.0, 0.0], 0.31, 0.2)
    after, slow = 100 * 0.12, 0.2 / 0.12
    agrees("11.8", scale=scale, strokes=strokes, after_mm=after, slow_mm_s=slow)


# Chapter 12


def rests(places):
    return bool(np.ptp(places[-5000:]) < 1e-4)  # m


def test_a_force_that_comes_back():
    """Hand numbers at rest, and the package where no force comes back."""
    at_rest = position_force(np.full(20_000, 2.0), 0, 0.0, 1000.0)[-1]
    np.testing.assert_allclose(at_rest, [2 / 200 + 2 / 1000, 2 / 1000], rtol=1e-4)
    free = position_force(np.ones(12_000), 0, 10.0, 1000.0)[:, 0]
    speed = (free[-1] - free[-2]) / 2e-4
    assert speed == pytest.approx(1 / 2.0, rel=1e-4)  # push over damping
    # led by a hand that does what the coupling's spring would do to the master
    push = np.linspace(0, 1, 1000)
    led = bilateral.simulate(PAIR, "position-position", push, 10.0, 1000.0, 2e-4)
    ours = position_force(push - led.master_n, 0, 10.0, 1000.0)
    np.testing.assert_allclose(ours, np.column_stack([led.master_m, led.slave_m]), atol=1e-12)


def test_delays_at_which_a_push_comes_to_rest():
    """Exercise 12.3: the hand pushes with 1 N, the wall of 1000 N/m is 50 mm away."""

    def with_force(delay_ms):
        return position_force(np.ones(50_000), 5 * delay_ms, 0.05, 1000.0)[:, 0]

    def with_positions(delay_ms):
        late = replace(PAIR, delay_s=1e-3 * delay_ms)
        push = np.ones(100_000)  # 20 s
        return bilateral.simulate(late, "position-position", push, 0.05, 1000.0, 2e-4).master_m

    assert [rests(with_force(ms)) for ms in (7, 8)] == [True, False]
    assert [rests(with_positions(ms)) for ms in (39, 40)] == [True, False]
    thrown = with_force(50)[:4000].min()  # by the first blow
    assert thrown == pytest.approx(-0.316, abs=0.002)


def test_frequencies_and_limits():
    s = 1j * value("12.1", "omega")
    C = 2.0 + 200.0 / s
    assert abs(C / (0.2 * s + 2.0 + C)) == pytest.approx(1)
    agrees("12.1", stiffness=30.0)
    assert bilateral.critical_delay(replace(PAIR, stiffness=30.1)) < np.inf
    assert bilateral.critical_delay(replace(PAIR, stiffness=29.9)) == np.inf

    camera = wall.Loop(0.2, 2.0, 1 / 30, 0.05)
    for infinite in (2 / camera.lag_s, wall.nyquist_limit(replace(camera, mass_kg=2e3)).stiffness):
        agrees("12.4", infinite=infinite)
    agrees("12.2", damping=800 * camera.lag_s)
    soon = wall.Loop(2000.0, 2.0, 1e-4, 1e-3 * value("12.2", "age_ms") - 0.5e-4)
    assert wall.nyquist_limit(soon).stiffness == pytest.approx(800, rel=1e-3)

    limits, delays_ms = [], []
    for m in (0.2, 2.0):
        heavy = replace(camera, mass_kg=m)
        limits.append(wall.nyquist_limit(heavy).stiffness)
        assert wall.simulated_limit(heavy) == pytest.approx(limits[-1], rel=0.005)
        # where |L| = 1, by exercise 12.1; there the way to and fro must turn by a whole circle
        b, K, D = 2.0, 200.0, 2.0
        s = 1j * np.sqrt(2 * m * K - b**2 - 2 * b * D) / m
        C = D + K / s
        delays_ms.append(1e3 * (np.angle(C / (m * s + b + C)) % np.pi) / s.imag)
    agrees("12.4", at_2_kg=limits[1], critical_ms=delays_ms[1])


def test_a_little_delay_that_helps():
    """By Nyquist; simulation, another algorithm, differs by less than a percent."""

    def largest(share, mass_kg):
        loop = wall.Loop(mass_kg, 20.0, 1 / 30, share / 30)
        return wall.nyquist_limit(loop).stiffness, loop

    massless = {share: largest(share, 1e-5)[0] / (20 * 30) for share in (0, 0.23, 0.25, 0.27)}
    agrees("12.5", prompt=massless[0], best=massless[0.25], best_share=0.25)
    assert max(massless, key=massless.get) == 0.25

    limits = []
    for hundredth in (0, 16, 18, 19, 25):
        limit, loop = largest(hundredth / 100, 0.05)
        assert wall.simulated_limit(loop) == pytest.approx(limit, rel=0.01)
        limits.append(limit)
    agrees("12.5", light_gain=limits[-1] / limits[0])
    assert np.argmax(limits) == 2


def test_a_force_that_is_shown():
    """By a tool that goes on at 50 mm/s until the answer comes."""
    age = 66.7 + 40
    depth = 0.05 * (age + 200)
    agrees("12.6", depth_mm=0.5 / 0.8, age_ms=age, deep_mm=depth, force_n=0.8 * depth)
