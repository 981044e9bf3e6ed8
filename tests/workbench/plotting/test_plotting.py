"""Figures come out, show what they are given, and need no display."""

import os
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from trinolab.datasets import load_rig
from trinolab.window import Window
from trinolab.workspace import intersect, surface_mesh
from trinolab.workspace.cones import paper_cones
from workbench.plotting import workspace as scenes
from workbench.plotting.basics import mark_window, show_image
from workbench.plotting.estimators import plot_by_slant, plot_estimators, plot_shifts
from workbench.plotting.gallery import plot_factor
from workbench.plotting.markers import plot_over_slant, plot_thresholds
from workbench.plotting.matching import plot_epipolar_plane
from workbench.plotting.structure import MASTER, SYSTEM, plot_structure
from workbench.plotting.table1 import plot_pose_errors
from workbench.plotting.workspace import plot_workspace, workspace_plotter, workspace_scene


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def cones_and_mesh():
    cones = paper_cones(100.0, np.pi / 4, np.pi / 4, 0.3)
    return cones, surface_mesh(cones, intersect(cones).centre, 500)


def test_workspace_views(cones_and_mesh):
    cones, mesh = cones_and_mesh
    figure = plot_workspace(cones, mesh, ["a", "b", "c"])
    top, front, side = figure.axes
    assert [ax.get_xlabel() + ax.get_ylabel() for ax in figure.axes] == [
        "$x$ / mm$z$ / mm",
        "$x$ / mm$y$ / mm",
        "$z$ / mm$y$ / mm",
    ]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "a",
        "b",
        "c",
        "workspace",
    ]
    assert front.yaxis_inverted()  # y points down
    assert side.yaxis_inverted()
    assert not top.yaxis_inverted()
    workspace = next(patch for patch in top.patches if patch.get_label() == "workspace").get_xy()
    np.testing.assert_allclose(
        [workspace.min(axis=0), workspace.max(axis=0)],
        [mesh[0][:, [0, 2]].min(axis=0), mesh[0][:, [0, 2]].max(axis=0)],
    )
    figure.canvas.draw()


def test_workspace_views_refuse_other_names(cones_and_mesh):
    with pytest.raises(ValueError, match="names: expected 3"):
        plot_workspace(*cones_and_mesh, names=["one"])


def test_scene_is_self_contained_and_needs_no_display(cones_and_mesh):
    html = workspace_scene(*cones_and_mesh).data
    assert html.startswith("<div><iframe srcdoc=")
    assert "OfflineLocalView" in html
    assert 5e5 < len(html) < 3e6


def test_without_pyvista_a_line_stands_in_the_scenes_place(cones_and_mesh, monkeypatch):
    monkeypatch.setattr(scenes, "find_spec", lambda name: None)
    assert "pip install pyvista" in workspace_scene(*cones_and_mesh).data


@pytest.mark.heavy
def test_scene_without_a_display_is_silent_and_opens_no_connection():
    code = (
        "import socket; socket.socket.connect = None\n"
        "import numpy as np\nfrom trinolab import workspace\nfrom trinolab.workspace import cones\n"
        "from workbench.plotting.workspace import workspace_scene\n"
        "c = cones.paper_cones(100.0, 0.8, 0.8, 0.3)\n"
        "m = workspace.surface_mesh(c, workspace.intersect(c).centre, 200)\n"
        "print(len(workspace_scene(c, m).data) > 500_000)"
    )
    environment = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert (run.stdout.strip(), run.stderr) == ("True", "")


def test_scene_holds_cones_apexes_axes_and_workspace(cones_and_mesh):
    plotter = workspace_plotter(*cones_and_mesh)
    assert len(plotter.renderer.actors) == 1 + 3 + 3 + 3
    plotter.close()


def test_names_of_the_scene_stand_beside_their_own_cameras(cones_and_mesh):
    names = ["CCD1", "CCD2", "CCD3"]
    plotter = workspace_plotter(*cones_and_mesh, names)
    assert len(plotter.renderer.actors) == 1 + 3 + 3 + 3 + 3
    apexes = np.array([cone.apex for cone in cones_and_mesh[0]])
    for k, name in enumerate(names):
        letters = np.array(plotter.renderer.actors[name].mapper.dataset.points)
        away = np.linalg.norm(letters[:, None] - apexes, axis=2).min(axis=0)
        assert away.argmin() == k
        assert 0 < away[k] < 60  # mm
        seen_from = scenes.SEEN_FROM / np.linalg.norm(scenes.SEEN_FROM)
        assert np.ptp(letters @ seen_from) < 1e-3  # they face the first view
    plotter.close()


def test_pose_errors_show_every_value():
    position, angles = np.array([0.1, 0.4]), np.array([[1.0, -2.0, 3.0], [0.5, 0.0, -1.0]])
    figure = plot_pose_errors(position, angles, labels=["first", "second"])
    heights = np.array([[bar.get_height() for bar in ax.patches] for ax in figure.axes])
    np.testing.assert_array_equal(heights, np.vstack([position, angles.T]))
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == ["first", "second"]
    np.testing.assert_allclose(figure.axes[2].lines[1].get_ydata(), 1.0)  # mean absolute of -2, 0
    np.testing.assert_allclose(figure.axes[2].lines[2].get_ydata(), -1.0)  # signed mean


def test_factor_shows_every_curve_and_the_working_point():
    x, panels = (
        [1.0, 2.0, 4.0],
        {"E_t / mm": {"E_t": [0.1, 0.05, 0.2]}, "deg": {"a": [1, 2, 3], "b": [3, np.nan, 1]}},
    )
    left, right = plot_factor(x, panels, "distance / m", 2.0).axes
    assert [ax.get_ylabel() for ax in (left, right)] == ["E_t / mm", "deg"]
    for ax, curves in zip((left, right), panels.values(), strict=True):
        *drawn, mark = ax.lines
        assert [line.get_label() for line in drawn] == list(curves)
        for line, y in zip(drawn, curves.values(), strict=True):
            np.testing.assert_array_equal(line.get_xydata(), np.column_stack([x, y]))
        assert mark.get_xdata() == [2.0, 2.0]
        assert "working point" in mark.get_label()


def test_factor_with_counts_and_equal_ratios():
    x, panels = (
        [2.0**k for k in range(10)],
        {"n": {"kept": [20] * 9 + [0]}, "E_t": {"E_t": np.geomspace(1e-3, 10, 10)}},
    )
    counts, errors = plot_factor(x, panels, "noise", 4.0, "log", ["n"], "here").axes
    assert (counts.get_yscale(), errors.get_yscale()) == ("linear", "log")
    assert counts.get_ylim()[0] == 0 < 20 < counts.get_ylim()[1]
    assert [tick.get_text() for tick in errors.get_xticklabels()] == ["1", "4", "16", "64", "256"]
    assert counts.lines[-1].get_label() == "here"


def test_factor_with_intervals_and_one_legend():
    y, low, high = [2.0, 3.0], [1.0, 2.5], [4.0, 3.5]
    figure = plot_factor([1, 2], {"a": {"one": [y, low, high]}, "b": {"one": y}}, "x", 1.0)
    with_bars, without = figure.axes
    (bars,) = with_bars.collections
    assert [segment.tolist() for segment in bars.get_segments()] == [
        [[1, 1], [1, 4]],
        [[2, 2.5], [2, 3.5]],
    ]
    assert not without.collections
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["one", "the paper's working point"]
    assert legend.get_texts()[0].get_fontsize() == 9


def test_image_with_markers():
    image = np.zeros((30, 50), dtype=np.uint8)  # not square
    ax = show_image(
        image, [[10.0, 20.0], [np.nan, np.nan], [49.0, 29.0]], labels=["a", "b", "c"], title="t"
    )
    assert [text.get_text() for text in ax.texts] == ["a", "c"]
    assert ax.texts[0].xy == (10.0, 20.0)
    assert ax.get_xlim() == (-0.5, 49.5)
    assert ax.get_ylim() == (29.5, -0.5)
    assert ax.images[0].get_array().shape == (30, 50)


def test_image_refuses_colour():
    with pytest.raises(ValueError, match="image"):
        show_image(np.zeros((3, 4, 3)))


def test_centroids_by_slant_show_every_marker_inside_the_frame():
    errors = pd.DataFrame(
        {"slant_deg": [0.0, 20.0, 60.0], "along": [0.1, -0.7, 0.2], "across": [0.0, 0.3, 9.0]}
    )
    along, across = plot_by_slant({"plain": errors, "registered": errors / 10}, 0.5).axes
    assert list(along.lines[0].get_ydata()) == [0.1, -0.5, 0.2]
    assert list(across.lines[1].get_ydata()) == [0.0, 0.03, 0.5]
    assert [text.get_text() for text in along.get_legend().get_texts()] == ["plain", "registered"]
    assert across.get_ylim()[1] > 0.5
    along.figure.canvas.draw()


def test_estimators_stand_over_their_rig_between_its_lines():
    rigs = ["pair", "three"]
    errors = {"E_t / mm": pd.DataFrame({"paper": [0.06, 0.07], "best": [0.005, 0.003]}, rigs)}
    target = pd.DataFrame({"E_t / mm": [0.012, 0.03]}, rigs[::-1])  # found by name, not by place
    figure = plot_estimators(errors, {"target": target})
    (ax,) = figure.axes
    assert [list(line.get_ydata()) for line in ax.lines] == [[0.06, 0.07], [0.005, 0.003]]
    assert all(np.abs(line.get_xdata() - [0, 1]).max() < 0.4 for line in ax.lines)
    assert [segment[0, 1] for segment in ax.collections[0].get_segments()] == [0.03, 0.012]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "paper",
        "best",
        "target",
    ]
    figure.canvas.draw()


def test_intervals_of_estimators_reach_from_end_to_end():
    means = pd.DataFrame({"paper": [0.06], "best": [0.006]}, index=["pair"])
    ends = (means / 2, 2 * means)
    ax = plot_estimators({"mm": means}, {}, {"mm": ends}).axes[0]
    bars = [collection.get_segments()[0][:, 1] for collection in ax.collections]
    np.testing.assert_allclose(bars, [[0.03, 0.12], [0.003, 0.012]])


def test_seven_estimators_are_drawn():
    means = pd.DataFrame({name: [1.0] for name in "abcdefg"}, index=["pair"])
    ax = plot_estimators({"mm": means}, {}).axes[0]
    assert [line.get_label() for line in ax.lines] == list("abcdefg")


def test_shifts_are_drawn_at_their_markers_and_their_mean_from_the_middle():
    at, shift = np.array([[3.0, 4], [-3, 4]]), np.array([[-0.1, 0.0], [-0.3, -0.2]])
    figure = plot_shifts({"one": (at, shift)}, {"one": {"a": [0, 2], "b": [3, 0]}}, 5.0, 10)
    (ax,) = figure.axes
    (arrows,) = ax.collections
    np.testing.assert_allclose(arrows.get_offsets(), at)
    np.testing.assert_allclose(np.stack([arrows.U, arrows.V], axis=1), 10 * shift)
    named = {text.get_text(): text.get_position() for text in ax.texts if text.get_text()}
    np.testing.assert_allclose([named["a"], named["b"]], [[0, 7.5], [7.5, 0]])
    means = [text.xy for text in ax.texts if not text.get_text()]
    np.testing.assert_allclose(means[0], [-2, -1])


def test_window_is_drawn_around_its_pixels():
    ax = show_image(np.zeros((20, 30), np.uint8))
    mark_window(ax, Window(3, 5, 10, 4), "seen")
    box = ax.patches[0].get_bbox()
    assert (box.x0, box.y0, box.x1, box.y1) == (2.5, 4.5, 12.5, 8.5)  # of pixels 3 to 12 and 5 to 8
    plt.close("all")


def test_both_loops_are_closed():
    for ax, boxes in zip(plot_structure().axes, (SYSTEM, MASTER), strict=True):
        said = [text.get_text() for text in ax.texts]
        assert set(boxes) < set(said)
        assert len([text for text in ax.texts if getattr(text, "arrow_patch", None)]) == len(boxes)


def test_thresholds_below_their_images():
    image = np.full((30, 40), 60, np.uint8)
    figure = plot_thresholds(
        {"a": image, "b": image},
        [[[3.0, 4.0]], np.empty((0, 2))],
        [np.arange(256)] * 2,
        [[(120.0, 3), (60.0, 8)]] * 2,
        18,
    )
    top, below = figure.axes[0], figure.axes[2]
    assert [ax.get_title() for ax in figure.axes[:2]] == ["a", "b"]
    assert top.lines[0].get_xydata().tolist() == [[3, 4]]
    assert below.lines[0].get_ydata()[0] == 0.5  # no contour
    assert below.lines[2].get_xydata().tolist() == [[120, 3], [60, 8]]


def test_dots_over_the_slant():
    ax = plot_over_slant(
        {"calm": ([10.0, 20], [0.2, 0.3]), "hard": ([15.0], [np.nan])},
        ([5, 60], [0.1, 1]),
        "stills",
    )
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["calm", "hard", "stills"]
    assert ax.lines[0].get_xydata().tolist() == [[10, 0.2], [20, 0.3]]


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
