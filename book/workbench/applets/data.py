"""What the applets need of the book, computed with the package when a page is built or a cell is run."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

# nearly upright: an epipolar line of CCD3 passes through both markers of a column, one of CCD2 through a row
UPRIGHT = ((0.0, 0.0, 560.0), (-1.0, 6.0, -8.0))  # mm; alpha, beta, gamma, deg
CROP = (160, 200)  # px, width and height of the part of an image that the epipolar applet shows
# of the games: instants in which the rules differ
NEXT_SEED, NEXT_S = 4, 2.0
PAIRS_SEED, PAIRS_OFF_PX, PAIRS_GATE_PX = 6, 3.0, 8.0
PAIRS_FRAMES, PAIRS_MARGIN = ((2, 12), (3, 17), (2, 47)), 20  # seed of a recording, frame; px
THRESHOLD_SEED, THRESHOLD_FRAMES = 1, ((4, 0), (14, 1), (34, 1), (48, 0), (58, 2))
WIDE, COARSE = (960, 768), 12  # px: of a part of an image, and every twelfth pixel of it


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


def nextplace(
    jerk_intensity: float, sigma_px: float, velocity_sigma: float, acceleration_sigma: float
) -> dict[str, Any]:
    """The way of a handle's middle through CCD1's images in a person's hand, observed with noise, and
    where three rules expect it: each place from those before it alone.
    """
    from trinolab import image_track
    from trinolab.datasets import load_rig
    from trinolab.kalman import KalmanParameters

    from ..studies.tuning import drawn_poses

    camera = load_rig("raised_40deg").cameras[0]
    times, poses = drawn_poses(NEXT_SEED, NEXT_S)
    noise = np.random.default_rng(NEXT_SEED).normal(0.0, sigma_px, (len(times), 2))
    z = camera.project(poses.translation) + noise
    p = KalmanParameters(jerk_intensity, sigma_px, velocity_sigma, acceleration_sigma)
    expected = image_track.track(times, z, p, False).predicted.mean[:, :2]
    rules = {
        "last place": z[:-1],
        "last step": np.concatenate([z[:1], 2 * z[1:-1] - z[:-2]]),
        "the filter": expected[1:],
    }
    return {
        "places": z.round(1).tolist(),
        "rules": {name: [None, *places.round(1).tolist()] for name, places in rules.items()},
        "size": list(camera.size),
    }


def pairs(ncc_threshold: float) -> dict[str, Any]:
    """Spots of CCD1 and CCD3 in a few instants of recordings: a part of each image, the true marker
    of each spot, its epipolar line in the other image, and how three rules pair them. The rig is
    believed to be a little other than it is, so that the lines lie beside their markers.
    """
    from trinolab import matching
    from trinolab.bench.rendering import scripted
    from trinolab.bench.scenario import take
    from trinolab.camera import epipolar_lines
    from trinolab.datasets import load_handle, load_rig
    from trinolab.markers import find_markers
    from trinolab.measurement import measure
    from trinolab.parameters import Parameters

    from ..studies import match_rivals
    from ..studies.broken import covariance_of_such, miscalibrated
    from ..studies.claim_trials import true_labels

    rig, handle = load_rig("raised_40deg"), load_handle("paper")
    believed = miscalibrated(rig, PAIRS_OFF_PX, 0.0, np.random.default_rng(PAIRS_SEED))
    told = replace(believed, covariance=covariance_of_such(believed, PAIRS_OFF_PX, 0.0))
    settings = matching.MatchParameters(epipolar_gate_px=PAIRS_GATE_PX, ncc_threshold=ncc_threshold)
    shots = []
    for seed, frame in PAIRS_FRAMES:
        job = scripted("hard", rig, handle, seed, 2.0)
        images = tuple(take(job, frame, index) for index in range(len(rig.cameras)))
        uv = tuple(
            find_markers(image, len(handle.marker_centres), handle.markers).uv for image in images
        )
        labels = [
            true_labels(rig.cameras[k], handle, job.shots[frame].T_world_handle, uv[k])
            for k in (0, 2)
        ]
        left, right = believed.cameras[0], believed.cameras[2]
        views = (left, right, images[0], images[2], uv[0], uv[2])
        D = matching.epipolar_distances(left, right, uv[0], uv[2])
        p = Parameters(matching=settings, estimator="paper")
        named = measure(images, told, handle, parameters=p).labels
        found = {
            "nearest line": match_rivals.by_line(
                match_rivals.Spots(D, np.zeros_like(D)), PAIRS_GATE_PX
            ),
            "four constraints": matching.match(*views, settings).index,
            "the layout": match_rivals.by_layout(named[0], named[2]),
        }
        shots.append(
            {
                "views": [_spots(images[k], uv[k], rig.cameras[k].name) for k in (0, 2)],
                "labels": [one.tolist() for one in labels],
                "lines": epipolar_lines(left, right, uv[0]).tolist(),
                "rules": {name: index.tolist() for name, index in found.items()},
            }
        )
    return {"shots": shots}


def _spots(image: np.ndarray, uv: np.ndarray, name: str) -> dict[str, Any]:
    """The part of an image about its spots, as a JPEG, and the spots in it."""
    low = np.maximum(np.floor(uv.min(axis=0)).astype(int) - PAIRS_MARGIN, 0)
    high = np.ceil(uv.max(axis=0)).astype(int) + PAIRS_MARGIN
    part = image[low[1] : high[1], low[0] : high[0]]
    written = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    return {
        "name": name.upper(),
        "picture": f"data:image/jpeg;base64,{base64.b64encode(written).decode()}",
        "size": [part.shape[1], part.shape[0]],
        "corner": low.tolist(),
        "spots": uv.round(2).tolist(),
    }


def threshold(difference_threshold: float) -> dict[str, Any]:
    """Frames of a recording and their background, both coarse, with the truth of what moves in them,
    and the thresholds that two rules choose.
    """
    from trinolab.bench.rendering import scripted
    from trinolab.bench.scenario import empty, take
    from trinolab.datasets import load_handle, load_rig

    from ..studies.ground_truth import cover

    rig, handle = load_rig("raised_40deg"), load_handle("coded")
    job = scripted("hard", rig, handle, THRESHOLD_SEED, 2.0)
    rounds = []
    for frame, index in THRESHOLD_FRAMES:
        grey, before = take(job, frame, index), empty(job, index)
        moves = cover(job, frame, index) > 0.5
        middle = np.argwhere(moves).mean(axis=0)[::-1]
        corner = np.clip(np.rint(middle - np.array(WIDE) / 2), 0, np.array(grey.shape[::-1]) - WIDE)
        u, v = corner.astype(int)
        parts = [one[v : v + WIDE[1] : COARSE, u : u + WIDE[0] : COARSE] for one in (grey, before)]
        truth = moves[v : v + WIDE[1] : COARSE, u : u + WIDE[0] : COARSE]
        change = cv2.absdiff(*parts)
        otsu, _ = cv2.threshold(change, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
        rounds.append(
            {
                "name": rig.cameras[index].name.upper(),
                "size": [truth.shape[1], truth.shape[0]],
                "frame": base64.b64encode(parts[0].tobytes()).decode(),
                "background": base64.b64encode(parts[1].tobytes()).decode(),
                "moves": base64.b64encode(np.packbits(truth).tobytes()).decode(),
                "rules": {"the chapter's T": difference_threshold, "Otsu's T": float(otsu)},
            }
        )
    return {"rounds": rounds}


def pointing() -> dict[str, Any]:
    """The targets of the pointing task, and how its log is written and judged."""
    from ..teleop.pointing import COLUMNS, SPREAD, conditions

    return {"targets": conditions(repeats=1).tolist(), "columns": COLUMNS, "spread": SPREAD}


# what an applet of that name is given as its `data`; the arguments are parameters of the chapter
DATA: dict[str, Callable[..., dict[str, Any]]] = {
    "depth": depth,
    "epipolar": epipolar,
    "nextplace": nextplace,
    "pairs": pairs,
    "pointing": pointing,
    "threshold": threshold,
}
