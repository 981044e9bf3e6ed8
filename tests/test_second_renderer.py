"""The estimators on the second renderer's images: the shipped table, and how it is shown."""

from itertools import product

import numpy as np
import pytest

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.camera import Rig
from trinolab.datasets import load_sweep
from trinolab.methods import BEST, ESTIMATORS
from trinolab.second import recipe
from trinolab.studies import second_renderer as study
from trinolab.studies.replication import Deviation, deviation, measure_frames
from trinolab.studies.second_renderer import OURS, SECOND

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
    lost = Deviation(*[np.nan] * 4)
    row = study.judged([Deviation(1.0, 6.0, 1.0, 2.0), Deviation(3.0, 2.0, 1.0, 2.0), lost])
    assert (row["n"], row["measured"], row["wrong"]) == (3, 2, 2)
    assert (row["mean_mm"], row["mean_deg"]) == (2.0, 4.0)
    assert row["error_by_sigma_mm"] == pytest.approx(np.sqrt(5))
    assert (row["error_by_sigma_low_mm"], row["error_by_sigma_high_mm"]) == (1.0, 3.0)
    assert np.isnan(study.judged([lost])["mean_mm"])


def test_table_is_whole():
    keys = ["handle", "renderer", "rig", "estimator"]
    stills = product(recipe.HANDLES, (SECOND, OURS), recipe.RIGS, ESTIMATORS)
    film = (recipe.FILM_HANDLE, SECOND, recipe.FILM_RIG, study.FILM)
    assert list(TABLE[keys].itertuples(index=False, name=None)) == [*stills, film]
    assert set(TABLE["n"][:-1]) == {20 + recipe.RANDOM_POSES}
    assert TABLE["n"].iloc[-1] == recipe.FILM_FRAMES
    for unit, what in product(("mm", "deg"), ("{}_", "error_by_sigma_{}_")):
        low, high = (TABLE[what.format(end) + unit] for end in ("low", "high"))
        middle = TABLE[what.format("mean").replace("_mean", "") + unit]
        assert (low <= middle * (1 + DIGITS)).all()
        assert (middle <= high * (1 + DIGITS)).all()


def test_side_by_side_has_the_own_bench_beside_the_other():
    shown = study.side_by_side(TABLE, (BEST,))
    assert len(shown) == len(recipe.HANDLES) * len(recipe.RIGS) + 1
    for row in shown[:-1].to_dict("records"):
        keys = row["rig"], row["handle"], BEST
        other, own = shipped(SECOND, *keys), shipped(OURS, *keys)
        assert (row["mm"], row["mm, own"]) == (other["mean_mm"], own["mean_mm"])
        assert row["by sigma, deg"] == other["error_by_sigma_deg"]
        assert row["by sigma, deg, own"] == own["error_by_sigma_deg"]
    film = shown.iloc[-1]
    assert film["estimator"] == study.FILM
    assert np.isnan(film["mm, own"])


@pytest.mark.heavy
def test_a_row_of_our_bench_is_made_again():
    shooting, (left, right, *_) = recipe.stills("coded"), recipe.four_cameras().cameras
    found = []
    for k, T in enumerate(shooting.truth):
        images = [
            render(camera, shooting.handle, T, Bench(), np.random.default_rng([recipe.SEED, k, c]))
            for c, camera in enumerate((left, right))
        ]
        how = {BEST: study.EVERY[BEST]}
        (m,) = measure_frames([images], Rig((left, right)), shooting.handle, how)[BEST]
        found.append(deviation(m.pose, T, shooting.handle))
    assert_is_shipped(found, OURS, "paper_pair", "coded", BEST)


@pytest.mark.heavy
@pytest.mark.parametrize("handle_name", recipe.HANDLES)
def test_all_rows_of_our_bench_are_made_again(handle_name):
    shooting = recipe.stills(handle_name)
    truths = list(shooting.truth)
    found = study._measured(study._ours(truths, shooting.handle), truths, shooting.handle)
    assert len(found) == len(recipe.RIGS) * len(ESTIMATORS)
    for (rig, estimator), deviations in found.items():
        assert_is_shipped(deviations, OURS, rig, handle_name, estimator)
