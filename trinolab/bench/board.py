"""The simulated bench with a calibration target: what cameras would see of a chessboard, with the
truth (Sect. 6.2).

A frame is made like one of the handle: the light that reaches each pixel's area, the lens's blur,
noise and 8 bit. The board is flat, opaque and evenly lit; its dark squares begin beside the first
inner corner, and a white margin is around them.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..calibration.target import Board
from ..camera import Camera, Rig
from ..checks import Array, as_number, as_rng, as_transform
from .optics import Bench, background, blurred, digitise
from .rays import sample_offsets

DARK_GREY, WHITE_GREY = 30.0, 200.0  # of the squares: no level saturates
_EMPTY = 0
_WHITE = 1
_DARK = 2
_CHUNK = 65_536  # rays at once


def render_board(
    camera: Camera,
    board: Board,
    T_world_board: RigidTransform,
    bench: Bench,
    rng: np.random.Generator,
) -> np.ndarray:
    """Take a frame of the board; uint8, shape (height, width).

    Raises
    ------
    ValueError
        If the board reaches behind the camera.
    """
    return digitise(blurred(board_radiance(camera, board, T_world_board, bench), bench), bench, rng)


def board_radiance(
    camera: Camera, board: Board, T_world_board: RigidTransform, bench: Bench
) -> Array:
    """The image before blur and noise: the mean grey of each pixel's area, shape (height, width).

    Pixels that an edge may cross have ``bench.supersampling ** 2`` samples, all others one at the
    centre. From behind the board is white. Raises ValueError if the board reaches behind the
    camera.
    """
    T_cam_board = camera.T_cam_world * as_transform(T_world_board, "T_world_board")
    if (T_cam_board.apply(np.array(board.outline))[:, 2] <= 0).any():
        raise ValueError("T_world_board: expected the board in front of the camera")
    image = background(camera, bench).copy()
    labels = np.full(image.shape, _EMPTY, np.uint8)
    rows, columns = np.nonzero(_region(camera, board, T_world_board))
    labels[rows, columns] = _seen(camera, board, T_cam_board, np.column_stack([columns, rows]))
    image[labels == _WHITE] = WHITE_GREY
    image[labels == _DARK] = DARK_GREY
    square = np.ones((3, 3), np.uint8)
    rows, columns = np.nonzero(cv2.dilate(labels, square) != cv2.erode(labels, square))
    offsets = sample_offsets(bench.supersampling)
    for start in range(0, len(rows), max(1, _CHUNK // len(offsets))):
        v, u = (index[start : start + max(1, _CHUNK // len(offsets))] for index in (rows, columns))
        samples = _seen(
            camera, board, T_cam_board, (np.column_stack([u, v])[:, None] + offsets).reshape(-1, 2)
        )
        behind = np.repeat(background(camera, bench)[v, u], len(offsets))
        grey = np.choose(samples, [behind, WHITE_GREY, DARK_GREY])
        image[v, u] = grey.reshape(len(v), -1).mean(axis=1)
    return image


def board_positions(
    rig: Rig,
    board: Board,
    count: int,
    rng: np.random.Generator,
    distance_mm: float = 560.0,
    tilt_deg: tuple[float, float] = (15.0, 40.0),
    margin_px: float = 12.0,
) -> RigidTransform:
    """Draw positions of the board that every camera sees whole: T_world_board of length `count`.

    The board's middle lies within a tenth of `distance_mm` of the point at that distance on the
    first camera's axis; the board is tilted by `tilt_deg` about any axis of its plane and turned by
    up to 20 deg in its plane.

    Raises
    ------
    ValueError
        If fewer than one in a hundred draws fits the images.
    """
    low, high = sorted(as_number(t, "tilt_deg", low=0.0, high=80.0) for t in tilt_deg)
    distance = as_number(distance_mm, "distance_mm", low=0.0, open_low=True)
    wanted = int(as_number(count, "count", low=1))
    positions = list[RigidTransform]()
    for _ in range(100 * wanted):
        T = rig.cameras[0].T_world_cam * _drawn(board, distance, (low, high), as_rng(rng))
        if all(
            camera.sees(T.apply(np.array(board.outline)), margin_px).all() for camera in rig.cameras
        ):
            positions.append(T)
        if len(positions) == wanted:
            return RigidTransform.concatenate(positions)
    raise ValueError(
        f"board: at most {len(positions)} of {100 * wanted} positions drawn at {distance:g} mm fit into the "
        "images of all cameras"
    )


def _drawn(
    board: Board, distance: float, tilt_deg: tuple[float, float], rng: np.random.Generator
) -> RigidTransform:
    """One pose T_cam_board, whether or not it fits."""
    around = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(rng.uniform(*tilt_deg))
    turn = np.deg2rad(rng.uniform(-20, 20))
    rotation = Rotation.from_rotvec([tilt * np.cos(around), tilt * np.sin(around), 0.0])
    rotation = rotation * Rotation.from_rotvec([0.0, 0.0, turn])
    centre = np.array([0, 0, distance]) + rng.uniform(-0.1, 0.1, 3) * distance
    return RigidTransform.from_components(
        centre - rotation.apply(board.points.mean(axis=0)), rotation
    )


def _region(camera: Camera, board: Board, T_world_board: RigidTransform) -> np.ndarray:
    """Pixels that may see the board, bool (height, width): its outline filled, with two pixels to
    spare.
    """
    share = np.linspace(0, 1, 16, endpoint=False)[:, None]
    after = np.roll(board.outline, -1, axis=0)
    edge = np.concatenate([a + share * (b - a) for a, b in zip(board.outline, after, strict=True)])
    uv = camera.project(T_world_board.apply(edge))
    mask = np.zeros(camera.size[::-1], np.uint8)
    if not (np.abs(uv) < 2e4).all():
        return np.ones(mask.shape, bool)  # an outline so far aside that the lens model folds back
    cv2.fillPoly(mask, [np.rint(uv).astype(np.int32)], 1)
    return cv2.dilate(mask, np.ones((5, 5), np.uint8)).astype(bool)


def _seen(camera: Camera, board: Board, T_cam_board: RigidTransform, uv: Array) -> np.ndarray:
    """The surface that rays through pixels (n, 2) meet: nothing of the board, white or dark; uint8
    (n,).
    """
    T_board_cam = T_cam_board.inv()
    origin = T_board_cam.translation
    xy = camera.normalise(uv)
    right, down, forward = T_board_cam.rotation.as_matrix().T[:, :, None]
    directions = right * xy[:, 0] + down * xy[:, 1] + forward
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -origin[2] / directions[2]
        x, y = (origin[:2, None] + depth * directions[:2]) / board.square_mm
        inside = (
            (depth > 0) & (x >= -2) & (x <= board.columns + 1) & (y >= -2) & (y <= board.rows + 1)
        )
        squares = inside & (x >= -1) & (x < board.columns) & (y >= -1) & (y < board.rows)
        dark = squares & ((np.floor(x) + np.floor(y)) % 2 == 0) & (origin[2] < 0)
    return np.where(dark, _DARK, np.where(inside, _WHITE, _EMPTY)).astype(np.uint8)
