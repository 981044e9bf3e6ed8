"""Blobs: contours, what stands out, cutting out, the ellipse of a mask."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from trinolab import blobs

EIGHT = np.ones((3, 3), int)  # neighbours that count as touching


def boxes_of_components(binary):
    """First and last column and row of each component, by SciPy: another implementation."""
    found = ndimage.find_objects(ndimage.label(binary, EIGHT)[0])
    return sorted((x.start, y.start, x.stop - x.start, y.stop - y.start) for y, x in found)


@pytest.mark.parametrize("seed", range(8))
def test_contours_are_the_components(seed):
    """Also those inside a hole of another, and those at the image's edge."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(
        rng.uniform(0, 255, rng.integers(3, 70, 2)), (0, 0), rng.uniform(0.5, 2.0)
    )
    threshold = float(np.quantile(image, rng.uniform(0.05, 0.95)))
    found = blobs.contours(image, image.max(axis=1), threshold, 10**6)
    assert sorted(map(cv2.boundingRect, found)) == boxes_of_components(image > threshold)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64, np.int64])
def test_a_threshold_is_exceeded_and_not_reached(dtype):
    image = blobs.searchable(np.array([[0, 7, 0, 8, 0, 9]] * 3, dtype))
    for threshold, count in ((6.5, 3), (7.0, 2), (7.5, 2), (8.0, 1), (9.0, 0), (-1.0, 1), (1e5, 0)):
        assert len(blobs.contours(image, image.max(axis=1), threshold, 10)) == count
        assert blobs.count_contours(image, threshold, 10) == count


def test_noise_has_no_contours_but_a_count():
    rng = np.random.default_rng(0)
    image = rng.normal(100, 5, (300, 400))
    assert blobs.contours(image, image.max(axis=1), 100.0, 18) is None
    assert blobs.count_contours(image, 100.0, 18) == ndimage.label(image > 100, EIGHT)[1]


@pytest.mark.parametrize(("sigma", "share"), [(0.5, 0.3), (1.5, 0.5), (1.5, 0.98), (4.0, 0.02)])
def test_noise_in_a_large_image_is_counted_as_far_as_needed(sigma, share):
    """A count of more than enough may be of a part: then the whole image has at least as many."""
    image = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 50, (512, 640)), (0, 0), sigma)
    threshold = float(np.quantile(image, 1 - share))
    true = ndimage.label(image > threshold, EIGHT)[1]
    for enough in (0, 18, 10**6):
        count = blobs.count_contours(image, threshold, enough)
        assert count == true or enough < count <= true


def test_halving_keeps_places():
    """A pixel of the reduced image is the mean of those that it covers, an odd row and column
    aside.
    """
    image = np.random.default_rng(0).uniform(0, 255, (1025, 1281))
    small, scale = blobs.reduced(image)
    assert scale == 2
    np.testing.assert_allclose(
        small, image[:1024, :1280].reshape(512, 2, 640, 2).mean(axis=(1, 3)), atol=1e-9
    )
    same, scale = blobs.reduced(image[:500, :640])
    assert scale == 1
    np.testing.assert_array_equal(same, image[:500, :640])


def found_places(image, threshold=None, wanted=18):
    small, scale = blobs.reduced(image)
    found = {}
    if threshold is not None:
        found = {threshold: blobs.contours(small, small.max(axis=1), threshold, wanted)}
    return blobs.places(small, scale, found, wanted, (4.0, 80.0), 20.0)


@pytest.mark.parametrize("size", [(300, 400), (1024, 1280)])
@pytest.mark.parametrize("radius", [3.0, 8.0, 30.0])
def test_a_disc_is_a_place_by_its_contour_and_without(size, radius):
    centre = np.array([201.3, 152.7])
    v, u = np.indices(size)
    image = cv2.GaussianBlur(
        np.where(np.hypot(u - centre[0], v - centre[1]) < radius, 200.0, 60.0), (0, 0), 0.7
    )
    # spots are looked for from 6 px on; by its contour to a pixel of the reduced image
    for threshold, within in (
        (130.0, 1.5),
        *([(None, max(2.0, radius / 2))] if radius > 4 else []),
    ):
        where = found_places(image, threshold)
        off = np.linalg.norm(where.uv - centre, axis=1)
        of_this_kind = np.isinf(where.threshold) == (threshold is None)
        assert ((off < within) & (where.reach > radius) & of_this_kind).any()


def test_places_of_a_reduced_image_have_no_offset():
    rng = np.random.default_rng(0)
    grid = np.meshgrid(np.arange(60, 1250, 80), np.arange(60, 1000, 80))
    centres = np.stack(grid, axis=-1).reshape(-1, 2) + rng.uniform(-1, 1, (180, 2))
    image = np.full((1024, 1280), 60, np.uint8)
    for u, v in centres:
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * 8, 200, -1, cv2.LINE_AA, 4)
    where = found_places(image, 130.0, 200)
    uv = where.uv[np.isfinite(where.threshold)]
    assert len(uv) == len(centres)
    off = uv - centres[np.linalg.norm(uv[:, None] - centres, axis=2).argmin(axis=1)]
    # px; scatter 0.4 over sqrt(180) discs
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=0.1)


def test_an_edge_and_a_rod_are_no_spots():
    rng = np.random.default_rng(0)
    image = np.full((400, 500), 50.0)
    image[:, 300:] = 200
    image[:, 80:132] = 120
    turn = cv2.getRotationMatrix2D((250, 200), 30, 1.6)
    image = cv2.warpAffine(image, turn, (500, 400)) + rng.normal(0, 1, (400, 500))
    candidates = blobs.candidates(image, found_places(image), 20.0)
    assert not [c for c in candidates if 60 < c.uv[0] < 440 and 60 < c.uv[1] < 340]


def test_candidates_come_by_contrast_with_thresholds_on_their_flanks():
    v, u = np.indices((200, 300))
    image = np.full((200, 300), 50.0)
    for x, grey in ((60, 110), (150, 200), (240, 150)):
        image[np.hypot(u - x, v - 100) < 9] = grey
    image[np.abs(v - 100) > 15] = 0  # beyond the reach
    uv = np.array([[60.0, 100], [150, 100], [240, 100], [105, 40]])
    where = blobs.Places(uv, np.full(4, 15.0), np.full(4, np.inf))
    found = blobs.candidates(image, where, 20.0)
    assert [c.uv[0] for c in found] == [150, 240, 60]  # at (105, 40) there is nothing
    for candidate, grey in zip(found, (200, 150, 110), strict=True):
        assert candidate.thresholds[0] == (50 + grey) / 2
        assert 50 < candidate.thresholds[1] < grey


def test_the_threshold_is_above_the_saddle_to_a_neighbour():
    image = np.full((60, 90), 50.0)
    v, u = np.indices(image.shape)
    image[27:33, 30:60] = 140  # a bridge brighter than halfway
    image[np.minimum(np.hypot(u - 30, v - 30), np.hypot(u - 60, v - 30)) < 9] = 200
    where = blobs.Places(np.array([[30.0, 30.0]]), np.array([14.0]), np.array([np.inf]))
    [candidate] = blobs.candidates(image, where, 20.0)
    assert min(candidate.thresholds) > 140
    cut = blobs.cut_out(image, candidate.uv, candidate.reach, candidate.thresholds[0])
    assert cut.inside.sum() == (np.hypot(u - 30, v - 30) < 9).sum()


def test_cut_out_holds_the_blob_and_what_is_beside_it():
    image = np.zeros((40, 50), np.uint8)
    image[10:16, 20:28], image[10:16, 30:34], image[30, 5] = 200, 150, 250
    cut = blobs.cut_out(image, (23.6, 12.7), 12.0, 100.0)
    u, v = cut.corner
    inside = np.zeros(image.shape, bool)
    inside[v : v + len(cut.inside), u : u + cut.inside.shape[1]] = cut.inside
    np.testing.assert_array_equal(inside, image == 200)
    np.testing.assert_array_equal(cut.grey, image[v : v + len(cut.grey), u : u + cut.grey.shape[1]])
    np.testing.assert_array_equal(cut.others, cut.grey == 150)
    assert cut.others.any()


NOTHING = {
    "too dim": ((23.0, 12.0), 12.0, 220.0),
    "nothing there": ((45.0, 30.0), 12.0, 100.0),
    "beyond the reach": ((23.0, 12.0), 1.0, 100.0),
    "cut left": ((1.0, 20.0), 9.0, 100.0),
    "cut above": ((30.0, 1.0), 9.0, 100.0),
    "cut right and below": ((48.0, 38.0), 9.0, 100.0),
}


@pytest.mark.parametrize("case", NOTHING)
def test_nothing_to_cut_out(case):
    image = np.zeros((40, 50), np.uint8)
    image[10:16, 16:32] = image[18:24, 0:4] = image[35:40, 44:49] = image[:4, 28:33] = 200
    assert blobs.cut_out(image, *NOTHING[case]) is None


def test_a_dark_middle_does_not_hide_a_blob():
    image = np.zeros((60, 60), np.uint8)
    cv2.circle(cv2.circle(image, (30, 30), 12, 200, -1), (30, 30), 2, 0, -1)
    assert blobs.cut_out(image, (30.0, 30.0), 17.0, 100.0).inside.sum() == np.count_nonzero(image)


def test_ellipse_of_a_rectangle_and_of_an_ellipse():
    """A rectangle of n x m pixels has the variances n^2 / 12 and m^2 / 12, pixels being squares."""
    mask = np.zeros((40, 60), np.uint8)
    mask[10:16, 20:50] = 1
    assert blobs.ellipse(mask) == pytest.approx((180, 4 * 30 / np.sqrt(12), 4 * 6 / np.sqrt(12)))
    v, u = np.indices((200, 200)) - 100
    x, y = 0.8 * u + 0.6 * v, -0.6 * u + 0.8 * v
    area, major, minor = blobs.ellipse(((x / 60) ** 2 + (y / 25) ** 2 < 1).astype(np.uint8))
    assert (major, minor) == pytest.approx((120, 50), abs=0.3)  # px; the outline is a staircase
    assert area == pytest.approx(np.pi * 60 * 25, rel=5e-3)
