"""What a frame of 1280 x 1024 costs `background.step` on one core, by what it costs three plain
chains of OpenCV in the same run: the subtractors CNT and MOG2, and the bare running average with a
difference and a threshold.

The frames are those of a camera of the standard recordings. All four see a frame one after the
other, so that whatever else the machine does slows all of them; a ratio is that of the medians, and
that of the quickest frames stands beside it:

    python tests/benchmarks/bench_background.py
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import time
from collections.abc import Callable

import cv2
import numpy as np

from trinolab import background
from workbench.studies.ground_truth import read_recording

LIMIT_MS = 4.0
CAMERA, EVERY = 2, 2  # CCD3, and of its frames every second one
STAGES = ("commonest_ratio", "has_moved", "_renew", "moving_window")


def chains(empty: np.ndarray) -> dict[str, Callable[[np.ndarray], object]]:
    """Each takes a frame after the other and keeps what it knows."""
    state = {"ours": empty.astype(np.float32), "bare": empty.astype(np.float32)}
    cnt = cv2.bgsegm.createBackgroundSubtractorCNT()
    mog2 = cv2.createBackgroundSubtractorMOG2()

    def ours(frame: np.ndarray) -> np.ndarray:
        state["ours"], found = background.step(state["ours"], frame)
        return found.mask

    def bare(frame: np.ndarray) -> np.ndarray:
        change = cv2.absdiff(frame, cv2.convertScaleAbs(state["bare"]))
        cv2.accumulateWeighted(frame, state["bare"], 0.01)
        return cv2.threshold(change, 15, 255, cv2.THRESH_BINARY)[1]

    return {"ours": ours, "CNT": cnt.apply, "MOG2": mog2.apply, "bare": bare}


def stages(frames: list[np.ndarray], empty: np.ndarray) -> str:
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
        state, begin = empty.astype(np.float32), time.process_time()
        for frame in frames:
            state, _ = background.step(state, frame)
        total = 1e3 * (time.process_time() - begin)
    finally:
        for name, function in originals.items():
            setattr(background, name, function)
    spent["the rest"] = total - sum(spent.values())
    return ", ".join(f"{name.lstrip('_')} {ms / len(frames):.2f}" for name, ms in spent.items())


def main() -> int:
    cv2.setNumThreads(1)
    slow = []
    for name in ("calm", "hard"):
        recorded = read_recording(name, range(0, 60, EVERY))
        frames, empty = recorded.images_of(CAMERA), recorded.empty[CAMERA]
        spent: dict[str, list[float]] = {}
        for _ in range(3):
            for take in chains(empty).values():
                take(frames[0])  # what is made once
            running = chains(empty)
            for frame in frames:
                for chain, take in running.items():
                    begin = time.process_time()
                    take(frame)
                    spent.setdefault(chain, []).append(1e3 * (time.process_time() - begin))
        times = {chain: (np.median(ms), np.min(ms)) for chain, ms in spent.items()}
        print(f"{name}: ms a frame, median and least of {len(spent['ours'])}")
        for chain, (median, least) in times.items():
            ratio = [times["ours"][k] / times[chain][k] for k in (0, 1)]
            print(
                f"  {chain:6s}{median:8.2f}{least:8.2f}    ours by it {ratio[0]:.2f}, of the "
                f"quickest frames {ratio[1]:.2f}",
                flush=True,
            )
        print(f"  ours: {stages(frames, empty)}")
        if times["ours"][0] > min(LIMIT_MS, times["CNT"][0]):
            slow.append(name)
    print(
        f"wanted: at most {LIMIT_MS:g} ms, and no more than CNT: "
        f"{'BROKEN: ' + ', '.join(slow) if slow else 'kept'}"
    )
    return int(bool(slow))


if __name__ == "__main__":
    raise SystemExit(main())
