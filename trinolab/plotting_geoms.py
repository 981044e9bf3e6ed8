"""A MuJoCo model's geoms as a PyVista scene in mm, posed anew from state to state."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import mujoco
    import pyvista

HIDDEN_GROUP = 3  # MuJoCo's habit: geoms of this group and above are for collisions, or not for the eye
ENDLESS = 10.0  # half the side of an endless plane, by the model's extent (stat.extent)
UNSET = (0.5, 0.5, 0.5, 1.0)  # a geom's colour in MuJoCo if nothing is said; then the material's holds


class GeomScene(NamedTuple):
    """A PyVista scene of a model's geoms: the plotter, and the actors by the geoms' numbers."""

    plotter: pyvista.Plotter
    actors: dict[int, pyvista.Actor]


def geom_scene(model: mujoco.MjModel, background: str = "white") -> GeomScene:
    """A model's geoms as a PyVista scene, each about its own origin, in mm; nothing is rendered yet.

    Geoms of group 3 and above and wholly transparent ones are left out, textures too. A plane without a size
    reaches from its origin as far as ten times the model's extent.

    Raises
    ------
    ValueError
        For anything but a model, a geom to be drawn that is no plane, sphere, capsule, ellipsoid, cylinder or box, or
        a machine that cannot render without a display.
    """
    import mujoco
    import pyvista

    if not isinstance(model, mujoco.MjModel):
        raise ValueError(f"model: expected a mujoco.MjModel, got {type(model).__name__}")
    shown = [k for k in range(model.ngeom) if model.geom_group[k] < HIDDEN_GROUP and _colour(model, k)[3] > 0]
    shapes = {k: _shape(model, k) for k in shown}
    fill = _as_colour(background)
    with pyvista.vtk_verbosity("off"):  # a machine without a display is no matter
        plotter = pyvista.Plotter(off_screen=True, lighting="none")
    _can_render(plotter)
    plotter.background_color = fill
    plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.55))
    plotter.add_light(pyvista.Light(position=(-0.4, -0.6, 1.0), light_type="scene light", intensity=0.6))
    actors = {k: plotter.add_mesh(shapes[k], reset_camera=False, render=False, **_look(model, k)) for k in shown}
    return GeomScene(plotter, actors)


def place(actor: pyvista.Actor, position_m: np.ndarray, rotation: np.ndarray) -> None:
    """Move an actor to a pose of MuJoCo's: position (3,) in m, rotation matrix (9,), row by row."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), 1000.0 * position_m
    actor.visibility = bool(np.isfinite(pose).all())
    if actor.visibility:
        actor.user_matrix = pose


def _shape(model: mujoco.MjModel, k: int) -> pyvista.PolyData:
    """The surface of a geom about its own origin, mm."""
    import mujoco
    import pyvista

    kind, (a, b, c) = mujoco.mjtGeom(model.geom_type[k]), 1000.0 * model.geom_size[k]
    upright: dict[str, Any] = {"direction": (0, 0, 1), "radius": a}
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        endless = 2000.0 * ENDLESS * model.stat.extent
        return pyvista.Plane(i_size=2 * a or endless, j_size=2 * b or endless, i_resolution=1, j_resolution=1)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return pyvista.Box((-a, a, -b, b, -c, c))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return pyvista.Cylinder(**upright, height=2 * b, resolution=48)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return pyvista.Capsule(**upright, cylinder_length=2 * b)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return pyvista.Sphere(radius=1.0).scale([a, b, c] if b else a)
    name = kind.name.removeprefix("mjGEOM_").lower()
    raise ValueError(f"model: expected simple shapes, got geom {k} ({model.geom(k).name or 'no name'}): {name}")


def _colour(model: mujoco.MjModel, k: int) -> tuple[float, ...]:
    """Red, green, blue, opacity of a geom, 0 to 1: its own, or where nothing is said its material's."""
    own, material = tuple(map(float, model.geom_rgba[k])), int(model.geom_matid[k])
    return own if material < 0 or own != UNSET else tuple(map(float, model.mat_rgba[material]))


def _look(model: mujoco.MjModel, k: int) -> dict[str, Any]:
    """How PyVista shall draw a geom. What its material emits takes the place of what it reflects."""
    import mujoco

    material, (*colour, opacity) = int(model.geom_matid[k]), _colour(model, k)
    ambient = 0.25 + 0.75 * float(np.clip(model.mat_emission[material], 0, 1) if material >= 0 else 0)
    edged = model.geom_type[k] in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_PLANE)
    return {"color": colour, "opacity": opacity, "ambient": ambient, "diffuse": 1 - ambient,
            "smooth_shading": not edged, "split_sharp_edges": not edged}


def _as_colour(background: str) -> pyvista.Color:
    import pyvista

    try:
        return pyvista.Color(background)
    except (TypeError, ValueError):
        raise ValueError(f"background: expected a colour, got {background!r}") from None


def _can_render(plotter: pyvista.Plotter) -> None:
    """VTK ends the process where it has neither a display nor EGL, and falls back on a library that is not there."""
    if plotter.render_window is None or plotter.render_window.GetClassName() != "vtkOSOpenGLRenderWindow":
        return
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
            return
        except OSError:
            continue
    plotter.close()
    raise ValueError("this machine cannot render without a display (Debian packages: libegl1, libgl1-mesa-dri)")
