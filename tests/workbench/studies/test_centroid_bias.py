"""The instruments that hold centroids against their prediction: on errors made by hand, and on
rendered light.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench, blurred
from trinolab.bench.scene import radiance
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle
from workbench.studies.centroid_bias import (
    METHODS,
    centres,
    centroid_errors,
    centroid_report,
    turned_marker,
)

PAPER = load_handle("paper")
MATRIX = [[3000.0, 0, 640], [0, 3000, 512], [0, 0, 1]]
STRAIGHT = Camera("c", (1280, 1024), MATRIX, np.zeros(5), RigidTransform.identity())
OTHER = replace(STRAIGHT, name="d", T_cam_world=RigidTransform.from_translation([-99.0, 0, 0]))
# the handle's axis upwards, column 0 towards the camera, at 540 mm
UPRIGHT = RigidTransform.from_components(
    [0, 0, 545.0], Rotation.from_matrix(np.diag([1.0, -1, -1]))
)


def test_along_is_towards_the_limb_and_across_clockwise():
    # to the right
    turned = UPRIGHT * RigidTransform.from_rotation(Rotation.from_rotvec([0, np.deg2rad(30.0), 0]))
    truth = centres(STRAIGHT, PAPER, turned)
    errors = centroid_errors(STRAIGHT, PAPER, turned, truth[[0, 1, 10, 11]] + [0.25, 0.5], truth)
    assert list(errors["marker"]) == [0, 1, 10, 11]  # columns at 0 and at 300 deg
    right, left = errors[errors["marker"] < 2], errors[errors["marker"] >= 10]
    # the camera is near: not quite 30
    assert right["slant_deg"].to_numpy() == pytest.approx(30.0, abs=0.5)
    # perspective tips the normal's image a little
    assert right["along"].to_numpy() == pytest.approx(0.25, abs=0.02)
    assert right["across"].to_numpy() == pytest.approx(0.5, abs=0.02)
    assert left["along"].to_numpy() == pytest.approx(-0.25, abs=0.02)
    assert left["across"].to_numpy() == pytest.approx(-0.5, abs=0.02)


def test_report_finds_bias_scatter_and_noise():
    """3,000 views of one marker: bias that grows with the slant, scatter from view to view, noise
    from draw to draw.
    """
    rng = np.random.default_rng(0)
    slant, view = np.repeat(rng.uniform(0, 65, 3000), 2), np.repeat(np.arange(3000), 2)
    along = 1e-3 * slant + np.repeat(0.03 * rng.standard_normal(3000), 2)
    along += 0.04 * rng.standard_normal(6000)
    across = 0.02 * rng.standard_normal(6000)
    columns = {"slant_deg": slant, "along": along, "across": across, "view": view}
    errors = pd.DataFrame({"marker": 0, **columns})
    errors.loc[:9, ["along", "across"]] = np.nan
    table = centroid_report(errors)
    assert ", ".join(table["slant_deg"]) == "0-10, 10-20, 20-30, 30-40, 40-50, 50-60, 60-65"
    assert (table["n"].sum(), table["missed"].sum()) == (6000, 10)
    middles = np.array([5, 15, 25, 35, 45, 55, 62.5])
    assert (np.abs(table["bias_along"] - 1e-3 * middles) < 4 * table["se_along"]).all()
    assert (np.abs(table["bias_across"]) < 4 * table["se_across"]).all()
    assert table["scatter_along"].to_numpy() == pytest.approx(0.05, rel=0.15)
    assert table["noise_along"].to_numpy() == pytest.approx(0.04, rel=0.15)
    assert table["noise_across"].to_numpy() == pytest.approx(0.02, rel=0.15)


def test_a_wrapped_markers_centroid_lies_along_the_slant():
    """The axis across the line of sight, a column 50 deg aside: the bias is along the slant alone,
    and towards us.
    """
    turned = UPRIGHT * RigidTransform.from_rotation(Rotation.from_rotvec([0, np.deg2rad(50.0), 0]))
    rig = Rig((STRAIGHT, OTHER))
    images = [blurred(radiance(camera, PAPER, turned, Bench()), Bench()) for camera in rig.cameras]
    steep = {}
    for name, method in METHODS.items():
        found, predicted = method(images, rig, PAPER, turned)
        errors = centroid_errors(STRAIGHT, PAPER, turned, found[0], predicted[0]).dropna()
        steep[name] = errors[errors["slant_deg"] > 45]
        assert len(steep[name]) == 2
    # rows above and below the axis: a little perspective
    assert (np.abs(steep["plain"]["across"]) < 0.08).all()
    assert (steep["plain"]["along"] < -0.2).all()
    assert (np.abs(steep["modelled"]["along"]) < 0.5).all()  # of 1.1: the rest is the detector's
    assert (np.abs(steep["registered"]["along"]) < 0.03).all()


def test_a_turned_marker_is_where_its_light_is_and_the_detector_finds_it_elsewhere():
    """A formula to second order: 3 a^2 / (8 r) times the sine of the slant, towards the middle
    line.
    """
    rig = Rig((STRAIGHT, OTHER))
    for turn_deg in (-55, 0, 30, 60):
        slant, integral, light, detector = turned_marker(turn_deg, rig, PAPER, Bench())
        assert slant == pytest.approx(abs(turn_deg), abs=0.7)
        formula = np.sign(turn_deg) * 3 * 1.5**2 / (8 * 5) * np.sin(np.deg2rad(slant)) * 3000 / 565
        assert integral == pytest.approx(formula, abs=0.03)
        assert integral == pytest.approx(light, abs=0.006)
        assert 0.02 < abs(detector - integral) < 0.6


# --- stills
