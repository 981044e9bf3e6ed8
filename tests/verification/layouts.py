"""Random layouts without symmetry: are their markers identified as `coded`'s are."""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.bench.hand import true_visibility
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle
from trinolab.measurement import measure
from trinolab.metrics import geodesic_deg
from workbench.studies.replication import EVERY

from .identity import rightly_labelled, seen_pose

APART_MM = 2.0  # between markers, and the least by which the staggers of two columns differ


def staggered(
    rng: np.random.Generator, columns: int = 6, radius_mm: float = 5.0, diameter_mm: float = 3.0
) -> Handle:
    """Two markers a column, the distance between them another one in each column."""
    room = rng.uniform(12, 16) + APART_MM * rng.permutation(columns)
    first = rng.uniform(8, 20, columns)
    rows = tuple((float(a), float(a - b)) for a, b in zip(first, room, strict=True))
    angles = tuple(float(a) for a in np.arange(columns) * 360 / columns)
    return Handle("staggered", radius_mm, 200.0, 25.0, diameter_mm, angles, rows)


def near_symmetric(rng: np.random.Generator) -> Handle:
    """The paper's layout with one marker moved along its column by 3 to 6 mm."""
    paper = load_handle("paper")
    rows = [list(row) for row in paper.rows_mm]
    rows[rng.integers(6)][rng.integers(2)] += float(rng.choice([-1, 1]) * rng.uniform(3, 6))
    return Handle(
        "near",
        paper.radius_mm,
        paper.length_mm,
        paper.top_mm,
        paper.marker_diameter_mm,
        paper.columns_deg,
        tuple(map(tuple, rows)),
    )


LAYOUTS: dict[str, Callable[[np.random.Generator], Handle]] = {
    "staggered": staggered,
    "five columns": lambda rng: staggered(rng, 5),
    "eight columns": lambda rng: staggered(rng, 8, 8.0),
    "other radius": lambda rng: staggered(
        rng, 6, float(rng.uniform(6, 12)), float(rng.uniform(2.5, 4))
    ),
    "near-symmetric": near_symmetric,
}


def report(arguments) -> None:
    poses = max(arguments.poses // 5, 1)
    print(
        f"{poses} random poses of random layouts of each kind, a new one every ten, four markers truly seen by each"
    )
    print(
        "of two cameras, no prior, `best`; what tells a near-symmetric one from the paper's is seen by one of them."
    )
    print("Right: measured, and every used marker identified; wrong: measured, but not so.")
    print(
        f"{'layout':15s} {'rig':17s} right %  ambiguous  lost  wrong   worst mm, deg of those right"
    )
    for kind in LAYOUTS:
        for rig in ("paper_pair", "raised_40deg"):
            _line(kind, rig, poses)


def instants(
    kind: str, rig: Rig, poses: int, rng: np.random.Generator
) -> Iterator[tuple[Handle, RigidTransform]]:
    """Handles and poses."""
    for k in range(poses):
        if k % 10 == 0:
            handle = LAYOUTS[kind](rng)
        T = seen_pose(rig, handle, rng)
        while kind == "near-symmetric" and not _tells(rig, handle, T):
            T = seen_pose(rig, handle, rng)
        yield handle, T


def _tells(rig: Rig, handle: Handle, T: RigidTransform) -> bool:
    """Whether a camera truly sees the marker that is not where the paper's layout has it."""
    moved = (handle.marker_centres != load_handle("paper").marker_centres).any(axis=1)
    return any(true_visibility(camera, handle, T)[moved].any() for camera in rig.cameras)


def _line(kind: str, rig_name: str, poses: int) -> None:
    rig, rng, status, worst = load_rig(rig_name), np.random.default_rng(3), [], np.zeros(2)
    for handle, T in tqdm(
        instants(kind, rig, poses, rng), total=poses, leave=False, unit="instant"
    ):
        found = measure(
            render_rig(rig, handle, T, Bench(), rng), rig, handle, parameters=EVERY["patches"]
        )
        right = found.pose.status == "measured" and rightly_labelled(found, T, rig, handle)
        status.append("right" if right else found.pose.status)
        if right:
            pose = found.pose.T_world_handle
            worst = np.maximum(
                worst, [np.linalg.norm(pose.translation - T.translation), geodesic_deg(pose, T)[0]]
            )
    counts = [status.count(word) for word in ("ambiguous", "lost", "measured")]
    print(
        f"{kind:15s} {rig_name:17s} {100 * status.count('right') / poses:7.2f} {counts[0]:10d} {counts[1]:5d} "
        f"{counts[2]:6d} {worst[0]:8.3f} {worst[1]:6.2f}",
        flush=True,
    )
