"""Hostile instants: is a pose called measured that is off by more than 2 mm or 5 deg."""

import numpy as np
from hostile import KINDS, hostile, is_wrong
from tqdm import tqdm

from trinolab.datasets import load_handle, load_rig
from trinolab.measurement import measure
from workbench.studies.replication import CHECKED, EVERY

ESTIMATORS = (CHECKED, "patches")


def report(arguments) -> None:
    each = -(-arguments.hostile // (2 * len(KINDS)))
    print(
        f"{each} hostile instants of each kind and rig, handle `coded`, no prior: measured and right, and wrong ones"
    )
    print(f"{'kind':20s} {'rig':17s}" + "".join(f"{name:>14s} right, wrong" for name in ESTIMATORS))
    for kind in KINDS:
        for rig in ("paper_pair", "raised_40deg"):
            _line(kind, rig, each)


def _line(kind: str, rig_name: str, each: int) -> None:
    rig, handle, rng = load_rig(rig_name), load_handle("coded"), np.random.default_rng(17)
    right, wrong = (dict.fromkeys(ESTIMATORS, 0) for _ in range(2))
    for _ in tqdm(range(each), leave=False, unit="instant"):
        instant = hostile(rng, rig, handle, kind)
        for name in ESTIMATORS:
            pose = measure(instant.frames, rig, handle, parameters=EVERY[name]).pose
            misled = is_wrong(pose, instant, handle)
            wrong[name] += misled
            right[name] += pose.status == "measured" and not misled
    print(
        f"{kind:20s} {rig_name:17s}"
        + "".join(f"{right[n]:19d}, {wrong[n]:5d}" for n in ESTIMATORS),
        flush=True,
    )
