"""Drawn rig files before the frames of two renderers: a row by hand, what is measured with what, and
the shipped table.
"""

from pathlib import Path

import drawn_rigs as study
import numpy as np
import pandas as pd
import pytest
from stress import as_row
from tablerows import made_and_stored

from trinolab.datasets import load_rig
from trinolab.methods import BEST
from workbench.studies.replication import EVERY, Deviation
from workbench.studies.second_renderer import OURS

DIGITS = 1e-5  # of the shipped table
GOOD, BAD = study.Level(0.1, 0.005, True), study.Level(0.3, 0.02, True)


def principal_points(rigs):
    return np.array([[camera.principal_point for camera in rig.cameras] for rig in rigs])


def test_files_of_an_instant_are_off_by_new_amounts_and_say_how_much():
    rig = load_rig("paper_pair")
    assert study.drawn(rig, study.EXACT, 3, 0) is rig
    files = [study.drawn(rig, GOOD, 3, draw) for draw in range(200)]
    off = principal_points(files) - principal_points([rig])
    assert off.std() == pytest.approx(0.1, rel=0.1)
    assert np.unique(off).size == off.size
    assert all(one.covariance.matrix[2, 2] == pytest.approx(0.01) for one in files)
    other = study.drawn(rig, GOOD, 4, 0)
    assert (principal_points([other]) != principal_points(files[:1])).all()


def test_a_size_scales_what_was_drawn_and_a_silent_file_says_nothing():
    rig = load_rig("paper_pair")
    good, bad, silent = (
        study.drawn(rig, level, 3, 0) for level in (GOOD, BAD, BAD._replace(stated=False))
    )
    exact = principal_points([rig])
    ratio = (principal_points([bad]) - exact) / (principal_points([good]) - exact)
    np.testing.assert_allclose(ratio, 3.0, rtol=1e-6)
    np.testing.assert_array_equal(principal_points([silent]), principal_points([bad]))
    assert silent.covariance is None


def off(sigmas):
    """Along one axis, by this; none for a lost pose."""
    return as_row(Deviation(*[0.1 * sigmas] * 2, 0.1, 0.1, sigmas**2))


def test_a_row_is_the_mean_over_what_is_measured():
    """Three instants: of two poses one, of two both, of two none."""
    sigmas = [2.0, np.nan, 1.0, 3.0, np.nan, np.nan]
    rows = pd.DataFrame(
        [{"renderer": OURS, "block": k // 2, **off(x)} for k, x in enumerate(sigmas)]
    )
    row = study.row(rows)
    assert (row["n"], row["measured"], row["seed"]) == (6, 3, study.SEED)
    assert row["nees"] == pytest.approx((4 + 1 + 9) / 3)
    # drawn again, single instants have 4 and 5
    assert (row["nees_low"], row["nees_high"]) == pytest.approx((4, 5))
    assert np.isnan(study.row(rows[4:])["nees"])


@pytest.mark.heavy
def test_rows_of_our_bench_are_made_again(monkeypatch):
    """Of the best estimator, with the exact file and silent ones that are off by 0.3 px, before two
    cameras.
    """
    monkeypatch.setattr(study, "EVERY", {BEST: EVERY[BEST]})
    monkeypatch.setattr(study, "RIGS", ("paper_pair",))
    monkeypatch.setattr(study, "LEVELS", (study.EXACT, study.LEVELS[-1]))
    made, stored = made_and_stored("drawn_rigs", study.table(Path()))
    pd.testing.assert_frame_equal(made, stored, rtol=DIGITS, check_dtype=False)
