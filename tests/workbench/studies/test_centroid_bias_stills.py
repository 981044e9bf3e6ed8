"""Stills of the handle: their truth, what is hostile about them, and the bias of a turned marker's
centroid.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trinolab.bench.optics import Bench
from trinolab.markers import find_markers
from workbench.paper.errata.markers import last_threshold_alone
from workbench.studies.centroid_bias import hostile_stills, inward, still, still_view

QUIET = Bench(shading=0, shot_variance=0, read_noise=0)


@pytest.fixture(scope="module")
def cases():
    return hostile_stills(Bench(), np.random.default_rng(0))


def test_the_view_is_about_the_axis():
    assert still_view().project([[0.0, 0.0, 570.0]]).tolist() == [[160.0, 160.0]]


def test_a_still_knows_its_markers():
    taken = still(Rotation.from_euler("Y", 180, degrees=True), Bench(), np.random.default_rng(0))
    assert taken.image.shape == (320, 320)
    assert taken.image.dtype == np.uint8
    # from 57 mm off the axis
    assert taken.slants_deg == pytest.approx(np.repeat([0.0, 60.5], [2, 4]), abs=1.1)
    found = find_markers(taken.image, 12).uv
    # of the steep ones
    assert np.linalg.norm(found[:, None] - taken.uv, axis=2).min(axis=0).max() < 1.5


def test_each_hostile_case_is_what_it_says(cases):
    assert list(cases) == ["standard scene", "bridges", "bright background", "glint"]
    plain, bridges, wall, glint = cases.values()
    assert np.unique(bridges.image).tolist() == [45, 120, 220]
    assert len(bridges.uv) == 8
    assert np.median(wall.image) > 120 > np.median(plain.image)
    u, v = plain.uv[0].round().astype(int)
    assert glint.image[v, u] == 255
    assert plain.image[v, u] < 255


def test_the_last_threshold_alone_loses_what_all_find(cases):
    counts = {name: len(last_threshold_alone(case.image, 12, 1.5)) for name, case in cases.items()}
    assert counts["standard scene"] >= 6
    assert counts["bridges"] == 0
    assert len(find_markers(cases["bridges"].image, 12).uv) == 8


def test_nothing_in_a_flat_image():
    assert last_threshold_alone(np.full((20, 20), 7), 12, 1.5).shape == (0, 2)


def test_the_bias_is_inwards_and_grows():
    slant, shift = (np.ravel(part) for part in inward(10.0, QUIET, np.random.default_rng(0)))
    by_slant = [shift[np.abs(slant - s) < 3].mean() for s in (10, 50, 70)]
    assert by_slant == sorted(by_slant)
    assert 0.1 < by_slant[0] < 0.2  # px; 0.9 sin 10 deg
    assert inward(10.0, QUIET, np.random.default_rng(0), draws=3)[1].shape == (3, 6)


def test_a_dark_image_has_no_shift():
    dark = Bench(body_grey=0, marker_grey=0, background_grey=0)
    assert np.isnan(inward(10.0, dark, np.random.default_rng(0))[1]).all()
