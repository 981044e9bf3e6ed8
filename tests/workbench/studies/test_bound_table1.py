"""The Cramer-Rao bounds of Table 1's poses: that the shipped table makes sense."""

import numpy as np
import pytest

from trinolab.datasets import load_sweep
from workbench.studies import bound
from workbench.studies.bound import COLUMNS, RIGS, SHIPPED_PIXELS, table1_bounds

TABLE = load_sweep("bound").set_index(["rig", "pixels", "row"])


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
