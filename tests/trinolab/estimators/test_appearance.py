"""Shares of pixels against the bench's rays, sampled densely: another algorithm."""

import numpy as np
import pytest
from scenes import bent, facing

from trinolab.bench.motion import random_pose
from trinolab.bench.rays import EMPTY, cast, sample_offsets
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators import loops, rows
from trinolab.estimators.appearance import geometry_of, shading_basis, windows

HANDLE = load_handle("coded")
PLAIN = load_rig("raised_40deg")
BENT = bent(PLAIN, -0.25, 0.1, 1e-3, -1e-3, 0.0)
T = random_pose(np.random.default_rng(1))
SIDE = 25


def views_of(rig, T, steepest_deg=68.0):
    views, slant = facing(rig, HANDLE, T, steepest_deg)
    uv = [camera.project(T.apply(HANDLE.marker_centres)) for camera in rig.cameras]
    return views, windows(rig, views, np.stack(uv)[views], (SIDE, SIDE)), np.rad2deg(slant)


def layers(rig, T, views, at, any_marker):
    """Shares of marker and body in windows, and the distance from whatever else is there, in cells."""
    _, k, p = at.xy.shape
    drawn, lights = np.empty((k, rows.LAYERS, p)), np.empty((k, 8, p))
    loops.draw_all(at.xy, *geometry_of(rig, HANDLE, T, views, at), any_marker, drawn, lights)
    return drawn[:, [rows.MARKER_SHARE, rows.BODY_SHARE, rows.CLEARANCE]].swapaxes(0, 1)


@pytest.mark.parametrize("rig", [PLAIN, BENT], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("any_marker", [False, True])
def test_shares_are_those_of_densely_sampled_rays(rig, any_marker):
    views, at, slant = views_of(rig, T)
    markers, bodies, clearance = layers(rig, T, views, at, any_marker)
    v, u = np.divmod(np.arange(SIDE**2), SIDE)
    for k in range(0, len(slant), 3):
        pixels = at.corner[k] + np.column_stack([u, v])
        rays = (pixels[:, None] + sample_offsets(12)).reshape(-1, 2)
        labels = cast(rig.cameras[views.camera[k]], HANDLE, T, rays).labels.reshape(SIDE**2, -1)
        # whatever else is there is near
        middle = labels[:, labels.shape[1] // 2]
        assert (clearance[k][(middle >= 0) & (middle != views.marker[k])] < 0.3).all()
        assert (clearance[k][middle == views.marker[k]] > 0).all()
        clear = clearance[k] > 1
        marker = (labels >= 0) if any_marker else labels == views.marker[k]
        for share, truth in ((markers[k], marker), (bodies[k], labels != EMPTY)):
            error = (share - truth.mean(axis=1))[clear]
            # an edge is taken as straight within a pixel: a curved or oblique one differs in single
            # pixels
            assert np.abs(error).max() < (0.03 if slant[k] < 50 and not any_marker else 0.2)
            # and so does the area, by up to 0.7 % at 65 deg: a hundredth of a pixel in the width
            assert abs(error.sum()) < (0.005 if slant[k] < 50 else 0.015) * truth.mean(axis=1).sum()


def test_the_basis_spans_a_distant_light():
    turn = np.linspace(-0.7, 0.7, 50)
    light = 0.7 + 0.3 * np.cos(turn - 0.4)  # Lambert's law
    assert np.linalg.lstsq(shading_basis(turn).T, light, rcond=None)[1] < 1e-20
    assert shading_basis(0.0)[0] == 1
    assert not shading_basis(0.0)[1:].any()
