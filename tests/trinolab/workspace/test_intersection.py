"""Cones and their intersection: against closed forms, counting, brute force, and in hostile
positions.
"""

import itertools
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera, Rig
from trinolab.datasets import load_rig
from trinolab.workspace import intersect, is_unbounded, mesh_volume, surface_mesh, view_volume
from trinolab.workspace.cones import (
    Cone,
    chord,
    cone_surface,
    cones_of_rig,
    half_angle,
    inside,
    paper_cones,
)
from trinolab.workspace.extent import _circles_meet

DEG20 = np.deg2rad(20.0)
UP, DOWN = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
ACCURACY = 1e-7  # relative, that `intersect` promises for a volume


def paper(degrees, baseline=1.0):
    """At right angles."""
    return paper_cones(baseline, np.pi / 4, np.pi / 4, np.deg2rad(degrees))


def facing(w, v=None, h=100.0):
    return [Cone([0, 0, 0], UP, w), Cone([0, 0, h], DOWN, w if v is None else v)]


@lru_cache
def bounded(seed):
    """Two to four cones that look at about the same place, and whose intersection is bounded."""
    rng = np.random.default_rng(seed)
    while True:
        target, apexes = rng.normal(0, 10, 3), rng.normal(0, 100, (rng.integers(2, 5), 3))
        cones = [Cone(q, target + rng.normal(0, 20, 3) - q, rng.uniform(0.05, 0.8)) for q in apexes]
        if intersect(cones).status == "bounded":
            return cones


CONES = {
    "drawn 1": lambda: bounded(1),
    "drawn 2": lambda: bounded(2),
    "paper": lambda: paper(20),
    "wide": lambda: paper(44),
    "rig": lambda: cones_of_rig(load_rig("raised_40deg")),
    # 106 mm by 0.1 mm
    "facing": lambda: facing(DEG20),
    "splinter": lambda: [
        Cone([0, 0, 0], UP, DEG20),
        Cone([100 * np.tan(DEG20) - 0.1, 0, 100], DOWN, DEG20),
    ],
    "one apex": lambda: [*facing(DEG20), Cone([0, 0, 0], [0.3, 0, 1], DEG20)],
}


def each(*names):
    return pytest.mark.parametrize("cones", [CONES[name]() for name in names], ids=names)


def test_inside_by_hand():
    points = [[0, 0, 0], [0.9, 0, 1], [1.1, 0, 1], [0, 0, -1], [0, -0.5, -1], [np.nan, 0, 1]]
    found = inside([Cone([0, 0, 0], UP, np.pi / 4)], points)
    assert found.tolist() == [True, True, False, False, False, False]
    # in every cone; 50 tan 20 deg = 18.20
    points = [[0, 0, 50], [0, 0, 150], [0, 0, -50], [18.1, 0, 50], [18.3, 0, 50]]
    assert inside(facing(DEG20), points).tolist() == [True, False, False, True, False]


def test_the_surface_parametrises_the_surface_and_normals_stand_on_it():
    rng = np.random.default_rng(0)
    axes = [*rng.normal(size=(10, 3)), [0, 1, 0], [1e-4, 1, 0]]
    for axis in axes:
        cone = Cone(rng.normal(size=3), axis, rng.uniform(0.1, 1.5))
        a, t = rng.uniform(0.1, 5, 30), rng.uniform(0, 2 * np.pi, 30)
        points, normals = cone_surface(cone, a, t), cone.normals(t)
        x = points - cone.apex
        along = x @ cone.axis
        across = np.linalg.norm(x - along[:, None] * cone.axis, axis=1)
        np.testing.assert_allclose(across, a, atol=1e-12)
        np.testing.assert_allclose(np.arctan2(across, along), cone.half_angle, atol=1e-12)
        np.testing.assert_allclose((normals * x).sum(axis=1), 0.0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
        assert inside([cone], points - 1e-9 * normals).all()
        assert not inside([cone], points + 1e-9 * normals).any()


# --- the paper's cones


def corrected(a, t, w, b1, b2, B):
    """Eq. 1 to 3 typed from the paper with the turns of its text."""
    x0 = B * np.tan(b2) / (np.tan(b1) + np.tan(b2))
    z0 = x0 * np.tan(b1)
    cot = 1 / np.tan(w)
    return (
        [
            a * np.sin(b1) * np.cos(t) + a * np.cos(b1) * cot,
            a * np.sin(t),
            -a * np.cos(b1) * np.cos(t) + a * np.sin(b1) * cot,
        ],
        [
            a * np.sin(b2) * np.cos(t) - a * np.cos(b2) * cot + B,
            a * np.sin(t),
            a * np.cos(b2) * np.cos(t) + a * np.sin(b2) * cot,
        ],
        [a * np.cos(t) + x0, np.hypot(x0, z0) - a * cot, a * np.sin(t) + z0],
    )


@pytest.mark.parametrize(("b1", "b2"), [(45, 45), (84.7, 84.9), (30, 70), (60, 89)])
def test_equations_1_to_3_give_the_surfaces(b1, b2):
    b1, b2, w, B = np.deg2rad(b1), np.deg2rad(b2), 0.3, 99.19
    a, t = np.linspace(0, 50, 40), np.linspace(0, 7, 40)
    for cone, formula in zip(paper_cones(B, b1, b2, w), corrected(a, t, w, b1, b2, B), strict=True):
        np.testing.assert_allclose(cone_surface(cone, a, t), np.transpose(formula), atol=1e-9)  # mm


@pytest.mark.parametrize(("degrees", "volume"), [(10, 0.008822), (20, 0.071490), (30, 0.255315)])
def test_volumes_of_the_paper_s_cones(degrees, volume):
    found = intersect(paper(degrees)).volume
    assert found == pytest.approx(volume, abs=6e-7)  # B^3; the number's last digit


# --- volumes


@pytest.mark.parametrize(("w", "v"), [(DEG20, DEG20), (0.3, 0.9), (1e-2, 1e-2), (1e-6, 1e-6)])
def test_facing_cones_off_the_axes(w, v):
    h, axis, apex = 37.0, np.array([2.0, -1.0, 2.0]) / 3, np.array([500.0, -300.0, 800.0])
    found = intersect([Cone(apex, axis, w), Cone(apex + h * axis, -axis, v)])
    first = h * np.tan(v) / (np.tan(w) + np.tan(v))  # height of the first cone's part
    r = first * np.tan(w)
    assert found.volume == pytest.approx(np.pi * r**2 * h / 3, rel=ACCURACY)
    middle = first / 2 + h / 4  # of two cones base to base: the mean of 0, first, first, h
    np.testing.assert_allclose((found.centroid - apex) @ axis, middle, atol=1e-8)


def by_generators(cones, centre, n=2**18):
    """Volume and centroid by the divergence theorem, generator by generator of each cone in equal
    steps of its turn.
    """
    volume, first = 0.0, np.zeros(3)
    for k, cone in enumerate(cones):
        t = np.arange(n) * (2 * np.pi / n)
        g = cone.generators(t)
        chords = [chord(other, cone.apex, g) for other in (*cones[:k], *cones[k + 1 :])]
        start = np.max([np.zeros(n), *(low for low, _ in chords)], axis=0)
        end = np.min([high for _, high in chords], axis=0)
        start, end = np.where(start < end, [start, end], 0.0)
        # along a generator, (p - centre) . normal is m . normal, and dA = s sin(w) ds dt
        m = cone.apex - centre
        weights = 2 * np.pi / n * np.sin(cone.half_angle) * (cone.normals(t) @ m)
        area, arm = weights @ (end**2 - start**2) / 2, (weights * (end**3 - start**3) / 3) @ g
        volume += area / 3
        first += (area * m + arm) / 4
    return volume, centre + first / volume


@each("drawn 1", "drawn 2", "paper", "wide", "rig", "splinter")
def test_against_integrals_over_the_conic_faces(cones):
    found = intersect(cones)
    volume, centroid = by_generators(cones, found.centre)
    assert found.volume == pytest.approx(volume, rel=ACCURACY)  # the equal steps are right to 3e-8
    size = np.ptp(found.bounding_box, axis=0).max()
    np.testing.assert_allclose(found.centroid, centroid, atol=ACCURACY * size)


@each("drawn 1", "one apex")
def test_volume_scales_and_does_not_move(cones):
    one = intersect(cones)
    shift = np.array([1e4, 0.0, -5e3])
    moved = intersect([Cone(3 * c.apex + shift, c.axis, c.half_angle) for c in cones])
    assert moved.volume == pytest.approx(27.0 * one.volume, rel=1e-9)
    np.testing.assert_allclose(moved.centroid, 3.0 * one.centroid + shift, atol=1e-6)
    # nor do repeated and redundant ones change anything
    around = Cone(cones[0].apex - 50 * cones[0].axis, cones[0].axis, cones[0].half_angle + 0.3)
    for more in (cones[::-1], [*cones, cones[0]], [around, *cones]):
        assert intersect(more).volume == pytest.approx(one.volume, rel=1e-9)


def test_apexes_in_one_place_and_on_each_other_s_surfaces():
    # equal steps, 2^20 of them, agree to 2.5e-7
    assert intersect(CONES["one apex"]()).volume == pytest.approx(19066.590414, rel=1e-8)
    # At 45 deg a generator of each cone runs along the baseline through the other's apex.
    assert intersect(paper(45 * (1 - 1e-12))).volume == pytest.approx(4 / 3, rel=1e-7)


@each("paper", "facing")
def test_the_mesh_lies_on_the_surface_and_closes(cones):
    found = intersect(cones)
    vertices, triangles = surface_mesh(cones, found.centre, 6000)
    out = vertices - found.centre
    assert inside(cones, found.centre + (1 - 1e-9) * out).all()
    assert not inside(cones, found.centre + (1 + 1e-9) * out).any()
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = ({tuple(edge) for edge in ends} for ends in (edges, edges[:, ::-1]))
    assert there == back  # every edge is used once in each direction
    # a convex body's chords lie inside; second order in the edge
    gaps = [
        1 - mesh_volume(*surface_mesh(cones, found.centre, n)) / found.volume for n in (1500, 6000)
    ]
    assert gaps[0] > 3 * gaps[1] > 0


@each("drawn 2", "paper", "facing")
def test_box_and_ball_against_another_optimiser(cones):
    found = intersect(cones)
    size = np.ptp(found.bounding_box, axis=0).max()

    def room(p):  # in every cone, at least 0
        cosines = [np.cos(c.half_angle) * np.linalg.norm(p - c.apex) for c in cones]
        return np.array([(p - c.apex) @ c.axis for c in cones]) - cosines

    for k, sign in itertools.product(range(3), (1.0, -1.0)):
        best = minimize(
            lambda p, k=k, s=sign: -s * p[k] / size,
            found.centre,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda p: room(p) / size},
            options={"ftol": 1e-12, "maxiter": 500},
        )
        assert best.x[k] == pytest.approx(found.bounding_box[int(sign > 0), k], abs=1e-4 * size)
    rooms = [
        np.sin(c.half_angle) * ((found.centre - c.apex) @ c.axis)
        - np.cos(c.half_angle) * np.linalg.norm(np.cross(found.centre - c.apex, c.axis))
        for c in cones
    ]
    assert min(rooms) == pytest.approx(found.radius, abs=1e-6 * size)  # the ball touches and fits


# --- hostile positions

ONE, TURNED = Cone([0, 0, 0], UP, DEG20), [np.sin(2 * DEG20), 0, np.cos(2 * DEG20)]
ON_SURFACE = [10 * np.sin(DEG20), 0, 10 * np.cos(DEG20)]
FURTHER = [np.sin(2 * DEG20 + 1e-7), 0, np.cos(2 * DEG20 + 1e-7)]
NEEDLE = Cone([0, 0, 0], UP, 1e-4)
HOSTILE = {
    "facing away": ([Cone([0, 0, 0], DOWN, DEG20), Cone([0, 0, 100], UP, DEG20)], "empty"),
    "back to back in one point": ([ONE, Cone([0, 0, 0], DOWN, DEG20)], "empty"),
    "an apex on the other's surface": ([ONE, Cone(ON_SURFACE, [1, 0, 0], DEG20)], "empty"),
    "one alone": ([ONE], "unbounded"),
    "a common direction, apart": ([ONE, Cone([100, 0, 0], TURNED, DEG20)], "empty"),
    "a common direction, overlapping": ([ONE, Cone([-100, 0, 0], TURNED, DEG20)], "unbounded"),
    "an end too far away": ([ONE, Cone([-100, 0, 0], FURTHER, DEG20)], "unbounded"),
    "needles that miss": ([NEEDLE, Cone([5, 1, 10], [-1, 0, 0], 1e-4)], "empty"),
    "needles that meet": ([NEEDLE, Cone([5, 0, 10], [-1, 0, 0], 1e-4)], "bounded"),
    "nearly half-spaces": (facing(1.57, h=1), "bounded"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_status(name):
    cones, status = HOSTILE[name]
    found = intersect(cones)
    assert found.status == status
    assert is_unbounded(cones) == (status == "unbounded")
    if status != "bounded":
        assert found.volume == {"empty": 0.0, "unbounded": np.inf}[status]
        rest = [*found.bounding_box.ravel(), *found.centre, found.radius, *found.centroid]
        assert np.isnan(rest).all()


# --- cameras


def test_circles_meet_in_two_directions_at_both_angles():
    axes = np.array([UP, [0.6, 0.0, 0.8]])
    directions = _circles_meet(*axes, 0.4, 0.6)
    np.testing.assert_allclose(directions @ axes.T, np.cos([[0.4, 0.6]] * 2), atol=1e-12)
    np.testing.assert_allclose((directions**2).sum(axis=1), 1.0)


def test_half_angle_of_ccd1():
    omega = half_angle([1280, 1024], [2956.2067, 2940.0975])
    assert np.rad2deg(omega) == pytest.approx(15.5, abs=0.05)
    assert half_angle([6.0, 8.0], 5.0) == pytest.approx(np.pi / 4)


def test_cones_of_a_rig_contain_all_that_is_seen_and_touch_a_corner():
    rig = load_rig("raised_40deg")
    for camera, cone in zip(rig.cameras, cones_of_rig(rig), strict=True):
        u, v = np.meshgrid(*(np.linspace(-0.5, side - 0.5, 30) for side in camera.size))
        angles = np.arccos(camera.rays(np.column_stack([u.ravel(), v.ravel()])) @ cone.axis)
        assert angles.max() == pytest.approx(cone.half_angle, abs=1e-12)
        np.testing.assert_array_equal(cone.apex, camera.centre)


def test_true_field_of_view_against_counting_points():
    rig, n = load_rig("raised_40deg"), 100_000
    for farthest in (None, 560.0):
        view, box = view_volume(rig, farthest), intersect(cones_of_rig(rig)).bounding_box
        points = np.random.default_rng(10).uniform(*box, (n, 3))
        seen = np.all([camera.sees(points) for camera in rig.cameras], axis=0)
        for camera in rig.cameras if farthest else ():
            seen &= (points - camera.centre) @ camera.axis < farthest
        p = seen.mean()
        off = abs(view.volume / np.prod(np.ptp(box, axis=0)) - p)
        assert off < 4.5 * np.sqrt(p * (1 - p) / n)
        assert mesh_volume(view.vertices, view.triangles) == pytest.approx(view.volume, rel=1e-9)
        middle = view.vertices.mean(axis=0)
        for camera in rig.cameras:
            assert camera.sees(middle + 0.999999 * (view.vertices - middle)).all()


def test_views_without_an_end_or_a_common_part():
    rig = load_rig("paper_pair")
    assert view_volume(rig).status == "unbounded"
    assert view_volume(rig, 600.0).status == "bounded"
    a, b = rig.cameras
    half_turn = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, np.pi, 0.0]))
    back = Camera("back", b.size, b.matrix, b.distortions, b.T_cam_world * half_turn)
    found = view_volume(Rig((a, back)))
    assert (found.status, found.volume) == ("empty", 0.0)


A, B = load_rig("paper_pair").cameras
DISTORTED = Rig((A, Camera("b", B.size, B.matrix, np.array([0.1, 0, 0, 0, 0]), B.T_cam_world)))


REFUSED = [
    (Cone, ([0, 0, 0], [0, 0, 0], 0.3), "axis"),
    (Cone, ([0, 0, 0], UP, 0.0), "half_angle"),
    (Cone, ([0, 0, 0], UP, np.pi / 2), "half_angle"),
    (paper_cones, (0.0, 1.0, 1.0, 0.2), "baseline"),
    (paper_cones, (1.0, 1.0, 2.0, 0.2), "beta2"),
    (paper_cones, (1.0, np.pi / 2, np.pi / 2, 0.2), "axes that meet"),
    (cone_surface, (ONE, [-1.0], [0.0]), "a: "),
    (surface_mesh, (paper(20), [10.0, 0.0, 0.0]), "centre"),
    (surface_mesh, ([ONE], [0.0, 0.0, 1.0]), "without an end"),
    (view_volume, (DISTORTED,), "camera b: expected no lens distortion"),
]


@pytest.mark.parametrize(("call", "given", "message"), REFUSED)
def test_refuses(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(*given)
