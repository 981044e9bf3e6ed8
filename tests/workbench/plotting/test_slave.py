"""The surveillance camera's picture lies where `Camera.project` says, and shows what the model
holds; the figures of the slave draw what they are given.
"""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from processes import without_display
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera
from workbench.plotting.slave import plot_arm, plot_session

mujoco = pytest.importorskip("mujoco")

from workbench.teleop import view  # noqa: E402
from workbench.teleop.view import ForceArrow, SlaveView, geom_scene  # noqa: E402

NONE, BARREL, MIXED = (0.0,) * 5, (-0.3, 0.1, 0.0, 0.0, 0.0), (0.12, -0.05, 0.004, -0.003, 0.01)


def seen_from(eye, at):
    """T_cam_world of a camera at one point that looks at another, upright, mm."""
    z = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    x = np.cross(z, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(z, (0.0, 0.0, 1.0)))
    return RigidTransform.from_components(
        eye, Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    ).inv()


def camera_of(size, focal, centre, distortions=NONE, eye=(900.0, -700.0, 600.0)):
    """A camera that looks at a point above the floor's middle."""
    matrix = [[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]
    return Camera("surveillance", size, matrix, distortions, seen_from(eye, (0.0, 0.0, 200.0)))


CAMERAS = {
    "even": camera_of((640, 480), (700.0, 700.0), (319.5, 239.5)),
    "odd": camera_of((641, 363), (650.0, 650.0), (320.0, 181.0)),
    "off centre": camera_of((400, 301), (420.0, 420.0), (120.3, 211.7), eye=(-500.0, 800.0, 30.0)),
    "fx is not fy": camera_of((301, 500), (380.0, 520.0), (170.2, 201.9)),
    "outside": camera_of((320, 200), (900.0, 800.0), (-150.0, 333.0)),
    "barrel": camera_of((480, 361), (400.0, 410.0), (250.0, 170.0), BARREL),
    "mixed": camera_of((361, 480), (500.0, 480.0), (180.0, 260.0), MIXED),
}


def model_of(geoms, assets=""):
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>"
    )


def settled(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def one(geom, assets="", camera=CAMERAS["even"], background="black"):
    """The picture of a model of one geom."""
    model = model_of(geom, assets)
    with SlaveView(model, camera, background) as view:
        return view.render(settled(model))


GLOW = '<material name="glow" emission="1" rgba="1 1 1 1"/>'


def spots(camera, count=24, radius_px=5.0, seed=3):
    """Pixels with glowing spheres behind them, apart from one another, and the centroids of what is
    rendered there.
    """
    rng, uv = np.random.default_rng(seed), np.empty((0, 2))
    while len(uv) < count:
        new = rng.uniform(8.0, np.array(camera.size) - 9.0)
        if not len(uv) or np.linalg.norm(uv - new, axis=1).min() > 20:
            uv = np.vstack([uv, new])
    depth = rng.uniform(600, 2500, count)
    points = camera.centre + camera.rays(uv) * depth[:, None]
    radii_m = radius_px * depth / camera.focal.mean() / 1000
    model = model_of(
        "".join(f'<geom type="sphere" size="{r}" material="glow"/>' for r in radii_m), GLOW
    )
    data = settled(model)
    data.geom_xpos[:] = points / 1000
    with SlaveView(model, camera, "black") as view:
        image = view.render(data)[..., 0].astype(float)
    return camera.project(points), np.array([centroid(image, u, v) for u, v in uv])


def centroid(image, u, v, half=8):
    u, v = round(u), round(v)
    left, top = max(u - half, 0), max(v - half, 0)
    patch = image[top : v + half + 1, left : u + half + 1]
    rows, columns = np.indices(patch.shape)
    return np.array([(columns * patch).sum(), (rows * patch).sum()]) / patch.sum() + (left, top)


@pytest.mark.parametrize("name", CAMERAS)
def test_spheres_lie_where_the_camera_projects_them(name):
    expected, found = spots(CAMERAS[name])
    off = found - expected
    # px; worst of 4 x 24 spheres a camera 0.13, rms 0.05
    assert np.linalg.norm(off, axis=1).max() < 0.2
    assert np.abs(off.mean(axis=0)).max() < 0.05  # px; half a pixel's shift would be 0.5


def ball(n=4000):
    points = np.random.default_rng(1).normal(size=(n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def rims(n=400):
    t = np.linspace(0, 2 * np.pi, n)
    return np.vstack([np.column_stack([np.cos(t), np.sin(t), np.full(n, end)]) for end in (-1, 1)])


CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
SHAPES = {  # a geom's words, and points (mm) about its origin that have the same outline
    "box": ('type="box" size=".08 .12 .2"', CORNERS * (80, 120, 200)),
    "sphere": ('type="sphere" size=".15"', ball() * 150),
    "ellipsoid": ('type="ellipsoid" size=".06 .12 .2"', ball() * (60, 120, 200)),
    "cylinder": ('type="cylinder" size=".1 .2"', rims() * (100, 100, 200)),
    "capsule": (
        'type="capsule" size=".08 .2"',
        np.vstack([ball() * 80 + (0, 0, 200), ball() * 80 - (0, 0, 200)]),
    ),
    "plane": ('type="plane" size=".2 .1 .01"', CORNERS * (200, 100, 0)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("euler", [(0, 0, 0), (40, -30, 70)])
def test_each_shape_has_its_size_and_stands_as_the_model_says(name, euler):
    words, outline = SHAPES[name]
    camera = CAMERAS["fx is not fy"]
    image = one(
        f'<geom {words} pos=".02 -.03 .2" euler="{euler[0]} {euler[1]} {euler[2]}" material="glow"/>',
        GLOW,
        camera,
    )
    turned = Rotation.from_euler("XYZ", euler, degrees=True).apply(outline)  # MuJoCo's default
    uv = camera.project(turned + (20, -30, 200))
    v, u = np.nonzero(image[..., 0] > 127)
    np.testing.assert_allclose(
        [u.min(), v.min(), u.max(), v.max()], [*uv.min(axis=0), *uv.max(axis=0)], atol=1.2
    )


@pytest.mark.parametrize(
    ("words", "colour"),
    [
        ('material="lamp" rgba="1 .4 0 1"', (255, 102, 0)),
        ('material="lamp"', (0, 0, 255)),
        ('material="lamp" group="2"', (0, 0, 255)),
        ('material="lamp" group="3"', (0, 0, 0)),  # what is not for the eye
        ('material="lamp" group="5"', (0, 0, 0)),
        ('rgba="1 1 1 0"', (0, 0, 0)),
    ],
)
def test_red_comes_first_and_a_geoms_colour_before_its_materials(words, colour):
    lamp = '<material name="lamp" emission="1" rgba="0 0 1 1"/>'
    image = one(f'<geom size=".2" pos="0 0 .2" {words}/>', lamp)
    assert tuple(image[240, 320]) == colour


def test_an_endless_plane_reaches_far_and_hides_nothing_that_is_before_it():
    # first what is as deep as it, then what comes later and would hide it
    image = one(
        '<geom type="box" size=".05 .05 .0002" pos="0 0 .2002" rgba="0 0 1 1"/>'
        '<geom type="plane" size="0 0 1" rgba="1 0 0 1"/>'
        '<geom type="box" size=".1 .1 .1" pos="0 0 .1" rgba="0 1 0 1"/>'
    )
    camera = CAMERAS["even"]
    u, v = camera.project([(80, 80, 200), (0, -400, 0)]).round().astype(int).T
    assert image[v, u].argmax(axis=1).tolist() == [1, 0]  # the box's top, the floor
    side = np.linspace(-44, 44, 40)
    plate = np.array(np.meshgrid(side, side, 200.4)).reshape(3, -1).T
    u, v = camera.project(plate).round().astype(int).T
    # 0.4 mm above the box below it, and without holes
    assert (image[v, u].argmax(axis=1) == 2).all()
    assert (image[camera.size[1] - 1] > 0).any(axis=1).all()


def test_a_thing_close_before_the_camera_is_seen_over_an_endless_plane():
    camera = CAMERAS["even"]
    x, y, z = (camera.centre + 20 * camera.axis) / 1000
    image = one(
        f'<geom size=".002" pos="{x} {y} {z}" rgba="0 1 0 1"/><geom type="plane" size="0 0 1" rgba="1 0 0 1"/>'
    )
    v, u = np.nonzero(image.argmax(axis=2) == 1)
    np.testing.assert_allclose([u.mean(), v.mean()], camera.principal_point, atol=0.3)
    assert u.max() - u.min() == pytest.approx(2 * 700 * 2 / 20, abs=2)


def test_a_view_follows_the_state_of_the_model():
    ball = '<joint type="slide" axis="1 0 0"/><geom size=".05" pos="0 0 .2" material="glow"/>'
    model = model_of(f"<body>{ball}</body>", GLOW)
    data, camera = mujoco.MjData(model), CAMERAS["even"]
    with SlaveView(model, camera, "black") as view:
        for x in (-0.1, 0.15):
            data.qpos[0] = x
            mujoco.mj_forward(model, data)
            v, u = np.nonzero(view.render(data)[..., 0] > 127)
            place = camera.project([[1000 * x, 0, 200]])[0]
            np.testing.assert_allclose([u.mean(), v.mean()], place, atol=0.5)
        data.geom_xpos[0] = (camera.centre - 400 * camera.axis) / 1000  # behind it
        assert not view.render(data).any()
        data.geom_xpos[0] = np.nan  # a simulation that has gone astray
        assert not view.render(data).any()


def test_a_force_is_as_long_as_it_is_strong():
    camera, model = CAMERAS["even"], model_of('<geom size=".001" pos="0 0 -3"/>')
    origin = np.array((10.0, 20.0, 200.0))
    with SlaveView(model, camera, "black") as view:
        for newton in ((0, 0, 12.0), (-20.0, 0, 0), (6.0, 9.0, -4.0)):
            force = ForceArrow(tuple(origin), newton, mm_per_n=15.0)
            np.testing.assert_allclose(force.tip_mm, origin + 15 * np.array(newton))
            start, tip = camera.project([force.origin_mm, force.tip_mm])
            length = np.linalg.norm(tip - start)
            v, u = np.nonzero(view.render(settled(model), force).any(axis=2))
            along = (np.column_stack([u, v]) - start) @ (tip - start) / length
            assert -6 < along.min() < 1  # the shaft's rim
            assert along.max() == pytest.approx(length, abs=1.5)
        for nothing in ((0.0, 0.0, 0.0), (np.nan, 0.0, 1.0)):
            assert not view.render(settled(model), ForceArrow((0, 0, 200), nothing)).any()
        assert not view.render(settled(model)).any()


def test_a_lens_bends_the_picture_and_its_dark_corners_are_the_background():
    camera = camera_of((301, 201), (150.0, 150.0), (150.0, 100.0), (-0.25, 0.0, 0.0, 0.0, 0.0))
    ideal = camera.ideal_pixels([(0.0, 0.0)])[0]
    assert ideal[0] < -30 or np.isnan(ideal[0])
    with SlaveView(model_of('<geom type="plane" size="0 0 1"/>'), camera, "#102030") as view:
        image = view.render(settled(model_of('<geom type="plane" size="0 0 1"/>')))
    assert image.shape == (201, 301, 3)
    assert tuple(image[0, 150]) == (0x10, 0x20, 0x30)  # sky
    assert tuple(image[200, 150]) != (0x10, 0x20, 0x30)


LARGE = camera_of((9000, 20), (700.0, 700.0), (320.0, 240.0))
STRONG = camera_of((640, 480), (450.0, 450.0), (320.0, 240.0), (-0.69, 0.273, 0.0, 0.0, -0.0398))
MESH = (
    '<geom name="tool" type="mesh" mesh="m"/>',
    '<mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>',
)
BOX = '<geom type="box" size=".1 .1 .1"/>'


@pytest.mark.parametrize(
    ("make", "arguments", "line"),
    [
        (SlaveView, ("model", CAMERAS["even"]), "model: expected a mujoco.MjModel, got str"),
        (SlaveView, (model_of(BOX), "camera"), "camera: expected a Camera, got str"),
        (
            SlaveView,
            (model_of(BOX), LARGE),
            "camera: expected an image of at most 8192 px per side",
        ),
        (SlaveView, (model_of(BOX), STRONG), "camera: expected a lens whose picture without"),
        (SlaveView, (model_of(BOX), CAMERAS["even"], "no colour"), "background: expected a colour"),
        (
            geom_scene,
            (model_of(*MESH),),
            r"model: expected simple shapes, got geom 0 \(tool\): mesh",
        ),
        (ForceArrow, ((0, 0), (0, 0, 1)), "origin_mm: expected shape"),
        (ForceArrow, ((0, 0, 0), (0, 0, "x")), "force_n: expected numbers"),
        (ForceArrow, ((0, 0, 0), (0, 0, 1), 0.0), "mm_per_n: expected a number"),
        (ForceArrow, ((0, 0, 0), (0, 0, 1), 1.0, np.nan), "radius_mm: expected a number"),
    ],
)
def test_a_wrong_argument_is_refused(make, arguments, line):
    with pytest.raises(ValueError, match=line):
        make(*arguments)


def test_data_of_another_model_and_a_closed_view_are_refused():
    model = model_of(BOX)
    with SlaveView(model, CAMERAS["even"]) as view:
        for other in (settled(model_of(BOX + BOX)), None):
            with pytest.raises(ValueError, match="data: expected the MjData of this model"):
                view.render(other)
        with pytest.raises(ValueError, match="force: expected a ForceArrow, got tuple"):
            view.render(settled(model), (0, 0, 1))
    with pytest.raises(ValueError, match="view: expected an open one"):
        view.render(settled(model))


WITHOUT_DISPLAY = """
import mujoco, numpy as np
from trinolab.camera import Camera
from scipy.spatial.transform import RigidTransform
from workbench.teleop.view import SlaveView
model = mujoco.MjModel.from_xml_string('<mujoco/>')
camera = Camera('s', (640, 480), np.diag([700, 700, 1]), [0] * 5, RigidTransform.identity())
print(SlaveView(model, camera).render(mujoco.MjData(model)).shape)
"""


@pytest.mark.heavy
def test_a_machine_without_a_display_renders_silently():
    assert without_display(WITHOUT_DISPLAY) == (0, "(480, 640, 3)", "")


# --- figures: the arm's frames, a session, a two-port


def test_an_arm_is_drawn_through_the_origins_of_its_frames():
    turns = Rotation.from_euler("x", [[0.0], [90.0], [0.0]], degrees=True)
    frames = RigidTransform.from_components([[0, 0, 0], [0, 0, 100], [-200, 0, 100]], turns)
    ax = plot_arm(frames, ["base", "", "tool"]).axes[0]
    # -x of the base to the right, z up
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[0, 0], [0, 100], [200, 100]])
    said = [text.get_text() for text in ax.texts]
    assert [said.count(f"${letter}$") for letter in "xyz"] == [2, 2, 2]
    assert [said.count(name) for name in ("base", "tool", "$z_{1}$")] == [1, 1, 1]
    with pytest.raises(ValueError, match="names: expected 3, one per frame, got 2"):
        plot_arm(frames, ["base", "tool"])


def test_a_session_has_a_panel_each_and_shades_the_stretches_in_all():
    t = np.linspace(0, 3, 7)
    panels = {"a / mm": {"hand": t, "tool": 2 * t}, "b / N": {"": t**2}}
    for ax, curves in zip(
        plot_session(t, panels, {"open": [(0.5, 1.0), (2.0, 2.5)]}).axes,
        panels.values(),
        strict=True,
    ):
        for line, y in zip(ax.lines, curves.values(), strict=False):
            np.testing.assert_allclose(line.get_ydata(), y)
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches]
        np.testing.assert_allclose(spans, [(0.5, 1.0), (2.0, 2.5)])


@pytest.mark.parametrize(
    ("window", "there", "can"),
    [
        ("vtkEGLRenderWindow", (), True),
        ("vtkOSOpenGLRenderWindow", ("libOSMesa.so.6",), True),
        ("vtkOSOpenGLRenderWindow", (), False),
    ],
)
def test_a_machine_that_cannot_render_is_told_what_to_install(monkeypatch, window, there, can):
    """VTK would end the process."""

    def load(name):
        if name not in there:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(view.ctypes, "CDLL", load)
    shown = SimpleNamespace(GetClassName=lambda: window)
    plotter = SimpleNamespace(render_window=shown, close=lambda: None)
    refused = pytest.raises(ValueError, match=r"without a display \(Debian packages: libegl1")
    with nullcontext() if can else refused:
        view.can_render(plotter)
