"""Poses in a batch: prediction, explanation, fit; the layout's arrays; the three-point problem."""

from dataclasses import replace

import numpy as np
import pytest
from boards import motion
from markerviews import seen_by
from scenes import bent

from trinolab.bench.motion import random_pose
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle, slants
from trinolab.identity.hypotheses import (
    Observed,
    Poses,
    explain,
    fit,
    ideal_pixels,
    predict,
    slopes,
)
from trinolab.identity.layout import layout_of, views_of
from trinolab.identity.p3p import three_point_depths
from trinolab.identity.parameters import IdentityParameters
from trinolab.identity.search import candidate_points
from trinolab.rigid import shifted

RIG, CODED = load_rig("raised_40deg"), load_handle("coded")
P = IdentityParameters()
BENT = bent(RIG, -0.2, 0.08, 1e-3, -5e-4, 0.0)


def batch(*poses):
    return Poses(
        np.stack([T.rotation.as_matrix() for T in poses]), np.stack([T.translation for T in poses])
    )


@pytest.mark.parametrize(
    "handle",
    [CODED, Handle("wide", 8.0, 150.0, 40.0, 5.0, (0.0, 90.0, 200.0), ((5.0,),) * 3)],
    ids=["coded", "wide"],
)
def test_predicted_centroids_are_those_of_the_visible_patches(handle):
    """To 0.1 px up to 75 deg of slant and to a quarter of one at 90 deg; the centre's image is off
    by a pixel there.
    """
    rng, layout, views = np.random.default_rng(0), layout_of(handle, P), views_of(RIG)
    for _ in range(10):
        T = random_pose(rng)
        predicted = predict(batch(T), views, layout)
        for c, camera in enumerate(RIG.cameras):
            slant = np.rad2deg(slants(handle, T, camera.centre))
            facing = np.rad2deg(np.arccos(predicted.facing[0, c]))
            np.testing.assert_allclose(facing, slant, atol=1e-6)
            uv, _, index = seen_by(camera, T, handle, rng, noise_px=0.0, limit_deg=90.0)
            off = np.linalg.norm(predicted.uv[0, c][:, index].T - uv, axis=1)
            assert (off < np.where(slant[index] < 75, 0.1, 0.25)).all()


def test_explained_by_hand():
    """A camera that finds all but one facing marker, a px or 2 off, and one thing that is none."""
    T, layout, views = random_pose(np.random.default_rng(3)), layout_of(CODED, P), views_of(RIG)
    exact = predict(batch(T), views, layout)
    index = [
        np.flatnonzero(facing > np.cos(np.deg2rad(P.certain_deg))) for facing in exact.facing[0]
    ]
    found = [exact.uv[0, c][:, k].T for c, k in enumerate(index)]
    found[0] = np.vstack([found[0][1:] + [0.6, 0.8], [[30.0, 30.0]]])
    e = explain(batch(T), Observed(views, layout, ideal_pixels(RIG, found)), 4.0, P)
    n = len(index[0]) - 1
    assert e.labels[0, 0, : n + 1].tolist() == [*index[0][1:], -1]
    assert e.outliers[0].tolist() == [1, 0, 0]
    assert e.missing[0, 0] == pytest.approx(1.0 + missed_by_slant(exact.facing[0, 0], index[0]))
    lacking = [
        min(m, len(k)) for m, k in zip(e.missing[0], (index[0][1:], *index[1:]), strict=True)
    ]
    assert e.cost[0] == pytest.approx(n * 1.0 + 16.0 * (1 + sum(lacking)), abs=1e-6)
    assert e.squares[0, 0].sum() == pytest.approx(n, abs=1e-9)


def missed_by_slant(facing, found):
    """What markers between 55 and 75 deg count that were not among the found ones."""
    low, high = np.cos(np.deg2rad([75.0, 55.0]))
    part = np.clip((facing - low) / (high - low), 0, 1)
    return np.delete(part, found).sum()


def test_a_covered_camera_lacks_nothing_and_one_at_the_edge_expects_nothing():
    T, layout = random_pose(np.random.default_rng(3)), layout_of(CODED, P)
    small = Rig(tuple(replace(camera, size=(200, 200)) for camera in RIG.cameras))
    nothing = [np.empty((0, 2))] * 3
    e = explain(batch(T), Observed(views_of(RIG), layout, ideal_pixels(RIG, nothing)), 4.0, P)
    assert (e.missing > 0).any()
    assert e.cost[0] == 0.0
    outside = explain(
        batch(T), Observed(views_of(small), layout, ideal_pixels(small, nothing)), 4.0, P
    )
    assert (outside.missing == 0).all()


def test_a_marker_on_the_far_side_explains_nothing():
    T = random_pose(np.random.default_rng(6))
    away = np.flatnonzero(slants(CODED, T, RIG.cameras[0].centre) > np.deg2rad(105))
    found = (RIG.cameras[0].project(T.apply(CODED.marker_centres[away])), *[np.empty((0, 2))] * 2)
    e = explain(
        batch(T), Observed(views_of(RIG), layout_of(CODED, P), ideal_pixels(RIG, found)), 0.5, P
    )
    assert (e.labels == -1).all()


@pytest.mark.parametrize("rig", [RIG, BENT], ids=["straight", "bent"])
def test_the_fit_ends_at_the_pose(rig):
    """Exact predictions of a pose lead back to it from 3 deg and 2 mm away; distortion is taken off
    before.
    """
    rng, layout, views = np.random.default_rng(1), layout_of(CODED, P), views_of(rig)
    for _ in range(5):
        T = random_pose(rng)
        exact = predict(batch(T), views, layout)
        seen = [facing > 0.3 for facing in exact.facing[0]]
        found = [
            camera.to_pixels((uv[:, k].T - camera.principal_point) / camera.focal)
            for camera, uv, k in zip(rig.cameras, exact.uv[0], seen, strict=True)
        ]
        observed = Observed(views, layout, ideal_pixels(rig, found))
        start = batch(T * motion([1.0, 1, 1], [0.03, -0.02, 0.04]), T)
        labels = np.repeat(explain(batch(T), observed, 1.0, P).labels, 2, axis=0)
        end = fit(start, labels, observed, P, steps=8)
        # mm
        np.testing.assert_allclose(end.translations, np.tile(T.translation, (2, 1)), atol=1e-4)
        np.testing.assert_allclose(
            end.rotations, np.tile(T.rotation.as_matrix(), (2, 1, 1)), atol=1e-5
        )


def test_slopes_are_those_of_finite_differences():
    """Of the points whose images the centroids are; that these wander on the marker is left to the
    next step.
    """
    T, layout, views = random_pose(np.random.default_rng(2)), layout_of(CODED, P), views_of(RIG)
    points = predict(batch(T), views, layout).points
    slope = slopes(batch(T), points, views)[0]
    for camera, X, of_camera in zip(RIG.cameras, points[0], slope, strict=True):
        body = T.inv().apply(camera.T_world_cam.apply(X.T))
        for k, step in enumerate(1e-4 * np.eye(6)):
            ends = [camera.project(shifted(T, sign * step).apply(body)) for sign in (1, -1)]
            np.testing.assert_allclose(of_camera[..., k], np.subtract(*ends) / 2e-4, atol=1e-4)


def test_depth_sigma_is_that_of_many_draws():
    rng, views, point = np.random.default_rng(5), views_of(RIG), np.array([[20.0, -10, 560]])
    exact = [camera.project(point) for camera in RIG.cameras]
    p, layout = IdentityParameters(sigma_px=0.2, gate_px=10.0), layout_of(CODED, P)
    seen = [
        ideal_pixels(RIG, [uv + rng.normal(0, 0.2, (1, 2)) for uv in exact]) for _ in range(400)
    ]
    drawn = [candidate_points(Observed(views, layout, uv, pairs=[(0, 1)]), 0, p) for uv in seen]
    scatter = np.std([(c.points - point) @ c.rays[0] for c in drawn])
    # 400 draws: 3.5 %, and the mean ray
    assert scatter == pytest.approx(drawn[0].ahead[0], rel=0.15)


def test_three_markers_nearly_on_a_line_are_no_triplet():
    """They span 0.044 and 0.055 of the square of the radius; the limit is 0.05."""
    for apart_deg, some in ((26.0, False), (28.0, True)):
        columns = (0.0, apart_deg, 2 * apart_deg)
        handle = Handle("arc", 5.0, 100.0, 50.0, 1.0, columns, ((0.0,),) * 3)
        assert layout_of(handle, P).triplets.any() == some


def test_among_the_depths_of_three_points_are_the_true_ones():
    rng, triplets = np.random.default_rng(7), np.argwhere(layout_of(CODED, P).triplets)
    for _ in range(60):
        triangle = CODED.marker_centres[rng.choice(triplets)]
        X = RIG.cameras[0].T_cam_world.apply(random_pose(rng).apply(triangle))
        true = np.linalg.norm(X, axis=1)
        sides = np.linalg.norm(triangle - np.roll(triangle, -1, axis=0), axis=1)
        depths = three_point_depths(X / true[:, None], sides[None])
        assert np.nanmin(np.abs(depths - true).max(axis=1)) < 1e-6  # mm


def test_three_points_that_cannot_be():
    rays = np.array([[0.0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    assert np.isnan(three_point_depths(rays, [[1.0, 1.0, 5.0]])).all()  # no triangle
    assert three_point_depths(rays, np.empty((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match="rays"):
        three_point_depths(rays[:2], [[1.0, 1, 1]])
    with pytest.raises(ValueError, match="sides"):
        three_point_depths(rays, [[1.0, np.nan, 1]])
