"""Markers: the threshold's bisection, the filters, the centroid."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy import ndimage

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.blobs import centroid
from trinolab.datasets import load_handle, load_rig
from trinolab.markers import MarkerParameters, blob_at, find_markers, halfway, iterative_threshold


def disc_image(centres, radius=8.0, size=(160, 120), body=90.0, marker=220.0, samples=16):
    """Blurred discs drawn by brute-force supersampling: independent of the package's renderer."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    v = (np.arange(size[1])[:, None] + offsets).ravel()
    u = (np.arange(size[0])[:, None] + offsets).ravel()
    fine = np.full((len(v), len(u)), body)
    for cu, cv in centres:
        fine[np.hypot(u - cu, v[:, None] - cv) <= radius] = marker
    image = fine.reshape(size[1], samples, size[0], samples).mean(axis=(1, 3))
    return cv2.GaussianBlur(image, (0, 0), 0.7)


def nearest(found, truth):
    """Distance of each true point from the nearest found one."""
    return np.linalg.norm(found - np.array(truth)[:, None], axis=2).min(axis=1, initial=np.inf)


TWO, THREE = [(30.2, 30.7), (80.1, 40.4)], [(30, 30), (80, 40), (120, 90)]


@pytest.mark.parametrize("wanted", [1, 3, 5, 12, 1000])
def test_bisection_moves_by_the_papers_rule(wanted):
    """Against SciPy's labels; of three discs there are never five, or twelve."""
    rng = np.random.default_rng(0)
    for image in (disc_image(THREE), cv2.GaussianBlur(rng.uniform(0, 255, (40, 60)), (0, 0), 1.5)):
        low, high, expected = image.min(), image.max(), []
        while high - low >= 1:
            middle = (low + high) / 2
            count = ndimage.label(image > middle, np.ones((3, 3)))[1]
            expected.append((middle, count))
            if count == wanted:
                break
            low, high = (middle, high) if count > wanted else (low, middle)
        assert iterative_threshold(image, wanted) == tuple(expected)


@pytest.mark.slow
def test_discs_are_kept_although_the_search_leaves_them():
    """Wanted are 18: the bisection counts 8, then 4 (the bridges), and ends where no contour is a
    disc.
    """
    centres = [(30 + 45 * k, 40 + 70 * j) for k in range(4) for j in range(2)]
    image = disc_image(centres, size=(200, 150), body=45.0)
    for k in range(4):
        # beyond the blurred edge, so that the centroid is not concerned
        image[49:102, 28 + 45 * k : 33 + 45 * k] = 120
    steps = iterative_threshold(image, 18)
    assert [step.contours for step in steps[:2]] == [8, 4]
    assert len(find_markers(255 * (image > steps[-1].threshold).astype(np.uint8), 12).uv) == 0
    found = find_markers(image, 12)
    assert len(found.uv) == 8
    # px: two rows of the bridge, 5 px wide and 75 grey levels bright, 9 px off, weigh 0.19 against
    # the disc
    assert nearest(found.uv, centres).max() < 0.25


FLANKS = [
    (55.0, 34.0),  # its mean has the flank in it; what is nearer than a fifth of 170 is left
    (190.0, 5.0),
]


@pytest.mark.parametrize(("threshold", "within"), FLANKS)
def test_a_contour_is_taken_again_halfway_up_the_flank(threshold, within):
    """A disc of 210 on 40, found near its foot or its top: half of its height is at 125."""
    image = disc_image([(60, 50)], body=40.0, marker=210.0)
    p = MarkerParameters()
    before = blob_at(image, (60, 50), 17.0, threshold, p)
    after = halfway(image, before, p)
    assert abs(before.threshold - 125) > 60
    assert after.threshold == pytest.approx(125, abs=within)
    assert (after.u, after.v) == pytest.approx((60, 50), abs=0.01)


def test_discs_have_their_centroids_diameters_and_contrasts():
    rng = np.random.default_rng(1)
    truth = np.array([*THREE, (40, 85)]) + rng.uniform(-0.5, 0.5, (4, 2))
    found = find_markers(disc_image(truth), 12)
    assert len(found.uv) == 4
    # px; 16 x 16 samples leave 0.003, float image without noise
    assert nearest(found.uv, truth).max() < 0.01
    np.testing.assert_allclose(found.axes_px, 16, atol=0.5)
    np.testing.assert_allclose(found.contrast, 130, atol=10)
    np.testing.assert_allclose(found.threshold, 155, atol=26)


def test_centroid_by_hand():
    image = np.array([[0, 0, 0], [0, 10, 30]])  # u = (1 * 10 + 2 * 30) / 40, v = 1
    np.testing.assert_allclose(centroid(image, np.ones((2, 3), bool), 0.0), [1.75, 1.0], atol=1e-15)
    # 5 and 25 remain, and -5 of the others does not count
    above = centroid(image, np.ones((2, 3), bool), 5.0)
    np.testing.assert_allclose(above, [(5 + 2 * 25) / 30, 1.0], atol=1e-15)
    assert np.isnan(centroid(np.zeros((3, 4)), np.ones((3, 4), bool), 0.0)).all()


NO_MARKERS = {
    "too long": (cv2.rectangle, (90, 20), (150, 23), 220, -1),
    "too thin": (cv2.rectangle, (100, 20), (130, 22), 220, -1),
    "too small": (cv2.rectangle, (110, 90), (111, 91), 220, -1),
    "not filled": (cv2.circle, (120, 60), 12, 220, 2),
    "a triangle": (cv2.fillConvexPoly, np.array([[108, 75], [132, 75], [120, 54]]), 220),
    "too large": (cv2.rectangle, (80, 5), (155, 115), 220, -1),
    "cut by the edge": (cv2.circle, (159, 60), 8, 220, -1),
    "no contrast": (cv2.circle, (120, 60), 8, 105, -1),
}


@pytest.mark.parametrize("why", NO_MARKERS)
def test_what_is_no_marker_is_dropped(why):
    draw, *form = NO_MARKERS[why]
    image = draw(disc_image([(60.0, 50.0)]), *form)
    found = find_markers(image, 12, parameters=MarkerParameters(diameter_px=(4.0, 40.0)))
    assert len(found.uv) == 1
    np.testing.assert_allclose(found.uv[0], [60, 50], atol=0.02)


def test_a_bright_neighbour_does_not_pull_the_centroid():
    image = disc_image([(60.0, 50.0)])
    image[:, 69:] = 220  # a bright wall one pixel from the disc's edge
    assert nearest(find_markers(image, 12).uv, [(60, 50)]) < 0.1


SCENES = [
    ({"background_grey": 150}, "bright", 1.0),  # as bright as markers
    ({}, "bright", 0.4),  # markers of 6 px
    pytest.param({}, "dark", 1.0, marks=pytest.mark.heavy),
    pytest.param({"read_noise": 8}, "bright", 1.0, marks=pytest.mark.heavy),
    pytest.param({}, "bright", 2.2, marks=pytest.mark.heavy),  # 35 px
]


@pytest.mark.slow
@pytest.mark.parametrize(("options", "markers", "zoom"), SCENES)
def test_all_that_is_truly_seen_is_found_in_whole_frames(options, markers, zoom):
    """Frames of the coded handle in random poses, so large that they are searched at half their size;
    the truth is the renderer's.
    """
    handle, rng, total = replace(load_handle("coded"), markers=markers), np.random.default_rng(7), 0
    for _ in range(2):
        T = random_pose(rng, (-40, 40), (-30, 30))
        for camera in load_rig("raised_40deg").cameras:
            focal = zoom * np.array(camera.focal)
            view = replace(camera, matrix=[[focal[0], 0, 640], [0, focal[1], 512], [0, 0, 1]])
            image = render(view, handle, T, Bench(**options), rng)
            truth = view.project(T.apply(handle.marker_centres[true_visibility(view, handle, T)]))
            # px, a quarter of a marker: the centroid is not the centre
            off = nearest(find_markers(image, 12, markers).uv, truth)
            assert off.max(initial=0) < max(0.25 * 15 * zoom, 2.0)
            total += len(truth)
    assert total > 15


@pytest.mark.parametrize(
    ("dtype", "factor"), [(np.uint16, 16), (np.int32, 1), (np.float32, 1), (np.float64, 0.02)]
)
def test_other_number_types(dtype, factor):
    """12 bit among them, and discs of 2.6 grey levels, as background subtraction leaves them."""
    image = np.round(disc_image(TWO)).astype(np.uint8)
    image = np.pad(image, ((300, 300), (400, 400)), constant_values=90)
    p = MarkerParameters(min_contrast=20.0 * factor)
    found = find_markers((factor * image.astype(float)).astype(dtype), 4, parameters=p)
    assert nearest(found.uv, find_markers(image, 4).uv).max() < (1e-9 if factor == 1 else 0.01)
    if factor == 1:
        assert found.steps == find_markers(image, 4).steps
    dark = find_markers(255 - image, 4, "dark").uv
    np.testing.assert_allclose(dark, find_markers(image, 4).uv, atol=1e-9)


@pytest.mark.parametrize("size", [(1281, 1025), (1280, 1024), (640, 480), (5, 900), (3, 3)])
def test_images_of_any_size(size):
    """Odd ones lose a row and a column when they are halved, thin ones cannot be halved often."""
    image = np.full(size[::-1], 60.0)
    every = np.array([(u + 0.3, v - 0.2) for u in (40, 620, 1262) for v in (30, 470, 1006)])
    centres = every[(every < np.array(size) - 15).all(axis=1)]
    v, u = np.indices(image.shape)
    for x, y in centres:
        image[np.hypot(u - x, v - y) < 6] = 200
    found = find_markers(image, 12).uv
    assert len(found) == len(centres)
    assert nearest(found, centres).max(initial=0) < 0.35  # px; sharp pixels


def test_noise_and_500_spots_give_no_more_than_was_asked_for():
    rng = np.random.default_rng(0)
    noise = np.clip(rng.normal(100, 20, (1024, 1280)), 0, 255).astype(np.uint8)
    assert len(find_markers(noise, 12).uv) == 0
    spots = np.full((1024, 1280), 60, np.uint8)
    for u, v in rng.uniform(20, 1000, (500, 2)):
        cv2.circle(spots, (int(16 * u), int(16 * v)), 16 * 6, 200, -1, cv2.LINE_AA, 4)
    found = find_markers(spots, 12)
    assert len(found.uv) == 18
    apart = np.linalg.norm(found.uv[:, None] - found.uv, axis=2) + 99 * np.eye(18)
    assert apart.min() > 6  # each once


DISC = disc_image([(60, 50)])


REFUSED = [
    (find_markers, (DISC, 0)),
    (find_markers, (DISC, 12, "red")),
    (iterative_threshold, (DISC, 0)),
    (centroid, (DISC, np.ones((2, 2), bool), 0.0)),
    (MarkerParameters, (0.5,)),
    (MarkerParameters, (1.5, (9.0, 4.0))),
    (MarkerParameters, (1.5, (0.0, 4.0))),
    (MarkerParameters, (1.5, (4.0, 9.0), -0.1)),
    (MarkerParameters, (1.5, (4.0, 9.0), 0.1, 0.1, float("nan"))),
]


@pytest.mark.parametrize(("call", "given"), REFUSED)
def test_bad_input_is_a_value_error(call, given):
    with pytest.raises(ValueError, match="expected"):
        call(*given)
