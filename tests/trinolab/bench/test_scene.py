"""The simulated bench as an instrument: every reference here comes from another algorithm than the
ray caster's.
"""

import inspect
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from marching import body_distance, marched
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import Arm, true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, background, blurred, digitise
from trinolab.bench.rays import (
    CAP,
    EMPTY,
    SIDE,
    body_region,
    cast,
    cast_rays,
    facing,
    marker_outline,
    sample_offsets,
)
from trinolab.bench.scene import radiance, render, render_clip, scaled
from trinolab.camera import Camera, Rig
from trinolab.handle import Handle, on_cylinder, slants

IDENTITY = RigidTransform.identity()
MATRIX = [[2956.2, 0, 628], [0, 2940.1, 515], [0, 0, 1]]
BARREL = [-0.25, 0.12, 0.001, -0.0008, 0.02]
PAPER = Handle("paper", 5, 200, 25, 3, [0, 60, 120, 180, 240, 300], [[10, -10]] * 6)
PLAIN = Camera("ccd1", (1280, 1024), MATRIX, [0] * 5, IDENTITY)
BENT = Camera("bent", (1280, 1024), MATRIX, BARREL, IDENTITY)
UNLIT = Bench(shading=0)  # uniform brightness, as the closed forms assume


def window(centre_uv, size=(72, 64), distortions=(0,) * 5):
    """A camera that sees only the part of the paper's image around a pixel."""
    matrix = np.array(MATRIX, float)
    matrix[:2, 2] -= np.round(np.asarray(centre_uv)) - np.array(size) // 2
    return Camera("window", size, matrix, distortions, IDENTITY)


def pose(position, rotation):
    return RigidTransform.from_components(position, rotation)


def turned(axis, angle_deg, z=540.0):
    return pose([0, 0, z], Rotation.from_euler(axis, angle_deg, degrees=True))


FRONTAL = turned("y", 180)  # the markers of column 0 face the camera


def centroid(weights):
    v, u = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return np.array([(weights * u).sum(), (weights * v).sum()]) / weights.sum()


# --- geometry


@pytest.mark.parametrize("camera", [PLAIN, BENT], ids=["plain", "distorted"])
def test_the_ray_through_a_projected_marker_centre_meets_that_centre(camera):
    rng = np.random.default_rng(1)
    tried = 0
    for _ in range(30):
        T = random_pose(rng)
        centres = T.apply(PAPER.marker_centres)
        seen = np.flatnonzero(
            (slants(PAPER, T, camera.centre) < np.deg2rad(85)) & camera.sees(centres)
        )
        uv = camera.project(centres[seen])
        hits = cast(camera, PAPER, T, uv)
        assert (hits.labels == seen).all()
        # mm; worst here 3e-11
        np.testing.assert_allclose(hits.points, PAPER.marker_centres[seen], atol=1e-9)
        # px; worst here 2e-11
        np.testing.assert_allclose(camera.project(T.apply(hits.points)), uv, atol=1e-9)
        tried += len(seen)
    assert tried > 70


def test_a_marker_centre_is_drawn_where_pencil_and_paper_put_it():
    """At (0, 10, 535) in front of the camera: u = 628, v = 515 + 2940.1 x 10 / 535 = 569.96; the
    image is [v, u].
    """
    image = radiance(PLAIN, PAPER, FRONTAL, UNLIT)
    assert image[570, 628] == 220
    # 1.5 mm x 2940.1 / 535 = 8.2 px to either side of 569.96
    assert (image[563:578, 628] == 220).all()
    assert image[560, 628] == image[579, 628] == 90
    assert image[628, 570] == pytest.approx(background(PLAIN, UNLIT)[628, 570])
    dark = replace(PAPER, markers="dark")
    image = radiance(PLAIN, dark, FRONTAL, UNLIT)
    assert (image[570, 628], image[515, 628]) == (90, 220)


@pytest.mark.slow
def test_hits_agree_with_marching():
    """The first meeting, found by marching along the ray by the distance to the body, from all
    sides and end-on.
    """
    rng = np.random.default_rng(2)
    labels = []
    for _ in range(15):
        T = pose(rng.uniform([-40, -40, 150], [40, 40, 300]), Rotation.random(rng=rng))
        region = np.argwhere(body_region(PLAIN, PAPER, T))
        if len(region) == 0:
            continue
        uv = region[rng.integers(len(region), size=100)][:, ::-1] + rng.uniform(-0.5, 0.5, (100, 2))
        hits, rays = cast(PLAIN, PAPER, T, uv), PLAIN.rays(uv)
        depth = marched(
            lambda points, T=T: body_distance(PAPER, T.inv().apply(points)), rays, 2000, 1e-9
        )
        # rays that graze the silhouette
        assert (np.isinf(depth) != (hits.labels == EMPTY)).sum() <= 1
        sure = np.isfinite(depth) & (hits.labels != EMPTY)
        met = T.inv().apply(depth[sure, None] * rays[sure])
        np.testing.assert_allclose(
            hits.points[sure], met, atol=1e-3
        )  # mm; marching stops 1e-9 away
        labels.extend(hits.labels)
    assert min(labels.count(part) for part in (EMPTY, SIDE, CAP)) > 10


def test_a_marker_is_met_as_soon_as_its_edge_comes_round_the_side():
    """The camera turns about the handle; what a ray meets is judged by the distances on the
    unrolled surface from all markers, seen or not.
    """
    wide = replace(PAPER, marker_diameter_mm=4.5)
    half = wide.marker_diameter_mm / 2
    beyond = 0
    for turn in np.deg2rad(np.arange(0, 60, 2)):
        viewpoint = np.array([200 * np.sin(turn), 0.0, 200 * np.cos(turn)])
        phi, height = (
            part.ravel() for part in np.meshgrid(turn + np.linspace(-1.54, 1.54, 99), [9, 10, 11.5])
        )
        aims = on_cylinder(wide.radius_mm, phi, height)
        hits = cast_rays(wide, viewpoint, (aims - viewpoint).T)
        x, y, z = hits.points.T
        around = np.arctan2(x, z)[:, None] - wide.marker_angles
        around = (around + np.pi) % (2 * np.pi) - np.pi
        distance = np.hypot(wide.radius_mm * around, y[:, None] - wide.marker_centres[:, 1])
        nearest = distance.argmin(axis=1)
        expected = np.where(distance.min(axis=1) <= half, nearest, SIDE)
        np.testing.assert_array_equal(hits.labels, expected)
        centres = wide.marker_centres[hits.labels[hits.labels >= 0]]
        beyond += np.count_nonzero(~facing(wide, centres, viewpoint))
    assert beyond > 50  # seen, though the marker's centre is on the far side


DARK = Bench(shading=0, texture_contrast=0, background_grey=0)  # but for the handle


def test_an_end_on_handle_is_its_cap():
    """The near cap hides all else: a circle of radius f r / z."""
    image = radiance(PLAIN, PAPER, turned("x", -90, 565), DARK)  # the free end 540 mm away
    assert image.max() == 90
    expected = np.pi * (5 / 540) ** 2 * 2956.2 * 2940.1
    assert image.sum() / 90 == pytest.approx(expected, rel=5e-4)  # 2341 px^2; off by 7e-5


AWKWARD = {
    "on its side": pose([20, 10, 570], Rotation.from_euler("zy", [75, 20], degrees=True)),
    "thin slivers": pose([0, 0, 540], Rotation.from_euler("y", 7, degrees=True)),
    "steep": pose([10, 5, 540], Rotation.from_euler("x", -80, degrees=True)),
    "near": pose([3, 2, 200], Rotation.from_euler("x", -92, degrees=True)),
    "partly behind": pose([0, -60, 60], Rotation.from_euler("x", -120, degrees=True)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("camera", "where"), [*((PLAIN, where) for where in AWKWARD), (BENT, "on its side")]
)
def test_no_edge_is_missed(camera, where):
    """8 x 8 samples everywhere on the body and around it give the same image as 8 x 8 samples at
    the edges.
    """
    matrix = np.diag([1 / 8, 1 / 8, 1]) @ MATRIX
    small = Camera(camera.name, (160, 128), matrix, camera.distortions, IDENTITY)
    image = radiance(small, PAPER, AWKWARD[where], replace(DARK, marker_supersampling=8))
    v, u = np.mgrid[:128, :160].reshape(2, -1)
    uv = (np.column_stack([u, v])[:, None] + sample_offsets(8)).reshape(-1, 2)
    labels = cast(small, PAPER, AWKWARD[where], uv).labels
    grey = np.select([labels >= 0, labels == EMPTY], [220.0, 0.0], 90.0)
    expected = grey.reshape(128, 160, -1).mean(axis=2)
    np.testing.assert_allclose(image, expected, atol=1e-9)  # 64 equal samples: rounding alone
    assert image.max() > 0


def test_a_body_thinner_than_a_pixel_is_not_missed():
    """0.4 px wide: its light is that of its area in the image, whatever pixel centres it passes
    by.
    """
    tiny, sharp = scaled(PLAIN, 1 / 128), replace(DARK, marker_grey=90)
    for x in (0, 7, 19):
        T = pose([x, 75, 540], Rotation.identity())
        whole = radiance(PLAIN, PAPER, T, sharp).sum() / 128**2
        # 8 x 8 samples a pixel
        assert radiance(tiny, PAPER, T, sharp).sum() == pytest.approx(whole, rel=0.15)


# --- marker images


@pytest.mark.parametrize("distortions", [(0,) * 5, BARREL], ids=["plain", "distorted"])
@pytest.mark.parametrize("slant_deg", [0, 40, 65])
def test_a_wrapped_marker_is_the_polygon_of_its_projected_edge(slant_deg, distortions):
    """Area and centroid against Green's theorem on 4000 projected points of the edge, all of it in
    view.
    """
    single = Handle("single", 5, 200, 25, 3, [0], [[10]])
    bench = Bench(shading=0, body_grey=0, marker_grey=200, background_grey=0)
    rng = np.random.default_rng(slant_deg)
    whole = Camera("whole", (1280, 1024), MATRIX, distortions, IDENTITY)
    for _ in range(8):
        spin = Rotation.from_euler("z", rng.uniform(-180, 180), degrees=True)
        rotation = spin * Rotation.from_euler(
            "y", 180 + slant_deg * rng.choice([-1, 1]), degrees=True
        )
        T = pose(rng.uniform([-30, -20, 520], [30, 20, 620]), rotation)
        edge = T.apply(marker_outline(single, 0, 4000))
        camera = window(whole.project(edge).mean(axis=0), distortions=distortions)
        area, centre = polygon(camera.project(edge))
        share = radiance(camera, single, T, bench) / 200
        assert share.sum() == pytest.approx(area, abs=0.15)  # px^2; worst of 600: 0.08
        np.testing.assert_allclose(centroid(share), centre, atol=0.01)  # px; worst of 600: 0.006


def polygon(uv):
    """Area and centroid of a closed polygon."""
    start = uv[0]
    (x, y), (a, b) = (uv - start).T, np.roll(uv - start, -1, axis=0).T
    cross = x * b - a * y
    moment = np.array([((x + a) * cross).sum(), ((y + b) * cross).sum()])
    return abs(cross.sum()) / 2, start + moment / (3 * cross.sum())


# --- light, blur, noise


@pytest.mark.parametrize(
    ("T", "light", "lit"),
    [
        (FRONTAL, (0, 0, -1), {(570, 628): 220, (515, 628): 90}),
        # 1 - 0.3 + 0.3 cos 65 deg = 0.827 of its grey
        (turned("y", 180 + 65), (0, 0, -1), {"marker": 220 * 0.827, "beside it": 90 * 0.827}),
        (turned("x", -90, 700), (0, 0, -1), {(515, 628): 90}),  # the free end's cap
        (turned("x", 90, 700), (0, 0, 1), {(515, 628): 90 * 0.7}),  # the held end's, from behind
    ],
)
def test_a_surface_has_its_grey_by_its_slant_to_the_light(T, light, lit):
    image = radiance(PLAIN, PAPER, T, Bench(light=light))
    u, v = PLAIN.project(T.apply(PAPER.marker_centres[:1]))[0].round().astype(int)
    places = {"marker": (v, u), "beside it": (v + 15, u)}
    for place, grey in lit.items():
        assert image[places.get(place, place)] == pytest.approx(grey, abs=1.5)


def test_the_light_stands_still_in_the_world():
    """From one side the body is brighter on that side, however the handle is turned about its
    axis.
    """
    for turn in (0, 100, 200):
        image = radiance(PLAIN, PAPER, turned("y", turn), Bench(light=(-1, 0, 0), shading=0.5))
        assert image[515, 608] > image[515, 648] + 20


def test_the_blur_is_a_gaussian_of_the_stated_width():
    image = np.zeros((41, 31))
    image[20, 15] = 1.0
    out = blurred(image, Bench(blur_px=0.7))
    v, u = np.mgrid[:41, :31]
    assert out.sum() == pytest.approx(1, abs=1e-12)
    # 0.4888: sampled at whole pixels
    assert (out * (u - 15) ** 2).sum() == pytest.approx(0.49, abs=2e-3)
    assert (out * (v - 20) ** 2).sum() == pytest.approx(0.49, abs=2e-3)
    assert (blurred(image, Bench(blur_px=0)) == image).all()
    # greys; up to the border
    np.testing.assert_allclose(blurred(np.full((9, 8), 70.0), Bench()), 70, atol=1e-9)
    assert image[20, 15] == 1.0


def test_greys_are_clipped_to_eight_bits():
    rng = np.random.default_rng(4)
    for grey, bound in ((300.0, 255), (-40.0, 0)):
        frame = digitise(np.full((20, 30), grey), Bench(read_noise=0.5, shot_variance=0), rng)
        assert frame.dtype == np.uint8
        assert abs(int(frame.max()) - bound) <= 3
        assert abs(int(frame.min()) - bound) <= 3
    frame = render(PLAIN, PAPER, AWKWARD["on its side"], Bench(marker_grey=255, body_grey=250), rng)
    assert frame.max() == 255


# --- frames and backgrounds


def test_the_background_does_not_depend_on_the_pose():
    empty = radiance(PLAIN, PAPER, None, Bench())
    assert (empty == background(PLAIN, Bench())).all()
    T = random_pose(np.random.default_rng(9))
    image, region = radiance(PLAIN, PAPER, T, Bench()), body_region(PLAIN, PAPER, T)
    assert (image[~region] == empty[~region]).all()
    assert (image[region] != empty[region]).any()
    assert (background(PLAIN, Bench()) == empty).all()  # drawing on it has left it alone


def test_the_background_has_its_mean_and_contrast_and_its_seed():
    grey = background(PLAIN, Bench())
    assert grey.mean() == pytest.approx(45, abs=0.1)
    assert grey.std() == pytest.approx(0.15 * 45, abs=0.1)
    assert grey.min() >= 0
    assert not grey.flags.writeable
    for other in (background(PLAIN, Bench(texture_seed=1)), background(BENT, Bench())):
        assert abs(np.corrcoef(grey.ravel(), other.ravel())[0, 1]) < 0.3
    assert (background(PLAIN, Bench(texture_contrast=0)) == 45).all()


@pytest.mark.parametrize("camera", [PLAIN, BENT], ids=["plain", "distorted"])
@pytest.mark.parametrize(
    "position",
    [[0, 0, -540], [900, 0, 540], [0, -900, 540], [0, 50, 1]],
    ids=["behind", "right", "above", "around the camera"],
)
def test_a_handle_out_of_view_leaves_the_background(camera, position):
    image = radiance(camera, PAPER, pose(position, Rotation.identity()), Bench())
    assert (image == background(camera, Bench())).all()


# --- clips, light, scale


def test_the_light_is_a_factor_on_everything_and_the_noise_follows_it():
    T, dim, even = AWKWARD["on its side"], 0.6, Bench(shading=0, texture_contrast=0)
    image = blurred(radiance(PLAIN, PAPER, T, even), even)
    frame = render(PLAIN, PAPER, T, even, np.random.default_rng(1), gain=dim).astype(float)
    for grey in (45, 90, 220):
        here = np.abs(image - grey) < 1e-6
        count, variance = here.sum(), 0.05 * dim * grey + 1.5**2 + 1 / 12
        assert frame[here].mean() == pytest.approx(dim * grey, abs=5 * np.sqrt(variance / count))
        assert frame[here].var() == pytest.approx(variance, rel=5 * np.sqrt(2 / count))
    assert render(PLAIN, PAPER, T, Bench(), np.random.default_rng(1), gain=50).min() == 255
    assert render(PLAIN, PAPER, T, Bench(), np.random.default_rng(1), gain=0).max() < 10


@pytest.mark.parametrize("held", [[None, Arm(), None], Arm()], ids=["by turns", "always"])
def test_a_clip_is_its_frames(held):
    """The same draws as one call of `render` after the other, camera by camera, in step with poses,
    arms and lights.
    """
    second = Camera("ccd2", (64, 48), np.diag([1 / 20, 1 / 20, 1]) @ MATRIX, [0] * 5, IDENTITY)
    rig = Rig((scaled(PLAIN, 0.125), second))
    poses, lights = [None, AWKWARD["on its side"], AWKWARD["steep"]], [1, 0.5, 2]
    clip = render_clip(rig, PAPER, poses, Bench(), np.random.default_rng(7), held, lights)
    assert inspect.isgenerator(clip)
    rng = np.random.default_rng(7)
    arms = [held] * 3 if isinstance(held, Arm) else held
    for frames, T, arm, gain in zip(clip, poses, arms, lights, strict=True):
        assert [frame.shape for frame in frames] == [(128, 160), (48, 64)]
        for frame, camera in zip(frames, rig.cameras, strict=True):
            assert (frame == render(camera, PAPER, T, Bench(), rng, arm, gain)).all()
    batch = RigidTransform.concatenate(poses[1:])
    of_one = list(render_clip(second, PAPER, batch, Bench(), np.random.default_rng(7)))
    rng = np.random.default_rng(7)
    assert (of_one[0] == render(second, PAPER, batch[0], Bench(), rng)).all()
    assert len(of_one) == 2


@pytest.mark.parametrize("camera", [PLAIN, BENT], ids=["plain", "distorted"])
@pytest.mark.parametrize("factor", [0.5, 0.25, 2])
def test_a_scaled_camera_sees_the_same_through_larger_pixels(camera, factor):
    """The image's corner, half a pixel outside the first centre, and every point keep their place
    in the image.
    """
    small = scaled(camera, factor)
    assert small.size == (1280 * factor, 1024 * factor)
    points = np.random.default_rng(2).uniform([-90, -60, 520], [90, 60, 620], (50, 3))
    # px
    np.testing.assert_allclose(
        (small.project(points) + 0.5) / factor, camera.project(points) + 0.5, atol=1e-9
    )


# --- truth


def test_true_visibility_follows_the_three_rules():
    def seen(position, turn_deg, handle=PAPER):
        T = pose(position, Rotation.from_euler("y", 180 + turn_deg, degrees=True))
        return true_visibility(PLAIN, handle, T).reshape(6, 2)[:, 0].tolist()

    assert seen([0, 0, 540], 0) == [True, True, False, False, False, True]  # slants 0 and 60.5 deg
    # one column at 62.5
    assert seen([0, 0, 540], 2) in ([True, True] + [False] * 4, [True] + [False] * 4 + [True])
    assert seen([0, 0, -540], 0) == [False] * 6
    # column 0's marker at 535 mm spans 628 +- 8.3 px and v = 515 + 55 +- 8.2; the others lie aside
    # by 24 px
    edge = (1279.5 - 628 - 10) / 2956.2 * 535
    assert seen([edge - 1.6, 0, 540], 0)[0]
    assert not seen([edge - 1.4, 0, 540], 0)[0]


def test_a_marker_that_reaches_round_the_body_is_hidden_in_part():
    """The share that is seen, against rays cast at the marker's own points."""
    wide = Handle("wide", 2, 60, 30, 6, [0], [[0]])
    rng = np.random.default_rng(6)
    radius, angle = 3 * np.sqrt(rng.uniform(size=4000)), rng.uniform(0, 2 * np.pi, 4000)
    theta, axial = radius * np.cos(angle) / 2, radius * np.sin(angle)
    points = np.column_stack([2 * np.sin(theta), axial, 2 * np.cos(theta)])
    for turn, expected in ((0, True), (20, True), (60, False)):
        T = pose([0, 0, 540], Rotation.from_euler("y", 180 + turn, degrees=True))
        hits = cast(PLAIN, wide, T, PLAIN.project(T.apply(points))).points
        share = (np.linalg.norm(hits - points, axis=1) < 1e-3).mean()
        assert abs(share - 0.8) > 0.02
        assert (share > 0.8) == expected == true_visibility(PLAIN, wide, T)[0]


@pytest.mark.slow
def test_random_poses_fill_the_standard_scene():
    rng = np.random.default_rng(7)
    poses = [random_pose(rng) for _ in range(1000)]
    positions = np.array([T.translation for T in poses])
    np.testing.assert_allclose(positions.min(axis=0), [-90, -60, 520], atol=1)  # mm
    np.testing.assert_allclose(positions.max(axis=0), [90, 60, 620], atol=1)
    axes = np.array([T.rotation.as_matrix()[:, 1] for T in poses])
    tilt = np.rad2deg(np.arccos(axes[:, 2]))
    assert 60 <= tilt.min() < 61
    assert 119 < tilt.max() <= 120
    np.testing.assert_allclose(axes.mean(axis=0), 0, atol=0.08)  # four standard errors of 1,000
    normals = np.array([T.rotation.as_matrix()[:, 2] for T in poses])
    np.testing.assert_allclose(normals.mean(axis=0), 0, atol=0.08)


# --- bad input


@pytest.mark.parametrize(("row", "said"), cases(Path(__file__).with_name("wrong.txt"), "Bench"))
def test_a_bad_bench_names_its_field(row, said):
    with pytest.raises(ValueError, match=f"^{row.split()[0]}: {said}"):
        Bench(**tomllib.loads(row))


RNG, AT = np.random.default_rng(0), AWKWARD["steep"]
ONE = "T_world_handle: expected one RigidTransform"


@pytest.mark.parametrize(
    ("message", "call"),
    [
        (ONE, lambda: radiance(PLAIN, PAPER, np.eye(4), Bench())),
        (ONE, lambda: true_visibility(PLAIN, PAPER, RigidTransform.identity(2))),
        ("rng: expected", lambda: render(PLAIN, PAPER, AT, Bench(), 5)),
        ("rng: expected", lambda: random_pose(5)),
        ("image: expected a grey image", lambda: digitise(np.zeros((4, 4, 3)), Bench(), RNG)),
        ("image: expected a grey image", lambda: blurred(np.zeros(4), Bench())),
        ("z_mm: expected", lambda: random_pose(RNG, z_mm=(1, 2, 3))),
        ("uv: expected shape", lambda: cast(PLAIN, PAPER, AT, np.zeros((2, 3)))),
        (
            "arm: expected one for each of 2 poses",
            lambda: render_clip(PLAIN, PAPER, [AT, AT], Bench(), RNG, [Arm()]),
        ),
        (
            "lights: expected shape",
            lambda: render_clip(PLAIN, PAPER, [AT, AT], Bench(), RNG, lights=[1.0]),
        ),
        (
            "lights: expected factors",
            lambda: render_clip(PLAIN, PAPER, [AT], Bench(), RNG, lights=[-1.0]),
        ),
        (ONE, lambda: list(render_clip(PLAIN, PAPER, [3], Bench(), RNG))),
        ("gain: expected", lambda: render(PLAIN, PAPER, AT, Bench(), RNG, gain=-1)),
        ("factor: expected whole", lambda: scaled(PLAIN, 0.3)),
    ],
)
def test_bad_arguments_are_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()
