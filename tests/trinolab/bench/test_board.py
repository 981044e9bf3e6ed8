"""The chessboard: its picture by hand, its corners against exact projections, and a whole rendered
calibration.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.board import (
    DARK_GREY,
    WHITE_GREY,
    board_positions,
    board_radiance,
    render_board,
)
from trinolab.bench.optics import Bench
from trinolab.calibration.target import Board, find_corners
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies.simulated_calibration import (
    calibration_errors,
    simulated_calibration,
)

BOARD = Board(9, 6, 15.0)
PLAIN = Bench(blur_px=0.0, shot_variance=0.0, read_noise=0.0)
MATRIX = np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]])
HAND = Camera("hand", (121, 91), MATRIX, np.zeros(5), RigidTransform.identity())


def at(x, y, z, rotvec=(0, 0, 0)):
    return RigidTransform.from_components([x, y, z], Rotation.from_rotvec(np.array(rotvec, float)))


# --- the board


def test_points_by_hand():
    board = Board(4, 3, 10.0)
    assert board.points.tolist()[:5] == [[0, 0, 0], [10, 0, 0], [20, 0, 0], [30, 0, 0], [0, 10, 0]]
    assert len(board.points) == 12
    assert board.outline.tolist() == [[-20, -20, 0], [50, -20, 0], [50, 40, 0], [-20, 40, 0]]
    with pytest.raises(ValueError, match="read-only"):
        board.points[0, 0] = 1


@pytest.mark.parametrize(
    ("name", "value"),
    [("columns", 2), ("rows", 2.5), ("columns", "9"), ("square_mm", 0.0), ("square_mm", np.nan)],
)
def test_board_names_the_field(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        replace(BOARD, **{name: value})


# --- the picture


def test_picture_by_hand():
    # 10 mm at a distance of 100 mm and a focal length of 100 px: 10 px a square, the first corner
    # at pixel (40, 30)
    image = board_radiance(HAND, Board(4, 3, 10.0), at(0, 0, 100), PLAIN)
    grey = (DARK_GREY + WHITE_GREY) / 2
    dark, white = (
        [(45, 35), (35, 25), (55, 45), (65, 35), (55, 25)],
        [(55, 35), (35, 35), (25, 35), (85, 45)],
    )
    assert [image[v, u] for u, v in dark] == [DARK_GREY] * 5
    assert [image[v, u] for u, v in white] == [WHITE_GREY] * 4
    # the corner of four squares, in the middle of a pixel
    assert image[30, 40] == pytest.approx(grey)
    assert image[35, 50] == pytest.approx(grey)  # an edge through the middle of a pixel
    assert image[35, 49] == DARK_GREY
    assert image[35, 51] == WHITE_GREY
    assert image[35, 95] < 100  # beside the board: its margin ends at u = 90


def test_an_edge_shares_its_pixel_by_area():
    # the board 0.3 mm to the right: 0.3 px; a pixel on an edge is then 0.8 dark and 0.2 white
    image = board_radiance(
        HAND, Board(4, 3, 10.0), at(0.3, 0, 100), replace(PLAIN, supersampling=20)
    )
    assert image[35, 50] == pytest.approx(0.8 * DARK_GREY + 0.2 * WHITE_GREY, abs=1e-9)


def test_from_behind_the_board_is_white():
    # turned by 180 deg about y: x runs to the left
    image = board_radiance(HAND, Board(4, 3, 10.0), at(10, 0, 100, [0, np.pi, 0]), PLAIN)
    assert image[35, 45] == image[35, 35] == WHITE_GREY


def test_corners_are_where_they_project_to():
    lens = [-0.3, 0.1, 1e-3, -2e-3, 0.0]
    matrix = np.array([[600.0, 0, 330], [0, 590, 235], [0, 0, 1]])
    rig = Rig(tuple(Camera(f"c{k}", (640, 480), matrix, lens, at(-30 * k, 0, 0)) for k in range(2)))
    poses = RigidTransform.concatenate(
        [at(-40, -40, 230, [0.4, 0.3, 0.1]), at(-30, -35, 250, [-0.3, 0.4, -0.1])]
    )
    bench, rng = replace(PLAIN, blur_px=1.0), np.random.default_rng(0)
    uv = np.stack(
        [
            [find_corners(render_board(camera, BOARD, T, bench, rng), BOARD, 5) for T in poses]
            for camera in rig.cameras
        ]
    )
    true = [
        [camera.project(T.apply(np.array(BOARD.points))) for T in poses] for camera in rig.cameras
    ]
    off = uv - np.stack(true)
    assert np.sqrt((off**2).mean()) < 0.03
    assert np.abs(off.mean(axis=2)).max() < 0.01


IN_FRONT = "T_world_board: expected the board in front"
PAIR, EMPTY = load_rig("paper_pair"), np.zeros((80, 100), np.uint8)


def placed(board, count=1, rng=None, **options):
    return board_positions(PAIR, board, count, rng or np.random.default_rng(0), **options)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        (IN_FRONT, lambda: board_radiance(HAND, BOARD, at(0, 0, -100), PLAIN)),
        (IN_FRONT, lambda: board_radiance(HAND, BOARD, at(0, 0, 20, [0, 1.2, 0]), PLAIN)),
        ("T_world_board: expected one", lambda: board_radiance(HAND, BOARD, np.eye(4), PLAIN)),
        ("rng: ", lambda: render_board(HAND, BOARD, at(0, 0, 100), PLAIN, 0)),
        ("image: expected 8 bit", lambda: find_corners(np.zeros((80, 100)), BOARD)),
        ("image: expected a grey", lambda: find_corners(np.zeros((80, 100, 3), np.uint8), BOARD)),
        ("half_window_px: ", lambda: find_corners(EMPTY, BOARD, 0)),
        ("half_window_px: ", lambda: find_corners(EMPTY, BOARD, 2.5)),
        ("half_window_px: ", lambda: find_corners(EMPTY, BOARD, "7")),
        ("board: at most 0 of 100 positions", lambda: placed(Board(9, 6, 60.0))),
        ("count: ", lambda: placed(BOARD, 0)),
        ("tilt_deg: ", lambda: placed(BOARD, tilt_deg=(10, 90))),
        ("rng: ", lambda: placed(BOARD, rng="one")),
    ],
)
def test_what_cannot_be_is_named(message, call):
    with pytest.raises(ValueError, match=message):
        call()


@settings(max_examples=15, deadline=None)
@given(
    st.floats(-300, 300),
    st.floats(-300, 300),
    st.floats(20, 900),
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
)
def test_any_pose_is_a_picture_or_refused(x, y, z, rotvec):
    pose, coarse = at(x, y, z, rotvec), replace(PLAIN, supersampling=2)
    if (pose.apply(np.array(BOARD.outline))[:, 2] <= 0).any():
        with pytest.raises(ValueError, match="T_world_board"):
            board_radiance(HAND, BOARD, pose, coarse)
        return
    image = board_radiance(HAND, BOARD, pose, coarse)
    assert image.shape == (91, 121)
    assert np.isfinite(image).all()
    assert image.max() <= WHITE_GREY


# --- the corners


def test_no_board_no_corners():
    assert np.isnan(find_corners(np.zeros((80, 100), np.uint8), BOARD)).all()
    frame = render_board(HAND, Board(4, 3, 10.0), at(0, 0, 100), PLAIN, np.random.default_rng(0))
    assert find_corners(frame, BOARD).shape == (54, 2)
    assert np.isnan(find_corners(frame, BOARD)).all()  # another board
    assert np.isfinite(find_corners(frame, Board(4, 3, 10.0), 3)).all()


# --- positions


def test_positions_fit_every_camera():
    poses = placed(BOARD, 14)
    assert len(poses) == 14
    for camera in PAIR.cameras:
        assert all(camera.sees(T.apply(np.array(BOARD.outline)), 12.0).all() for T in poses)
    tilt = np.rad2deg(np.arccos(poses.rotation.as_matrix()[:, 2, 2]))
    assert tilt.min() >= 15
    assert tilt.max() <= 40
    again = placed(BOARD, 14)
    np.testing.assert_array_equal(poses.as_matrix(), again.as_matrix())


# --- what a calibration costs


HANDLE, POSES = load_handle("paper"), load_table1().set_poses


def test_a_true_calibration_costs_nothing():
    errors = calibration_errors(PAIR, PAIR, HANDLE, POSES)
    assert errors.n == 20
    assert errors.E_t_mm < 1e-9
    assert errors.geodesic_max_deg < 1e-6  # acos near 1: half of the digits


def test_a_wrong_scale_costs_its_share_of_the_distance():
    first, second = PAIR.cameras
    T = second.T_world_cam
    apart = RigidTransform.from_components(1.001 * T.translation, T.rotation)
    longer = Rig((first, replace(second, T_cam_world=apart.inv())))
    errors = calibration_errors(longer, PAIR, HANDLE, POSES)
    # a baseline 0.1 % too long makes everything 0.1 % larger about CCD1's centre; a rigid fit keeps
    # the handle's size, which moves its origin by 0.1 % of the 15 mm between it and the markers at
    # most
    expected = 1e-3 * np.linalg.norm(POSES.translation, axis=1).mean()
    assert errors.E_t_mm == pytest.approx(expected, abs=0.015)
    assert errors.geodesic_max_deg < 1e-3


def test_14_positions_cost_less_than_the_papers_error():
    rng = np.random.default_rng(0)
    costs = [
        calibration_errors(simulated_calibration(PAIR, BOARD, 14, rng).rig, PAIR, HANDLE, POSES)
        for _ in range(2)
    ]
    assert 0.05 < np.mean([one.E_t_mm for one in costs]) < 0.31
    few = simulated_calibration(PAIR, BOARD, 6, np.random.default_rng(0), noise_px=0.2)
    assert few.sigma_px == pytest.approx(0.2, rel=0.1)


def test_calibration_errors_refuse():
    with pytest.raises(ValueError, match="found: expected 2 cameras, got 3"):
        calibration_errors(load_rig("paper_trinocular"), PAIR, HANDLE, POSES)
    with pytest.raises(ValueError, match="poses: expected three or more markers"):
        calibration_errors(PAIR, PAIR, HANDLE, POSES, max_slant_deg=10.0)
    with pytest.raises(ValueError, match="noise_px: "):
        simulated_calibration(PAIR, BOARD, 3, np.random.default_rng(0), noise_px=-1.0)
