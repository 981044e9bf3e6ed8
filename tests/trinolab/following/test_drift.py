"""A camera that turns within a recording: it is found, with the time, and nothing is found where
none does.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from boards import motion
from scenes import centroids
from scipy.signal import lfilter
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.following.drift import Series, find_drift, image_offsets
from trinolab.following.parameters import FollowParameters
from trinolab.following.track import DriftMonitor
from trinolab.identity.parameters import IdentityParameters

P = IdentityParameters()
CODED = load_handle("coded")
TURN_DEG = 0.05
N, WHEN = 200, 100


def moving(rng):
    """Poses of a hand that moves about the middle of the field of view."""
    t = np.arange(N) / 25
    phase = rng.uniform(0, 2 * np.pi, 6)
    swing = np.sin(2 * np.pi * np.outer(t, [0.3, 0.41, 0.23, 0.37, 0.29, 0.19]) + phase)
    turns = Rotation.from_rotvec(0.4 * swing[:, 3:])
    return RigidTransform.from_components(swing[:, :3] * [40, 30, 30] + [0, 0, 570], turns)


def turned(rig, c, deg=TURN_DEG):
    turn = motion([0, 0, 0], np.deg2rad(deg) * np.array([0.6, 0.8, 0.0]))
    cameras = list(rig.cameras)
    T = cameras[c].T_cam_world
    there = RigidTransform.from_components(T.translation, turn.rotation * T.rotation)
    cameras[c] = replace(cameras[c], T_cam_world=there)
    return Rig(tuple(cameras))


def seen(rig, poses, rng, sigma_px=0.1):
    """Pixels (n, cameras, markers, 2) of the markers that face a camera within 72 deg."""
    uv = np.stack([centroids(rig, CODED, T, 72) for T in poses])
    return uv + sigma_px * rng.standard_normal(uv.shape)


def recording(rig, c, seed):
    """Poses and pixels of a recording in which a camera turns half way, or none does."""
    rng = np.random.default_rng(seed)
    poses = moving(rng)
    after = rig if c is None else turned(rig, c)
    return poses, np.concatenate([seen(rig, poses[:WHEN], rng), seen(after, poses[WHEN:], rng)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "turns", "named"), [("raised_40deg", 2, (2,)), ("paper_pair", 0, (0, 1))]
)
def test_the_camera_that_turns_is_named_with_its_time(name, turns, named):
    """Of a pair it may be either."""
    rig = load_rig(name)
    poses, uv = recording(rig, turns, turns)
    found = find_drift(image_offsets(rig, CODED, poses, uv, P), rig)
    assert found.cameras == named
    assert abs(found.instant - WHEN) <= 5  # a block
    if len(named) == 1:
        # as far as it shows: a motion of the handle explains a part
        assert 0.7 < found.turned_deg / TURN_DEG < 1.1
        focal = rig.cameras[turns].focal.mean()
        assert found.shift_px == pytest.approx(np.deg2rad(found.turned_deg) * focal)
    watched = DriftMonitor(rig, CODED, FollowParameters())
    for k, T in enumerate(poses):
        watched.add(k, k / 25, uv[k], T)
    (line,) = watched.drift()
    at = found.instant
    says = rf"{rig.names[named[-1]]}: turned by 0\.0\d+ deg .* at {at / 25:.2f} s \(frame {at}\);"
    assert re.search(says, line)


@pytest.mark.slow
def test_a_rig_that_stays_does_not_drift():
    """Nor does a rig file that is wrong from the first instant on."""
    rig = load_rig("raised_40deg")
    offsets = image_offsets(rig, CODED, *recording(rig, None, 1), P)
    assert find_drift(offsets, rig) is None
    rng = np.random.default_rng(0)
    poses = moving(rng)
    offsets = image_offsets(rig, CODED, poses, seen(turned(rig, 2), poses, rng), P)
    assert np.linalg.norm(np.median(offsets.shift, axis=0)) > 1.0
    assert find_drift(offsets, rig) is None


@pytest.mark.slow
def test_instants_that_one_camera_sees_do_not_count():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(0)
    poses = moving(rng)
    uv = seen(rig, poses, rng)
    poses, uv = poses[:60], uv[:60]
    uv[10:20, 1:] = np.nan
    uv[30:40, 2] = np.nan
    found = image_offsets(rig, CODED, poses, uv, P)
    assert not np.isin(np.arange(10, 20), found.instant).any()
    ranks = np.linalg.matrix_rank(found.shows)
    assert (ranks[np.isin(found.instant, np.arange(30, 40))] == 1).all()
    assert (ranks[np.isin(found.instant, np.arange(50, 60))] == 3).all()


def test_offsets_that_wander_are_no_drift():
    """Slowly, as the bias of centroids does with the pose: taken for independent, a quarter of such
    recordings would have a drift.
    """
    rig, n, rho = load_rig("raised_40deg"), 400, 0.97
    shows = np.tile(np.eye(6), (n, 1, 1))
    for seed in range(40):
        steps = np.random.default_rng(seed).standard_normal((n, 6))
        steps[1:] *= np.sqrt(1 - rho**2)
        shift = lfilter([1.0], [1.0, -rho], steps, axis=0)
        assert find_drift(Series(np.arange(n), 0.5 * shift, shows), rig) is None


def test_too_few_instants_say_nothing():
    rig, poses = load_rig("paper_pair"), moving(np.random.default_rng(0))[:1]
    nothing = image_offsets(rig, CODED, poses, np.full((1, 2, 12, 2), np.nan), P)
    assert len(nothing.instant) == 0
    assert find_drift(nothing, rig) is None
