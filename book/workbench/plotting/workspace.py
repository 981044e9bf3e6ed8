"""The workspace: cones, their intersection and the cameras, in sections and in three dimensions."""

from __future__ import annotations

import html
import io
import json
import zipfile
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from trinolab.checks import Array, as_points
from trinolab.workspace.cones import Cone, cone_surface

from .basics import COLOURS, subplots

if TYPE_CHECKING:
    import pyvista

WORKSPACE_COLOUR = "#CC79A7"
SEEN_FROM = np.array([900.0, 500.0, 900.0])  # the scene's first view: from the middle backwards, mm
NAME_HEIGHT = 36.0  # of a camera's name in the scene, mm
VIEWS = (("from above", 0, 2), ("along the line of sight", 0, 1), ("from the side", 2, 1))
Mesh = tuple[Array, np.ndarray]  # vertices (n, 3), triangles (m, 3)


def plot_workspace(cones: Sequence[Cone], mesh: Mesh, names: Sequence[str] | None = None) -> Figure:
    """Three orthogonal views of cones and of the convex workspace inside them, axes in mm.

    Parameters
    ----------
    cones : sequence of Cone
    mesh : (vertices, triangles)
        As `intersection.surface_mesh` or a `Polyhedron` gives them, mm.
    names : sequence of str, optional
        One a cone.
    """
    vertices = as_points(mesh[0], "mesh", 3)
    figure, axes = subplots(1, 3, figsize=(6.9, 3.3))
    for ax, (title, i, j) in zip(axes, VIEWS, strict=True):
        for k, (cone, name) in enumerate(zip(cones, _names(cones, names), strict=True)):
            _fill(ax, _outline(cone, vertices)[:, [i, j]], COLOURS[k % len(COLOURS)], 0.12, name)
            ax.plot(*cone.apex[[i, j]], "o", color=COLOURS[k % len(COLOURS)], markersize=5)
        _fill(ax, vertices[:, [i, j]], WORKSPACE_COLOUR, 0.75, "workspace")
        ax.set(
            xlabel=f"${'xyz'[i]}$ / mm",
            ylabel=f"${'xyz'[j]}$ / mm",
            aspect="equal",
        )
        ax.set_title(title, fontsize=10)
        if j == 1:
            ax.invert_yaxis()  # y points down
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def show_cones_from_above(
    cones: Sequence[Cone],
    names: Sequence[str],
    title: str,
    ax: Axes,
    reach: float,
    letters: bool = False,
) -> None:
    """A plan of cones, cut at the height of the first one's apex: OXYZ's X to the right, Z upwards.

    Parameters
    ----------
    cones : sequence of Cone
        A cone whose axis lies in the plan is a wedge; one that looks along Y is a dashed circle, its
        cut; any other place in between is drawn by its outline from above, dashed.
    names : sequence of str
        One a cone.
    title : str
    ax : Axes
    reach : float
        How far a wedge is drawn, in the cones' unit.
    letters : bool
        Whether to write the paper's letters at the first two cones: B, the angles beta, and the
        place (x0, z0) where the axes meet.
    """
    for cone, name, colour in zip(cones, names, COLOURS, strict=False):
        x, height, z = cone.apex - [0.0, cones[0].apex[1], 0.0]
        style = "-" if abs(height) < 1e-9 else "--"
        if abs(cone.axis[1]) > 1 - 1e-9:
            radius = abs(height) * np.tan(cone.half_angle)
            t = np.linspace(0, 2 * np.pi, 73)
            outline = np.column_stack([x + radius * np.cos(t), z + radius * np.sin(t)])
        else:
            middle = np.arctan2(cone.axis[2], cone.axis[0])
            turned = middle + np.array([-1, 1]) * cone.half_angle
            ends = np.column_stack([np.cos(turned), np.sin(turned)]) * reach
            outline = np.vstack([[x, z], [x, z] + ends])
            far = reach * np.array([np.cos(middle), np.sin(middle)])
            ax.plot(*np.array([[x, z], [x, z] + far]).T, "-.", color=colour, linewidth=0.8)
        ax.fill(*outline.T, facecolor=colour, alpha=0.25, label=name)
        ax.fill(*outline.T, fill=False, edgecolor=colour, linestyle=style)
        ax.plot(x, z, "o" if style == "-" else "s", color=colour)
    if letters:
        _write_letters(ax, cones, reach / 10)
    middle_x = (cones[0].apex[0] + cones[1].apex[0]) / 2
    wide = 0.65 * reach if letters else 1.3 * reach  # printed cones look apart
    ax.set(
        xlabel="$X / B$",
        ylabel="$Z / B$",
        aspect="equal",
        xlim=(middle_x - wide, middle_x + wide),
        ylim=(-0.35 * reach, 1.05 * reach),
    )
    ax.set_title(title, fontsize=10)


def _write_letters(ax: Axes, cones: Sequence[Cone], step: float) -> None:
    """B, beta_1, beta_2, x0 and z0 of two cones whose apexes lie on X; letters are a step high."""
    (a, _, _), (b, _, _) = cones[0].apex, cones[1].apex
    slopes = [cone.axis[2] / cone.axis[0] for cone in cones[:2]]
    x0 = (slopes[0] * a - slopes[1] * b) / (slopes[0] - slopes[1])
    z0 = slopes[0] * (x0 - a)
    for end, height, text in ((x0, -0.5, "$x_0$"), (b, -2.0, "$B$")):
        arrow = {"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", (a, height * step), (end, height * step), arrowprops=arrow)
        ax.text((a + end) / 2, (height - 0.1) * step, text, ha="center", va="top")
    ax.plot([x0, x0], [0, z0], ":", color="black", linewidth=1)
    ax.text(x0, z0 / 4, " $z_0$", va="center")
    ax.plot(x0, z0, "o", color="black", markersize=4)
    for start, text, side in ((a, r"$\beta_1$", 1), (b, r"$\beta_2$", -1)):
        ax.text(start + 1.1 * step * side, 0.1 * step, text, ha="center", va="bottom")


def workspace_scene(
    cones: Sequence[Cone], mesh: Mesh, height: int = 420, names: Sequence[str] | None = None
) -> Any:
    """A scene that can be turned in the page, without a server or a display: cones, their apexes
    with their names, the workspace.

    Returns
    -------
    IPython.display.HTML
        An iframe that holds the whole scene (about 1 MB). Axes: x red, y green, z blue, 50 mm long.
        Without PyVista, which a student's small installation leaves out, a line that says so.
    """
    from IPython.display import HTML

    if find_spec("pyvista") is None:
        return HTML(
            "<p>Here stands a scene that can be turned: <code>pip install pyvista[jupyter]</code></p>"
        )
    page = html.escape(_scene_page(workspace_plotter(cones, mesh, names)))
    return HTML(
        f'<div><iframe srcdoc="{page}" width="100%" height="{int(height)}" style="border:0; background:white" '
        'title="workspace, turnable"></iframe></div>'
    )


def workspace_plotter(
    cones: Sequence[Cone], mesh: Mesh, names: Sequence[str] | None = None
) -> pyvista.Plotter:
    """The scene of `workspace_scene` as a PyVista plotter; nothing is rendered yet."""
    import pyvista

    vertices, triangles = mesh
    # a machine without a display is no matter: nothing is rendered here
    with pyvista.vtk_verbosity("off"):
        plotter = pyvista.Plotter(off_screen=True)
    plotter.renderer.set_background("white")
    middle = vertices.mean(axis=0)
    # clear of the cones
    solid = pyvista.PolyData.from_regular_faces(middle + 0.99 * (vertices - middle), triangles)
    plotter.add_mesh(solid, color=WORKSPACE_COLOUR, ambient=0.4)
    for k, cone in enumerate(cones):
        surface = pyvista.PolyData.from_regular_faces(*_cone_mesh(cone, vertices))
        plotter.add_mesh(surface, color=COLOURS[k % len(COLOURS)], opacity=0.2, ambient=0.4)
        plotter.add_mesh(
            pyvista.Sphere(radius=6.0, center=cone.apex), color=COLOURS[k % len(COLOURS)]
        )
    apexes = np.array([cone.apex for cone in cones])
    for k, name in enumerate(() if names is None else _names(cones, names)):
        colour = COLOURS[k % len(COLOURS)]
        letters = _written(name, apexes, k)
        plotter.add_mesh(letters, name=name, color=colour, ambient=0.5, diffuse=0.5)
    for direction, colour in zip(np.eye(3), ("red", "green", "blue"), strict=True):
        plotter.add_mesh(
            pyvista.Line((0.0, 0.0, 0.0), 50.0 * direction), color=colour, line_width=4
        )
    plotter.camera_position = [
        tuple(middle - SEEN_FROM),
        tuple(middle),
        (0.0, -1.0, 0.0),
    ]
    plotter.renderer.ResetCamera()
    return plotter


def _written(name: str, apexes: Array, k: int) -> pyvista.PolyData:
    """A camera's name beside its apex, away from the nearest other one, upright in the first view.

    It is a body like all others: labels and overlays do not come along into the page.
    """
    import pyvista

    ahead = SEEN_FROM / np.linalg.norm(SEEN_FROM)
    right = np.cross(ahead, [0.0, -1.0, 0.0])
    right = right / np.linalg.norm(right)
    up = np.cross(right, ahead)
    away = np.array([0.0, -1.0, 0.0])
    if len(apexes) > 1:
        off = apexes[k] - np.delete(apexes, k, axis=0)
        away = off[np.linalg.norm(off, axis=1).argmin()]
    away = away - (away @ ahead) * ahead  # in the plane of the view
    away = away / max(np.linalg.norm(away), 1e-9)

    text = pyvista.Text3D(name, depth=0.0, height=NAME_HEIGHT, center=(0.0, 0.0, 0.0))
    wide = text.bounds.x_max
    shift = (NAME_HEIGHT / 2 + (wide + NAME_HEIGHT / 2) * abs(away @ right)) * away
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, up, -ahead])
    pose[:3, 3] = apexes[k] + shift
    return text.transform(pose, inplace=False)


def _scene_page(plotter: pyvista.Plotter) -> str:
    """A page that holds the scene and vtk.js.

    PyVista's own export starts a web server for this and lets it look for downloads; the parts are
    taken directly.
    """
    from trame_vtk.modules.vtk import serializers
    from trame_vtk.tools.vtksz2html import write_html

    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    window = plotter.render_window
    scene = serializers.serialize(None, window, serializers.reference_id(window), context, 1)
    scene["extra"] = {
        "vtkRefId": scene["id"],
        "centerOfRotation": plotter.camera.focal_point,
        "camera": serializers.reference_id(plotter.camera),
    }
    arrays = {
        entry["hash"]: {**entry, "content": context.get_cached_data_array(entry["hash"], False)}
        for entry in serializers.extract_array_hash(scene)
    }
    packed = io.BytesIO()
    page = io.StringIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"hashes": arrays, "scene": scene}))
    write_html(packed.getvalue(), page)
    return page.getvalue()


def _outline(cone: Cone, vertices: Array) -> Array:
    """The apex, and a circle on the cone as far away as the farthest vertex, shape (n, 3)."""
    depth = float(((vertices - cone.apex) @ cone.axis).max())
    t = np.linspace(0, 2 * np.pi, 73)
    return np.vstack(
        [cone.apex, cone_surface(cone, np.full(73, depth * np.tan(cone.half_angle)), t)]
    )


def _cone_mesh(cone: Cone, vertices: Array) -> Mesh:
    points = _outline(cone, vertices)
    k = np.arange(1, len(points) - 1)
    return points, np.column_stack([np.zeros_like(k), k, k + 1])


def _fill(ax: Axes, points: Array, colour: str, alpha: float, label: str) -> None:
    """Fill the silhouette of convex points."""
    border = points[ConvexHull(points).vertices]
    ax.fill(border[:, 0], border[:, 1], facecolor=colour, alpha=alpha, label=label)
    ax.fill(border[:, 0], border[:, 1], fill=False, edgecolor=colour, linewidth=1.0)


def _names(cones: Sequence[Cone], names: Sequence[str] | None) -> Sequence[str]:
    if names is not None and len(names) != len(cones):
        raise ValueError(f"names: expected {len(cones)}, one a cone, got {len(names)}")
    return names if names is not None else [f"cone {k + 1}" for k in range(len(cones))]
