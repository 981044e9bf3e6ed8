"""The error budget: its sums, its exact chain, and the shipped tables against lines
computed anew.
"""

import budget as module
import numpy as np
import pandas as pd
import pytest
from budget import (
    REGISTRATIONS,
    Images,
    exact_tables,
    line,
)

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1
from workbench.studies import error_sources as sources
from workbench.studies.accounts import clamped_anew, misaligned
from workbench.studies.deviations import (
    MEANS,
    exact,
    together,
)
from workbench.studies.error_sources import make_trial
from workbench.studies.pattern import (
    STATISTICS,
    holm,
    pattern_table,
    statistics,
)

RMS = [f"rms_{name}" for name in MEANS]
IMAGES = ["pixel noise", "centroid bias"]
CERTAIN = [*IMAGES, "calibration", "platform", "printed digits"]
KNOWN = [*CERTAIN, "R_rl as printed", "one focal length"]


@pytest.fixture(scope="module")
def trial():
    return make_trial(load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses)


@pytest.fixture(scope="module")
def table():
    return load_sweep("budget").set_index(["registration", "source"])


# --- the shipped tables


@pytest.mark.parametrize("registration", REGISTRATIONS)
def test_lines_of_the_budget_are_computed_again(table, trial, registration):
    sigma = table.loc[(registration, "pixel noise"), "size"]
    for source in (
        sources.pixel_noise(trial, sigma),
        sources.printed_matrix(trial),
        sources.one_focal_length(trial),
        sources.platform(trial, 0.02),
        sources.printed_digits(trial),
        sources.lens_distortion(trial, -0.05),
    ):
        again = line(source, trial, REGISTRATIONS[registration])
        stored = table.loc[(registration, source.name)]
        np.testing.assert_allclose(
            [again[c] for c in (*MEANS, *RMS)],
            stored[[*MEANS, *RMS]].astype(float),
            rtol=1e-4,
            atol=1e-9,
        )


@pytest.mark.parametrize("registration", REGISTRATIONS)
def test_sums_of_squares_are_the_lines_added_up(table, registration):
    rows = table.loc[registration]
    assert list(rows.index)[:7] == KNOWN
    for name, some in (
        ("images: root of sum of squares", IMAGES),
        ("certain: root of sum of squares", CERTAIN),
        ("as printed: root of sum of squares", KNOWN),
    ):
        total = np.sqrt((rows.loc[some, RMS].astype(float) ** 2).sum())
        np.testing.assert_allclose(rows.loc[name, RMS].astype(float), total, rtol=1e-4)


def test_patterns_are_computed_again():
    """The two accounts, which need no rendered frame."""
    stored = load_sweep("patterns")
    assert (stored.groupby("model").size() == len(STATISTICS)).all()
    assert (stored["n"] == module.PATTERN_TABLES).all()
    tested = stored[~stored["fitted"]]
    np.testing.assert_allclose(tested["p_holm"], holm(tested["p"]), rtol=1e-4)
    printed = load_table1()
    truths = printed.set_poses
    errors = exact([printed.measured], truths)
    accounts = [(misaligned(errors, truths), ()), (clamped_anew(errors, truths), ())]
    again = pattern_table(
        accounts, truths, statistics(errors, truths)[0], module.PATTERN_TABLES, module.SEED
    )
    rows = stored[stored["model"].isin(again["model"])].reset_index(drop=True)
    same = ["model", "statistic", "observed", "model_median", "model_low", "model_high", "p"]
    pd.testing.assert_frame_equal(again[same], rows[same], rtol=1e-4, atol=5e-4)


# --- how they are made


def test_exact_tables_hold_bias_printed_matrix_and_one_focal_length(trial):
    """Without noise and calibration error the exact chain is near the sum of the three to first
    order, and without the program's mistakes near the bias.
    """
    uv = trial.uv + 0.1 * np.random.default_rng(0).standard_normal(trial.uv.shape)
    given = trial, Images(uv, 0.0, []), np.zeros((14, 14)), 1
    (alone,) = exact_tables(*given, as_printed=False)
    (poses,) = exact_tables(*given, as_printed=True)
    found = exact([poses], trial.truths)
    bias = sources.centroid_bias(trial, uv)
    others = [sources.printed_matrix(trial), sources.one_focal_length(trial)]
    expected = together([bias, *others], "all")
    without = exact([alone], trial.truths)
    np.testing.assert_allclose(without.position_mm[0], bias.fixed[:, :3], atol=0.04)
    np.testing.assert_allclose(without.turns_deg[0], bias.fixed[:, 3:], atol=0.4)
    np.testing.assert_allclose(found.position_mm[0], expected.fixed[:, :3], atol=0.04)
    np.testing.assert_allclose(found.turns_deg[0], expected.fixed[:, 3:], atol=0.4)
    assert np.abs(bias.fixed[:, 3:]).max() > 1.5
    assert np.linalg.norm(together(others, "others").fixed[:, :3], axis=1).min() > 0.3
