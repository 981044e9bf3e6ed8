"""The applets of the chapters: a Sphinx extension that loads an applet's script on the pages that
have a place for it.

A place is ``<div class="applet" data-applet="NAME">`` in a chapter, with a text for where no script
runs, and the applet is ``book/_static/applets/NAME.js``. What it needs to know it finds in
``window.trinolabAppletData``: the chapter's own parameters, and under its name what `DATA` computes
with the package, so that no number is typed a second time.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from docutils import nodes

__all__ = ["data_of", "depth", "epipolar", "setup"]

PLACE = re.compile(r'data-applet="(\w+)"')
# nearly upright: an epipolar line of CCD3 passes through both markers of a column, one of CCD2 through a row
UPRIGHT = ((0.0, 0.0, 560.0), (-1.0, 6.0, -8.0))  # mm; alpha, beta, gamma, deg
CROP = (160, 200)  # px, width and height of the part of an image that the epipolar applet shows


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("html-page-context", _load)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _load(app: Any, page: str, template: str, context: dict[str, Any], document: Any) -> None:
    """Add the scripts to one page, if it has a place for an applet."""
    raw = document.findall(nodes.raw) if document is not None else ()
    names = [name for node in raw for name in PLACE.findall(node.astext())]
    if not names:
        return
    data = data_of(Path(app.srcdir) / f"{page}.ipynb", names)
    app.add_css_file("applets/applets.css")
    app.add_js_file(None, body=f"window.trinolabAppletData = {json.dumps(data)};")
    for name in ("shared", *names):
        app.add_js_file(f"applets/{name}.js", loading_method="defer")


def data_of(chapter: Path, names: list[str]) -> dict[str, Any]:
    """What the applets of a chapter need to know."""
    from ..sweep.notebook import read_parameters

    data = {name: DATA[name]() for name in names if name in DATA}
    return {"parameters": read_parameters(chapter), **data}


def epipolar() -> dict[str, Any]:
    """Three cameras, and what they see of the paper's handle: a part of each rendered image, and
    where the markers truly are in it.
    """
    from trinolab.bench import optics, scene
    from trinolab.datasets import load_handle, load_rig
    from trinolab.handle import facing_pixels
    from trinolab.matching import MatchParameters
    from trinolab.metrics import pose_from_euler_deg

    rig, handle = load_rig("raised_40deg"), load_handle("paper")
    pose = pose_from_euler_deg(*UPRIGHT)
    images = scene.render_rig(rig, handle, pose, optics.Bench(), np.random.default_rng(0))
    cameras = []
    for camera, image in zip(rig.cameras, images, strict=True):
        middle = camera.project(pose.apply([[0.0, 0.0, 0.0]]))[0]
        corner = np.rint(middle - np.array(CROP) / 2).astype(int)
        part = image[corner[1] : corner[1] + CROP[1], corner[0] : corner[0] + CROP[0]]
        markers = facing_pixels(handle, camera, pose, 70.0)
        cameras.append(
            {
                "name": camera.name.upper(),
                "matrix": camera.matrix.tolist(),
                "rotation": camera.T_cam_world.rotation.as_matrix().tolist(),
                "translation": camera.T_cam_world.translation.tolist(),
                "corner": corner.tolist(),
                "size": [part.shape[1], part.shape[0]],
                "grey": base64.b64encode(part.tobytes()).decode(),
                "markers": [row.tolist() if np.isfinite(row).all() else None for row in markers],
            }
        )
    return {"cameras": cameras, "window_px": MatchParameters().window_px}


def depth() -> dict[str, float]:
    """The paper's pair of cameras in a few numbers: its mean focal length, its baseline, the angle
    between its axes, and how far away Table 1's positions are.
    """
    from trinolab.datasets import load_rig, load_table1

    first, second = load_rig("paper_pair").cameras
    between = np.rad2deg(np.arccos(first.axis @ second.axis))
    away = load_table1().set_poses.translation[:, 2].mean()
    return {
        "focal_px": float(np.round(np.mean([first.focal, second.focal]))),
        "width_px": first.size[0],
        "baseline_mm": float(np.linalg.norm(second.centre - first.centre).round(1)),
        "vergence_deg": float(between.round(1)),
        "distance_mm": float(away.round()),
    }


DATA: dict[str, Callable[[], dict[str, Any]]] = {"epipolar": epipolar, "depth": depth}
