"""The best rule that knows two sizes of a rig's errors, against the closed form for one number."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies.silent_size import NOISE_PX, Seen, curve, fixed, seen, sizes

POSES = load_table1().set_poses


def alone(numbers):
    """Six numbers are the pose, and so many more contradict it: each is off by the size."""
    by_motion = np.eye(6 + numbers, 6)
    return Seen(by_motion, np.eye(6 + numbers))


@pytest.mark.parametrize("ratio", [2.0, 4.0])
def test_one_number_by_hand(ratio):
    """|x| < c is called good: of good rigs a = 2 ndtr(c) - 1 of all, of bad ones the same of
    c / ratio. A bad one that is called good has `ratio` squared times its NEES.
    """
    covariances = np.eye(7), ratio**2 * np.eye(7)
    rule = curve([alone(1)], covariances, np.random.default_rng(0), draws=60_000, noise_px=1e-4)
    good = 6 * (0.6 + 0.4 / ratio**2)
    c = ndtri((1 + 0.6) / 2)
    bad_as_good = 2 * ndtr(c / ratio) - 1
    bad = 6 * (bad_as_good * ratio**2 + 1 - bad_as_good)
    # 60,000 draws: the mean of such numbers is known to 0.5 %
    assert rule.bad_where_good_is(good) == pytest.approx(bad, rel=0.03)
    # three of the six numbers are the position
    assert rule.by_sigma_where_good_is(good) == pytest.approx(np.sqrt(good / 6), rel=0.01)


def test_more_numbers_tell_more():
    """Four numbers of chi-square, by its table: 0.73 of the good below 5.15, 0.016 of the bad."""
    covariances = np.eye(10), 3.7**2 * np.eye(10)
    rule = curve([alone(4)], covariances, np.random.default_rng(0), draws=60_000, noise_px=1e-4)
    expected = 6 * (0.0157 * 3.7**2 + 1 - 0.0157)
    assert rule.bad_where_good_is(6 * (0.73 + 0.27 / 3.7**2)) == pytest.approx(expected, rel=0.03)


def test_a_fixed_size_is_right_for_its_own_and_wrong_for_others():
    covariances = np.eye(7), 9 * np.eye(7)
    good, bad = fixed([alone(1)], covariances, 4 * np.eye(7), noise_px=1e-4)
    assert good == pytest.approx(6 / 4, rel=1e-6)
    assert bad == pytest.approx(6 * 9 / 4, rel=1e-6)


@pytest.mark.parametrize("name", ["paper_pair", "raised_40deg"])
def test_who_knows_which_it_is_has_a_nees_of_six(name):
    rig = load_rig(name)
    instants = [seen(rig, load_handle("paper"), T) for T in POSES[::5]]
    both = sizes(rig)
    assert fixed(instants, both, both[0])[0] == pytest.approx(6, rel=1e-6)
    assert fixed(instants, both, both[1])[1] == pytest.approx(6, rel=1e-6)
    ends = curve(instants, both, np.random.default_rng(0), draws=200, noise_px=NOISE_PX)
    # whoever calls all rigs good is right of the good ones; 800 draws of chi-square with six
    assert ends.good[-1] == pytest.approx(6, abs=4 * np.sqrt(12 / 800))
    assert ends.bad[0] == pytest.approx(6, abs=4 * np.sqrt(12 / 800))
