"""Shares of pixels against the bench's rays, sampled densely: another algorithm."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.motion import random_pose
from trinolab.bench.rays import EMPTY, cast, sample_offsets
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators import loops, rows
from trinolab.estimators.appearance import Views, geometry_of, shading_basis, windows
from trinolab.handle import slants

HANDLE = load_handle("coded")
PLAIN = load_rig("raised_40deg")
BENT = Rig(
    tuple(replace(c, distortions=np.array([-0.25, 0.1, 1e-3, -1e-3, 0.0])) for c in PLAIN.cameras)
)
T = random_pose(np.random.default_rng(1))
SIDE = 25


def views_of(rig, T_world_handle, steepest_deg=68.0):
    slant = np.stack([slants(HANDLE, T_world_handle, camera.centre) for camera in rig.cameras])
    views = Views(*np.nonzero(slant < np.deg2rad(steepest_deg)))
    uv = np.stack(
        [camera.project(T_world_handle.apply(HANDLE.marker_centres)) for camera in rig.cameras]
    )[views]
    return views, windows(rig, views, uv, (SIDE, SIDE)), np.rad2deg(slant[views])


class Drawn(NamedTuple):
    """Layers of windows: shares of marker and body, their derivatives by a motion of the handle,
    angle about the axis, rad, and distance from whatever else is there, in cells.
    """

    marker: np.ndarray
    body: np.ndarray
    marker_motion: np.ndarray
    body_motion: np.ndarray
    turn: np.ndarray
    clear: np.ndarray


def layers(rig, handle, pose, views, at, any_marker=False):
    """The layers as `loops.draw` fills them."""
    _, k, p = at.xy.shape
    drawn, lights = np.empty((k, rows.LAYERS, p)), np.empty((k, 8, p))
    loops.draw_all(at.xy, *geometry_of(rig, handle, pose, views, at), any_marker, drawn, lights)
    return Drawn(
        drawn[:, rows.MARKER_SHARE],
        drawn[:, rows.BODY_SHARE],
        drawn[:, rows.MARKER_MOTION : rows.MARKER_MOTION + 6],
        drawn[:, rows.BODY_MOTION : rows.BODY_MOTION + 6],
        np.arctan2(drawn[:, rows.SINE], 1 - drawn[:, rows.VERSINE]),
        drawn[:, rows.CLEARANCE],
    )


def moved(step):
    return T * RigidTransform.from_components(step[:3], Rotation.from_rotvec(step[3:]))


@pytest.mark.parametrize("rig", [PLAIN, BENT], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("any_marker", [False, True])
def test_shares_are_those_of_densely_sampled_rays(rig, any_marker):
    views, at, slant = views_of(rig, T)
    shown = layers(rig, HANDLE, T, views, at, any_marker)
    v, u = np.divmod(np.arange(SIDE**2), SIDE)
    for k in range(0, len(slant), 3):
        pixels = at.corner[k] + np.column_stack([u, v])
        rays = (pixels[:, None] + sample_offsets(12)).reshape(-1, 2)
        labels = cast(rig.cameras[views.camera[k]], HANDLE, T, rays).labels.reshape(SIDE**2, -1)
        clear = shown.clear[k] > 1
        marker = (labels >= 0) if any_marker else labels == views.marker[k]
        for share, truth in ((shown.marker[k], marker), (shown.body[k], labels != EMPTY)):
            error = (share - truth.mean(axis=1))[clear]
            # an edge is taken as straight within a pixel: a curved or oblique one differs in single
            # pixels
            assert np.abs(error).max() < (0.03 if slant[k] < 50 and not any_marker else 0.2)
            # and so does the area, by up to 0.7 % at 65 deg: a hundredth of a pixel in the width
            assert abs(error.sum()) < (0.005 if slant[k] < 50 else 0.015) * truth.mean(axis=1).sum()


@pytest.mark.parametrize("any_marker", [False, True])
def test_shares_move_with_the_pose_as_their_derivatives_say(any_marker):
    views, at, _ = views_of(PLAIN, T, 60.0)
    shown = layers(PLAIN, HANDLE, T, views, at, any_marker)
    step = np.array([0.02, -0.03, 0.02, 2e-3, -3e-3, 2e-3])  # 0.2 px
    after, before = (
        layers(PLAIN, HANDLE, moved(sign * step), views, at, any_marker) for sign in (1, -1)
    )
    for name in ("marker", "body"):
        change = getattr(after, name) - getattr(before, name)
        told = 2 * step @ getattr(shown, f"{name}_motion")
        # summed over a few pixels, because within one the share bends where an edge enters it
        for pattern in (
            np.ones(SIDE**2),
            np.divmod(np.arange(SIDE**2), SIDE)[0],
            np.arange(SIDE**2) % SIDE,
        ):
            scale = np.abs(change) @ pattern
            np.testing.assert_allclose(told @ pattern, change @ pattern, atol=0.02 * scale.max())


def test_pixels_of_neighbours_and_beyond_the_end_are_known():
    views, at, _ = views_of(PLAIN, T)
    shown = layers(PLAIN, HANDLE, T, views, at)
    v, u = np.divmod(np.arange(SIDE**2), SIDE)
    for k in range(len(views.camera)):
        labels = cast(
            PLAIN.cameras[views.camera[k]], HANDLE, T, at.corner[k] + np.column_stack([u, v])
        ).labels
        other = (labels >= 0) & (labels != views.marker[k])
        assert (shown.clear[k][other] < 0.3).all()
        assert (shown.clear[k][labels == views.marker[k]] > 0).all()


def test_a_cell_of_several_pixels_shows_their_mean():
    views, at, slant = views_of(PLAIN, T, 50.0)
    uv = at.corner + SIDE // 2
    coarse = windows(PLAIN, views, uv, (SIDE, 12), (2, 1))
    fine = windows(PLAIN, views, uv, (SIDE, 24))
    assert (coarse.corner == fine.corner).all()
    assert coarse.size_px.tolist() == fine.size_px.tolist() == [24, SIDE]
    of_cells = layers(PLAIN, HANDLE, T, views, coarse)
    of_pixels = layers(PLAIN, HANDLE, T, views, fine)
    for name in ("marker", "body"):
        pixels = getattr(of_pixels, name).reshape(-1, SIDE, 12, 2).mean(axis=3)
        error = getattr(of_cells, name) - pixels.reshape(len(slant), -1)
        # an edge is taken as straight within a cell, and a cell is twice as wide
        assert np.abs(error).max() < 0.06
        assert np.abs(error.sum(axis=1)).max() < 0.3


def test_turn_is_the_angle_from_the_column_and_the_basis_spans_a_distant_light():
    turn = np.linspace(-0.7, 0.7, 50)
    light = 0.7 + 0.3 * np.cos(turn - 0.4)  # Lambert's law
    rest = np.linalg.lstsq(shading_basis(turn).T, light, rcond=None)[1]
    assert rest < 1e-20
    assert shading_basis(0.0)[0] == 1
    assert not shading_basis(0.0)[1:].any()


def test_the_angle_in_a_cell_that_the_outline_cuts_is_that_of_what_is_seen():
    """Rays against a cylinder by hand, 144 a cell."""
    views, at, _ = views_of(PLAIN, T, 62.0)
    shown = layers(PLAIN, HANDLE, T, views, at)
    v, u = np.divmod(np.arange(SIDE**2), SIDE)
    errors_deg = []
    for k in range(len(views.camera)):
        cut = np.flatnonzero((shown.body[k] > 0.1) & (shown.body[k] < 0.9))
        pixels = at.corner[k] + np.column_stack([u, v])[cut]
        rays = (pixels[:, None] + sample_offsets(12)).reshape(-1, 2)
        camera = PLAIN.cameras[views.camera[k]]
        x, _, z = T.inv().apply(camera.centre)
        dx, _, dz = T.rotation.inv().apply(camera.rays(rays)).T
        # of |(x, z) + t (dx, dz)| = radius the nearer solution
        a, b, c = dx**2 + dz**2, x * dx + z * dz, x**2 + z**2 - HANDLE.radius_mm**2
        t = (-b - np.sqrt(np.where(b**2 > a * c, b**2 - a * c, np.nan))) / a
        angle = np.arctan2(x + t * dx, z + t * dz) - HANDLE.marker_angles[views.marker[k]]
        turn = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
        seen = np.nanmean(turn.reshape(len(cut), 144), axis=1)
        errors_deg.append(np.rad2deg(shown.turn[k][cut] - seen))
    errors_deg = np.concatenate(errors_deg)
    assert len(errors_deg) > 30
    # 0.65; in the middles of the cells 7.0
    assert np.abs(errors_deg).max() < 1.0
