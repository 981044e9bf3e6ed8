"""Tables of what the paper leaves open: their numbers are those of the draws, their order is computed."""

import re

import pandas as pd
import pytest

from trinolab.datasets import data_path
from workbench.pages import ranges_pages
from workbench.studies.ranges import load_ranges
from workbench.studies.scoreboard import drawn_results

DRAWS = pd.read_csv(data_path("claims_draws.csv"))


def cells(table):
    """The rows of a table without its head, as lists of cells."""
    rows = re.split(r"^\* - ", table, flags=re.MULTILINE)[2:]
    return [re.split(r"^  - ", row.removesuffix("````"), flags=re.MULTILINE) for row in rows]


def test_every_range_of_a_row_is_in_its_line(board):
    text = ranges_pages.ranges_table(board)
    results = drawn_results()
    for one in load_ranges():
        for no, check in one.checks.items():
            lines = [line for line in cells(text) if f"<claim-{no}>" in line[0]]
            shown = any(one.instead.replace("_", "\\_") in line[2] for line in lines)
            assert shown == (check in results), (no, one.instead)


def test_ten_assumptions_those_that_turn_most_verdicts_first(board):
    rows = cells(ranges_pages.assumptions_table(board))
    assert len(rows) == 10
    found = ranges_pages.moved(board)
    turned = [
        len({one.row.no for one in found if one.turned and f"[{one.other.assumption}]" in row[0]})
        for row in rows
    ]
    assert turned == sorted(turned, reverse=True)
    assert turned[0] > 0


def test_flatness_has_the_means_of_its_draws():
    rows = cells(ranges_pages.flatness_table())
    of_trial = DRAWS[DRAWS["trial"] == "flatness"]
    assert [float(row[0]) for row in rows] == [0, 0.005, 0.01, 0.02]
    for row, name in zip(rows, ("flat", "bent_5um", "bent_10um", "bent_20um"), strict=True):
        costs = of_trial[of_trial["check"] == f"calibration_cost_{name}"]["a"]
        assert float(row[1].split()[0]) == pytest.approx(costs.mean(), rel=5e-3)


def test_rates_are_in_order_with_the_assumed_one_among_them():
    rows = cells(ranges_pages.rates_table())
    rates = [float(row[0]) for row in rows]
    assert rates == sorted(rates)
    assert 0.01 in rates
    line = rows[rates.index(0.05)]
    tracked = DRAWS[DRAWS["check"] == "long_share_tracked_printed_rate_0.05"]
    assert line[1].startswith(f"{tracked['a'].sum():.0f} of {len(tracked)} ")
