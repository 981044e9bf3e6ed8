"""The hand and forearm: closed-form capsules against marching along the ray, and what they hide."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from marching import body_distance, marched
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import (
    Arm,
    Capsules,
    capsule_region,
    capsules,
    cast_capsules,
    in_camera,
    skin_grey,
    true_visibility,
)
from trinolab.bench.motion import random_pose, smooth_motion
from trinolab.bench.optics import Bench, background
from trinolab.bench.scene import radiance
from trinolab.datasets import load_handle, paper_rig
from trinolab.handle import on_cylinder

PAPER = load_handle("paper")
RIG = paper_rig(40.0)
CCD1, CCD2, CCD3 = RIG.cameras
# every surface has one grey of its own, so that a grey tells what a pixel sees
FLAT = Bench(
    shading=0, texture_contrast=0, background_grey=0, supersampling=4, marker_supersampling=4
)
SKIN = 150.0


def plain(**fields):
    return Arm(grey=SKIN, texture_contrast=0, **fields)


def upright(position=(0.0, 0.0, 570.0), turn_deg=0.0):
    """Free end upwards, turned about the axis."""
    rotation = Rotation.from_euler("x", 180, degrees=True) * Rotation.from_euler(
        "y", turn_deg, degrees=True
    )
    return RigidTransform.from_components(position, rotation)


def capsule_distances(solids, points):
    """Distance of points (n, 3) to each capsule, shape (m, n), by projection on the segment."""
    found = []
    for start, end, radius in zip(*solids, strict=True):
        share = np.clip((points - start) @ (end - start) / np.sum((end - start) ** 2), 0, 1)
        found.append(
            np.linalg.norm(points - start - share[:, None] * (end - start), axis=1) - radius
        )
    return np.array(found)


def to_capsules(solids, origin):
    """The distance to the nearest capsule of points seen from an origin."""
    return lambda points: capsule_distances(solids, origin + points).min(axis=0)


def seen(camera, T, arm, uv):
    """What the rays through pixels see, 'none', 'skin' or 'body', by marching against all solids at
    once.
    """
    T_handle_cam = (camera.T_cam_world * T).inv()
    rays, to_skin = camera.rays(uv), to_capsules(capsules(arm, PAPER, T), camera.centre)

    def to_body(points):
        local = camera.T_cam_world.apply(camera.centre + points)
        return body_distance(PAPER, T_handle_cam.apply(local))

    depth = marched(lambda points: np.minimum(to_skin(points), to_body(points)), rays)
    points = np.minimum(depth, 5000)[:, None] * rays
    nearer = np.where(to_skin(points) < to_body(points), "skin", "body")
    return np.where(np.isinf(depth), "none", nearer)


# --- capsules


@pytest.mark.slow
def test_rays_meet_capsules_where_marching_does():
    rng = np.random.default_rng(1)
    starts = rng.uniform([-80, -80, 300], [80, 80, 500], (6, 3))
    solids = Capsules(starts, starts + rng.uniform(-90, 90, (6, 3)), rng.uniform(5, 25, 6))
    rays = np.column_stack([rng.uniform(-0.3, 0.3, (3000, 2)), np.ones(3000)])
    length = np.linalg.norm(rays, axis=1)
    expected = marched(to_capsules(solids, np.zeros(3)), rays / length[:, None]) / length
    hits = cast_capsules(solids, rays.T)
    both = np.isfinite(hits.depths) & np.isfinite(expected)
    assert (np.isfinite(hits.depths) != np.isfinite(expected)).sum() <= 2  # rays that graze
    assert 500 < both.sum() < 2500
    # mm; marching stops short where it grazes
    np.testing.assert_allclose(hits.depths[both], expected[both], atol=0.01)
    assert np.median(np.abs(hits.depths[both] - expected[both])) < 1e-5
    points = hits.depths[both, None] * rays[both]
    nudged = capsule_distances(solids, points + 1e-3 * hits.normals[both]).min(axis=0)
    np.testing.assert_allclose(nudged, 1e-3, atol=1e-6)  # mm; the normals lead away at unit rate
    np.testing.assert_allclose(np.linalg.norm(hits.normals[both], axis=1), 1, atol=1e-9)


def test_a_ball_is_a_capsule_without_length():
    """Pencil and paper: a ball of 30 mm 300 mm ahead is met at 270 mm, and missed beyond
    asin(0.1).
    """
    ball = Capsules(np.array([[0, 0, 300.0]]), np.array([[0, 0, 300.0]]), np.array([30.0]))
    edge = np.tan(np.arcsin(0.1))
    hits = cast_capsules(ball, np.array([[0, 0.999 * edge, 1.001 * edge], [0, 0, 0], [1, 1, 1]]))
    assert hits.depths[0] == pytest.approx(270, abs=1e-9)
    assert np.isfinite(hits.depths).tolist() == [True, True, False]
    np.testing.assert_allclose(hits.normals[0], [0, 0, -1], atol=1e-12)


def test_capsules_behind_and_around_the_camera_are_not_seen():
    ahead = np.array([[0.0], [0.0], [1.0]])
    behind = Capsules(np.array([[0, 0, -300.0]]), np.array([[0, 50, -300.0]]), np.array([30.0]))
    around = Capsules(np.array([[0, 0, -5.0]]), np.array([[0, 0, 200.0]]), np.array([30.0]))
    beside = Capsules(np.array([[0, 0, -100.0]]), np.array([[0, 0, 40.0]]), np.array([30.0]))
    for solids in (behind, around, beside):
        assert np.isinf(cast_capsules(solids, ahead).depths).all()
    assert not capsule_region(CCD1, behind).any()
    assert capsule_region(CCD1, around).all()


def test_the_region_holds_all_that_meets_the_arm():
    for seed, camera in ((1, CCD1), (2, CCD2), (3, CCD3)):
        solids = in_camera(camera, capsules(Arm(), PAPER, random_pose(np.random.default_rng(seed))))
        v, u = np.mgrid[:1024:7, :1280:7].reshape(2, -1)
        xy = camera.normalise(np.column_stack([u, v]))
        met = np.isfinite(cast_capsules(solids, np.column_stack([xy, np.ones(len(xy))]).T).depths)
        region = capsule_region(camera, solids)
        assert met.sum() > 100
        assert region[v[met], u[met]].all()
        assert region.mean() < 1.4 * met.mean() + 0.03


# --- images


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [0, 180], ids=["fingers in front", "fingers behind"])
def test_what_is_nearer_hides_what_is_behind(turn_deg):
    """Pixels in the hand, at random: marching against all solids at once says which is first."""
    T, arm = upright(turn_deg=turn_deg), plain()
    image = radiance(CCD1, PAPER, T, FLAT, arm)
    centre = CCD1.project(T.apply([[0.0, -50, 0]]))[0]
    uv = np.round(centre + np.random.default_rng(4).uniform(-140, 140, (300, 2)))
    corners = [
        seen(CCD1, T, arm, uv + shift)
        for shift in ((0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (0, 0))
    ]
    whole = (np.array(corners) == corners[0]).all(axis=0)  # no edge near
    expected = np.select([corners[0] == "skin", corners[0] == "body"], [SKIN, 90.0], 0.0)
    u, v = uv[whole].astype(int).T
    np.testing.assert_allclose(image[v, u], expected[whole], atol=1e-9)
    assert all((expected[whole] == grey).sum() >= 5 for grey in (0.0, 90.0, SKIN))


def test_the_arm_leaves_all_else_as_it_was():
    T = upright()
    with_arm, without = (radiance(CCD1, PAPER, T, Bench(), arm) for arm in (Arm(), None))
    region = capsule_region(CCD1, in_camera(CCD1, capsules(Arm(), PAPER, T)))
    assert (with_arm[~region] == without[~region]).all()
    assert (with_arm != without).mean() > 0.05
    assert (radiance(CCD1, PAPER, None, Bench(), Arm()) == background(CCD1, Bench())).all()


def test_skin_is_lit_like_any_surface():
    """A fingertip that faces the light has the skin's grey, what turns away from it has 1 - shading
    of that.
    """
    lit, dimmed = (
        radiance(
            CCD1, PAPER, upright(), Bench(light=(0, 0, z), shading=0.4, background_grey=0), plain()
        )
        for z in (-1, 1)
    )
    hand = capsule_region(CCD1, in_camera(CCD1, capsules(plain(), PAPER, upright())))
    assert lit[hand].max() == pytest.approx(SKIN, abs=0.1)
    assert dimmed[1000, 628] == pytest.approx(0.6 * SKIN)


def test_the_texture_is_slight_and_moves_with_the_hand():
    grey = skin_grey(Arm(), np.random.default_rng(5).uniform(-100, 100, (2000, 3)))
    assert np.abs(grey / 110 - 1).max() <= 0.08
    assert grey.std() > 0.02 * 110
    assert grey.mean() == pytest.approx(110, abs=1)
    moved = []
    for T in (upright(), upright((20.0, -30, 600))):
        u, v = CCD1.project(T.apply([[0, -60, 24.0]]))[0].round().astype(int)
        moved.append(radiance(CCD1, PAPER, T, Bench(shading=0), Arm())[v, u])
    assert moved[0] == pytest.approx(moved[1], abs=2)  # grey levels; a pixel is 0.2 mm


# --- the hand and what it hides


def test_the_hand_holds_the_body_where_it_should():
    """Fingers reach from 40 to 110 mm below the origin and touch the body; they move rigidly with
    it.
    """
    T, other = random_pose(np.random.default_rng(6)), random_pose(np.random.default_rng(7))
    local = [capsules(Arm(), PAPER, pose) for pose in (T, other)]
    hands = [
        Capsules(pose.inv().apply(s.starts)[:-2], pose.inv().apply(s.ends)[:-2], s.radii[:-2])
        for pose, s in zip((T, other), local, strict=True)
    ]
    for ours, theirs in zip(*hands, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)  # mm
    fingers = Capsules(*(part[:8] for part in hands[0]))
    heights = np.concatenate([fingers.starts, fingers.ends])[:, 1]
    assert heights.max() + fingers.radii[0] == pytest.approx(-40)
    assert heights.min() - fingers.radii[0] == pytest.approx(-110)
    np.testing.assert_allclose(
        np.hypot(*fingers.starts[:, [0, 2]].T), PAPER.radius_mm + fingers.radii, atol=1e-9
    )


def test_the_forearm_leaves_towards_the_operator_and_from_the_free_end():
    for seed in range(12):
        T = random_pose(np.random.default_rng(seed))
        solids = capsules(Arm(), PAPER, T)
        leaving = solids.ends[-1] - solids.starts[-1]
        axis = T.rotation.as_matrix()[:, 1]
        assert leaving @ axis / np.linalg.norm(leaving) < -0.55
        assert np.linalg.norm(leaving) == pytest.approx(400)
        if axis[1] < -0.5:  # held upright
            assert leaving[2] > 0  # away from CCD1


@pytest.mark.slow
def test_no_marker_is_covered_by_default():
    rng = np.random.default_rng(8)
    for T in [*smooth_motion(rng, 6, 1), *(random_pose(rng) for _ in range(6))]:
        for camera in RIG.cameras:
            free, held = (true_visibility(camera, PAPER, T, arm) for arm in (None, Arm()))
            assert (free == held).all()


def test_a_second_hand_hides_the_markers_from_one_camera():
    for T in smooth_motion(np.random.default_rng(9), 5, 1):
        for hidden in (CCD1, CCD2):
            arm = Arm(hides_from=tuple(hidden.centre))
            assert not true_visibility(hidden, PAPER, T, arm).any()
            other = CCD2 if hidden is CCD1 else CCD1
            assert (true_visibility(other, PAPER, T, arm) == true_visibility(other, PAPER, T)).all()
    # half-way where the camera is near
    assert not true_visibility(CCD1, PAPER, upright((0.0, 0, 300)), Arm(hides_from=(0, 0, 0))).any()


@pytest.mark.slow
def test_true_visibility_counts_the_share_that_an_arm_hides():
    """A grip that slides over the lower row: the share that is shown, by marching rays to random
    points of a marker.
    """
    rng = np.random.default_rng(10)
    radius, phi = 1.5 * np.sqrt(rng.uniform(size=300)), rng.uniform(0, 2 * np.pi, 300)
    T, decided = upright(turn_deg=180), []
    for top in (-11.0, -9.5, -8.5):
        arm = Arm(grip_mm=(top - 70, top))
        solids = capsules(arm, PAPER, T)
        truly = true_visibility(CCD1, PAPER, T, arm)
        assert truly[::2].sum() == 3  # the upper row
        for k in 1 + 2 * np.flatnonzero(true_visibility(CCD1, PAPER, T)[1::2]):
            theta = PAPER.marker_angles[k] + radius * np.cos(phi) / PAPER.radius_mm
            points = on_cylinder(5.0, theta, PAPER.marker_centres[k, 1] + radius * np.sin(phi))
            world = T.apply(points) - CCD1.centre
            length = np.linalg.norm(world, axis=1)
            depth = marched(to_capsules(solids, CCD1.centre), world / length[:, None])
            share = (depth > length - 1e-3).mean()
            assert abs(share - 0.8) > 0.01
            assert truly[k] == (share > 0.8)
            decided.append(truly[k])
    assert 3 <= sum(decided) <= len(decided) - 3


# --- bad input


@pytest.mark.parametrize(("row", "said"), cases(Path(__file__).with_name("wrong.txt"), "Arm"))
def test_a_bad_arm_names_its_field(row, said):
    with pytest.raises(ValueError, match=f"^{row.split()[0]}: {said}"):
        Arm(**tomllib.loads(row))


def test_a_grip_may_be_given_either_way_round():
    assert Arm(grip_mm=(-40, -110)).grip_mm == Arm().grip_mm


def test_a_pose_that_leaves_no_direction_is_named():
    at, along = (0, 0, 570), (0, 0, 1)
    with pytest.raises(ValueError, match="T_world_handle: expected one"):
        capsules(Arm(), PAPER, RigidTransform.identity(2))
    with pytest.raises(ValueError, match="hides_from, seen from the handle: expected a direction"):
        capsules(Arm(hides_from=at), PAPER, upright(at))
    with pytest.raises(ValueError, match="forearm, across the line of sight: expected a direction"):
        capsules(Arm(hides_from=(0, 0, 0), forearm=along), PAPER, upright(at))
