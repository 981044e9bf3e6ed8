"""A calibration on the simulated bench: a board photographed at several positions, and what the
result costs a pose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.board import board_positions, render_board
from trinolab.bench.optics import Bench
from trinolab.calibration.adjust import Calibrated, calibrate
from trinolab.calibration.target import Board, find_corners
from trinolab.camera import Rig
from trinolab.checks import Array, as_number, as_rng, frozen
from trinolab.handle import Handle, facing_pixels
from trinolab.metrics import PoseErrors, pose_errors
from trinolab.pose import rigid_fit
from trinolab.triangulation import triangulate

CORNER_NOISE_PX = 0.05  # of corners found in rendered frames; 0.036 to 0.049 px in three trials


def photograph(
    rig: Rig, board: Board, poses: RigidTransform, bench: Bench, rng: np.random.Generator
) -> list[list[np.ndarray]]:
    """Frames of the board: for each camera one at each of the poses T_world_board, of length n."""
    return [[render_board(camera, board, T, bench, rng) for T in poses] for camera in rig.cameras]


def corners_of(
    frames: Sequence[Sequence[np.ndarray]], board: Board, half_window_px: int = 7
) -> Array:
    """Corners found in each camera's frames, shape (cameras, views, n, 2), px; NaN where the board
    is not found.
    """
    return frozen(
        np.array(
            [[find_corners(frame, board, half_window_px) for frame in side] for side in frames]
        )
    )


def bent(board: Board, bend_mm: float) -> Array:
    """The corners (n, 3) of a board that is bent along its rows to a parabola: the middle stands out
    of the plane of both ends by `bend_mm`, board frame.
    """
    points = np.array(board.points)
    x = points[:, 0] - points[:, 0].mean()
    points[:, 2] = as_number(bend_mm, "bend_mm") * (1 - (x / x.max()) ** 2)
    return points


def true_corners(rig: Rig, board: Board, poses: RigidTransform, bend_mm: float = 0.0) -> Array:
    """Where the corners truly are, shape (cameras, views, n, 2), px; the board may be `bent`."""
    points = bent(board, bend_mm)
    return np.stack([[camera.project(T.apply(points)) for T in poses] for camera in rig.cameras])


def calibration_errors(
    found: Rig, true: Rig, handle: Handle, poses: RigidTransform, max_slant_deg: float = 65.0
) -> PoseErrors:
    """What a calibration alone costs: exact pixels of the markers, measured with the wrong cameras
    (Eq. 20-27).

    The pixels are where the true cameras see the markers' centres; points and poses come from the
    found ones, with the first camera's frame as the world of both. There is no noise and no wrong
    match.

    Parameters
    ----------
    found, true : Rig
    handle : Handle
    poses : RigidTransform of length n
    max_slant_deg : float
        Markers seen at a larger one are left out.

    Raises
    ------
    ValueError
        If the rigs have not the same number of cameras, or a pose shows fewer than three common
        markers.
    """
    if len(found.cameras) != len(true.cameras):
        raise ValueError(f"found: expected {len(true.cameras)} cameras, got {len(found.cameras)}")
    steepest = as_number(max_slant_deg, "max_slant_deg", low=0.0, high=90.0)
    pixels = [
        np.stack([facing_pixels(handle, camera, T, steepest) for camera in true.cameras])
        for T in poses
    ]
    fits = [rigid_fit(handle.marker_centres, triangulate(found, uv)) for uv in pixels]
    if any(fit is None for fit in fits):
        raise ValueError(
            "poses: expected three or more markers that two cameras see, at every pose"
        )
    return pose_errors(RigidTransform.concatenate([fit for fit in fits if fit is not None]), poses)


def simulated_calibration(
    rig: Rig,
    board: Board,
    positions: int,
    rng: np.random.Generator,
    noise_px: float = CORNER_NOISE_PX,
    bend_mm: float = 0.0,
) -> Calibrated:
    """Calibrate from exact corners with Gaussian noise: a rendered calibration without the
    rendering.

    Parameters
    ----------
    rig, board, positions, rng, noise_px
    bend_mm : float
        By which the true board's middle stands out of the plane of its ends, see `bent`; the
        calibration takes it for flat.

    Raises
    ------
    ValueError
        As `board_positions` and `calibrate` do, or for a negative noise.
    """
    poses = board_positions(rig, board, positions, as_rng(rng))
    exact = true_corners(rig, board, poses, bend_mm)
    noise = as_number(noise_px, "noise_px", low=0.0) * rng.standard_normal(exact.shape)
    return calibrate(
        board.points, exact + noise, [c.size for c in rig.cameras], rig.names, distortion_terms=0
    )
