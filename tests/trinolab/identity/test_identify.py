"""Which marker is which: search, verdict, symmetry, prior; and what must not be called known."""

from dataclasses import replace

import numpy as np
import pytest
from boards import motion
from markerviews import CODED, PAPER, RIG, TRIO, good_poses, seen_by, views, without
from scenes import pose
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import random_pose
from trinolab.camera import Rig
from trinolab.handle import Handle, slants
from trinolab.identity import choose, equivalents, identify, labelled_pixels, relabel
from trinolab.identity.hypotheses import Explained, Observed, Poses
from trinolab.identity.identify import _alternatives
from trinolab.identity.layout import layout_of, views_of
from trinolab.identity.parameters import IdentityParameters
from trinolab.identity.scoring import judge, rivals, shape_misfit
from trinolab.identity.search import SINGLE_UNITS
from trinolab.work import Work

P = IdentityParameters()
NEARLY = Handle(
    "nearly", 5.0, 200.0, 25.0, 3.0, PAPER.columns_deg, ((10.0, -14.0), *PAPER.rows_mm[1:])
)
ODD = Handle(
    "odd",
    8.0,
    150.0,
    40.0,
    4.0,
    (0.0, 70.0, 140.0, 215.0, 290.0),
    ((12.0, -3.0), (9.0, -12.0), (12.0, -7.0), (3.0, -9.0), (10.0, -14.0)),
)


def test_the_shapes_of_markers_fit_their_pose_and_no_other():
    """Axes of the visible patches, against those that poses predict: in variances, a marker at most
    nine for its size and nine for its roundness.
    """
    T = random_pose(np.random.default_rng(2))
    camera = RIG.cameras[0]
    uv, axes, index = seen_by(camera, T, CODED, np.random.default_rng(0), limit_deg=70.0)
    alone = views_of(RIG).only(0)
    poses = Poses(T.rotation.as_matrix()[None], T.translation[None])

    def misfit(axes):
        observed = Observed(alone, layout_of(CODED, P), uv.T[None], axes[None])
        return shape_misfit(poses, index[None, None], observed, P)[0]

    count = len(index)
    assert misfit(axes) < 0.1 * count
    larger = 1.3 * axes
    assert misfit(larger) == pytest.approx(count * (np.log(1.3) / P.size_sigma) ** 2, rel=0.4)
    slant = slants(CODED, T, camera.centre)[index]
    round_ones = axes[:, [0, 0]]
    too_round = np.minimum(((1 - np.cos(slant)) / P.roundness_sigma) ** 2, 9.0).sum()
    assert too_round > 3
    assert misfit(round_ones) == pytest.approx(too_round, rel=0.2)
    assert misfit(100 * round_ones * [1.0, 100.0]) == pytest.approx(18 * count)


def apart_deg(a, b):
    return np.rad2deg((a.inv() * b).rotation.magnitude())


def assert_identified(options, T, index, turn_deg=5.0):
    assert len(options) == 1
    assert apart_deg(options[0].T_world_handle, T) < turn_deg
    for label, k in zip(options[0].labels, index, strict=True):
        assert set(label[label >= 0] - k[label >= 0]) <= {0}
        assert (label >= 0).sum() >= len(k) - 1  # one at the limb may be left out


@pytest.mark.slow
@pytest.mark.parametrize(("handle", "rig"), [(CODED, RIG), (CODED, TRIO), (ODD, TRIO)])
def test_a_layout_without_symmetry_is_identified_from_one_instant(handle, rig):
    for T, rng in good_poses(handle, 8, 0, rig):
        found, axes, index = views(T, handle, rng, rig)
        assert_identified(identify(rig, handle, found, axes_px=axes), T, index)
        assert_identified(identify(rig, handle, found), T, index)
        if handle is ODD:  # ten wrong blobs in each image
            more = tuple(np.vstack([uv, rng.uniform(0, 1024, (10, 2))]) for uv in found)
            (option,) = identify(rig, handle, more)
            labels = tuple(label[: len(k)] for label, k in zip(option.labels, index, strict=True))
            assert_identified([replace(option, labels=labels)], T, index)


def test_paper_layout_is_found_up_to_its_symmetry():
    for T, rng in good_poses(PAPER, 5, 2):
        found, axes, _ = views(T, PAPER, rng)
        options = identify(RIG, PAPER, found, axes_px=axes)
        assert len(options) == 1
        assert min(apart_deg(E, T) for E in equivalents(options[0].T_world_handle, PAPER)) < 5.0


@pytest.mark.parametrize("camera", [0, 1, 2])
def test_one_camera_is_enough(camera):
    others = [c for c in range(3) if c != camera]
    for T, rng in good_poses(CODED, 8, 4, TRIO):
        found, axes, index = views(T, CODED, rng, TRIO, noise_px=0.03)
        if len(index[camera]) >= 5:
            options = identify(TRIO, CODED, without(found, *others), axes_px=without(axes, *others))
            assert_identified(options, T, without(index, *others))
            assert options[0].cameras == (camera,)


def test_a_search_that_is_cut_short_goes_on_where_it_ended():
    """Two cameras look elsewhere, see more blobs than the third one markers, and are tried first."""
    around = pose([0, 0, 0], [0, 180, 0])
    away = [replace(camera, T_cam_world=around * camera.T_cam_world) for camera in TRIO.cameras[:2]]
    rig = Rig((*away, TRIO.cameras[2]))
    T, rng = next(good_poses(CODED, 1, 4, TRIO))
    found, axes, _ = views(T, CODED, rng, TRIO, noise_px=0.03)
    blobs = [rng.uniform(300, 700, (12, 2)) for _ in away]
    found = (*blobs, found[2])
    axes = (*(np.tile([12.0, 10.0], (12, 1)) for _ in away), axes[2])
    whole = identify(rig, CODED, found, axes_px=axes)
    assert apart_deg(whole[0].T_world_handle, T) < 5.0
    cursor, tried = 0, []
    while not tried or not tried[-1]:
        work = Work(2 * SINGLE_UNITS, cursor)
        tried.append(identify(rig, CODED, found, axes_px=axes, work=work))
        assert 0 <= work.remaining < 2 * SINGLE_UNITS
        cursor = work.cursor
    assert 1 < len(tried) < 5
    assert apart_deg(tried[-1][0].T_world_handle, T) < 5.0


def test_cameras_that_see_different_markers_go_together():
    """Two cameras face to face, either side of the handle."""
    first = RIG.cameras[0]
    back = pose([0.0, 0.0, 1140.0], [0, 180, 0])
    rig = Rig((first, replace(RIG.cameras[1], T_cam_world=back.inv())))
    rng = np.random.default_rng(5)
    for turn in (0.0, 20.0, 40.0):
        T = pose([5.0, 8.0, 570.0], [80, turn, 8])
        found, axes, index = views(T, CODED, rng, rig, noise_px=0.03, limit_deg=70.0)
        assert not set(index[0]) & set(index[1])
        options = identify(rig, CODED, found, axes_px=axes)
        assert_identified(options, T, index)
        assert options[0].cameras == (0, 1)


def test_one_marker_out_of_line_decides_where_it_is_seen():
    """The paper's layout with one marker moved by 4 mm: its neighbours' turns explain all markers
    but that one.
    """
    turn = {True: 0.0, False: 180.0}  # towards the cameras, or to the far side
    for seen, angle in turn.items():
        T = pose([0.0, 0.0, 560.0], [80, 180.0 + angle, 0])
        found, axes, index = views(T, NEARLY, np.random.default_rng(0))
        assert (1 in index[0]) == seen
        options = identify(RIG, NEARLY, found, axes_px=axes)
        assert (len(options) == 1) == seen
        assert min(apart_deg(option.T_world_handle, T) for option in options) < 2.0


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_camera_is_outvoted_by_two_and_not_believed_alone(seed):
    T, rng = next(good_poses(CODED, 1, seed, TRIO))
    axis = rng.normal(size=3)
    turn = motion([0, 0, 0], np.deg2rad(2.0) * axis / np.linalg.norm(axis))
    first, second, third = TRIO.cameras
    second = replace(second, T_cam_world=turn * second.T_cam_world)
    turned = Rig((first, second, third))
    found, axes, _ = views(T, CODED, rng, turned)
    options = identify(TRIO, CODED, found, axes_px=axes)
    assert len(options) == 1
    assert (options[0].labels[1] == -1).all()
    assert apart_deg(options[0].T_world_handle, T) < 5.0
    pair = TRIO.part(range(2))
    for option in identify(pair, CODED, found[:2], axes_px=axes[:2]):
        assert np.linalg.norm(option.T_world_handle.translation - T.translation) < 2.0  # mm


def test_a_camera_that_sees_another_handle_refutes_a_single_one():
    rng = np.random.default_rng(8)
    poses = [T for T, _ in good_poses(CODED, 2, 8)]
    (found, axes, _), (others, other_axes, _) = (views(T, CODED, rng) for T in poses)
    assert len(identify(RIG, CODED, without(found, 1), axes_px=without(axes, 1))) == 1
    assert identify(RIG, CODED, (found[0], others[1]), axes_px=(axes[0], other_axes[1])) == []


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 8, 500])
def test_blobs_alone_are_nothing(count):
    rng = np.random.default_rng(count)
    for _ in range(2):
        found = tuple(rng.uniform(10, 1014, (count, 2)) for _ in TRIO.cameras)
        axes = tuple(15 * rng.uniform(0.6, 1.3, (count, 1)) * [1.0, 0.8] for _ in TRIO.cameras)
        assert identify(TRIO, CODED, found, axes_px=axes) == []
        assert identify(TRIO, CODED, found) == []
    # and three markers are too few
    T, rng = next(good_poses(PAPER, 1, 4))
    found, _, index = views(T, PAPER, rng)
    three = np.intersect1d(*index)[:3]
    few = tuple(uv[np.isin(k, three)] for uv, k in zip(found, index, strict=True))
    assert identify(RIG, PAPER, few) == []


def test_known_matches_limit_the_search():
    T, rng = next(good_poses(CODED, 1, 9))
    found, _, index = views(T, CODED, rng)
    right = np.argwhere(index[0][:, None] == index[1])
    assert_identified(identify(RIG, CODED, found, matches=[right]), T, index)
    assert identify(RIG, CODED, found, matches=[right[:2]]) == []
    wrong = np.argwhere(index[0][:, None] != index[1])
    assert identify(RIG, CODED, found, matches=[wrong]) == []


def test_choice_by_prior_and_without():
    T = pose([0, 0, 560.0], [85, 10, 5])
    alike = equivalents(T, PAPER)
    assert len(alike) == 12
    for k, E in enumerate(alike):
        assert choose(alike, E * motion([0, 0, 0], [0.1, 0.1, -0.1])) == (k, True)
    index, unambiguous = choose(alike, None)
    assert not unambiguous
    assert alike[index].rotation.magnitude() == min(E.rotation.magnitude() for E in alike)
    between = alike[0] * motion([0, 0, 0], [0, np.deg2rad(29.0), 0])
    assert not choose(alike, between)[1]  # 29 deg from one and 31 deg from the next
    assert choose(alike[:1], None) == (0, True)


def test_a_pose_that_explains_more_but_does_not_fit_is_a_rival():
    """Two images of six markers. The first pose fits ten of them to 0.7 px and leaves two over, the
    second one fits all, but to 0.9 px; the third has the first one's labels.
    """
    p = IdentityParameters()
    first = np.array([[-1, 0, 1, 2, 3, 4], [-1, 0, 1, 2, 3, 4]])
    second = np.array([[6, 7, 8, 9, 10, 11], [6, 7, 8, 9, 10, 11]])
    labels = np.stack([first, second, first])
    freedom = 2 * (labels >= 0).sum(axis=(1, 2)) - 6
    each = np.array([0.7, 0.9, 0.9]) ** 2 * freedom / (labels >= 0).sum(axis=(1, 2))
    squares = np.where(labels >= 0, each[:, None, None], 0.0)
    left_over = np.array([[1, 1], [0, 0], [1, 1]])
    cost = squares.sum(axis=(1, 2)) + 2 * p.gate_px**2 * left_over.sum(axis=1)
    explained = Explained(
        labels, squares, left_over.astype(float), left_over, cost, np.zeros(3, int)
    )
    verdict = judge(explained, p)
    np.testing.assert_allclose(verdict.residual_px, [0.7, 0.9, 0.9])
    assert verdict.holds.tolist() == [True, False, False]
    assert verdict.strained.tolist() == [False, True, True]
    assert rivals(0, explained, verdict, np.zeros(3), p).tolist() == [True, True, False]


def test_a_pose_that_explains_nothing_is_not_the_best_one():
    """Although it costs less than the one that holds."""
    labels = np.stack([np.tile(np.arange(6), (2, 1)), np.full((2, 6), -1)])
    none = np.zeros((2, 2))
    explained = Explained(labels, 0.0 * labels, none, none, np.array([1.0, 0.0]), np.zeros(2, int))
    poses = Poses(np.tile(np.eye(3), (2, 1, 1)), np.array([[0.0, 0.0, 560.0], [0.0, 0.0, 900.0]]))
    best, *_ = _alternatives(poses, explained, np.zeros(2), [6, 6], CODED, P)
    assert best.T_world_handle.translation[2] == 560.0


def test_relabelling_follows_the_equivalent_pose():
    T = next(good_poses(PAPER, 1, 5))[0]
    index = np.flatnonzero(slants(PAPER, T, RIG.cameras[0].centre) < np.deg2rad(62))
    exact = RIG.cameras[0].project(T.apply(PAPER.marker_centres[index]))
    for S in PAPER.symmetries:
        labels = relabel(np.array([*index, -1]), PAPER, S)
        predicted = RIG.cameras[0].project((T * S).apply(PAPER.marker_centres[labels[:-1]]))
        np.testing.assert_allclose(predicted, exact, atol=1e-8)  # px
        assert labels[-1] == -1


def test_labelled_pixels():
    found = (np.array([[1.0, 2], [3, 4]]), np.array([[5.0, 6], [7, 8]]))
    uv = labelled_pixels((np.array([2, -1]), np.array([-1, 0])), found, 3)
    assert uv[0, 2].tolist() == [1, 2]
    assert uv[1, 0].tolist() == [7, 8]
    assert np.isnan(uv).all(axis=2).sum() == 4


def test_wrong_arguments_are_named():
    for field in ("gate_px", "sigma_px", "min_markers", "max_residual_px"):
        with pytest.raises(ValueError, match=field):
            IdentityParameters(**{field: -1})
    four = np.ones((4, 2))
    for options, word in (
        ({"found": [four]}, "found"),
        ({"found": [four, np.ones((4, 3))]}, "ccd2"),
        ({"axes_px": [four, four[:3]]}, "axes_px"),
        ({"matches": []}, "matches"),
    ):
        with pytest.raises(ValueError, match=word):
            identify(RIG, PAPER, **{"found": [four, four], **options})
    with pytest.raises(ValueError, match="prior"):
        choose(equivalents(RigidTransform.identity(), PAPER), np.eye(4))
