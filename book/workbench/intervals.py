"""How sure a number is: bootstrap, order statistics, Wilson, Student, chi-square; and the Allan
deviation.

The rule for a mean error, in every table: percentiles of the mean over rows that are drawn again
(`of_mean`). Where only sums are kept it is the normal interval (`of_sums`), which the other one
approaches, and for a ratio of sums percentiles over blocks (`of_ratio`). Where the protocol of the
claims has frozen Student's t, it stays.

All intervals hold 95 %.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from trinolab.checks import Array, as_array, as_number, as_whole

LEVEL = 0.95
RESAMPLES = 2000
NORMAL = 1.96  # standard deviations, of which the normal distribution holds 95 %
TOGETHER = 15  # instants that follow one another, half a second: their errors depend on each other


class Interval(NamedTuple):
    """Where a number lies with 95 % confidence, and by which method; NaN where that cannot be
    said.
    """

    low: float
    high: float
    how: str


NONE = Interval(np.nan, np.nan, "")


def by_bootstrap(
    values: ArrayLike,
    statistic: Callable[[Array], float],
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Interval:
    """Percentiles of a statistic over resampled rows (Efron 1979, DOI 10.1214/aos/1176344552).

    Parameters
    ----------
    values : array_like, shape (n, ...)
        Rows that are independent of each other.
    statistic : callable
        From rows to a number.
    seed : int
        Of the resampling.
    resamples : int
        How often.
    """
    rows = np.asarray(values, float)
    if len(rows) < 2:
        return NONE
    chosen = np.random.default_rng(seed).integers(len(rows), size=(resamples, len(rows)))
    statistics = [statistic(rows[resample]) for resample in chosen]
    low, high = np.nanquantile(statistics, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(low), float(high), f"bootstrap, {resamples} resamples")


def of_series(
    values: ArrayLike,
    statistic: Callable[[Array], float],
    length: int,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Interval:
    """Of a statistic of instants that follow one another, by drawing blocks of them again: within a
    block they may depend on each other (moving blocks: Kuensch 1989, DOI 10.1214/aos/1176347265).

    Parameters
    ----------
    values : array_like, shape (n, ...)
        In the order of time.
    statistic : callable
        From rows to a number.
    length : int
        Of a block; NaN for fewer than two blocks.
    seed, resamples
        See `by_bootstrap`.
    """
    rows = np.asarray(values, float)
    m = as_whole(length, "length", 1)
    if len(rows) < 2 * m:
        return NONE
    blocks = -(-len(rows) // m)
    begin = np.random.default_rng(seed).integers(len(rows) - m + 1, size=(resamples, blocks))
    chosen = (begin[..., None] + np.arange(m)).reshape(resamples, -1)[:, : len(rows)]
    statistics = [statistic(rows[resample]) for resample in chosen]
    low, high = np.nanquantile(statistics, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(low), float(high), f"bootstrap, {resamples} resamples of blocks of {m}")


def of_mean(values: ArrayLike, seed: int = 0, resamples: int = RESAMPLES) -> Interval:
    """Of the mean of independent values (n,), see `by_bootstrap`."""
    return by_bootstrap(values, lambda rows: float(rows.mean()), seed, resamples)


def of_sums(total: float, squares: float, n: int) -> Interval:
    """Of the mean of n independent values of which only the sum and the sum of squares are kept, by
    the normal distribution; NaN for none.
    """
    if n == 0:
        return NONE
    mean = total / n
    reach = NORMAL * np.sqrt(max(squares / n - mean**2, 0.0) / n)
    return Interval(float(mean - reach), float(mean + reach), "normal")


def of_ratio(totals: ArrayLike, counts: ArrayLike, seed: int = 0) -> Interval:
    """Of a mean that blocks add up to, by drawing blocks again; NaN where nothing was counted.

    Parameters
    ----------
    totals, counts : array_like, shape (n,)
        Of each block the sum of its values, and how many they are.
    seed : int
        Of the resampling.
    """
    pairs = np.column_stack([totals, counts]).astype(float)
    return by_bootstrap(pairs, ratio, seed) if pairs[:, 1].any() else NONE


def ratio(pairs: Array) -> float:
    """The sum of the first column by that of the second; NaN if that is zero."""
    total, count = pairs.sum(axis=0)
    return float(total / count) if count else np.nan


def of_quantile(values: ArrayLike, share: float) -> Interval:
    """Two of the ordered values between which a quantile lies, whatever the distribution (David
    and Nagaraja 2003, Order Statistics, sect. 7.1); NaN where too few values say so.
    """
    rows = as_array(values, "values", (None,))
    p = as_number(share, "share", 0.0, 1.0)
    test = stats.quantile_test(rows, q=float(np.quantile(rows, p)), p=p)
    interval = test.confidence_interval(confidence_level=LEVEL)
    return Interval(float(interval.low), float(interval.high), "order statistics")


def of_student(values: ArrayLike) -> Interval:
    """Of the mean of independent values, by Student's t."""
    x = as_array(values, "values", (None,))
    if len(x) < 2:
        return NONE
    reach = float(stats.t.ppf((1 + LEVEL) / 2, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x)))
    return Interval(float(x.mean()) - reach, float(x.mean()) + reach, "Student's t")


def of_share(count: int, n: int, together: int = 1) -> Interval:
    """Of a share of trials (Wilson 1927, DOI 10.1080/01621459.1927.10502953), of which so many that
    follow one another count as one.
    """
    independent = max(int(n) // together, 1)
    like_count = round(count * independent / n)
    interval = stats.binomtest(like_count, independent).proportion_ci(LEVEL, method="wilson")
    how = "Wilson" if together == 1 else f"Wilson, {together} instants as one"
    return Interval(float(interval.low), float(interval.high), how)


def highest_share(count: int, n: int) -> float:
    """A share that is exceeded with a confidence of 5 % at most, after `count` in `n` trials
    (Clopper and Pearson 1934, one-sided, DOI 10.1093/biomet/26.4.404); 1 without a trial.
    """
    if n == 0:
        return 1.0
    interval = stats.binomtest(int(count), int(n), alternative="less").proportion_ci(
        LEVEL, method="exact"
    )
    return float(interval.high)


def of_slope(times: ArrayLike, values: ArrayLike) -> tuple[float, Interval]:
    """Slope of a line through values over time, and its interval by Student's t: the values scatter
    independently about it.
    """
    t = as_array(times, "times", (None,))
    x = as_array(values, "values", (len(t),))
    line = stats.linregress(t, x)
    reach = float(stats.t.ppf((1 + LEVEL) / 2, len(t) - 2) * line.stderr)
    slope = float(line.slope)
    return slope, Interval(slope - reach, slope + reach, "Student's t")


def allan_deviation(values: ArrayLike, length: int) -> float:
    """Allan deviation of a series: that of the means of `length` values that follow one another,
    overlapping.

    sigma^2 = < (next mean - this mean)^2 > / 2 (Allan 1966, DOI 10.1109/PROC.1966.4634; IEEE Std
    1139; the overlapping estimate: Howe, Allan and Barnes 1981).

    Parameters
    ----------
    values : array_like, shape (n,) or (n, d)
        At equal steps of time; of several columns the variances are added.
    length : int
        At most n / 2.
    """
    rows = np.asarray(values, float)
    rows = rows.reshape(len(rows), -1)
    m = as_whole(length, "length", 1, len(rows) // 2)
    sums = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows - rows[0], axis=0)])
    means = (sums[m:] - sums[:-m]) / m
    steps = means[m:] - means[:-m]
    return float(np.sqrt((steps**2).sum(axis=1).mean() / 2))


def allan_freedom(n: int, length: int) -> float:
    """Degrees of freedom of the overlapping estimate from n values of white noise (Riley 2008, NIST
    SP 1065, white frequency noise): its square is then chi-square over them.
    """
    m = as_whole(length, "length", 1, n // 2)
    phases = n + 1
    return (3 * (phases - 1) / (2 * m) - 2 * (phases - 2) / phases) * 4 * m**2 / (4 * m**2 + 5)


def of_allan(deviation: float, n: int, length: int, series: int = 1) -> Interval:
    """Interval of an Allan deviation over so many series (or columns) of n values of white noise
    each.
    """
    freedom = series * allan_freedom(n, length)
    low, high = (
        deviation * np.sqrt(freedom / stats.chi2.ppf(p, freedom))
        for p in ((1 + LEVEL) / 2, (1 - LEVEL) / 2)
    )
    return Interval(float(low), float(high), "chi-square, white noise")


def octaves(n: int) -> list[int]:
    """Lengths 1, 2, 4, ... of which n values hold at least four."""
    return [2**k for k in range(max(int(np.log2(max(n / 4, 1))), 0) + 1) if 2**k <= n // 2]


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
