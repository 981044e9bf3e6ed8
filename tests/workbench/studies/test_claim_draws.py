"""The trials: what counts as close, as a wrong match, as saved; the trials themselves run small."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import image_track
from trinolab.calibration.target import Board
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import facing_pixels, slants
from trinolab.kalman import (
    KalmanParameters,
    State,
    constant_acceleration,
    initial_state,
    white_jerk,
)
from trinolab.measurement import Measurement
from trinolab.parameters import Parameters
from trinolab.pose import LOST, Pose
from trinolab.tracker import CameraState, TrackerState
from trinolab.triangulation import triangulate
from trinolab.window import Window
from workbench.studies import claim_draws, claim_trials, factors, master_slave
from workbench.studies.replication import EVERY, shared_poses
from workbench.studies.simulated_calibration import bent

PAPER = load_handle("paper")
T = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_euler("z", 85, degrees=True))


def measured(motion):
    pose = LOST if motion is None else Pose("measured", motion, np.eye(6), 0.1, 4, 2)
    return Measurement(pose, (), ())


def shifted(mm, deg):
    return T * RigidTransform.from_components(
        [mm, 0, 0], Rotation.from_rotvec([0, 0, np.deg2rad(deg)])
    )


def test_close_is_a_millimetre_and_five_degrees():
    poses = [
        T,
        shifted(0.9, 4.9),
        shifted(1.1, 0.0),
        shifted(0.0, 5.1),
        None,
        T * PAPER.symmetries[2],
    ]
    measurements = [measured(pose) for pose in poses]
    assert claim_trials.share_close(measurements, [T] * 6, PAPER, equivalents=False) == 2 / 6
    assert claim_trials.share_close(measurements, [T] * 6, PAPER, equivalents=True) == 3 / 6


def test_true_labels_by_hand():
    camera = load_rig("paper_pair").cameras[0]
    centres = camera.project(T.apply(PAPER.marker_centres))
    facing = int(slants(PAPER, T, camera.centre).argmin())
    away = int(slants(PAPER, T, camera.centre).argmax())
    labels = claim_trials.true_labels(
        camera, PAPER, T, np.array([centres[facing] + 1.0, [5.0, 5.0]])
    )
    assert labels.tolist() == [facing, -1]
    assert away not in claim_trials.true_labels(camera, PAPER, T, centres)


@pytest.mark.heavy
def test_a_clip_is_tracked_in_steady_light():
    drawn = claim_draws.clip(0, 5)
    assert drawn["share_tracked_ours"] == (1.0, 1.0)
    searched, windows = drawn["share_searched_ours"]
    assert windows == 2 * (claim_draws.CLIP - 1)  # the first instant predicts nothing
    assert 0 < searched < windows


def test_a_window_that_leaves_out_a_marker_is_the_whole_image():
    camera = load_rig("paper_pair").cameras[0]
    whole = Window(0, 0, *camera.size)
    assert claim_trials.share_of_image(whole, camera, PAPER, T) == 1.0
    assert claim_trials.share_of_image(Window(0, 0, 9, 9), camera, PAPER, T) == 1.0
    assert claim_trials.share_of_image(None, camera, PAPER, T) == 1.0
    uv = camera.project(T.apply(PAPER.marker_centres))
    u, v = uv.min(axis=0).astype(int) - 2
    width, height = np.ptp(uv, axis=0).astype(int) + 5
    share = claim_trials.share_of_image(Window(u, v, width, height), camera, PAPER, T)
    assert share == pytest.approx(width * height / np.prod(camera.size))


def test_the_hidden_pair_alone_measures_nothing():
    """What the third camera is given credit for: the same frames without it."""
    from trinolab.bench.hand import Arm
    from trinolab.bench.optics import Bench
    from trinolab.bench.scene import render_rig
    from trinolab.measurement import measure

    rig = load_rig("paper_pair")
    rng = np.random.default_rng(0)
    arm = Arm(hides_from=tuple(float(c) for c in rig.cameras[0].centre))
    drawn = next(shared_poses(load_rig("raised_40deg"), PAPER, rng, arm))
    frames = render_rig(rig, PAPER, drawn, Bench(), rng, arm)
    assert measure(frames, rig, PAPER, parameters=EVERY["paper"]).pose.status == "lost"


# --- the draws' own arithmetic, without an image


PAIR = load_rig("paper_pair")
BLACK = np.zeros((1024, 1280), np.uint8)


def test_a_lost_pose_has_no_error_and_a_measured_one_its_own():
    truth = load_table1().set_poses[3]
    off = RigidTransform.from_translation([0.0, 0.3, 0.4]) * truth * PAPER.symmetries[1]
    found = claim_draws.errors_of(measured(off), truth, PAPER)
    assert (found.E_t_mm, found.n) == (pytest.approx(0.5), 1)
    assert claim_draws.errors_of(measured(None), truth, PAPER) is None


@pytest.fixture
def position_errors(monkeypatch):
    """Gives each pose of a setup an error by what was changed, or none; which poses were asked, and
    the first number of their noise.
    """
    asked = []

    def error(base, worse):
        def of(setup, k, rng):
            asked.append((setup.poses[k].rotation, rng.random()))
            changed = (
                setup.true_rig is not setup.rig
                or setup.velocity.any()
                or setup.handle.marker_diameter_mm != 3.0
                or not np.array_equal(setup.poses.translation, load_table1().set_poses.translation)
            )
            return (worse if changed else base)(setup.poses[k].rotation)

        monkeypatch.setattr(claim_draws, "position_error", of)
        return asked

    return error


def row_of(rotation):
    """The row of Table 1 that has an orientation."""
    return int((load_table1().set_poses.rotation.inv() * rotation).magnitude().argmin())


@pytest.fixture(scope="module")
def kept():
    """The poses that stay in the images at every distance."""
    return np.flatnonzero(factors.in_view_everywhere(factors.table1_setup(PAIR, PAPER))).tolist()


def test_factors_are_compared_at_the_same_poses_and_noise(position_errors, kept):
    """At a distance, too, where some poses are left out before it."""
    asked = position_errors(lambda _: 2.0, lambda _: 5.0)
    drawn = claim_draws.factor(1, 7)
    assert len(kept) < 20
    poses = {name: 20 for name in claim_draws.FACTORS} | {"distance": len(kept)}
    for name, n in poses.items():
        assert drawn[f"factor_{name}"] == (3.0 * n, 2.0 * n)
        assert drawn[f"factor_{name}_without_the_most"] == (3.0 * (n - 1), 2.0 * (n - 1))
    assert len(asked) == 20 + sum(poses.values())
    noise = {row_of(rotation): first for rotation, first in asked[:20]}
    assert len(set(noise.values())) == 20
    for rotation, first in asked[20:]:
        assert first == noise[row_of(rotation)]
    assert claim_draws.factor(2, 7) == drawn
    assert not {first for _, first in asked[-20:]} & set(noise.values())  # another draw's


def test_the_pose_whose_error_grows_most_is_left_out(position_errors):
    position_errors(lambda _: 2.0, lambda rotation: 12.0 if row_of(rotation) == 3 else 5.0)
    drawn = claim_draws.factor(0, 7)
    assert drawn["factor_speed"] == (10.0 + 19 * 3.0, 20 * 2.0)
    assert drawn["factor_speed_without_the_most"] == (19 * 3.0, 19 * 2.0)


@pytest.mark.parametrize("before", [True, False])
def test_a_pose_that_is_lost_on_either_side_does_not_count(monkeypatch, position_errors, before):
    monkeypatch.setattr(claim_draws, "FACTORS", {"speed": 200.0})

    def lost_at_3(error):
        return lambda rotation: None if row_of(rotation) == 3 else error

    def always(error):
        return lambda _: error

    position_errors((lost_at_3 if before else always)(2.0), (always if before else lost_at_3)(5.0))
    assert claim_draws.factor(0, 7)["factor_speed"] == (19 * 3.0, 19 * 2.0)


def test_the_error_of_a_pose_is_that_of_its_own_frames_and_noise(monkeypatch):
    """The frames are the pose, and the noise shifts it along y."""
    setup = factors.table1_setup(PAIR, PAPER)

    def measure(frames, rig, handle, parameters):
        return measured(RigidTransform.from_translation([0.0, frames[1], 0.0]) * frames[0])

    monkeypatch.setattr(factors, "frames", lambda setup, k, rng: (setup.poses[k], rng.random()))
    monkeypatch.setattr(claim_draws, "measure", measure)
    expected = np.random.default_rng(7).random()
    found = claim_draws.position_error(setup, 4, np.random.default_rng(7))
    assert found == pytest.approx(expected)
    monkeypatch.setattr(claim_draws, "measure", lambda *_, **__: measured(None))
    assert claim_draws.position_error(setup, 4, np.random.default_rng(7)) is None


# --- calibrations


def test_a_bent_board_is_the_same_calibration_but_for_the_bend(monkeypatch):
    """Costs by hand: what the generator gives first, and a hundred times the bend."""
    monkeypatch.setattr(
        claim_draws,
        "simulated_calibration",
        lambda rig, board, positions, rng, bend_mm: SimpleNamespace(
            rig=0.3 * rng.random() + 10 * bend_mm
        ),
    )
    monkeypatch.setattr(
        claim_draws, "calibration_errors", lambda found, *_: SimpleNamespace(E_t_mm=found)
    )
    first = 0.3 * np.random.default_rng([5, 2]).random()
    drawn = claim_draws.one_calibration(2, 5)
    assert drawn["calibration_cost_flat"] == (pytest.approx(first), 1.0)
    assert drawn["calibration_cost_bent_50um"] == (pytest.approx(first + 0.5), 1.0)
    assert drawn["calibration_enough_flat"] == (1.0, 1.0)
    assert drawn["calibration_enough_bent_50um"] == (0.0, 1.0)
    assert claim_draws.calibration(2, 5) == {"calibration_cost": (pytest.approx(first), 1.0)}


def test_a_bend_is_a_parabola_along_the_rows():
    board = Board()
    points = bent(board, 0.02)
    height = points[:, 2].reshape(board.rows, board.columns)
    np.testing.assert_allclose(height[:, [0, -1]], 0.0, atol=1e-15)
    np.testing.assert_allclose(height[:, 4], 0.02)  # the middle one of nine columns
    np.testing.assert_allclose(height[:, 2], 0.02 * 0.75)  # half-way: 1 - 1/4
    np.testing.assert_array_equal(points[:, :2], np.array(board.points)[:, :2])
    np.testing.assert_array_equal(bent(board, 0.0), board.points)


# --- the mean over the pairs


def test_the_mean_over_pairs_counts_markers_that_all_three_have(monkeypatch):
    """Exact pixels of the true markers: both means are right, but where a camera misses one."""
    rig = load_rig("raised_40deg")
    truth = next(shared_poses(rig, PAPER, np.random.default_rng([5, 0])))
    uv = [camera.project(truth.apply(PAPER.marker_centres)) for camera in rig.cameras]
    uv[0] = uv[0] + [0.0, 1.0]  # CCD1 is a pixel off

    def measure(images, rig, handle, prior, parameters):
        assert (prior.translation == truth.translation).all()
        labels = tuple(np.arange(12) for _ in uv)
        found = tuple(SimpleNamespace(uv=pixels) for pixels in uv)
        return SimpleNamespace(labels=labels, found=found)

    monkeypatch.setattr(claim_draws, "render_rig", lambda *_: None)
    monkeypatch.setattr(claim_draws, "measure", measure)
    plain, weighted = claim_draws.rendered_mean(0, 5)["plain_mean_rendered"]
    steepest = [
        facing_pixels(PAPER, camera, truth, Parameters().max_slant_deg) for camera in rig.cameras
    ]
    rows = np.flatnonzero(np.isfinite(steepest).all(axis=(0, 2)))
    assert 0 < len(rows) < 12
    expected = [
        np.linalg.norm(
            triangulate(rig, np.array(uv)[:, [row]]) - truth.apply(PAPER.marker_centres[[row]])
        )
        for row in rows
    ]
    assert plain == pytest.approx(np.square(expected).sum())
    assert weighted > 0.0
    assert weighted != plain


def test_a_pose_without_a_marker_that_all_see_is_drawn_again(monkeypatch):
    """Of the first one each camera sees a marker of its own."""
    rig = load_rig("raised_40deg")
    away = RigidTransform.from_translation([0.0, 0.0, 700.0])
    drawn = iter([away, T])
    monkeypatch.setattr(claim_draws, "shared_poses", lambda *_: drawn)
    monkeypatch.setattr(
        claim_draws,
        "true_visibility",
        lambda camera, handle, pose: (
            np.arange(12) == (3 if pose is T else rig.names.index(camera.name))
        ),
    )
    found = claim_draws.concealed(0, 5)
    assert next(drawn, None) is None
    assert found["share_concealed"] == (1.0, 1.0)


# --- clips


def camera_state(window, velocity=(60.0, 30.0)):
    """Of a camera that knows where and how fast the handle's window moves."""
    mean, covariance = initial_state(window.centre)
    return CameraState(BLACK, State(np.append(mean[:2], [*velocity, 0.0, 0.0]), covariance), window)


def moving_windows(count):
    """Windows around the markers of T in CCD1, each 2 px right of and 1 px below the last."""
    uv = PAIR.cameras[0].project(T.apply(PAPER.marker_centres))
    u, v = uv.min(axis=0).astype(int) - 60
    return [Window(u + 2 * k, v + k, 300, 300) for k in range(count)]


@pytest.fixture
def followed(monkeypatch):
    """A clip of which the tracker finds the given poses; one camera knows the windows, the other
    never does.
    """

    def of(poses, knows=0):
        windows = moving_windows(len(poses) + 1)
        nothing = CameraState(BLACK, None, None)
        states = []
        for k, window in enumerate(windows):
            cameras = (camera_state(window), nothing)
            states.append(TrackerState(k / 30, cameras[:: -1 if knows else 1], 0.0, None))
        after = iter(states[1:])
        monkeypatch.setattr(claim_draws, "step", lambda state, images, *_: (next(after), *images))
        frames = [[measured(pose)] for pose in poses]
        way = claim_draws.follow_clip(
            states[0], [None, None], frames, [T] * len(poses), 0, PAIR, PAPER, claim_draws.PRINTED
        )
        return windows, way

    return of


def test_an_instant_is_right_if_its_pose_is_close(followed):
    _, way = followed([T, None, shifted(5.0, 0.0), T])
    assert way.right == [True, False, False, True]
    assert way.state.t_s == 4 / 30


def test_only_a_camera_that_knows_a_window_searches_in_one(followed):
    windows, way = followed([T, T, T])
    assert len(way.shares_ours) == len(way.shares_printed) == 3
    size = np.prod(PAIR.cameras[0].size)
    assert all(90_000 / size < share < 1 for share in way.shares_ours)
    # from where the last window was, by its velocity
    assert way.window.centre == pytest.approx(
        np.array(windows[2].centre) + [60 / 30, 30 / 30], abs=1.0
    )


def test_the_window_whose_search_is_timed_is_ccd1_s(followed):
    """Of which there is none if only CCD2 knows."""
    _, way = followed([T, T], knows=1)
    assert way.window is None
    assert len(way.shares_ours) == 2
    assert way.printed[0] is None
    assert way.printed[1] is not None


def test_the_printed_filter_starts_at_rest_and_sees_sums_of_coordinates(followed):
    """By the filter of whole tracks."""
    windows, way = followed([T, T, T])
    sums = np.array([[sum(window.centre)] for window in windows[1:]])
    F, Q = constant_acceleration(1 / 30), white_jerk(1 / 30, KalmanParameters().jerk_intensity)
    R = np.array([[2 * KalmanParameters().sigma_px ** 2]])
    known = claim_draws.certain(windows[0])
    whole = image_track.run(known, sums, F, Q, claim_draws.PRINTED_H, R).updated
    np.testing.assert_allclose(way.printed[0].mean, whole.mean[-1], rtol=1e-9)
    np.testing.assert_allclose(
        way.printed[0].covariance, whole.covariance[-1], rtol=1e-9, atol=1e-9
    )
    assert way.printed[1] is None


@pytest.fixture
def clip(monkeypatch):
    """A clip of four instants: the printed background loses the last of all in doubled light, ours
    the first.
    """
    monkeypatch.setattr(claim_draws, "render_rig", lambda *_: [BLACK, BLACK])

    def render_clip(rig, handle, truths, bench, rng, arm, gains=(1.0, 1.0)):
        return [[gain, gain] for _, gain in zip(truths, gains, strict=True)]

    def follow(state, printed, frames, truths, begin, rig, handle, parameters):
        right = [True] * len(frames)
        if frames[0][0] == 2.0:
            right[-1 if parameters is claim_draws.PRINTED else 0] = False
        shares = [0.25] * len(frames)
        return claim_draws.Way(state, printed, right, shares, [0.5] * len(frames), None)

    monkeypatch.setattr(claim_draws, "render_clip", render_clip)
    monkeypatch.setattr(claim_draws, "follow_clip", follow)
    return claim_draws.clip(0, 5, 4)


def test_a_clip_counts_instants_in_steady_light_and_after_it_doubles(clip):
    for name in ("printed", "ours"):
        assert clip[f"share_tracked_{name}"] == (1.0, 1.0)
        assert clip[f"share_kept_under_light_{name}"] == (1.0, 2.0)
        assert clip[f"share_measured_in_light_{name}"] == (1.0, 2.0)
    assert clip["share_searched_ours"] == (4 * 0.25, 4.0)
    assert clip["share_searched_printed"] == (4 * 0.5, 4.0)
    assert clip["time_searched"] == claim_draws.NOTHING  # the last window is none


def test_the_time_of_a_search_is_that_in_the_window_and_in_all_of_the_image(monkeypatch):
    def searched(images, windows, camera, handle, truths):
        assert len(images) == len(windows) == len(truths)
        return SimpleNamespace(seconds=float(windows[0].area))

    monkeypatch.setattr(claim_draws, "searched", searched)
    found = claim_draws.time(BLACK, Window(3, 4, 20, 10), PAIR.cameras[0], PAPER, T)
    assert found == (200.0, 1280.0 * 1024.0)


def test_a_long_clip_is_a_clip_of_a_second_by_other_names(monkeypatch):
    monkeypatch.setattr(claim_draws, "clip", lambda *of: {"x": of})
    assert claim_draws.long_clip(1, 5) == {"long_x": (1, 5, 30, True)}


# --- the slave's arm


def test_the_hand_that_rests_is_the_one_that_moves_until_it_stops(monkeypatch):
    """The session is by hand: the tool is 3 mm and 2 deg beside where the hand is."""
    beside = RigidTransform.from_components(
        [0.0, 3.0, 0.0], Rotation.from_euler("x", 2.0, degrees=True)
    )
    runs = []

    def run(robot, hand, duration_s, rng, **settings):
        runs.append((hand, duration_s, rng.random(), settings))
        poses = hand(np.arange(5) / 4 * duration_s)
        return SimpleNamespace(stages={"hand": poses, "tool": poses * beside})

    monkeypatch.setattr(claim_draws, "kept_robot", lambda: None)
    monkeypatch.setattr(master_slave, "run", run)
    monkeypatch.setattr(master_slave, "parts", lambda trial: {"total": (1.5, 2.5)})
    monkeypatch.setattr(master_slave, "lag_s", lambda trial: 0.2)
    assert claim_draws.slave(1, 5) == {
        "slave_delay_ms": (200.0, 1.0),
        "slave_moving_mm": (1.5, 1.0),
        "slave_moving_deg": (2.5, 1.0),
        "slave_rest_mm": (pytest.approx(3.0), 1.0),
        "slave_rest_deg": (pytest.approx(2.0), 1.0),
    }
    (moving, moving_s, *_), (resting, resting_s, *_) = runs
    assert (moving_s, resting_s) == (3.0, 1.0 + master_slave.REST_S)
    times = np.array([0.3, 1.9, 2.0, 2.1, 5.0])
    here, there = (hand(times).translation for hand in (moving, resting))
    np.testing.assert_allclose(there[:3], here[:3], atol=1e-9)
    np.testing.assert_allclose(there[3:], np.broadcast_to(here[2], (2, 3)), atol=1e-9)
    assert runs[0][2] != runs[1][2]  # the noise is another one
    assert all(one[3] == other[3] for one, other in pairwise(runs))
