"""The webcams' study: where they stand, where the rod is held, and what a row counts."""

import numpy as np
import pytest
import webcams
from scipy.spatial.transform import RigidTransform
from webcams import WEBCAMS, rod_poses, webcam_rig

from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose

RIG = webcam_rig(WEBCAMS[1])
PLACE = RIG.cameras[0].T_world_cam.apply([[0.0, 0.0, np.hypot(500.0, 100.0)]])[0]


# --- the scene


@pytest.mark.parametrize("webcam", WEBCAMS, ids=lambda webcam: f"{webcam.size[0]} px")
def test_all_webcams_have_the_place_of_the_rod_in_the_middle_of_their_image(webcam):
    for camera in webcam_rig(webcam).cameras:
        middle = (np.array(webcam.size) - 1) / 2
        np.testing.assert_allclose(camera.project(PLACE[None])[0], middle, atol=1e-6)


@pytest.mark.parametrize("baseline_mm", [100.0, 200.0])
def test_webcams_stand_as_far_apart_as_they_say_and_the_third_40_deg_above(baseline_mm):
    first, second, third = (c.centre for c in webcam_rig(WEBCAMS[0], baseline_mm).cameras)
    place = np.array([0.0, 0.0, np.hypot(500.0, baseline_mm / 2)])  # in the first one's frame
    assert np.linalg.norm(second - first) == pytest.approx(baseline_mm)
    to_pair, to_third = (first + second) / 2 - place, third - place
    assert np.linalg.norm(to_pair) == pytest.approx(500.0)
    assert np.linalg.norm(to_third) == pytest.approx(500.0)
    assert np.rad2deg(np.arccos(to_pair @ to_third / 500.0**2)) == pytest.approx(40.0)
    assert to_third[1] < 0  # y points down


def test_rods_are_held_around_the_place():
    off = rod_poses(RIG).translation - PLACE
    assert len(off) == webcams.POSES
    # the box of the draw, turned by the first webcam's direction: its half diagonal
    assert np.linalg.norm(off, axis=1).max() < np.linalg.norm([60.0, 45.0, 50.0])
    assert np.abs(off.mean(axis=0)).max() < 15.0
    assert (off.std(axis=0) > 20.0).all()


# --- a row


@pytest.fixture
def cell(monkeypatch):
    """The rows of a webcam and rod whose poses are measured off by so many mm, or are lost."""

    def of(*off_mm):
        poses = rod_poses(RIG, len(off_mm))
        monkeypatch.setattr(webcams, "rod_poses", lambda rig: poses)
        monkeypatch.setattr(webcams, "render_rig", lambda rig, handle, T, *_: T)
        shifts = {tuple(T.translation): mm for T, mm in zip(poses, off_mm, strict=True)}

        def measure(T, rig, handle, parameters):
            mm = shifts[tuple(T.translation)]
            if mm is None or parameters.estimator == "patches":
                return Measurement(LOST, (), ())
            found = RigidTransform.from_translation([0.0, 0.6 * mm, 0.8 * mm]) * T
            return Measurement(Pose("ambiguous", found, np.eye(6), 0.1, 4, 2), (), ())

        monkeypatch.setattr(webcams, "measure", measure)
        return webcams.cell(0, 2)

    return of


def test_a_wrong_pose_is_counted_and_is_in_no_mean(cell):
    row, _ = cell(1.0, 2.0, 2.9, 3.1, None)
    assert (row["estimator"], row["n"]) == ("paper, checked", 5)
    assert (row["measured"], row["wrong"]) == (0.8, 1)
    assert row["measured_low"] < 0.8 < row["measured_high"] < 1
    assert row["E_t_mm"] == pytest.approx(5.9 / 3)
    assert 1.0 <= row["E_t_mm_low"] < row["E_t_mm"] < row["E_t_mm_high"] <= 2.9 + 1e-9
    assert row["geodesic_deg"] == pytest.approx(0.0, abs=1e-5)
    assert row["marker_px"] == 600.0 * 5.0 / 500.0
