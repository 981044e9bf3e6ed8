"""Markers where they are expected: the compiled loop against the form in NumPy and OpenCV, and with
bounds checked.
"""

import os
import subprocess
import sys

import cv2
import markers_reference as reference
import numpy as np
import pytest

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.markers import MarkerParameters, markers_at

RIG = load_rig("raised_40deg")
LENIENT = MarkerParameters(
    diameter_px=(1.0, 80.0), min_axis_ratio=0.0, min_fill=0.3, min_contrast=5.0
)


def check_same(image, uv, reach_px, *args):
    """The same to rounding; returns how many markers there are."""
    found = markers_at(image, uv, reach_px, *args)
    expected = reference.markers_at(image, uv, reach_px, *args)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    return np.isfinite(found[:, 0]).sum()


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
@pytest.mark.parametrize("markers", ["bright", "dark"])
def test_renderings(markers, kind):
    handle = load_handle("coded")
    rng = np.random.default_rng(3)
    T = random_pose(rng)
    images = render_rig(RIG, handle, T, Bench(supersampling=2, marker_supersampling=4), rng)
    count = 0
    for camera, image in zip(RIG.cameras, images, strict=True):
        image = image if handle.markers == markers else 255 - image
        uv = camera.project(T.apply(handle.marker_centres))
        uv += rng.normal(0, 3, uv.shape)
        uv[::5] = np.nan
        count += check_same(image.astype(kind), uv, 21.0, markers)
    assert count > 6


def hostile(rng):
    """A small image: noise of all sizes, with rings whose middle is dark, and discs at its border."""
    shape = rng.integers(1, 60, 2)
    image = rng.uniform(0, 255, shape)
    for _ in range(rng.integers(1, 5)):
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 3))
        centre = tuple(rng.integers(0, 60, 2).tolist())
        grey = rng.uniform(0, 255)
        width = int(rng.choice([-1, 2, 4]))
        cv2.circle(image, centre, int(rng.integers(1, 12)), grey, width)
    return image.astype(np.uint8)


@pytest.mark.parametrize("parameters", [MarkerParameters(), LENIENT], ids=["usual", "lenient"])
def test_hostile_images(parameters):
    rng = np.random.default_rng(0)
    count = 0
    for _ in range(400):
        image = hostile(rng)
        uv = rng.uniform(-3, 63, (12, 2))
        uv[0] = rng.choice([np.nan, -0.5, 0.0, 1e30])
        count += check_same(image, uv, rng.uniform(1, 25), "bright", parameters)
    assert count > 12


def test_a_reach_beyond_all_images():
    image = hostile(np.random.default_rng(1))
    uv = np.full((1, 2), 5.0)
    np.testing.assert_array_equal(markers_at(image, uv, 1e30), markers_at(image, uv, 1e5))


def test_no_light_is_no_marker():
    image = np.zeros((30, 30))
    nothing = MarkerParameters(min_contrast=0.0)
    assert np.isnan(markers_at(image, np.full((1, 2), 15.0), 8.0, "bright", nothing)).all()


@pytest.mark.heavy
def test_no_index_is_out_of_bounds(tmp_path):
    """Compiled anew with bounds checked."""
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    here = f"{__file__}::test_hostile_images"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", here]
    subprocess.run(command, env=environment, check=True)
