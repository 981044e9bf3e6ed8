"""Matching: epipolar distance, correlation, both directions, order."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import true_visibility
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import epipolar_lines
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.markers import find_markers
from trinolab.matching import (
    Matches,
    MatchParameters,
    candidates,
    confirmed,
    epipolar_distances,
    in_order,
    match,
    mutual,
    ncc,
    ncc_matrix,
)
from trinolab.measurement import measure
from trinolab.parameters import Parameters

PAIR = load_rig("paper_pair").cameras
NO_MATCH = Matches(np.empty((0, 2)), np.empty(0), np.empty(0))
ONE_MATCH = Matches(np.zeros((1, 2)), np.zeros(1), np.zeros(1))


def points(rng, n=20):
    return np.column_stack(
        [rng.uniform(-80, 80, n), rng.uniform(-50, 50, n), rng.uniform(520, 620, n)]
    )


@pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])
def test_true_pairs_lie_on_their_epipolar_lines(name):
    rig = load_rig(name)
    X = points(np.random.default_rng(0))
    for i, j in rig.pairs:
        D = epipolar_distances(
            rig.cameras[i], rig.cameras[j], rig.cameras[i].project(X), rig.cameras[j].project(X)
        )
        assert np.diag(D).max() < 1e-8  # px; rounding of coordinates of 1e3 px


def test_epipolar_distance_by_brute_force():
    """The distance from the projection of a densely sampled viewing ray: no fundamental matrix in
    it.
    """
    left, right = PAIR
    rng = np.random.default_rng(1)
    uv_left, uv_right = rng.uniform(200, 800, (4, 2)), rng.uniform(200, 800, (3, 2))
    D = epipolar_distances(left, right, uv_left, uv_right)
    for i, ray in enumerate(left.rays(uv_left)):
        line = right.project(left.centre + np.array([300.0, 900.0])[:, None] * ray)
        along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
        offset = uv_right - line[0]
        np.testing.assert_allclose(D[i], np.abs(offset @ [-along[1], along[0]]), atol=1e-7)  # px


def test_missing_points_give_nan():
    D = epipolar_distances(*PAIR, [[np.nan, 1], [500, 500]], [[500, 500]])
    assert np.isnan(D[0, 0])
    assert np.isfinite(D[1, 0])


def test_ncc_against_opencv():
    rng = np.random.default_rng(2)
    image = rng.integers(0, 255, (30, 40)).astype(np.float32)
    template = image[5:14, 8:21]
    reference = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED)
    ours = [[ncc(template, image[v : v + 9, u : u + 13]) for u in range(28)] for v in range(22)]
    np.testing.assert_allclose(ours, reference, atol=2e-6)  # OpenCV sums in single precision


def test_ncc_against_double_loops():
    rng = np.random.default_rng(3)
    t, w = rng.uniform(0, 255, (2, 5, 7))
    cross = sum((t[v, u] - t.mean()) * (w[v, u] - w.mean()) for v in range(5) for u in range(7))
    own = [sum((x[v, u] - x.mean()) ** 2 for v in range(5) for u in range(7)) for x in (t, w)]
    assert ncc(t, w) == pytest.approx(cross / np.sqrt(own[0] * own[1]), abs=1e-13)


def test_ncc_is_blind_to_gain_and_offset_and_zero_for_flat():
    rng = np.random.default_rng(4)
    t = rng.uniform(0, 255, (9, 9))
    assert ncc(t, 3 * t + 20) == pytest.approx(1.0, abs=1e-12)
    assert ncc(t, 255 - t) == pytest.approx(-1.0, abs=1e-12)
    assert ncc(t, np.full((9, 9), 7.0)) == 0.0


def test_ncc_matrix_is_centred_on_whole_pixels():
    rng = np.random.default_rng(5)
    a, b = rng.integers(0, 255, (2, 40, 60)).astype(np.uint8)
    S = ncc_matrix(a, b, [[20, 15]], [[30, 25]], 11)
    assert S[0, 0] == pytest.approx(ncc(a[10:21, 15:26], b[20:31, 25:36]), abs=1e-6)


def test_mutual_keeps_each_point_once():
    m = Matches(
        np.array([[0, 0], [0, 1], [1, 1], [2, 1]]), np.zeros(4), np.array([0.7, 0.9, 0.95, 0.6])
    )
    # 0's best is 1, whose best is 1: nothing is left for 0
    assert mutual(m).index.tolist() == [[1, 1]]


def test_order_along_the_epipolar_line():
    """Two points on one epipolar plane: crossed pairs break the order, and the weaker one goes."""
    left, right = PAIR
    baseline = right.centre / np.linalg.norm(right.centre)
    X = np.array([0.0, 20.0, 560.0]) + np.array([[-4.0], [4.0]]) * baseline
    uv_left, uv_right = left.project(X), right.project(X)
    straight = Matches(np.array([[0, 0], [1, 1]]), np.zeros(2), np.array([0.8, 0.9]))
    crossed = Matches(np.array([[0, 1], [1, 0]]), np.zeros(2), np.array([0.8, 0.9]))
    assert in_order(straight, left, right, uv_left, uv_right, 2.0).index.tolist() == [
        [0, 0],
        [1, 1],
    ]
    assert in_order(crossed, left, right, uv_left, uv_right, 2.0).index.tolist() == [[1, 0]]


def test_order_does_not_bind_points_on_different_lines():
    left, right = PAIR
    X = np.array([[-10.0, -20.0, 540.0], [10.0, 20.0, 600.0]])
    swapped_depths = Matches(np.array([[0, 0], [1, 1]]), np.zeros(2), np.array([0.8, 0.9]))
    assert len(in_order(swapped_depths, left, right, left.project(X), right.project(X), 2.0)) == 2


def test_rendered_markers_are_among_the_candidates_and_matched():
    rig, handle = load_rig("paper_pair"), load_handle("paper")
    T = load_table1().set_poses[2]
    frames = render_rig(rig, handle, T, Bench(), np.random.default_rng(6))
    seen = np.flatnonzero(np.all([true_visibility(c, handle, T) for c in rig.cameras], axis=0))
    uv = [c.project(T.apply(handle.marker_centres[seen])) for c in rig.cameras]
    found = {tuple(pair) for pair in candidates(*rig.cameras, *frames, *uv).index.tolist()}
    assert {(k, k) for k in range(len(seen))} <= found
    assert match(*rig.cameras, *frames, *uv).index.tolist() == [[k, k] for k in range(len(seen))]


@pytest.fixture(scope="module")
def across():
    """A rod across the baseline from CCD1 to CCD3, turned so that each camera sees another column
    head-on.
    """
    rig, handle, up = load_rig("raised_40deg"), load_handle("paper"), np.deg2rad(-10)
    # axis; the normal of column 0
    y, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, -np.sin(up), -np.cos(up)])
    T = RigidTransform.from_components(
        [0.0, 0.0, 560.0], Rotation.from_matrix(np.column_stack([np.cross(y, z), y, z]))
    )
    frames = render_rig(rig, handle, T, Bench(), np.random.default_rng(0))
    return rig, handle, T, frames


def true_labels(camera, handle, T, uv):
    """For each of the columns 0 (markers 0, 1) and 5 (10, 11), which both cameras see, the nearest
    spot's index.
    """
    expected = camera.project(T.apply(handle.marker_centres[[0, 1, 10, 11]]))
    return np.linalg.norm(uv[:, None] - expected, axis=2).argmin(axis=0)


def test_equal_markers_on_one_line_fool_the_correlation_and_not_the_layout(across):
    rig, handle, T, frames = across
    cameras, images = [rig.cameras[k] for k in (0, 2)], [frames[k] for k in (0, 2)]
    uv = [find_markers(image, 12).uv for image in images]
    spots = [
        true_labels(camera, handle, T, found) for camera, found in zip(cameras, uv, strict=True)
    ]
    right, crossed = np.column_stack(spots), np.column_stack([spots[0][:2], spots[1][2:]])
    within = {tuple(pair) for pair in candidates(*cameras, *images, *uv).index.tolist()}
    assert {tuple(pair) for pair in [*right.tolist(), *crossed.tolist()]} <= within
    left = {tuple(pair) for pair in match(*cameras, *images, *uv).index.tolist()}
    # column 0 with column 5: both seen head-on
    assert {tuple(pair) for pair in crossed.tolist()} <= left
    assert not {tuple(pair) for pair in right.tolist()} & left
    m = measure(frames, rig, handle, parameters=Parameters(estimator="paper"))
    labels = [m.labels[k][true_labels(rig.cameras[k], handle, T, m.found[k].uv)] for k in (0, 2)]
    assert labels[0].tolist() == labels[1].tolist()
    assert len(set(labels[0].tolist()) - {-1}) == 4


def test_a_third_camera_is_not_fooled(across):
    """Markers that share a line and look alike, as above: CCD2 sees which of the points there are."""
    rig, handle, T, frames = across
    order = (0, 2, 1)
    cameras, images = [rig.cameras[k] for k in order], [frames[k] for k in order]
    uv = [find_markers(image, 12).uv for image in images]
    spots = [
        true_labels(camera, handle, T, found) for camera, found in zip(cameras, uv, strict=True)
    ]
    any_ncc = MatchParameters(ncc_threshold=-1.0)
    near = candidates(*cameras[:2], *images[:2], *uv[:2], any_ncc)
    right = {tuple(pair) for pair in np.column_stack(spots[:2]).tolist()}
    assert len(near) > len(right)
    found = confirmed(near, cameras, uv, 3.0)
    assert {tuple(pair) for pair in found.index.tolist()} == right


def test_a_third_camera_confirms_where_two_epipolar_lines_cross():
    """No point in space: a pair is seen by the third camera where the lines of its spots cross."""
    cameras = load_rig("raised_40deg").cameras
    X = points(np.random.default_rng(6), 60)
    uv = [camera.project(X) for camera in cameras]
    uv[2] = uv[2][10:]  # which sees no spot of ten of them
    D = epipolar_distances(*cameras[:2], *uv[:2])
    i, j = np.nonzero(D < 1.0)
    from_left, from_right = (epipolar_lines(cameras[k], cameras[2], uv[k]) for k in (0, 1))
    crossing = np.cross(from_left[i], from_right[j])
    crossing = crossing[:, :2] / crossing[:, 2:]
    away = np.linalg.norm(crossing[:, None] - uv[2], axis=2).min(axis=1)
    expected = np.flatnonzero(away < 3.0)
    assert len(i) > 65
    assert 50 <= len(expected) < 60
    found = confirmed(Matches(np.column_stack([i, j]), D[i, j], 0.0 * D[i, j]), cameras, uv, 3.0)
    assert found.index.tolist() == np.column_stack([i, j])[expected].tolist()


def test_of_pairs_that_share_a_spot_the_best_confirmed_stays():
    cameras = load_rig("raised_40deg").cameras
    X = np.array([[0.0, 0.0, 570.0], [0.2, 0.1, 570.2]])
    uv = [camera.project(X) for camera in cameras]
    every = Matches(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]), np.zeros(4), np.zeros(4))
    assert confirmed(every, cameras, uv, 3.0).index.tolist() == [[0, 0], [1, 1]]
    assert len(confirmed(every, cameras, [*uv[:2], np.empty((0, 2))], 3.0)) == 0


def test_matching_is_the_same_from_either_side(across):
    """With a gate that lets everything pass; D itself is another distance in the other image."""
    rig, _, _, frames = across
    wide = MatchParameters(epipolar_gate_px=1e4)
    uv = [find_markers(image, 12).uv for image in frames]
    for i, j in rig.pairs:
        there = match(
            rig.cameras[i], rig.cameras[j], frames[i], frames[j], uv[i], uv[j], wide
        ).index
        back = match(rig.cameras[j], rig.cameras[i], frames[j], frames[i], uv[j], uv[i], wide).index
        assert sorted(there.tolist()) == sorted(back[:, ::-1].tolist())
        assert len(there) > 0


@pytest.mark.parametrize(
    "call",
    [
        lambda: MatchParameters(epipolar_gate_px=0.0),
        lambda: MatchParameters(ncc_threshold=1.5),
        lambda: MatchParameters(window_px=20),
        lambda: ncc(np.ones((3, 3)), np.ones((3, 4))),
        lambda: epipolar_distances(*PAIR, [[1, 2, 3]], [[1, 2]]),
        lambda: epipolar_distances(PAIR[0], PAIR[0], [[1, 2]], [[1, 2]]),
        lambda: ncc_matrix(np.ones(5), np.ones((5, 5)), [[1, 2]], [[1, 2]], 3),
        lambda: confirmed(NO_MATCH, PAIR, [[[1, 2]]] * 2, 3.0),
        lambda: confirmed(NO_MATCH, (*PAIR, PAIR[0]), [[[1, 2]]] * 3, -1.0),
        lambda: confirmed(ONE_MATCH, (*PAIR, PAIR[0]), [np.empty((0, 2))] * 3, 1.0),
    ],
)
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call()
