"""Hostile instants: is a pose called measured that is off by more than 2 mm or 5 deg."""

from itertools import product

import numpy as np
import pandas as pd
from hostile import KINDS, hostile, is_wrong
from tqdm import tqdm

from trinolab.datasets import load_handle, load_rig
from trinolab.measurement import measure
from workbench.studies.replication import CHECKED, EVERY

ESTIMATORS = (CHECKED, "patches")
RIGS = ("paper_pair", "raised_40deg")


def report(arguments) -> None:
    each = -(-arguments.hostile // (2 * len(KINDS)))
    print(
        f"{each} hostile instants of each kind and rig, handle `coded`, no prior: right and wrong"
    )
    handle, rows = load_handle("coded"), []
    for kind, name in product(KINDS, RIGS):
        rig, rng = load_rig(name), np.random.default_rng(17)
        counts = dict.fromkeys(product(ESTIMATORS, ("right", "wrong")), 0)
        for _ in tqdm(range(each), leave=False, unit="instant"):
            instant = hostile(rng, rig, handle, kind)
            for estimator in ESTIMATORS:
                pose = measure(instant.frames, rig, handle, parameters=EVERY[estimator]).pose
                misled = is_wrong(pose, instant, handle)
                counts[estimator, "wrong"] += misled
                counts[estimator, "right"] += pose.status == "measured" and not misled
        rows.append({"kind": kind, "rig": name, **{" ".join(k): n for k, n in counts.items()}})
    print(pd.DataFrame(rows).to_string(index=False), flush=True)
