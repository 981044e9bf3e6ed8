"""The carrier of tables: rows of a trial, draws, what is kept, and what a test makes again."""

from dataclasses import replace

import pandas as pd
import pytest

from workbench.studies import carrier
from workbench.studies.carrier import Table, make_tables, results_of

DONE = []
STOP_AT = []


@pytest.fixture(autouse=True)
def fresh():
    DONE.clear()
    STOP_AT.clear()


def power(base, exponent):
    """A row, or two for the base 3."""
    row = {"name": "power", "value": base**exponent}
    return [row, {"name": "root", "value": base ** (1 / exponent)}] if base == 3 else row


def scattered(size, draw):
    if draw in STOP_AT:
        raise KeyboardInterrupt
    DONE.append((size, draw))
    return {"value": size + draw, "unit": "mm"}


def mean_and_count(draws):
    return {"n": len(draws), "value": draws["value"].mean()}


POWERS = Table(
    "powers", power, [{"base": [2, 3], "exponent": [1, 2]}], by=("base", "exponent", "name")
)
SCATTER = Table(
    "scatter",
    scattered,
    [{"size": [1.0], "draw": [0]}, {"size": [5.0, 7.0]}],
    by=("size",),
    draws=3,
    summary=mean_and_count,
    again={"size": 7.0},
)


def test_a_trial_may_give_several_rows_and_each_has_its_setting():
    assert POWERS.make().to_dict("records") == [
        {"base": 2, "exponent": 1, "name": "power", "value": 2},
        {"base": 2, "exponent": 2, "name": "power", "value": 4},
        {"base": 3, "exponent": 1, "name": "power", "value": 3},
        {"base": 3, "exponent": 1, "name": "root", "value": 3},
        {"base": 3, "exponent": 2, "name": "power", "value": 9},
        {"base": 3, "exponent": 2, "name": "root", "value": pytest.approx(3**0.5)},
    ]


def test_columns_are_chosen_and_a_setting_that_does_not_identify_a_row_is_left_out():
    assert list(replace(POWERS, columns=("value", "base")).make()) == ["value", "base"]
    assert list(replace(POWERS, by=("base", "name")).make()) == ["base", "name", "value"]


def test_draws_are_summed_up_row_by_row():
    assert SCATTER.make().to_dict("records") == [
        {"size": 1.0, "n": 1, "value": 1.0},
        {"size": 5.0, "n": 3, "value": 6.0},
        {"size": 7.0, "n": 3, "value": 8.0},
    ]
    assert SCATTER.make(draws=5)["n"].tolist() == [1, 5, 5]


def test_one_setting_is_made_again():
    assert SCATTER.make_again().to_dict("records") == [{"size": 7.0, "n": 3, "value": 8.0}]
    assert DONE == [(7.0, 0), (7.0, 1), (7.0, 2)]


def test_what_is_finished_is_taken_up_and_no_table_is_half_written(tmp_path):
    kept = tmp_path / "kept"
    STOP_AT.append(2)
    with pytest.raises(KeyboardInterrupt, match="3 of 7 runs are kept"):
        make_tables([SCATTER], tmp_path, kept)
    assert not (tmp_path / "scatter.csv").exists()
    STOP_AT.clear()
    DONE.clear()
    make_tables([SCATTER, POWERS], tmp_path, kept)
    assert DONE == [(5.0, 2), (7.0, 0), (7.0, 1), (7.0, 2)]
    assert (tmp_path / "scatter.csv").read_text() == "size,n,value\n1,1,1\n5,3,6\n7,3,8\n"
    assert len(pd.read_csv(tmp_path / "powers.csv")) == 6
    assert not list(kept.iterdir())


SETTINGS = [{"size": 1, "draw": draw} for draw in range(3)]


def values(kept, made_from="this"):
    return [one["value"] for one in results_of("sizes", scattered, SETTINGS, 1, kept, made_from)]


def test_what_is_kept_belongs_to_what_it_was_made_from(tmp_path):
    kept = tmp_path / "new" / "kept.jsonl"
    for made_from, count in (("this", 3), ("this", 3), ("other", 6)):
        assert values(kept, made_from) == [1, 2, 3]
        assert len(DONE) == count


def test_some_tables_are_made_and_an_unknown_one_is_refused(tmp_path):
    make_tables([SCATTER, POWERS], tmp_path, tmp_path / "kept", ["powers"])
    assert not (tmp_path / "scatter.csv").exists()
    with pytest.raises(ValueError, match="name: expected one of scatter, powers, got 'colour'"):
        make_tables([SCATTER, POWERS], tmp_path, tmp_path / "kept", ["colour"])


def test_runs_of_a_sweep_that_fail_are_counted():
    with pytest.raises(
        ValueError, match="powers: 1 of 2 runs failed; the first: ZeroDivisionError"
    ):
        carrier.all_runs("powers", power, {"base": [0, 2], "exponent": [-1]}, None, 1)
