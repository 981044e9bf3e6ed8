"""What ``trinolab refine`` prints: residuals before and after, each camera's change with its
standard deviation, the markers, and the views that were left out.
"""

from __future__ import annotations

import numpy as np

from trinolab.camera import difference
from trinolab.following.refine import Refined

_MOST_VIEWS = 10  # that are printed; all of them are in the table


def as_lines(refined: Refined) -> list[str]:
    """A refinement as lines of text."""
    bundle = refined.cleaned.bundle
    used = len(refined.cleaned.instants)
    lines = [
        f"instants       {used} adjusted of {len(refined.frames)} chosen; {refined.still} of "
        f"{refined.length} show the handle still enough",
        f"residual / px  {refined.before_px:.3f} before, {refined.after_px:.3f} after, "
        f"{bundle.sigma_factor:.2f} times what the centres' covariances say",
        f"scale          {scale(refined)}",
    ]
    lines += _camera_lines(refined)
    lines += ["", "places change as T_cam_world, world to camera, turned in the camera's own frame"]
    moved = bundle.handle.marker_centres - refined.start_handle.marker_centres
    away = np.linalg.norm(moved, axis=1)
    lines += [
        "",
        f"markers of {bundle.handle.name}: moved by {np.sqrt((away**2).mean()):.4f} mm (rms), at most "
        f"{away.max():.4f} mm; each coordinate is known to {bundle.handle.placement_sigma_mm:.4f} mm",
        "",
    ]
    return lines + view_lines(refined)


def scale(refined: Refined) -> str:
    """What holds the scale."""
    length = refined.prior.length
    if length is None:
        return "by the covariances of rig and markers; no length was given"
    ends = (length.first, length.second)
    names = [refined.start_rig.names[k] if length.of == "cameras" else str(k) for k in ends]
    return f"{length.of} {names[0]} and {names[1]} are {length.mm:.4f} mm apart"


def _camera_lines(refined: Refined) -> list[str]:
    """A block of lines per camera: each parameter that could change."""
    bundle = refined.cleaned.bundle
    changes = difference(bundle.rig, refined.start_rig)
    sigmas = np.sqrt(np.diag(bundle.covariance))[: changes.size].reshape(changes.shape)
    lines = []
    for camera, change, sigma in zip(bundle.rig.cameras, changes, sigmas, strict=True):
        place = sigma[-6:].any()
        lines += ["", camera.name + ("" if place else ", the world frame")]
        for (name, unit), by, spread in zip(camera.parameters, change, sigma, strict=True):
            if spread > 0:
                factor = 180 / np.pi if unit == "rad" else 1.0
                unit_text = {"rad": " / deg", "1": ""}.get(unit, f" / {unit}")
                lines.append(
                    f"  {name + unit_text:22s} by {factor * by:10.5f} +- {factor * spread:.5f}"
                )
    return lines


def view_lines(refined: Refined) -> list[str]:
    """How many views were left out, and the first of them with their reasons."""
    out = refined.views[refined.views["status"] == "left out"]
    lines = [f"views left out: {len(out) or 'none'}"]
    lines += [
        f"  {row.camera}, frame {row.frame}: {row.reason}"
        for row in out.head(_MOST_VIEWS).itertuples()
    ]
    if len(out) > _MOST_VIEWS:
        lines.append(f"  and {len(out) - _MOST_VIEWS} more, see views.csv")
    return lines
