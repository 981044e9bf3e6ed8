"""The surveillance camera's picture lies where `Camera.project` says, and shows what the model
holds; the figures of the slave draw what they are given.
"""

import os
import subprocess
import sys
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera
from workbench.plotting.slave import plot_arm, plot_session, plot_two_port

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


def camera_of(
    size, focal, centre, distortions=NONE, eye=(900.0, -700.0, 600.0), at=(0.0, 0.0, 200.0)
):
    matrix = [[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]
    return Camera("surveillance", size, matrix, distortions, seen_from(eye, at))


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


def test_red_comes_first_and_a_geoms_colour_before_its_materials():
    lamp = '<material name="lamp" emission="1" rgba="0 0 1 1"/>'
    assert tuple(
        one('<geom size=".2" pos="0 0 .2" material="lamp" rgba="1 .4 0 1"/>', lamp)[240, 320]
    ) == (255, 102, 0)
    assert tuple(one('<geom size=".2" pos="0 0 .2" material="lamp"/>', lamp)[240, 320]) == (
        0,
        0,
        255,
    )
    plain = one('<geom size=".2" pos="0 0 .2" rgba="0 1 0 1"/>')[240, 320]
    assert plain[1] > 150
    assert plain[0] == plain[2] == 0


@pytest.mark.parametrize("words", ['group="3"', 'group="5"', 'rgba="1 1 1 0"'])
def test_what_is_not_for_the_eye_is_left_out(words):
    assert not one(f'<geom size=".2" pos="0 0 .2" {words}/>').any()
    assert one('<geom size=".2" pos="0 0 .2" group="2"/>').any()


def test_an_endless_plane_reaches_far_and_hides_nothing_that_is_before_it():
    # first: what is as deep as it
    image = one(
        '<geom type="box" size=".05 .05 .0002" pos="0 0 .2002" rgba="0 0 1 1"/>'
        '<geom type="plane" size="0 0 1" rgba="1 0 0 1"/>'  # and comes later would hide it
        '<geom type="box" size=".1 .1 .1" pos="0 0 .1" rgba="0 1 0 1"/>'
    )
    camera = CAMERAS["even"]
    top, plate, floor = (
        camera.project([(80, 80, 200), (0, 0, 200.4), (0, -400, 0)]).round().astype(int)
    )
    assert [int(image[v, u].argmax()) for u, v in (top, plate, floor)] == [1, 2, 0]
    plate = (
        np.array(np.meshgrid(np.linspace(-44, 44, 40), np.linspace(-44, 44, 40), 200.4))
        .reshape(3, -1)
        .T
    )
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
    model = model_of(
        '<body><joint type="slide" axis="1 0 0"/><geom size=".05" pos="0 0 .2" material="glow"/></body>',
        GLOW,
    )
    data, camera = mujoco.MjData(model), CAMERAS["even"]
    with SlaveView(model, camera, "black") as view:
        for x in (-0.1, 0.15):
            data.qpos[0] = x
            mujoco.mj_forward(model, data)
            v, u = np.nonzero(view.render(data)[..., 0] > 127)
            np.testing.assert_allclose(
                [u.mean(), v.mean()], camera.project([[1000 * x, 0, 200]])[0], atol=0.5
            )
        data.geom_xpos[0] = np.nan  # a simulation that has gone astray
        assert not view.render(data).any()


def test_what_is_behind_the_camera_is_not_seen():
    camera = CAMERAS["even"]
    x, y, z = (camera.centre - 400 * camera.axis) / 1000
    assert not one(f'<geom size=".1" pos="{x} {y} {z}"/>').any()


def test_a_force_is_as_long_as_it_is_strong():
    camera, model = CAMERAS["even"], model_of('<geom size=".001" pos="0 0 -3"/>')
    with SlaveView(model, camera, "black") as view:
        for newton in ((0, 0, 12.0), (-20.0, 0, 0), (6.0, 9.0, -4.0)):
            force = ForceArrow((10.0, 20.0, 200.0), newton, mm_per_n=15.0)
            np.testing.assert_allclose(
                force.tip_mm, np.array((10.0, 20.0, 200.0)) + 15 * np.array(newton)
            )
            ends = camera.project([force.origin_mm, force.tip_mm])
            v, u = np.nonzero(view.render(settled(model), force).any(axis=2))
            along = (
                (np.column_stack([u, v]) - ends[0])
                @ (ends[1] - ends[0])
                / np.linalg.norm(ends[1] - ends[0])
            )
            assert -6 < along.min() < 1  # the shaft's rim
            assert along.max() == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=1.5)
        for nothing in ((0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), None):
            shown = None if nothing is None else ForceArrow((0, 0, 200), nothing)
            assert not view.render(settled(model), shown).any()


def test_a_lens_bends_the_picture_and_its_dark_corners_are_the_background():
    camera = camera_of((301, 201), (150.0, 150.0), (150.0, 100.0), (-0.25, 0.0, 0.0, 0.0, 0.0))
    ideal = camera.ideal_pixels([(0.0, 0.0)])[0]
    assert ideal[0] < -30 or np.isnan(ideal[0])
    with SlaveView(model_of('<geom type="plane" size="0 0 1"/>'), camera, "#102030") as view:
        image = view.render(settled(model_of('<geom type="plane" size="0 0 1"/>')))
    assert image.shape == (201, 301, 3)
    assert tuple(image[0, 150]) == (0x10, 0x20, 0x30)  # sky
    assert tuple(image[200, 150]) != (0x10, 0x20, 0x30)


BENT = (-0.69, 0.273, 0.0, 0.0, -0.0398)
BOX = '<geom type="box" size=".1 .1 .1"/>'


@pytest.mark.parametrize(
    ("build", "line"),
    [
        (lambda: SlaveView("model", CAMERAS["even"]), "model: expected a mujoco.MjModel, got str"),
        (lambda: SlaveView(model_of(BOX), "camera"), "camera: expected a Camera, got str"),
        (
            lambda: SlaveView(model_of(BOX), camera_of((9000, 20), (700.0, 700.0), (320.0, 240.0))),
            r"camera: expected an image of at most 8192 px per side, got \(9000, 20\)",
        ),
        (
            lambda: SlaveView(
                model_of(BOX), camera_of((640, 480), (450.0, 450.0), (320.0, 240.0), BENT)
            ),
            "camera: expected a lens whose picture without distortion is at most 2 times",
        ),
        (
            lambda: SlaveView(model_of(BOX), CAMERAS["even"], "no colour"),
            "background: expected a colour, got 'no colour'",
        ),
        (
            lambda: geom_scene(
                model_of(
                    '<geom name="tool" type="mesh" mesh="m"/>',
                    '<mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>',
                )
            ),
            r"model: expected simple shapes, got geom 0 \(tool\): mesh",
        ),
        (lambda: ForceArrow((0, 0), (0, 0, 1)), "origin_mm: expected shape"),
        (lambda: ForceArrow((0, 0, 0), (0, 0, "x")), "force_n: expected numbers"),
        (lambda: ForceArrow((0, 0, 0), (0, 0, 1), 0.0), "mm_per_n: expected a number"),
        (
            lambda: ForceArrow((0, 0, 0), (0, 0, 1), radius_mm=np.nan),
            "radius_mm: expected a number",
        ),
    ],
)
def test_a_wrong_argument_is_one_line(build, line):
    with pytest.raises(ValueError, match=line) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_data_of_another_model_and_a_closed_view_are_refused():
    model = model_of(BOX)
    with SlaveView(model, CAMERAS["even"]) as view:
        for other in (settled(model_of(BOX + BOX)), None):
            with pytest.raises(
                ValueError, match="data: expected the MjData of this model with 1 geoms, got"
            ):
                view.render(other)
        with pytest.raises(ValueError, match="force: expected a ForceArrow, got tuple"):
            view.render(settled(model), (0, 0, 1))
    with pytest.raises(ValueError, match="view: expected an open one"):
        view.render(settled(model))


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ({}, "(480, 640, 3)"),
        (
            {"VTK_DEFAULT_OPENGL_WINDOW": "vtkOSOpenGLRenderWindow"},
            "cannot render without a display",
        ),
    ],
)
def test_a_machine_without_a_display_renders_silently_or_says_why_not(broken, said):
    code = (
        "import mujoco, numpy as np\nfrom trinolab.camera import Camera\n"
        "from scipy.spatial.transform import RigidTransform\nfrom workbench.teleop.view import SlaveView\n"
        "model = mujoco.MjModel.from_xml_string('<mujoco/>')\n"
        "camera = Camera('s', (640, 480), np.diag([700, 700, 1]), [0] * 5, RigidTransform.identity())\n"
        "try:\n    print(SlaveView(model, camera).render(mujoco.MjData(model)).shape)\n"
        "except ValueError as error:\n    print(error)"
    )
    environment = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env=environment | broken,
        check=False,
    )
    assert said in run.stdout
    assert (run.returncode, run.stderr) == (0, "")


# --- figures: the arm's frames, a session, a two-port


def texts(ax):
    return [text.get_text() for text in ax.texts]


def test_an_arm_is_drawn_through_the_origins_of_its_frames():
    turns = Rotation.from_euler("x", [[0.0], [90.0], [0.0]], degrees=True)
    frames = RigidTransform.from_components([[0, 0, 0], [0, 0, 100], [-200, 0, 100]], turns)
    ax = plot_arm(frames, ["base", "", "tool"]).axes[0]
    # -x of the base to the right, z up
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[0, 0], [0, 100], [200, 100]])
    said = texts(ax)
    assert [name for name in said if name in ("base", "tool")] == ["base", "tool"]
    assert [said.count(f"${letter}$") for letter in "xyz"] == [2, 2, 2]
    assert said.count("$z_{1}$") == 1
    with pytest.raises(ValueError, match="names: expected 3, one per frame, got 2"):
        plot_arm(frames, ["base", "tool"])


def test_a_session_has_a_panel_each_and_shades_the_stretches_in_all():
    t = np.linspace(0, 3, 7)
    panels = {"a / mm": {"hand": t, "tool": 2 * t}, "b / N": {"": t**2}}
    figure = plot_session(t, panels, {"open": [(0.5, 1.0), (2.0, 2.5)]})
    above, below = figure.axes
    np.testing.assert_allclose(above.lines[1].get_ydata(), 2 * t)
    np.testing.assert_allclose(below.lines[0].get_ydata(), t**2)
    for ax in (above, below):
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches]
        np.testing.assert_allclose(spans, [(0.5, 1.0), (2.0, 2.5)])
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["hand", "tool", "open"]


def test_a_two_port_has_two_speeds_and_two_forces():
    said = texts(plot_two_port().axes[0])
    assert {"$V_m$", "$F_h$", "$V_s$", "$F_e$", "the two-port $H$"} <= set(said)


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


@pytest.mark.parametrize(
    ("window", "there", "can"),
    [
        ("vtkEGLRenderWindow", (), True),
        ("vtkOSOpenGLRenderWindow", ("libOSMesa.so.6",), True),
        ("vtkOSOpenGLRenderWindow", (), False),
        (None, (), True),
    ],
)
def test_a_machine_that_cannot_render_is_told_what_to_install(monkeypatch, window, there, can):
    """VTK would end the process."""

    def load(name):
        if name not in there:
            raise OSError(f"{name}: cannot open shared object file")

    closed = []
    monkeypatch.setattr(view.ctypes, "CDLL", load)
    shown = window and SimpleNamespace(GetClassName=lambda: window)
    plotter = SimpleNamespace(render_window=shown, close=lambda: closed.append(True))
    if can:
        view.can_render(plotter)
    else:
        with pytest.raises(ValueError, match=r"without a display \(Debian packages: libegl1"):
            view.can_render(plotter)
    assert bool(closed) is not can
