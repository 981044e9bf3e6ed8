"""Milliseconds to measure one instant of three 1280 x 1024 frames, stage by stage, for each estimator.

Beside it a plain OpenCV chain on the same frames: SimpleBlobDetector, triangulatePoints for each
pair of cameras and their mean, rigid fit by SVD; once with OpenCV's own thresholds, once told that
the body is darker than grey 100. Which blob is which marker the truth tells it, and that takes no
time; ours finds it out, without a prior:

    python tests/benchmarks/bench_measure.py
"""

import clock
import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab import measurement
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.identity import labelled_pixels
from trinolab.methods import BEST, ESTIMATORS
from trinolab.metrics import pose_errors
from trinolab.parameters import Parameters
from trinolab.pose import rigid_fit
from workbench.studies.claim_trials import true_labels
from workbench.studies.instant_times import blob_detector

LIMIT_MS = 15.0
POSES, REPEATS = 20, 5
STAGES = ("find_markers", "rig_candidates", "identify", "estimate")
RIG, HANDLE = load_rig("raised_40deg"), load_handle("coded")


def opencv_chain(frames, truth, lowest=None):
    """Pose and time, ms; the shipped rigs have no distortion that had to be removed."""
    detector = blob_detector(RIG, HANDLE, lowest)
    blobs, detecting_ms = clock.timed(lambda: [detector.detect(frame) for frame in frames])
    found = [np.reshape([blob.pt for blob in of_one], (-1, 2)) for of_one in blobs]
    labels = [true_labels(c, HANDLE, truth, uv) for c, uv in zip(RIG.cameras, found, strict=True)]
    uv = labelled_pixels(tuple(labels), tuple(found), len(HANDLE.marker_centres))
    T, fitting_ms = clock.timed(_fitted, uv)
    return T, detecting_ms + fitting_ms


def _fitted(uv):
    points = np.full((len(RIG.pairs), len(HANDLE.marker_centres), 3), np.nan)
    matrices = [c.matrix @ c.T_cam_world.as_matrix()[:3] for c in RIG.cameras]
    for pair, (i, j) in zip(points, RIG.pairs, strict=True):
        both = np.isfinite(uv[[i, j]]).all(axis=(0, 2))
        X = cv2.triangulatePoints(matrices[i], matrices[j], uv[i, both].T, uv[j, both].T)
        pair[both] = (X[:3] / X[3]).T
    seen = np.isfinite(points).any(axis=(0, 2))
    mean = np.full(points.shape[1:], np.nan)
    mean[seen] = np.nanmean(points[:, seen], axis=0)
    return rigid_fit(HANDLE.marker_centres, mean)


def errors(poses, truths):
    """The mean errors of poses, None where there is none."""
    pairs = [(T, truth) for T, truth in zip(poses, truths, strict=True) if T is not None]
    e = pose_errors(*map(RigidTransform.concatenate, zip(*pairs, strict=True)))
    lost = len(poses) - len(pairs)
    return f"E_t {e.E_t_mm:.4f} mm, {e.geodesic_mean_deg:.3f} deg, lost {lost}"


def main() -> int:
    rng, truths = np.random.default_rng(1), list(load_table1().set_poses[:POSES])
    instants = [render_rig(RIG, HANDLE, T, Bench(), rng) for T in truths]
    measurement.measure(instants[0], RIG, HANDLE)  # what is made once
    for lowest, name in ((None, "OpenCV"), (100.0, "OpenCV, from grey 100")):
        poses, times = zip(
            *(opencv_chain(images, T, lowest) for images, T in zip(instants, truths, strict=True)),
            strict=True,
        )
        clock.line(name, times, more=errors(poses, truths))
    for estimator in ESTIMATORS:
        p = Parameters(estimator=estimator)
        times = []
        with clock.clocked(measurement, *STAGES) as spent:
            for _ in range(REPEATS):
                found = [
                    clock.timed(measurement.measure, one, RIG, HANDLE, None, p) for one in instants
                ]
                times += [ms for _, ms in found]
        poses = [one.pose.T_world_handle for one, _ in found]
        stages = ", ".join(f"{stage} {ms / len(times):.2f}" for stage, ms in spent.items())
        limit = LIMIT_MS if estimator == BEST else None
        clock.line(estimator, times, "ms", limit, f"{errors(poses, truths)}; mean of {stages}")
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
