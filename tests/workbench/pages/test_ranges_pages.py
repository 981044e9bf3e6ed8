"""Tables of what the paper leaves open: their numbers are those of the draws, their order is computed."""

import pandas as pd
import pytest
from pages import table_of

from trinolab.datasets import data_path
from workbench.studies.ranges import load_ranges
from workbench.studies.scoreboard import drawn_results

DRAWS = pd.read_csv(data_path("claims_draws.csv"))


def test_every_range_of_a_row_is_in_its_line(page):
    rows = table_of(page("report"), "ranges")
    results = drawn_results()
    for one in load_ranges():
        for no, check in one.checks.items():
            lines = [line for line in rows if f"<claim-{no}>" in line[0]]
            shown = any(one.instead.replace("_", "\\_") in line[2] for line in lines)
            assert shown == (check in results), (no, one.instead)


def test_ten_assumptions_those_that_turn_most_verdicts_first(page, numbers):
    rows = table_of(page("article"), "assumptions")
    assert len(rows) == 10
    turned = [
        sum(
            any(f"[{one['assumption']}]" in row[0] and one["turned"] for one in ranged["others"])
            for ranged in numbers["ranges"]
        )
        for row in rows
    ]
    assert turned == sorted(turned, reverse=True)
    assert turned[0] > 0


@pytest.mark.parametrize("name", ["report", "article"])
def test_flatness_has_the_means_of_its_draws(page, name):
    rows = table_of(page(name), "flatness")
    of_trial = DRAWS[DRAWS["trial"] == "flatness"]
    assert [float(row[0]) for row in rows] == [0, 0.005, 0.01, 0.02]
    for row, name in zip(rows, ("flat", "bent_5um", "bent_10um", "bent_20um"), strict=True):
        costs = of_trial[of_trial["check"] == f"calibration_cost_{name}"]["a"]
        assert float(row[1].split()[0]) == pytest.approx(costs.mean(), rel=5e-3)


def test_rates_are_in_order_with_the_assumed_one_among_them(page):
    rows = table_of(page("report"), "rates")
    rates = [float(row[0]) for row in rows]
    assert rates == sorted(rates)
    assert 0.01 in rates
    line = rows[rates.index(0.05)]
    tracked = DRAWS[DRAWS["check"] == "long_share_tracked_printed_rate_0.05"]
    assert line[1].startswith(f"{tracked['a'].sum():.0f} of {len(tracked)} ")
