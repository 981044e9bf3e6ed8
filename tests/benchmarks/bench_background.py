"""What a frame of 1280 x 1024 costs `background.step` on one core, by what it costs three plain
chains of OpenCV in the same run: the subtractors CNT and MOG2, and the bare running average with a
difference and a threshold.

The frames are those of a camera of the standard recordings, and images that are hard to work on.
All chains see a frame one after the other, so that whatever else the machine does slows all of
them; a ratio is that of the medians, and that of the quickest frames stands beside it. With
--numpy it is done by the equations, as in a browser, and no limit holds:

    python tests/benchmarks/bench_background.py [--numpy]
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from trinolab import background
from workbench.studies.ground_truth import read_recording

LIMIT_MS = 8.0  # on any image
LIMIT_BY_CNT = 0.7  # on the recordings
CAMERA, EVERY = 2, 2  # CCD3, and of its frames every second one
COUNT = 15  # frames of an image that is hard to work on
STAGES = ("commonest_ratio", "_compared", "_window")
SIZE = (1024, 1280)


class Scene(NamedTuple):
    """Frames of a camera, the empty scene, and whether each frame meets that anew."""

    name: str
    empty: np.ndarray
    frames: list[np.ndarray]
    anew: bool


def recordings() -> Iterator[Scene]:
    """The standard recordings, one frame after the other."""
    for name in ("calm", "hard"):
        recorded = read_recording(name, range(0, 60, EVERY))
        yield Scene(name, recorded.empty[CAMERA], recorded.images_of(CAMERA), False)


def hard_images() -> Iterator[Scene]:
    """Images that are hard to work on: many equal ratios of greys, many regions, or one that fills
    the image.
    """
    rng = np.random.default_rng(0)
    whole = rng.normal(60, 12, SIZE).clip(20, 120).round().astype(np.uint8)
    lamp = np.linspace(1.0, 4.0, SIZE[1])  # one factor does not make up for it

    def noisy(image: np.ndarray) -> np.ndarray:
        return (image + rng.normal(0, 2, SIZE)).clip(0, 255).round().astype(np.uint8)

    def speckled() -> np.ndarray:
        return np.where(rng.random(SIZE) < 0.15, np.uint8(220), noisy(whole))

    makers: dict[str, Callable[[], np.ndarray]] = {
        "whole greys": lambda: noisy(1.2 * whole),
        "speckle of 15 %": speckled,
        "a lamp switched on": lambda: noisy(whole * lamp),
        "saturated": lambda: np.full(SIZE, 255, np.uint8),
        "black": lambda: np.zeros(SIZE, np.uint8),
    }
    for name, make in makers.items():
        yield Scene(name, whole, [make() for _ in range(COUNT)], True)


def chains(scene: Scene) -> dict[str, Callable[[np.ndarray], object]]:
    """Each takes a frame after the other and keeps what it knows."""
    known = scene.empty.astype(np.float32)
    state = {"ours": known, "bare": known.copy()}
    cnt = cv2.bgsegm.createBackgroundSubtractorCNT()
    mog2 = cv2.createBackgroundSubtractorMOG2()
    for _ in range(20 if scene.anew else 1):
        cnt.apply(scene.empty)
        mog2.apply(scene.empty)

    def ours(frame: np.ndarray) -> np.ndarray:
        renewed, detection = background.step(state["ours"], frame)
        state["ours"] = known if scene.anew else renewed
        return detection.mask

    def bare(frame: np.ndarray) -> np.ndarray:
        change = cv2.absdiff(frame, cv2.convertScaleAbs(state["bare"]))
        cv2.accumulateWeighted(frame, state["bare"], 0.01)
        return cv2.threshold(change, 15, 255, cv2.THRESH_BINARY)[1]

    return {"ours": ours, "CNT": cnt.apply, "MOG2": mog2.apply, "bare": bare}


def stages(scene: Scene) -> str:
    """Where the time of `step` goes, ms a frame."""
    spent = dict.fromkeys(STAGES, 0.0)
    originals = {name: getattr(background, name) for name in STAGES}

    def clock(name: str) -> Callable:
        def timed(*arguments, **options):
            begin = time.process_time()
            try:
                return originals[name](*arguments, **options)
            finally:
                spent[name] += 1e3 * (time.process_time() - begin)

        return timed

    try:
        for name in STAGES:
            setattr(background, name, clock(name))
        ours, begin = chains(scene)["ours"], time.process_time()
        for frame in scene.frames:
            ours(frame)
        total = 1e3 * (time.process_time() - begin)
    finally:
        for name, function in originals.items():
            setattr(background, name, function)
    spent["checks"] = total - sum(spent.values())
    count = len(scene.frames)
    return ", ".join(f"{name.lstrip('_')} {ms / count:.2f}" for name, ms in spent.items() if ms)


def measured(scene: Scene) -> dict[str, tuple[float, float]]:
    """Median and least time of a frame, ms, of each chain."""
    spent: dict[str, list[float]] = {}
    for _ in range(3):
        running = chains(scene)
        running["ours"](scene.frames[0])  # what is made once
        running = chains(scene)
        for frame in scene.frames:
            for chain, take in running.items():
                begin = time.process_time()
                take(frame)
                spent.setdefault(chain, []).append(1e3 * (time.process_time() - begin))
    return {chain: (float(np.median(ms)), min(ms)) for chain, ms in spent.items()}


def report(scene: Scene) -> dict[str, tuple[float, float]]:
    """Print a scene's lines."""
    times = measured(scene)
    print(f"{scene.name}: ms a frame, median and least of {3 * len(scene.frames)}")
    for chain, (median, least) in times.items():
        ratio = times["ours"][0] / median, times["ours"][1] / least
        print(
            f"  {chain:6s}{median:8.2f}{least:8.2f}    ours by it {ratio[0]:.2f}, of the "
            f"quickest frames {ratio[1]:.2f}",
            flush=True,
        )
    print(f"  ours: {stages(scene)}")
    return times


def main() -> int:
    cv2.setNumThreads(1)
    by_equations = "--numpy" in sys.argv
    if by_equations:
        background._loops = lambda: None
    slow = []
    for scene in recordings():
        times = report(scene)
        if times["ours"][0] > min(LIMIT_MS, LIMIT_BY_CNT * times["CNT"][0]):
            slow.append(scene.name)
    for scene in hard_images():
        if report(scene)["ours"][0] > LIMIT_MS:
            slow.append(scene.name)
    print(
        f"wanted: at most {LIMIT_MS:g} ms, and of the recordings at most {LIMIT_BY_CNT:g} of CNT: "
        f"{'BROKEN: ' + ', '.join(slow) if slow else 'kept'}"
    )
    return int(bool(slow) and not by_equations)


if __name__ == "__main__":
    raise SystemExit(main())
