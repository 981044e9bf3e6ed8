"""What a frame of 1280 x 1024 costs `background.step`, beside three plain chains of OpenCV in the same run:
the subtractors CNT and MOG2, and the bare running average with a difference and a threshold.

The frames are those of a camera of the standard recordings, and images that are hard to work on. All
chains see a frame one after the other, so that whatever else the machine does slows all of them:

    python tests/benchmarks/bench_background.py
"""

import clock
import cv2
import numpy as np

from trinolab import background
from workbench.studies.ground_truth import read_recording

LIMIT_MS = 8.0
LIMIT_BY_CNT = 0.7  # on the recordings
CAMERA, EVERY = 2, 2  # CCD3, and of its frames every second one
SIZE = (1024, 1280)


def hard_images():
    """An empty scene, and images that are hard to work on: many equal ratios of greys, many regions, or
    one that fills the image.
    """
    rng = np.random.default_rng(0)
    whole = rng.normal(60, 12, SIZE).clip(20, 120).round().astype(np.uint8)
    noisy = [
        (image + rng.normal(0, 2, SIZE)).clip(0, 255).round().astype(np.uint8)
        for image in (1.2 * whole, whole, whole * np.linspace(1.0, 4.0, SIZE[1]))
    ]
    speckled = np.where(rng.random(SIZE) < 0.15, np.uint8(220), noisy[1])
    return whole, {
        "whole greys": noisy[0],
        "speckle of 15 %": speckled,
        "a lamp switched on": noisy[2],
        "saturated": np.full(SIZE, 255, np.uint8),
        "black": np.zeros(SIZE, np.uint8),
    }


def report(name, empty, frames, by_cnt=None):
    """Print a line a chain; each takes a frame after the other and keeps what it knows."""
    state = {"ours": empty.astype(np.float32), "bare": empty.astype(np.float32)}
    cnt = cv2.bgsegm.createBackgroundSubtractorCNT()
    mog2 = cv2.createBackgroundSubtractorMOG2()
    for _ in range(20):
        cnt.apply(empty)
        mog2.apply(empty)

    def ours(frame):
        state["ours"], detection = background.step(state["ours"], frame)
        return detection.mask

    def bare(frame):
        change = cv2.absdiff(frame, cv2.convertScaleAbs(state["bare"]))
        cv2.accumulateWeighted(frame, state["bare"], 0.01)
        return cv2.threshold(change, 15, 255, cv2.THRESH_BINARY)[1]

    chains = {"CNT": cnt.apply, "MOG2": mog2.apply, "bare average": bare, "ours": ours}
    ours(empty)  # what is made once
    times = {chain: [] for chain in chains}
    for frame in frames:
        for chain, take in chains.items():
            times[chain].append(clock.timed(take, frame)[1])
    for chain in ("CNT", "MOG2", "bare average"):
        clock.line(f"{name}: {chain}", times[chain])
    clock.line(f"{name}: ours", times["ours"], limit=LIMIT_MS)
    if by_cnt is not None:
        clock.line(
            f"{name}: ours by CNT", np.median(times["ours"]) / np.median(times["CNT"]), "", by_cnt
        )


def main() -> int:
    for name in ("calm", "hard"):
        recorded = read_recording(name, range(0, 60, EVERY))
        report(name, recorded.empty[CAMERA], recorded.images_of(CAMERA), LIMIT_BY_CNT)
    empty, images = hard_images()
    for name, image in images.items():
        report(name, empty, [image] * 5)
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
