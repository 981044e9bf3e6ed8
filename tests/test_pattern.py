"""The statistics of the pattern by hand, and p-values that a model's own tables give."""

import numpy as np
import pytest
from scipy import stats

from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.studies.budget import STATISTICS, compare, statistics
from trinolab.studies.deviations import Errors, drawn, exact, first_order
from trinolab.studies.error_sources import make_trial, pixel_noise

TABLE = load_table1()
TRUTHS = TABLE.set_poses
OBSERVED = statistics(exact([TABLE.measured], TRUTHS), TRUTHS)[0]


@pytest.fixture(scope="module")
def noise():
    return pixel_noise(make_trial(load_rig("paper_pair"), load_handle("paper"), TRUTHS), 0.02)


def test_of_table_1_by_hand():
    """Digits of the printed table; rows 1, 2 and 4 are those with |beta| above 75 deg."""
    alpha = np.array(
        [
            0.7,
            0.6,
            0.7,
            1,
            1,
            0.5,
            0.9,
            0.6,
            0.5,
            0.8,
            0.9,
            0.5,
            0.2,
            0.6,
            0.9,
            0.7,
            1.2,
            0.5,
            1,
            0.4,
        ]
    )
    near = np.isin(np.arange(1, 21), [1, 2, 4])
    rest = (alpha - alpha.mean()) ** 2
    growth = np.sqrt(rest[near].mean() / rest[~near].mean())
    t = stats.ttest_1samp(alpha, 0.0).statistic
    np.testing.assert_allclose(OBSERVED[[0, 2]], [growth, t], rtol=1e-9)
    np.testing.assert_allclose(OBSERVED[2:5], [12.75, 7.98, 9.72], atol=0.01)


def test_scale_does_not_matter():
    errors = exact([TABLE.measured], TRUTHS)
    larger = Errors(*(7.0 * part for part in errors))
    np.testing.assert_allclose(statistics(larger, TRUTHS)[0], OBSERVED, rtol=1e-12)


def test_depth_by_hand():
    position = np.zeros((20, 3))
    position[::2] = [1.0, 1.0, 3.0]
    errors = Errors(position, np.random.default_rng(0).standard_normal((20, 3)), np.zeros((20, 3)))
    assert statistics(errors, TRUTHS)[-1] == pytest.approx(3.0)


def test_a_table_of_the_model_itself_is_nothing_unusual(noise):
    tables = first_order(drawn(noise, 5000, np.random.default_rng(0)), TRUTHS)
    own = statistics(first_order(drawn(noise, 200, np.random.default_rng(1)), TRUTHS), TRUTHS)
    p = np.array([compare(tables, TRUTHS, one)["p"] for one in own])
    assert p.shape == (200, len(STATISTICS))
    for column in p.T:
        assert stats.kstest(column, "uniform").pvalue > 0.001
    assert p.min() > 0


def test_p_counts_both_sides_and_the_observed_table_itself():
    errors = Errors(
        np.random.default_rng(0).standard_normal((99, 20, 3)),
        np.random.default_rng(1).standard_normal((99, 20, 3)),
        np.zeros((99, 20, 3)),
    )
    extreme = np.full(len(STATISTICS), 1e6)
    extreme[0] = 0.0
    np.testing.assert_allclose(compare(errors, TRUTHS, extreme)["p"], 2 / 100)
    middle = np.median(statistics(errors, TRUTHS), axis=0)
    assert (compare(errors, TRUTHS, middle)["p"] == 1.0).all()


def test_table_1_against_noise(noise):
    """Chapter 9's finding: offsets, and no growth near the gimbal lock, are not what noise
    makes.
    """
    tables = first_order(drawn(noise, 9999, np.random.default_rng(0)), TRUTHS)
    found = compare(tables, TRUTHS, OBSERVED).set_index("statistic")
    assert found.loc["growth_alpha", "p"] < 0.01
    assert found.loc["growth_gamma", "p"] < 0.05
    assert (found.loc[["offset_alpha", "offset_beta", "offset_gamma"], "p"] <= 2e-4).all()
    assert found.loc["depth", "p"] > 0.1
