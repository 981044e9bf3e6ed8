"""One draw of each trial of the protocol: what chance decides once, and what every check makes of it.

A draw gives each of its checks two numbers (a, b). Over all draws the value of the check is sum a /
sum b, see `claims.estimated`: for a share a is 1 or 0, and b is 1. A draw that says nothing about a
check has b = 0. Draw k of a trial has a generator of its own, of (seed, k), so that it can be made
alone.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.background import BackgroundParameters
from trinolab.bench.hand import Arm, true_visibility
from trinolab.bench.motion import smooth_motion
from trinolab.bench.optics import Bench
from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import take
from trinolab.bench.scene import render, render_clip, render_rig
from trinolab.camera import Camera, Rig
from trinolab.checks import Array
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle, facing_pixels
from trinolab.identity import labelled_pixels
from trinolab.image_track import run, search_window, track
from trinolab.kalman import (
    KalmanParameters,
    State,
    constant_acceleration,
    predict_motion,
    update,
    white_jerk,
)
from trinolab.matching import MatchParameters, match
from trinolab.measurement import Measurement, measure
from trinolab.methods import BEST
from trinolab.metrics import PoseErrors, pose_errors
from trinolab.parameters import Parameters
from trinolab.pose import rigid_fit
from trinolab.slave.arm import Robot, load_robot
from trinolab.tracker import TrackerState, start, step
from trinolab.triangulation import triangulate, triangulate_weighted
from trinolab.window import Window

from . import factors, master_slave
from .claim_trials import (
    FPS,
    SAME_PX,
    nearest,
    searched,
    share_close,
    share_of_image,
    true_labels,
)
from .replication import (
    EVERY,
    estimates_and_truths,
    measure_frames,
    replication_errors,
    shared_poses,
)
from .simulated_calibration import Board, calibration_errors, simulated_calibration

Draw = dict[str, tuple[float, float]]

NOTHING = (0.0, 0.0)
# Eq. 5 and 6 as printed: one threshold, every pixel renewed at one rate, no factor for the light.
# The paper gives no rate: that of assumption A23.
PRINTED = Parameters(
    background=BackgroundParameters(shadow_share=0.0, masked_rate=None, compensate_light=False)
)
PRINTED_H = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])  # Eq. 12: x + y is observed
OUR_BEST = {BEST: Parameters(estimator=BEST)}
QUANTITIES = {
    "position": "E_t_mm",
    "alpha": "E_alpha_deg",
    "beta": "E_beta_deg",
    "gamma": "E_gamma_deg",
    "geodesic": "geodesic_mean_deg",
}
POSITIONS = 14  # of the board in Sect. 6.2
BENDS_MM = {"flat": 0.0, "bent_20um": 0.02, "bent_50um": 0.05}  # of the board's middle
FLATNESS_MM = {"flat": 0.0, "bent_5um": 0.005, "bent_10um": 0.01, "bent_20um": 0.02}
PAPER_MM = 0.31  # E_t as the paper has it
CLIP, LONG_CLIP = 6, 30  # instants; the light changes in the middle
FACTORS = {"distortion": -0.1, "distance": 900.0, "marker_size": 4.0, "speed": 200.0}
CONCEALED_MM = 1.0  # a marker's place is calculated if it is as near as this
MARKER_PX = 0.1  # noise of a marker's pixel where no image is rendered
PATH_PX = 2.0  # noise of an observed path in the image
# The other choices of data/ranges.toml, by the end of a check's name
RATES = (0.002, 0.02, 0.05, 0.1)  # of the printed background
LIGHTS = {"halved": 0.5}  # from the middle of a clip on
SLANTS_DEG = (55.0, 80.0)  # up to which a marker is measured
MATCHINGS = {
    "ncc_0.8": MatchParameters(ncc_threshold=0.8),
    "ncc_none": MatchParameters(ncc_threshold=-1.0),
    "gate_6": MatchParameters(epipolar_gate_px=6.0),
    "window_11": MatchParameters(window_px=11),
}
OTHER_HANDLES = {
    "small": lambda: replace(load_handle("paper"), marker_diameter_mm=2.0),
    "large": lambda: replace(load_handle("paper"), marker_diameter_mm=4.0),
    "dark": lambda: replace(load_handle("paper"), markers="dark"),
    "coded": lambda: load_handle("coded"),
}
FORECASTS = {
    **{f"noise_{px:g}": (px, 1.0) for px in (0.1, 0.5, 6.0)},  # noise, px; factor of q
    "calm": (PATH_PX, 0.1),
    "lively": (PATH_PX, 10.0),
}
PRIOR_MM, PRIOR_DEG = 5.0, 10.0  # by which a prior pose is wrong
SCRIPT_S = 5.0  # of a standard recording's script, of which one instant is drawn


def table1(k: int, seed: int) -> Draw:
    """All of Table 1's poses, rendered with one draw of the noise and measured: by the paper's method
    with a rig that was calibrated anew, by the same with the exact one, by our best with every exact
    rig. A number is the mean over the poses.
    """
    handle = load_handle("paper")
    poses = load_table1().set_poses
    rng = np.random.default_rng([seed, k])
    rig = load_rig("paper_pair")
    pairs = [render_rig(rig, handle, truth, Bench(), rng) for truth in poses]
    calibrated = simulated_calibration(rig, Board(), POSITIONS, rng).rig
    draw: Draw = {}
    for name, believed in (("calibrated", calibrated), ("replication", rig)):
        found = measure_frames(pairs, believed, handle)["paper"]
        errors = replication_errors(found, poses, handle)
        for quantity, field in QUANTITIES.items():
            draw[f"{name}_{quantity}"] = (float(getattr(errors, field)), 1.0)
        draw[f"{name}_measured"] = (float(errors.n), float(len(poses)))
    for name in ("paper_pair", "paper_trinocular", "raised_40deg"):
        cameras = load_rig(name).cameras
        frames = [
            [*pair, *(render(camera, handle, truth, Bench(), rng) for camera in cameras[2:])]
            for pair, truth in zip(pairs, poses, strict=True)
        ]
        found = measure_frames(frames, load_rig(name), handle, OUR_BEST)[BEST]
        errors = replication_errors(found, poses, handle)
        draw[f"best_position_{name}"] = (errors.E_t_mm, 1.0)
        draw[f"best_geodesic_{name}"] = (errors.geodesic_mean_deg, 1.0)
        draw[f"best_measured_{name}"] = (float(errors.n), float(len(poses)))
    return draw


def random_pose(k: int, seed: int) -> Draw:
    """A random pose at which CCD1 and CCD2 truly see the same four markers, rendered: measured?
    matched rightly? how far are the centroids off?
    """
    rig = load_rig("paper_pair")
    handle = load_handle("paper")
    rng = np.random.default_rng([seed, k])
    truth = next(shared_poses(rig, handle, rng))
    images = render_rig(rig, handle, truth, Bench(), rng)
    m = measure(images, rig, handle, parameters=EVERY["paper"])
    left, right, pairs, same = _matched(images, m, truth, rig, handle)
    turn = Rotation.from_rotvec(np.deg2rad(PRIOR_DEG) * _direction(rng))
    off = RigidTransform.from_components(PRIOR_MM * _direction(rng), turn)
    begun = measure(images, rig, handle, truth * off, EVERY["paper"])
    both = np.logical_and(*(true_visibility(camera, handle, truth) for camera in rig.cameras))
    matched = np.isin(np.flatnonzero(both), left[pairs[same, 0]])
    distance = np.concatenate(
        [
            nearest(markers.uv, facing_pixels(handle, camera, truth, 65.0))[1]
            for camera, markers in zip(rig.cameras, m.markers, strict=True)
        ]
    )
    distance = distance[distance < SAME_PX]
    draw = {
        "share_measured": (share_close([m], [truth], handle, equivalents=True), 1.0),
        "share_measured_itself": (share_close([m], [truth], handle, equivalents=False), 1.0),
        "share_measured_prior": (share_close([begun], [truth], handle, equivalents=True), 1.0),
        "share_measured_itself_prior": (
            share_close([begun], [truth], handle, equivalents=False),
            1.0,
        ),
        "share_of_wrong_matches": (float((~same).sum()), float(len(pairs))),
        "share_of_wrong_identities": _wrong_identities(m, left, right),
        "share_of_markers_matched": (float(matched.sum()), float(both.sum())),
        "centroid_error_px": (float((distance**2).sum()), float(len(distance))),
    }
    for name, parameters in MATCHINGS.items():
        same = _matched(images, m, truth, rig, handle, parameters)[3]
        draw[f"share_of_wrong_matches_{name}"] = (float((~same).sum()), float(len(same)))
    return draw


def other_handle(k: int, seed: int) -> Draw:
    """A random pose, rendered with handles of other markers: `random_pose` of each."""
    rig = load_rig("paper_pair")
    draw: Draw = {}
    for name, make in OTHER_HANDLES.items():
        handle = make()
        rng = np.random.default_rng([seed, k])
        truth = next(shared_poses(rig, load_handle("paper"), rng))
        visible = [true_visibility(camera, handle, truth) for camera in rig.cameras]
        counts = float(np.logical_and(*visible).sum() >= 4)
        images = render_rig(rig, handle, truth, Bench(), rng)
        m = measure(images, rig, handle, parameters=EVERY["paper"])
        same = _matched(images, m, truth, rig, handle)[3]
        for check, equivalents in (("share_measured", True), ("share_measured_itself", False)):
            close = share_close([m], [truth], handle, equivalents)
            draw[f"{check}_{name}"] = (counts * close, counts)
        draw[f"share_of_wrong_matches_{name}"] = (float((~same).sum()), float(len(same)))
    return draw


def _direction(rng: np.random.Generator) -> Array:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def recorded_instant(k: int, seed: int) -> Draw:
    """One instant of a new draw of a standard recording, ``calm`` and ``hard`` in turn: wrong matches
    of CCD1 and CCD2 while both are lit.
    """
    rig = load_rig("paper_pair")
    handle = load_handle("paper")
    job = scripted(("calm", "hard")[k % 2], rig, handle, seed + k, SCRIPT_S)
    rng = np.random.default_rng([seed, k])
    visible = [
        frame
        for frame, shot in enumerate(job.shots)
        if shot.T_world_handle is not None and min(shot.gains) > 0
    ]
    frame = int(rng.choice(visible))
    truth = job.shots[frame].T_world_handle
    assert truth is not None  # chosen so
    images = [take(job, frame, index) for index in range(len(rig.cameras))]
    m = measure(images, rig, handle, parameters=EVERY["paper"])
    left, right, pairs, same = _matched(images, m, truth, rig, handle)
    return {
        "recorded_wrong_matches": (float((~same).sum()), float(len(pairs))),
        "recorded_wrong_identities": _wrong_identities(m, left, right),
    }


def hidden_camera(k: int, seed: int) -> Draw:
    """A random pose at which CCD1 and CCD2 share four markers; then a hand hides CCD1: do three
    cameras still measure it, CCD3 at Fig. 5's place or at 40 deg?
    """
    handle = load_handle("paper")
    rng = np.random.default_rng([seed, k])
    truth = next(shared_poses(load_rig("paper_pair"), handle, rng))
    draw: Draw = {}
    for name in ("paper_trinocular", "raised_40deg"):
        rig = load_rig(name)
        x, y, z = rig.cameras[0].centre
        arm = Arm(hides_from=(float(x), float(y), float(z)))
        images = render_rig(rig, handle, truth, Bench(), rng, arm)
        for end, parameters in _by_slant(EVERY["paper"]).items():
            m = measure(images, rig, handle, parameters=parameters)
            close = share_close([m], [truth], handle, equivalents=True)
            draw[f"share_saved_{name}{end}"] = (close, 1.0)
    return draw


def _by_slant(parameters: Parameters) -> dict[str, Parameters]:
    """The parameters, and with markers measured up to other slants, by the end of a check's name."""
    return {"": parameters} | {
        f"_slant_{slant:g}": replace(parameters, max_slant_deg=slant) for slant in SLANTS_DEG
    }


def clip(k: int, seed: int, length: int = CLIP, ranges: bool = False) -> Draw:
    """A short clip of a moving, held handle, tracked from a known start by the printed background
    and by ours, in steady light and in light that doubles half-way; with `ranges` by backgrounds of
    other rates and thresholds as well, and in other changes of the light.
    """
    rig = load_rig("paper_pair")
    handle = load_handle("paper")
    rng = np.random.default_rng([seed, k])
    truths = list(smooth_motion(rng, length / FPS, FPS))
    half = length // 2
    empty = render_rig(rig, handle, None, Bench(), rng)
    first = list(render_clip(rig, handle, truths[:half], Bench(), rng, Arm()))
    gains = {"steady": np.ones(length - half), "doubled": np.full(length - half, 2.0)}
    if ranges:
        gains |= {name: np.full(length - half, gain) for name, gain in LIGHTS.items()}
    second = {
        light: list(render_clip(rig, handle, truths[half:], Bench(), rng, Arm(), gain))
        for light, gain in gains.items()
    }
    draw: Draw = {}
    begun = start(empty, rig, -1 / FPS, truths[0])
    unknown: list[State | None] = [None] * len(rig.cameras)
    for name, parameters in (("printed", PRINTED), ("ours", Parameters())):
        follow = partial(follow_clip, rig=rig, handle=handle, parameters=parameters)
        before = follow(begun, unknown, first, truths[:half], 0)
        after = {
            light: follow(before.state, before.printed, frames, truths[half:], half)
            for light, frames in second.items()
        }
        steady, doubled = after["steady"], after["doubled"]
        draw[f"share_tracked_{name}"] = (float(all(before.right + steady.right)), 1.0)
        draw[f"share_kept_under_light_{name}"] = (
            float(sum(doubled.right)),
            float(sum(steady.right)),
        )
        draw[f"share_measured_in_light_{name}"] = _right(doubled)
        if ranges:
            draw[f"instants_tracked_{name}"] = _right(before, steady)
            for light in LIGHTS:
                draw[f"share_measured_{light}_{name}"] = _right(after[light])
            frames = first + second["steady"]
            for end, other in _backgrounds(name, parameters).items():
                way = follow_clip(begun, unknown, frames, truths, 0, rig, handle, other)
                draw[f"share_tracked_{name}_{end}"] = (float(all(way.right)), 1.0)
                draw[f"instants_tracked_{name}_{end}"] = _right(way)
        if name == "ours":
            for whose in ("ours", "printed"):
                shares = [*getattr(before, f"shares_{whose}"), *getattr(steady, f"shares_{whose}")]
                draw[f"share_searched_{whose}"] = (float(sum(shares)), float(len(shares)))
            draw["time_searched"] = time(
                second["steady"][-1][0], steady.window, rig.cameras[0], handle, truths[-1]
            )
    return draw


def long_clip(k: int, seed: int) -> Draw:
    """`clip` for a second, its checks named ``long_``."""
    return {f"long_{check}": pair for check, pair in clip(k, seed, LONG_CLIP, True).items()}


def _right(*ways: Way) -> tuple[float, float]:
    """The instants that are right, and all of them."""
    right = [one for way in ways for one in way.right]
    return float(sum(right)), float(len(right))


def _backgrounds(name: str, parameters: Parameters) -> dict[str, Parameters]:
    """The parameters with other rates and thresholds of the background, by the end of a check's
    name.
    """
    rates = RATES if name == "printed" else (0.05,)
    changes: dict[str, dict[str, Any]] = {f"rate_{r:g}": {"update_rate": r} for r in rates}
    changes["threshold_25"] = {"difference_threshold": 25.0}
    return {
        end: replace(parameters, background=replace(parameters.background, **change))
        for end, change in changes.items()
    }


def calibration(k: int, seed: int) -> Draw:
    """A calibration from 14 positions of a flat target: its mean cost at Table 1's poses, mm."""
    return {"calibration_cost": (_calibration_cost_mm(k, seed), 1.0)}


def one_calibration(k: int, seed: int) -> Draw:
    """A calibration from 14 positions of a target that is flat, and from the same positions of
    targets that are bent: is its mean cost at Table 1's poses at most the paper's error?
    """
    draw: Draw = {}
    for name, bend_mm in BENDS_MM.items():
        cost = _calibration_cost_mm(k, seed, bend_mm)
        draw[f"calibration_enough_{name}"] = (float(cost <= PAPER_MM), 1.0)
        draw[f"calibration_cost_{name}"] = (cost, 1.0)
    return draw


def _calibration_cost_mm(k: int, seed: int, bend_mm: float = 0.0) -> float:
    rig = load_rig("paper_pair")
    rng = np.random.default_rng([seed, k])
    calibrated = simulated_calibration(rig, Board(), POSITIONS, rng, bend_mm=bend_mm).rig
    poses = load_table1().set_poses
    return float(calibration_errors(calibrated, rig, load_handle("paper"), poses).E_t_mm)


def flatness(k: int, seed: int) -> Draw:
    """Table 1's poses, rendered once, measured with rigs that were calibrated from the same positions
    of a flat board and of bent ones: position error of the method, cost of the calibration alone.
    """
    handle, rig = load_handle("paper"), load_rig("paper_pair")
    poses = load_table1().set_poses
    rng = np.random.default_rng([seed, k])
    pixels = [labelled(render_rig(rig, handle, T, Bench(), rng), rig, handle) for T in poses]
    draw: Draw = {}
    for name, bend_mm in FLATNESS_MM.items():
        same = deepcopy(rng)
        found = simulated_calibration(rig, Board(), POSITIONS, same, bend_mm=bend_mm).rig
        fits = [rigid_fit(handle.marker_centres, triangulate(found, uv)) for uv in pixels]
        estimates, truths = estimates_and_truths(fits, poses, handle)
        errors = pose_errors(estimates, truths)
        joined = rigid_fit(truths.translation, estimates.translation)
        assert joined is not None  # twenty places
        left = joined.inv().apply(estimates.translation) - truths.translation
        draw[f"registered_{name}"] = (float(np.linalg.norm(left, axis=1).mean()), 1.0)
        cost = float(calibration_errors(found, rig, handle, poses).E_t_mm)
        draw[f"position_{name}"] = (errors.E_t_mm, 1.0)
        draw[f"calibration_cost_{name}"] = (cost, 1.0)
        draw[f"calibration_enough_{name}"] = (float(cost <= PAPER_MM), 1.0)
    return draw


def labelled(images: list[np.ndarray], rig: Rig, handle: Handle) -> Array:
    """The centroids of an instant by camera and marker, as the paper's pose takes them: NaN for those
    that are not found, or too steep.
    """
    m = measure(images, rig, handle, parameters=EVERY["paper"])
    uv = labelled_pixels(
        m.labels, tuple(markers.uv for markers in m.markers), len(handle.marker_centres)
    )
    T = m.pose.T_world_handle
    if T is not None:
        steepest = Parameters().max_slant_deg
        facing = [facing_pixels(handle, camera, T, steepest) for camera in rig.cameras]
        uv = np.where(np.isfinite(facing), uv, np.nan)
    return uv


def factor(k: int, seed: int) -> Draw:
    """Table 1's poses with one factor changed, against the same noise without: growth of the
    position errors, of all poses that are measured both times and of all of these but the one whose
    error grows most.
    """
    handle = load_handle("paper")
    setup = factors.table1_setup(load_rig("paper_pair"), handle)

    def error(of: factors.Setup, place: int, row: int) -> float | None:
        return position_error(of, place, np.random.default_rng([seed, k, row]))

    rows = list(range(len(setup.poses)))
    # at another distance some poses would leave the images
    far = np.flatnonzero(factors.in_view_everywhere(setup)).tolist()
    base = [error(setup, row, row) for row in rows]
    draw: Draw = {}
    for name, value in FACTORS.items():
        changed = factors.FACTORS[name].change(setup, value)
        pairs = []
        for place, row in enumerate(far if name == "distance" else rows):
            before, after = base[row], error(changed, place, row)
            if before is not None and after is not None:
                pairs.append((after - before, before))
        pairs.sort()
        draw[f"factor_{name}"] = _sums(pairs)
        draw[f"factor_{name}_without_the_most"] = _sums(pairs[:-1])
    return draw


def _sums(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    return float(sum(a for a, _ in pairs)), float(sum(b for _, b in pairs))


def concealed(k: int, seed: int) -> Draw:
    """A random pose of which three cameras see a marker, concealed from one of them: is its place
    calculated all the same?
    """
    handle = load_handle("paper")
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng([seed, k])
    while True:
        truth = next(shared_poses(rig, handle, rng))
        visible = np.stack([true_visibility(camera, handle, truth) for camera in rig.cameras])
        if len(seen := np.flatnonzero(visible.all(axis=0))):
            break
    marker = int(rng.choice(seen))
    point = truth.apply(handle.marker_centres[[marker]])
    uv = np.stack([camera.project(point) for camera in rig.cameras])
    uv += rng.normal(0.0, MARKER_PX, uv.shape)
    ratios = {"plain_mean": _plain_to_weighted(rig, uv, point)}
    above = load_rig("paper_trinocular")
    seen_above = np.stack([camera.project(point) for camera in above.cameras])
    noise = np.random.default_rng([seed, k, 1]).normal(0.0, MARKER_PX, uv.shape)
    ratios["plain_mean_above"] = _plain_to_weighted(above, seen_above + noise, point)
    uv[int(rng.integers(len(rig.cameras)))] = np.nan
    rest = triangulate(rig, uv)
    return {
        "share_concealed": (float(np.linalg.norm(rest - point) <= CONCEALED_MM), 1.0),
        **ratios,
    }


def _plain_to_weighted(rig: Rig, uv: Array, points: Array) -> tuple[float, float]:
    """Squared errors of Eq. 22's mean, and of the mean weighted by covariances."""
    plain = triangulate(rig, uv)
    weighted = triangulate_weighted(rig, uv, MARKER_PX)[0]
    return float(((plain - points) ** 2).sum()), float(((weighted - points) ** 2).sum())


def rendered_mean(k: int, seed: int) -> Draw:
    """A random pose, rendered for three cameras: how far off are Eq. 22's plain mean and the mean
    weighted by covariances, of the markers whose centroids all three have?
    """
    rig = load_rig("raised_40deg")
    handle = load_handle("paper")
    rng = np.random.default_rng([seed, k])
    truth = next(shared_poses(rig, handle, rng))
    # the truth tells the look-alikes apart
    images = render_rig(rig, handle, truth, Bench(), rng)
    m = measure(images, rig, handle, truth, EVERY["paper"])
    markers = len(handle.marker_centres)
    uv = labelled_pixels(m.labels, tuple(markers.uv for markers in m.markers), markers)
    draw: Draw = {}
    for end, parameters in _by_slant(EVERY["paper"]).items():
        steepest = parameters.max_slant_deg
        facing = [facing_pixels(handle, camera, truth, steepest) for camera in rig.cameras]
        by_all = np.isfinite(uv + np.array(facing)).all(axis=(0, 2))
        points = truth.apply(handle.marker_centres[by_all])
        draw[f"plain_mean_rendered{end}"] = _plain_to_weighted(rig, uv[:, by_all], points)
    return draw


def forecast(k: int, seed: int) -> Draw:
    """A motion seen by CCD1: errors of position, speed and acceleration forecasted one frame ahead,
    against having no forecast.
    """
    fine = 10  # steps per frame, for the true speed
    rng = np.random.default_rng([seed, k])
    camera = load_rig("paper_pair").cameras[0]
    poses = smooth_motion(rng, 3.0, fine * FPS)
    path = camera.project(poses.translation)
    speed = np.gradient(path, 1 / (fine * FPS), axis=0)
    acceleration = np.gradient(speed, 1 / (fine * FPS), axis=0)
    true = np.hstack([path, speed, acceleration])[::fine]
    unit = rng.normal(0.0, 1.0, (len(true), 2))
    z = true[:, :2] + PATH_PX * unit
    ours = _forecast(z, PATH_PX)
    known = State(np.append(z[0], np.zeros(4)), np.zeros((6, 6)))
    p = KalmanParameters()
    F, Q = constant_acceleration(1 / FPS), white_jerk(1 / FPS, p.jerk_intensity)
    sums = z[1:].sum(axis=1, keepdims=True)
    R = np.array([[2 * PATH_PX**2]])
    printed = run(known, sums, F, Q, PRINTED_H, R).predicted.mean
    line = np.full((len(true), 6), np.nan)
    line[2:, :2] = 2 * z[1:-1] - z[:-2]
    settled = slice(15, None)
    moved = np.diff(true[:, :2], axis=0, prepend=np.nan)

    def compare(predicted: Array, quantity: Array, columns: slice) -> tuple[float, float]:
        off = (predicted - true)[settled, columns]
        return float((off**2).sum()), float((quantity[settled] ** 2).sum())

    position, velocity, third = slice(0, 2), slice(2, 4), slice(4, 6)
    draw = {
        "forecast_printed": compare(np.vstack([np.full(6, np.nan), printed]), moved, position),
        "forecast_position": compare(ours, moved, position),
        "forecast_speed": compare(ours, true[:, velocity], velocity),
        "forecast_acceleration": compare(ours, true[:, third], third),
        "forecast_line": compare(line, moved, position),
    }
    draw["forecast_against_line"] = draw["forecast_position"][0], draw["forecast_line"][0]
    for end, (noise_px, factor_of_q) in FORECASTS.items():
        predicted = _forecast(true[:, :2] + noise_px * unit, noise_px, factor_of_q)
        draw[f"forecast_position_{end}"] = compare(predicted, moved, position)
        draw[f"forecast_acceleration_{end}"] = compare(predicted, true[:, third], third)
    return draw


def _forecast(z: Array, noise_px: float, factor_of_q: float = 1.0) -> Array:
    """The states that the corrected filter predicts from observed places."""
    standard = KalmanParameters(sigma_px=noise_px)
    p = replace(standard, jerk_intensity=factor_of_q * standard.jerk_intensity)
    return track(np.arange(len(z)) / FPS, z, p, gated=False).predicted.mean


def slave(k: int, seed: int) -> Draw:
    """A hand at a third of a person's pace for three seconds, and a hand that then rests, through
    tracker noise, filter and arm: errors at the tool, delay.
    """
    robot = kept_robot()
    number = seed + k
    hand = master_slave.human_hand(number, 0.3)
    led = partial(
        master_slave.run, robot, noise_mm=0.05, noise_deg=0.3, age_s=0.005 + 1 / 30 + 0.0105
    )
    moving = led(hand, duration_s=3.0, rng=np.random.default_rng([seed, k, 0]))
    stop_s = master_slave.STILL_S + 1.0

    def resting(times: Array) -> RigidTransform:
        return hand(np.minimum(times, stop_s))

    rest = led(
        resting, duration_s=1.0 + master_slave.REST_S, rng=np.random.default_rng([seed, k, 1])
    )
    mm, deg = master_slave.parts(moving)["total"]
    last = [rest.stages[name][-1:] for name in ("hand", "tool")]
    rest_mm, rest_deg = master_slave.between(*last)
    return {
        "slave_delay_ms": (1e3 * master_slave.lag_s(moving), 1.0),
        "slave_moving_mm": (mm, 1.0),
        "slave_moving_deg": (deg, 1.0),
        "slave_rest_mm": (rest_mm, 1.0),
        "slave_rest_deg": (rest_deg, 1.0),
    }


TRIALS: dict[str, Callable[[int, int], Draw]] = {
    "concealed": concealed,
    "forecast": forecast,
    "calibration": calibration,
    "one_calibration": one_calibration,
    "flatness": flatness,
    "other_handle": other_handle,
    "rendered_mean": rendered_mean,
    "slave": slave,
    "table1": table1,
    "random_pose": random_pose,
    "factor": factor,
    "recorded_instant": recorded_instant,
    "hidden_camera": hidden_camera,
    "clip": clip,
    "long_clip": long_clip,
}


class Way(NamedTuple):
    """What came of a part of a clip: the tracker's state, the printed filter of each camera, whether
    each instant is right, the shares of the images that both filters would have searched, and the
    last window of the first camera.
    """

    state: TrackerState
    printed: list[State | None]
    right: list[bool]
    shares_ours: list[float]
    shares_printed: list[float]
    window: Window | None


def follow_clip(
    state: TrackerState,
    printed: list[State | None],
    frames: list[list[np.ndarray]],
    truths: list[RigidTransform],
    begin: int,
    rig: Rig,
    handle: Handle,
    parameters: Parameters,
) -> Way:
    """Go on with a clip by the tracker, and beside it with the printed filter of the same windows'
    centres (Eq. 7-15).
    """
    progress = Way(state, list(printed), [], [], [], None)
    for k, (images, truth) in enumerate(zip(frames, truths, strict=True), start=begin):
        for c, (camera, known) in enumerate(zip(rig.cameras, progress.state.cameras, strict=True)):
            if known.motion is None or known.window is None:
                continue
            motion = predict_motion(known.motion, 1 / FPS)
            window = search_window(motion, known.window, camera.size)
            progress.shares_ours.append(share_of_image(window, camera, handle, truth))
            last = progress.printed[c] or certain(known.window)
            progress.printed[c] = guess = predict_motion(last, 1 / FPS)
            window_of_guess = search_window(guess, known.window, camera.size)
            progress.shares_printed.append(share_of_image(window_of_guess, camera, handle, truth))
            if c == 0:
                progress = progress._replace(window=window)
        now, measurement = step(progress.state, images, k / FPS, rig, handle, parameters)
        for c, known in enumerate(now.cameras):
            guess_c = progress.printed[c]
            if guess_c is not None and known.window is not None:
                progress.printed[c] = _printed_update(guess_c, known.window)
        progress.right.append(share_close([measurement], [truth], handle, equivalents=False) == 1.0)
        progress = progress._replace(state=now)
    return progress


def certain(window: Window) -> State:
    """The paper's start: all is known, and nothing moves (Sect. 4.2)."""
    return State(np.append(np.array(window.centre), np.zeros(4)), np.zeros((6, 6)))


def _printed_update(state: State, window: Window) -> State:
    """Eq. 13-15 with the printed H: only the sum of the coordinates is observed."""
    R = np.array([[2 * KalmanParameters().sigma_px ** 2]])
    return update(state, np.array([sum(window.centre)]), PRINTED_H, R)


def time(
    image: np.ndarray,
    window: Window | None,
    camera: Camera,
    handle: Handle,
    truth: RigidTransform,
) -> tuple[float, float]:
    """Processor time of a search in a window of an image, and in all of it, s."""
    if window is None:
        return NOTHING
    inside, whole = (
        searched([image] * 2, [where] * 2, camera, handle, [truth] * 2).seconds
        for where in (window, Window(0, 0, *camera.size))
    )
    return inside, whole


def _matched(
    images: list[np.ndarray],
    m: Measurement,
    truth: RigidTransform,
    rig: Rig,
    handle: Handle,
    parameters: MatchParameters | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The true markers of what both cameras found, the pairs that Sect. 5.2 makes of it, and which of
    these are right.
    """
    left, right = (
        true_labels(camera, handle, truth, markers.uv)
        for camera, markers in zip(rig.cameras, m.markers, strict=True)
    )
    uv = [markers.uv for markers in m.markers]
    pairs = match(
        rig.cameras[0], rig.cameras[1], images[0], images[1], uv[0], uv[1], parameters
    ).index
    same = (left[pairs[:, 0]] == right[pairs[:, 1]]) & (left[pairs[:, 0]] >= 0)
    return left, right, pairs, same


def _wrong_identities(m: Measurement, left: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """Pairs of pixels that the whole chain takes for one marker of the handle, and that are not; of
    all its pairs.
    """
    ours = [np.asarray(labels) for labels in m.labels]
    wrong = pairs = 0
    for i, label in enumerate(ours[0]):
        for j in np.flatnonzero((ours[1] == label) & (label >= 0)):
            pairs += 1
            wrong += int(left[i] != right[j] or left[i] < 0)
    return float(wrong), float(pairs)


def position_error(setup: factors.Setup, k: int, rng: np.random.Generator) -> float | None:
    """Of one pose of a setup, mm; None if it is lost."""
    frames = factors.frames(setup, k, rng)
    m = measure(frames, setup.rig, setup.handle, parameters=EVERY["paper"])
    errors = errors_of(m, setup.poses[k], setup.handle)
    return None if errors is None else float(errors.E_t_mm)


def errors_of(m: Measurement, truth: RigidTransform, handle: Handle) -> PoseErrors | None:
    """Errors of one measurement, up to the handle's symmetry; None if it is lost."""
    if m.pose.T_world_handle is None:
        return None
    return replication_errors([m], RigidTransform.concatenate([truth]), handle)


@cache
def kept_robot() -> Robot:
    return load_robot()
