"""What the trials count: what is close, which marker a spot is, how much of an image is searched."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle, load_rig
from trinolab.handle import slants
from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose
from trinolab.window import Window
from workbench.studies import claim_trials

PAPER = load_handle("paper")
T = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_euler("z", 85, degrees=True))


def measured(motion):
    pose = LOST if motion is None else Pose("measured", motion, np.eye(6), 0.1, 4, 2)
    return Measurement(pose, (), ())


def shifted(mm, deg):
    return T * RigidTransform.from_components(
        [mm, 0, 0], Rotation.from_rotvec([0, 0, np.deg2rad(deg)])
    )


def test_close_is_a_millimetre_and_five_degrees():
    off = [shifted(*by) for by in ((0.9, 4.9), (1.1, 0.0), (0.0, 5.1))]
    poses = [T, *off, None, T * PAPER.symmetries[2]]
    measurements = [measured(pose) for pose in poses]
    assert claim_trials.share_close(measurements, [T] * 6, PAPER, equivalents=False) == 2 / 6
    assert claim_trials.share_close(measurements, [T] * 6, PAPER, equivalents=True) == 3 / 6


def test_true_labels_by_hand():
    camera = load_rig("paper_pair").cameras[0]
    centres = camera.project(T.apply(PAPER.marker_centres))
    facing = int(slants(PAPER, T, camera.centre).argmin())
    away = int(slants(PAPER, T, camera.centre).argmax())
    labels = claim_trials.true_labels(
        camera, PAPER, T, np.array([centres[facing] + 1.0, [5.0, 5.0]])
    )
    assert labels.tolist() == [facing, -1]
    assert away not in claim_trials.true_labels(camera, PAPER, T, centres)


def test_a_window_that_leaves_out_a_marker_is_the_whole_image():
    camera = load_rig("paper_pair").cameras[0]
    whole = Window(0, 0, *camera.size)
    assert claim_trials.share_of_image(whole, camera, PAPER, T) == 1.0
    assert claim_trials.share_of_image(Window(0, 0, 9, 9), camera, PAPER, T) == 1.0
    assert claim_trials.share_of_image(None, camera, PAPER, T) == 1.0
    uv = camera.project(T.apply(PAPER.marker_centres))
    u, v = uv.min(axis=0).astype(int) - 2
    width, height = np.ptp(uv, axis=0).astype(int) + 5
    share = claim_trials.share_of_image(Window(u, v, width, height), camera, PAPER, T)
    assert share == pytest.approx(width * height / np.prod(camera.size))


# --- calibrations
