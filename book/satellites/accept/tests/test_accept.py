"""The tests of the data sheet: what they draw, and what they make of poses that are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation
from sheetrows import COVARIANCE, RIGS, pointer_rows, rows_of, setup, static_rows

from satellites.accept import (
    arm,
    availability,
    combined,
    field_map,
    latency,
    moving,
    pointer,
    rest,
    static,
    tracks,
)
from satellites.accept.numbers import LARGEST
from satellites.accept.setup import Setup, field_of, sobol_poses
from satellites.accept.tracks import FPS, as_track, track_of_table
from trinolab.bench.scenario import seen_markers
from trinolab.bench.scene import scaled
from trinolab.camera import Rig, RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.files.poses import pose_table
from trinolab.handle import slant_angles
from trinolab.pose import LOST, Pose
from trinolab.rigid import shifted
from workbench import intervals


def value(answer, what, statistic):
    """The one number of this name."""
    (number,) = [n for n in answer.numbers if (n.what, n.statistic) == (what, statistic)]
    return number


# --- the field of view, and the poses in it


@pytest.mark.parametrize("rig", RIGS)
def test_field_is_what_counting_gives(rig):
    """Random points of the field's box, judged by the images of a ball's outermost points; and every
    marker of every pose is in every image.
    """
    one = setup(rig)
    field = one.field
    for T in sobol_poses(field, 64, 0).poses:
        for camera in one.rig.cameras:
            assert camera.sees(T.apply(one.handle.marker_centres)).all()
    rng = np.random.default_rng(0)
    points = rng.uniform(*field.box, (300, 3))
    held = field.holds(points)
    for point, inside in zip(points[:100], held, strict=False):
        around = point + field.reach_mm * np.vstack([np.eye(3), -np.eye(3)])
        if inside:
            # a ball is at most 1 / cos of the half field of view wider than the margin
            closer = point + 0.9 * (around - point)
            assert all(camera.sees(closer).all() for camera in field.rig.cameras)
    assert 0.02 < held.mean() < 0.9


def test_lens_distortion_is_in_the_field():
    """With a barrel lens the corners of the image see further out."""
    rig = load_rig("raised_40deg")
    bent = Rig(tuple(replace(c, distortions=[-0.3, 0, 0, 0, 0]) for c in rig.cameras))
    straight, curved = (field_of(one, load_handle("coded")) for one in (rig, bent))
    assert len(curved.points) > len(straight.points)


@pytest.mark.parametrize(
    ("rig", "turn", "longer", "said"),
    [
        ("paper_pair", np.pi, 1, "no field of view in common"),
        ("raised_40deg", 0.0, 8, "in common is too small for the handle"),
    ],
)
def test_cameras_that_do_not_hold_the_handle_in_common_are_refused(rig, turn, longer, said):
    first, *others = load_rig(rig).cameras
    back = RigidTransform.from_rotation(Rotation.from_rotvec([0, turn, 0]))
    turned = replace(first, T_cam_world=first.T_cam_world * back)
    coded = load_handle("coded")
    rows = tuple(tuple(longer * row for row in column) for column in coded.rows_mm)
    top, length = longer * coded.top_mm, longer * coded.length_mm
    long = replace(coded, rows_mm=rows, top_mm=top, length_mm=length)
    with pytest.raises(ValueError, match=said):
        field_of(Rig((turned, *others)), long)


def test_sobol_poses_are_even():
    """Of 512 poses: half of the turns and azimuths lie on either side, the tilts fill their band,
    and the first ones are those of a smaller sheet.
    """
    field = setup().field
    drawn = sobol_poses(field, 512, 0)
    tilt, azimuth, turn = drawn.freedoms[:, 3:].T
    axes = drawn.poses.rotation.as_matrix()[:, :, 1]
    assert np.rad2deg(np.arccos(axes @ field.rig.cameras[0].axis)) == pytest.approx(tilt)
    assert tilt.min() > 59.999
    assert tilt.max() < 120.001
    for angle in (azimuth, turn):
        # rejection leaves a Sobol sequence nearly as even; random ones scatter by 11
        assert abs((angle < 180).sum() - 256) < 22
    fewer = sobol_poses(field, 32, 0)
    assert np.allclose(fewer.freedoms, drawn.freedoms[:32])


# --- A1: rest


def test_rest_in_numbers():
    """Gaussian noise of 0.01 mm and 0.1 deg about each axis."""
    rng = np.random.default_rng(0)
    places = rest.places(setup())
    assert len(places) == rest.PLACES
    assert setup().field.holds(places.translation).all()
    size = np.repeat([0.01, np.deg2rad(0.1)], 3)
    noise = rng.normal(size=(9, 200, 6)) * size
    found = [rows_of([T] * 200, off) for T, off in zip(places, noise, strict=True)]
    answer = rest.judge(setup(), found)
    # 5400 numbers: their root mean square scatters by 1 %
    assert value(answer, "jitter, position", "rms").value == pytest.approx(
        0.01 * np.sqrt(3), rel=0.04
    )
    assert value(answer, "jitter, rotation", "rms").value == pytest.approx(
        0.1 * np.sqrt(3), rel=0.04
    )
    one, long = [n for n in answer.numbers if n.what == "Allan deviation, position"]
    assert one.value == pytest.approx(0.01 * np.sqrt(3), rel=0.05)
    assert long.low < one.value / np.sqrt(32) < long.high
    drift = value(answer, "drift, position", "steepest of all axes")
    # of 27 lines the steepest is less than four standard deviations from none
    spread = 60 * 0.01 / (np.std(np.arange(200) / FPS) * np.sqrt(200))
    assert abs(drift.value) < 4 * spread
    all_at_rest = [as_track(rows) for rows in found]
    assert rest.jitter_of(all_at_rest) == pytest.approx((0.01, 0.1), rel=0.04)
    # only what was timed says how long a measurement takes; poses of a file bring no times along
    (number,) = rest.time([all_at_rest[0], all_at_rest[1]._replace(cpu_s=np.full(200, np.nan))])
    assert (number.what, number.value, number.n) == ("time of a measurement", 10.0, 198)
    # a place that moves by 0.1 mm a minute along x
    off = np.random.default_rng(1).normal(size=(200, 6)) * 1e-4
    off[:, 0] += 0.1 / 60 * np.arange(200) / FPS
    moves = rest.judge_tracks([as_track(rows_of([places[0]] * 200, off))], 0, "x")
    drift = value(moves, "drift, position", "steepest of all axes")
    assert drift.low < 0.1 < drift.high
    assert drift.value == pytest.approx(0.1, rel=0.1)


def test_a_rest_with_gaps_has_its_jitter_and_no_allan_deviation():
    T = rest.places(setup())[0]
    off = np.random.default_rng(0).normal(size=(60, 6)) * 1e-3
    answer = rest.judge_tracks([as_track(rows_of([T] * 60, off, lost=[30]))], None, "x")
    jitter = value(answer, "jitter, position", "rms")
    assert jitter.value == pytest.approx(1e-3 * np.sqrt(3), rel=0.3)
    assert not [one for one in answer.numbers if "Allan" in one.what]
    assert not answer.pictures
    assert "No Allan deviation: instants are missing at every place." in answer.notes
    hardly = rest.judge(setup(), [rows_of([T] * 12, lost=range(2, 12))])
    assert (hardly.numbers, hardly.pictures) == ([], [])
    assert hardly.notes == ["No place was measured in eight instants."]


def test_a_recording_is_at_rest_or_not():
    T = rest.places(setup())[0]
    for way, lost, is_at_rest in (
        (np.zeros(6), (), True),
        ([0, 3, 0, 0, 0, 0], (), False),
        ([0, 0, 0, 0, np.deg2rad(5), 0], (), False),
        (np.zeros(6), range(50), False),
    ):
        off = np.outer(np.linspace(0, 1, 50), way)
        assert rest.at_rest(as_track(rows_of([T] * 50, off, lost))) == is_at_rest


# --- A2: static accuracy


def test_static_errors_before_and_after_registration():
    """A rig that is shifted by 0.3 mm and turned by 0.1 deg: nothing is left of that after a rigid
    registration.
    """
    one = setup()
    poses = sobol_poses(one.field, one.poses, one.seed).poses
    turn = Rotation.from_rotvec([0, 0, np.deg2rad(0.1)])
    moved = RigidTransform.from_components([0.3, 0, 0], turn) * poses
    off = np.column_stack(
        [
            moved.translation - poses.translation,
            (moved.rotation * poses.rotation.inv()).as_rotvec(),
        ]
    )
    answer = static.judge(one, static_rows(one, off))
    assert value(answer, "poses measured", "share").value == 100
    assert value(answer, "position error", "mean").value == pytest.approx(
        np.linalg.norm(off[:, :3], axis=1).mean()
    )
    assert value(answer, "angle error", "largest").value == pytest.approx(0.1)
    assert value(answer, "position error, registered", "largest").value < 1e-9
    assert value(answer, "angle error, registered", "largest").value < 1e-6
    far = "called measured, off by more than 2 mm or 5 deg"
    assert value(answer, far, "count").value == 0


def test_static_numbers_of_known_errors():
    """Half of the poses off by 0.01 mm, half by 0.03 mm along z; four are lost, one is far off."""
    one = setup()
    off = np.zeros((64, 6))
    off[:, 2] = np.where(np.arange(64) % 2, 0.01, 0.03)
    off[5, 2] = 2.5
    answer = static.judge(one, static_rows(one, off, lost=(0, 2, 4, 6)))
    known = np.delete(off[:, 2], [0, 2, 4, 6])
    assert value(answer, "poses measured", "share").value == pytest.approx(100 * 60 / 64)
    assert value(answer, "position error", "median").value == pytest.approx(np.median(known))
    assert value(answer, "position error", "rms").value == pytest.approx(np.sqrt((known**2).mean()))
    assert value(answer, "position error", "largest").value == pytest.approx(2.5)
    far = value(answer, "called measured, off by more than 2 mm or 5 deg", "count")
    assert (far.value, far.n) == (1, 60)
    # the reported standard deviation is 0.01 sqrt 3 mm
    assert value(answer, "true / reported position error", "rms").value == pytest.approx(
        np.sqrt((known**2).mean()) / (0.01 * np.sqrt(3))
    )


def test_what_is_hardly_measured_has_its_share_and_no_errors():
    one = setup(poses=8)
    answer = static.judge(one, static_rows(one, None, lost=range(8)))
    (number,) = answer.numbers
    assert (number.what, number.value, number.n) == ("poses measured", 0.0, 8)
    bar = moving.judge(one, moving_rows(one, lost=lambda k: range(1000)))
    assert {(number.what[:19], number.value) for number in bar.numbers} == {
        ("both ends measured ", 0.0)
    }
    assert answer.pictures == bar.pictures == []
    drawn = pointer.touches(one)
    touched = pointer.judge(one, [rows_of(drawn.poses, lost=range(2, drawn.pivoted))])
    assert touched.notes[-1] == "Too few poses were measured for the tip."
    assert not any("tip" in number.what for number in touched.numbers)
    rows = [rows_of(poses, times=times) for times, poses, _ in sines(one)]
    times, poses, _ = latency.sine(one, 1)
    rows[1] = rows_of(poses, lost=range(7, len(times)), times=times)
    delays = {n.what for n in latency.judge(one, rows).numbers if n.statistic == "delay"}
    assert any("sine of 0.5 Hz" in what for what in delays)
    assert not any("sine of 1 Hz" in what for what in delays)


def test_what_goes_with_an_error_is_found():
    """An error that grows with z, another that depends on an angle which closes on itself, and
    noise.
    """
    rng = np.random.default_rng(2)
    freedoms = rng.uniform(size=(400, 6))
    values = rng.normal(size=(400, 3))
    values[:, 0] *= 1 + 4 * freedoms[:, 2]
    values[:, 1] *= 2 + np.cos(2 * np.pi * freedoms[:, 4])
    part, chance = static.explained(freedoms, values)
    sure = chance < 0.05 / chance.size
    assert sure[2, 0]
    assert sure[4, 1]
    assert sure.sum() == 2
    # noise: H has as many degrees of freedom as ranges less one
    assert part[:, 2].mean() == pytest.approx(5 / 399, rel=0.6)


# --- A3: motion


@pytest.mark.parametrize("rig", RIGS)
def test_both_ends_stay_in_the_field(rig):
    one = setup(rig)
    for raster in range(2 * len(moving.SPEEDS_MM_S)):
        for end in moving.ends_of(one, raster):
            assert one.field.holds(end.translation).all()


@pytest.mark.parametrize("raster", range(8))
def test_velocity_is_that_of_the_way(raster):
    """Against differences of what the way is a moment later; the largest speed is the nominal one,
    and a tenth more for the way across.
    """
    one = setup(poses=512)
    path = moving.path_of(one, raster)
    nominal = moving.SPEEDS_MM_S[raster // 2]
    speed = np.linalg.norm(path.velocities, axis=1)
    assert speed.max() < 1.1 * nominal
    assert speed.max() > 0.8 * nominal
    steps = np.diff(path.positions, axis=0) * FPS
    between = (path.velocities[1:] + path.velocities[:-1]) / 2
    if nominal <= 200:  # a chord against a mean: the sine bends little within an interval
        assert np.linalg.norm(steps - between, axis=1).max() < 0.1 * nominal


def moving_rows(one, off=None, lost=None):
    rows = []
    for k in range(moving.parts(one)):
        raster, end = divmod(k, moving.ENDS)
        poses = moving.ends_of(one, raster)[end]
        shift = np.zeros((len(poses), 6)) if off is None else np.tile(off[end], (len(poses), 1))
        rows.append(rows_of(poses, shift, () if lost is None else lost(k)))
    return rows


def test_bar_of_known_ends():
    """The second end is off by 0.2 mm along the bar: the bar is as much too long."""
    one = setup()
    bar = moving.bar_of(one.field)
    assert bar.length_mm == 300
    assert np.linalg.norm(bar.direction) == pytest.approx(1)
    assert abs(bar.ways @ bar.direction).max() < 1e-9
    off = np.zeros((2, 6))
    off[1, :3] = 0.2 * bar.direction
    answer = moving.judge(one, moving_rows(one, off))
    for speed in ("0.1", "0.2", "0.5", "1"):
        length = value(answer, f"bar's length at {speed} m/s", "rms")
        assert length.value == pytest.approx(0.2, rel=1e-6)
        assert value(answer, f"relative position at {speed} m/s", "rms").value == pytest.approx(0.2)
        assert value(answer, f"relative angle at {speed} m/s", "largest").value < 1e-6
        assert value(answer, f"both ends measured at {speed} m/s", "share").value == 100
    # an angle of the first end counts with the bar as its lever
    off = np.zeros((2, 6))
    off[0, 3:] = np.deg2rad(0.1) * bar.ways[0]
    answer = moving.judge(one, moving_rows(one, off))
    lever = 2 * bar.length_mm * np.sin(np.deg2rad(0.05))
    position = value(answer, "relative position at 0.1 m/s", "rms").value
    assert position == pytest.approx(lever, rel=1e-6)
    assert value(answer, "relative angle at 0.1 m/s", "rms").value == pytest.approx(0.1, rel=1e-6)
    assert value(answer, "bar's length at 0.1 m/s", "rms").value < 1e-9


# --- A4: the pointer


def test_pivot_of_a_known_tip():
    """Exact poses give the tip; noisy ones what a search for the least squares finds."""
    rng = np.random.default_rng(3)
    tip, point = np.array([3.0, 100.0, -2.0]), np.array([10.0, 20.0, 600.0])
    turns = Rotation.from_rotvec(rng.normal(size=(20, 3)) * 0.4)
    poses = RigidTransform.from_components(point - turns.apply(tip), turns)
    exact = pointer.calibrate_pivot(poses)
    assert exact.tip == pytest.approx(tip, abs=1e-9)
    assert exact.point == pytest.approx(point, abs=1e-9)
    noisy = RigidTransform.from_components(poses.translation + rng.normal(0, 0.05, (20, 3)), turns)
    found = pointer.calibrate_pivot(noisy)
    other = least_squares(
        lambda x: (turns.apply(x[:3]) + noisy.translation - x[3:]).ravel(), np.zeros(6), xtol=1e-15
    )
    assert np.concatenate([found.tip, found.point]) == pytest.approx(other.x, abs=1e-5)
    assert found.off.ravel() == pytest.approx(other.fun, abs=1e-5)
    about_one_axis = Rotation.from_rotvec(np.linspace(0, 1, 20)[:, None] * [0, 1.0, 0])
    assert pointer.calibrate_pivot(RigidTransform.from_rotation(about_one_axis)) is None


def test_pointer_of_noisy_poses():
    """0.02 mm about each axis, no turn: the tip scatters by it, a distance by sqrt 2 of one
    axis. Exact ones err nowhere.
    """
    exact = pointer.judge(setup(), pointer_rows(setup()))
    for what, statistic in (
        ("tip held at one point, scatter", "largest"),
        ("tip from pivoting, error", "distance"),
        ("distance between two points, error", "largest"),
    ):
        assert value(exact, what, statistic).value < 1e-9
    one = setup(poses=512)
    n = len(pointer.touches(one).points)
    off = np.zeros((n, 6))
    off[:, :3] = np.random.default_rng(4).normal(0, 0.02, (n, 3))
    answer = pointer.judge(one, pointer_rows(one, off))
    scatter = value(answer, "tip held at one point, scatter", "rms")
    assert scatter.low < 0.02 * np.sqrt(3) < 1.1 * scatter.high
    distance = value(answer, "distance between two points, error", "rms")
    assert distance.low < 0.02 * np.sqrt(2) < 1.1 * distance.high


def test_eight_poses_about_a_point_are_known_as_a_pivot():
    drawn = pointer.touches(setup())
    eight, seven, elsewhere = (
        pointer.judge_recording(as_track(rows), "recording a")
        for rows in (
            rows_of(drawn.poses[:8]),
            rows_of(drawn.poses[:8], lost=(3,)),
            rows_of(drawn.poses[drawn.pivoted :]),
        )
    )
    assert value(eight, "tip held at one point, scatter", "largest").value < 1e-9
    assert seven.numbers == elsewhere.numbers == []


# --- A5: latency


@pytest.mark.parametrize("rate", latency.RATES_HZ)
def test_delay_of_a_known_sine(rate):
    rng = np.random.default_rng(5)
    t = (np.arange(60) + 0.3) / FPS
    late = 0.0123
    values = 7 + 30 * np.sin(2 * np.pi * rate * (t - late))
    delay, interval = latency.delay_of(t, values, rate)
    assert delay == pytest.approx(late, abs=1e-9)
    delay, (low, high, _) = latency.delay_of(t, values + rng.normal(0, 0.05, 60), rate)
    assert low < late < high
    # the phase of n values scatters by sqrt(2 / n) of noise over amplitude
    expected = np.sqrt(2 / 60) * 0.05 / 30 / (2 * np.pi * rate)
    assert high - low == pytest.approx(2 * 2.0 * expected, rel=0.5)
    assert interval.high - interval.low < 1e-9


def test_a_held_value_is_half_an_interval_old():
    rate = 1.0
    t = np.arange(120) / FPS
    values = 30 * np.sin(2 * np.pi * rate * t)
    age = 0.02
    delay, _ = latency.delay_of(*latency.held(t + age, values), rate)
    assert delay == pytest.approx(age + 0.5 / FPS, abs=5e-4)


def sines(one):
    return [latency.sine(one, k) for k in range(latency.parts(one))]


def test_latency_of_exact_poses_and_how_bad_it_gets():
    """Of three sines the first two instants, a search, do not count."""
    one = setup()
    rows = []
    counted = []
    for k, (times, poses, velocities) in enumerate(sines(one)):
        assert np.linalg.norm(velocities, axis=1).max() <= 30.1 * 2 * np.pi * latency.RATES_HZ[k]
        of_sine = rows_of(poses, times=times)
        cpu_ms = np.arange(len(times)) + 100.0 * k
        rows.append(
            [[*row[:4], ms / 1e3, *row[5:]] for row, ms in zip(of_sine, cpu_ms, strict=True)]
        )
        counted.append(cpu_ms[2:])
    ages = np.sort(np.concatenate(counted)) + 5.0
    answer = latency.judge(one, rows)
    for rate in ("0.5", "1", "2"):
        own = value(answer, f"pose against its own time, sine of {rate} Hz", "delay")
        assert own.value == pytest.approx(0, abs=1e-6)
    worst = value(answer, "age of a pose when it is there", LARGEST)
    assert worst.value == pytest.approx(ages[-1])
    assert "95 % sure" in worst.note
    late = value(answer, "age of a pose when it is there", "99 %")
    assert ages[-3] <= late.value <= ages[-1]
    assert late.n == worst.n == len(ages)
    taken = value(answer, "time of a measurement in motion", LARGEST)
    assert taken.value == pytest.approx(ages[-1] - 5.0)


# --- A6: availability


def test_availability_of_a_known_track():
    """Five instants are lost, of which the truth says that they could be measured."""
    one = setup(poses=52)
    job = availability.job_of(one)
    n = len(job.shots)
    assert n == 30
    poses = [shot.T_world_handle for shot in job.shots]
    answer = availability.judge(one, [rows_of(poses, lost=range(10, 15))])
    assert value(answer, "measured, of all instants", "share").value == pytest.approx(
        100 * (n - 5) / n
    )
    assert value(answer, "losses", "count").value == 1
    again = value(answer, "time until it is found again", "largest")
    possible = sum(max(seen_markers(job, k)) >= 4 for k in range(10, 15))
    assert again.value == pytest.approx(possible / FPS)


def test_standard_scene_is_in_view():
    """As it stands for the shipped rigs; a rig whose world lies elsewhere is brought before it."""
    one = setup()
    assert availability.before(one) is one.rig
    T = RigidTransform.from_components([500, -300, 80], Rotation.from_rotvec([0.3, 1.0, -0.5]))
    cameras = [replace(c, T_cam_world=c.T_cam_world * T) for c in one.rig.cameras]
    rig = availability.before(Setup(Rig(tuple(cameras)), one.handle, 8))
    for camera in rig.cameras:
        assert camera.sees([[0.0, 0.0, 570.0]]).all()
    between = [c.T_cam_world * rig.cameras[0].T_world_cam for c in rig.cameras]
    true = [c.T_cam_world * one.rig.cameras[0].T_world_cam for c in one.rig.cameras]
    for a, b in zip(between, true, strict=True):
        assert np.allclose(a.as_matrix(), b.as_matrix(), atol=1e-9)


# --- A7: the arm


def test_accuracy_and_repeatability_by_hand():
    """Four positions at the corners of a square of 2 mm about (1, 0, 0); and four at 1 and 3 mm."""
    positions = np.array([[2, 1, 0], [2, -1, 0], [0, 1, 0], [0, -1, 0.0]])
    found = arm.attained(positions, np.zeros(3))
    assert found.accuracy == pytest.approx(1.0)
    assert found.repeatability == pytest.approx(np.sqrt(2))  # all are as far from their mean
    positions = np.array([[1.0, 0, 0], [-1, 0, 0], [3, 0, 0], [-3, 0, 0]])
    deviation = np.std([1, 1, 3, 3], ddof=1)
    found = arm.attained(positions, np.zeros(3))
    assert found.repeatability == pytest.approx(2 + 3 * deviation)


@pytest.mark.parametrize("shape", arm.SHAPES)
@pytest.mark.parametrize("above_mm", [0.0, 0.3])
def test_a_path_is_off_by_its_shift_and_not_by_its_lag(shape, above_mm):
    """A tool 0.1 s late, shifted across the path's plane: off as much at each station and in each
    round.
    """
    points, off = arm.off_path(shape, trial_of(shape, above_mm))
    assert len(points) == len(arm.stations(shape))
    assert off.shape == (len(points), arm.ROUNDS, 3)
    assert np.abs(off - off.mean(axis=1, keepdims=True)).max() < 0.02
    assert np.linalg.norm(off, axis=2).max() == pytest.approx(above_mm, abs=0.01)


def trial_of(shape, above_mm):
    """A tool so far above the commanded path, 0.1 s late."""
    times = np.arange(0, arm.LEAD_S + 12 * arm.length_of(shape) / arm.SPEED_MM_S, 0.01)
    times = times + arm.STILL_S
    hand = arm.along(shape, times).translation
    tool = arm.along(shape, times - 0.1).translation + [0, 0, above_mm]
    return {"t_s": times.tolist(), "hand": hand.tolist(), "tool": tool.tolist()}


def group(shift, turn_deg):
    """Cycles of the five poses, in which the tool is off the hand by a shift and a turn about z."""
    hand = np.tile(arm.CORNERS_MM, (arm.TOGETHER, 1)) + [0.0, 0.0, 570.0]
    level = Rotation.identity(len(hand))
    turned = Rotation.from_rotvec([0.0, 0.0, np.deg2rad(turn_deg)]) * level
    places = {"hand": (hand, level), "tool": (hand + shift, turned)}
    return {
        stage: {"positions": at.tolist(), "quaternions": turn.as_quat().tolist()}
        for stage, (at, turn) in places.items()
    }


def test_numbers_of_five_poses_by_hand(monkeypatch):
    """Half of the cycles are off by 0.1 mm and half by 0.3 mm along x: by 0.2 mm in the mean, and
    each by 0.1 mm from that.
    """
    monkeypatch.setattr(intervals, "RESAMPLES", 20)
    groups = [group([0.1, 0, 0], 0.4), group([0.3, 0, 0], 0.6)]
    found = arm.pose_numbers(setup(poses=8), groups)
    assert [(one.what, one.statistic, one.n) for one in found] == [
        ("five poses, accuracy", "worst pose", 50),
        ("five poses, repeatability", "worst pose", 50),
        ("five poses, angle error", "mean", 50),
    ]
    assert [one.value for one in found] == pytest.approx([0.2, 0.1, 0.5], rel=1e-9)
    assert all(one.low <= one.value for one in found)
    monkeypatch.setattr(intervals, "RESAMPLES", 3)  # of a path they take long
    path = arm.path_numbers(setup(), "circle", trial_of("circle", 0.3))
    (accuracy, repeatability), picture = path
    assert accuracy.value == pytest.approx(0.3, abs=1e-3)
    assert repeatability.value < 0.01
    assert accuracy.n == arm.STATIONS * arm.ROUNDS
    assert "drawn 10 times as large" in picture.alt


def test_hand_rests_at_its_five_poses():
    step = arm.MOVE_S + arm.DWELL_S
    for k in range(7):
        ends = arm.STILL_S + (k + 1) * step - np.array([0.01, arm.DWELL_S - 0.01])
        resting = arm.five_poses(ends)
        assert np.ptp(resting.translation, axis=0).max() < 1e-9
        expected = arm.CORNERS_MM[(k + 1) % 5] + [0, 0, 570]
        assert resting.translation[0] == pytest.approx(expected)
    times = np.linspace(0, 20, 4001)
    speeds = np.linalg.norm(np.diff(arm.five_poses(times).translation, axis=0), axis=1) / 0.005
    # minimum jerk: 15 / 8 of the mean speed
    longest = max(np.linalg.norm(np.roll(arm.CORNERS_MM, -1, axis=0) - arm.CORNERS_MM, axis=1))
    assert speeds.max() == pytest.approx(15 / 8 * longest / arm.MOVE_S, rel=1e-3)


# --- tracks


def test_errors_of_rows_and_of_tables_are_those_put_in():
    one = setup()
    drawn = sobol_poses(one.field, 5, 0)
    off = np.random.default_rng(6).normal(size=(5, 6)) * np.repeat([0.1, 0.01], 3)
    poses = [
        Pose("measured", shifted(T, by), COVARIANCE, 0.1, 6, 3)
        for T, by in zip(drawn.poses, off, strict=True)
    ]
    poses[1] = LOST
    of_rows = as_track(rows_of(drawn.poses, off, lost=(1,)))
    of_table = track_of_table(pose_table(poses, list(np.arange(5) / FPS)))
    for track in (of_rows, of_table):
        assert track.t_s == pytest.approx(np.arange(5) / FPS)
        found, there = tracks.errors(track, drawn.poses, one)
        assert there.tolist() == [True, False, True, True, True]
        assert found[there] == pytest.approx(off[there], abs=1e-9)
        assert np.isnan(found[1]).all()
    np.testing.assert_allclose(of_rows.sigmas, of_table.sigmas, atol=1e-12)


def test_errors_are_up_to_the_handle_s_symmetry():
    one = setup(handle="paper")
    drawn = sobol_poses(one.field, 3, 0)
    turned = [T * one.handle.symmetries[k] for k, T in enumerate(drawn.poses)]
    track = as_track(rows_of(turned))
    each, _ = tracks.errors(track, drawn.poses, one, one_track=False)
    assert np.abs(each).max() < 1e-9
    together, _ = tracks.errors(track, drawn.poses, one)
    assert np.rad2deg(np.abs(together[:, 3:]).max()) > 50


def quarter():
    """What frames are made for: the pair at a quarter of its size, and a handle before it."""
    small = replace(
        load_rig("paper_pair"),
        cameras=tuple(scaled(camera, 0.25) for camera in load_rig("paper_pair").cameras),
    )
    return SimpleNamespace(rig=small, handle=load_handle("coded"))


NEAR = RigidTransform.from_components(
    [0.0, 0.0, 560.0], Rotation.from_euler("ZYX", [-30, 10, 20], degrees=True)
)


def difference(one, other):
    """Root mean square of the difference of two instants, grey levels."""
    pairs = zip(one.images, other.images, strict=True)
    return np.mean([np.std(a.astype(float) - b) for a, b in pairs])


def test_a_handle_that_moves_is_blurred_along_its_way():
    """At 1 m/s it moves by 10 mm while the shutter is open; its middle stays. Frames at rest differ by
    their noise alone, of which each has its own.
    """
    one, other, third = tracks.resting(quarter(), NEAR, 3, 0)
    (again,) = tracks.resting(quarter(), NEAR, 1, 0)
    np.testing.assert_array_equal(again.images, one.images)
    assert [frame.t_s for frame in (one, other, third)] == pytest.approx(np.arange(3) / FPS)
    noise = difference(one, other)
    assert noise == pytest.approx(difference(one, third), rel=0.05)
    assert 1 < noise < 0.5 * np.std(one.images[0])  # the scene is gone
    two = RigidTransform.concatenate([NEAR, NEAR])
    velocities = np.array([[0.0, 0, 0], [1000.0, 0, 0]])
    times = np.array([0.1, 0.2])
    still, fast = tracks.moving(quarter(), times, two, velocities, 0)
    assert (still.t_s, fast.t_s) == (0.1, 0.2)
    assert difference(still, one) == pytest.approx(noise, rel=0.05)
    assert difference(fast, one) > 1.15 * noise


# --- a part of each test, rendered and measured


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("test", "poses_of", "worst_mm"),
    [
        (rest, lambda one: rest.places(one)[[0] * 500], 0.2),
        (static, lambda one: sobol_poses(one.field, 8, 0).poses, 0.1),
        (pointer, lambda one: pointer.touches(one).poses, 0.1),
        (moving, lambda one: moving.ends_of(one, 0)[0], 0.5),
    ],
    ids=["A1", "A2", "A4", "A3 at 0.1 m/s"],
)
def test_poses_are_measured(test, poses_of, worst_mm):
    one = setup(poses=8)
    rows = test.run(one, 0)
    off, found = tracks.errors(as_track(rows), poses_of(one)[: len(rows)], one, one_track=False)
    assert found.mean() > (0.9 if test is moving else 0.999)
    assert np.linalg.norm(off[found, :3], axis=1).max() < worst_mm
    assert np.rad2deg(np.linalg.norm(off[found, 3:], axis=1)).max() < 1.0


@pytest.mark.heavy
def test_a_sine_is_followed_without_delay():
    one = setup(poses=8)
    answer = latency.judge(one, [latency.run(one, k) for k in range(latency.parts(one))])
    delay = value(answer, "pose against its own time, sine of 1 Hz", "delay")
    assert abs(delay.value) < 0.5


@pytest.mark.heavy
def test_the_arm_comes_to_its_poses():
    pytest.importorskip("mink", reason="the arm needs the extra 'slave'")
    one = setup(poses=8)
    found = arm.run(one, 0, arm.Noise(0.003, 0.03, "a test has"))
    off = np.array(found["tool"]["positions"]) - np.array(found["hand"]["positions"])
    assert np.linalg.norm(off, axis=1).max() < 0.5


# --- A0: the combined uncertainty


def set_ups(one, sigmas, seed=0):
    """Rows of all set-ups with errors drawn by hand: of depth, across it (an axis, mm) and about each
    axis (deg), by what is wrong; what is common to a set-up is drawn once for it.
    """
    rng = np.random.default_rng(seed)
    count, together = combined.parts(one), combined.TOGETHER
    poses = sobol_poses(one.field, count * together, one.seed).poses
    sizes = {
        name: np.array([across, across, depth, *[np.deg2rad(turn)] * 3])
        for name, (depth, across, turn) in sigmas.items()
    }
    covariance = np.diag(sum(size**2 for size in sizes.values()))
    rows = []
    for k in range(count):
        noise, calibration, markers = (
            np.repeat(size * rng.normal(size=(drawn, 6)), together // drawn, axis=0)
            for size, drawn in zip(sizes.values(), (together, 1, 1), strict=True)
        )
        errors = {
            "noise": noise,
            "calibration": noise + calibration,
            "markers": noise + markers,
            "all": noise + calibration + markers,
        }
        part = poses[k * together : (k + 1) * together]
        rows.append(
            {name: rows_of(part, off, covariance=covariance) for name, off in errors.items()}
        )
    return rows


SIGMAS = {
    "noise": (0.003, 0.002, 0.04),
    "calibration": (0.2, 0.05, 0.03),
    "markers": (0.01, 0.01, 0.25),
}


def test_a_budget_has_what_was_drawn():
    one = setup(poses=512)
    rows = set_ups(one, SIGMAS)
    answer = combined.judge(one, rows)
    n = combined.parts(one)
    assert n == 24
    for index, kind in enumerate(("depth", "across", "rotation")):
        factor = np.sqrt(3) if kind == "rotation" else 1.0  # the angle is that of all three axes
        for name, line in (
            ("noise", "images' noise (type A)"),
            ("calibration", "calibration (type B)"),
            ("markers", "markers' places (type B)"),
        ):
            found = value(answer, f"{kind}: {line}", "rms")
            share = SIGMAS[name][index] / np.sqrt(sum(s[index] ** 2 for s in SIGMAS.values()))
            if share > 0.3:  # what is small beside the rest drowns in it
                assert found.value == pytest.approx(factor * SIGMAS[name][index], rel=0.4)
        whole = value(answer, f"{kind}: combined, u", "rms")
        expanded = value(answer, f"{kind}: expanded, U = 2 u", "rms")
        assert expanded.value == pytest.approx(2 * whole.value)
        assert whole.low < whole.value < whole.high
        freedom = float(expanded.note.split()[0])
        assert n - 2 < freedom < 4 * n  # nearly all of it is drawn once a set-up
    held = float(value(answer, "depth: expanded, U = 2 u", "rms").note.split("; ")[1].split()[0])
    assert held > 88
    assert value(answer, "true / reported position error", "rms").value == pytest.approx(1, abs=0.3)
    assert value(answer, "poses measured", "share").value == 100.0


def test_what_the_files_state_is_what_is_drawn():
    one = setup(poses=8)
    names = one.rig.names
    matrix = np.zeros((15 * len(names),) * 2)
    matrix[2, 2] = 0.7**2  # the first camera's principal point, along u
    stated = replace(one.rig, covariance=RigCovariance(names, matrix))
    wide = Setup(stated, replace(one.handle, placement_sigma_mm=0.1), 8, 0)
    drawn = [combined.believed(wide, np.random.default_rng(k)) for k in range(60)]
    off = np.array(
        [rig.cameras[0].matrix[0, 2] - one.rig.cameras[0].matrix[0, 2] for rig, _ in drawn]
    )
    assert off.std() == pytest.approx(0.7, rel=0.3)
    assert {rig.cameras[1].matrix[0, 2] for rig, _ in drawn} == {one.rig.cameras[1].matrix[0, 2]}
    beside = np.array([handle.marker_centres - one.handle.marker_centres for _, handle in drawn])
    assert beside.std() == pytest.approx(0.1, rel=0.1)
    assert {handle.placement_sigma_mm for _, handle in drawn} == {0.1}


@pytest.mark.heavy
def test_a_set_up_is_measured_in_four_ways():
    one = setup(poses=8)
    rows = combined.run(one, 0)
    assert set(rows) == {"all", "noise", "calibration", "markers"}
    poses = sobol_poses(one.field, combined.parts(one) * combined.TOGETHER, 0).poses
    off, found = {}, {}
    for name in rows:
        track = tracks.as_track(rows[name])
        errors, found[name] = tracks.errors(track, poses[: combined.TOGETHER], one, one_track=False)
        assert found[name].sum() >= 7
        off[name] = errors[:, :3]
    assert np.linalg.norm(off["noise"][found["noise"]], axis=1).max() < 0.05
    # a budget of parts that add up: all poses are corrected by the same stated errors
    in_all = np.all(list(found.values()), axis=0)
    apart = off["all"] - (off["calibration"] + off["markers"] - off["noise"])
    assert np.mean(apart[in_all] ** 2) < 0.1 * np.mean(off["all"][in_all] ** 2)


def test_the_map_is_known_worse_further_away_and_in_depth():
    known = field_map.over_field(load_rig("raised_40deg"), load_handle("coded"))
    inside = np.isfinite(known.depth_mm)
    assert 0.2 < inside.mean() < 1.0
    assert (np.isfinite(known.across_mm) == inside).all()
    assert (known.depth_mm[inside] > known.across_mm[inside]).mean() > 0.95
    of_rows = [np.nanmean(row) for row in known.depth_mm if np.isfinite(row).any()]
    assert of_rows[-1] > 1.5 * of_rows[0]


def test_the_covariance_of_a_pose_is_what_many_adjustments_scatter_by():
    """The marker's places and the rig are exact, so that the pixels' noise is all."""
    rig, handle = load_rig("raised_40deg"), load_handle("coded")
    T = RigidTransform.from_components(
        [10.0, 5.0, 560.0], Rotation.from_euler("ZYX", [5, 190, 8], True)
    )
    expected = field_map.pose_covariance(T, rig, handle)
    rng = np.random.default_rng(0)
    centres = T.apply(handle.marker_centres)
    normals = handle.marker_normals @ T.as_matrix()[:3, :3].T
    slants = [slant_angles(centres, normals, camera.centre) for camera in rig.cameras]
    seen = [slant < np.deg2rad(field_map.MAX_SLANT_DEG) for slant in slants]
    noise = [field_map.CENTRE_PX * rng.normal(size=(75, *centres.shape[:1], 2)) for _ in seen]

    def left(step, k):
        at = shifted(T, step).apply(handle.marker_centres)
        return np.concatenate(
            [
                (camera.project(at) - camera.project(centres) - one[k])[mask].ravel()
                for camera, mask, one in zip(rig.cameras, seen, noise, strict=True)
            ]
        )

    steps = np.array([least_squares(left, np.zeros(6), args=(k,)).x for k in range(75)])
    found = np.sqrt(np.diag(np.cov(steps.T)))
    np.testing.assert_allclose(found, np.sqrt(np.diag(expected)), rtol=0.25)  # of 75: 8 % each
