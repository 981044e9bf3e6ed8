"""The views of the workspace, and its scene, which need no display."""

import numpy as np
import pytest
from processes import without_display

from trinolab.workspace import intersect, surface_mesh
from trinolab.workspace.cones import paper_cones
from workbench.plotting import workspace as scenes
from workbench.plotting.workspace import plot_workspace, workspace_plotter, workspace_scene


@pytest.fixture(scope="module")
def cones_and_mesh():
    cones = paper_cones(100.0, np.pi / 4, np.pi / 4, 0.3)
    return cones, surface_mesh(cones, intersect(cones).centre, 500)


def test_workspace_views(cones_and_mesh):
    cones, mesh = cones_and_mesh
    top, front, side = plot_workspace(cones, mesh, ["a", "b", "c"]).axes
    labels = [ax.get_xlabel() + ax.get_ylabel() for ax in (top, front, side)]
    assert labels == ["$x$ / mm$z$ / mm", "$x$ / mm$y$ / mm", "$z$ / mm$y$ / mm"]
    # y points down
    assert [ax.yaxis_inverted() for ax in (top, front, side)] == [False, True, True]
    seen = next(patch for patch in top.patches if patch.get_label() == "workspace").get_xy()
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(seen, axis=0), end(mesh[0][:, [0, 2]], axis=0))
    with pytest.raises(ValueError, match="names: expected 3"):
        plot_workspace(cones, mesh, names=["one"])


def test_scene_is_self_contained_and_without_pyvista_a_line_stands_in_its_place(
    cones_and_mesh, monkeypatch
):
    html = workspace_scene(*cones_and_mesh).data
    assert html.startswith("<div><iframe srcdoc=")
    assert "OfflineLocalView" in html
    monkeypatch.setattr(scenes, "find_spec", lambda name: None)
    assert "pip install pyvista" in workspace_scene(*cones_and_mesh).data


@pytest.mark.heavy
def test_scene_without_a_display_is_silent_and_opens_no_connection():
    code = (
        "import socket; socket.socket.connect = None\n"
        "from trinolab import workspace\nfrom trinolab.workspace import cones\n"
        "from workbench.plotting.workspace import workspace_scene\n"
        "c = cones.paper_cones(100.0, 0.8, 0.8, 0.3)\n"
        "m = workspace.surface_mesh(c, workspace.intersect(c).centre, 200)\n"
        "print(len(workspace_scene(c, m).data) > 500_000)"
    )
    assert without_display(code) == (0, "True", "")


def test_names_of_the_scene_stand_beside_their_own_cameras(cones_and_mesh):
    names = ["CCD1", "CCD2", "CCD3"]
    plotter = workspace_plotter(*cones_and_mesh, names)
    # the workspace; and of each camera its cone, apex, axis and name
    assert len(plotter.renderer.actors) == 1 + 4 * 3
    apexes = np.array([cone.apex for cone in cones_and_mesh[0]])
    for k, name in enumerate(names):
        letters = np.array(plotter.renderer.actors[name].mapper.dataset.points)
        away = np.linalg.norm(letters[:, None] - apexes, axis=2).min(axis=0)
        assert away.argmin() == k
        assert 0 < away[k] < 60  # mm
        seen_from = scenes.SEEN_FROM / np.linalg.norm(scenes.SEEN_FROM)
        assert np.ptp(letters @ seen_from) < 1e-3  # they face the first view
    plotter.close()
