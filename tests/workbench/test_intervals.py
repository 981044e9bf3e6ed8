"""Intervals and the Allan deviation, against closed forms, other algorithms, and counting."""

import numpy as np
import pytest
from scipy import stats

from workbench import intervals
from workbench.intervals import (
    allan_deviation,
    allan_freedom,
    by_bootstrap,
    highest_share,
    octaves,
    of_allan,
    of_quantile,
    of_series,
    of_share,
    of_slope,
    of_student,
    rms,
)


def by_loops(values, m):
    """The overlapping Allan deviation as its definition reads."""
    n = len(values)
    means = [np.mean(values[k : k + m]) for k in range(n - m + 1)]
    steps = [means[k + m] - means[k] for k in range(len(means) - m)]
    return np.sqrt(np.mean(np.square(steps)) / 2)


@pytest.mark.parametrize("m", [1, 2, 5, 10])
def test_allan_deviation_as_defined(m):
    """That of columns adds their variances."""
    values = np.random.default_rng(0).normal(size=(40, 2))
    each = [by_loops(column, m) for column in values.T]
    assert allan_deviation(values[:, 0], m) == pytest.approx(each[0], rel=1e-12)
    assert allan_deviation(values, m) == pytest.approx(np.hypot(*each), rel=1e-12)


@pytest.mark.parametrize("m", [1, 4, 16, 64])
def test_allan_deviation_of_noise_in_closed_form(m):
    """White noise: sigma / sqrt m; a random walk of steps s: s sqrt((2 m^2 + 1) / (6 m)). Of n / m
    means the relative scatter is about sqrt(m / n); five of them.
    """
    n = 40_000
    steps = np.random.default_rng(2).normal(size=n)
    scatter = 5 * np.sqrt(m / n)
    assert allan_deviation(3 * steps, m) == pytest.approx(3 / np.sqrt(m), rel=scatter)
    walk = np.sqrt((2 * m**2 + 1) / (6 * m))
    assert allan_deviation(np.cumsum(steps), m) == pytest.approx(walk, rel=scatter)


@pytest.mark.parametrize("m", [1, 4, 16])
def test_interval_of_an_allan_deviation_holds_95_percent(m):
    n, draws = 128, 2000
    rng = np.random.default_rng(3)
    deviations = np.array([allan_deviation(rng.normal(size=n), m) for _ in range(draws)])
    ends = np.array([of_allan(deviation, n, m)[:2] for deviation in deviations])
    held = ((ends[:, 0] <= 1 / np.sqrt(m)) & (1 / np.sqrt(m) <= ends[:, 1])).sum()
    low, high = stats.binom(draws, 0.95).interval(0.999)
    assert low <= held <= high
    # the variance of a chi-square variable; of 2000 draws the estimate scatters by 4 %
    sampled = 2 * (deviations**2).mean() ** 2 / (deviations**2).var()
    assert allan_freedom(n, m) == pytest.approx(sampled, rel=0.15)


def test_octaves():
    assert octaves(240) == [1, 2, 4, 8, 16, 32]
    assert octaves(12) == [1, 2]
    assert octaves(2) == [1]


def test_wilson_by_its_formula():
    k, n, z = 7, 40, stats.norm.ppf(0.975)
    p = k / n
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low, high, how = of_share(k, n)
    assert (low, high) == pytest.approx((middle - half, middle + half), rel=1e-12)
    assert how == "Wilson"


def test_highest_share_without_a_case_is_the_rule_of_three():
    assert highest_share(0, 512) == pytest.approx(1 - 0.05 ** (1 / 512), rel=1e-9)
    assert highest_share(0, 10_000) == pytest.approx(3 / 10_000, rel=0.01)
    assert highest_share(3, 3) == 1.0


def test_quantile_lies_between_order_statistics():
    """The interval of the median of 1 to 20 is from the 6th to the 15th value (a table of David
    and Nagaraja: 95.9 %).
    """
    low, high, _ = of_quantile(np.arange(1.0, 21.0), 0.5)
    assert (low, high) == (6.0, 15.0)
    low, high, _ = of_quantile(np.arange(20.0), 0.95)  # of too few values there is no upper end
    assert np.isfinite(low)
    assert np.isnan(high)


def test_bootstrap_against_another_program():
    values = np.random.default_rng(7).exponential(size=60)
    low, high, _ = by_bootstrap(values, rms)
    other = stats.bootstrap(
        (values,), lambda rows, axis: np.sqrt((rows**2).mean(axis)), method="percentile", rng=1
    ).confidence_interval
    # the ends of 2000 resamples scatter by 3 % of the interval's length
    scatter = 0.12 * (other.high - other.low)
    assert low == pytest.approx(other.low, abs=scatter)
    assert high == pytest.approx(other.high, abs=scatter)
    # rows are drawn whole: a statistic that is the same for each is the same for each resample
    rows = np.column_stack([np.arange(10.0), -np.arange(10.0)])
    assert by_bootstrap(rows, lambda chosen: float(chosen.sum()))[:2] == (0.0, 0.0)
    assert by_bootstrap([3.0], np.mean) == intervals.NONE


def test_student_by_the_table():
    """Of 1, 2, 3, 4: t of three degrees of freedom is 3.18245."""
    reach = 3.18245 * np.sqrt(5 / 3) / 2
    assert of_student([1, 2, 3, 4])[:2] == pytest.approx((2.5 - reach, 2.5 + reach), rel=1e-5)
    assert of_student([1.0]) == intervals.NONE


def test_slope_against_another_solution():
    rng = np.random.default_rng(6)
    t = np.linspace(0, 5, 30)
    x = 0.3 * t + rng.normal(0, 0.1, 30)
    slope, (low, high, _) = of_slope(t, x)
    coefficients, covariance = np.polyfit(t, x, 1, cov="unscaled")
    variance = ((x - np.polyval(coefficients, t)) ** 2).sum() / 28
    reach = stats.t.ppf(0.975, 28) * np.sqrt(variance * covariance[0, 0])
    assert slope == pytest.approx(coefficients[0], rel=1e-9)
    assert (low, high) == pytest.approx((slope - reach, slope + reach), rel=1e-9)


def test_a_mean_of_a_series_is_held_as_often_as_is_said():
    """Of an autoregression of the first order, whose neighbours agree to 0.8: single instants drawn
    again say an interval of a third of the width.
    """
    rng = np.random.default_rng(5)
    held = alone = 0
    for _ in range(200):
        noise = rng.normal(size=400)
        series = np.zeros(400)
        for k in range(1, 400):
            series[k] = 0.8 * series[k - 1] + noise[k]
        low, high, how = of_series(series, np.mean, 25, resamples=400)
        held += low <= 0 <= high
        low, high, _ = by_bootstrap(series, np.mean, resamples=400)
        alone += low <= 0 <= high
    assert how.endswith("blocks of 25")
    assert held >= 168  # blocks cut a little off: 84 % and more
    assert alone <= 140
    assert np.isnan(of_series(np.arange(19.0), np.mean, 10).low)  # less than two blocks


def test_instants_that_count_as_one_widen_a_share():
    each, together = of_share(90, 300), of_share(90, 300, 15)
    exact = stats.binomtest(6, 20).proportion_ci(0.95, method="wilson")
    assert (together.low, together.high) == pytest.approx((exact.low, exact.high))
    assert together.low < each.low < each.high < together.high
    assert together.how == "Wilson, 15 instants as one"
