"""Sizes that are put in come out, and every source of a pair helps."""

import numpy as np
import pytest
from budget import mix, mixes

from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies.deviations import drawn, first_order, means, together
from workbench.studies.error_sources import (
    make_trial,
    pixel_noise,
    platform,
    printed_digits,
    set_angles,
)
from workbench.studies.pattern import scaled

TRUTHS = load_table1().set_poses


@pytest.fixture(scope="module")
def trial():
    return make_trial(load_rig("paper_pair"), load_handle("paper"), TRUTHS)


def test_sizes_are_recovered(trial):
    """Targets from tables of other draws, with known sizes."""
    noise, places, digits = pixel_noise(trial, 0.02), platform(trial, 0.1), printed_digits(trial)
    mixed = together([scaled(noise, 2.0), scaled(places, 0.5), digits], "mixed")
    targets = means(first_order(drawn(mixed, 3000, np.random.default_rng(9)), TRUTHS))[:4]
    found = mix([noise, places], digits, TRUTHS, targets)
    np.testing.assert_allclose([s.size for s in found.sources], [0.04, 0.05], rtol=0.1)
    assert found.misfit < 1.05
    np.testing.assert_allclose(found.means, targets, rtol=0.05)


def test_mixes_are_sorted_and_every_source_of_a_pair_helps(trial):
    free = [pixel_noise(trial, 0.02), platform(trial, 0.1), set_angles(trial, 0.5)]
    found = mixes(free, printed_digits(trial), TRUTHS, [0.31, 0.67, 0.56, 0.65])
    assert [m.misfit for m in found] == sorted(m.misfit for m in found)
    by_name = {tuple(s.name for s in m.sources): m.misfit for m in found}
    assert len(by_name) == len(found) >= 4
    assert {("pixel noise",), ("platform",), ("zeros of the set angles",)} < set(by_name)
    assert ("platform", "zeros of the set angles") in by_name
    assert ("pixel noise", "zeros of the set angles") not in by_name  # the zeros move no position
    for names, misfit in by_name.items():
        assert len(names) == 1 or misfit < min(by_name[(name,)] for name in names)
