"""Matching: epipolar distance, correlation, both directions, order."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from trinolab import matching
from trinolab.bench.hand import true_visibility
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import epipolar_lines
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.matching import Matches, MatchParameters, confirmed, epipolar_distances, match, ncc
from trinolab.sensitivity import offsets_of

RIG, TRIO = load_rig("paper_pair"), load_rig("raised_40deg").cameras
PAIR = RIG.cameras


def pairs(index, ncc=None):
    zeros = np.zeros(len(index))
    return Matches(index, zeros, zeros if ncc is None else ncc)


def test_epipolar_distance_by_brute_force():
    """The distance from the projection of a densely sampled viewing ray: no fundamental matrix in
    it.
    """
    left, right = PAIR
    rng = np.random.default_rng(1)
    uv_left, uv_right = rng.uniform(200, 800, (4, 2)), rng.uniform(200, 800, (3, 2))
    D = epipolar_distances(left, right, np.vstack([uv_left, [[np.nan, 1]]]), uv_right)
    for i, ray in enumerate(left.rays(uv_left)):
        line = right.project(left.centre + np.array([300.0, 900.0])[:, None] * ray)
        along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
        offset = uv_right - line[0]
        np.testing.assert_allclose(D[i], np.abs(offset @ [-along[1], along[0]]), atol=1e-7)  # px
    assert np.isnan(D[4]).all()


def test_ncc_against_opencv():
    rng = np.random.default_rng(2)
    image = rng.integers(0, 255, (30, 40)).astype(np.float32)
    template = image[5:14, 8:21]
    reference = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED)
    ours = [[ncc(template, image[v : v + 9, u : u + 13]) for u in range(28)] for v in range(22)]
    np.testing.assert_allclose(ours, reference, atol=2e-6)  # OpenCV sums in single precision


def test_ncc_is_blind_to_gain_and_offset_and_zero_for_flat():
    t = np.random.default_rng(4).uniform(0, 255, (9, 9))
    assert ncc(t, 3 * t + 20) == pytest.approx(1.0, abs=1e-12)
    assert ncc(t, 255 - t) == pytest.approx(-1.0, abs=1e-12)
    assert ncc(t, 1000 + 1e-8 * t) == ncc(t, np.full((9, 9), 7.0)) == 0.0
    assert ncc(t, 1000 + t) == pytest.approx(1.0, abs=1e-9)


def test_ncc_matrix_is_centred_on_whole_pixels():
    a, b = np.random.default_rng(5).integers(0, 255, (2, 40, 60)).astype(np.uint8)
    S = matching.ncc_matrix(a, b, [[20, 15], [np.nan, 1]], [[30, 25]], 11)
    assert S[0, 0] == pytest.approx(ncc(a[10:21, 15:26], b[20:31, 25:36]), abs=1e-6)
    assert S[1, 0] == 0


def test_mutual_keeps_each_point_once():
    m = pairs([[0, 0], [0, 1], [1, 1], [2, 1]], [0.7, 0.9, 0.95, 0.6])
    # 0's best is 1, whose best is 1: nothing is left for 0
    assert matching.mutual(m).index.tolist() == [[1, 1]]


def test_order_along_the_epipolar_line():
    """Two points on one epipolar plane: crossed pairs break the order, and the weaker one goes. It
    does not bind points on different lines.
    """
    left, right = PAIR
    baseline = right.centre / np.linalg.norm(right.centre)
    together = np.array([0.0, 20.0, 560.0]) + np.array([[-4.0], [4.0]]) * baseline
    apart = np.array([[-10.0, -20.0, 540.0], [10.0, 20.0, 600.0]])
    straight, crossed = [[0, 0], [1, 1]], [[0, 1], [1, 0]]
    for X, index, kept in (
        (together, straight, straight),
        (together, crossed, crossed[1:]),
        (apart, straight, straight),
    ):
        uv = left.project(X), right.project(X)
        found = matching.in_order(pairs(index, [0.8, 0.9]), left, right, *uv, 2.0)
        assert found.index.tolist() == kept


def test_rendered_markers_are_among_the_candidates_and_matched():
    handle, T = load_handle("paper"), load_table1().set_poses[2]
    frames = render_rig(RIG, handle, T, Bench(), np.random.default_rng(6))
    seen = np.all([true_visibility(c, handle, T) for c in PAIR], axis=0)
    uv = [c.project(T.apply(handle.marker_centres[seen])) for c in PAIR]
    own = [[k, k] for k in range(seen.sum())]
    found = matching.candidates(*PAIR, *frames, *uv)
    assert {tuple(pair) for pair in own} <= {tuple(pair) for pair in found.index.tolist()}
    assert match(*PAIR, *frames, *uv).index.tolist() == own
    (of_rig,) = matching.rig_candidates(RIG, frames, uv)
    for part in ("index", "distance_px", "ncc"):
        np.testing.assert_allclose(getattr(of_rig, part), getattr(found, part), atol=1e-9)
    # of a rig that may be off more passes: the gate is wider, by four sigmas
    silent = replace(RIG, covariance=None)
    (wider,) = matching.rig_candidates(silent, frames, uv)
    gate = np.hypot(2.0, 4.0 * offsets_of(silent, uv).apart_px(0, 1))
    expected = matching.candidates(*PAIR, *frames, *uv, MatchParameters(epipolar_gate_px=gate))
    assert len(expected) > len(found)
    assert wider.index.tolist() == expected.index.tolist()
    # the same from either side, with a gate that lets everything pass
    wide = MatchParameters(epipolar_gate_px=1e4)
    back = match(*PAIR[::-1], *frames[::-1], *uv[::-1], wide).index[:, ::-1]
    assert sorted(match(*PAIR, *frames, *uv, wide).index.tolist()) == sorted(back.tolist())


def test_a_third_camera_confirms_where_two_epipolar_lines_cross():
    """No point in space: a pair is seen by the third camera where the lines of its spots cross."""
    X = np.random.default_rng(6).uniform([-80, -50, 520], [80, 50, 620], (60, 3))
    uv = [camera.project(X) for camera in TRIO]
    uv[2] = uv[2][10:]  # which sees no spot of ten of them
    D = epipolar_distances(*TRIO[:2], *uv[:2])
    i, j = index = np.nonzero(D < 1.0)
    from_left, from_right = (epipolar_lines(TRIO[k], TRIO[2], uv[k]) for k in (0, 1))
    crossing = np.cross(from_left[i], from_right[j])
    crossing = crossing[:, :2] / crossing[:, 2:]
    away = np.linalg.norm(crossing[:, None] - uv[2], axis=2).min(axis=1)
    expected = np.transpose(index)[away < 3.0]
    assert len(i) > 60
    assert 50 <= len(expected) < 60
    found = confirmed(pairs(np.transpose(index)), TRIO, uv, 3.0)
    assert found.index.tolist() == expected.tolist()


def test_of_pairs_that_share_a_spot_the_best_confirmed_stays():
    X = np.array([[0.0, 0.0, 570.0], [0.2, 0.1, 570.2]])
    uv = [camera.project(X) for camera in TRIO]
    every = pairs([[0, 0], [0, 1], [1, 0], [1, 1]])
    assert confirmed(every, TRIO, uv, 3.0).index.tolist() == [[0, 0], [1, 1]]
    assert len(confirmed(every, TRIO, [*uv[:2], np.empty((0, 2))], 3.0)) == 0


ONE, NONE = np.ones((1, 2)), np.empty((0, 2))


REFUSED = [
    (MatchParameters, (0.0,)),
    (MatchParameters, (1.0, 0.5, 20)),
    (MatchParameters, (1.0, 0.5, 1)),
    (Matches, ([[0, -1]], [0], [0])),
    (Matches, ([[0, 0.5]], [0], [0])),
    (matching.in_order, (pairs([[0, 1]]), *PAIR, ONE, ONE, 2.0)),
    (matching.in_order, (pairs([[0, 0]]), *PAIR, ONE, ONE, -1.0)),
    (confirmed, (pairs(NONE), PAIR, [ONE] * 2, 3.0)),
    (confirmed, (pairs(NONE), TRIO, [ONE] * 3, -1.0)),
    (confirmed, (pairs([[0, 0]]), TRIO, [NONE] * 3, 1.0)),
]


@pytest.mark.parametrize(("call", "given"), REFUSED)
def test_bad_input_is_a_value_error(call, given):
    with pytest.raises(ValueError, match="expected"):
        call(*given)
