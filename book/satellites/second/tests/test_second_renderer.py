"""The estimators on the second renderer's images: the shipped table, and how it is shown."""

from itertools import product

import numpy as np
import pytest
import second_renderer as study
from scipy.spatial.transform import RigidTransform

from satellites.second import recipe
from trinolab.datasets import load_sweep
from trinolab.methods import BEST
from workbench.studies.replication import EVERY, Deviation
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
    assert set(TABLE["n"]) == {20 + recipe.RANDOM_POSES, recipe.FILM_FRAMES}


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
@pytest.mark.parametrize("handle_name", recipe.HANDLES)
def test_all_rows_of_our_bench_are_made_again(handle_name):
    shooting = recipe.stills(handle_name)
    truths = list(shooting.truth)
    found = study.measured(study.ours(truths, shooting.handle), truths, shooting.handle)
    assert len(found) == len(recipe.RIGS) * len(EVERY)
    for (rig, estimator), deviations in found.items():
        assert_is_shipped(deviations, OURS, rig, handle_name, estimator)


# --- how the table is made, without Mitsuba


def test_a_recording_is_rendered_once_for_each_recipe(tmp_path, monkeypatch):
    """And the one that there is stays."""
    shooting, rendered = recipe.recordings()["film"], []
    brighter = shooting._replace(gains=[1.1, *shooting.gains[1:]])

    def write(shooting, folder):
        rendered.append(shooting)
        folder.mkdir()

    monkeypatch.setattr(recipe, "write_recording", write)
    folders = []
    for film in (shooting, shooting, brighter):
        monkeypatch.setattr(recipe, "recordings", lambda film=film: {"film": film})
        folders.append(study.recorded("film", tmp_path / "new" / "kept"))
    assert rendered == [shooting, brighter]
    assert folders[0] == folders[1] != folders[2]
    assert set((tmp_path / "new" / "kept").iterdir()) == set(folders)


TRUTHS = [RigidTransform.from_translation([0.0, 0.0, z]) for z in (500.0, 600.0)]
