"""The way of a frame of `trinolab live` from camera to screen, in headless Chromium, with frames in
memory in the place of three cameras that are triggered together.

The time of its arrival, ms, is drawn into each frame's pixels as a row of black and white blocks, and read
back from the page's canvas when the page has drawn it, at 30 frames a second of 640 x 480 and of 1280 x
1024:

    python tests/benchmarks/bench_live.py [--seconds 20]
"""

import argparse
import multiprocessing
import os
import signal
import tempfile
import time
from functools import partial
from pathlib import Path

import clock
import numpy as np
import psutil

from satellites.live.command import live
from satellites.live.sources import Feed, Source
from trinolab.bench.motion import motion_at
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig, scaled
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle, load_rig
from workbench.pages.browser import Browser

MOST_MS, LATEST_MS = 100.0, 250.0
FPS, BITS, SEED, INSTANTS = 30.0, 24, 5, 60
HANDLE = load_handle("coded")
# The page reads each frame when it is drawn: a block's middle is dark or bright.
READ = """
window.late = [];
document.addEventListener('drawn', () => {
    const canvas = document.getElementById('camera-0'), pen = canvas.getContext('2d');
    const side = canvas.width / BITS, all = 2 ** BITS;
    const row = pen.getImageData(0, canvas.height - Math.ceil(side / 2), canvas.width, 1).data;
    let number = 0;
    for (let k = 0; k < BITS; k++)
        number = 2 * number + (row[4 * Math.floor((k + 0.5) * side)] > 128);
    if (number !== window.before)  // without a camera the picture stays
        window.late.push((Date.now() % all - number + all) % all);
    window.before = number;
});
""".replace("BITS", str(BITS))


def small_rig() -> Rig:
    """The standard rig with images of 640 x 480: the middle of its images at half the size."""
    cameras = []
    for camera in load_rig("raised_40deg").cameras:
        half = scaled(camera, 0.5)
        matrix = half.matrix.copy()
        matrix[1, 2] -= 16
        cameras.append(Camera(half.name, (640, 480), matrix, half.distortions, half.T_cam_world))
    return Rig(tuple(cameras))


def drawn(rig: Rig) -> np.ndarray:
    """The images of a moving handle, there and back, uint8 (instants, cameras, height, width)."""
    rng = np.random.default_rng(SEED)
    poses = motion_at(rng, np.arange(INSTANTS // 2) / FPS, speed_mm_s=100.0, turn_deg_s=10.0)
    quick = Bench(supersampling=4, marker_supersampling=8)
    frames = [render_rig(rig, HANDLE, T, quick, rng) for T in poses]
    return np.array([*frames, *frames[::-1]])


def frames_of(images, is_first, stopped):
    """A camera's frames at the instants of a common trigger, those of the first one with the time of
    their arrival in their pixels.
    """
    while not stopped.is_set():
        k = int(time.monotonic() * FPS) + 1
        stopped.wait(max(0.0, k / FPS - time.monotonic()))
        image = images[k % len(images)]
        yield time.monotonic(), [stamped(image) if is_first else image]


def stamped(image: np.ndarray) -> np.ndarray:
    """The image with the present time in its lowest rows."""
    number = int(1e3 * time.time()) % (1 << BITS)
    high, wide = image.shape
    bits = [255 * (number >> k & 1) for k in reversed(range(BITS))]
    edges = np.linspace(0, wide, BITS + 1).round().astype(int)
    image = image.copy()
    image[high - wide // BITS :] = np.repeat(np.array(bits, np.uint8), np.diff(edges))
    return image


def serving(images, rig, folder, address) -> None:
    """The process that is measured."""
    feeds = [
        Feed(camera.name, partial(frames_of, images[:, k], k == 0), False)
        for k, camera in enumerate(rig.cameras)
    ]
    live(Source(rig, HANDLE, feeds), folder, on_open=address.send)


def processor_s(pid: int) -> float:
    """Processor time of a process so far."""
    return sum(psutil.Process(pid).cpu_times()[:2])


def watched(browser: Browser, pid: int, seconds: float, name: str) -> None:
    """Print what is measured of a page with frames of one size."""
    while not browser.evaluate("Boolean(last && last.status === 'measured')"):
        time.sleep(0.05)
    browser.evaluate("send({clutch: true})")
    browser.evaluate(READ)
    time.sleep(2.0)
    browser.evaluate("late.length = 0")
    used = processor_s(pid)
    time.sleep(seconds)
    late = np.array(browser.evaluate("late"))
    used = 1e3 * (processor_s(pid) - used) / len(late)
    clock.line(f"{name}: from frame to screen", late)
    clock.line(f"{name}: of 95 %", np.quantile(late, 0.95), limit=MOST_MS)
    clock.line(f"{name}: the latest", late.max(), limit=LATEST_MS)
    clock.line(f"{name}: processor time of a frame on the screen", used)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    context = multiprocessing.get_context("spawn")
    for rig in (small_rig(), load_rig("raised_40deg")):
        with tempfile.TemporaryDirectory() as folder:
            ours, its = multiprocessing.Pipe()
            process = context.Process(target=serving, args=(drawn(rig), rig, folder, its))
            process.start()
            browser = Browser(Path(folder))
            try:
                browser.open(ours.recv())
                name = "{} x {}".format(*rig.cameras[0].size)
                watched(browser, process.pid, seconds, name)
            finally:
                browser.close()
                os.kill(process.pid, signal.SIGINT)
                process.join()
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
