"""Random poses of the standard scene without a prior, of the shipped handles and of random layouts
without symmetry: is every used marker the right one, how far off is the pose.
"""

from collections import Counter
from collections.abc import Callable
from itertools import product

import numpy as np
import pandas as pd
from hostile import seen_pose
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle
from trinolab.measurement import Measurement, measure
from trinolab.metrics import geodesic_deg, nearest_equivalent
from workbench.studies.bound import RIGS
from workbench.studies.claim_trials import true_labels
from workbench.studies.replication import EVERY

APART_MM = 2.0  # between markers, and the least by which the staggers of two columns differ
EACH = 10  # poses of a layout that is drawn
PAPER = load_handle("paper")


def staggered(
    rng: np.random.Generator, columns: int = 6, radius_mm: float = 5.0, diameter_mm: float = 3.0
) -> Handle:
    """Two markers a column, the distance between them another one in each column."""
    room = rng.uniform(12, 16) + APART_MM * rng.permutation(columns)
    first = rng.uniform(8, 20, columns)
    rows = tuple((float(a), float(a - b)) for a, b in zip(first, room, strict=True))
    angles = tuple(float(a) for a in np.arange(columns) * 360 / columns)
    return Handle("staggered", radius_mm, 200.0, 25.0, diameter_mm, angles, rows)


LAYOUTS: dict[str, Callable[[np.random.Generator], Handle]] = {
    "coded": lambda rng: load_handle("coded"),
    "paper": lambda rng: PAPER,
    "staggered": staggered,
    "five columns": lambda rng: staggered(rng, 5),
    "eight columns": lambda rng: staggered(rng, 8, 8.0),
    "other radius": lambda rng: staggered(rng, 6, rng.uniform(6, 12), rng.uniform(2.5, 4)),
}


def report(arguments) -> None:
    print(
        "Random poses, four markers truly seen by each of two cameras, no prior; layouts are drawn anew every "
        f"{EACH}.\nRight: a pose, and every used marker identified, up to the handle's symmetry; wrong: measured, "
        "but not so.\nErrors of those right: mean and largest"
    )
    rows = []
    for layout, rig in product(LAYOUTS, RIGS):
        count = arguments.poses if layout in ("coded", "paper") else max(arguments.poses // 5, 1)
        rows += _rows(layout, rig, count)
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.4f}".format), flush=True)


def _rows(layout: str, rig_name: str, count: int) -> list[dict[str, float | str]]:
    """What each estimator makes of the same frames."""
    rig, rng = load_rig(rig_name), np.random.default_rng(7)
    status: dict[str, Counter] = {name: Counter() for name in EVERY}
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in EVERY}
    for k in tqdm(range(count), leave=False, unit="instant"):
        if k % EACH == 0:
            handle = LAYOUTS[layout](rng)
        T = seen_pose(rng, rig, handle)
        images = render_rig(rig, handle, T, Bench(), rng)
        for name, parameters in EVERY.items():
            found = measure(images, rig, handle, parameters=parameters)
            right = rightly_labelled(found, T, rig, handle)
            status[name]["right" if right else found.pose.status] += 1
            if right:
                near = nearest_equivalent(found.pose.T_world_handle, T, handle.symmetries)[0]
                away = np.linalg.norm(near.translation - T.translation)
                errors[name].append((float(away), float(geodesic_deg(near, T)[0])))
    rows = []
    for name in EVERY:
        shares = {kind: 100 * status[name][kind] / count for kind in ("right", "ambiguous", "lost")}
        mm, deg = np.reshape(errors[name] or [(np.nan, np.nan)], (-1, 2)).T
        means = {"mm": mm.mean(), "most mm": mm.max(), "deg": deg.mean(), "most deg": deg.max()}
        wrong = status[name]["measured"]
        about = {"layout": layout, "rig": rig_name, "estimator": name}
        rows.append({**about, **shares, "wrong": wrong, **means})
    return rows


def rightly_labelled(found: Measurement, truth: RigidTransform, rig: Rig, handle: Handle) -> bool:
    """Whether there is a pose, and every labelled marker is the one that is there by the equivalent
    truth.
    """
    if found.pose.T_world_handle is None:
        return False
    near = nearest_equivalent(truth, found.pose.T_world_handle, handle.symmetries)[0]
    return all(
        (true_labels(camera, handle, near, markers.uv)[labels >= 0] == labels[labels >= 0]).all()
        for camera, markers, labels in zip(rig.cameras, found.markers, found.labels, strict=True)
    )
