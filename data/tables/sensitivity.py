"""What each assumption is worth: the report's headline numbers with one assumption at a time replaced
by another that the paper allows as well. Every case renders the same poses, Table 1's, with the same
noise as the case without a change, so that differences are those of pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab.bench.optics import Bench
from trinolab.calibration.target import Board
from trinolab.camera import Camera, Rig, T_world_oxyz
from trinolab.checks import Array
from trinolab.datasets import load_calibration, load_handle, load_rig, load_sweep, load_table1
from trinolab.handle import Handle, facing_pixels
from trinolab.markers import MarkerParameters
from trinolab.matching import MatchParameters
from trinolab.measurement import Measurement, measure
from trinolab.methods import BEST
from trinolab.metrics import (
    angle_differences_deg,
    geodesic_deg,
    nearest_equivalent,
    pose_errors,
    position_errors,
)
from trinolab.parameters import Parameters
from trinolab.rigid import nearest_rotation
from trinolab.workspace import intersect
from trinolab.workspace.cones import cones_of_rig
from workbench.intervals import of_mean
from workbench.studies import factors
from workbench.studies.carrier import all_runs
from workbench.studies.error_sources import Trial, by_matrix, with_one_focal
from workbench.studies.simulated_calibration import calibration_errors, simulated_calibration

COLUMNS = (
    "assumption",
    "instead",
    "number",
    "unit",
    "claim",
    "as_assumed",
    "changed",
    "difference",
    "low",
    "high",
    "n",
    "draws",
    "seed",
    "source",
)
SEED = 1801  # used by nothing else
DRAWS = 2  # of the noise, for each of the poses
CALIBRATIONS = 30
ITSELF_DEG = 5.0  # a pose that is turned by more is one that looks alike
# name -> unit, and the row of the scoreboard that has it
NUMBERS = {
    "E_t": ("mm", "5j"),
    "E_alpha": ("deg", "6b"),
    "E_beta": ("deg", "7b"),
    "E_gamma": ("deg", "8k"),
    "angle": ("deg", "8b"),
    "E_t best": ("mm", "5e"),
    "angle best": ("deg", "8d"),
    "told apart": ("share", "11a"),
    "measured": ("share", "11"),
}


@dataclass(frozen=True)
class World:
    """What is rendered, what is measured with, and what is compared; a case changes some of it.

    Attributes
    ----------
    setup : factors.Setup
        Three cameras, of which the first two make the paper's pair.
    parameters : Parameters
        Of the measurement.
    T_handle_rod : RigidTransform
        From the frame of the rod, whose y axis is the cylinder's, to that of the paper's handle.
    told : bool
        Whether poses that look alike count as one.
    as_printed : bool
        Whether the pair is measured with R_rl as printed.
    late_s : float
        By which CCD2 exposes after the others.
    full_range : bool
        Whether a corner of each image has the grey values 0 and 255: the first bounds of Eq. 16.
    """

    setup: factors.Setup
    parameters: Parameters = field(default_factory=lambda: Parameters(estimator="paper"))
    T_handle_rod: RigidTransform = field(default_factory=RigidTransform.identity)
    told: bool = True
    as_printed: bool = False
    late_s: float = 0.0
    full_range: bool = False


class Case(NamedTuple):
    """One assumption replaced by another: its name in ``book/assumptions.md``, what holds instead,
    and the change.
    """

    assumption: str
    instead: str
    change: Callable[[World], World]


def standard() -> World:
    """Everything as assumed."""
    return World(factors.table1_setup(load_rig("paper_trinocular"), load_handle("paper")))


# --- the changes


def _with(**changes: Any) -> Callable[[World], World]:
    """Other fields of the setup."""
    return lambda world: replace(world, setup=world.setup._replace(**changes))


def _handle(**changes: Any) -> Callable[[World], World]:
    """The same handle with other fields."""
    return lambda world: _with(handle=replace(world.setup.handle, **changes))(world)


def _rows(upper: float, lower: float, top: float) -> Callable[[World], World]:
    """Rows of markers, and the free end, at other axial coordinates."""
    return _handle(rows_mm=((upper, lower),) * 6, top_mm=top)


def _measured_by(**changes: Any) -> Callable[[World], World]:
    """Other parameters of the measurement."""
    return lambda world: replace(world, parameters=replace(world.parameters, **changes))


def _cameras(rig: Rig, change: Callable[[Camera], Camera]) -> Rig:
    return replace(rig, cameras=tuple(change(camera) for camera in rig.cameras))


def _whole_sensor(world: World) -> World:
    rig = _cameras(world.setup.rig, lambda camera: replace(camera, size=(1624, 1224)))
    return _with(true_rig=rig, rig=rig)(world)


def _distorted(k1: float) -> Callable[[World], World]:
    return lambda world: replace(world, setup=factors.with_distortion(world.setup, k1))


def _longer_unit(share: float) -> Callable[[World], World]:
    """All places of cameras in a longer unit than the measurement believes."""

    def stretched(camera: Camera) -> Camera:
        T = camera.T_cam_world
        return replace(
            camera,
            T_cam_world=RigidTransform.from_components((1 + share) * T.translation, T.rotation),
        )

    return lambda world: _with(true_rig=_cameras(world.setup.true_rig, stretched))(world)


def _in_oxyz(world: World) -> World:
    return _with(poses=T_world_oxyz(world.setup.rig) * world.setup.poses)(world)


def _third_camera_raised(world: World) -> World:
    rig = load_rig("raised_40deg")
    return _with(true_rig=rig, rig=rig)(world)


def _other_axis(world: World) -> World:
    """The rod's axis is the handle's z axis."""
    turn = RigidTransform.from_rotation(Rotation.from_euler("x", 90, degrees=True))
    changed = _with(poses=world.setup.poses * turn)(world)
    return replace(changed, T_handle_rod=turn)


def _angles_in_turn(world: World) -> World:
    """Table 1's angles about X, Y, Z in that order."""
    return _with(poses=_in_turn(world.setup.poses))(world)


def _moving(speed_mm_s: float) -> Callable[[World], World]:
    return lambda world: replace(world, setup=factors.at_speed(world.setup, speed_mm_s))


def _late(seconds: float, speed_mm_s: float) -> Callable[[World], World]:
    return lambda world: replace(_moving(speed_mm_s)(world), late_s=seconds)


CASES = (
    Case("A1", "images of the whole sensor, 1624 x 1224 px", _whole_sensor),
    Case("A2", "lenses with k1 = -0.1 that nobody corrects", _distorted(-0.1)),
    Case("A3", "a unit that is longer by 0.1 %", _longer_unit(0.001)),
    Case("A4", "R_rl used as printed", lambda world: replace(world, as_printed=True)),
    Case(
        "A5",
        "one focal length a camera, the mean",
        lambda world: _with(rig=with_one_focal(world.setup.rig))(world),
    ),
    Case("A6", "positions in Sect. 3's frame OXYZ", _in_oxyz),
    Case("A7", "CCD3 raised by 40 deg", _third_camera_raised),
    Case("A9", "the rod along the handle's z axis", _other_axis),
    Case("A10", "rows 14 mm apart", _rows(7.0, -7.0, 25.0)),
    Case("A10", "the origin 10 mm below the middle of the rows", _rows(20.0, 0.0, 35.0)),
    Case("A11", "markers of 2 mm", _handle(marker_diameter_mm=2.0)),
    Case("A11", "markers of 4 mm", _handle(marker_diameter_mm=4.0)),
    Case(
        "A12",
        "the first column at 30 deg",
        _handle(columns_deg=(30.0, 90.0, 150.0, 210.0, 270.0, 330.0)),
    ),
    Case("A13", "the free end 40 mm from the origin", _handle(top_mm=40.0)),
    Case("A14", "dark markers on a bright rod", _handle(markers="dark")),
    Case("A15", "markers that identify themselves", _with(handle=load_handle("coded"))),
    Case("A16", "nobody tells which pose it is", lambda world: replace(world, told=False)),
    Case("A17", "angles about X, Y, Z in that order", _angles_in_turn),
    Case("A20", "half the contrast: rod 90, markers 155", _with(bench=Bench(marker_grey=155.0))),
    Case("A21", "a blur of 1.4 px", _with(bench=Bench(blur_px=1.4))),
    Case(
        "A21",
        "twice the noise",
        _with(bench=Bench(shot_variance=4 * Bench().shot_variance, read_noise=3.0)),
    ),
    Case("A22", "a handle that moves by 50 mm/s", _moving(50.0)),
    Case("A26", "first bounds 0 and 255", lambda world: replace(world, full_range=True)),
    Case("A27", "lambda = 1", _measured_by(markers=MarkerParameters(surplus=1.0))),
    Case("A27", "lambda = 2.5", _measured_by(markers=MarkerParameters(surplus=2.5))),
    Case("A28", "epsilon_0 = 0.8", _measured_by(matching=MatchParameters(ncc_threshold=0.8))),
    Case("A28", "D_0 = 6 px", _measured_by(matching=MatchParameters(epipolar_gate_px=6.0))),
    Case("A28", "windows of 11 px", _measured_by(matching=MatchParameters(window_px=11))),
    Case("A29", "markers up to 55 deg", _measured_by(max_slant_deg=55.0)),
    Case("A29", "markers up to 80 deg", _measured_by(max_slant_deg=80.0)),
    Case("A31", "CCD2 1 ms late at 50 mm/s", _late(0.001, 50.0)),
)


# --- one instant


def numbers_of(world: World, k: int, draw: int) -> dict[str, float]:
    """The headline numbers of pose `k` under one draw of the noise; NaN for what is not measured."""
    images = images_of(world, k, draw)
    rig = world.setup.rig
    pair = rig.part(range(2))
    m = measure(images[:2], pair, world.setup.handle, parameters=world.parameters)
    estimate = m.pose.T_world_handle
    if world.as_printed:
        estimate = by_printed_matrix(m, pair, world.setup.handle)
    best = measure(
        images, rig, world.setup.handle, parameters=replace(world.parameters, estimator=BEST)
    ).pose.T_world_handle
    E_t, E_alpha, E_beta, E_gamma, angle = errors(world, estimate, k)
    best_mm, *_, best_deg = errors(world, best, k)
    return {
        "E_t": E_t,
        "E_alpha": E_alpha,
        "E_beta": E_beta,
        "E_gamma": E_gamma,
        "angle": angle,
        "E_t best": best_mm,
        "angle best": best_deg,
        "told apart": float(is_itself(world, estimate, k)),
        "measured": float(estimate is not None),
    }


def images_of(world: World, k: int, draw: int) -> list[np.ndarray]:
    """The frames of a pose; CCD2's of a later instant if it is late."""
    images = factors.frames(world.setup, k, np.random.default_rng([SEED, draw, k]))
    if world.late_s:
        poses = world.setup.poses
        later = poses.translation + world.late_s * world.setup.velocity
        moved = world.setup._replace(poses=RigidTransform.from_components(later, poses.rotation))
        images[1] = factors.frames(moved, k, np.random.default_rng([SEED, draw, k]))[1]
    for image in images if world.full_range else ():
        image[:8, :8] = 0
        image[:8, 8:16] = 255
    return images


def by_printed_matrix(m: Measurement, pair: Rig, handle: Handle) -> RigidTransform | None:
    """The pose by the first form of Eq. 20 with R_rl as printed, from the same labelled centroids."""
    T = m.pose.T_world_handle
    if T is None:
        return None
    uv = np.full((1, 2, len(handle.marker_centres), 2), np.nan)
    for view, camera, markers, labels in zip(uv[0], pair.cameras, m.markers, m.labels, strict=True):
        known = labels >= 0
        view[labels[known]] = markers.uv[known]
        steep = np.isnan(facing_pixels(handle, camera, T, Parameters().max_slant_deg)).any(axis=1)
        view[steep] = np.nan
    printed = load_calibration().R_rl
    trial = Trial(pair, handle, RigidTransform.identity(1), uv, Parameters())
    return by_matrix(trial, uv, pair, printed - nearest_rotation(printed).as_matrix())[0]


def errors(world: World, estimate: RigidTransform | None, k: int) -> list[float]:
    """Distance, three angles, geodesic angle, of the paper's handle; NaN without an estimate."""
    if estimate is None:
        return [np.nan] * 5
    truth = world.setup.poses[k : k + 1]
    estimated = RigidTransform.concatenate([estimate])
    if world.told:
        estimated = nearest_equivalent(estimated, truth, world.setup.handle.symmetries)
    back = world.T_handle_rod.inv()
    angles = np.abs(angle_differences_deg(estimated * back, truth * back))[0]
    distance = position_errors(estimated, truth)[0]
    return [float(distance), *map(float, angles), float(geodesic_deg(estimated, truth)[0])]


def is_itself(world: World, estimate: RigidTransform | None, k: int) -> bool:
    """Whether a pose is the true one and not one that looks like it."""
    if estimate is None:
        return False
    return bool(
        geodesic_deg(RigidTransform.concatenate([estimate]), world.setup.poses[k : k + 1])[0]
        < ITSELF_DEG
    )


# --- all cases


def make_table(kept: Path, draws: int = DRAWS, workers: int = 1) -> pd.DataFrame:
    """Run every case; columns `COLUMNS`. Finished instants in the folder `kept` are taken up."""
    poses = range(len(load_table1().set_poses))
    grid = {"case": range(len(CASES) + 1), "draw": range(draws), "k": poses}
    runs = all_runs("sensitivity", instant, grid, kept, workers)
    base, *others = (part.to_dict("records") for _, part in runs.groupby("case"))
    rows = [
        (case.assumption, case.instead, name, unit, claim)
        + compared(by_pose(base, name, len(poses)), by_pose(numbers, name, len(poses)))
        + (draws, SEED, "rendered")
        for case, numbers in zip(CASES, others, strict=True)
        for name, (unit, claim) in NUMBERS.items()
    ]
    rows += [*of_table1(), *of_workspace(), *of_calibration(), *of_sweeps()]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    order = table["assumption"].str.removeprefix("A").astype(int)
    return table.iloc[np.argsort(order, kind="stable")].reset_index(drop=True)


def instant(case: int, draw: int, k: int) -> dict[str, float]:
    """The numbers of pose `k`; case 0 is as assumed, the others are those of `CASES`."""
    return numbers_of(world_of(case), k, draw)


@lru_cache(maxsize=1)
def world_of(case: int) -> World:
    """The world of a case, see `instant`."""
    return standard() if case == 0 else CASES[case - 1].change(standard())


def compared(before: Array, after: Array) -> tuple[float, float, float, float, float, int]:
    """Mean before and after a change, over the poses that have both; mean difference with its
    interval; how many poses. Shape (n,) each, a mean over the draws for each pose.
    """
    both = np.isfinite(before) & np.isfinite(after)
    if not both.any():
        return (np.nan,) * 5 + (0,)
    change = after[both] - before[both]
    interval = of_mean(change)
    means = float(before[both].mean()), float(after[both].mean()), float(change.mean())
    return (*means, interval.low, interval.high, int(both.sum()))


def by_pose(found: Sequence[dict[str, float]], name: str, poses: int) -> Array:
    """A number's mean over the draws that have it, for each pose; NaN where none has."""
    values = np.array([row[name] for row in found], float).reshape(-1, poses)
    good = np.isfinite(values)
    count = good.sum(axis=0)
    total = np.where(good, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


# --- what needs no images


def computed(
    what: tuple[str, ...], before: float, after: float, n: int = 1, source: str = "computed"
) -> tuple:
    """A row without a draw, and so without an interval."""
    return (*what, before, after, after - before, np.nan, np.nan, n, 0, "", source)


def of_table1() -> list[tuple]:
    """What the printed table says if it is read in another way: Eq. 26, 27 without an image."""
    table = load_table1()
    measured, true = table.measured, table.set_poses
    base = pose_errors(measured, true)
    moved = true.translation.copy()
    far = np.argmax(np.abs(moved[:, 1] - moved[:, 1].round(2)))  # the one number of four decimals
    moved[far, 1] = moved[far, 1].round(2)
    readings = {
        ("A17", "angles about X, Y, Z in that order"): (_in_turn(measured), _in_turn(true)),
        ("A18", "the columns of angles exchanged"): (
            RigidTransform.from_components(measured.translation, true.rotation),
            RigidTransform.from_components(true.translation, measured.rotation),
        ),
        ("A19", "row 8's y rounded to two decimals"): (
            measured,
            RigidTransform.from_components(moved, true.rotation),
        ),
    }
    rows = []
    for (assumption, instead), poses in readings.items():
        errors = pose_errors(*poses)
        for name, number, unit, claim in (
            ("E_t_mm", "E_t printed", "mm", "1"),
            ("geodesic_mean_deg", "angle printed", "deg", ""),
        ):
            before, after = getattr(base, name), getattr(errors, name)
            what = (assumption, instead, number, unit, claim)
            rows.append(computed(what, before, after, len(true)))
    return rows


def _in_turn(poses: RigidTransform) -> RigidTransform:
    angles = poses.rotation.as_euler("ZYX")
    return RigidTransform.from_components(
        poses.translation, Rotation.from_euler("XYZ", angles[:, ::-1])
    )


def of_workspace() -> list[tuple]:
    """The workspace if omega is the angle to the middle of an image's long side (Eq. 4)."""
    cones = cones_of_rig(load_rig("paper_trinocular"))
    camera = load_rig("paper_trinocular").cameras[0]
    side = float(np.arctan(camera.size[0] / 2 / camera.focal[0]))
    narrow = tuple(replace(cone, half_angle=side) for cone in cones)
    before, after = (1e-6 * intersect(cones_of).volume for cones_of in (cones, narrow))
    instead = f"omega of {np.rad2deg(side):.1f} deg, to the side of the image"
    return [computed(("A8", instead, "workspace", "dm³", "10"), before, after)]


def of_calibration() -> list[tuple]:
    """What a calibration costs by another board (claims 18 to 18d): pairs of calibrations of one
    draw.
    """
    base = _costs(Board())
    others = {
        "squares of 10 mm": (Board(square_mm=10.0), 0.0),
        "a board that is bent by 0.02 mm": (Board(), 0.02),
        "a board that is bent by 0.05 mm": (Board(), 0.05),
    }
    return [
        ("A25", instead, "E_t of a calibration", "mm", "18b")
        + (*compared(base, _costs(board, bend_mm)), CALIBRATIONS, SEED, "simulated corners")
        for instead, (board, bend_mm) in others.items()
    ]


def _costs(board: Board, bend_mm: float = 0.0) -> Array:
    """Mean position errors at Table 1's poses, of calibrations that each have their own draw."""
    rig, handle = load_rig("paper_pair"), load_handle("paper")
    poses = load_table1().set_poses
    title = f"A25 {board.square_mm:g} mm, bent by {bend_mm:g} mm"
    costs = []
    for k in tqdm(range(CALIBRATIONS), title, disable=None):
        rng = np.random.default_rng([SEED, k])
        calibrated = simulated_calibration(rig, board, 14, rng, bend_mm=bend_mm).rig
        costs.append(calibration_errors(calibrated, rig, handle, poses).E_t_mm)
    return np.array(costs)


def of_sweeps() -> list[tuple]:
    """What the shipped sweeps of the gallery say of the assumptions that no still image shows."""
    rows = []
    false, window = "false_percent_cured", "window_percent_calm"
    for assumption, name, column, number, assumed, others in (
        ("A23", "update_rate", "update_rate", false, 0.008, (0.001, 0.064)),
        ("A23", "difference_threshold", "difference_threshold", false, 15, (10, 20)),
        ("A24", "process_noise", "jerk_intensity", window, 1e8, (1e6, 1e10)),
    ):
        table = load_sweep(f"gallery/{name}").groupby(column)[number].mean()
        at = {
            value: float(table.iloc[np.argmin(np.abs(np.log(table.index / value)))])
            for value in (assumed, *others)
        }
        for value in others:
            what = (assumption, f"{column} = {value:g}, not {assumed:g}", number, "%", "")
            source = f"data/sweeps/gallery/{name}.csv"
            rows.append(computed(what, at[assumed], at[value], source=source))
    return rows
