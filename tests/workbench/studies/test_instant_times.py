"""The study of an instant's time: its films, what a row says, and what of the shipped table is kept."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.bench.scenario import take
from trinolab.datasets import load_real_sets, load_rig, load_sweep, real_set
from trinolab.files.fetch import why_not
from trinolab.pose import LOST, Pose
from workbench.studies import instant_times
from workbench.studies.instant_times import (
    BEFORE,
    FILMS,
    FPS,
    IN_CHAPTER,
    KEYS,
    METHODS,
    Film,
    by_film,
    chapter_rows,
    fast,
    film_rows,
    films,
    followed,
    job_of,
    make_tables,
    real,
    taken,
)
from workbench.studies.real_recordings import at_times, load_trajectories

needs_recording = pytest.mark.skipif(
    real_set("trajectories") is None,
    reason=f"no trajectories: {why_not(load_real_sets()['trajectories'])}",
)


# --- the films


def test_films_have_two_exposures_of_what_is_smeared():
    kinds = {film[:2] for film in FILMS}
    smeared = {(motion, ms) for motion in ("hard", "fast") for ms in (6.0, 10.0)}
    assert kinds == smeared | {(name, 10.0) for name in ("calm", "task", "silent", "real")}


def test_each_film_has_its_share_of_the_instants_in_draws_of_its_noise():
    for film, whole in zip(films(4000), FILMS, strict=False):
        assert film == whole._replace(instants=min(500, whole.instants), draws=film.draws)
        assert 500 <= film.instants * film.draws < 500 + film.instants


def test_fewer_instants_are_the_first_ones_of_each_film():
    few = films(60)
    assert {film.instants for film in few} == {8}
    assert {film.draws for film in few} == {1}
    with pytest.raises(ValueError, match="instants: expected"):
        films(1)


def test_a_recording_that_is_not_here_is_left_out_with_a_line(monkeypatch, capfd):
    monkeypatch.setattr(instant_times, "load_trajectories", lambda: None)
    monkeypatch.delenv("TRINOLAB_DATA", raising=False)
    assert [film.motion for film in films()] == [film.motion for film in FILMS[:-1]]
    assert capfd.readouterr().err == "real: left out, TRINOLAB_DATA is not set\n"
    with pytest.raises(ValueError, match="real: TRINOLAB_DATA is not set"):
        job_of(FILMS[-1])


def test_the_silent_rig_has_lenses_with_distortion_and_says_nothing():
    silent, calm = (job_of(Film(motion, 10.0, 0, 40)) for motion in ("silent", "calm"))
    assert silent.rig.covariance is None
    assert calm.rig.covariance is not None
    corner = [[0.0, 0.0]]
    for bent, straight in zip(silent.rig.cameras, calm.rig.cameras, strict=True):
        off = bent.ideal_pixels(corner) - straight.ideal_pixels(corner)
        assert 8 < np.linalg.norm(off) < 16
    np.testing.assert_array_equal(
        silent.shots[-1].T_world_handle.as_matrix(), calm.shots[-1].T_world_handle.as_matrix()
    )


@needs_recording
def test_the_real_hand_keeps_its_pace_and_size():
    times = np.arange(300) / FPS
    shots = real(load_rig("raised_40deg"), times, 0)
    places = np.array([shot.T_world_handle.translation for shot in shots])
    recorded = at_times(load_trajectories(), times + 0.005).translation
    np.testing.assert_allclose(np.diff(places, axis=0), np.diff(recorded, axis=0), atol=1e-9)
    velocities = np.array([shot.velocity for shot in shots])
    middle = (places[2:] - places[:-2]) * FPS / 2
    assert np.median(np.linalg.norm(velocities[1:-1] - middle, axis=1)) < 20  # mm/s, of 330
    assert np.median(np.linalg.norm(velocities, axis=1)) == pytest.approx(330, abs=50)


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
    with pytest.raises(ValueError, match=r"motion: expected one of calm, .*, real, task, got wild"):
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
    assert table["possible"].tolist() == [True, True, False]
    np.testing.assert_allclose(table["mm"], [1.0, np.nan, np.inf])
    np.testing.assert_allclose(table["deg"], [0.0, np.nan, np.inf], atol=1e-6)
    np.testing.assert_allclose(table["nees"], [1.0, np.nan, np.nan])  # 1 mm, of a sigma of 1 mm


def test_each_draw_is_followed_for_itself(stand_in):
    table = followed(stand_in._replace(draws=2), "stand-in")
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
    new = pd.DataFrame({**rows, "draw": 0, "blobs_ms": [1.0, 3.0], "ratio": [2.0, 3.0], "mm": 0.1})
    stored = pd.DataFrame({**rows, "blobs_ms": 9.0, "before": [70.0, 80.0], "before_mm": 0.2})
    monkeypatch.setattr(instant_times, "load_sweep", lambda name: stored.iloc[1:])
    more = [new, new.assign(draw=1, ratio=9.0), new.assign(motion="silent")]
    table = chapter_rows(pd.concat(more))
    assert list(table) == [*KEYS, "blobs_ms", "before", "after", "before_mm", "after_mm"]
    assert table["after"].tolist() == [2.0, 3.0]
    assert table["blobs_ms"].tolist() == [2.0, 2.0]
    np.testing.assert_array_equal(table["before"], [np.nan, 80.0])
    np.testing.assert_array_equal(table["before_mm"], [np.nan, 0.2])
    assert table["after_mm"].tolist() == [0.1, 0.1]


def instants(count=60, draws=2, **columns):
    """Rows of a film in which nothing is special."""
    rng = np.random.default_rng(3)
    frame, draw = (axis.ravel() for axis in np.mgrid[:count, :draws])
    shape = {"motion": "calm", "exposure_ms": 10.0, "seed": 0, "frame": frame, "draw": draw}
    errors = {"mm": rng.uniform(1, 3, len(frame)), "deg": 0.5, "nees": rng.chisquare(6, len(frame))}
    ms = rng.uniform(10, 20, len(frame))
    times = {"ms": ms, "ratio": ms / 40, "blobs_ms": 40.0, "possible": True}
    return pd.DataFrame({**shape, **times, **errors, **columns})


def test_a_film_has_times_errors_share_and_nees_with_intervals():
    table = instants()
    table.loc[table["frame"] < 10, ["mm", "deg", "nees"]] = np.nan  # not measured
    table.loc[table["frame"] < 5, "possible"] = False
    film, both = film_rows(table).to_dict("records")
    assert (film["n"], film["draws"], film["wrong"]) == (120, 2, (table["mm"] > 2).sum())
    for name, share in {"median": 0.5, "99": 0.99, "999": 0.999, "worst": 1.0}.items():
        assert film[f"ms_{name}"] == pytest.approx(np.quantile(table["ms"], share), abs=1e-4)
        assert film[f"ratio_{name}"] == pytest.approx(film[f"ms_{name}"] / 40, abs=1e-4)
    assert film["measured"] == pytest.approx(100 * 50 / 55, abs=1e-4)
    assert film["mean_mm"] == pytest.approx(table["mm"].mean(), abs=1e-4)
    assert film["rms_mm"] == pytest.approx(np.sqrt((table["mm"] ** 2).mean()), abs=1e-4)
    assert film["rms_deg"] == film["mean_deg"] == 0.5
    assert film["nees"] == pytest.approx(table["nees"].mean(), abs=1e-4)
    for name in ("ratio_median", "ratio_99", "measured", "mean_mm", "rms_mm", "nees"):
        assert film[f"{name}_low"] < film[name] < film[f"{name}_high"] + 1e-5
    assert both["motion"] == "all"
    assert both["n"] == 120


def test_an_interval_counts_the_draws_of_an_instant_as_one():
    """Draws that are alike tell nothing new."""
    one = instants(draws=1)
    again = pd.concat([one.assign(draw=draw) for draw in range(5)])
    first, fifth = (film_rows(table).iloc[0] for table in (one, again))
    for name in ("mean_mm_low", "mean_mm_high", "ratio_median_low", "nees_high"):
        assert first[name] == fifth[name]


def test_a_film_of_less_than_a_second_has_no_interval_and_a_wrong_pose_counts_where_nobody_is():
    table = instants(12, mm=np.inf, deg=np.inf, nees=np.nan, possible=False)
    film = film_rows(table).iloc[0]
    assert film["wrong"] == 24
    assert np.isnan(film[["mean_mm", "nees", "measured", "ratio_median_low"]].astype(float)).all()


def test_finished_films_are_kept(monkeypatch, tmp_path):
    taken_up, stops = [], [True]

    def follow(film, method):
        if stops and len(taken_up) == 3:
            raise KeyboardInterrupt
        taken_up.append(film)
        keys = dict(zip(KEYS[:3], film[:3], strict=True))
        return instants(film.instants, film.draws, **keys)

    monkeypatch.setattr(instant_times, "followed", follow)
    with pytest.raises(KeyboardInterrupt, match=r"^3 of \d+ runs are kept"):
        make_tables(320, 1, tmp_path)
    stops.clear()
    of_instants, of_films = make_tables(320, 1, tmp_path)
    chosen = films(320)
    assert sorted(taken_up) == sorted(chosen)  # each of them once
    assert of_films["motion"].tolist() == [*(film.motion for film in chosen), "all"]
    assert len(of_instants) == sum(film.instants for film in chosen[: len(IN_CHAPTER)])


def test_the_shipped_table_is_that_of_the_films():
    table = load_sweep("instant_times")
    wanted = [(*film[:3], frame) for film in IN_CHAPTER for frame in range(film.instants)]
    assert list(table[KEYS].itertuples(index=False, name=None)) == wanted
    assert (table[["blobs_ms", "before", "after"]] > 0).all(axis=None)


def test_the_shipped_table_has_all_films():
    table = load_sweep("instant_films")
    assert table["motion"].tolist() == [*(film.motion for film in FILMS), "all"]
    films_alone = table[table["motion"] != "all"]
    assert films_alone["n"].sum() == table["n"].iloc[-1]
    assert (films_alone["n"] >= 100).all()
    assert by_film(table)["film"].tolist()[:2] == ["hard, 10 ms", "hard, 6 ms"]


def test_the_data_say_with_which_code_it_was_before():
    root = Path(__file__).resolve().parents[3]
    assert BEFORE in (root / "data" / "README.md").read_text()
