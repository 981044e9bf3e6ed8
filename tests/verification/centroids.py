"""The centroid beside a prediction of it, by slant, on random poses."""

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, digitise
from trinolab.datasets import load_handle, load_rig
from workbench.studies.centroid_bias import METHODS, centroid_report, instant_errors

from .table1 import expected_frames

DRAWS = 2


def report(arguments) -> None:
    print(
        f"Found minus predicted centroid, px, {arguments.centroid_poses} random poses, three cameras, {DRAWS} draws,"
        " by slant:\nbias along it and across it (se: standard error), scatter, and the part of it that is noise"
    )
    rig, bench = load_rig("raised_40deg"), Bench()
    for handle in map(load_handle, ("coded", "paper")):
        rng = np.random.default_rng(11)
        errors: dict[str, list[pd.DataFrame]] = {name: [] for name in METHODS}
        for k in tqdm(range(arguments.centroid_poses), leave=False, unit="pose"):
            T = random_pose(rng)
            expected = expected_frames(rig, handle, T, bench)
            for _ in range(DRAWS):
                images = [digitise(image, bench, rng) for image in expected]
                for name, method in METHODS.items():
                    errors[name].append(instant_errors(method, images, rig, handle, T, k))
        for name, parts in errors.items():
            table = centroid_report(pd.concat(parts, ignore_index=True))
            print(f"{name}, handle `{handle.name}`")
            print(table.to_string(index=False, float_format="{:.4f}".format), flush=True)
