"""Markers: the threshold's bisection, the filters, the centroid."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.blobs import centroid
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import slants
from trinolab.markers import (
    MarkerParameters,
    blob_at,
    find_markers,
    halfway,
    iterative_threshold,
)


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


def components_by_flood_fill(binary):
    """Count 8-connected components by an explicit flood fill: the reference for the contour
    count.
    """
    todo = {tuple(p) for p in np.argwhere(binary)}
    count = 0
    while todo:
        stack, count = [todo.pop()], count + 1
        while stack:
            v, u = stack.pop()
            near = {(v + a, u + b) for a in (-1, 0, 1) for b in (-1, 0, 1)} & todo
            todo -= near
            stack.extend(near)
    return count


def test_bisection_ends_at_the_wanted_number():
    image = disc_image([(30, 30), (80, 40), (120, 90)])
    steps = iterative_threshold(image, 3)
    assert steps[-1].contours == 3
    assert steps[0].threshold == pytest.approx((image.min() + image.max()) / 2)  # Eq. 16


def test_counts_are_those_of_a_flood_fill():
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.uniform(0, 255, (40, 60)), (0, 0), 1.5)
    for step in iterative_threshold(image, 1000):
        assert step.contours == components_by_flood_fill(image > step.threshold)


def test_bisection_moves_by_the_papers_rule():
    image = disc_image([(30, 30), (80, 40), (120, 90)])
    few, many = iterative_threshold(image, 100), iterative_threshold(image, 1)
    assert few[1].threshold < few[0].threshold  # too few contours: T_max = T_0
    assert many[1].threshold > many[0].threshold  # too many: T_min = T_0


@pytest.mark.slow
def test_bisection_ends_although_the_count_is_never_reached():
    """Eight discs joined by a dimmer bridge: the counts go 8, then fewer, and never 5."""
    image = disc_image([(20 + 40 * k, 30 + 40 * j) for k in range(4) for j in range(2)])
    image[60:62] = 150
    steps = iterative_threshold(image, 5)
    assert steps[-1].contours != 5
    assert len(steps) <= 8  # 220 - 90 grey levels, halved until under one


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
    assert np.linalg.norm(found.uv[:, None] - centres, axis=2).min(axis=0).max() < 0.25


@pytest.mark.parametrize(
    ("threshold", "within"),
    [
        (55.0, 34.0),  # its mean has the flank in it; what is nearer than a fifth of 170 is left
        (190.0, 5.0),
    ],
)
def test_a_contour_is_taken_again_halfway_up_the_flank(threshold, within):
    """A disc of 210 on 40, found near its foot or its top: half of its height is at 125."""
    image = disc_image([(60, 50)], body=40.0, marker=210.0)
    p = MarkerParameters()
    before = blob_at(image, (60, 50), 17.0, threshold, p)
    after = halfway(image, before, p)
    assert abs(before.threshold - 125) > 60
    assert after.threshold == pytest.approx(125, abs=within)
    assert (after.u, after.v) == pytest.approx((60, 50), abs=0.01)


def wrapped_centroid_mm(theta, radius, disc):
    """Where a disc wrapped on a cylinder has its centroid from far away, mm from the axis:
    numerical integrals.
    """
    seen = lambda a: 2 * np.sqrt(disc**2 - a**2) * np.cos(theta + a / radius)  # noqa: E731
    area = quad(seen, -disc, disc)[0]
    return quad(lambda a: seen(a) * radius * np.sin(theta + a / radius), -disc, disc)[0] / area


@pytest.mark.parametrize("turn_deg", [5, 25, 45, 65])
def test_centroid_of_a_wrapped_marker_is_off_by_what_geometry_says(turn_deg):
    """Even light and a rod as dark as the background: only the wrapping is left."""
    camera, handle = load_rig("paper_pair").cameras[0], load_handle("paper")
    bench = Bench(shading=0, body_grey=45, texture_contrast=0, shot_variance=0, read_noise=0)
    turn = Rotation.from_euler("Y", 180 + turn_deg, degrees=True)
    T = RigidTransform.from_components([0.0, 0.0, 570.0], turn)
    found = find_markers(render(camera, handle, T, bench, np.random.default_rng(0)), 12).uv
    theta = slants(handle, T, camera.centre)[0]
    truth = camera.project(T.apply(handle.marker_centres[:1]))[0]
    error = found[np.linalg.norm(found - truth, axis=1).argmin()] - truth
    scale = camera.focal[0] / (570 - 5 * np.cos(theta))  # px/mm
    inward = (handle.radius_mm * np.sin(theta) - wrapped_centroid_mm(theta, 5.0, 1.5)) * scale
    # px; pixels and perspective, worst 0.02
    assert abs(error[0]) == pytest.approx(inward, abs=0.03)
    assert (error[0] < 0) == (truth[0] > camera.principal_point[0])  # towards the axis


def test_a_flat_image_has_no_steps_and_no_markers():
    image = np.full((50, 70), 90, dtype=np.uint8)
    assert iterative_threshold(image, 12) == ()
    assert find_markers(image, 12).uv.shape == (0, 2)


def test_centroids_of_rendered_discs():
    rng = np.random.default_rng(1)
    truth = np.array([(30, 30), (80, 40), (120, 90), (40, 85)]) + rng.uniform(-0.5, 0.5, (4, 2))
    found = find_markers(disc_image(truth), 12)
    assert len(found.uv) == 4
    nearest = np.linalg.norm(found.uv - truth[:, None], axis=2).min(axis=1)
    assert nearest.max() < 0.01  # px; 16 x 16 samples leave 0.003, float image without noise


def test_centroid_under_noise_and_eight_bit():
    rng = np.random.default_rng(2)
    clean = disc_image([(60.3, 50.6)])
    errors = []
    for _ in range(50):
        noisy = np.clip(
            np.round(clean + rng.normal(0, np.sqrt(0.05 * clean + 1.5**2))), 0, 255
        ).astype(np.uint8)
        found = find_markers(noisy, 12)
        assert len(found.uv) == 1
        errors.append(found.uv[0] - [60.3, 50.6])
    assert np.abs(np.mean(errors, axis=0)).max() < 0.015  # px; scatter 0.03 over sqrt(50) draws
    assert np.std(errors, axis=0).max() < 0.05


def test_centroid_by_hand():
    image = np.array([[0, 0, 0], [0, 10, 30]])  # u = (1 * 10 + 2 * 30) / 40, v = 1
    np.testing.assert_allclose(centroid(image, np.ones((2, 3), bool), 0.0), [1.75, 1.0], atol=1e-15)


def test_centroid_of_nothing_is_nan():
    assert np.isnan(centroid(np.zeros((3, 4)), np.ones((3, 4), bool), 0.0)).all()


def test_dark_markers_are_bright_ones_of_the_negative():
    image = disc_image([(30.2, 30.7), (80.1, 40.4)])
    bright = find_markers(image, 4)
    dark = find_markers(255 - image, 4, markers="dark")
    np.testing.assert_allclose(np.sort(dark.uv, axis=0), np.sort(bright.uv, axis=0), atol=1e-9)


@pytest.mark.parametrize(
    ("shape", "why"),
    [
        ("bar", "too long"),
        ("sliver", "too thin"),
        ("speck", "too small"),
        ("ring", "not filled"),
        ("slab", "too large"),
        ("edge", "cut by the edge"),
        ("faint", "no contrast"),
    ],
)
def test_what_is_no_marker_is_dropped(shape, why):
    image = disc_image([(60.0, 50.0)])
    draw = {
        "bar": lambda: cv2.rectangle(image, (90, 20), (150, 23), 220, -1),
        "sliver": lambda: cv2.rectangle(image, (100, 20), (130, 22), 220, -1),
        "speck": lambda: cv2.rectangle(image, (110, 90), (111, 91), 220, -1),
        "ring": lambda: cv2.circle(image, (120, 60), 12, 220, 2),
        "slab": lambda: cv2.rectangle(image, (80, 5), (155, 115), 220, -1),
        "edge": lambda: cv2.circle(image, (159, 60), 8, 220, -1),
        "faint": lambda: cv2.circle(image, (120, 60), 8, 105, -1),
    }
    draw[shape]()
    found = find_markers(image, 12, parameters=MarkerParameters(diameter_px=(4.0, 40.0)))
    assert len(found.uv) == 1, why
    np.testing.assert_allclose(found.uv[0], [60, 50], atol=0.02)


def test_a_bright_neighbour_does_not_pull_the_centroid():
    image = disc_image([(60.0, 50.0)])
    image[:, 69:] = 220  # a bright wall one pixel from the disc's edge
    found = find_markers(image, 12)
    nearest = found.uv[np.linalg.norm(found.uv - [60, 50], axis=1).argmin()]
    np.testing.assert_allclose(nearest, [60, 50], atol=0.1)


def test_markers_survive_a_texture_brighter_than_the_body():
    rng = np.random.default_rng(3)
    image = disc_image([(60.0, 50.0), (90.0, 70.0)])
    wall = 140 + cv2.GaussianBlur(rng.normal(0, 60, image.shape), (0, 0), 2.0)
    image[:, :30], image[:, 125:] = wall[:, :30], wall[:, 125:]
    found = find_markers(image, 12)
    for truth in ([60, 50], [90, 70]):
        assert np.linalg.norm(found.uv - truth, axis=1).min() < 0.02


def rendered(bench, seed, markers="bright", zoom=1.0, count=2):
    """Whole frames of the coded handle in random poses, each with the pixels of the markers that
    are truly seen.
    """
    rig, handle = load_rig("raised_40deg"), replace(load_handle("coded"), markers=markers)
    rng = np.random.default_rng(seed)
    for _ in range(count):
        T = random_pose(rng, (-40, 40), (-30, 30))
        for camera in rig.cameras:
            focal = zoom * np.array(camera.focal)
            view = replace(camera, matrix=[[focal[0], 0, 640], [0, focal[1], 512], [0, 0, 1]])
            seen = true_visibility(view, handle, T)
            yield (
                render(view, handle, T, bench, rng),
                view.project(T.apply(handle.marker_centres[seen])),
            )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "options", "bench"),
    [
        ("standard scene", {}, {}),
        pytest.param(*("dark", {"markers": "dark"}, {}), marks=pytest.mark.heavy),
        ("low contrast", {}, {"marker_grey": 130}),
        pytest.param(
            *("brighter than the body", {}, {"background_grey": 110}), marks=pytest.mark.heavy
        ),
        ("as bright as markers", {}, {"background_grey": 150}),
        ("noise", {}, {"read_noise": 8}),
        pytest.param(*("blurred", {}, {"blur_px": 2}), marks=pytest.mark.heavy),
        ("6 px", {"zoom": 0.4}, {}),
        ("35 px", {"zoom": 2.2}, {}),
    ],
)
def test_all_that_is_truly_seen_is_found_in_whole_frames(what, options, bench):
    """Frames so large that they are searched at half their size; the truth is the renderer's."""
    lost = total = 0
    for image, truth in rendered(Bench(**bench), 7, **options):
        found = find_markers(image, 12, options.get("markers", "bright")).uv
        # px, a quarter of a marker: the centroid is not the centre
        near = 0.25 * 15 * options.get("zoom", 1.0)
        lost += sum(
            np.linalg.norm(found - uv, axis=1).min(initial=np.inf) > max(near, 2.0) for uv in truth
        )
        total += len(truth)
    assert total > 15
    assert lost == 0, what


def test_a_whole_frame_and_a_window_of_it_give_the_same_centroids():
    """The search differs (half size, full size, other thresholds), the measurement does not."""
    for image, truth in rendered(Bench(), 3, count=1):
        first = np.maximum(truth.min(axis=0).astype(int) - 40, 0)
        last = truth.max(axis=0).astype(int) + 40
        whole = find_markers(image, 12).uv
        window = find_markers(image[first[1] : last[1], first[0] : last[0]], 12).uv + first
        for uv in truth:
            one, other = (
                found[np.linalg.norm(found - uv, axis=1).argmin()] for found in (whole, window)
            )
            # px; another threshold moves a steep marker's mask by a pixel
            assert np.linalg.norm(one - other) < 0.05


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.float32, np.float64])
def test_other_number_types(dtype):
    discs = disc_image([(30.2, 30.7), (80.1, 40.4)])
    image = np.pad(np.round(discs).astype(np.uint8), ((300, 300), (400, 400)), constant_values=90)
    expected = find_markers(image, 4)
    found = find_markers(image.astype(dtype), 4)
    np.testing.assert_allclose(found.uv, expected.uv, atol=1e-9)
    assert found.steps == expected.steps
    if dtype is np.uint16:  # 12 bit
        found = find_markers(
            16 * image.astype(dtype), 4, parameters=MarkerParameters(min_contrast=320.0)
        )
        np.testing.assert_allclose(found.uv, expected.uv, atol=0.01)


def test_a_float_image_keeps_its_fractions_of_grey_levels():
    """Discs of 2.6 grey levels, as background subtraction leaves them: rounded they would be off by
    far more.
    """
    truth = np.array([(30.37, 30.81), (80.62, 40.23)])
    image = disc_image(truth) / 50
    found = find_markers(image, 4, parameters=MarkerParameters(min_contrast=1.0))
    assert len(found.uv) == 2
    assert np.linalg.norm(found.uv - truth[:, None], axis=2).min(axis=1).max() < 0.01  # px


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
    for centre in centres:
        assert np.linalg.norm(found - centre, axis=1).min() < 0.35  # px; sharp pixels


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


@pytest.mark.parametrize(
    "call",
    [
        lambda image: find_markers(image[None], 12),
        lambda image: find_markers(image, 0),
        lambda image: find_markers(image, 12, markers="red"),
        lambda image: iterative_threshold(image, 0),
        lambda image: find_markers(image * np.nan, 12),
        lambda image: centroid(image, np.ones((2, 2), bool), 0.0),
        lambda image: MarkerParameters(surplus=0.5),
        lambda image: MarkerParameters(diameter_px=(9.0, 4.0)),
        lambda image: MarkerParameters(min_contrast=float("nan")),
    ],
)
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call(disc_image([(60, 50)]))
