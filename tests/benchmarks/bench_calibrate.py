"""Seconds that ``trinolab calibrate`` takes on one core: 13 pairs of real photographs, and 48 instants
of three webcams, rendered.

Beside it OpenCV on the same images: the same search for corners, ``calibrateCamera`` for each camera,
then ``stereoCalibrate`` for the first camera with each of the others. It fits five distortion
coefficients to all views, and says no uncertainty; ours leaves out views that do not fit, chooses
the number of coefficients by views that are held out, and draws the residuals. What is imported is not counted:

    python tests/benchmarks/bench_calibrate.py
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from trinolab.bench.board import board_positions, render_board
from trinolab.bench.optics import Bench
from trinolab.calibration.calibrate import calibrate_rig
from trinolab.calibration.target import Target
from trinolab.camera import Rig
from trinolab.datasets import real_set
from trinolab.files.fetch import why_not
from workbench.plotting.calibration import picture_of_residuals
from workbench.studies.carrier import script

webcams = script("webcams")
PAIRS_S, INSTANTS_S = 3.0, 20.0
REPEATS = 3
INSTANTS, DISTANCE_MM, SEED = 48, 500.0, 0
LENS = np.array([-0.12, 0.05, 5e-4, -4e-4, 0.0])
BOARD = Target("chessboard", 9, 6, 20.0)
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)


def rendered(folder: Path) -> dict[str, str]:
    """Instants of a board before three webcams, as folders of images by the cameras' names."""
    perfect = webcams.webcam_rig(webcams.WEBCAMS[1])
    rig = Rig(tuple(replace(camera, distortions=LENS) for camera in perfect.cameras))
    rng = np.random.default_rng(SEED)
    poses = board_positions(rig, BOARD.board, INSTANTS, rng, DISTANCE_MM)
    for camera in rig.cameras:
        (folder / camera.name).mkdir()
        for k, T in enumerate(poses):
            image = render_board(camera, BOARD.board, T, Bench(supersampling=4), rng)
            cv2.imwrite(str(folder / camera.name / f"{k:02d}.png"), image)
    return {camera.name: str(folder / camera.name) for camera in rig.cameras}


def ours(sources: dict[str, str], target: Target, folder: Path) -> float:
    """What the command does; the rms residual, px."""
    result = calibrate_rig(
        sources, target, folder / "rig.toml", progress=False, picture=picture_of_residuals
    )
    return result.found.rms_px


def opencv(files: list[list[Path]], target: Target) -> float:
    """The rms residual of the last pair of cameras, px."""
    corners, size = [], (0, 0)
    for side in files:
        images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in side]
        size = images[0].shape[::-1]
        corners.append([_corners(image, target) for image in images])
    lenses = []
    for side in corners:
        seen = [uv for uv in side if uv is not None]
        board = [target.points.astype(np.float32)] * len(seen)
        lenses.append(cv2.calibrateCamera(board, seen, size, None, None)[1:3])
    rms = np.nan
    for side, lens in zip(corners[1:], lenses[1:], strict=True):
        pairs = [
            (a, b) for a, b in zip(corners[0], side, strict=True) if a is not None and b is not None
        ]
        board = [target.points.astype(np.float32)] * len(pairs)
        left, right = zip(*pairs, strict=True)
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        rms = cv2.stereoCalibrate(board, left, right, *lenses[0], *lens, size, flags=flags)[0]
    return float(rms)


def _corners(image: np.ndarray, target: Target) -> np.ndarray | None:
    detected, corners = cv2.findChessboardCorners(image, (target.columns, target.rows))
    return cv2.cornerSubPix(image, corners, (7, 7), (-1, -1), STOP) if detected else None


def timed(function: Callable[[], float], repeats: int) -> tuple[float, float]:
    """What a function returns, and the median of its CPU time, s, which other programs do not
    lengthen.
    """
    times = []
    for _ in range(repeats):
        start = time.process_time()
        rms = function()
        times.append(time.process_time() - start)
    return rms, float(np.median(times))


def compare(
    label: str, sources: dict[str, str], files: list[list[Path]], target: Target, limit_s: float
) -> bool:
    """Print a line; whether ours keeps its limit."""
    with tempfile.TemporaryDirectory() as out:
        ours_px, ours_s = timed(lambda: ours(sources, target, Path(out)), REPEATS)
    opencv_px, opencv_s = timed(lambda: opencv(files, target), REPEATS)
    print(
        f"{label:30}{ours_s:8.2f}{opencv_s:10.2f}{ours_s / opencv_s:8.1f}{limit_s:8.0f}"
        f"{ours_px:10.3f}{opencv_px:12.3f}",
        flush=True,
    )
    return ours_s <= limit_s


def main() -> int:
    cv2.setNumThreads(1)
    print(
        f"{f's of CPU time, median of {REPEATS}':30}{'ours':>8}{'OpenCV':>10}{'ratio':>8}{'limit':>8}"
        f"{'rms / px':>10}{'OpenCV px':>12}"
    )
    kept = []
    photographs = real_set("opencv_stereo")
    if photographs is None:
        print(f"13 pairs of photographs: {why_not()}")
    else:
        sources = {side: str(photographs / f"{side}*.jpg") for side in ("left", "right")}
        files = [sorted(photographs.glob(f"{side}[0-9]*.jpg")) for side in sources]
        target = replace(BOARD, square_mm=25.0)
        kept.append(compare("13 pairs of photographs", sources, files, target, PAIRS_S))
    with tempfile.TemporaryDirectory() as folder:
        sources = rendered(Path(folder))
        files = [sorted(Path(path).glob("*.png")) for path in sources.values()]
        label = f"{INSTANTS} instants of three webcams"
        kept.append(compare(label, sources, files, BOARD, INSTANTS_S))
    print("limits " + ("kept" if all(kept) else "BROKEN"))
    return int(not all(kept))


if __name__ == "__main__":
    raise SystemExit(main())
