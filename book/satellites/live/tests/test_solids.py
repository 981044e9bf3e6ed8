"""The shaded views: what the arm and the ellipsoid are drawn from, and what a browser draws."""

import mujoco
import numpy as np
import pytest
from livepage import Bench, Live, shows
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.live.picture import ellipsoid
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
    T = np.reshape(wedge["T"], (3, 4))
    vertices = np.array([[0, 0, 0], [200, 0, 0], [0, 100, 0], [0, 0, 300]])
    inside = (vertices - T[:, 3]) @ T[:, :3]
    assert (np.abs(inside) <= np.array(wedge["size"]) + 0.1).all()
    assert np.linalg.norm(wedge["size"]) < 300  # half the box


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


# ---- in a browser

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


@pytest.mark.usefixtures("live")
def test_solids_are_shaded_where_lines_and_words_are_drawn(browser):
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
    larger = browser.evaluate("larger * Math.hypot(...last.ellipsoid)")
    assert 14 <= larger <= 80  # mm, so that it is seen
    assert browser.errors == []


def test_an_ellipsoid_that_would_hide_the_cameras_is_not_drawn_and_who_watches_need_not_act(
    live, browser
):
    shown = (
        "(mm => { paintWorld({...last, ellipsoid: [mm, 0, 0, 0, mm, 0, 0, 0, mm]}, []);"
        " return $('larger').textContent; })"
    )
    for mm, said in (
        (200, "no ellipsoid: the position is uncertain by more than 150 mm"),
        (60, "drawn as large as it is"),
        (0.01, "drawn 2,000 times as large"),
    ):
        assert browser.evaluate(f"{shown}({mm})").endswith(said)
    said = "(by => { last.demonstration = by; return letsGo(); })"
    assert browser.evaluate(f"{said}(true)").startswith("The demonstration opens the clutch")
    assert browser.evaluate(f"{said}(false)").startswith("Open the clutch")


def test_without_webgl_lines_are_drawn(browser, tmp_path):
    with Live(Bench().source, tmp_path) as live:
        browser.open(live.address, before=NO_WEBGL)
        shows(browser, "last && last.status === 'measured'")
        assert not browser.evaluate("Solids.ready()")
        assert browser.evaluate(f"{COLOUR}('arm', [-500, 200, 60], {ARM})")[3] == 0
        for name in ("arm", "world"):
            assert browser.evaluate(f"{SHADES}('{name}')") > 1
        assert browser.errors == []


def test_a_context_that_is_lost_comes_back(live, browser):
    if not browser.evaluate("Solids.ready()"):
        pytest.skip("this browser has no WebGL 2")
    browser.evaluate("window.lose = Solids.context().getExtension('WEBGL_lose_context')")
    browser.evaluate("lose.loseContext()")
    block = f"{COLOUR}('arm', [-500, 200, 60], {ARM})"
    shows(browser, f"!Solids.ready() && {block}[3] === 0")
    browser.evaluate("lose.restoreContext()")
    shows(browser, f"Solids.ready() && {block}[3] === 255")


@pytest.mark.usefixtures("live")
def test_a_view_turns_by_keys_and_the_page_says_so(browser):
    words = browser.evaluate("$($('arm').getAttribute('aria-describedby')).innerText")
    assert "drag" in words
    assert "arrow keys" in words
    view = "[views.arm.turn, views.arm.zoom]"
    browser.evaluate("$('arm').focus()")
    browser.press("ArrowRight")
    browser.press("+")
    assert browser.evaluate(view) == pytest.approx([2.6, 1.2])
    browser.press("0")
    assert browser.evaluate(view) == [2.5, 1]
    browser.drag("#world", 100, 0)
    assert browser.evaluate("views.world.turn") == pytest.approx(1.6)
