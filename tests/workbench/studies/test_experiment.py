"""Powers against simulated experiments."""

import numpy as np
import pytest
from scipy import stats

from trinolab.datasets import load_table1
from workbench.studies.experiment import fewest, power_of_ratio, told_apart

TRUTHS = load_table1().set_poses


def test_power_against_drawn_variances():
    rng = np.random.default_rng(0)
    a = 2.0 * rng.standard_normal((20_000, 30)) ** 2
    b = rng.standard_normal((20_000, 54)) ** 2
    found = a.mean(axis=1) / b.mean(axis=1) > stats.f.ppf(0.95, 30, 54)
    assert power_of_ratio(2.0, 30, 54) == pytest.approx(found.mean(), abs=0.01)


def test_the_fewest_reach_the_power_and_one_less_does_not():
    def power(n):
        return power_of_ratio(3.0, n - 1, 40)

    n = fewest(power, 0.9)
    assert power(n) >= 0.9 > power(n - 1)
    with pytest.raises(ValueError, match="wanted: expected a power that"):
        fewest(lambda n: 0.5, 0.9)


def test_a_turned_platform_tells_fixture_from_cameras():
    eight = TRUTHS[[0, 3, 5, 8, 10, 13, 16, 18]]
    constants = (0.71, 0.52, 0.64)
    assert told_apart(eight, 30.0, constants, 0.28, 200, np.random.default_rng(0)) > 0.95
    # not turned, both are the same; without constants little tells
    still = told_apart(eight, 0.0, constants, 0.28, 200, np.random.default_rng(0))
    assert still < 0.95
    none = told_apart(eight, 30.0, (0.0, 0.0, 0.0), 0.28, 400, np.random.default_rng(0))
    assert none < 0.8  # the scatter alone, which is in the fixture's angles, helps a little
