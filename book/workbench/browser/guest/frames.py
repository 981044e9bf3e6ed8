"""Images of the standard recordings, as the site holds them.

Noise is most of an image, and it follows from the recording's seed. So the site holds how an image
differs from one of the empty bench in the same light and with the same noise: this is zero where
nothing but the bench is seen, and takes an eighth of the bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trinolab.bench.optics import background, blurred
from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import Job, noisy
from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.files import recording

FPS = 30.0


class Bench(NamedTuple):
    """The empty bench of a recording: its job, and the light that each camera gets from it."""

    job: Job
    lights: tuple[Array, ...]


@lru_cache(maxsize=1)
def bench_of(folder: Path) -> Bench:
    """The empty bench of a standard recording."""
    found, handle = recording.open_folder(folder)
    about = json.loads((folder / "made_from.json").read_text(encoding="utf-8"))
    job = scripted(about["motion"], found.rig, handle, about["seed"], about["frames"] / FPS)
    lights = (blurred(background(camera, job.bench), job.bench) for camera in job.rig.cameras)
    return Bench(job, tuple(lights))


def empty(bench: Bench, frame: int, index: int) -> np.ndarray:
    """A camera's image of the empty bench at an instant, uint8 (height, width)."""
    gain = bench.job.shots[frame].gains[index]
    return noisy(bench.job, frame, index, gain * bench.lights[index])


def difference(image: np.ndarray, bench: Bench, frame: int, index: int) -> np.ndarray:
    """The difference of an image from the one of the empty bench, modulo 256."""
    return image - empty(bench, frame, index)


def read_from(site: Path) -> None:
    """Let `read_instants` restore the images of recordings in a folder of the site."""
    read = recording.read_instants

    def read_instants(listed: Sequence[recording.Instant], rig: Rig) -> Iterator[list[np.ndarray]]:
        for instant, images in zip(listed, read(listed, rig), strict=True):
            folder = instant.paths[0].parents[2]
            if folder.parent != site:
                yield images
                continue
            bench = bench_of(folder)
            yield [held + empty(bench, instant.frame, k) for k, held in enumerate(images)]

    recording.read_instants = read_instants
