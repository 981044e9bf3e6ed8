"""Exercises of chapter 4: the Kalman filter."""

from __future__ import annotations

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


def filter_number(observations, mean, variance, growth, noise):
    """Filter the observations of one number.

    Before each observation the variance grows. Then the mean moves towards the observation.

    Parameters
    ----------
    observations
        (n,), in their order.
    mean, variance
        What is known before the first one.
    growth
        Q, by which the variance grows before each observation.
    noise
        R, the variance of an observation.

    Returns
    -------
    list
        The n means, one after each observation.
    """
    means = []
    for observed in observations:
        variance = variance + growth
        gain = variance / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


def _filter_cases(rng):
    return [
        (rng.normal(5, 2, 6).tolist(), 0.0, 4.0, growth, noise)
        for growth, noise in ((0.0, 1.0), (0.5, 1.0), (2.0, 0.3), (0.1, 5.0))
    ]


def _variance_never_corrected(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        mean = mean + variance / (variance + noise) * (observed - mean)
        means.append(mean)
    return means


def _growth_after(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        gain = variance / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance + growth
        means.append(mean)
    return means


def _gain_of_noise(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        gain = noise / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


def _only_last(observations, mean, variance, growth, noise):
    return filter_number(observations, mean, variance, growth, noise)[-1]


EXERCISES = (
    ValueExercise(
        "04.1",
        "pencil",
        "A second observation",
        "ex-kalman-gain",
        2,
        (
            Mistake(
                "The gain is the noise's share. It has to be the guess's share of the innovation's "
                "variance: a certain guess moves little.",
                "4, One number first",
                {"gain": 1 / 1.8},
            ),
            Mistake(
                "This is the variance before the second observation. An observation makes it smaller.",
                "4, One number first",
                {"variance": 0.8},
            ),
            Mistake(
                "You have started from the first guess again, and have forgotten the first "
                "observation.",
                "4, One number first",
                {"mean": 6.8},
            ),
        ),
        {
            "gain": Asked(0.8 / 1.8, within=0.005),
            "mean": Asked(6 + 2 * 0.8 / 1.8, within=0.01),
            "variance": Asked(0.8 / 1.8, within=0.005),
        },
    ),
    FunctionExercise(
        "04.2",
        "write",
        "A filter of one number",
        "ex-kalman-write",
        4,
        (
            Mistake(
                "The variance is never corrected: after an observation it has to shrink by the "
                "factor 1 - gain.",
                "4, One number first",
                _variance_never_corrected,
            ),
            Mistake(
                "The variance grows after the observation. It has to grow before it, because time "
                "has passed by then.",
                "4, One number first",
                _growth_after,
            ),
            Mistake(
                "The gain is the noise's share. It has to be the variance's share of the sum.",
                "4, One number first",
                _gain_of_noise,
            ),
            Mistake(
                "Only the last mean is returned. All of them are asked for.",
                "4, Exercises",
                _only_last,
            ),
        ),
        filter_number,
        _filter_cases,
    ),
)
