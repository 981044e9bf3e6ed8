"""The answer in four sentences: each of its numbers computed in another way, and one that the
tables do not carry stops the build.
"""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from trinolab.datasets import data_path, load_sweep
from workbench.studies import answer

FACTS = answer.facts()


def test_the_printed_table_gives_the_printed_mean():
    assert FACTS.E_t_mm == pytest.approx(6.2418 / 20, abs=5e-6)  # added up by hand


def test_errors_of_the_assumed_sizes_make_a_twenty_fifth():
    """Of the mean square after registration by all poses; the sum of squares of the five sources."""
    table = pd.read_csv(data_path("sweeps", "budget.csv"))
    rows = table[table.registration == "20 poses"].set_index("source").rms_E_t_mm
    known = rows[["pixel noise", "centroid bias", "calibration", "platform", "printed digits"]]
    assert FACTS.assumed_share == pytest.approx((known**2).sum() / rows["Table 1"] ** 2, rel=0.05)
    assert f"{FACTS.assumed_share:.0%}" == "4%"


def test_the_smooth_share_is_chances():
    # independent, normal, equal errors have the beta distribution with 3 and 24
    expected = stats.beta(3, 24).cdf(0.0814818)  # data/sweeps/patterns.csv
    assert FACTS.smooth_p == pytest.approx(expected, abs=4 * np.sqrt(expected / 4000))


def test_constants_make_most_of_the_angles_by_hand():
    # means 0.71, 0.52, 0.64 deg and standard deviations 0.25, 0.29, 0.29 of twenty
    constant = np.square([0.71, 0.52, 0.64]).sum()
    scatter = 19 / 20 * np.square([0.25, 0.29, 0.29]).sum()
    assert FACTS.constant_share == pytest.approx(constant / (constant + scatter), abs=0.01)


def test_models_that_err_by_cameras_alone_are_all_refused():
    patterns = load_sweep("patterns")
    assert len(FACTS.by_cameras) == 5
    assert set(FACTS.by_cameras) <= set(patterns.model)
    assert max(FACTS.by_cameras.values()) < 0.05


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"E_t_mm": 0.4}, "printed table is indeed"),
        ({"smooth_p": 0.999}, "independent from pose to pose"),
        ({"isotropic_p": 0.01}, "in each direction"),
        ({"by_images": (FACTS.by_images[0]._replace(refused=3.0),)}, "Whatever their size"),
        ({"elongation": 1.5}, "much larger in one direction"),
        ({"by_images": (FACTS.by_images[0]._replace(at_most=0.6),)}, "they explain at most"),
        ({"assumed_share": 0.6}, "the sizes that we assume"),
        ({"constant_share": 0.3}, "mostly constant"),
        ({"left": ("clamped anew",)}, "too few to tell"),
    ],
)
def test_a_part_that_does_not_hold_stops_the_build(change, part):
    with pytest.raises(ValueError, match=f"answer: '{part}' does not hold"):
        answer.sentence(FACTS._replace(**change))
