"""What is taken for a rig and a handle that state nothing: it shifts images by what it says, leaves
single parameters loose, and is said.
"""

from dataclasses import replace

import numpy as np
import pytest

from trinolab.camera import Rig, RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.default_covariance import (
    FREEDOM,
    IMAGE_PX,
    PLACEMENT_MM,
    assumed,
    known_covariance,
    known_placement_mm,
    usual_covariance,
)

CODED = load_handle("coded")
RAISED = load_rig("raised_40deg")
SILENT = Rig(RAISED.cameras)
MIDDLE = np.array([[0.0, 0.0, 549.0]])  # where the optical axes of the three cameras meet


def drawn(rig, matrix, seed, count=400):
    """Rigs as they may be."""
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng = np.random.default_rng(seed)
    return [displaced(rig, root @ rng.standard_normal(len(matrix))) for _ in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])
@pytest.mark.parametrize("px", [IMAGE_PX, 1.0])
def test_the_image_of_the_work_is_shifted_by_what_is_said(name, px):
    rig = load_rig(name)
    places = MIDDLE + [[0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30]]
    shifts = np.array(
        [
            [
                there.project(places) - camera.project(places)
                for there, camera in zip(one.cameras, rig.cameras, strict=True)
            ]
            for one in drawn(rig, usual_covariance(rig, px).matrix, 1)
        ]
    )  # (draws, cameras, places, 2)
    # 400 draws know a standard deviation to 3.5 %
    np.testing.assert_allclose(np.sqrt((shifts**2).mean(axis=0)), px, rtol=0.2)
    # beside each other places move alike
    own = shifts - shifts.mean(axis=2, keepdims=True)
    assert np.sqrt((own**2).mean()) < 0.25 * px


def test_single_parameters_are_looser_than_what_they_do_together():
    sigma = np.sqrt(np.diag(known_covariance(SILENT).matrix)).reshape(3, 15)
    assert (sigma[:, 2:4] > 2 * IMAGE_PX).all()  # principal points
    turn_px = sigma[:, 9:11] * SILENT.cameras[0].focal.mean()
    assert (turn_px > 2 * IMAGE_PX).all()
    assert not sigma[:, 4:9].any()  # distortions


def test_what_is_stated_counts_and_what_is_not_is_usual():
    assert known_covariance(RAISED) is RAISED.covariance
    assert known_covariance(RAISED).is_exact
    usual = known_covariance(SILENT)
    assert not usual.is_exact
    assert usual.freedom == FREEDOM
    np.testing.assert_array_equal(usual.matrix, usual_covariance(SILENT, IMAGE_PX).matrix)
    told = replace(SILENT, reprojection_px=0.7)
    np.testing.assert_array_equal(
        known_covariance(told).matrix, usual_covariance(SILENT, 0.7).matrix
    )
    assert known_placement_mm(CODED) == 0.0
    assert known_placement_mm(replace(CODED, placement_sigma_mm=None)) == PLACEMENT_MM


def test_cameras_with_parallel_axes_are_taken_to_work_ahead():
    first = RAISED.cameras[0]
    beside = displaced(SILENT, np.r_[np.zeros(12), -100, 0, 0, np.zeros(30)]).cameras[0]
    rig = Rig((first, replace(beside, name="beside")))
    ahead = np.array([[50.0, 0.0, 500.0]])
    shifts = [
        np.concatenate([c.project(ahead)[0] for c in one.cameras])
        for one in drawn(rig, usual_covariance(rig).matrix, 2)
    ]
    np.testing.assert_allclose(np.std(shifts, axis=0), IMAGE_PX, rtol=0.2)


def test_what_was_assumed_is_said_in_a_line():
    unplaced = replace(CODED, placement_sigma_mm=None)
    assert assumed(RAISED, CODED, "r.toml", "h.toml") == []
    (line,) = assumed(SILENT, CODED, "r.toml", "h.toml")
    assert line.startswith("r.toml: does not say how well the cameras are known; a usual")
    # a quarter of chi-square with half a degree of freedom lies beyond 0.521, three beyond 0.00528
    assert "0.24 to 2.4 px per image" in line
    (line,) = assumed(replace(SILENT, reprojection_px=0.21), CODED, "r.toml", "h.toml")
    assert "0.21 to 2 px per image" in line
    (line,) = assumed(RAISED, unplaced, "r.toml", "h.toml")
    assert line.startswith("h.toml: does not say how well the markers are placed")
    assert "0.05" in line
    assert len(assumed(SILENT, unplaced, "r.toml", "h.toml")) == 2


def test_a_covariance_says_how_well_its_size_is_known():
    with pytest.raises(ValueError, match="freedom: expected a positive number, got 0"):
        RigCovariance(("a",), np.eye(15), 0)
    exact = RigCovariance.exact(["a", "b"])
    assert exact.is_exact
    assert exact.names == ("a", "b")
    assert not RigCovariance(("a",), np.eye(15)).is_exact


def test_a_part_of_a_rig_is_known_as_well_as_the_whole():
    matrix = np.diag(np.arange(45.0))
    rig = replace(SILENT, covariance=RigCovariance(SILENT.names, matrix, 3.0), reprojection_px=0.2)
    part = rig.part([2, 0])
    assert part.names == ("ccd3", "ccd1")
    expected = np.r_[np.arange(30.0, 45.0), np.arange(15.0)]
    np.testing.assert_array_equal(np.diag(part.covariance.matrix), expected)
    assert part.covariance.freedom == 3.0
    assert part.reprojection_px == 0.2
    assert SILENT.part([0, 1]).covariance is None
