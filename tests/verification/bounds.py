"""That the difference steps of the Cramer-Rao bound are small enough and not too small: the bound at
the first pose of Table 1 over steps and samples.
"""

from unittest.mock import patch

import pandas as pd

from trinolab.bench.optics import Bench
from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies import bound

STEPS_PX = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
SAMPLES = (8, 16, 32, 64)


def report(arguments) -> None:
    print(
        "Cramer-Rao bound, rms in mm: `paper_pair`, markers, by step and samples a side of a pixel"
    )
    rows = {step: {samples: _first(samples, step) for samples in SAMPLES} for step in STEPS_PX}
    print(pd.DataFrame(rows).T.rename_axis("px").to_string(float_format="{:.5f}".format))


def _first(samples: int, step_px: float) -> float:
    bench, T = Bench(marker_supersampling=samples), load_table1().set_poses[0]
    handle, cameras = load_handle("paper"), load_rig("paper_pair").cameras
    with patch.object(bound, "SAMPLES", (samples, 8)):
        parts = [bound.information(c, handle, T, bench, step_px=step_px) for c in cameras]
    return bound.bound_of(sum(parts)).rms_mm
