"""Figures show what they are given: each number is among the data of what is drawn, in its order."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from trinolab.calibration.target import Board
from trinolab.datasets import load_rig, load_table1
from trinolab.window import Window
from trinolab.workspace.cones import inside, paper_cones
from workbench.plotting.background import plot_pixel_histories
from workbench.plotting.basics import (
    mark_window,
    plot_with_intervals,
    show_image,
)
from workbench.plotting.calibration import plot_boards, plot_residuals
from workbench.plotting.estimators import plot_by_slant
from workbench.plotting.gallery import plot_factor
from workbench.plotting.kalman import plot_beliefs, plot_prediction
from workbench.plotting.markers import plot_rod_section
from workbench.plotting.matching import plot_epipolar_plane
from workbench.plotting.pose import plot_frames, plot_two_rays
from workbench.plotting.slave import plot_session
from workbench.plotting.structure import plot_rig
from workbench.plotting.table1 import (
    plot_budget,
    plot_errors_in_space,
    plot_pose_errors,
)
from workbench.plotting.wall import plot_limits, plot_nyquist
from workbench.plotting.workspace import show_cones_from_above


def drawn(figure):
    """The data of a figure's artists, axes by axes: bars, images, lines, and what stands in
    collections, arrows by their places and their lengths.
    """
    for ax in figure.axes:
        bars = [bar for bar in ax.patches if isinstance(bar, plt.Rectangle)]
        yield np.array([bar.get_height() for bar in bars])
        yield np.array([bar.get_width() for bar in bars])
        yield from (image.get_array() for image in ax.images)
        for line in ax.lines:
            yield from (line.get_xydata(), line.get_xdata(), line.get_ydata())
        for one in ax.collections:
            if hasattr(one, "U"):
                yield from (one.get_offsets(), np.column_stack([one.U, one.V]))
            elif hasattr(one, "get_segments"):
                yield np.array(one.get_segments())


def same(one, other):
    one, other = np.asarray(one, float), np.asarray(other, float)
    return one.shape == other.shape and np.allclose(one, other, atol=1e-9, equal_nan=True)


POSITIONS, ANGLES = [0.1, 0.4], np.array([[1.0, -2.0, 3.0], [0.5, 0.0, -1.0]])
PANELS = {"mm": {"E_t": [0.1, 0.05, 0.2]}, "deg": {"a": [1, 2, 3], "b": [3, np.nan, 1]}}
SLANTED = pd.DataFrame(
    {"slant_deg": [0.0, 20.0, 60.0], "along": [0.1, -0.7, 0.2], "across": [0.0, 0.3, 9.0]}
)
X, ERRORS = np.arange(12.0).reshape(4, 3), np.ones((4, 3)) * [0.1, -0.2, 0.3]
RING = np.exp(1j * np.arange(4.0))
BUDGET = pd.DataFrame(
    {"group": ["certain", "certain", "sum"], "mm": [0.1, 0.2, 0.22], "deg": [1.0, np.nan, 1.5]},
    index=["a", "b", "both"],
)
CURVES = {"a": ([1, 2], [[3.0, 2.0, 5.0], [4.0, np.nan, np.nan]])}
UV = np.array([[[[100.0, 50.0], [200.0, 80.0], [300.0, 90.0]]]])
RESIDUALS = np.array([[[[0.3, 0.0], [0.0, -0.4], [np.nan, np.nan]]]])
# a figure, and what is drawn in it, among other things, in this order
FIGURES = {
    # a difference of T itself is no motion
    "histories": (
        plot_pixel_histories,
        ([0, 1, 2, 3], {"lamp": ([45.0, 60.0, 61.0, 29.0], [45.0] * 4)}, 15.0),
        ([[0, 45], [1, 60]], [[2, 61], [3, 29]]),
    ),
    "intervals": (
        lambda *of: plot_with_intervals(*of).figure,
        (CURVES, "n", "mm", "xy"),
        ([[[1, 2], [1, 5]], [[2, 4], [2, 4]]],),
    ),
    # the root of (0.09 + 0.16) / 2, of lengths of 0.3 and 0.4 px; the third point was not used
    "residuals": (
        plot_residuals,
        (UV, RESIDUALS, [(640, 480)], ["left"], ["0001"]),
        ([np.sqrt(0.125)],),
    ),
    # mean absolute of -2 and 0, signed mean
    "pose errors": (
        plot_pose_errors,
        (POSITIONS, ANGLES, ["first", "second"]),
        (POSITIONS, [1.0, 0.5], [-2.0, 0.0], [1.0, 1.0], [-1.0, -1.0], [3.0, -1.0]),
    ),
    "factor": (
        plot_factor,
        ([1.0, 2.0, 4.0], PANELS, "m", 2.0),
        (PANELS["mm"]["E_t"], [2.0, 2.0], [1, 2, 3], [3, np.nan, 1], [2.0, 2.0]),
    ),
    # inside the frame, whatever their size
    "by slant": (
        plot_by_slant,
        ({"plain": SLANTED, "registered": SLANTED / 10}, 0.5),
        ([0.1, -0.5, 0.2], [0.01, -0.07, 0.02], [0.0, 0.3, 0.5], [0.0, 0.03, 0.5]),
    ),
    "errors in space": (
        plot_errors_in_space,
        (X, ERRORS, 100),
        (X[:, [0, 1]], 100 * ERRORS[:, [0, 1]], X[:, [0, 2]], 100 * ERRORS[:, [0, 2]]),
    ),
    "session": (
        plot_session,
        (X[0], {"a / mm": {"hand": X[0], "tool": X[1]}, "b / N": {"": X[2]}}, {"open": []}),
        tuple(X[:3]),
    ),
    "nyquist": (plot_nyquist, ({"a": (RING, 2 * RING)},), (RING.imag, 2 * RING.imag)),
    "limits": (
        plot_limits,
        ([0.0, 0.1], {"30 Hz": [100.0, 10.0]}, {"simulated": [np.nan, 10.0]}),
        ([0.0, 100.0],),
    ),
    "budget": (
        plot_budget,
        (BUDGET, {"mm": "E_t / mm", "deg": "angle / deg"}),
        ([0.1, 0.2, 0.22], [1.0, np.nan, 1.5]),
    ),
}


@pytest.mark.parametrize("name", FIGURES)
def test_what_is_given_is_drawn(name):
    plot, given, expected = FIGURES[name]
    figure = plot(*given)
    left = drawn(figure)
    for wanted in expected:
        assert any(same(wanted, one) for one in left), wanted


def test_every_position_of_the_board_is_drawn_and_both_ways_lead_to_it():
    rig = load_rig("paper_pair")
    poses = RigidTransform.from_translation([[-60.0, -40, 560], [-50, -40, 600], [0, 0, 500]])
    ax = plot_boards(rig, Board().outline, poses).axes[0]
    assert len(ax.patches) == 3
    dotted = [line.get_xydata() for line in ax.lines if line.get_linestyle() == ":"]
    # z to the right, y down, x obliquely: the first board's corner, and CCD1 in the origin
    np.testing.assert_allclose(dotted[0], [[560 + 24, -27 + 40], [0, 0]])
    np.testing.assert_allclose(dotted[0][0], dotted[1][0])


def test_a_belief_is_drawn_one_standard_deviation_from_its_mean():
    mean, P = np.array([1.0, -2.0]), np.array([[13.0, 9.0], [9.0, 9.0]])
    ax = plot_beliefs({"predicted": (mean, P)}, "place", "speed")
    away = np.column_stack(ax.lines[0].get_data()) - mean
    squared = np.einsum("ki,ij,kj->k", away, np.linalg.inv(P), away)
    assert squared == pytest.approx(np.ones(len(away)))
    assert np.abs(away).max(axis=0) == pytest.approx(np.sqrt(np.diag(P)), rel=1e-3)


def test_the_gate_is_an_ellipse_that_holds_its_share_of_the_innovations():
    S, middle = np.array([[9.0, 4.0], [4.0, 16.0]]), np.array([55.0, 45.0])
    places = Window(30, 20, 60, 60), Window(45, 35, 20, 20), middle
    ax = plot_prediction(np.zeros((100, 120), np.uint8), *places, S, 0.9, [[50.0, 40.0]])
    gate = next(patch for patch in ax.patches if patch.get_label() == "gate, 90 %")
    edge = gate.get_patch_transform().transform(gate.get_path().vertices[:25:3]) - middle
    squared = np.einsum("ki,ij,kj->k", edge, np.linalg.inv(S), edge)
    np.testing.assert_allclose(squared, chi2.ppf(0.9, 2), rtol=1e-6)


def test_the_section_has_the_marker_on_the_rod_and_its_image_below():
    ax = plot_rod_section(5.0, 3.0, 55.0, 3.96)
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    marker = lines["marker"]
    np.testing.assert_allclose(np.linalg.norm(marker, axis=1), 5.0)  # on the rod
    steps = np.linalg.norm(np.diff(marker, axis=0), axis=1).sum()
    assert steps == pytest.approx(3.0, rel=1e-3)  # as long as wide when it was flat
    middle, centroid = lines["its middle"][0], lines["centroid of its image"][0]
    assert middle[0] == pytest.approx(5 * np.sin(np.deg2rad(55)))
    assert centroid[0] == 3.96
    assert marker[:, 0].min() < centroid[0] < middle[0] < marker[:, 0].max()


def test_image_with_markers():
    image = np.zeros((30, 50), dtype=np.uint8)  # not square
    ax = show_image(image, [[10.0, 20.0], [np.nan, np.nan], [49.0, 29.0]], labels=["a", "b", "c"])
    assert [(text.get_text(), text.xy) for text in ax.texts] == [("a", (10, 20)), ("c", (49, 29))]
    assert (ax.get_xlim(), ax.get_ylim()) == ((-0.5, 49.5), (29.5, -0.5))
    mark_window(ax, Window(3, 5, 10, 4), "seen")
    box = ax.patches[0].get_bbox()
    assert (box.x0, box.y0, box.x1, box.y1) == (2.5, 4.5, 12.5, 8.5)  # of pixels 3 to 12 and 5 to 8
    with pytest.raises(ValueError, match="image"):
        show_image(np.zeros((3, 4, 3)))


def test_the_epipolar_plane_holds_the_points_and_the_second_camera_s_line():
    rig = load_rig("raised_40deg")
    depths = [350.0, 450.0, 550.0]
    figure = plot_epipolar_plane(rig.cameras[0], rig.cameras[2], [400, 300], depths)
    ax = figure.axes[0]
    line = next(one for one in ax.lines if one.get_label().startswith("epipolar line"))
    seen = np.array(line.get_data_3d()).T
    centre = rig.cameras[2].centre
    points = rig.cameras[0].centre + np.outer(depths, rig.cameras[0].rays([[400.0, 300.0]])[0])
    for pixel, point in zip(seen, points, strict=True):
        # what the camera sees of a point lies on the way to it
        np.testing.assert_allclose(np.cross(pixel - centre, point - centre), 0, atol=1e-6)


def test_two_rays_cross_in_the_marker_they_come_from():
    left, right = load_rig("paper_pair").cameras
    point = np.array([20.0, -30.0, 560.0])  # of CCD1's frame, which is the world
    uv_left, uv_right = left.project([point])[0], right.project([point])[0]
    ax = plot_two_rays(left, right, uv_left, uv_right, 50.0)
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    np.testing.assert_allclose(lines["the marker"], [[560, 20]], atol=1e-6)  # z, x
    np.testing.assert_allclose(lines["baseline"][1], right.centre[[2, 0]], atol=1e-9)
    overlap = ax.patches[-1]
    low, high = overlap.get_xy().min(axis=0), overlap.get_xy().max(axis=0)
    assert (low < [560, 20]).all()
    assert (high > [560, 20]).all()
    assert (high - low)[0] > 5 * (high - low)[1]  # a lozenge along z


def test_every_frame_has_its_name_and_three_axes():
    T = load_table1().set_poses[9]
    ax = plot_frames(load_rig("raised_40deg"), T).axes[0]
    said = {text.get_text().strip() for text in ax.texts}
    assert {"CCD1", "CCD2", "CCD3", "handle"} <= said
    _, eq23 = (line for line in ax.lines if line.get_linestyle() == ":")
    x, y, z = T.translation
    # z to the right, y down, x obliquely; CCD1 is the world's origin
    np.testing.assert_allclose(eq23.get_xydata(), [[z - 0.4 * x, 0.45 * x - y], [0, 0]])


def test_cameras_and_rod_are_where_they_are():
    corners = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    centres = {"left": np.zeros(3), "right": np.array([100.0, 0.0, 0.0])}
    views = {name: (centre, centre + corners) for name, centre in centres.items()}
    rod = [[0.0, -50.0, 500.0], [0.0, 50.0, 500.0]]
    axes = [[0.0, 0.0, 500.0], [60.0, 0.0, 500.0], [0.0, 60.0, 500.0], [0.0, 0.0, 560.0]]
    (ax,) = plot_rig(views, rod, [[5.0, 10.0, 495.0]], axes).axes
    drawn = [np.array(line.get_data_3d()).T[:, [0, 2, 1]] for line in ax.lines]  # x, y, z
    assert any(np.array_equal(line, rod) for line in drawn)
    for centre in centres.values():
        rays = [line for line in drawn if len(line) == 2 and np.array_equal(line[0], centre)]
        assert len(rays) == 5  # four edges of the pyramid, and the line of sight
    assert ax.zaxis_inverted()  # the world's y points down


NAMES = ("CCD1", "CCD2", "CCD3")


def test_points_of_the_plan_are_inside_the_wedge_when_they_are_inside_the_cone():
    cones = paper_cones(1.0, np.deg2rad(60), np.deg2rad(50), 0.3)
    _, ax = plt.subplots()
    show_cones_from_above(cones, NAMES, "", ax, reach=3.0)
    plan = np.random.default_rng(0).uniform(-0.2, 1.2, (500, 2))
    points = np.column_stack([plan[:, 0], np.zeros(500), plan[:, 1]])
    filled = {patch.get_label(): patch for patch in ax.patches}
    for cone, name in zip(cones, NAMES, strict=True):
        shown = filled[name].get_path().contains_points(plan)
        assert np.mean(shown == inside([cone], points)) > 0.99  # the circle is a polygon of 72
        assert 0 < shown.sum() < 500
