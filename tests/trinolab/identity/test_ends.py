"""The visible end of the body, on rendered frames: it decides rightly, or not at all."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import pose

from trinolab.bench.hand import Arm
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.identity import equivalents
from trinolab.identity.ends import keep_by_body
from trinolab.measurement import measure
from trinolab.parameters import Parameters

RIG, PAPER = load_rig("paper_pair"), load_handle("paper")
T = pose([15.0, -10.0, 560.0], [70, 20, 10])


@cache
def usual_frames():
    return render_rig(RIG, PAPER, T, Bench(), np.random.default_rng(0))


def right_way(poses):
    """Whether the free end points as it does in T."""
    return [bool((T.inv() * pose).rotation.as_matrix()[1, 1] > 0) for pose in poses]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bench", "arm", "markers"),
    [
        (Bench(), None, "bright"),
        (Bench(), None, "dark"),
        (Bench(), Arm(palm_deg=120.0), "bright"),
    ],
    ids=["usual", "dark markers", "held"],
)
def test_the_free_end_halves_the_choice(bench, arm, markers):
    handle = replace(PAPER, markers=markers)
    frames = render_rig(RIG, handle, T, bench, np.random.default_rng(0), arm)
    for order in (slice(None), slice(None, None, -1)):  # the first pose may be the wrong one
        poses = equivalents(T, handle)[order]
        assert keep_by_body(frames, RIG, handle, poses).tolist() == right_way(poses)


def test_a_body_that_does_not_stand_out_decides_nothing():
    bench = Bench(background_grey=70.0, texture_contrast=0.4)
    frames = render_rig(RIG, PAPER, T, bench, np.random.default_rng(0))
    assert keep_by_body(frames, RIG, PAPER, equivalents(T, PAPER)).all()


@pytest.mark.slow
def test_what_is_hidden_or_outside_or_the_same_either_way_decides_nothing():
    rng = np.random.default_rng(0)
    held = render_rig(RIG, PAPER, T, Bench(), rng, Arm(grip_mm=(-100.0, -20.0)))
    assert keep_by_body(held, RIG, PAPER, equivalents(T, PAPER)).all()
    middle = replace(PAPER, top_mm=100.0)
    frames = usual_frames()
    assert keep_by_body(frames, RIG, middle, equivalents(T, middle)).all()
    aside = pose([600.0, 0, 0]) * T
    assert keep_by_body(frames, RIG, PAPER, equivalents(aside, PAPER)).all()
    assert keep_by_body(frames, RIG, PAPER, [T]).tolist() == [True]
    # the cameras contradict each other
    turned = next(E for E in equivalents(T, PAPER) if right_way([E]) == [False])
    other = render_rig(RIG, PAPER, turned, Bench(), rng)
    assert keep_by_body([frames[0], other[1]], RIG, PAPER, equivalents(T, PAPER)).all()
    # poses on other axes are left alone
    away = pose([0, 0, 40.0]) * T
    poses = [*equivalents(T, PAPER), away]
    assert keep_by_body(frames, RIG, PAPER, poses).tolist() == [*right_way(poses[:12]), True]


def test_a_layout_with_that_symmetry_alone_is_measured():
    """Markers that look alike end for end, and in no other way: the body decides, without a
    prior.
    """
    handle = replace(
        PAPER, columns_deg=(60.0, 130.0, 180.0, 230.0, 300.0), rows_mm=((10.0, -10.0),) * 5
    )
    assert len(handle.symmetries) == 2
    images = render_rig(RIG, handle, T, Bench(), np.random.default_rng(0))
    found = measure(images, RIG, handle, parameters=Parameters(estimator="paper")).pose
    assert found.status == "measured"
    assert np.rad2deg((found.T_world_handle.inv() * T).rotation.magnitude()) < 5.0
