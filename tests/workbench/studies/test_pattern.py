"""The statistics of the pattern by hand, their distribution for white errors, and the size of
a smooth cause against brute force.
"""

import numpy as np
import pytest
from scipy import stats

from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies.deviations import Errors, drawn, exact
from workbench.studies.error_sources import (
    make_trial,
    one_focal_length,
    pixel_noise,
    platform,
    turned_camera,
)
from workbench.studies.pattern import (
    STATISTICS,
    compare,
    filled_up,
    holm,
    largest_size,
    pattern_table,
    rigid_field,
    scaled,
    smooth_share,
    statistics,
    without_field,
)

TABLE = load_table1()
TRUTHS = TABLE.set_poses
OBSERVED = statistics(exact([TABLE.measured], TRUTHS), TRUTHS)[0]


PLACES = TRUTHS.translation
TABLE_MM = TABLE.measured.translation - PLACES


@pytest.fixture(scope="module")
def trial():
    return make_trial(load_rig("paper_pair"), load_handle("paper"), TRUTHS)


@pytest.fixture(scope="module")
def noise(trial):
    return pixel_noise(trial, 0.02)


def test_of_table_1_by_hand():
    """Digits of the printed table; rows 1, 2 and 4 are those with |beta| above 75 deg."""
    printed = "0.7 0.6 0.7 1 1 0.5 0.9 0.6 0.5 0.8 0.9 0.5 0.2 0.6 0.9 0.7 1.2 0.5 1 0.4"
    alpha = np.array(printed.split(), float)
    near = np.isin(np.arange(1, 21), [1, 2, 4])
    rest = (alpha - alpha.mean()) ** 2
    growth = np.sqrt(rest[near].mean() / rest[~near].mean())
    t = stats.ttest_1samp(alpha, 0.0).statistic
    np.testing.assert_allclose(OBSERVED[[0, 2]], [growth, t], rtol=1e-9)
    np.testing.assert_allclose(OBSERVED[2:5], [12.75, 7.98, 9.72], atol=0.01)


def test_a_motion_is_nothing_and_a_stretch_is_smooth():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((20, 3))
    motion = rigid_field(PLACES) @ [0.1, -0.2, 0.3, 0.01, 0.02, -0.01]
    assert np.abs(without_field(motion, rigid_field(PLACES))).max() < 1e-12
    assert smooth_share(PLACES, white + motion) == pytest.approx(smooth_share(PLACES, white))
    stretch = PLACES * [0.001, 0.0, 0.0]
    assert smooth_share(PLACES, stretch) == pytest.approx(1.0)


def test_white_errors_have_the_beta_distribution():
    white = np.random.default_rng(1).standard_normal((3000, 20, 3))
    null = stats.beta(3, 24)
    assert stats.kstest(smooth_share(PLACES, white), null.cdf).pvalue > 0.001
    assert null.mean() == pytest.approx(1 / 9)


def test_p_counts_both_sides_and_the_observed_table_itself():
    white = np.random.default_rng(0).standard_normal((2, 99, 20, 3))
    errors = Errors(*white, np.zeros((99, 20, 3)))
    extreme = np.full(len(STATISTICS), 1e6)
    extreme[0] = 0.0
    np.testing.assert_allclose(compare(errors, TRUTHS, extreme)["p"], 2 / 100)
    middle = np.median(statistics(errors, TRUTHS), axis=0)
    assert (compare(errors, TRUTHS, middle)["p"] == 1.0).all()


def test_holm_by_hand():
    # sorted: 4 x 0.005, 3 x 0.01, 2 x 0.03, 1 x 0.04, none below the one before
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.5, 0.9]), [1.0, 1.0])


def test_a_source_is_filled_up_to_an_rms(trial):
    focal, places = one_focal_length(trial), platform(trial, 0.1)
    model = filled_up(focal, places, TRUTHS, 0.3)
    tables = drawn(model, 4000, np.random.default_rng(0))[..., :3]
    rest = without_field(tables, rigid_field(PLACES))
    assert np.sqrt((rest**2).sum(axis=2).mean()) == pytest.approx(0.3, rel=0.01)
    # what is larger itself stays as it is
    large = scaled(focal, 10.0)
    np.testing.assert_array_equal(filled_up(large, places, TRUTHS, 0.3).fixed, large.fixed)


def test_the_largest_size_is_refused_in_one_of_twenty(trial):
    """At the size found, other draws lie below Table 1 in 5 %; one half larger in fewer."""
    places, rms = platform(trial, 0.1), 0.31323
    rest = without_field(TABLE_MM, rigid_field(PLACES))
    assert np.sqrt((rest**2).sum() / 20) == pytest.approx(rms, rel=1e-3)
    for source in (one_focal_length(trial), turned_camera(trial, 0.02)):
        size, share = largest_size(source, places, TRUTHS, TABLE_MM, 0.05, 1000)
        assert 0 < size < 2 * source.size
        assert 0 < share < 0.7
        below = []
        for factor in (1.0, 1.5):
            model = filled_up(scaled(source, factor * size / source.size), places, TRUTHS, rms)
            some = drawn(model, 4000, np.random.default_rng(7))[..., :3]
            below.append((smooth_share(PLACES, some) <= OBSERVED[-1]).mean())
        assert below[0] == pytest.approx(0.05, abs=0.025)  # 1,000 tables: 0.007
        assert below[1] < below[0] - 0.01


def test_fitted_statistics_are_not_tested(noise):
    names = ["offset_alpha", "depth"]
    table = pattern_table([(noise, names)], TRUTHS, OBSERVED, 199).set_index("statistic")
    assert set(table.index[table["fitted"]]) == set(names)
    assert table.loc[names, "p_holm"].isna().all()
    tested = table[~table["fitted"]]
    np.testing.assert_allclose(tested["p_holm"], holm(tested["p"]))
