"""Why the handle is lost: causes that are made on purpose, and that nothing is said of a good track."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scenes import close_up, pose
from scipy.spatial.transform import RigidTransform

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.following.losses import likely_cause, lost_lines

CODED, PAPER = load_handle("coded"), load_handle("paper")
PLACE = np.array([0.0, 5.0, 560.0])
EMPTY = 3


RIG = close_up(load_rig("paper_pair"), PLACE)


@pytest.fixture(scope="module")
def instants():
    """Three instants of the coded handle, and three without one."""
    rng = np.random.default_rng(0)
    shown = [pose(PLACE + [4.0 * k, 0, 10.0 * k], [170.0, 15.0, 40.0 + 50 * k]) for k in range(3)]
    return [render_rig(RIG, CODED, T, Bench(), rng) for T in [None] * EMPTY + shown]


def test_another_shipped_handle_is_named(instants):
    said = likely_cause(instants, RIG, PAPER)
    assert said.startswith("of 6 looked at 3 show markers, those of the shipped handle coded: ")
    assert "by itself each gives a pose" in likely_cause(instants, RIG, CODED)


@pytest.mark.slow
def test_exchanged_cameras_are_named(instants):
    exchanged = [images[::-1] for images in instants]
    said = likely_cause(exchanged, RIG, CODED)
    assert "which fit if ccd1 and ccd2 are exchanged: likely the cameras are" in said


@pytest.mark.slow
def test_a_camera_that_was_moved_is_suspected(instants):
    """CCD2 has sunk by half a millimetre, 3 px, and the rig's file says that it is exact."""
    first, second = RIG.cameras
    sunk = RigidTransform.from_translation([0.0, 0.55, 0.0]) * second.T_cam_world
    rig = replace(RIG, cameras=(first, replace(second, T_cam_world=sunk)))
    said = likely_cause(instants, replace(rig, covariance=RigCovariance.exact(rig.names)), CODED)
    assert "which fit a rig that is less well known than its file says" in said
    assert "likely a camera was moved, or" in said


@pytest.mark.slow
def test_markers_that_nothing_explains(instants):
    moved = replace(CODED, columns_deg=tuple(40.0 * k for k in range(len(CODED.columns_deg))))
    turned = [[np.rot90(images[0]).copy(), images[1]] for images in instants]
    said = likely_cause(turned, RIG, replace(moved, name="other"))
    assert "but no pose of other explains them: likely the file of the handle, or" in said


def test_an_empty_bench_darkness_and_dark_markers(instants):
    assert "likely the handle is out of the picture" in likely_cause(instants[:EMPTY], RIG, CODED)
    dark = [[(image // 10).astype(np.uint8) for image in images] for images in instants]
    assert "likely too little light" in likely_cause(dark, RIG, CODED)
    inverted = [[255 - image for image in images] for images in instants]
    said = likely_cause(inverted[EMPTY:], RIG, CODED)
    assert said == "the markers are dark, the handle's file says bright"


def test_only_most_instants_without_a_pose_are_worth_a_line(instants):
    asked = []

    def images_of(rows):
        asked.extend(rows)
        return (instants[row] for row in rows)

    few = pd.DataFrame({"status": ["lost"] * 3 + ["measured"] * 3})
    assert lost_lines(few, RIG, PAPER, images_of) == []
    assert asked == []
    most = pd.DataFrame({"status": ["lost"] * 4 + ["predicted", "ambiguous"]})
    (line,) = lost_lines(most, RIG, PAPER, images_of)
    assert asked == [0, 1, 2, 3, 4]
    assert line.startswith("5 of 6 instants have no measured pose; of 5 looked at 2 show markers")
