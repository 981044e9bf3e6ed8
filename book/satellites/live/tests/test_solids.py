"""The shaded views: what the arm and the ellipsoid are drawn from, and what a browser draws."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from workbench.pages.browser import CHROMIUM

pytest.importorskip("mink", reason="the extra 'slave' is missing")
pytest.importorskip("tornado", reason="the extra 'live' is missing")

import mujoco
from livepage import HANDLE, RIG, Bench, Live, shows

from satellites.live.picture import ellipsoid, scene
from satellites.live.solids import body_poses, shapes
from trinolab.pose import Pose
from trinolab.slave.arm import load_robot
from workbench.teleop.session import Session

Q = [0.4, -1.1, 1.7, -1.9, -1.3, 0.6]  # rad
MESH = """<mujoco><asset><mesh name="wedge" vertex="0 0 0  0.2 0 0  0 0.1 0  0 0 0.3"/></asset>
<worldbody><geom type="plane" size="0 0 1"/><geom type="sphere" size="0.1" pos="0 0 1"/>
<geom type="sphere" size="0.1" group="3"/>
<body><joint name="j" range="-1 1" limited="true"/><geom type="mesh" mesh="wedge"/><site name="tool"/></body>
</worldbody><actuator><position name="j" joint="j"/><velocity name="j_speed" joint="j"/></actuator>
</mujoco>"""


def placed(pose):
    x, y, z, *turn = pose
    return RigidTransform.from_components(
        [x, y, z], Rotation.from_quat(turn, scalar_first=True)
    ).as_matrix()


def test_shapes_on_their_bodies_are_where_the_simulation_has_them():
    """Seen in another posture than that in which the shapes were taken."""
    robot = load_robot()
    session = Session(robot, q=Q)
    data = session.slave.data
    bodies = np.reshape(body_poses(session), (-1, 7))
    assert len(bodies) == 6  # what is fixed to a link goes along with it
    found = shapes(robot)
    assert len(found) == robot.model.ngeom
    kinds = {int(mujoco.mjtGeom.mjGEOM_BOX): "box", int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder"}
    for geom, shape in enumerate(found):
        assert shape["kind"] == kinds.get(int(robot.model.geom_type[geom]), "capsule")
        T = np.vstack([np.reshape(shape["T"], (3, 4)), [0, 0, 0, 1]])
        if shape["body"] >= 0:
            T = placed(bodies[shape["body"]]) @ T
        # mm and shares; what is sent is rounded to 0.1 mm and 1e-4
        np.testing.assert_allclose(T[:3, 3], 1000 * data.geom_xpos[geom], atol=0.25)
        np.testing.assert_allclose(T[:3, :3].ravel(), data.geom_xmat[geom], atol=4e-4)
    (table,) = [one for one in found if one["size"] == [600.0, 600.0, 20.0]]
    assert (table["body"], table["T"][3::4]) == (-1, [-450.0, 0.0, -20.0])
    assert table["colour"] == [0.55, 0.45, 0.35, 1.0]


def test_of_other_shapes_the_bounding_box_is_drawn(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(MESH)
    plane, sphere, wedge = shapes(load_robot(file))  # and not what is for collisions
    assert (plane["kind"], plane["size"]) == ("box", [2000.0, 2000.0, 1.0])
    assert (sphere["kind"], sphere["size"]) == ("ellipsoid", [100.0, 100.0, 100.0])
    assert wedge["kind"] == "box"
    T = np.vstack([np.reshape(wedge["T"], (3, 4)), [0, 0, 0, 1]])
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * wedge["size"]
    corners = corners @ T[:3, :3].T + T[:3, 3]
    vertices = np.array([[0, 0, 0], [200, 0, 0], [0, 100, 0], [0, 0, 300]])
    inside = (vertices - T[:3, 3]) @ T[:3, :3]
    assert (np.abs(inside) <= np.array(wedge["size"]) + 0.1).all()
    assert np.ptp(corners, axis=0).max() < 500


def test_the_ellipsoid_holds_95_percent():
    """Of random positions; n = 40,000, whose share has a standard deviation of 0.1 %."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 6)) * [0.01, 0.02, 0.05, 0.1, 0.1, 0.1]
    covariance = root @ root.T
    pose = Pose("measured", RigidTransform.identity(), covariance, 0.1, 6, 3)
    S = np.reshape(ellipsoid(pose), (3, 3))
    draws = rng.multivariate_normal(np.zeros(3), covariance[:3, :3], 40_000)
    share = (np.linalg.norm(np.linalg.solve(S, draws.T), axis=0) < 1).mean()
    assert share == pytest.approx(0.95, abs=0.005)
    assert np.linalg.det(S) > 0  # no mirror, which would turn the shading inside out
    nothing = Pose("measured", RigidTransform.identity(), np.full((6, 6), np.nan), 0.1, 6, 3)
    assert ellipsoid(nothing) is None


def test_what_is_new_in_a_frame_is_short():
    """Poses and ellipsoid; the shapes come once."""
    session = Session(load_robot(), q=Q)
    pose = Pose("measured", RigidTransform.identity(), 1e-4 * np.eye(6), 0.1, 6, 3)
    assert len(json.dumps([body_poses(session), ellipsoid(pose)])) < 600
    assert len(json.dumps(scene(RIG, HANDLE, load_robot()))) < 12_000


# ---- in a browser

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing")
NO_WEBGL = """
const usual = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function(kind, ...more) {
    return kind.startsWith('webgl') ? null : usual.call(this, kind, ...more);
};
"""
# The colour of a canvas where a point of its space is seen.
COLOUR = """((id, point, ...space) => {
    paint();
    const canvas = $(id), [u, v] = placeOf(sightOf(views[id], canvas.width, canvas.height, ...space), point);
    return [...canvas.getContext('2d').getImageData(u, v, 1, 1).data];
})"""
ARM = "[-420, 0, 170], 1080, 'z'"
SHADES = """(id => {
    const canvas = $(id), all = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    const shades = new Set();
    for (let k = 0; k < all.length; k += 4)
        if (all[k + 3] === 255) shades.add(all[k] << 16 | all[k + 1] << 8 | all[k + 2]);
    return shades.size;
})"""


@needs_browser
def test_solids_are_shaded_where_lines_and_words_are_drawn(browser, tmp_path):
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        if not browser.evaluate("Solids.ready()"):
            pytest.skip("this browser has no WebGL 2")
        for _ in range(3):  # from all sides
            red, green, blue, alpha = browser.evaluate(f"{COLOUR}('arm', [-500, 200, 60], {ARM})")
            assert (alpha, red > green + 30 > blue + 30) == (255, True)  # the block, from above
            red, green, blue, alpha = browser.evaluate(f"{COLOUR}('arm', [-100, -500, 0], {ARM})")
            assert (alpha, red > blue, abs(red - green) < 60) == (255, True, True)  # the table
            assert browser.evaluate(f"{COLOUR}('arm', [-450, 0, 900], {ARM})")[3] == 0  # nothing
            browser.evaluate("views.arm.turn += 1.3")
        assert browser.evaluate(f"{SHADES}('arm')") > 200
        assert browser.evaluate(f"{SHADES}('world')") > 100
        tool = browser.evaluate(
            "(() => { const {parts, body} = scene.shapes[scene.shapes.length - 1];"
            " return Solids.times(Solids.ofPose(last.bodies.slice(7 * body)), parts[0].M).slice(12, 15); })()"
        )
        before, end = np.array(browser.evaluate("last.arm.slice(-2)"))
        np.testing.assert_allclose(tool, (before + end) / 2, atol=0.3)  # mm, of what is rounded
        assert "drawn" in browser.evaluate("$('larger').textContent")
        larger = browser.evaluate("larger * Math.hypot(...last.ellipsoid)")
        assert 14 <= larger <= 80  # mm, so that it is seen
        assert browser.errors == []


@needs_browser
def test_an_ellipsoid_that_would_hide_the_cameras_is_not_drawn(browser, tmp_path):
    shown = (
        "(mm => { paintWorld({...last, ellipsoid: [mm, 0, 0, 0, mm, 0, 0, 0, mm]}, []);"
        " return $('larger').textContent; })"
    )
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        far = browser.evaluate(f"{shown}(200)")
        assert far == "no ellipsoid: the position is uncertain by more than 150 mm"
        assert browser.evaluate(f"{shown}(60)").endswith("drawn as large as it is")
        assert browser.evaluate(f"{shown}(0.01)").endswith("drawn 2,000 times as large")


@needs_browser
def test_who_watches_a_demonstration_is_not_told_to_act(browser, tmp_path):
    said = "(by => { last.demonstration = by; return letsGo(); })"
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        assert browser.evaluate(f"{said}(true)").startswith("The demonstration opens the clutch")
        assert browser.evaluate(f"{said}(false)").startswith("Open the clutch")


@needs_browser
def test_without_webgl_lines_are_drawn(browser, tmp_path):
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address, before=NO_WEBGL)
        shows(browser, "last && last.status === 'measured'")
        assert not browser.evaluate("Solids.ready()")
        assert browser.evaluate(f"{COLOUR}('arm', [-500, 200, 60], {ARM})")[3] == 0
        for name in ("arm", "world"):
            assert browser.evaluate(f"{SHADES}('{name}')") > 1
        assert browser.errors == []


@needs_browser
def test_a_context_that_is_lost_comes_back(browser, tmp_path):
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        if not browser.evaluate("Solids.ready()"):
            pytest.skip("this browser has no WebGL 2")
        browser.evaluate("window.lose = Solids.context().getExtension('WEBGL_lose_context')")
        browser.evaluate("lose.loseContext()")
        block = f"{COLOUR}('arm', [-500, 200, 60], {ARM})"
        shows(browser, f"!Solids.ready() && {block}[3] === 0")
        browser.evaluate("lose.restoreContext()")
        shows(browser, f"Solids.ready() && {block}[3] === 255")


@needs_browser
def test_a_view_turns_by_keys_and_the_page_says_so(browser, tmp_path):
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        words = browser.evaluate("$($('arm').getAttribute('aria-describedby')).innerText")
        assert "drag" in words
        assert "arrow keys" in words
        browser.evaluate("$('arm').focus()")
        browser.press("ArrowRight")
        browser.press("+")
        assert browser.evaluate("views.arm.turn") == pytest.approx(2.6)
        assert browser.evaluate("views.arm.zoom") == pytest.approx(1.2)
        browser.press("0")
        assert browser.evaluate("[views.arm.turn, views.arm.zoom]") == [2.5, 1]
        browser.drag("#world", 100, 0)
        assert browser.evaluate("views.world.turn") == pytest.approx(1.6)
