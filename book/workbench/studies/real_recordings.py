"""Evidence from real cameras: recordings made by others, read in our conventions, beside their
published results.

Each function returns None where its recording is not on this machine (see `datasets.real_set`).
Lengths are mm, and pixels have (0, 0) in the centre of the first one. Nothing is unpickled. The
readers raise ValueError as `datasets.real_set` does.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.linalg import rq
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from trinolab.calibration.adjust import Calibrated, calibrate
from trinolab.calibration.target import Board, find_corners
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_array, as_number, frozen
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.rigs import read_rig
from trinolab.markers import MarkerParameters, find_markers
from trinolab.pose import rigid_fit
from trinolab.triangulation import mean_point, points_of_pairs, triangulate

PARTICLES = MarkerParameters(
    diameter_px=(2.5, 14.0), min_axis_ratio=0.3, min_fill=0.6, min_contrast=1.5
)
"""What passes for a particle of `trackpy_particles`: 5 px across, and of 2 to 40 grey levels."""


class StereoPhotographs(NamedTuple):
    """Pairs of photographs of a board: images of uint8, shape (height, width), one per view in `left`
    and `right`.
    """

    left: tuple[np.ndarray, ...]
    right: tuple[np.ndarray, ...]
    board: Board


class Tracks(NamedTuple):
    """Points seen by a calibrated rig: pixels (cameras, n, 2), NaN where not seen, and points (m,
    3) or None, mm.
    """

    rig: Rig
    uv: Array
    points: Array | None


class Particles(NamedTuple):
    """A grey image of dark particles, and the positions (n, 2), px, that another program finds in
    it.
    """

    image: np.ndarray
    uv: Array


class Trajectory(NamedTuple):
    """Times (n,), s, from 0, and poses, mm."""

    t_s: Array
    poses: RigidTransform


def load_opencv_stereo(fetch: bool = False) -> StereoPhotographs | None:
    """OpenCV's 13 pairs of photographs of a chessboard, 640 x 480; there is no pair 10."""
    folder = real_set("opencv_stereo", fetch)
    if folder is None:
        return None
    left, right = (
        tuple(grey(path) for path in sorted(folder.glob(f"{side}??.jpg")))
        for side in ("left", "right")
    )
    return StereoPhotographs(left, right, Board(9, 6, 25.0))


def load_pymvg_mcsc(fetch: bool = False) -> Tracks | None:
    """One LED at 464 instants in four cameras, as MultiCamSelfCal's output has it; no `points`.

    Three traps, undone here. The lens distortion belongs to the matrix of the ``.rad`` files and
    not to the linear camera. The linear cameras have skew, up to 4 px, which `Camera` has not:
    **the pixels are corrected for distortion and skew**, and the cameras have neither. Cameras and
    points of the files without ``Pmat`` are mirrored: a proper rotation puts every point behind its
    camera. The ``Pmat`` files are not; their unit is the metre.
    """
    folder = real_set("pymvg_mcsc", fetch)
    if folder is None:
        return None
    sizes = np.loadtxt(folder / "Res.dat", dtype=int)
    pixels = np.loadtxt(folder / "points.dat").reshape(len(sizes), 3, -1)[:, :2].transpose(0, 2, 1)
    cameras, corrected = zip(
        *(
            _mcsc_camera(folder, k, size, uv)
            for k, (size, uv) in enumerate(zip(sizes.tolist(), pixels, strict=True), start=1)
        ),
        strict=True,
    )
    return Tracks(Rig(cameras), frozen(np.stack(corrected)), None)


def load_caliscope(fetch: bool = False) -> Tracks | None:
    """Corners of a board in four webcams: 48 instants of 12 corners, one after the other in `uv`.

    `points` are the 12 corners in the board's frame, z = 0. The cameras were not triggered
    together: their times within an instant differ by 8 ms in the middle, up to 46 ms.
    """
    folder = real_set("caliscope", fetch)
    if folder is None:
        return None
    rig = read_rig(folder / "camera_array.toml")
    frame = pd.read_csv(folder / "xy.csv")
    instants, instant = np.unique(frame["sync_index"], return_inverse=True)
    board = frame.groupby("keypoint_id")[["obj_loc_x", "obj_loc_y"]].first() * 1e3  # m
    uv = np.full((len(rig.cameras), len(instants), len(board), 2), np.nan)
    uv[frame["cam_id"], instant, frame["keypoint_id"]] = frame[["img_loc_x", "img_loc_y"]]
    corners = np.column_stack([board.to_numpy(), np.zeros(len(board))])
    return Tracks(rig, frozen(uv.reshape(len(uv), -1, 2)), frozen(corners))


def load_trackpy_particles(fetch: bool = False) -> Particles | None:
    """A microscope image of dark particles, and the 344 positions of trackpy's ``locate(255 -
    image, 9, ...)``.
    """
    folder = real_set("trackpy_particles", fetch)
    if folder is None:
        return None
    with np.load(folder / "reproducibility_v0.4.npz", allow_pickle=False) as stored:
        uv = as_array(stored["arr_3"], "arr_3", (None, 2))[:, ::-1]
    return Particles(grey(folder / "T76S3F00001.png"), frozen(uv))


def load_trajectories(fetch: bool = False) -> Trajectory | None:
    """A handheld camera followed by motion capture for 30 s: times and poses. Never fetched: see
    `data/real.toml`.
    """
    folder = real_set("trajectories", fetch)
    if folder is None:
        return None
    rows = as_array(
        np.loadtxt(folder / "freiburg1_xyz-groundtruth.txt"),
        "freiburg1_xyz-groundtruth.txt",
        (None, 8),
    )
    poses = RigidTransform.from_components(rows[:, 1:4] * 1e3, Rotation.from_quat(rows[:, 4:]))
    return Trajectory(frozen(rows[:, 0] - rows[0, 0]), poses)


def at_times(recorded: Trajectory, times_s: Array) -> RigidTransform:
    """The poses between the recorded ones, on straight lines and at even turns, at times (n,), s."""
    places = [np.interp(times_s, recorded.t_s, axis) for axis in recorded.poses.translation.T]
    turns = Slerp(recorded.t_s, recorded.poses.rotation)(times_s)
    return RigidTransform.from_components(np.column_stack(places), turns)


def before_the_cameras(recorded: Trajectory) -> Trajectory:
    """The motion with its middle in that of the standard scene, where it is upright in the mean."""
    places, turns = recorded.poses.translation, recorded.poses.rotation
    upright = Rotation.from_euler("Z", 180, degrees=True) * turns.mean().inv()
    middle = np.median(places, axis=0) - [0.0, 0.0, 570.0]
    return recorded._replace(poses=RigidTransform.from_components(places - middle, upright * turns))


def grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(f"{path}: no image")
    return frozen(image)


def _mcsc_camera(folder: Path, number: int, size: list[int], uv: Array) -> tuple[Camera, Array]:
    """A camera without distortion and skew, and its pixels corrected for both."""
    name = f"basler{number}"
    identity = RigidTransform.identity()
    text = (folder / f"basename{number}.rad").read_text(encoding="utf-8")
    rad = {key: float(value) for key, value in re.findall(r"(\w+)\s*=\s*(\S+)", text)}
    matrix = np.array([[rad["K11"], 0, rad["K13"]], [0, rad["K22"], rad["K23"]], [0, 0, 1]])
    distortions = np.array([*(rad[f"kc{k}"] for k in range(1, 5)), 0.0])
    lens = Camera(name, (size[0], size[1]), matrix, distortions, identity)
    K, R, t = decomposed(np.loadtxt(folder / f"camera{number}.Pmat.cal"))
    upright = K.copy()
    upright[0, 1] = 0.0  # the skew stays with the pixels' correction
    camera = Camera(
        name, lens.size, upright, np.zeros(5), RigidTransform.from_components(t * 1e3, R)
    )
    ideal = lens.ideal_pixels(uv)
    xy = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(K).T
    return camera, camera.to_pixels(xy[:, :2])


def decomposed(P: Array) -> tuple[Array, Rotation, Array]:
    """K (with a diagonal that is positive), R and t of a projection matrix P ~ K [R | t]."""
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    side = np.sign(np.linalg.det(R))
    return K / K[2, 2], Rotation.from_matrix(R * side), np.linalg.solve(K, P[:, 3]) * side


def photographed_calibration(half_window_px: int = 7) -> Calibrated | None:
    """Calibrate OpenCV's 13 pairs of photographs of a chessboard; the smallest squares are 20 px
    across.
    """
    photographs = load_opencv_stereo()
    if photographs is None:
        return None
    uv = [
        [find_corners(image, photographs.board, half_window_px) for image in side]
        for side in photographs[:2]
    ]
    height, width = photographs.left[0].shape
    return calibrate(
        photographs.board.points, np.array(uv), [(width, height)] * 2, ("left", "right")
    )


def led_errors_px() -> Array | None:
    """Reprojection errors of one LED in four cameras, 464 instants, points by Eq. 20-22; shape
    (cameras, n), px.

    In pixels without distortion and skew, which are up to a fifth larger than those that were
    taken.
    """
    tracks = load_pymvg_mcsc()
    return (
        None
        if tracks is None
        else reprojection_px(tracks.rig, triangulate(tracks.rig, tracks.uv), tracks.uv)
    )


def board_errors_mm(min_angle_deg: float = 30.0) -> Array | None:
    """Distances of a board's corners, triangulated from four webcams, from the board laid through
    them.

    Parameters
    ----------
    min_angle_deg : float
        Of `triangulate_steep`.

    Returns
    -------
    ndarray, shape (instants, corners), or None
        mm, after a rigid fit of the board an instant; NaN where a corner was not triangulated.
    """
    tracks = load_caliscope()
    if tracks is None or tracks.points is None:
        return None
    measured = triangulate_steep(tracks.rig, tracks.uv, min_angle_deg).reshape(
        -1, len(tracks.points), 3
    )
    errors = np.full(measured.shape[:2], np.nan)
    for row, points in zip(errors, measured, strict=True):
        T = rigid_fit(tracks.points, points)
        if T is not None:
            row[:] = np.linalg.norm(T.apply(np.array(tracks.points)) - points, axis=1)
    return errors


def particle_errors_px(window_px: int = 9) -> Array | None:
    """Distance of each position that trackpy gives from the nearest marker that `find_markers`
    finds; (344,), px.

    The image is bright with dark particles, and uneven; what is searched is its difference from the
    mean over a window as wide as a particle (9 px, as in the reference). A position without a
    marker of its own counts with its distance from the nearest other one.
    """
    particles = load_trackpy_particles()
    if particles is None:
        return None
    bright = 255.0 - particles.image
    difference = bright - cv2.blur(bright, (window_px, window_px))
    markers = find_markers(difference, len(particles.uv), "bright", PARTICLES)
    return cKDTree(markers.uv).query(particles.uv)[0]


def triangulate_steep(rig: Rig, uv: ArrayLike, min_angle_deg: float) -> Array:
    """Points by Eq. 20-22 without those pairs of cameras whose rays are too nearly parallel to
    measure (Eq. 20-22).

    A depth's error grows like 1/sin of the angle between the rays: at 30 deg, and for cameras that
    face each other at 150 deg, it is twice that of a right angle. Eq. 22's plain mean would take
    such a pair for as good as any.

    Parameters
    ----------
    rig : Rig
    uv : array_like, shape (cameras, n, 2)
        Pixels as taken; NaN where a camera does not see the point.
    min_angle_deg : float
        Smallest angle between the rays, or between one and the other reversed, 0 to 90.

    Returns
    -------
    ndarray, shape (n, 3)
        World frame, mm; NaN where no pair is left.

    Raises
    ------
    ValueError
        If the shape does not fit the rig, or the angle is out of its range.
    """
    uv = as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False)
    least = np.sin(np.deg2rad(as_number(min_angle_deg, "min_angle_deg", low=0.0, high=90.0)))
    rays = [camera.rays(pixels) for camera, pixels in zip(rig.cameras, uv, strict=True)]
    by_pair = points_of_pairs(rig, uv)
    sine = np.stack([np.linalg.norm(np.cross(rays[i], rays[j]), axis=1) for i, j in rig.pairs])
    with np.errstate(invalid="ignore"):
        by_pair[sine < least] = np.nan
    return mean_point(by_pair)


def reprojection_px(rig: Rig, points: ArrayLike, uv: ArrayLike) -> Array:
    """Distances of projected points (n, 3) from pixels (cameras, n, 2); shape (cameras, n), px, NaN
    where missing.
    """
    pixels = as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False)
    return np.linalg.norm(
        np.stack([camera.project(points) for camera in rig.cameras]) - pixels, axis=2
    )


def baseline_difference_mm() -> float | None:
    """How far the photographed pair's baseline is from the stored reference for the same window of
    +-7 px, mm.
    """
    calibrated = photographed_calibration()
    if calibrated is None:
        return None
    reference = load_real_sets()["opencv_stereo"].reference["baseline_mm_win7"]
    return abs(float(np.linalg.norm(calibrated.cameras[1].centre)) - reference)


def led_median_px() -> float | None:
    """Median of `led_errors_px`."""
    errors = led_errors_px()
    return None if errors is None else float(np.nanmedian(errors))


def board_fit_mm() -> float | None:
    """Median over the instants of the median of `board_errors_mm` of an instant."""
    errors = board_errors_mm()
    return None if errors is None else float(np.nanmedian(np.nanmedian(errors, axis=1)))


def particle_median_px() -> float | None:
    """Median of `particle_errors_px`."""
    errors = particle_errors_px()
    return None if errors is None else float(np.median(errors))
