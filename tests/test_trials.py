"""The trials: what counts as close, as a wrong match, as saved; the trials themselves run small."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle, load_rig
from trinolab.handle import slants
from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose
from trinolab.studies import claim_trials
from trinolab.studies.replication import shared_poses

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
    poses = [
        T,
        shifted(0.9, 4.9),
        shifted(1.1, 0.0),
        shifted(0.0, 5.1),
        None,
        T * PAPER.symmetries[2],
    ]
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


def test_a_few_instants_of_the_trials_themselves():
    instants = claim_trials.random_instants(count=3, seed=5)
    assert (
        claim_trials.share_close(instants.measurements, instants.truths, PAPER, equivalents=True)
        == 1.0
    )
    assert len(instants.frames) == 3
    clip = claim_trials.tracked_clip(1.0, count=4, seed=5)
    assert claim_trials.share_close(clip.measurements, clip.truths, PAPER, equivalents=False) == 1.0
    assert min(clip.seconds) > 0
    assert len(clip.searched) == 6  # the first instant predicts nothing
    assert all(0 < share <= 1 for share in clip.searched)
    assert claim_trials.share_saved_by_the_third(count=1, seed=5) in (0.0, 1.0)


def test_the_hidden_pair_alone_measures_nothing():
    """What the third camera is given credit for: the same frames without it."""
    from trinolab.bench.hand import Arm
    from trinolab.bench.optics import Bench
    from trinolab.bench.scene import render_rig
    from trinolab.measurement import measure

    rig = load_rig("paper_pair")
    rng = np.random.default_rng(0)
    arm = Arm(hides_from=tuple(float(c) for c in rig.cameras[0].centre))
    drawn = next(shared_poses(load_rig("raised_40deg"), PAPER, rng, arm))
    frames = render_rig(rig, PAPER, drawn, Bench(), rng, arm)
    assert measure(frames, rig, PAPER).pose.status == "lost"


@pytest.mark.parametrize("share", [claim_trials.share_measured, claim_trials.share_tracked])
def test_every_trial_is_a_share_of_known_instants(share, monkeypatch):
    both = [measured(T), measured(None)]
    monkeypatch.setattr(
        claim_trials, "random_instants", lambda: claim_trials.Instants([], [T, T], both)
    )
    monkeypatch.setattr(
        claim_trials, "tracked_clip", lambda: claim_trials.Clip([T, T], both, [], [])
    )
    assert share() == 0.5
