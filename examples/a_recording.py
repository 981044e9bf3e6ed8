"""A recording: rendered, followed, and compared with its truth.

    python examples/a_recording.py [FOLDER]

writes the recording and its poses into a folder, `example` without one.
"""

import sys
from pathlib import Path

import trinolab

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "example")
folder.mkdir(exist_ok=True)
recording = folder / "recording"
poses = folder / "poses.csv"

trinolab.render("paper_pair", "coded", "calm", recording, seconds=1.2)
trinolab.track(recording, poses)
result = trinolab.evaluate(poses, recording / "truth.csv", "coded")

print(f"{result.measured} of {result.instants} instants measured")
print(f"mean error {result.errors.E_t_mm:.4f} mm, {result.errors.geodesic_mean_deg:.3f} deg")
