"""The surveillance camera: a MuJoCo scene, drawn by PyVista as a calibrated camera would see it.

Lengths are mm, the world frame is the robot's; MuJoCo's metres are converted here. What is drawn
where agrees with `Camera.project`, so that the picture can be measured in like any other.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np

from trinolab.camera import Camera
from trinolab.checks import Array, as_array, check_numbers, frozen

if TYPE_CHECKING:
    import mujoco
    import pyvista

# MuJoCo's habit: geoms of this group and above are for collisions, or not for the eye
HIDDEN_GROUP = 3
ENDLESS = 10.0  # half the side of an endless plane, by the model's extent (stat.extent)
# a geom's colour in MuJoCo if nothing is said; then the material's holds
UNSET = (0.5, 0.5, 0.5, 1.0)
FORCE_COLOUR = "#D55E00"
MOST_PX = 8192  # side of a picture that is rendered
WIDEST = 2.0  # times the image may grow where the lens distortion is taken out
DEEPEST = 5000.0  # farthest by nearest depth that is drawn


class GeomScene(NamedTuple):
    """A PyVista scene of a model's geoms: the plotter, and the actors by the geoms' numbers."""

    plotter: pyvista.Plotter
    actors: dict[int, pyvista.Actor]


def geom_scene(model: mujoco.MjModel, background: str = "white") -> GeomScene:
    """A model's geoms as a PyVista scene, each about its own origin, in mm; nothing is rendered
    yet.

    Geoms of group 3 and above and wholly transparent ones are left out, textures too. A plane
    without a size reaches from its origin as far as ten times the model's extent.

    Raises
    ------
    ValueError
        For anything but a model, a geom to be drawn that is no plane, sphere, capsule, ellipsoid,
        cylinder or box, or a machine that cannot render without a display.
    """
    import mujoco
    import pyvista

    if not isinstance(model, mujoco.MjModel):
        raise ValueError(f"model: expected a mujoco.MjModel, got {type(model).__name__}")
    geoms = visible_geoms(model)
    shapes = {k: _shape(model, k) for k in geoms}
    fill = _as_colour(background)
    with pyvista.vtk_verbosity("off"):  # a machine without a display is no matter
        plotter = pyvista.Plotter(off_screen=True, lighting="none")
    can_render(plotter)
    plotter.background_color = fill
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.55))
    plotter.add_light(
        pyvista.Light(position=(-0.4, -0.6, 1.0), light_type="scene light", intensity=0.6)
    )
    actors = {
        k: plotter.add_mesh(shapes[k], reset_camera=False, render=False, **_look(model, k))
        for k in geoms
    }
    return GeomScene(plotter, actors)


def place(actor: pyvista.Actor, position_m: np.ndarray, rotation: np.ndarray) -> None:
    """Move an actor to a pose of MuJoCo's: position (3,) in m, rotation matrix (9,), row by row."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.reshape(3, 3)
    pose[:3, 3] = 1000.0 * position_m
    actor.visibility = bool(np.isfinite(pose).all())
    if actor.visibility:
        actor.user_matrix = pose


def _shape(model: mujoco.MjModel, k: int) -> pyvista.PolyData:
    """The surface of a geom about its own origin, mm."""
    import mujoco
    import pyvista

    kind = mujoco.mjtGeom(model.geom_type[k])
    (a, b, c) = 1000.0 * model.geom_size[k]
    upright: dict[str, Any] = {"direction": (0, 0, 1), "radius": a}
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        endless = 2000.0 * ENDLESS * model.stat.extent
        return pyvista.Plane(
            i_size=2 * a or endless, j_size=2 * b or endless, i_resolution=1, j_resolution=1
        )
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return pyvista.Box((-a, a, -b, b, -c, c))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return pyvista.Cylinder(**upright, height=2 * b, resolution=48)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return pyvista.Capsule(**upright, cylinder_length=2 * b)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return pyvista.Sphere(radius=1.0).scale([a, b, c] if b else a)
    name = kind.name.removeprefix("mjGEOM_").lower()
    raise ValueError(
        f"model: expected simple shapes, got geom {k} ({model.geom(k).name or 'no name'}): {name}"
    )


def visible_geoms(model: mujoco.MjModel) -> list[int]:
    """Numbers of the geoms that are there for the eye."""
    return [
        k
        for k in range(model.ngeom)
        if model.geom_group[k] < HIDDEN_GROUP and geom_colour(model, k)[3] > 0
    ]


def geom_colour(model: mujoco.MjModel, k: int) -> tuple[float, ...]:
    """Red, green, blue, opacity of a geom, 0 to 1: its own, or where nothing is said its
    material's.
    """
    own = tuple(map(float, model.geom_rgba[k]))
    material = int(model.geom_matid[k])
    return own if material < 0 or own != UNSET else tuple(map(float, model.mat_rgba[material]))


def _look(model: mujoco.MjModel, k: int) -> dict[str, Any]:
    """How PyVista shall draw a geom. What its material emits takes the place of what it
    reflects.
    """
    import mujoco

    material = int(model.geom_matid[k])
    (*colour, opacity) = geom_colour(model, k)
    ambient = 0.25 + 0.75 * float(
        np.clip(model.mat_emission[material], 0, 1) if material >= 0 else 0
    )
    edged = model.geom_type[k] in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_PLANE)
    return {
        "color": colour,
        "opacity": opacity,
        "ambient": ambient,
        "diffuse": 1 - ambient,
        "smooth_shading": not edged,
        "split_sharp_edges": not edged,
    }


def _as_colour(background: str) -> pyvista.Color:
    import pyvista

    try:
        return pyvista.Color(background)
    except (TypeError, ValueError):
        raise ValueError(f"background: expected a colour, got {background!r}") from None


def can_render(plotter: pyvista.Plotter) -> None:
    """VTK ends the process where it has neither a display nor EGL, and falls back on a library that
    is not there.
    """
    if (
        plotter.render_window is None
        or plotter.render_window.GetClassName() != "vtkOSOpenGLRenderWindow"
    ):
        return
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
            return
        except OSError:
            continue
    plotter.close()
    raise ValueError(
        "this machine cannot render without a display (Debian packages: libegl1, libgl1-mesa-dri)"
    )


@dataclass(frozen=True, eq=False)
class ForceArrow:
    """A force, drawn as an arrow from the point where it acts; a missing one (NaN), or none at all,
    is not.

    Attributes
    ----------
    origin_mm : ndarray, shape (3,)
        World frame.
    force_n : ndarray, shape (3,)
        World frame, N.
    mm_per_n : float
        Length of the arrow, mm/N.
    radius_mm : float
        Of its shaft; less where the arrow is short.
    """

    origin_mm: Array
    force_n: Array
    mm_per_n: float = 10.0
    radius_mm: float = 4.0

    def __post_init__(self) -> None:
        for name in ("origin_mm", "force_n"):
            object.__setattr__(self, name, as_array(getattr(self, name), name, (3,), finite=False))
        check_numbers(self, "mm_per_n", "radius_mm", low=0.0, open_low=True)

    @property
    def tip_mm(self) -> Array:
        """Where the arrow ends, world frame, shape (3,), mm."""
        return frozen(self.origin_mm + self.mm_per_n * self.force_n)


class SlaveView:
    """The picture that a calibrated camera takes of a MuJoCo scene; a context manager.

    Lens distortion is applied to the rendered picture, bilinearly; pixels that no ideal point maps
    to show the background.

    Parameters
    ----------
    model : mujoco.MjModel
    camera : Camera
        World frame: the robot's, mm.
    background : str
        A colour.

    Raises
    ------
    ValueError
        For anything but a model and a camera, a geom that is no simple shape (see `geom_scene`), an
        image of more than `MOST_PX` pixels per side, a lens that needs a picture more than `WIDEST`
        times as large, or a machine that cannot render.
    """

    def __init__(self, model: mujoco.MjModel, camera: Camera, background: str = "white") -> None:
        if not isinstance(camera, Camera):
            raise ValueError(f"camera: expected a Camera, got {type(camera).__name__}")
        self.camera, self._model = camera, model
        self._ideal = _undistorted(camera)
        self._plotter, self._actors = geom_scene(model, background)
        self._plotter.window_size = self._ideal.size
        self._fill = self._plotter.background_color.int_rgb
        self._arrow: pyvista.Actor | None = None
        _aim(self._plotter, camera)

    def render(self, data: mujoco.MjData, force: ForceArrow | None = None) -> np.ndarray:
        """The picture of one state.

        Parameters
        ----------
        data : mujoco.MjData
            Its geom_xpos (m) and geom_xmat are used: call mj_forward, or step, before. A geom whose
            pose is not finite is left out.
        force : ForceArrow, optional

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Red first, indexed [v, u].

        Raises
        ------
        ValueError
            If the data are those of another model, or the view is closed.
        """
        if self._plotter.render_window is None:
            raise ValueError("view: expected an open one, got one that is closed")
        if np.shape(getattr(data, "geom_xpos", ())) != (self._model.ngeom, 3):
            raise ValueError(
                f"data: expected the MjData of this model with {self._model.ngeom} geoms, "
                f"got {type(data).__name__}"
            )
        if not isinstance(force, ForceArrow | None):
            raise ValueError(f"force: expected a ForceArrow, got {type(force).__name__}")
        for k, actor in self._actors.items():
            place(actor, data.geom_xpos[k], data.geom_xmat[k])
        self._draw(force)
        picture = self._snap()
        if self._ideal.map_uv is None:
            return picture
        return np.asarray(
            cv2.remap(picture, *self._ideal.map_uv, cv2.INTER_LINEAR, borderValue=self._fill)
        )

    def close(self) -> None:
        """Give the memory of the renderer back; the view cannot render any more."""
        self._plotter.close()

    def __enter__(self) -> SlaveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _draw(self, force: ForceArrow | None) -> None:
        shape = None if force is None else _arrow(force)
        if shape is not None and self._arrow is None:
            self._arrow = self._plotter.add_mesh(
                shape,
                color=FORCE_COLOUR,
                ambient=0.5,
                diffuse=0.5,
                reset_camera=False,
                render=False,
            )
        elif shape is not None and self._arrow is not None:
            self._arrow.mapper.dataset = shape
        if self._arrow is not None:
            self._arrow.visibility = shape is not None

    def _snap(self) -> np.ndarray:
        """What the ideal camera sees, shape (height, width, 3), uint8."""
        _project(self._plotter, self.camera, self._ideal)
        self._plotter.render()
        return np.ascontiguousarray(np.asarray(self._plotter.screenshot(return_img=True))[..., :3])


class _Ideal(NamedTuple):
    """The picture without lens distortion: its size, principal point (px), and where each pixel of
    the image lies.
    """

    size: tuple[int, int]
    centre: Array
    # columns and rows, (height, width), float32
    map_uv: tuple[np.ndarray, np.ndarray] | None = None


def _undistorted(camera: Camera) -> _Ideal:
    """The smallest ideal picture that holds all that the camera sees."""
    if max(camera.size) > MOST_PX:
        raise ValueError(
            f"camera: expected an image of at most {MOST_PX} px per side, got {camera.size}"
        )
    if not camera.distortions.any():
        return _Ideal(camera.size, camera.principal_point)
    width, height = camera.size
    uv = camera.ideal_pixels(np.indices((height, width))[::-1].reshape(2, -1).T)
    known = uv[np.isfinite(uv[:, 0])]
    low, high = (
        (np.floor(known.min(axis=0)) - 1, np.ceil(known.max(axis=0)) + 1)
        if len(known)
        else (0, np.inf)
    )
    size = np.broadcast_to(high - low + 1, 2)
    if (size > np.minimum(WIDEST * np.array(camera.size) + 4, MOST_PX)).any():
        raise ValueError(
            f"camera: expected a lens whose picture without distortion is at most {WIDEST:g} times as "
            f"large, got distortions {camera.distortions.tolist()}"
        )
    map_u, map_v = np.nan_to_num(uv - low, nan=-9.0).astype(np.float32).T.reshape(2, height, width)
    return _Ideal((int(size[0]), int(size[1])), camera.principal_point - low, (map_u, map_v))


def _aim(plotter: pyvista.Plotter, camera: Camera) -> None:
    rotation = camera.T_world_cam.rotation.as_matrix()
    plotter.camera_set = True  # else PyVista would choose one at the first picture
    plotter.camera.SetPosition(*camera.centre)
    plotter.camera.SetFocalPoint(*(camera.centre + 1000.0 * rotation[:, 2]))
    plotter.camera.SetViewUp(*-rotation[:, 1])


def _project(plotter: pyvista.Plotter, camera: Camera, ideal: _Ideal) -> None:
    """Set the projection to the camera's, with the near and the far plane around what there is.

    OpenGL's eye looks along -z with y up, and its picture spans the pixels' edges: -1 is at u =
    -0.5 px.
    """
    import pyvista

    near, far = _depths(np.array(plotter.renderer.ComputeVisiblePropBounds()), camera)
    (fx, fy) = 2 * camera.focal / ideal.size
    (cx, cy) = 1 - (2 * ideal.centre + 1) / ideal.size
    depth = (far + near) / (near - far), 2 * far * near / (near - far)
    matrix = np.array([[fx, 0, cx, 0], [0, fy, -cy, 0], [0, 0, *depth], [0, 0, -1, 0]])
    plotter.camera.SetExplicitProjectionTransformMatrix(pyvista.vtkmatrix_from_array(matrix))
    plotter.camera.SetUseExplicitProjectionTransformMatrix(True)


def _depths(bounds: np.ndarray, camera: Camera) -> tuple[float, float]:
    """Depths (mm) between which what is in front of the camera lies, of a box with bounds (6,) as
    VTK has them, mm.
    """
    corners = np.array(np.meshgrid(*bounds.reshape(3, 2))).reshape(3, -1).T
    depth = camera.T_cam_world.apply(corners)[:, 2]
    far = 1.01 * depth.max()
    if (bounds[::2] > bounds[1::2]).any() or far <= 0:
        return 1.0, 2.0  # nothing to be seen
    return max(0.99 * float(depth.min()), far / DEEPEST), far


def _arrow(force: ForceArrow) -> pyvista.PolyData | None:
    """An arrow from the force's origin to its tip, mm; None if there is none to draw."""
    import pyvista

    direction = force.tip_mm - force.origin_mm
    length = float(np.linalg.norm(direction))
    if not 1e-6 < length < 1e6:
        return None
    radius = min(force.radius_mm / length, 0.08)  # all by the arrow's length
    return pyvista.Arrow(
        start=force.origin_mm,
        direction=frozen(direction),
        scale=length,
        shaft_radius=radius,
        tip_radius=2.5 * radius,
        tip_length=6 * radius,
    )
