"""What cameras see of a handle, marker point by marker point: another algorithm than the renderer's."""

import numpy as np

from trinolab.bench.motion import random_pose
from trinolab.bench.rays import facing, marker_area
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import slants

RIG, TRIO = load_rig("paper_pair"), load_rig("raised_40deg")
PAPER, CODED = load_handle("paper"), load_handle("coded")


def seen_by(camera, T, handle, rng, noise_px=0.1, limit_deg=80.0):
    """Centroids of the facing markers, their axes and indices, in any order: each marker point by
    point.
    """
    index = rng.permutation(
        np.flatnonzero(slants(handle, T, camera.centre) < np.deg2rad(limit_deg))
    )
    points = [marker_area(handle, k) for k in index]
    shown = [p[facing(handle, p, T.inv().apply(camera.centre))] for p in points]
    uv, axes = np.empty((len(index), 2)), np.empty((len(index), 2))
    for k, patch in enumerate(shown):
        # the area that a point shows to the camera, up to a factor
        outward = patch * [1, 0, 1] / handle.radius_mm
        weight = (outward * (T.inv().apply(camera.centre) - patch)).sum(axis=1)
        pixels = camera.project(T.apply(patch))
        uv[k] = np.average(pixels, axis=0, weights=weight)
        axes[k] = 4 * np.sqrt(
            np.maximum(np.linalg.eigvalsh(np.cov(pixels.T, aweights=weight))[::-1], 0.05)
        )
    inside = ((uv > 10) & (uv < np.array(camera.size) - 10)).all(axis=1)
    return (uv + rng.normal(0, noise_px, uv.shape))[inside], axes[inside], index[inside]


def views(T, handle, rng, rig=RIG, **options):
    """Pixels, axes and indices, a tuple of arrays each."""
    return tuple(
        zip(*(seen_by(camera, T, handle, rng, **options) for camera in rig.cameras), strict=True)
    )


def without(arrays, *cameras):
    return tuple(array[:0] if c in cameras else array for c, array in enumerate(arrays))


def good_poses(handle, n, seed, rig=RIG):
    """Poses at which two cameras see four markers up to 62 deg of slant, inside the images."""
    rng = np.random.default_rng(seed)
    while n:
        T = random_pose(rng)
        counts = [len(seen_by(camera, T, handle, rng, limit_deg=62.0)[0]) for camera in rig.cameras]
        if sorted(counts)[-2] >= 4:
            n -= 1
            yield T, rng
