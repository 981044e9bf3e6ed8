"""Seconds that ``trinolab calibrate`` takes: 13 pairs of real photographs, and 48 instants of three webcams,
rendered.

Beside it OpenCV on the same images: the same search for corners, ``calibrateCamera`` for each camera,
then ``stereoCalibrate`` for the first camera with each of the others. It fits five distortion
coefficients to all views, and says no uncertainty; ours leaves out views that do not fit, chooses
the number of coefficients by views that are held out, and draws the residuals. What is imported is not
counted:

    python tests/benchmarks/bench_calibrate.py
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import clock
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


def rendered(folder):
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


def ours(sources, target, folder):
    """What the command does; the rms residual, px."""
    result = calibrate_rig(
        sources, target, folder / "rig.toml", progress=False, picture=picture_of_residuals
    )
    return result.calibrated.rms_px


def corners_of(image, target):
    detected, corners = cv2.findChessboardCorners(image, (target.columns, target.rows))
    return cv2.cornerSubPix(image, corners, (7, 7), (-1, -1), STOP) if detected else None


def opencv(files, target):
    """The rms residual of the last pair of cameras, px."""
    board, corners, lenses = target.points.astype(np.float32), [], []
    for side in files:
        images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in side]
        size = images[0].shape[::-1]
        corners.append([corners_of(image, target) for image in images])
        seen = [uv for uv in corners[-1] if uv is not None]
        lenses.append(cv2.calibrateCamera([board] * len(seen), seen, size, None, None)[1:3])
    for side, lens in zip(corners[1:], lenses[1:], strict=True):
        pairs = zip(corners[0], side, strict=True)
        left, right = zip(
            *(pair for pair in pairs if all(uv is not None for uv in pair)), strict=True
        )
        of_both = [*lenses[0], *lens, size]
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        rms = cv2.stereoCalibrate([board] * len(left), left, right, *of_both, flags=flags)[0]
    return float(rms)


def compare(label, sources, files, target, limit_s):
    with tempfile.TemporaryDirectory() as out:
        own = [clock.timed(ours, sources, target, Path(out)) for _ in range(REPEATS)]
    other = [clock.timed(opencv, files, target) for _ in range(REPEATS)]
    for name, found, limit in (("OpenCV", other, None), ("ours", own, limit_s)):
        seconds = [ms / 1e3 for _, ms in found]
        clock.line(f"{label}: {name}", seconds, "s", limit, f"rms {found[0][0]:.3f} px")


def main() -> int:
    photographs = real_set("opencv_stereo")
    if photographs is None:
        print(f"13 pairs of photographs: {why_not()}")
    else:
        sources = {side: str(photographs / f"{side}*.jpg") for side in ("left", "right")}
        files = [sorted(photographs.glob(f"{side}[0-9]*.jpg")) for side in sources]
        target = replace(BOARD, square_mm=25.0)
        compare("13 pairs of photographs", sources, files, target, PAIRS_S)
    with tempfile.TemporaryDirectory() as folder:
        sources = rendered(Path(folder))
        files = [sorted(Path(path).glob("*.png")) for path in sources.values()]
        compare(f"{INSTANTS} instants of three webcams", sources, files, BOARD, INSTANTS_S)
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
