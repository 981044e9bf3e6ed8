"""The run of the protocol: its stored draws come out again, and its results follow from them."""

import claims
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from trinolab.datasets import data_path
from workbench.studies.claim_draws import TRIALS
from workbench.studies.protocol import load_claims, load_trials
from workbench.studies.ranges import load_ranges

QUICK = ("concealed", "forecast", "calibration", "rendered_mean", "recorded_instant")
ROWS = load_trials()
DRAWS = pd.read_csv(data_path("claims_draws.csv"))
RESULTS = pd.read_csv(data_path("claims_results.csv"))
FROM_THE_CLOCK = {"time_searched"}


def draws_of(table, name):
    """The draws of a trial from a table as `claims.table_of_draws` gives it."""
    draws = {}
    for row in table[table["trial"] == name].itertuples():
        draws.setdefault(int(row.k), {})[str(row.check)] = (float(row.a), float(row.b))
    return [draws[k] for k in sorted(draws)]


def draws_come_out_again(name, numbers):
    stored = draws_of(DRAWS, name)
    for k in numbers:
        drawn = TRIALS[name](k, ROWS[name].seed)
        # a range that was not run yet is drawn and not stored
        assert set(stored[k]) <= set(drawn)
        for check in set(stored[k]) - FROM_THE_CLOCK:
            # six digits are stored, and processors differ in the last ones
            assert drawn[check] == pytest.approx(stored[k][check], rel=1e-4, abs=1e-6), check


@pytest.mark.parametrize("name", QUICK)
def test_a_stored_draw_comes_out_again(name):
    draws_come_out_again(name, [0])


@pytest.mark.heavy
@pytest.mark.parametrize("name", sorted(set(DRAWS["trial"])))
def test_every_stored_draw_comes_out_again(name):
    if name == "slave":
        pytest.importorskip("mink", reason="the extra 'slave' is missing")
    draws_come_out_again(name, range(ROWS[name].draws))


@pytest.mark.parametrize("name", sorted(set(RESULTS["trial"])))
def test_results_follow_from_the_stored_draws(name):
    again = claims.results_of(name, ROWS[name], draws_of(DRAWS, name))
    stored = RESULTS[RESULTS["trial"] == name].reset_index(drop=True)
    assert list(again["check"]) == list(stored["check"])
    numbers = ["value", "low", "high", "n", "draws", "seed"]
    # both tables have six digits
    assert np.allclose(again[numbers], stored[numbers], rtol=2e-5, atol=1e-6, equal_nan=True)
    assert (stored["draws"] == ROWS[name].draws).all()
    assert (stored["seed"] == ROWS[name].seed).all()


def test_every_stored_result_is_a_check_of_its_trial():
    wanted = {(c.check, c.trial) for c in load_claims() if c.trial}
    wanted |= {(check, one.trial) for one in load_ranges() for check in one.checks.values()}
    assert set(zip(RESULTS["check"], RESULTS["trial"], strict=True)) <= wanted


# --- the intervals


SHARE = stats.binomtest(18, 20).proportion_ci(method="wilson")
MEAN = stats.ttest_1samp([1.0, 2.0, 4.0, 9.0], 0.0).confidence_interval()
ALL = stats.binomtest(24, 24).proportion_ci(method="wilson")


@pytest.mark.parametrize(
    ("statistic", "a", "b", "value", "expected"),
    [
        ("share", np.arange(20) < 18, 1.0, 0.9, SHARE),
        ("mean", [1.0, 2.0, 4.0, 9.0], 1.0, 4.0, MEAN),
        ("ratio", np.full(24, 3.0), 3.0, 1.0, ALL),  # draws that all agree are not certain
    ],
)
def test_intervals_are_scipys(statistic, a, b, value, expected):
    pairs = np.column_stack(np.broadcast_arrays(a, b)).astype(float)
    found, interval = claims.estimated(pairs, statistic)
    assert found == value
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))


# --- the run
