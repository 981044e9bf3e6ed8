"""Cones and their intersection: against closed forms, counting, brute force, and in hostile
positions.
"""

import itertools
from functools import lru_cache, partial

import numpy as np
import pytest
from scipy.optimize import minimize

from trinolab.camera import Camera, Rig
from trinolab.datasets import load_rig, load_table1
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
from trinolab.workspace.extent import share_direction

RIGHT = np.pi / 4  # beta of cameras at right angles
DEG20 = np.deg2rad(20.0)
UP, DOWN = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
ACCURACY = 1e-7  # relative, that `intersect` promises for a volume


def paper(degrees, baseline=1.0, beta1=RIGHT, beta2=RIGHT):
    return paper_cones(baseline, beta1, beta2, np.deg2rad(degrees))


def random_cones(rng):
    """Two to four cones that look at about the same place."""
    target = rng.normal(0, 10, 3)
    apexes = rng.normal(0, 100, (rng.integers(2, 5), 3))
    return [Cone(q, target + rng.normal(0, 20, 3) - q, rng.uniform(0.05, 0.8)) for q in apexes]


@lru_cache
def bounded(count, seed):
    rng = np.random.default_rng(seed)
    found = (
        cones
        for cones in iter(lambda: random_cones(rng), None)
        if intersect(cones).status == "bounded"
    )
    return list(itertools.islice(found, count))


def drawn(count, seed):
    """Functions that give cones with a bounded intersection: drawing them takes seconds, so it
    waits for its test.
    """
    return [partial(lambda k: bounded(count, seed)[k], k) for k in range(count)]


@pytest.fixture
def cones(request):
    return request.param()


# --- one cone


def test_inside_by_hand():
    cone = Cone([0, 0, 0], UP, RIGHT)
    points = [
        [0, 0, 0],
        [0, 0, 1],
        [0.9, 0, 1],
        [1.1, 0, 1],
        [0, 0, -1],
        [0, -0.5, -1],
        [np.nan, 0, 1],
    ]
    assert inside([cone], points).tolist() == [True, True, True, False, False, False, False]


def test_inside_means_inside_every_cone():
    cones = [Cone([0, 0, 0], UP, DEG20), Cone([0, 0, 100], DOWN, DEG20)]
    # 50 tan 20 deg = 18.20
    points = [[0, 0, 50], [0, 0, 150], [0, 0, -50], [18.1, 0, 50], [18.3, 0, 50]]
    assert inside(cones, points).tolist() == [True, False, False, True, False]


def test_the_surface_parametrises_the_surface():
    rng = np.random.default_rng(0)
    for _ in range(20):
        cone = Cone(rng.normal(size=3), rng.normal(size=3), rng.uniform(0.01, 1.5))
        a, t = rng.uniform(0.1, 5, 30), rng.uniform(0, 2 * np.pi, 30)
        x = cone_surface(cone, a, t) - cone.apex
        along = x @ cone.axis
        across = np.linalg.norm(x - along[:, None] * cone.axis, axis=1)
        np.testing.assert_allclose(across, a, atol=1e-12)
        np.testing.assert_allclose(np.arctan2(across, along), cone.half_angle, atol=1e-12)


def test_normals_are_the_surface_s_gradient():
    cone = Cone([1.0, 2.0, 3.0], [1.0, -1.0, 2.0], 0.4)
    t = np.linspace(0, 6, 7)
    points, normals = cone.apex + 2.0 * cone.generators(t), cone.normals(t)
    np.testing.assert_allclose(np.einsum("ij,ij->i", normals, cone.generators(t)), 0.0, atol=1e-15)
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


def test_the_shift_of_equation_3_at_45_degrees_is_the_printed_one():
    np.testing.assert_allclose(
        paper(20, baseline=2.0)[2].apex, [1.0, np.sqrt(2.0), 1.0], atol=1e-12
    )


@pytest.mark.parametrize(("b1", "b2"), [(45, 45), (84.7, 84.9), (30, 70)])
def test_all_three_axes_meet(b1, b2):
    cones = paper_cones(100.0, np.deg2rad(b1), np.deg2rad(b2), 0.2)
    meeting = (
        cones[0].apex
        + np.linalg.norm(cones[2].apex - [cones[2].apex[0], 0, cones[2].apex[2]]) * cones[0].axis
    )
    for cone in cones:
        x = meeting - cone.apex
        np.testing.assert_allclose(x / np.linalg.norm(x), cone.axis, atol=1e-12)


def by_slices(w, n=2000):
    """Volume of the paper's cones at 45 deg in B^3: how long each line along y is inside, on a grid
    over x and z.
    """
    x, z = np.meshgrid((np.arange(n) + 0.5) / n, 1.3 * (np.arange(n) + 0.5) / n)
    u1, u2, c2 = (x + z) / np.sqrt(2), (1 - x + z) / np.sqrt(2), np.cos(w) ** 2
    y2 = np.minimum(u1**2 / c2 - x**2 - z**2, u2**2 / c2 - (1 - x) ** 2 - z**2)
    y = np.sqrt(np.maximum(y2, 0.0))
    top = np.minimum(y, np.sqrt(0.5) - np.hypot(x - 0.5, z - 0.5) / np.tan(w))
    return np.where((y2 > 0) & (top > -y), top + y, 0.0).sum() * 1.3 / n**2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degrees", "volume"),
    [
        (10, 0.008822),
        pytest.param(15, 0.029886, marks=pytest.mark.heavy),
        pytest.param(20, 0.071490, marks=pytest.mark.heavy),
        (30, 0.255315),
    ],
)
def test_volumes_of_the_paper_s_cones(degrees, volume):
    found = intersect(paper(degrees)).volume
    assert found == pytest.approx(volume, abs=6e-7)  # B^3; the number's last digit
    # the grid's error, from halving it: 1e-6
    assert found == pytest.approx(by_slices(np.deg2rad(degrees)), rel=1e-5)


# --- volumes


def test_two_equal_facing_cones():
    h, w = 100.0, DEG20
    found = intersect([Cone([0, 0, 0], UP, w), Cone([0, 0, h], DOWN, w)])
    assert found.volume == pytest.approx(np.pi * h**3 * np.tan(w) ** 2 / 12, rel=ACCURACY)
    np.testing.assert_allclose(found.centroid, [0, 0, h / 2], atol=1e-9)
    r = h / 2 * np.tan(w)
    # mm; TOLERANCE x scale
    np.testing.assert_allclose(found.bounding_box, [[-r, -r, 0], [r, r, h]], atol=1e-6)
    assert found.radius == pytest.approx(h / 2 * np.sin(w), abs=1e-7)


def test_two_unequal_facing_cones_off_the_axes():
    h, w, v = 37.0, 0.3, 0.9
    axis = np.array([2.0, -1.0, 2.0]) / 3
    apex = np.array([500.0, -300.0, 800.0])
    found = intersect([Cone(apex, axis, w), Cone(apex + h * axis, -axis, v)])
    first = h * np.tan(v) / (np.tan(w) + np.tan(v))  # height of the first cone's part
    r = first * np.tan(w)
    assert found.volume == pytest.approx(np.pi * r**2 * h / 3, rel=ACCURACY)
    middle = first / 2 + h / 4  # of two cones base to base: the mean of 0, first, first, h
    np.testing.assert_allclose((found.centroid - apex) @ axis, middle, atol=1e-8)


@pytest.mark.parametrize("cones", drawn(6, seed=1), indirect=True, ids=range(6))
def test_against_counting_points(cones):
    found = intersect(cones)
    rng = np.random.default_rng(7)
    low, high = found.bounding_box
    points = rng.uniform(low, high, (400_000, 3))
    hit = inside(cones, points)
    p, box = hit.mean(), np.prod(high - low)
    sigma = np.sqrt(p * (1 - p) / len(points))
    assert abs(found.volume / box - p) < 4.5 * sigma
    scatter = points[hit].std(axis=0) / np.sqrt(hit.sum())
    assert (np.abs(points[hit].mean(axis=0) - found.centroid) < 4.5 * scatter).all()
    wider = rng.uniform(low - (high - low), high + (high - low), (400_000, 3))
    outside = ((wider < low) | (wider > high)).any(axis=1)
    assert not inside(cones, wider[outside]).any()


def by_generators(cones, centre, n=2**19):
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "cones",
    [
        *drawn(4, seed=2)[:2],
        *(pytest.param(cones, marks=pytest.mark.heavy) for cones in drawn(4, seed=2)[2:]),
        partial(paper, 20),
        pytest.param(partial(paper, 44), marks=pytest.mark.heavy),
        pytest.param(lambda: cones_of_rig(load_rig("paper_trinocular")), marks=pytest.mark.heavy),
        lambda: cones_of_rig(load_rig("raised_40deg")),
    ],
    indirect=True,
    ids=range(8),
)
def test_against_integrals_over_the_conic_faces(cones):
    found = intersect(cones)
    volume, centroid = by_generators(cones, found.centre)
    assert found.volume == pytest.approx(volume, rel=ACCURACY)  # the equal steps are right to 3e-8
    np.testing.assert_allclose(
        found.centroid, centroid, atol=ACCURACY * np.ptp(found.bounding_box, axis=0).max()
    )


@pytest.mark.parametrize("half_angle", [1e-2, 1e-4, 1e-6])
def test_facing_needles(half_angle):
    found = intersect([Cone([0, 0, 0], UP, half_angle), Cone([0, 0, 10], DOWN, half_angle)])
    assert found.volume == pytest.approx(np.pi * 10**3 * np.tan(half_angle) ** 2 / 12, rel=ACCURACY)


def test_a_small_part_of_a_wide_cone():
    # The second cone's apex is just inside the first, whose surface is nearly flat there: the
    # volume goes with gap^3.
    def volume(gap):
        return (
            intersect(
                [
                    Cone([0, 0, 0], UP, DEG20),
                    Cone([10 * np.sin(DEG20) - gap, 0, 10 * np.cos(DEG20)], [1, 0, 0], DEG20),
                ]
            ).volume
            / gap**3
        )

    # nearly a line
    assert volume(1e-4) == pytest.approx(1.1 * volume(1e-3) - 0.1 * volume(1e-2), rel=ACCURACY)


@pytest.mark.slow
def test_a_splinter_between_two_apexes():
    # 106 mm by 0.1 mm
    cones = [Cone([0, 0, 0], UP, DEG20), Cone([100 * np.tan(DEG20) - 0.1, 0, 100], DOWN, DEG20)]
    found = intersect(cones)
    assert found.volume == pytest.approx(by_generators(cones, found.centre)[0], rel=ACCURACY)


@pytest.mark.parametrize("cones", drawn(2, seed=3), indirect=True, ids=range(2))
def test_volume_scales_and_does_not_move(cones):
    one = intersect(cones)
    moved = intersect(
        [Cone(3.0 * cone.apex + [1e4, 0.0, -5e3], cone.axis, cone.half_angle) for cone in cones]
    )
    assert moved.volume == pytest.approx(27.0 * one.volume, rel=1e-9)
    np.testing.assert_allclose(moved.centroid, 3.0 * one.centroid + [1e4, 0.0, -5e3], atol=1e-6)
    backwards = intersect(cones[::-1])
    assert backwards.volume == pytest.approx(one.volume, rel=1e-9)


@pytest.mark.parametrize(
    "cones",
    [partial(paper, 20), partial(paper, 30), *drawn(3, seed=4)],
    indirect=True,
    ids=range(5),
)
def test_the_mesh_lies_on_the_surface_and_closes(cones):
    found = intersect(cones)
    vertices, triangles = surface_mesh(cones, found.centre, 6000)
    out = vertices - found.centre
    assert inside(cones, found.centre + (1 - 1e-9) * out).all()
    assert not inside(cones, found.centre + (1 + 1e-9) * out).any()
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = ({tuple(edge) for edge in ends} for ends in (edges, edges[:, ::-1]))
    assert there == back  # every edge is used once in each direction
    low, high = found.bounding_box
    assert (vertices >= low - 1e-6).all()
    assert (vertices <= high + 1e-6).all()
    assert 0 < mesh_volume(vertices, triangles) < found.volume  # a convex body's chords lie inside


def test_the_mesh_converges_to_the_volume():
    cones = paper(20)
    found = intersect(cones)
    gaps = [
        1 - mesh_volume(*surface_mesh(cones, found.centre, n)) / found.volume
        for n in (1000, 4000, 16000)
    ]
    # second order in the edge: 4 times the vertices, a quarter
    assert gaps[0] > 3 * gaps[1] > 9 * gaps[2] > 0
    assert gaps[2] < 1e-3


@pytest.mark.parametrize(
    "cones",
    [
        partial(paper, 20),
        *(pytest.param(one, marks=pytest.mark.heavy) for one in drawn(3, seed=5)),
    ],
    indirect=True,
    ids=range(4),
)
def test_the_bounding_box_against_another_optimiser(cones):
    found = intersect(cones)

    def room(p):  # in every cone, at least 0
        return [
            (p - c.apex) @ c.axis - np.cos(c.half_angle) * np.linalg.norm(p - c.apex) for c in cones
        ]

    size = np.ptp(found.bounding_box, axis=0).max()
    for k, sign in itertools.product(range(3), (1.0, -1.0)):
        best = minimize(
            lambda p, k=k, s=sign: -s * p[k] / size,
            found.centre,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda p: np.array(room(p)) / size},
            options={"ftol": 1e-12, "maxiter": 500},
        )
        assert best.x[k] == pytest.approx(found.bounding_box[int(sign > 0), k], abs=1e-4 * size)


@pytest.mark.slow
def test_the_inscribed_ball_touches_and_fits():
    for cones in [paper(20), *bounded(3, 6)]:
        found = intersect(cones)
        rooms = [
            np.sin(c.half_angle) * ((found.centre - c.apex) @ c.axis)
            - np.cos(c.half_angle) * np.linalg.norm(np.cross(found.centre - c.apex, c.axis))
            for c in cones
        ]
        assert min(rooms) == pytest.approx(found.radius, abs=1e-6)  # mm


# --- hostile positions


HOSTILE = {
    "facing away": ([Cone([0, 0, 0], DOWN, DEG20), Cone([0, 0, 100], UP, DEG20)], "empty"),
    "back to back in one point": (
        [Cone([0, 0, 0], UP, DEG20), Cone([0, 0, 0], DOWN, DEG20)],
        "empty",
    ),
    "an apex on the other's surface": (
        [
            Cone([0, 0, 0], UP, DEG20),
            Cone([10 * np.sin(DEG20), 0, 10 * np.cos(DEG20)], [1, 0, 0], DEG20),
        ],
        "empty",
    ),
    "side by side": ([Cone([0, 0, 0], UP, DEG20), Cone([10, 0, 0], UP, DEG20)], "unbounded"),
    "one alone": ([Cone([0, 0, 0], UP, DEG20)], "unbounded"),
    "one alone, twice": ([Cone([0, 0, 0], UP, DEG20)] * 2, "unbounded"),
    "a common direction, apart": (
        [
            Cone([0, 0, 0], UP, DEG20),
            Cone([100, 0, 0], [np.sin(2 * DEG20), 0, np.cos(2 * DEG20)], DEG20),
        ],
        "empty",
    ),
    "a common direction, overlapping": (
        [
            Cone([0, 0, 0], UP, DEG20),
            Cone([-100, 0, 0], [np.sin(2 * DEG20), 0, np.cos(2 * DEG20)], DEG20),
        ],
        "unbounded",
    ),
    "needles that miss": ([Cone([0, 0, 0], UP, 1e-4), Cone([5, 1, 10], [-1, 0, 0], 1e-4)], "empty"),
    "needles that meet": (
        [Cone([0, 0, 0], UP, 1e-4), Cone([5, 0, 10], [-1, 0, 0], 1e-4)],
        "bounded",
    ),
    "nearly half-spaces": ([Cone([0, 0, 0], UP, 1.57), Cone([0, 0, 1], DOWN, 1.57)], "bounded"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_status(name):
    cones, status = HOSTILE[name]
    found = intersect(cones)
    assert found.status == status
    assert is_unbounded(cones) == (status == "unbounded")
    if status != "bounded":
        assert found.volume == {"empty": 0.0, "unbounded": np.inf}[status]
        assert np.isnan(
            [*found.bounding_box.ravel(), *found.centre, found.radius, *found.centroid]
        ).all()


def test_repeated_and_redundant_cones_change_nothing():
    cones = paper(20, baseline=100.0)
    volume = intersect(cones).volume
    around = Cone([0, 0, -50], cones[0].axis, np.deg2rad(60))
    for more in ([*cones, cones[0]], [*cones, *cones], [around, *cones]):
        assert intersect(more).volume == pytest.approx(volume, rel=1e-9)


def test_cones_from_one_apex():
    # The limit of apexes that come together.
    def volume(gap):
        return intersect(
            [
                Cone([0, 0, 0], UP, DEG20),
                Cone([0, 0, gap], [0.3, 0, 1], DEG20),
                Cone([0, 0, 100], DOWN, DEG20),
            ]
        ).volume

    assert volume(0.0) == pytest.approx(volume(1e-6), rel=1e-7)
    # equal steps, 2^20 of them, agree to 2.5e-7
    assert volume(0.0) == pytest.approx(19066.590414, rel=1e-8)


def test_apexes_on_each_other_s_surfaces():
    # At 45 deg a generator of each cone runs along the baseline through the other's apex.
    assert intersect(paper(45 * (1 - 1e-12))).volume == pytest.approx(4 / 3, rel=1e-7)


def test_share_direction_against_many_directions():
    rng = np.random.default_rng(8)
    tries = rng.normal(size=(200_000, 3))
    tries /= np.linalg.norm(tries, axis=1, keepdims=True)
    answers = []
    for _ in range(40):
        cones = [
            Cone([0, 0, 0], rng.normal(size=3) + [0, 0, 1.5], rng.uniform(0.2, 1.4))
            for _ in range(3)
        ]
        found = np.all([tries @ c.axis >= np.cos(c.half_angle) for c in cones], axis=0).any()
        answers.append(found)
        if found:
            assert share_direction(cones)
        elif share_direction(
            cones, margin=0.02
        ):  # 0.02 rad wide: a hundred of the directions would be in it
            pytest.fail("a direction that none of 200,000 found")
    assert {True, False} == {bool(answer) for answer in answers}


# --- cameras


def test_half_angle_of_ccd1():
    assert np.rad2deg(half_angle([1280, 1024], [2956.2067, 2940.0975])) == pytest.approx(
        15.5, abs=0.05
    )
    assert np.rad2deg(half_angle([1280, 0.001], 2956.2067)) == pytest.approx(12.2, abs=0.05)
    assert half_angle([6.0, 8.0], 5.0) == pytest.approx(np.pi / 4)


@pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])
def test_cones_of_a_rig_contain_all_that_is_seen_and_touch_a_corner(name):
    rig = load_rig(name)
    rng = np.random.default_rng(9)
    for camera, cone in zip(rig.cameras, cones_of_rig(rig), strict=True):
        width, height = camera.size
        uv = np.vstack(
            [
                rng.uniform([-0.5, -0.5], [width - 0.5, height - 0.5], (2000, 2)),
                list(itertools.product((-0.5, width - 0.5), (-0.5, height - 0.5))),
            ]
        )
        angles = np.arccos(camera.rays(uv) @ cone.axis)
        assert angles.max() == pytest.approx(cone.half_angle, abs=1e-12)
        np.testing.assert_array_equal(cone.apex, camera.centre)


@pytest.mark.parametrize("name", ["paper_trinocular", "raised_40deg"])
def test_true_field_of_view_against_counting_points(name):
    rig = load_rig(name)
    view, box = view_volume(rig), intersect(cones_of_rig(rig)).bounding_box
    rng = np.random.default_rng(10)
    points = rng.uniform(*box, (400_000, 3))
    seen = np.all([camera.sees(points) for camera in rig.cameras], axis=0)
    p = seen.mean()
    assert abs(view.volume / np.prod(np.ptp(box, axis=0)) - p) < 4.5 * np.sqrt(
        p * (1 - p) / len(points)
    )
    assert mesh_volume(view.vertices, view.triangles) == pytest.approx(view.volume, rel=1e-9)
    assert inside(cones_of_rig(rig), points[seen]).all()
    middle = view.vertices.mean(axis=0)
    for camera in rig.cameras:
        assert camera.sees(middle + 0.999999 * (view.vertices - middle)).all()


def test_views_without_an_end_or_a_common_part():
    assert view_volume(load_rig("paper_pair")).status == "unbounded"
    a, b = load_rig("paper_pair").cameras
    turned = Camera("back", b.size, b.matrix, b.distortions, b.T_cam_world * turn_about_y())
    assert view_volume(Rig((a, turned))).status == "empty"
    assert view_volume(Rig((a, turned))).volume == 0.0


def turn_about_y():
    from scipy.spatial.transform import RigidTransform, Rotation

    return RigidTransform.from_rotation(Rotation.from_rotvec([0.0, np.pi, 0.0]))


def test_table1_lies_in_the_workspace():
    for name in ("paper_pair", "paper_trinocular", "raised_40deg"):
        assert inside(cones_of_rig(load_rig(name)), load_table1().set_poses.translation).all()


# --- what is refused


def distorted():
    a, b = load_rig("paper_pair").cameras
    return Rig((a, Camera("b", b.size, b.matrix, np.array([0.1, 0, 0, 0, 0]), b.T_cam_world)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Cone([0, 0], UP, 0.3), "apex"),
        (lambda: Cone([0, 0, np.nan], UP, 0.3), "apex"),
        (lambda: Cone([0, 0, 0], [0, 0, 0], 0.3), "axis"),
        (lambda: Cone([0, 0, 0], UP, 0.0), "half_angle"),
        (lambda: Cone([0, 0, 0], UP, np.pi / 2), "half_angle"),
        (lambda: Cone([0, 0, 0], UP, True), "half_angle"),
        (lambda: intersect([]), "cones"),
        (lambda: intersect(["cone"]), "cones"),
        (lambda: inside(paper(20), [1.0, 2.0, 3.0]), "points"),
        (lambda: paper_cones(0.0, 1.0, 1.0, 0.2), "baseline"),
        (lambda: paper_cones(1.0, 0.0, 1.0, 0.2), "beta1"),
        (lambda: paper_cones(1.0, 1.0, 2.0, 0.2), "beta2"),
        (lambda: paper_cones(1.0, np.pi / 2, np.pi / 2, 0.2), "axes that meet"),
        (lambda: half_angle([1.0, -1.0], 2.0), "size"),
        (lambda: half_angle([1.0, 1.0], [0.0, 1.0]), "focal"),
        (lambda: cone_surface(paper(20)[0], [-1.0], [0.0]), "a: "),
        (lambda: cone_surface(paper(20)[0], [1.0], [0.0, 1.0]), "t: "),
        (lambda: surface_mesh(paper(20), [10.0, 0.0, 0.0]), "centre"),
        (lambda: surface_mesh(paper(20)[:1], [1.0, 0.0, 1.0]), "without an end"),
        (lambda: view_volume(distorted()), "camera b: expected no lens distortion"),
    ],
)
def test_refuses(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_results_are_read_only():
    found = intersect(paper(20))
    for array in (
        found.bounding_box,
        found.centre,
        found.centroid,
        found.cones[0].apex,
        found.cones[0].across,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
