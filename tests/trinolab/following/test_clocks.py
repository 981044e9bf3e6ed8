"""What late cameras do to a track: against a fit of the pixels, and to its table."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform

from trinolab.camera import RigCovariance
from trinolab.datasets import load_rig
from trinolab.files.poses import POSE_COLUMNS
from trinolab.following.clocks import late_lines, shifts_mm, widened
from trinolab.following.sync import Offsets

PAIR, RAISED = load_rig("paper_pair"), load_rig("raised_40deg")


@pytest.mark.parametrize(("rig", "late_s"), [(PAIR, (0, 0.005)), (RAISED, (0, 0.005, -0.003))])
def test_a_point_that_late_cameras_see_is_measured_beside_its_place(rig, late_s):
    rng = np.random.default_rng(2)
    places = rng.uniform([-60, -40, 530], [60, 40, 600], (12, 3))
    velocities = 200 * rng.standard_normal((12, 3))
    expected = []
    for place, velocity in zip(places, velocities, strict=True):
        uv = [
            camera.project((place + late * velocity)[None])[0]
            for camera, late in zip(rig.cameras, late_s, strict=True)
        ]

        def residuals(X, uv=uv):
            return np.concatenate(
                [c.project(X[None])[0] - seen for c, seen in zip(rig.cameras, uv, strict=True)]
            )

        expected.append(least_squares(residuals, place, xtol=1e-12).x - place)
    found = shifts_mm(places, velocities, np.array(late_s, float), rig)
    size = np.linalg.norm(expected, axis=1)
    assert size.max() > 2.0
    # the pixels' second derivatives: a hundredth of the distance is 5 mm
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.05 * size.max())


def track(speed_mm_s, count=5):
    """Along x, the baseline, at 30 instants a second."""
    table = pd.DataFrame({name: np.zeros(count) for name in POSE_COLUMNS})
    table["t_s"] = np.arange(count) / 30
    table["x_mm"] = speed_mm_s * table["t_s"]
    table["z_mm"] = 549.0
    return table.assign(sigma_mm=0.3, systematic_mm=0.0, sigma_deg=0.4, systematic_deg=0.3)


def late(ms, sigma_ms=0.1):
    return Offsets(np.array([0.0, ms / 1e3]), np.array([0.0, sigma_ms / 1e3]), (None, None))


def test_a_pair_takes_a_shift_along_its_baseline_for_a_distance():
    """Two equal cameras at an angle: what moves by d along the baseline, in the time that one is
    late, is d times distance by baseline off in depth.
    """
    table = widened(track(100.0), late(5.0), PAIR)
    a, b = (camera.centre for camera in PAIR.cameras)
    depth_mm = 0.5 * 549.0 / np.linalg.norm(a - b)
    np.testing.assert_allclose(table["systematic_mm"], depth_mm, rtol=0.1)
    np.testing.assert_allclose(table["sigma_mm"] ** 2, table["systematic_mm"] ** 2 + 0.09)
    stated = replace(PAIR, covariance=RigCovariance(PAIR.names, 1e-8 * np.eye(30)))
    pd.testing.assert_frame_equal(widened(track(100.0), late(5.0), stated), table)
    turn = np.rad2deg(2 * table["systematic_mm"] / 549.0)
    np.testing.assert_allclose(table["sigma_deg"] ** 2, turn**2 + 0.16, rtol=0.01)
    np.testing.assert_allclose(table["systematic_deg"] ** 2, turn**2 + 0.09, rtol=0.01)


def test_the_world_frame_does_not_matter():
    shift = RigidTransform.from_translation([100.0, 0.0, 0.0])
    cameras = [replace(one, T_cam_world=one.T_cam_world * shift.inv()) for one in PAIR.cameras]
    elsewhere = track(100.0).assign(x_mm=lambda table: table["x_mm"] + 100.0)
    found = widened(elsewhere, late(5.0), replace(PAIR, cameras=tuple(cameras)))
    expected = widened(track(100.0), late(5.0), PAIR)
    pd.testing.assert_frame_equal(found.drop(columns="x_mm"), expected.drop(columns="x_mm"))


@pytest.mark.parametrize(
    ("table", "offsets", "rig"),
    [
        (track(0.0), late(5.0), PAIR),
        (track(100.0), late(0.3), PAIR),  # below a millisecond nothing is said
        (track(100.0), late(5.0, sigma_ms=2.0), PAIR),
        (track(100.0, count=1), late(5.0), PAIR),
        (track(np.nan), late(5.0), PAIR),
        (track(100.0), late(5.0), replace(PAIR, covariance=None)),
    ],
    ids=["still", "in step", "not sure", "one instant", "no pose", "rig says nothing"],
)
def test_nothing_is_wider_without_motion_or_offset_or_where_sigma_has_it(table, offsets, rig):
    pd.testing.assert_frame_equal(widened(table, offsets, rig), table)


def test_a_line_names_the_camera_and_by_how_much():
    assert late_lines(late(0.5), PAIR) == []
    (line,) = late_lines(late(-5.04, 0.02), PAIR)
    assert line.startswith("ccd2: 5.0 ms (+- 0.1) earlier than ccd1; the cameras are not synch")
