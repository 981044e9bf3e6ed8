"""The study of an instant's time: its films, what a row says, and what of the shipped table is kept."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.bench.scenario import take
from trinolab.datasets import load_rig, load_sweep
from trinolab.pose import LOST, Pose
from workbench.studies import instant_times
from workbench.studies.instant_times import (
    BEFORE,
    FPS,
    INSTANTS,
    METHODS,
    Film,
    fast,
    films,
    followed,
    job_of,
    make_table,
    taken,
)

KEYS = ["motion", "exposure_ms", "seed", "frame"]


# --- the films


def test_a_round_has_all_motions_and_two_exposures_of_what_is_smeared():
    kinds = {(film.motion, film.exposure_ms) for film in films()}
    smeared = {(motion, ms) for motion in ("hard", "fast") for ms in (6.0, 10.0)}
    assert kinds == smeared | {("calm", 10.0), ("task", 10.0)}
    assert sum(film.instants for film in films()) == INSTANTS


def test_more_instants_are_further_rounds_with_other_seeds():
    many = films(2 * INSTANTS + INSTANTS // 2)
    assert many[: len(films())] == films()
    assert len({(film.motion, film.exposure_ms, film.seed) for film in many}) == len(many)
    assert sum(film.instants for film in many) == pytest.approx(2.5 * INSTANTS, abs=len(films()))
    assert many[-1].instants == pytest.approx(films()[-1].instants / 2, abs=1)


def test_fewer_instants_are_the_first_ones_of_each_film():
    few = films(60)
    assert [film[:3] for film in few] == [film[:3] for film in films()]
    assert sum(film.instants for film in few) == pytest.approx(60, abs=len(few))
    with pytest.raises(ValueError, match="instants: expected"):
        films(1)


def test_a_shorter_exposure_is_a_shorter_way_and_nothing_else():
    usual, short = (job_of(Film("hard", ms, 3, 4)) for ms in (10.0, 6.0))
    for long_way, way in zip(usual.shots, short.shots, strict=True):
        np.testing.assert_allclose(way.velocity, 0.6 * long_way.velocity, atol=1e-12)
        np.testing.assert_allclose(way.turn_rate, 0.6 * long_way.turn_rate, atol=1e-12)
        assert way.gains == long_way.gains
        np.testing.assert_array_equal(
            way.T_world_handle.as_matrix(), long_way.T_world_handle.as_matrix()
        )


def test_velocities_of_the_fast_hand_are_its_poses_differences():
    step = 1e-5
    times = np.array([0.1, 0.37, 0.9])
    rig = load_rig("raised_40deg")
    before, now, after = (fast(rig, times + t, 2) for t in (-step, 0.0, step))
    for a, shot, b in zip(before, now, after, strict=True):
        way = b.T_world_handle.translation - a.T_world_handle.translation
        turn = b.T_world_handle.rotation * a.T_world_handle.rotation.inv()
        np.testing.assert_allclose(shot.velocity, way / (2 * step), atol=1e-3)  # mm/s
        np.testing.assert_allclose(
            shot.turn_rate, turn.as_rotvec() / (2 * step), atol=1e-4
        )  # rad/s


def test_the_fast_hand_reaches_what_it_says():
    shots = fast(load_rig("raised_40deg"), np.arange(60) / FPS, 0)
    speeds = [np.linalg.norm(shot.velocity) for shot in shots]
    assert max(speeds) == pytest.approx(2 * np.pi * 1.6 * 80, rel=0.02)


def test_an_unknown_motion_is_named():
    with pytest.raises(
        ValueError, match="motion: expected one of calm, hard, fast, task, got wild"
    ):
        job_of(Film("wild", 10.0, 0, 3))


# --- a row


@pytest.fixture
def stand_in(monkeypatch):
    """A method that needs 3, 7 and 5 ms, beside blobs that need 2 ms: off by 1 mm, lost, and a pose
    where nobody is.
    """
    clock = SimpleNamespace(now=0.0)
    film = Film("task", 10.0, 0, 3)
    job = job_of(film)
    job.shots[2] = job.shots[2]._replace(T_world_handle=None)
    T = job.shots[0].T_world_handle
    off = RigidTransform.from_translation([0.0, 0.6, -0.8]) * T
    spread = np.eye(6)
    poses = [Pose("measured", off, spread, 0.1, 4, 2), LOST, Pose("measured", T, spread, 0.1, 4, 2)]
    spent = iter([0.1, 0.1, 0.1, 0.003, 0.007, 0.005, 0.001, 0.002, 0.004])  # three to warm up

    def step(state, images, t):
        clock.now += next(spent)
        return state + 1, poses[state]

    def detect(image):
        clock.now += 0.002 / 3

    monkeypatch.setattr(instant_times, "job_of", lambda film: job)
    images = [np.zeros((2, 2))] * 3
    monkeypatch.setattr(instant_times, "taken", lambda job, draws: [[images] * draws] * 3)
    monkeypatch.setattr(instant_times.time, "process_time", lambda: clock.now)
    detector = SimpleNamespace(detect=detect)
    monkeypatch.setattr(instant_times, "blob_detector", lambda rig, handle: detector)
    monkeypatch.setitem(METHODS, "stand-in", lambda job, exposure_ms: (0, step))
    return film


def test_a_row_has_the_time_by_that_of_the_blobs_and_the_error(stand_in):
    table = followed(stand_in, "stand-in")
    assert table["frame"].tolist() == [0, 1, 2]
    np.testing.assert_allclose(table["ms"], [3.0, 7.0, 5.0])
    np.testing.assert_allclose(table["ratio"], [1.5, 3.5, 2.5])
    assert table["present"].tolist() == [True, True, False]
    np.testing.assert_allclose(table["mm"], [1.0, np.nan, np.inf])
    np.testing.assert_allclose(table["deg"], [0.0, np.nan, np.inf], atol=1e-6)


def test_each_draw_is_followed_for_itself(stand_in):
    table = followed(stand_in, "stand-in", draws=2)
    assert table["frame"].tolist() == [0, 0, 1, 1, 2, 2]
    assert table["draw"].tolist() == [0, 1] * 3
    np.testing.assert_allclose(table["ms"], [3.0, 7.0, 5.0, 1.0, 2.0, 4.0])
    np.testing.assert_allclose(table["ratio"], table["ms"] / 2)  # the blobs' of the first draw
    # a follower's number is its own: the third pose is that of the third instant
    np.testing.assert_allclose(table["mm"], [1.0, 1.0, np.nan, np.nan, np.inf, np.inf])


def test_the_draws_of_an_instant_have_noise_of_their_own():
    job = job_of(Film("task", 10.0, 0, 1))
    (instant,) = taken(job, 3)
    first, second, third = (images[0].astype(float) for images in instant)
    np.testing.assert_array_equal(first, take(job, 0, 0))
    # two draws of noise, of some grey levels each
    for a, b in ((first, second), (second, third)):
        assert abs(np.mean(a - b)) < 0.05
        assert 1.5 < np.std(a - b) / np.sqrt(2) < 6


@pytest.mark.parametrize(("method", "most_mm"), [("patches", 0.1), ("paper's chain", 1.0)])
def test_both_ways_to_follow_measure_the_task(method, most_mm):
    table = followed(Film("task", 10.0, 0, 2), method)
    assert (table["mm"].iloc[-1:] < most_mm).all()
    assert (table[["ms", "blobs_ms"]] > 0).all(axis=None)


# --- the table


def test_what_was_before_is_kept_and_the_rest_is_new(monkeypatch):
    rows = {"motion": "hard", "exposure_ms": 10.0, "seed": 0, "frame": [0, 1]}
    new = pd.DataFrame({**rows, "blobs_ms": [1.0, 3.0], "ratio": [2.0, 3.0], "mm": 0.1})
    stored = pd.DataFrame({**rows, "blobs_ms": 9.0, "before": [70.0, 80.0], "before_mm": 0.2})
    monkeypatch.setattr(instant_times, "all_followed", lambda films, method, workers: new)
    monkeypatch.setattr(instant_times, "load_sweep", lambda name: stored.iloc[1:])
    table = make_table(1)
    assert list(table) == [*KEYS, "blobs_ms", "before", "after", "before_mm", "after_mm"]
    assert table["after"].tolist() == [2.0, 3.0]
    assert table["blobs_ms"].tolist() == [2.0, 2.0]
    np.testing.assert_array_equal(table["before"], [np.nan, 80.0])
    np.testing.assert_array_equal(table["before_mm"], [np.nan, 0.2])
    assert table["after_mm"].tolist() == [0.1, 0.1]


def test_the_shipped_table_is_that_of_the_films():
    table = load_sweep("instant_times")
    wanted = [(*film[:3], frame) for film in films() for frame in range(film.instants)]
    assert list(table[KEYS].itertuples(index=False, name=None)) == wanted
    assert (table[["blobs_ms", "before", "after"]] > 0).all(axis=None)


def test_the_data_say_with_which_code_it_was_before():
    root = Path(__file__).resolve().parents[3]
    assert BEFORE in (root / "data" / "README.md").read_text()
