"""The centroid beside a prediction of it, by slant, on random poses."""

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, digitise
from trinolab.datasets import load_handle, load_rig
from workbench.studies.centroid_bias import METHODS, Method, centroid_report, instant_errors

from .draws import expected_frames


def drawn_errors(
    methods: dict[str, Method],
    poses: int,
    draws: int = 2,
    rig_name: str = "raised_40deg",
    handle_name: str = "coded",
    seed: int = 11,
) -> dict[str, pd.DataFrame]:
    """Errors of each method on rendered frames of random poses, the same for all of them."""
    rig, handle, rng, bench = (
        load_rig(rig_name),
        load_handle(handle_name),
        np.random.default_rng(seed),
        Bench(),
    )
    errors: dict[str, list[pd.DataFrame]] = {name: [] for name in methods}
    for k in tqdm(range(poses), leave=False, unit="pose"):
        T = random_pose(rng)
        expected = expected_frames(rig, handle, T, bench)
        for _ in range(draws):
            images = [digitise(image, bench, rng) for image in expected]
            for name, method in methods.items():
                errors[name].append(instant_errors(method, images, rig, handle, T, k))
    return {name: pd.concat(parts, ignore_index=True) for name, parts in errors.items()}


def report(arguments) -> None:
    print(
        f"Found minus predicted centroid, px, {arguments.centroid_poses} random poses, three cameras, two draws, by"
    )
    print(
        "slant: bias along it and across it (se: standard error), scatter, and the part of the scatter that is noise"
    )
    for handle in ("coded", "paper"):
        for name, errors in drawn_errors(
            METHODS, arguments.centroid_poses, handle_name=handle
        ).items():
            print(f"{name}, handle `{handle}`")
            print(
                centroid_report(errors).to_string(index=False, float_format="{:.4f}".format),
                flush=True,
            )
