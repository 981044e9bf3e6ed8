"""The compiled loops against the image model in NumPy, and with bounds checked."""

import os
import subprocess
import sys

import imagemodel_reference as reference
import numpy as np
import pytest
from scenes import bent

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators import imagemodel, loops, movingmodel, rows
from trinolab.estimators.patches import moving_patches, patches

HANDLE = load_handle("coded")
PLAIN = load_rig("raised_40deg")
BENT = bent(PLAIN, -0.25, 0.1, 1e-3, -1e-3, 0.0)
T = random_pose(np.random.default_rng(1))
MOTION = np.array([2.4, -1.2, 0.8, 0.004, -0.003, 0.002])  # 14 px
BLUR = imagemodel.MotionBlur(MOTION, MOTION, np.eye(6))


@pytest.fixture(scope="module")
def images():
    bench = Bench(supersampling=2, marker_supersampling=4)
    return render_rig(PLAIN, HANDLE, T, bench, np.random.default_rng(0))


NAMES = ("greys", "by_pose", "predicted", "residual", "weight", "by_greys")


def rows_of(at):
    """The reference's model in the rows of `loops`."""
    return {name: getattr(at, name) for name in (*NAMES, "marker", "body", "by_gloss")}


def ours(at):
    return {name: getattr(at, name) for name in NAMES} | {
        "marker": at.rows[:, rows.MARKER],
        "body": at.rows[:, rows.BODY],
        "by_gloss": at.rows[:, rows.GLOSS : rows.GLOSS + 3],
    }


def check_same(found, expected, share):
    """Equal but for a share of the largest entry: the polynomial arctangent is right to 4e-9 rad."""
    for name, values in expected.items():
        atol = share * max(np.abs(values).max(), 1e-9)
        np.testing.assert_allclose(found[name], values, rtol=0, atol=atol, err_msg=name)


def check_steps(at, expected, by_other, share):
    """Normal equations, a step and the noise that it leaves."""
    normal = imagemodel.reduce(at, at.unknowns)
    by_reference = reference.reduce(by_other, expected)
    check_same(normal._asdict(), by_reference._asdict(), share)
    step = 1e-3 * np.random.default_rng(2).normal(size=by_reference.gradient.shape)
    after = imagemodel.advanced(at, normal, step)
    then = reference.advanced(expected, by_other, by_reference, step)
    check_same(ours(after), rows_of(then), share)
    np.testing.assert_allclose(imagemodel.misfit(after), reference.misfit(then), rtol=1e-5)
    used = np.arange(len(step)) % 4 > 0
    noise = imagemodel.noise_of(after, 1, used)
    seen = then._replace(weight=then.weight * used[:, None])
    np.testing.assert_allclose(noise, reference.noise_of(seen, 1), rtol=1e-5)


@pytest.mark.parametrize("rig", [PLAIN, BENT], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("known", [False, True], ids=["first", "glossy"])
def test_a_still_handle(images, rig, known):
    here = patches(images, rig, HANDLE, T, 70.0)
    state = imagemodel.first_state(T, rig)
    if known:
        greys = np.tile([130.0, 90.0, 0.1, -0.2, 0.05, 3.0, -2.0, 4.0, 45.0], (len(here.grey), 1))
        state = state._replace(greys=greys, blur_px2=np.array([0.3, 0.64, 1.7]))
    at = imagemodel.linearise(state, here, rig, HANDLE)
    expected = reference.linearise(state, here, rig, HANDLE)
    assert (expected.weight > 0).mean() > 0.2
    check_same(ours(at), rows_of(expected), 1e-6)
    check_steps(at, expected, expected.by_pose, 1e-6)


@pytest.mark.parametrize("most_cells", [5_000, 18_000])
@pytest.mark.parametrize("length", [0.5, 3.0], ids=["short", "long"])
def test_a_moving_handle(images, most_cells, length):
    here = moving_patches(images, PLAIN, HANDLE, T, 70.0, length * MOTION, most_cells)
    blur = BLUR._replace(motion=length * MOTION)
    state = imagemodel.first_state(T, PLAIN, blur)
    at = movingmodel.linearise_moving(state, here, PLAIN, HANDLE)
    expected = reference.linearise_moving(state, here, PLAIN, HANDLE)
    check_same(ours(at), rows_of(expected), 1e-6)
    check_steps(at, expected, expected.by_pose, 1e-6)


def test_the_arctangent():
    angles = np.linspace(-np.pi, np.pi, 10_001)[1:-1]
    found = [loops.angle.py_func(np.sin(a), np.cos(a)) for a in angles]
    assert np.abs(found - angles).max() < 5e-9


@pytest.mark.heavy
def test_no_index_is_out_of_bounds(tmp_path):
    """Compiled anew with bounds checked."""
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not heavy"]
    subprocess.run([*command, __file__], env=environment, check=True)
