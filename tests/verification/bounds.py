"""The Cramer-Rao bound at Table 1's poses, and that its difference steps are small enough and not
too small.
"""

import numpy as np

from trinolab.bench.optics import Bench
from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies import bound
from workbench.studies.bound import PIXELS, RIGS, Bound, bound_of, information, table1_bounds

STEPS_PX = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
SAMPLES = (8, 16, 32, 64)


def report(arguments) -> None:
    print(
        "Cramer-Rao bound at Table 1's poses, handle `paper`: rms over the poses, in brackets least and largest"
    )
    print(f"{'rig':18s} {'pixels':9s} greys      position mm                   rotation deg")
    for rig in RIGS:
        for pixels, known in [*((pixels, True) for pixels in PIXELS), ("markers", False)]:
            bounds = table1_bounds(rig, pixels, known)
            mm, deg = np.array([(b.rms_mm, b.rms_deg) for b in bounds]).T
            print(
                f"{rig:18s} {pixels:9s} {'known' if known else 'unknown':8s} {_spread(mm)}     {_spread(deg)}",
                flush=True,
            )
    print(
        "\nThe same at the first pose, `paper_pair`, markers, over difference steps and samples a side of a pixel"
    )
    print("step px " + "".join(f"{f'{s} x {s}: mm, deg':>22s}" for s in SAMPLES))
    for step in STEPS_PX:
        found = [_first(samples, step) for samples in SAMPLES]
        print(
            f"{step:7.2f} " + "".join(f"{b.rms_mm:14.5f} {b.rms_deg:7.4f}" for b in found),
            flush=True,
        )


def _first(samples: int, step_px: float) -> Bound:
    chosen, bound.SAMPLES = bound.SAMPLES, (samples, 8)
    bench, handle, T = (
        Bench(marker_supersampling=samples),
        load_handle("paper"),
        load_table1().set_poses[0],
    )
    try:
        return bound_of(
            sum(
                information(camera, handle, T, bench, step_px=step_px)
                for camera in load_rig("paper_pair").cameras
            )
        )
    finally:
        bound.SAMPLES = chosen


def _spread(values: np.ndarray) -> str:
    return f"{np.sqrt((values**2).mean()):.4f} ({values.min():.4f} to {values.max():.4f})"
