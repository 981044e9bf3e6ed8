"""The study of what each assumption is worth: its changes, its comparison, its shipped table."""

import json

import numpy as np
import pandas as pd
import pytest

from trinolab.datasets import data_path
from trinolab.studies import sensitivity
from trinolab.studies.sensitivity import CASES, COLUMNS, NUMBERS, Case, compared, standard

TABLE = pd.read_csv(data_path("sensitivity.csv"))
UNCHANGED = Case("", "", lambda world: world)


def case(assumption, part=""):
    return next(c for c in CASES if c.assumption == assumption and part in c.instead)


@pytest.mark.parametrize("each", CASES, ids=lambda each: f"{each.assumption} {each.instead}")
def test_every_case_changes_something(each):
    before, after = standard(), each.change(standard())
    setups = [
        (w.setup.true_rig.cameras, w.setup.rig.cameras, w.setup.handle, w.setup.bench)
        for w in (before, after)
    ]
    same_poses = np.array_equal(
        before.setup.poses.as_matrix(), after.setup.poses.as_matrix()
    ) and np.array_equal(before.setup.velocity, after.setup.velocity)
    same_rest = (before.parameters, before.told, before.as_printed, before.late_s) == (
        after.parameters,
        after.told,
        after.as_printed,
        after.late_s,
    )
    assert not (same_poses and same_rest and repr(setups[0]) == repr(setups[1]))


def test_a_longer_unit_moves_the_true_cameras_alone():
    world = case("A3").change(standard())
    ratio = world.setup.true_rig.cameras[1].centre / world.setup.rig.cameras[1].centre
    np.testing.assert_allclose(ratio, 1.001)
    np.testing.assert_array_equal(
        world.setup.rig.cameras[1].centre, standard().setup.rig.cameras[1].centre
    )


def test_the_comparison_is_of_pairs_that_both_have():
    before = np.array([1.0, 2.0, np.nan, 4.0])
    after = np.array([1.5, 2.5, 9.0, np.nan])
    first, second, difference, low, high, n = compared(before, after)
    assert (first, second, difference, low, high, n) == (1.5, 2.0, 0.5, 0.5, 0.5, 2)
    assert compared(np.array([np.nan]), np.array([1.0]))[-1] == 0


def test_a_draw_of_a_pose_is_the_same_again_and_another_draw_is_not():
    world = standard()
    once = sensitivity.numbers_of(world, 1, 0)
    assert set(once) == set(NUMBERS)
    assert sensitivity.numbers_of(world, 1, 0) == once
    assert sensitivity.numbers_of(world, 1, 1)["E_t"] != once["E_t"]


def test_the_printed_matrix_costs_what_the_errata_say():
    """0.64 mm on average over Table 1, by another computation: exact pixels, no image."""
    rows = TABLE[(TABLE["assumption"] == "A4") & (TABLE["number"] == "E_t")]
    assert rows["changed"].item() == pytest.approx(0.64, abs=0.03)  # mm, beside 0.06 of the images


def test_finished_instants_are_taken_up(tmp_path, monkeypatch):
    asked = []

    def numbers(world, k, draw):
        asked.append((k, draw))
        return dict.fromkeys(NUMBERS, float(k))

    monkeypatch.setattr(sensitivity, "numbers_of", numbers)
    path = tmp_path / "case.jsonl"
    first = sensitivity.run_case(UNCHANGED, path, 1)
    assert asked == [(k, 0) for k in range(20)]
    assert sensitivity.run_case(UNCHANGED, path, 2)[:20] == first
    assert asked[20:] == [(k, 1) for k in range(20)]
    path.write_text(path.read_text() + json.dumps([1]) + "\n")
    assert len(sensitivity.run_case(UNCHANGED, path, 2)) == 40


def test_the_shipped_table_is_of_these_cases():
    assert tuple(TABLE.columns) == COLUMNS
    drawn = TABLE[TABLE["source"] == "rendered"]
    found = list(dict.fromkeys(zip(drawn["assumption"], drawn["instead"], strict=True)))
    assert found == [
        (c.assumption, c.instead) for c in sorted(CASES, key=lambda c: int(c.assumption[1:]))
    ]
    assert set(drawn["seed"]) == {sensitivity.SEED}
    assert set(drawn["draws"]) == {sensitivity.DRAWS}
    good = drawn.dropna(subset="difference")
    np.testing.assert_allclose(
        good["difference"], good["changed"] - good["as_assumed"], atol=2e-5 * 90
    )  # six digits are kept
    assert (
        (good["low"] <= good["difference"] + 1e-9) & (good["difference"] <= good["high"] + 1e-9)
    ).all()


@pytest.mark.parametrize(
    "rows", [sensitivity.of_table1, sensitivity.of_workspace, sensitivity.of_sweeps]
)
def test_what_needs_no_image_is_that_of_the_shipped_table(rows):
    for row in rows():
        shown = TABLE[
            (TABLE["assumption"] == row[0])
            & (TABLE["instead"] == row[1])
            & (TABLE["number"] == row[2])
        ]
        assert shown["changed"].item() == pytest.approx(row[6], rel=1e-4)
