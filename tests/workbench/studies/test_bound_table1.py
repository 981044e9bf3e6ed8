"""The Cramer-Rao bounds of Table 1's poses: that the shipped table is what the code makes, and
makes sense.
"""

from itertools import product

import numpy as np
import pytest

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1
from workbench.studies import bound
from workbench.studies.bound import COLUMNS, RIGS, SHIPPED_PIXELS, Bound, pose_bound, table1_bounds

TABLE = load_sweep("bound").set_index(["rig", "pixels", "row"])
# Tables have six digits. Between instruction sets their numbers differ by at most 1.3e-11 of
# themselves (make verify ARGS="--only spread --groups tables").
DIGITS = 1e-5


def test_table_has_every_pose():
    assert list(TABLE.index) == [
        (rig, pixels, row) for rig in RIGS for pixels in SHIPPED_PIXELS for row in range(1, 21)
    ]
    assert tuple(TABLE.columns) == COLUMNS
    assert (TABLE > 0).all(axis=None)


def test_a_third_camera_and_more_pixels_never_take_information_away():
    for three in RIGS[1:]:
        assert (
            TABLE.loc[three, ["rms_mm", "rms_deg"]] < TABLE.loc["paper_pair", ["rms_mm", "rms_deg"]]
        ).all(axis=None)
    markers, around = (
        TABLE.xs(pixels, level="pixels")[["rms_mm", "rms_deg"]] for pixels in SHIPPED_PIXELS
    )
    assert (around < 1.001 * markers).all(axis=None)


@pytest.mark.heavy
def test_one_row_is_made_again():
    for pixels in SHIPPED_PIXELS:
        made = pose_bound(
            load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses[4], None, pixels
        )
        row = TABLE.loc["paper_pair", pixels, 5]
        assert [getattr(made, name) for name in COLUMNS] == pytest.approx(list(row), rel=DIGITS)


def test_cameras_of_the_pair_are_asked_once_for_all_rigs(monkeypatch):
    asked = []

    def one(camera, handle, T, *_):
        asked.append(camera.name)
        return np.eye(6)

    monkeypatch.setattr(bound, "information", one)
    bound.kept_information.cache_clear()
    bounds = [table1_bounds(rig) for rig in RIGS]
    bound.kept_information.cache_clear()
    assert [asked.count(name) for name in ("ccd1", "ccd2", "ccd3")] == [20, 20, 40]
    assert [found[7].covariance[0, 0] for found in bounds] == pytest.approx([1 / 2, 1 / 3, 1 / 3])


def test_the_table_has_each_rig_s_bounds_row_by_row(monkeypatch):
    """Bounds that grow from pose to pose, and say which rig and pixels they are of."""
    size = {(rig, pixels): k for k, (rig, pixels) in enumerate(product(RIGS, SHIPPED_PIXELS), 1)}

    def bounds(rig, pixels):
        return [Bound((size[rig, pixels] * row) ** 2 * np.eye(6)) for row in range(1, 21)]

    monkeypatch.setattr(bound, "table1_bounds", bounds)
    table = bound.sweep_bounds().set_index(["rig", "pixels", "row"])
    assert table.index.equals(TABLE.index)
    assert tuple(table.columns) == COLUMNS
    one = table.loc["paper_trinocular", "around", 7]
    sigma = 4 * 7
    assert one["rms_mm"] == pytest.approx(sigma * np.sqrt(3))
    assert one["mean_deg"] == pytest.approx(np.rad2deg(sigma * np.sqrt(8 / np.pi)), rel=1e-6)
