"""The estimators on the second renderer's images: the shipped table, and how it is shown."""

from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import second_renderer as study
from scipy.spatial.transform import RigidTransform

from satellites.second import recipe
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.datasets import load_handle, load_sweep
from trinolab.methods import BEST
from trinolab.pose import LOST, Pose
from workbench.studies import replication
from workbench.studies.replication import EVERY, Deviation, deviation, measure_frames
from workbench.studies.second_renderer import FILM, OURS, SECOND, side_by_side

TABLE = load_sweep("second_renderer")
DIGITS = 1e-5  # of the shipped table


def shipped(renderer, rig, handle, estimator):
    """The one row."""
    rows = TABLE.query(
        "renderer == @renderer and rig == @rig and handle == @handle and estimator == @estimator"
    )
    (row,) = rows.to_dict("records")
    return row


def assert_is_shipped(found, *keys):
    stored = shipped(*keys)
    for name, value in study.judged(found).items():
        assert stored[name] == pytest.approx(value, rel=DIGITS), name


def test_a_row_by_hand():
    """Errors of 1 and 3 mm with sigmas of 1 mm: the rms of error by sigma is root 5."""
    lost = Deviation(*[np.nan] * 5)
    row = study.judged(
        [Deviation(1.0, 6.0, 1.0, 2.0, 9.0), Deviation(3.0, 2.0, 1.0, 2.0, 9.0), lost]
    )
    assert (row["n"], row["measured"], row["wrong"]) == (3, 2, 2)
    assert (row["mean_mm"], row["mean_deg"]) == (2.0, 4.0)
    assert row["error_by_sigma_mm"] == pytest.approx(np.sqrt(5))
    assert (row["error_by_sigma_low_mm"], row["error_by_sigma_high_mm"]) == (1.0, 3.0)
    assert np.isnan(study.judged([lost])["mean_mm"])


def test_table_is_whole():
    keys = ["handle", "renderer", "rig", "estimator"]
    stills = product(recipe.HANDLES, (SECOND, OURS), recipe.RIGS, EVERY)
    film = (recipe.FILM_HANDLE, SECOND, recipe.FILM_RIG, FILM)
    assert list(TABLE[keys].itertuples(index=False, name=None)) == [*stills, film]
    assert set(TABLE["n"][:-1]) == {20 + recipe.RANDOM_POSES}
    assert TABLE["n"].iloc[-1] == recipe.FILM_FRAMES
    for unit, what in product(("mm", "deg"), ("{}_", "error_by_sigma_{}_")):
        low, high = (TABLE[what.format(end) + unit] for end in ("low", "high"))
        middle = TABLE[what.format("mean").replace("_mean", "") + unit]
        assert (low <= middle * (1 + DIGITS)).all()
        assert (middle <= high * (1 + DIGITS)).all()


def test_side_by_side_has_the_own_bench_beside_the_other():
    shown = side_by_side(TABLE, (BEST,))
    assert len(shown) == len(recipe.HANDLES) * len(recipe.RIGS) + 1
    for row in shown[:-1].to_dict("records"):
        keys = row["rig"], row["handle"], BEST
        other, own = shipped(SECOND, *keys), shipped(OURS, *keys)
        assert (row["mm"], row["mm, own"]) == (other["mean_mm"], own["mean_mm"])
        assert row["by sigma, deg"] == other["error_by_sigma_deg"]
        assert row["by sigma, deg, own"] == own["error_by_sigma_deg"]
    film = shown.iloc[-1]
    assert film["estimator"] == FILM
    assert np.isnan(film["mm, own"])


@pytest.mark.heavy
def test_a_row_of_our_bench_is_made_again():
    shooting, pair = recipe.stills("coded"), recipe.rigs()["paper_pair"]
    found = []
    for k, T in enumerate(shooting.truth):
        images = [
            render(camera, shooting.handle, T, Bench(), np.random.default_rng([recipe.SEED, k, c]))
            for c, camera in enumerate(pair.cameras)
        ]
        how = {BEST: EVERY[BEST]}
        (m,) = measure_frames([images], pair, shooting.handle, how)[BEST]
        found.append(deviation(m.pose, T, shooting.handle))
    assert_is_shipped(found, OURS, "paper_pair", "coded", BEST)


@pytest.mark.heavy
@pytest.mark.parametrize("handle_name", recipe.HANDLES)
def test_all_rows_of_our_bench_are_made_again(handle_name):
    shooting = recipe.stills(handle_name)
    truths = list(shooting.truth)
    found = study.measured(study.ours(truths, shooting.handle), truths, shooting.handle)
    assert len(found) == len(recipe.RIGS) * len(EVERY)
    for (rig, estimator), deviations in found.items():
        assert_is_shipped(deviations, OURS, rig, handle_name, estimator)


# --- how the table is made, without Mitsuba


@pytest.fixture(scope="module")
def shootings():
    return recipe.recordings()


@pytest.fixture
def kept(tmp_path, monkeypatch, shootings):
    """A folder of recordings that are not rendered; each rendering is noted by its number."""
    rendered = []

    def write(shooting, folder):
        rendered.append(shooting.number)
        folder.mkdir()

    monkeypatch.setattr(recipe, "write_recording", write)
    monkeypatch.setattr(recipe, "recordings", lambda: shootings)
    return tmp_path / "new" / "kept", rendered


def test_a_recording_is_rendered_once(kept):
    folder, rendered = kept
    first = study.recorded("film", folder)
    assert study.recorded("film", folder) == first
    assert first.parent == folder
    assert first.name.startswith("film-")
    assert rendered == [2]


def test_another_recipe_is_another_recording(kept, monkeypatch):
    """And the one that there is stays."""
    folder, rendered = kept
    shooting = recipe.recordings()["film"]
    first = study.recorded("film", folder)
    brighter = shooting._replace(gains=[1.1, *shooting.gains[1:]])
    monkeypatch.setattr(recipe, "recordings", lambda: {"film": brighter})
    second = study.recorded("film", folder)
    assert second != first
    assert {path.name for path in folder.iterdir()} == {first.name, second.name}
    assert rendered == [2, 2]


TRUTHS = [RigidTransform.from_translation([0.0, 0.0, z]) for z in (500.0, 600.0)]


def test_our_frames_are_each_camera_s_of_each_pose_with_noise_of_their_own(monkeypatch):
    """Frames that say who took them, of what, and which number the noise began with."""

    def taken(camera, handle, T, bench, rng):
        return camera.name, handle.name, T.translation[2], rng.random()

    monkeypatch.setattr(study, "render", taken)
    frames = list(study.ours(TRUTHS, load_handle("coded")))
    names = recipe.four_cameras().names
    assert [[one[:3] for one in images] for images in frames] == [
        [(name, "coded", z) for name in names] for z in (500.0, 600.0)
    ]
    noise = [one[3] for images in frames for one in images]
    assert len(set(noise)) == 2 * 4
    assert noise[5] == np.random.default_rng([recipe.SEED, 1, 1]).random()


@pytest.mark.parametrize(("handle_name", "told"), [("paper", True), ("coded", False)])
def test_every_rig_takes_its_own_of_the_four_images(monkeypatch, handle_name, told):
    """The truth tells look-alikes apart, where there are any."""
    asked = []

    def measure_frames(frames, rig, handle, methods, priors):
        asked.append((frames, rig.names, priors))
        return {"paper": [SimpleNamespace(pose=len(asked))]}

    monkeypatch.setattr(replication, "measure_frames", measure_frames)
    monkeypatch.setattr(study, "deviation", lambda pose, T, handle: (pose, T.translation[2]))
    images = [["a", "b", "above", "raised"]] * 2
    found = study.measured(iter(images), TRUTHS, load_handle(handle_name))
    assert [frames for frames, *_ in asked[:3]] == [
        [images[0][:2]],
        [images[0][:3]],
        [["a", "b", "raised"]],
    ]
    assert [names[2:] for _, names, _ in asked[:3]] == [(), ("above",), ("raised",)]
    assert [priors is not None for *_, priors in asked] == [told] * 6
    assert found == {
        (rig, "paper"): [(k, 500.0), (k + 3, 600.0)] for k, rig in enumerate(recipe.RIGS, 1)
    }


def test_the_table_is_of_both_renderers_and_ends_with_the_film(kept, monkeypatch):
    """Deviations that say which images they are of: 1 of the second renderer, 2 of our bench, 3 of
    the film.
    """
    folder, rendered = kept

    def measured(frames, truths, handle):
        return {
            key: [Deviation(mm, 1.0, 1.0, 1.0, 1.0) for mm in frames]
            for key in product(recipe.RIGS, [BEST])
        }

    monkeypatch.setattr(
        study, "open_folder", lambda path: (None, load_handle(path.name.split("-")[1]))
    )
    monkeypatch.setattr(study, "EVERY", {BEST: EVERY[BEST]})
    monkeypatch.setattr(study, "read_poses", lambda path: path)
    monkeypatch.setattr(study, "poses_by_frame", lambda path: dict(enumerate(TRUTHS)))
    monkeypatch.setattr(study, "read", lambda path: [1.0, 1.0])
    monkeypatch.setattr(study, "ours", lambda truths, handle: [2.0] * len(truths))
    monkeypatch.setattr(study, "measured", measured)
    monkeypatch.setattr(study, "followed", lambda path: [Deviation(3.0, 1.0, 1.0, 1.0, 1.0)] * 2)
    table = study.make_table(folder)
    assert rendered == [0, 1, 2]
    keys = ["renderer", "rig", "handle", "estimator"]
    stored = TABLE[TABLE["estimator"].isin([BEST, FILM])].reset_index(drop=True)
    assert table[keys].equals(stored[keys])
    assert list(table.columns) == list(TABLE.columns)
    assert table["mean_mm"][:-1].tolist() == [
        {SECOND: 1.0, OURS: 2.0}[r] for r in table["renderer"][:-1]
    ]
    assert table["mean_mm"].iloc[-1] == 3.0
    assert (table["n"] == 2).all()


def test_the_film_s_poses_are_held_against_the_truth_of_their_frames(monkeypatch):
    """Frames 4 and 7 of it, 1 mm off and lost."""
    handle = load_handle("coded")
    truths = dict(zip((4, 7), TRUTHS, strict=True))
    near = Pose("measured", RigidTransform.from_translation([1.0, 0, 500.0]), np.eye(6), 0.1, 4, 2)

    def track(instants, rig, of, how):
        assert how.estimator == BEST
        for frame, pose in ((4, near), (7, LOST)):
            yield (
                SimpleNamespace(frame=frame),
                SimpleNamespace(measurement=SimpleNamespace(pose=pose)),
            )

    monkeypatch.setattr(study, "open_folder", lambda path: (SimpleNamespace(rig=None), handle))
    monkeypatch.setattr(study, "read_poses", lambda path: path)
    monkeypatch.setattr(study, "poses_by_frame", lambda path: truths)
    monkeypatch.setattr(study, "instants", lambda recording: None)
    monkeypatch.setattr(study, "track_instants", track)
    first, second = study.followed(Path("film"))
    assert (first.mm, first.deg) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-5))
    assert not second.measured
