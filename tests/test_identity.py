"""Hypotheses and identity: poses from triplets, labels, symmetry, prior."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle, slants
from trinolab.hypotheses import explain, triplet_poses
from trinolab.identity import (
    IdentityParameters,
    choose,
    equivalents,
    identify,
    labelled_pixels,
    relabel,
)
from trinolab.scene import random_pose
from trinolab.triangulation import triangulate, triangulation_covariance

RIG = load_rig("paper_pair")
PAPER, CODED = load_handle("paper"), load_handle("coded")


def seen_pixels(T, handle, rig=RIG, limit_deg=62.0):
    """Exact projections of the facing markers and their indices, one a camera."""
    index = [np.flatnonzero(slants(handle, T, camera.centre) < np.deg2rad(limit_deg)) for camera in rig.cameras]
    centres = T.apply(handle.marker_centres)
    return tuple(camera.project(centres[k]) for camera, k in zip(rig.cameras, index, strict=True)), index


def all_points(found, rig=RIG):
    """Points of every pair of pixels of the first two cameras, right and wrong, in front of the cameras."""
    i, j = np.indices((len(found[0]), len(found[1]))).reshape(2, -1)
    uv = np.full((len(rig.cameras), len(i), 2), np.nan)
    uv[0], uv[1] = found[0][i], found[1][j]
    X, C = triangulate(rig, uv), triangulation_covariance(rig, uv, 0.3)
    valid = np.isfinite(X).all(axis=1)
    return X[valid], C[valid]


def apart_deg(a, b):
    return np.rad2deg((a.inv() * b).rotation.magnitude())


def good_poses(handle, n, seed, rig=RIG):
    rng = np.random.default_rng(seed)
    while n:
        T = random_pose(rng)
        _, index = seen_pixels(T, handle, rig)
        if len(np.intersect1d(index[0], index[1])) >= 4:
            n -= 1
            yield T, rng


def test_triplets_of_exact_points_contain_the_pose():
    T = RigidTransform.from_components([5.0, -20.0, 560.0], Rotation.from_euler("ZYX", [80, 20, 170], degrees=True))
    X = T.apply(CODED.marker_centres[[0, 1, 2, 3]])
    poses = triplet_poses(X, np.tile(1e-4 * np.eye(3), (4, 1, 1)), CODED)
    error = [np.linalg.norm(P.translation - T.translation) + apart_deg(P, T) for P in poses]
    assert min(error) < 1e-6
    assert len(poses) <= 8  # four triangles, each with few mirror labellings


def test_no_triplet_fits_points_that_are_no_handle():
    X = np.array([[0.0, 0, 500], [100, 0, 500], [0, 100, 500], [70, 70, 560]])
    assert len(triplet_poses(X, np.tile(1e-2 * np.eye(3), (4, 1, 1)), PAPER)) == 0
    assert len(triplet_poses(np.empty((0, 3)), np.empty((0, 3, 3)), PAPER)) == 0


def test_cost_by_hand():
    """A camera that finds all but one facing marker, and one thing that is none."""
    T = next(good_poses(CODED, 1, 0))[0]
    found, index = seen_pixels(T, CODED, limit_deg=49.0)
    first = np.vstack([found[0][1:] + [0.6, 0.8], [[3.0, 3.0]]])
    batch = RigidTransform.from_matrix(T.as_matrix()[None])
    labels, cost, residual = explain(batch, RIG, CODED, (first, found[1]), gate_px=4.0)
    n = len(first) - 1
    assert labels[0][0].tolist() == [*index[0][1:], -1]
    # each of n at distance 1; 16 for the stranger, and 16 for the marker that is missing
    assert cost[0] == pytest.approx(n * 1.0 + 16.0 + 16.0, abs=1e-6)
    assert residual[0] == pytest.approx(np.sqrt(n / (n + len(found[1]))), abs=1e-9)


def test_a_marker_on_the_far_side_explains_nothing():
    T = next(good_poses(PAPER, 1, 6))[0]
    away = np.flatnonzero(slants(PAPER, T, RIG.cameras[0].centre) > np.deg2rad(100))
    found = (RIG.cameras[0].project(T.apply(PAPER.marker_centres[away])), np.empty((0, 2)))
    labels, _, residual = explain(RigidTransform.from_matrix(T.as_matrix()[None]), RIG, PAPER, found, gate_px=0.5)
    assert (labels[0] == -1).all()
    assert np.isnan(residual[0])


def test_one_marker_out_of_line_decides_where_it_is_seen():
    """The paper's layout with one marker moved by 4 mm: its neighbours' turns explain all markers but that one."""
    handle = Handle("nearly", 5.0, 200.0, 25.0, 3.0, PAPER.columns_deg, ((10.0, -14.0), *PAPER.rows_mm[1:]))
    turn = {True: 0.0, False: 180.0}  # towards the cameras, or to the far side
    for seen, angle in turn.items():
        facing = Rotation.from_euler("y", 180.0 + angle, degrees=True)
        T = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_euler("z", 80, degrees=True) * facing)
        found, index = seen_pixels(T, handle)
        assert (1 in index[0]) == seen
        options = identify(RIG, handle, found, *all_points(found))
        assert (len(options) == 1) == seen
        assert min(apart_deg(option.T_world_handle, T) for option in options) < 1.0


@pytest.mark.parametrize("seed", [0, 1])
def test_coded_layout_is_identified_from_one_instant(seed):
    for T, rng in good_poses(CODED, 10, seed):
        found, index = seen_pixels(T, CODED)
        found = tuple(uv + rng.normal(0, 0.1, uv.shape) for uv in found)
        options = identify(RIG, CODED, found, *all_points(found))
        assert len(options) == 1
        assert apart_deg(options[0].T_world_handle, T) < 5.0
        for label, k in zip(options[0].labels, index, strict=True):
            assert label.tolist() == k.tolist()


def test_paper_layout_is_found_up_to_its_symmetry():
    for T, rng in good_poses(PAPER, 10, 2):
        found = tuple(uv + rng.normal(0, 0.1, uv.shape) for uv in seen_pixels(T, PAPER)[0])
        options = identify(RIG, PAPER, found, *all_points(found))
        assert len(options) == 1
        assert min(apart_deg(E, T) for E in equivalents(options[0].T_world_handle, PAPER)) < 5.0


def test_another_layout_and_spurious_markers():
    """Five columns, unequal rows, markers of another size; twelve wrong blobs in each image."""
    handle = Handle("odd", 8.0, 150.0, 40.0, 4.0, (0.0, 70.0, 140.0, 215.0, 290.0),
                    ((12.0, -3.0), (9.0, -12.0), (12.0, -7.0), (3.0, -9.0), (10.0, -14.0)))
    for T, rng in good_poses(handle, 2, 3):
        found, index = seen_pixels(T, handle)
        found = tuple(np.vstack([uv + rng.normal(0, 0.1, uv.shape), rng.uniform(0, 1024, (12, 2))]) for uv in found)
        options = identify(RIG, handle, found, *all_points(found))
        assert apart_deg(options[0].T_world_handle, T) < 5.0
        for label, k in zip(options[0].labels, index, strict=True):
            assert label[:len(k)].tolist() == k.tolist()


def test_too_few_or_nothing_gives_no_hypothesis():
    T = next(good_poses(PAPER, 1, 4))[0]
    found, _ = seen_pixels(T, PAPER)
    three = tuple(uv[:3] for uv in found)
    assert identify(RIG, PAPER, three, *all_points(three)) == []
    nothing = (np.empty((0, 2)), np.empty((0, 2)))
    assert identify(RIG, PAPER, nothing, np.empty((0, 3)), np.empty((0, 3, 3))) == []


def test_choice_by_prior_and_without():
    T = RigidTransform.from_components([0, 0, 560.0], Rotation.from_euler("ZYX", [85, 10, 5], degrees=True))
    alike = equivalents(T, PAPER)
    assert len(alike) == 12
    for k, E in enumerate(alike):
        prior = E * RigidTransform.from_rotation(Rotation.from_rotvec([0.1, 0.1, -0.1]))
        assert choose(alike, prior) == (k, True)
    index, sure = choose(alike, None)
    assert not sure
    assert alike[index].rotation.magnitude() == min(E.rotation.magnitude() for E in alike)
    between = alike[0] * RigidTransform.from_rotation(Rotation.from_rotvec([0, np.deg2rad(29.0), 0]))
    assert not choose(alike, between)[1]  # 29 deg from one and 31 deg from the next
    assert choose(alike[:1], None) == (0, True)


def test_relabelling_follows_the_equivalent_pose():
    T = next(good_poses(PAPER, 1, 5))[0]
    found, index = seen_pixels(T, PAPER)
    for S in PAPER.symmetries:
        labels = relabel(np.array([*index[0], -1]), PAPER, S)
        predicted = RIG.cameras[0].project((T * S).apply(PAPER.marker_centres[labels[:-1]]))
        np.testing.assert_allclose(predicted, found[0], atol=1e-8)  # px
        assert labels[-1] == -1


def test_labelled_pixels():
    found = (np.array([[1.0, 2], [3, 4]]), np.array([[5.0, 6], [7, 8]]))
    uv = labelled_pixels((np.array([2, -1]), np.array([-1, 0])), found, 3)
    assert uv[0, 2].tolist() == [1, 2]
    assert uv[1, 0].tolist() == [7, 8]
    assert np.isnan(uv).all(axis=2).sum() == 4


@pytest.mark.parametrize("field", ["gate_px", "sigma_px", "min_markers", "max_residual_px"])
def test_bad_parameters_are_value_errors(field):
    with pytest.raises(ValueError, match=field):
        IdentityParameters(**{field: -1})


def test_bad_shapes_are_value_errors():
    with pytest.raises(ValueError, match="covariances"):
        triplet_poses(np.ones((4, 3)), np.ones((3, 3, 3)), PAPER)
    with pytest.raises(ValueError, match="prior"):
        choose(equivalents(RigidTransform.identity(), PAPER), np.eye(4))
