"""What a calibration that is off costs: drawn rigs, patterns, the shipped table, and its theory."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from calibration_error import DRAWS, ERRORS, PLACES, SEED, drawn_rig, results
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1
from trinolab.handle import slants
from trinolab.measurement import Measurement
from trinolab.methods import BEST
from trinolab.pose import LOST, Pose
from trinolab.rigid import cross_matrices
from workbench.plotting.calibration import plot_calibration_error
from workbench.studies.calibration_error import (
    CENTRE_PX,
    DIRECTIONS,
    RIGS,
    SETTINGS,
    TURN_DEG,
    curve,
    level_at,
    pattern,
)

PAIR, RAISED = (load_rig(name) for name in RIGS)
HANDLE, TRUTHS = load_handle("paper"), load_table1().set_poses
TABLE = load_sweep("calibration_error")


def shipped(rig, estimator):
    return curve(TABLE, rig, estimator).set_index("level", drop=False)


# --- the drawn rigs


def shifts(true, believed):
    """Of each camera: principal point (px), turn in its own frame (rad), place (mm), shape (cameras,
    8).
    """
    return np.array(
        [
            [
                *(b.principal_point - a.principal_point),
                *(b.T_cam_world.rotation * a.T_cam_world.rotation.inv()).as_rotvec(),
                *(b.centre - a.centre),
            ]
            for a, b in zip(true.cameras, believed.cameras, strict=True)
        ]
    )


@pytest.mark.parametrize(
    ("changed", "sizes"),
    [
        (DIRECTIONS, np.repeat([[0.1, np.deg2rad(0.005), 0]] * 3, [2, 3, 3], axis=1)),
        (PLACES, np.repeat([[0, 0, 0], [0, 0, 0.02], [0, 0, 0.02]], [2, 3, 3], axis=1)),
    ],
)
def test_rigs_are_off_by_what_the_level_says(changed, sizes):
    off = np.array([shifts(RAISED, drawn_rig(RAISED, changed, 2.0, k)) for k in range(300)])
    # 300 draws know a standard deviation to 4 %, and a correlation to 0.058
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=0)), 2 * sizes, rtol=0.16, atol=1e-9)
    correlation = np.corrcoef(off[:, sizes > 0].T) - np.eye(np.count_nonzero(sizes))
    assert np.abs(correlation).max() < 0.25


def test_a_level_scales_a_draw_and_nothing_else_changes():
    once, twice = (shifts(RAISED, drawn_rig(RAISED, DIRECTIONS, s, 7)) for s in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2 * once, atol=1e-9)
    for a, b in zip(RAISED.cameras, drawn_rig(RAISED, DIRECTIONS, 3.0, 7).cameras, strict=True):
        assert (a.focal == b.focal).all()
        assert (a.name, a.size) == (b.name, b.size)


def test_cameras_that_two_rigs_share_are_off_by_the_same():
    two = shifts(PAIR, drawn_rig(PAIR, DIRECTIONS, 1.0, 3))
    three = shifts(RAISED, drawn_rig(RAISED, DIRECTIONS, 1.0, 3))
    np.testing.assert_allclose(two, three[:2], atol=1e-9)


# --- the pattern of errors


def test_a_shift_and_a_stretch_are_told_apart():
    x = TRUTHS.translation
    stretch = (x - x.mean(axis=0)) @ np.diag([0.001, 0.0, -0.002])
    assert pattern(x, stretch + 1e-9) == pytest.approx((0.0, 1.0), abs=1e-6)
    both = pattern(x, stretch + [0.3, 0.0, 0.0])
    assert both.common_share == pytest.approx(0.09 / (0.09 + (stretch**2).sum() / 20))
    assert both.smooth_share == pytest.approx(1.0)


def test_independent_errors_have_the_shares_that_counting_gives():
    """One of 20 numbers is the mean; three of the other 19 are slopes."""
    rng = np.random.default_rng(0)
    x = TRUTHS.translation
    found = np.array([pattern(x, rng.standard_normal((20, 3))) for _ in range(500)])
    expected = np.array([1 / 20, 3 / 19])
    assert np.abs(found.mean(axis=0) - expected).max() < 4 * found.std(axis=0).max() / np.sqrt(500)


def test_table_1_has_the_pattern_of_independent_errors():
    table = load_table1()
    errors = table.measured.translation - table.set_poses.translation
    assert pattern(table.set_poses.translation, errors) == pytest.approx((0.043, 0.153), abs=5e-4)


# --- what a draw and a level give


def measured(shift_mm, lost=0, wrong=0):
    """Measurements that are all off by a shift; the first are lost, the last 20 mm off."""
    poses = [
        Pose("measured", RigidTransform.from_translation(shift_mm) * T, np.eye(6), 0.0, 6, 2)
        for T in TRUTHS
    ]
    for k in range(20 - wrong, 20):
        moved = RigidTransform.from_translation([20, 0, 0]) * TRUTHS[k]
        poses[k] = Pose("measured", moved, np.eye(6), 0.0, 6, 2)
    return [Measurement(LOST if k < lost else pose, (), ()) for k, pose in enumerate(poses)]


def test_results_of_poses_that_are_all_shifted():
    found = results(measured([0, 0, 0.5], lost=4), HANDLE)
    assert found["E_t_mm"] == pytest.approx(0.5)
    assert found["registered_mm"] == pytest.approx(0.0, abs=1e-9)
    assert found["geodesic_deg"] == pytest.approx(0.0, abs=1e-5)
    assert found["common_share"] == pytest.approx(1.0)
    assert (found["measured"], found["off"]) == (0.8, 0.0)


def test_a_rig_that_measures_little_has_shares_and_no_errors():
    found = results(measured([0, 0, 0.5], lost=11, wrong=2), HANDLE)
    assert (found["measured"], found["off"]) == (0.45, 0.1)
    assert np.isnan([found[name] for name in ERRORS]).all()
    nothing = results(measured([0, 0, 0.5], lost=20), HANDLE)
    assert (nothing["measured"], nothing["off"]) == (0.0, 0.0)
    assert nothing.keys() == found.keys()


def test_the_level_at_a_limit_lies_on_the_power_law_between():
    levels = [0.0, 0.1, 1.0, 10.0, 20.0]
    error = [0.001, 0.01, 0.1, np.nan, 1.0]
    rows = pd.DataFrame({"level": levels, "E_t_mm": error, "E_t_mm_high": error})
    rows["E_t_mm_low"] = rows["E_t_mm"] / 2
    level, low, high = level_at(rows, 0.04)
    assert (level, low, high) == pytest.approx((0.4, 0.4, 0.8))
    assert np.isnan(level_at(rows, 0.5)).all()  # a gap is no crossing
    assert np.isnan(level_at(rows, 0.001)).all()  # nor is what lies below the first draw


# --- the shipped table


def test_exact_rig_is_one_row_of_the_gallery():
    """Other frames of the same poses: the noise is drawn anew, with a read noise of 1 and of 2 in
    place of 1.5.
    """
    other = load_sweep("gallery/noise").query("read_noise in [1, 2]")
    for estimator in SETTINGS:
        here = shipped("paper_pair", estimator).loc[0.0, "E_t_mm"]
        assert here == pytest.approx(other[f"E_t_mm_{estimator}"].mean(), rel=0.15)


# --- the theory: a pinhole's slopes


def slopes(rig, T):
    """How `drawn_rig`'s numbers move a pose that makes the squared distances of the visible
    markers' pixels smallest, shape (6, cameras, 5): mm, rad, by units of level 1.

    Analytic: no function of the package projects, triangulates or fits here.
    """
    by_pose, by_rig = [], []
    points = T.apply(HANDLE.marker_centres)
    for k, camera in enumerate(rig.cameras):
        R = camera.T_cam_world.rotation.as_matrix()
        seen = points[slants(HANDLE, T, camera.centre) <= np.deg2rad(70)]
        x, y, z = camera.T_cam_world.apply(seen).T
        pinhole = np.zeros((len(seen), 2, 3))  # slopes of the pixels by the point, camera frame
        pinhole[:, 0, 0] = camera.matrix[0, 0] / z
        pinhole[:, 0, 2] = -camera.matrix[0, 0] * x / z**2
        pinhole[:, 1, 1] = camera.matrix[1, 1] / z
        pinhole[:, 1, 2] = -camera.matrix[1, 1] * y / z**2
        by_point = pinhole @ R  # world frame
        about = cross_matrices(seen - T.translation)
        by_pose.append(np.concatenate([by_point, -by_point @ about], axis=2))
        slope = np.zeros((len(seen), 2, len(rig.cameras), 5))
        slope[:, :, k, :2] = CENTRE_PX * np.eye(2)
        # a turn of the camera's frame moves the point in it
        slope[:, :, k, 2:] = -np.deg2rad(TURN_DEG) * (
            pinhole @ cross_matrices(np.column_stack([x, y, z]))
        )
        by_rig.append(slope)
    J = np.concatenate(by_pose).reshape(-1, 6)
    K = np.concatenate(by_rig).reshape(len(J), -1)
    return -(np.linalg.pinv(J) @ K).reshape(6, len(rig.cameras), 5)


def predicted(rig):
    """E_t in mm at level 1, over the table's draws."""
    z = np.array(
        [
            np.random.default_rng([SEED, k]).standard_normal((len(rig.cameras), 5))
            for k in range(DRAWS)
        ]
    )
    errors = np.einsum("nirc,drc->dni", [slopes(rig, T) for T in TRUTHS], z)
    return np.linalg.norm(errors[..., :3], axis=2).mean()


@pytest.mark.parametrize("level", [3.0, 5.0])
@pytest.mark.parametrize("rig", RIGS)
def test_measured_slope_is_that_of_the_pinhole(rig, level):
    """Where all points are moved together, geometry decides. The paper's method takes what it gets;
    its own error is small beside this.
    """
    row = shipped(rig, "paper").loc[level]
    assert row["E_t_mm"] / level == pytest.approx(predicted(load_rig(rig)), rel=0.05)


@pytest.mark.parametrize(("rig", "share"), [("paper_pair", 0.4), ("raised_40deg", 0.7)])
def test_a_pose_that_is_corrected_by_its_residuals_is_better_than_geometry_says(rig, share):
    row = shipped(rig, BEST).loc[1.0]
    assert row["E_t_mm_high"] < share * predicted(load_rig(rig))


# --- the figure


def test_figure_shows_the_table():
    figure = plot_calibration_error(TABLE, "paper", 0.31)
    position, turn, measured_share, off = figure.axes
    assert position.get_xscale() == position.get_yscale() == turn.get_yscale() == "log"
    rows = shipped("paper_pair", "paper")
    assert (position.lines[0].get_ydata() == rows["E_t_mm"]).all()
    assert (position.lines[0].get_xdata()[1:] == rows["centre_px"].iloc[1:]).all()
    last = shipped("raised_40deg", BEST)
    np.testing.assert_array_equal(measured_share.lines[3].get_ydata(), last["measured"])
    np.testing.assert_array_equal(off.lines[3].get_ydata(), last["off"])
    assert set(np.asarray(position.lines[-1].get_ydata())) == {0.31}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        *[f"{rig}, {estimator}" for rig in RIGS for estimator in SETTINGS],
        "0.31 mm",
    ]
    figure.canvas.draw()
    with pytest.raises(ValueError, match="handle: expected one of paper, coded, got 'rod'"):
        plot_calibration_error(TABLE, "rod", 0.31)
    plt.close(figure)
