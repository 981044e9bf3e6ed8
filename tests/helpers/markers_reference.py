"""`markers.markers_at` in NumPy and OpenCV, a place at a time: the reference of `marker_loops`."""

import numpy as np

from trinolab import blobs
from trinolab.markers import MarkerParameters, blob_at, brightened, halfway


def markers_at(image, uv, reach_px, markers="bright", parameters=None):
    p = parameters or MarkerParameters()
    bright = brightened(image, markers)
    inside = ((uv > -0.5) & (uv < np.array(bright.shape[::-1]) - 0.5)).all(axis=1)
    rows = np.flatnonzero(inside)
    no_threshold = np.full(len(rows), np.inf)
    where = blobs.Places(uv[rows], np.full(len(rows), reach_px), no_threshold)
    table = np.full((len(uv), 6), np.nan)
    for candidate in blobs.candidates(bright, where, p.min_contrast):
        for threshold in candidate.thresholds:
            blob = blob_at(bright, candidate.uv, candidate.reach, threshold, p)
            if blob is not None:
                table[rows[candidate.place]] = halfway(bright, blob, p)[:6]
                break
    return table
