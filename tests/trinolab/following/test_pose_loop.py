"""The compiled fit of one pose against that of many poses at once, and with bounds checked."""

import os
import subprocess
import sys

import numpy as np
import pytest

from trinolab.bench.motion import random_pose
from trinolab.datasets import load_handle, load_rig
from trinolab.following import pose_loop
from trinolab.identity.hypotheses import FAR, Observed, Poses, explain, fit, predict
from trinolab.identity.layout import layout_of, views_of
from trinolab.identity.parameters import IdentityParameters
from trinolab.rigid import rotation_of, shifted

P = IdentityParameters()
GATE_PX = 4 * P.gate_px


def by_hypotheses(R, t, views, layout, uv):
    """The same with the functions that search for poses."""
    markers = np.arange(uv.shape[2])
    observed = Observed(views, layout, uv)
    labels = np.where(uv[:, 0] < FAR, markers, -1)[None]
    poses = fit(Poses(R[None], t[None]), labels, observed, P, 2)
    explained = explain(poses, observed, GATE_PX, P)
    labels = np.where(explained.labels == markers, explained.labels, -1)
    poses = fit(poses, labels, observed, P, 1)
    return poses.rotations[0], poses.translations[0]


def compiled(R, t, views, layout, uv):
    return pose_loop.approach(
        R,
        t,
        (views.rotations, views.translations, views.focal, views.principal),
        (layout.centres, layout.normals, layout.tangents, layout.slants, layout.shift),
        np.array([np.cos(np.deg2rad(P.steep_deg)), layout.limb, GATE_PX]),
        uv,
        uv[:, 0] < FAR,
    )


@pytest.mark.parametrize("rig_name", ["paper_pair", "raised_40deg"])
@pytest.mark.parametrize("handle_name", ["paper", "coded"])
def test_the_same_pose(rig_name, handle_name):
    views = views_of(load_rig(rig_name))
    layout = layout_of(load_handle(handle_name), P)
    rng = np.random.default_rng(0)
    for k in range(22):
        T = random_pose(rng)
        start = shifted(T, rng.normal(0, [1.0] * 3 + [0.02] * 3))
        poses = Poses(rotation_of(T)[None], T.translation[None])
        predicted = predict(poses, views, layout)
        uv = predicted.uv[0] + rng.normal(0, 0.3, predicted.uv[0].shape)
        far_off = rng.random(uv[:, 0].shape) < 0.1
        uv += np.where(far_off[:, None], rng.normal(0, 30, uv.shape), 0.0)
        facing = predicted.facing[0] > 0.3
        hidden = ~facing | (rng.random(facing.shape) < 0.1 * (k % 11))  # none at all in some
        uv = np.where(hidden[:, None], FAR, uv)
        R, t = rotation_of(start).copy(), start.translation
        for found, expected in zip(
            compiled(R, t, views, layout, uv), by_hypotheses(R, t, views, layout, uv), strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


def test_what_shows_nothing_changes_nothing():
    """A pose behind the cameras and no marker; and no number gives no number."""
    views = views_of(load_rig("paper_pair"))
    layout = layout_of(load_handle("coded"), P)
    uv = np.full((len(views.focal), 2, len(layout.centres)), FAR)
    R, t = compiled(np.eye(3), np.array([0.0, 0.0, -500.0]), views, layout, uv)
    np.testing.assert_array_equal(R, np.eye(3))
    np.testing.assert_array_equal(t, [0.0, 0.0, -500.0])
    R, _ = compiled(np.full((3, 3), np.nan), np.zeros(3), views, layout, 0 * uv)
    assert np.isnan(R).all()


@pytest.mark.heavy
def test_no_index_is_out_of_bounds(tmp_path):
    """Compiled anew with bounds checked."""
    environment = {
        **os.environ,
        "NUMBA_BOUNDSCHECK": "1",
        "NUMBA_CACHE_DIR": str(tmp_path),
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not heavy"]
    subprocess.run([*command, __file__], env=environment, check=True)
