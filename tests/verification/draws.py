"""Many noisy frames of Table 1's poses, measured by every estimator: a pose is rendered once, only
its noise drawn.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.camera import Rig
from trinolab.datasets import load_table1
from trinolab.handle import Handle
from trinolab.pose import Pose
from workbench.studies.replication import EVERY, estimates_and_truths, measure_frames


class Draw(NamedTuple):
    """One measurement: of which row of Table 1, and under which noise."""

    row: int
    seed: int
    pose: Pose

    @property
    def truth(self) -> RigidTransform:
        return load_table1().set_poses[self.row]


def expected_frames(rig: Rig, handle: Handle, T: RigidTransform, bench: Bench) -> list[np.ndarray]:
    """What the cameras would see without noise, a float image a camera."""
    return [blurred(radiance(camera, handle, T, bench), bench) for camera in rig.cameras]


def frames(
    rig: Rig, handle: Handle, seeds: int, rows: slice
) -> Iterator[tuple[int, int, list[np.ndarray]]]:
    """Row, seed and frames; for a seed the same frames as those of
    `replication.replicate_table1`.
    """
    rngs, bench = [np.random.default_rng(seed) for seed in range(seeds)], Bench()
    for row in range(20)[rows]:
        expected = expected_frames(rig, handle, load_table1().set_poses[row], bench)
        for seed, rng in enumerate(rngs):
            yield row, seed, [digitise(image, bench, rng) for image in expected]


def table1_draws(
    rig: Rig,
    handle: Handle,
    seeds: int,
    rows: slice = slice(None),
    with_prior: bool = False,
    estimators=EVERY,
) -> dict[str, list[Draw]]:
    """Every estimator's measurements of the same frames."""
    places = [(row, seed) for row in range(20)[rows] for seed in range(seeds)]
    shown = tqdm(frames(rig, handle, seeds, rows), total=len(places), leave=False, unit="instant")
    priors = [load_table1().set_poses[row] for row, _ in places] if with_prior else None
    found = measure_frames((images for *_, images in shown), rig, handle, estimators, priors)
    return {
        name: [Draw(row, seed, m.pose) for (row, seed), m in zip(places, measurements, strict=True)]
        for name, measurements in found.items()
    }


def held(draws: list[Draw], handle: Handle) -> tuple[RigidTransform, RigidTransform]:
    """Estimates, each by its equivalent nearest to the truth, and truths of the draws that have a
    pose.
    """
    return estimates_and_truths(
        [draw.pose.T_world_handle for draw in draws], [draw.truth for draw in draws], handle
    )
