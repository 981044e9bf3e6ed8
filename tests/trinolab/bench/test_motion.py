"""Smooth motion: rates and smoothness by finite differences of the poses, not from the motion's own
formulas.
"""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.motion import human_motion, motion_at, random_pose, smooth_motion
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.fetch import why_not
from workbench.studies.real_recordings import at_times, load_trajectories

LIMITS = np.array([[-90, 90], [-60, 60], [520, 620]])


def rng(seed=0):
    return np.random.default_rng(seed)


def rates(poses, step_s):
    """Speeds in mm/s and turn rates in deg/s between successive poses."""
    turns = (poses.rotation[:-1].inv() * poses.rotation[1:]).magnitude()
    return np.linalg.norm(np.diff(poses.translation, axis=0), axis=1) / step_s, np.rad2deg(
        turns
    ) / step_s


def tilts_deg(poses):
    return np.rad2deg(np.arccos(poses.rotation.as_matrix()[:, 2, 1]))


def test_the_speeds_are_a_persons():
    clips = [rates(smooth_motion(rng(seed), 20, 50), 0.02) for seed in range(20)]
    speed, turn = (np.array(values) for values in zip(*clips, strict=True))
    # mm/s; medians of single clips of 20 s: 173 to 231
    assert np.median(speed) == pytest.approx(200, abs=20)
    assert np.median(turn) == pytest.approx(20, abs=2)  # deg/s; of single clips: 18 to 24
    assert np.median(speed, axis=1).min() > 100
    assert np.median(speed, axis=1).max() < 300
    assert turn.max() < 66 < 75  # the bound of the sums, sqrt(6) * 2 * 0.67 * 20; worst here 54


def test_asked_for_speeds_are_kept():
    speed, turn = rates(smooth_motion(rng(1), 60, 100, speed_mm_s=50, turn_deg_s=5), 0.01)
    assert np.median(speed) == pytest.approx(50, rel=0.2)  # a clip of 60 s has a median of its own
    assert np.median(turn) == pytest.approx(5, rel=0.2)
    still = smooth_motion(rng(1), 1, 30, speed_mm_s=0, turn_deg_s=0).as_matrix()
    np.testing.assert_allclose(still, np.broadcast_to(still[0], still.shape), atol=1e-12)  # mm


@pytest.mark.parametrize(
    "ranges",
    [
        {"x_mm": (-90, 90), "y_mm": (-60, 60), "z_mm": (520, 620), "tilt_deg": (60, 120)},
        {"x_mm": (5, 6), "y_mm": (-10, 10), "z_mm": (700, 710), "tilt_deg": (80, 85)},
    ],
)
def test_the_motion_stays_in_its_ranges_and_uses_them(ranges):
    options = {} if ranges["x_mm"] == (-90, 90) else ranges  # of the standard scene
    poses = [smooth_motion(rng(seed), 20, 30, **options) for seed in range(10)]
    tilt = np.concatenate([tilts_deg(T) for T in poses])
    found = np.column_stack([np.concatenate([T.translation for T in poses]), tilt])
    low, high = np.array(list(ranges.values())).T
    assert (found >= low - 1e-9).all()
    assert (found <= high + 1e-9).all()
    assert (np.ptp(found[:, :3], axis=0) > 0.9 * (high - low)[:3]).all()
    assert np.ptp(tilt) > 0.2 * (high - low)[3]


@pytest.mark.parametrize("rest_s", [None, (0.5, 0.9)], ids=["moving", "with a rest"])
def test_velocity_and_turn_rate_are_continuous(rest_s):
    """A jump of velocity would make the second difference grow as the step shrinks; it shrinks with
    it, squared.
    """
    for seed in range(3):
        worst = []
        for step in (1 / 400, 1 / 800):
            poses = motion_at(rng(seed), np.arange(0, 2, step), rest_s=rest_s)
            spin = (poses.rotation[1:] * poses.rotation[:-1].inv()).as_rotvec() / step
            jumps = [np.diff(poses.translation, axis=0) / step, np.rad2deg(spin)]
            worst.append([np.abs(np.diff(jump, axis=0)).max() / step for jump in jumps])
        np.testing.assert_allclose(worst[1], worst[0], rtol=0.05)  # twice as much at a jump
        assert worst[1][0] < 10_000  # mm/s^2, a g


def test_it_starts_where_it_is_told():
    for seed in range(10):
        start = random_pose(rng(seed))
        first = smooth_motion(rng(seed), 1, 30, start)[0]
        # mm; worst here 3e-13
        np.testing.assert_allclose(first.as_matrix(), start.as_matrix(), atol=1e-9)
    upright = smooth_motion(rng(), 1, 30)[0]
    np.testing.assert_allclose(upright.translation, [0, 0, 570], atol=1e-9)
    np.testing.assert_allclose(upright.rotation.as_matrix()[:, 1], [0, -1, 0], atol=1e-12)


def test_at_rest_nothing_moves_and_elsewhere_it_does():
    times = np.arange(0, 4, 1 / 30)
    poses = motion_at(rng(3), times, rest_s=(1.0, 2.5))
    resting = (times >= 1) & (times <= 2.5)
    rest = poses[np.flatnonzero(resting)].as_matrix()
    assert len(rest) == 46
    assert (rest == rest[0]).all()
    speed = rates(poses, 1 / 30)[0]
    assert speed[times[1:] < 0.7].min() > 20
    assert speed[times[:-1] > 2.8].min() > 20
    np.testing.assert_allclose(
        poses[0].as_matrix(), motion_at(rng(3), [0.0])[0].as_matrix(), atol=1e-12
    )


def test_a_rest_from_the_beginning_keeps_the_start():
    poses = motion_at(rng(4), np.arange(0, 2, 0.1), rest_s=(0, 1))
    np.testing.assert_allclose(poses[:11].translation, [[0, 0, 570]] * 11, atol=1e-9)
    assert np.linalg.norm(poses[-1].translation - [0, 0, 570]) > 10


def test_one_seed_is_one_motion_at_any_times():
    even = smooth_motion(rng(5), 2, 50)
    assert len(even) == 100
    uneven = motion_at(rng(5), [0.02, 0.5, 0.5, 1.98])
    np.testing.assert_allclose(uneven.as_matrix(), even[[1, 25, 25, 99]].as_matrix(), atol=1e-9)
    other = smooth_motion(rng(6), 2, 50)
    assert np.abs(other.translation - even.translation).max() > 10


@pytest.mark.parametrize(("row", "said"), cases(Path(__file__).with_name("wrong.txt"), "motion"))
def test_a_bad_argument_is_named(row, said):
    with pytest.raises(ValueError, match=said):
        motion_at(**{"rng": rng(), "times_s": [0.0], **tomllib.loads(row)})


def test_a_clip_that_cannot_be_is_named():
    up, end_on = (Rotation.from_euler("x", angle, degrees=True) for angle in (180, 90))
    outside = RigidTransform.from_components([0, 0, 700], up)
    lying = RigidTransform.from_components([0, 0, 570], end_on)
    for arguments, said in (
        ((1, 0), "fps"),
        ((0.001, 30), "duration_s"),
        ((1, 30, outside), "start: expected x, y, z"),
        ((1, 30, lying), "start: expected x, y"),
    ):
        with pytest.raises(ValueError, match=said):
            smooth_motion(rng(), *arguments)
    with pytest.raises(ValueError, match="times_s"):
        human_motion(rng(5), [-1.0, 2.0])


# --- a person's pace

# mm/s and deg/s, median and 95 %, of the handheld recording at 30 Hz
HELD = np.array([[329, 496], [15.3, 36.1]])


def quantiles(poses, step_s):
    return np.array([np.percentile(values, [50, 95]) for values in rates(poses, step_s)])


@pytest.mark.skipif(
    real_set("trajectories") is None,
    reason=f"no trajectories: {why_not(load_real_sets()['trajectories'])}",
)
def test_the_pace_is_read_from_a_handheld_recording():
    recorded = load_trajectories()
    every = np.arange(0, recorded.t_s[-1], 1 / 30)
    np.testing.assert_allclose(quantiles(at_times(recorded, every), 1 / 30), HELD, rtol=0.005)


def test_human_motion_has_the_speeds_and_turn_rates_of_a_person():
    found = np.mean(
        [quantiles(human_motion(rng(seed), np.arange(1800) / 30), 1 / 30) for seed in range(4)],
        axis=0,
    )
    np.testing.assert_allclose(found, HELD, rtol=0.08)  # over 12 seeds 328, 484, 15.5, 37.6
    for seed in range(4):  # 10 s have medians of their own
        short = quantiles(human_motion(rng(seed), np.arange(300) / 30), 1 / 30)
        np.testing.assert_allclose(short, HELD, rtol=0.35)


def test_human_motion_is_one_motion_whenever_it_is_asked_for():
    times = np.array([0.0, 0.31, 1.0, 4.77, 9.5])
    every = human_motion(rng(5), times)
    np.testing.assert_allclose(
        every[:3].as_matrix(), human_motion(rng(5), times[:3]).as_matrix(), rtol=0, atol=1e-9
    )
    assert len(human_motion(rng(5), [])) == 0
    position = human_motion(rng(6), np.arange(600) / 30).translation
    assert (position >= LIMITS[:, 0] - 1e-9).all()
    assert (position <= LIMITS[:, 1] + 1e-9).all()
