"""A camera that turns within a recording: it is found, with the time, and nothing is found where
none does.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig, RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.files import recording_writer
from trinolab.files.poses import transforms, truth_table
from trinolab.following import track
from trinolab.following.drift import Series, find_drift, image_offsets
from trinolab.following.parameters import FollowParameters
from trinolab.following.track import DriftMonitor, track_folder
from trinolab.handle import slants
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
    places = swing[:, :3] * [40, 30, 30] + [0, 0, 570]
    turns = Rotation.from_rotvec(0.4 * swing[:, 3:])
    return RigidTransform.from_components(places, turns)


def turned(rig, c, deg=TURN_DEG):
    camera = rig.cameras[c]
    T = camera.T_cam_world
    turn = Rotation.from_rotvec(np.deg2rad(deg) * np.array([0.6, 0.8, 0.0]))
    there = replace(
        camera, T_cam_world=RigidTransform.from_components(T.translation, turn * T.rotation)
    )
    return Rig((*rig.cameras[:c], there, *rig.cameras[c + 1 :]))


def seen(rig, poses, rng, sigma_px=0.1):
    """Pixels (n, cameras, markers, 2) of the markers that face a camera within 72 deg."""
    uv = np.full((len(poses), len(rig.cameras), len(CODED.marker_centres), 2), np.nan)
    for row, T in zip(uv, poses, strict=True):
        slant = np.stack([slants(CODED, T, camera.centre) for camera in rig.cameras])
        views = Views(*np.nonzero(slant < np.deg2rad(72)))
        row[views] = predict_centroids(rig, CODED, T, views)[0]
    return uv + sigma_px * rng.standard_normal(uv.shape)


def series(rig, c, seed, deg=TURN_DEG):
    """Offsets of a recording in which a camera turns half way, or none does."""
    rng = np.random.default_rng(seed)
    poses = moving(rng)
    after = rig if c is None else turned(rig, c, deg)
    uv = np.concatenate([seen(rig, poses[:WHEN], rng), seen(after, poses[WHEN:], rng)])
    return image_offsets(rig, CODED, poses, uv, P)


@pytest.mark.slow
@pytest.mark.parametrize(
    "c", [pytest.param(0, marks=pytest.mark.heavy), pytest.param(1, marks=pytest.mark.heavy), 2]
)
def test_the_camera_of_three_that_turns_is_named_with_its_time(c):
    rig = load_rig("raised_40deg")
    found = find_drift(series(rig, c, c), rig)
    assert found.cameras == (c,)
    assert abs(found.instant - WHEN) <= 5  # a block
    # as far as it shows: a motion of the handle explains a part
    assert 0.7 < found.turned_deg / TURN_DEG < 1.1
    focal = rig.cameras[c].focal.mean()
    assert found.shift_px == pytest.approx(np.deg2rad(found.turned_deg) * focal)


@pytest.mark.slow
def test_a_pair_does_not_say_which_of_its_cameras_has_turned():
    rig = load_rig("paper_pair")
    found = find_drift(series(rig, 0, 0), rig)
    assert found.cameras == (0, 1)
    assert abs(found.instant - WHEN) <= 5


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param("paper_pair", marks=pytest.mark.heavy), "raised_40deg"]
)
def test_a_rig_that_stays_does_not_drift(name):
    rig = load_rig(name)
    assert [find_drift(series(rig, None, seed), rig) for seed in range(2)] == [None] * 2


@pytest.mark.slow
def test_offsets_that_stay_are_no_drift():
    """A rig file that is wrong from the first instant on."""
    rig = load_rig("raised_40deg")
    wrong = turned(rig, 2)
    rng = np.random.default_rng(0)
    poses = moving(rng)
    offsets = image_offsets(rig, CODED, poses, seen(wrong, poses, rng), P)
    assert np.linalg.norm(np.median(offsets.shift, axis=0)) > 1.0
    assert find_drift(offsets, rig) is None


@pytest.mark.slow
def test_instants_that_one_camera_sees_do_not_count():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(0)
    poses = moving(rng)
    uv = seen(rig, poses, rng)
    uv[10:20, 1:] = np.nan
    uv[30:40, 2] = np.nan
    found = image_offsets(rig, CODED, poses, uv, P)
    assert not np.isin(np.arange(10, 20), found.instant).any()
    ranks = np.linalg.matrix_rank(found.shows)
    assert (ranks[np.isin(found.instant, np.arange(30, 40))] == 1).all()
    assert (ranks[np.isin(found.instant, np.arange(50, 60))] == 3).all()


def wandering(seed, n=400, rho=0.97, sigma_px=0.5):
    """Offsets that go up and down slowly, as the bias of centroids does with the pose."""
    rng = np.random.default_rng(seed)
    shift = np.empty((n, 6))
    shift[0] = rng.standard_normal(6)
    for k in range(1, n):
        shift[k] = rho * shift[k - 1] + np.sqrt(1 - rho**2) * rng.standard_normal(6)
    return Series(np.arange(n), sigma_px * shift, np.tile(np.eye(6), (n, 1, 1)))


def test_offsets_that_wander_are_no_drift():
    """Taken for independent, a quarter of such recordings would have one."""
    rig = load_rig("raised_40deg")
    assert [find_drift(wandering(seed), rig) for seed in range(40)] == [None] * 40


def test_too_few_instants_say_nothing():
    rig = load_rig("paper_pair")
    nothing = image_offsets(
        rig, CODED, moving(np.random.default_rng(0))[:1], np.full((1, 2, 12, 2), np.nan), P
    )
    assert len(nothing.instant) == 0
    assert find_drift(nothing, rig) is None


@pytest.mark.slow
def test_a_track_says_which_camera_and_when():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(1)
    poses = moving(rng)
    after = turned(rig, 1)
    uv = np.concatenate([seen(rig, poses[:WHEN], rng), seen(after, poses[WHEN:], rng)])
    watched = DriftMonitor(rig, CODED, FollowParameters())
    for k, T in enumerate(poses):
        watched.add(k, k / 25, uv[k], T)
    (line,) = watched.drift()
    said = re.fullmatch(
        r"ccd2: turned by (0\.0\d+) deg \((\d\.\d) px, as far as that shows\) at (\d\.\d\d) s "
        r"\(frame (\d+)\); from there on the rig file does not hold",
        line,
    )
    assert abs(int(said[4]) - WHEN) <= 5
    assert float(said[3]) == pytest.approx(int(said[4]) / 25)


def test_long_tracks_are_watched_at_fewer_instants(monkeypatch):
    monkeypatch.setattr(track, "MOST_INSTANTS", 10)
    watched = DriftMonitor(load_rig("paper_pair"), CODED, FollowParameters())
    T = moving(np.random.default_rng(0))[0]
    for frame in range(50):
        watched.add(frame, 0.0, np.full((2, 12, 2), np.nan), T)
    frames = [frame for frame, *_ in watched.instants]
    assert frames == list(range(0, 50, watched.every))
    assert len(frames) <= 10


@pytest.mark.heavy
@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
@pytest.mark.parametrize("known", [True, False])
def test_a_rendered_recording_with_a_camera_that_turns(name, known, tmp_path, caplog):
    """It is reported, and no pose is called measured that is badly wrong."""
    rig = load_rig(name)
    last = len(rig.cameras) - 1
    rng = np.random.default_rng(2)
    poses = moving(rng)[::2][: 2 * (N // 5)]
    half = len(poses) // 2
    folder = tmp_path / "r"
    sigma = np.tile(
        [0.0] * 2 + [0.1] * 2 + [0.0] * 5 + [np.deg2rad(0.005)] * 3 + [0.0] * 3, last + 1
    )
    covariance = RigCovariance(rig.names, np.diag(sigma**2)) if known else None
    partial = recording_writer.begin(folder, replace(rig, covariance=covariance), CODED)
    for k, T in enumerate(poses):
        there = rig if k < half else turned(rig, last)
        recording_writer.add(partial, rig, k, render_rig(there, CODED, T, Bench(), rng))
    recording_writer.finish(folder, np.arange(len(poses)) / 12.5, truth_table(poses))
    with caplog.at_level("INFO", logger="trinolab"):
        table = track_folder(folder, tmp_path / "p.csv", progress=False)
    (line,) = [message for message in caplog.messages if "turned by" in message]
    assert rig.names[last] in line.split(":")[0]
    assert abs(int(re.search(r"frame (\d+)", line)[1]) - half) <= 5
    held = table[table["status"] == "measured"]
    assert (held["frame"] < half).sum() == half
    away = transforms(held).translation - poses.translation[held["frame"]]
    mm = np.linalg.norm(away, axis=1)
    assert not ((mm > 2) & (mm > 5 * held["sigma_mm"])).any()
