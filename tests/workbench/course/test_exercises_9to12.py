"""The solutions of chapters 9 to 12: the code that the chapters print, other algorithms, and hand
numbers.
"""

import json
import re
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import norm
from solutions import says

from trinolab import datasets, metrics
from trinolab.estimators import centroids, reprojection
from trinolab.estimators.appearance import Views
from trinolab.handle import facing_pixels
from trinolab.parameters import Parameters
from trinolab.slave import bilateral, mapping, wall
from trinolab.slave.oneeuro import OneEuroParameters
from workbench.course.child import outcome
from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import exercise, of_chapter
from workbench.course.exercises.estimators import variance_without
from workbench.course.exercises.feedback import position_force
from workbench.course.exercises.slave import clutched, strokes_needed
from workbench.course.exercises.table1 import askew_differences, mean_angle_errors
from workbench.course.grading import call_of, judge_outcomes
from workbench.studies import accounts, deviations, error_sources, experiment, pattern

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"


def text_of(chapter):
    (file,) = NOTEBOOKS.glob(f"{chapter}_*.ipynb")
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells)


def printed_code(chapter, label):
    """The code block of a solution."""
    found = rf"```{{solution}} {label}\n:class: dropdown\n(.*?)\n```"
    solution = re.search(found, text_of(chapter), re.S)
    lines = solution[1].splitlines()
    code = [line for line in lines if line.startswith("    ") or not line.strip()]
    return textwrap.dedent("\n".join(code))


@pytest.mark.parametrize("chapter", ["09", "10", "11", "12"])
def test_the_printed_code_is_right(chapter):
    for asked in of_chapter(chapter):
        if isinstance(asked, FunctionExercise):
            namespace = {}
            exec(printed_code(chapter, asked.label), namespace)
            function = namespace[asked.name]
            outcomes = [outcome(function, case) for case in call_of(asked).cases]
            assert judge_outcomes(asked, outcomes).right, asked.number


def value(number, name):
    return exercise(number).asked[name].value


def near(number, name):
    """The value that is asked for, with its tolerance."""
    asked = exercise(number).asked[name]
    return pytest.approx(asked.value, rel=0, abs=asked.within)


# Chapter 9


def test_angle_errors_are_the_package_s():
    table1 = datasets.load_table1()
    measured, truths = table1.measured, table1.set_poses
    errors = mean_angle_errors(metrics.euler_deg(measured), metrics.euler_deg(truths))
    np.testing.assert_allclose(errors, metrics.angle_errors_deg(measured, truths), atol=1e-12)
    lost = np.array([[180.0, 0, 0], [np.nan, 0, 0]])
    np.testing.assert_allclose(mean_angle_errors(lost, np.full((2, 3), -179.0))[0], 1.0)


def test_a_small_turn_goes_through_the_jacobian_of_the_angles():
    """To first order d(alpha, beta, gamma) is a matrix times the rotation vector."""
    truths = datasets.load_table1().set_poses
    turn = np.array([1e-4, -2e-4, 1.5e-4])  # deg
    angles = metrics.euler_deg(truths)
    jacobian = deviations.euler_jacobian(truths)
    world = askew_differences(angles, turn, "world")
    np.testing.assert_allclose(world, jacobian @ turn, atol=1e-7)
    handle = askew_differences(angles, turn, "handle")
    np.testing.assert_allclose(
        handle, np.einsum("nij,nj->ni", jacobian, truths.rotation.apply(turn)), atol=1e-7
    )


def test_offsets_of_table_1():
    for name, beta in (("at_80", 80), ("at_0", 0), ("at_minus_80", -80)):
        ends = Rotation.from_euler("ZYX", [[20, beta, -30], [20.006, beta + 0.006, -29.994]], True)
        assert 100 * np.rad2deg((ends[1] * ends[0].inv()).magnitude()) == near("09.1", name)
    table1 = datasets.load_table1()
    errors = deviations.exact([table1.measured], table1.set_poses)
    clamp = accounts.clamping(errors, table1.set_poses)
    assert clamp.repeat_deg.value == pytest.approx(0.28, abs=0.005)
    assert 2.093 * 0.28 / np.sqrt(20) == near("09.2", "of_twenty")
    assert 1.96 * 0.28 / np.sqrt(20) == near("09.2", "of_twenty")
    for poses, factor in ((30.1, 1.96), (33, 2.037)):  # Student's for 32 degrees of freedom
        assert factor * 0.28 / np.sqrt(poses) == pytest.approx(0.1, abs=0.001)
        assert poses == near("09.2", "poses")


def test_a_stricter_judge():
    patterns = datasets.load_sweep("patterns")
    tested = patterns[~patterns.fitted]
    least = tested.groupby("model").p_holm.min()
    assert (least >= 0.001).sum() == value("09.5", "left") == len(least)
    assert (least >= 0.05).sum() == 2
    growth = patterns.set_index(["model", "statistic"]).model_median["certain", "growth_alpha"]

    def clampings(level):
        return experiment.fewest(
            lambda m: experiment.power_of_ratio(2.0, 15 * (m - 1), 15 * m - 6, level), 0.9
        )

    def poses(level):
        return experiment.fewest(
            lambda n: experiment.power_of_ratio(growth**2, n - 1, 19, level), 0.9
        )

    assert (clampings(0.05), poses(0.05)) == (6, 8)
    assert (clampings(0.001), poses(0.001)) == (value("09.5", "clampings"), value("09.5", "near"))


def test_a_knocked_camera():
    """CCD2 really turned, where the chapter's solution takes the response to first order."""
    truths = datasets.load_table1().set_poses
    rig, handle = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
    trial = error_sources.make_trial(rig, handle, truths)
    axes = rig.cameras[1].T_world_cam.rotation.as_matrix()
    shares = {}
    for name, axis in zip("xyz", axes.T, strict=True):
        shift = np.concatenate([np.zeros(11), np.deg2rad(0.05) * axis])
        errors = error_sources.response(trial, rig=error_sources.shifted_rig(rig, shift))
        after = deviations.registered(errors, truths, range(20))
        shares[name] = pattern.smooth_share(truths.translation, errors[:, :3])
        if name == "y":
            assert np.linalg.norm(errors[:, :3], axis=1).mean() == near("09.6", "before_mm")
            assert np.linalg.norm(after[:, :3], axis=1).mean() == near("09.6", "after_mm")
            assert shares[name] == near("09.6", "smooth_share")
    assert min(shares, key=shares.get) == value("09.6", "missed")


# Chapter 10


def test_what_is_left_without_a_view_is_the_package_s():
    rng = np.random.default_rng(3)
    rig, handle = datasets.load_rig("raised_40deg"), datasets.load_handle("paper")
    T = datasets.load_table1().set_poses[9]
    seen = np.stack([facing_pixels(handle, camera, T, 62.0) for camera in rig.cameras])
    views = Views(*np.nonzero(np.isfinite(seen[..., 0])))
    predicted, J = centroids.predict_centroids(rig, handle, T, views)
    roots = rng.normal(0, 0.02, (len(J), 2, 2)) + 0.1 * np.eye(2)
    C = roots @ roots.mT
    found = predicted + rng.normal(0, 0.05, predicted.shape)
    ours = variance_without(J, C)
    for k in (0, len(J) - 1):
        rest = np.arange(len(J)) != k
        fewer = Views(views.camera[rest], views.marker[rest])
        _, package = reprojection.fit_pixels(
            found[rest], C[rest], rig, handle, fewer, T, steps=1, huber=np.inf
        )
        assert ours[k] == pytest.approx(np.trace(package[:3, :3]), rel=1e-3)

    # four times all covariances, and then those of CCD3 alone
    def fitted(factor):
        return reprojection.fit_pixels(
            found, factor * C, rig, handle, views, T, steps=10, huber=np.inf
        )

    once, fourfold = fitted(1.0), fitted(4.0)
    assert value("10.4", "pose") == "stays"
    np.testing.assert_allclose(once[0].as_matrix(), fourfold[0].as_matrix(), atol=1e-7)
    np.testing.assert_allclose(fourfold[1], value("10.4", "covariance") * once[1], rtol=1e-4)
    nees = [metrics.nees(*fit, T)[0] for fit in (once, fourfold)]
    assert nees[1] / nees[0] == near("10.4", "nees")
    assert value("10.4", "pose_ccd3") == "moves"
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
    assert (value("10.2", "known"), value("10.2", "unknown")) == (5.0, 3.2)
    assert value("10.2", "lost_even") == 0


def test_half_a_marker():
    """A centroid by the integral, at 40 degrees, with markers of 3 and of 1.5 mm."""
    rig, T = datasets.load_rig("paper_pair"), datasets.load_table1().set_poses[9]
    handle = datasets.load_handle("paper")
    bias = []
    for factor in (1.0, 0.5):
        one = replace(handle, marker_diameter_mm=factor * handle.marker_diameter_mm)
        seen = np.stack([facing_pixels(one, camera, T, 62.0) for camera in rig.cameras])
        views = Views(*np.nonzero(np.isfinite(seen[..., 0])))
        uv, _ = centroids.predict_centroids(rig, one, T, views)
        bias.append(np.linalg.norm(uv - seen[views], axis=1).max())
    assert bias[1] / bias[0] == pytest.approx(value("10.1", "bias"), rel=0.03)  # the third order
    # what the blurred edge of a disc tells of a shift along u, by the sum over its pixels
    u, v = np.mgrid[-15:15:0.23, -15:15:0.23]
    r = np.hypot(u, v)
    information = [((norm.pdf(r, a, 0.76) * u / r) ** 2).sum() for a in (7.75, 7.75 / 2)]
    scatter = (information[1] / information[0]) ** -0.5
    assert scatter == pytest.approx(value("10.1", "scatter"), rel=0.02)


def test_a_third_camera_anywhere():
    truths, handle = datasets.load_table1().set_poses, datasets.load_handle("paper")

    def seen(elevation, T):
        rig = datasets.paper_rig(elevation)
        slant = Parameters().max_slant_deg
        return rig, np.stack([facing_pixels(handle, one, T, slant) for one in rig.cameras])

    def worst_um(elevation, hidden=()):
        sigmas = []
        for T in truths:
            rig, uv = seen(elevation, T)
            uv[list(hidden)] = np.nan
            views = Views(*np.nonzero(np.isfinite(uv[..., 0])))
            _, J = centroids.predict_centroids(rig, handle, T, views)
            rows = J.reshape(-1, 6) / 0.012
            covariance = np.linalg.inv(rows.T @ rows)
            sigmas.append(1e3 * np.sqrt(np.trace(covariance[:3, :3])))
        return max(sigmas)

    assert worst_um(None) == near("10.5", "pair_um")
    assert worst_um(40.0) == near("10.5", "third_um")
    assert worst_um(40.0, (0,)) == near("10.5", "hidden_um")
    for elevation, count in ((90.0, value("10.5", "shared_90")), (40.0, 16)):
        shared = [np.isfinite(seen(elevation, T)[1][1:, :, 0]).all(axis=0).sum() for T in truths]
        assert sum(number >= 3 for number in shared) == count


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
    says(
        "11.2", f"the scale is at most {scale:.2f}, and the travel to the right takes seven strokes"
    )
    assert strokes == 7
    assert strokes_needed([150, 120, 100], [300, 60, 200], 0.31, 2 * 0.31) == (2, 1)
    says("11.2", f"scale 2, and {2 * 0.31:.2f} mm at the tool")
    old = Rotation.from_euler("x", -90, degrees=True)  # down becomes -z, away becomes +y
    np.testing.assert_allclose(2 * old.apply([30, 10, 6]), [60, 12, -20], atol=1e-9)
    round_the_table = Rotation.from_euler("z", 180, degrees=True) * old
    way = 2 * round_the_table.apply([30, 10, 6])
    np.testing.assert_allclose(way, [value("11.1", name) for name in "xyz"], atol=1e-9)


def test_a_peg_in_a_hole():
    """By the formulas, and the stages added up by hand."""
    frame, take = 1 / 60, 1 / (1 + 60 / (2 * np.pi * 4))
    left = 3 * np.sqrt(take / (2 - take))
    wander = left * np.hypot(0.05, 20 * np.deg2rad(0.3))
    assert wander == near("11.4", "wander_mm")
    assert wander < value("11.4", "clearance_mm") == (20.5 - 20) / 2
    f = OneEuroParameters()
    filtered = 1 / (2 * np.pi * (4 + f.slope * 20))
    others = 0.005 + frame + 0.015 + frame / 2 + 0.001 + 0.001
    # the reference's time constant is 1/60 s; it climbs a little after each pose
    assert 1e3 * (others + filtered + 1 / 60) == near("11.4", "delay_ms")
    slower = 1 / (2 * np.pi * (2 + f.slope * 20))
    assert others + slower + 1 / 60 > 0.1
    assert 0.005 + 1 / 30 + 0.015 + 1 / 60 + 0.001 + 0.001 + 1 / 20 > 0.1  # without a filter


def test_a_loop_of_rotations():
    """By quaternions: the scalar part of the commutator of two turns by epsilon."""

    def turned(epsilon):
        s = np.sin(epsilon / 2)
        return 2 * np.rad2deg(np.arccos(1 - 2 * s**4))

    assert turned(np.deg2rad(20)) == near("11.5", "hand_deg")
    assert turned(np.deg2rad(10)) == near("11.5", "tool_deg")
    order = np.log2(turned(np.deg2rad(2)) / turned(np.deg2rad(1)))
    assert order == near("11.5", "order")


# Chapter 12


def test_a_force_that_comes_back():
    """Hand numbers at rest, and the package where no force comes back."""
    at_rest = position_force(np.full(20_000, 2.0), 0, 0.0, 1000.0)[-1]
    np.testing.assert_allclose(at_rest, [2 / 200 + 2 / 1000, 2 / 1000], rtol=1e-4)
    free = position_force(np.ones(12_000), 0, 10.0, 1000.0)[:, 0]
    assert (free[-1] - free[-2]) / 2e-4 == pytest.approx(1 / 2.0, rel=1e-4)  # push over damping
    thrown = position_force(np.ones(4000), 250, 0.05, 1000.0)[:, 0]
    assert thrown.min() == pytest.approx(-0.316, abs=0.002)
    for late, rests in ((30, True), (40, False)):  # 6 and 8 ms
        held = position_force(np.ones(25_000), late, 0.05, 1000.0)[-5000:, 0]
        assert (np.ptp(held) < 1e-4) == rests  # m
    # led by a hand that does what the coupling's spring would do to the master
    pair = bilateral.Teleoperator(0.2, 0.2, 2.0, 200.0, 2.0)
    push = np.linspace(0, 1, 1000)
    led = bilateral.simulate(pair, "position-position", push, 10.0, 1000.0, 2e-4)
    ours = position_force(push - led.master_n, 0, 10.0, 1000.0)
    np.testing.assert_allclose(ours, np.column_stack([led.master_m, led.slave_m]), atol=1e-12)


def test_frequencies_and_limits():
    pair = bilateral.Teleoperator(0.2, 0.2, 2.0, 200.0, 2.0)
    omega = value("12.1", "omega")
    s = 1j * omega
    C = 2.0 + 200.0 / s
    assert abs(C / (0.2 * s + 2.0 + C)) == pytest.approx(1)
    assert bilateral.critical_delay(replace(pair, stiffness=30.1)) < np.inf
    assert bilateral.critical_delay(replace(pair, stiffness=29.9)) == np.inf
    assert value("12.1", "stiffness") == 30
    heavy = replace(pair, master_kg=2.0, slave_kg=2.0)
    assert 1e3 * bilateral.critical_delay(heavy) == near("12.4", "critical_ms")

    camera = wall.Loop(0.2, 2.0, 1 / 30, 0.05)
    assert 2 / camera.lag_s == near("12.4", "infinite")
    assert wall.nyquist_limit(replace(camera, mass_kg=2000.0)).stiffness == near("12.4", "infinite")
    assert wall.simulated_limit(replace(camera, mass_kg=2.0)) == near("12.4", "at_2_kg")
    assert 800 * camera.lag_s == near("12.2", "damping")
    soon = wall.Loop(2000.0, 2.0, 1e-4, 1e-3 * value("12.2", "age_ms") - 0.5e-4)
    assert wall.nyquist_limit(soon).stiffness == pytest.approx(800, rel=1e-3)


def test_a_little_delay_that_helps():
    massless = wall.Loop(1e-5, 20.0, 1 / 30)

    def largest(share):
        late = replace(massless, delay_s=share / 30)
        return wall.nyquist_limit(late).stiffness / (20 * 30)

    assert largest(0.0) == near("12.5", "prompt")
    best = value("12.5", "best_share")
    assert largest(best) == near("12.5", "best")
    assert max(largest(best - 0.02), largest(best + 0.02)) < largest(best)
    light = wall.Loop(0.05, 20.0, 1 / 30)
    late = replace(light, delay_s=0.25 / 30)
    assert wall.simulated_limit(late) / wall.simulated_limit(light) == near("12.5", "light_gain")
