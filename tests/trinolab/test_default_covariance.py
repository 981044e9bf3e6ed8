"""What is taken for a rig and a handle that state nothing: it shifts images by what it says, leaves
single parameters loose, and is said.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from trinolab.camera import Rig, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.default_covariance import (
    FREEDOM,
    IMAGE_PX,
    PLACEMENT_MM,
    assumed,
    known_covariance,
    known_placement_mm,
    known_scale_share,
    usual_covariance,
)

CODED, RAISED = load_handle("coded"), load_rig("raised_40deg")
UNPLACED, SILENT = replace(CODED, placement_sigma_mm=None), Rig(RAISED.cameras)


def parallel():
    first = RAISED.cameras[0]
    beside = displaced(SILENT, np.r_[np.zeros(12), -100, 0, 0, np.zeros(30)]).cameras[0]
    return Rig((first, replace(beside, name="beside")))


@pytest.mark.parametrize(
    ("rig", "middle"),
    [
        (load_rig("paper_pair"), (0, 0, 549)),  # where the optical axes meet
        (load_rig("paper_trinocular"), (0, 0, 549)),
        (parallel(), (50, 0, 500)),  # five baselines ahead
    ],
    ids=["pair", "three", "parallel"],
)
def test_the_image_of_the_work_is_shifted_by_what_is_said(rig, middle):
    """By the slopes of the images: differences of displaced rigs."""
    places = np.array(middle) + [[0.0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30]]
    steps = 1e-4 * np.eye(15 * len(rig.cameras))
    slopes = np.stack(
        [
            np.stack([camera.project(places) for camera in displaced(rig, step).cameras])
            - [camera.project(places) for camera in rig.cameras]
            for step in steps
        ],
        axis=-1,
    ).reshape(-1, len(steps))
    for px in (IMAGE_PX, 1.0):
        covariance = slopes @ usual_covariance(rig, px).matrix @ slopes.T * 1e8
        covariance = covariance.reshape(len(rig.cameras), 4, 2, len(rig.cameras), 4, 2)
        for c in range(len(rig.cameras)):
            for d in range(2):
                own = covariance[c, :, d, c, :, d]
                np.testing.assert_allclose(np.sqrt(np.diag(own)), px, rtol=0.15)
                # beside each other places move alike
                assert np.diag(own - own.mean(axis=0)).mean() < (0.25 * px) ** 2


def test_what_is_stated_counts_and_what_is_not_is_usual():
    assert known_covariance(RAISED) is RAISED.covariance
    for rig, px in ((SILENT, IMAGE_PX), (replace(SILENT, reprojection_px=0.7), 0.7)):
        usual = known_covariance(rig)
        np.testing.assert_array_equal(usual.matrix, usual_covariance(SILENT, px).matrix)
        assert (usual.is_exact, usual.freedom) == (False, FREEDOM)
    assert (known_placement_mm(CODED), known_scale_share(CODED)) == (0.0, 0.0)
    assert (known_placement_mm(UNPLACED), known_scale_share(UNPLACED)) == (PLACEMENT_MM, 0.002)


ASSUMED = [
    (RAISED, CODED, []),
    # a quarter of chi-square with half a degree of freedom lies beyond 0.521, three beyond 0.00528
    (SILENT, CODED, ["r.toml: .* 0.24 to 2.4 px per image"]),
    (replace(SILENT, reprojection_px=0.21), CODED, ["r.toml: .* 0.21 to 2 px per image"]),
    (RAISED, UNPLACED, ["h.toml: .* = 0.05 is assumed, .* right to 0.2 %"]),
    (SILENT, UNPLACED, ["r.toml", "h.toml"]),
]


@pytest.mark.parametrize(("rig", "handle", "said"), ASSUMED)
def test_what_was_assumed_is_said_in_a_line(rig, handle, said):
    lines = assumed(rig, handle, "r.toml", "h.toml")
    assert len(lines) == len(said)
    for line, words in zip(lines, said, strict=True):
        assert re.match(words, line)
