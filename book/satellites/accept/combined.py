"""A0: what a user gets whose rig was calibrated and whose markers were placed as well as one can, and
where it comes from.

A set-up is a calibration and a handle of its own: cameras and markers are off by what their files
state. The images of a few poses are then measured four times: with these files, with right ones, and
with each of the two wrong alone. All of them state the same errors: what a pose is corrected by depends
on what is stated, and only parts of one correction add up to the whole. So the same noise is in all four
as well, and what calibration and markers add is a difference of squares (GUM, 5.1.2).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig, displaced
from trinolab.checks import Array
from trinolab.handle import Handle
from trinolab.metrics import FAR_DEG, FAR_MM
from workbench.intervals import Interval, by_bootstrap, rms
from workbench.studies.broken import covariance_of_such, miscalibrated
from workbench.studies.replication import measure_frames

from . import figures, tracks
from .numbers import Answer, Number, Picture, far_count, share
from .setup import Setup, sobol_poses
from .tracks import Row

NAME = "A0"
TITLE = "Combined uncertainty with a calibration of your own"
CALIBRATION_PX, CALIBRATION_DEG = 0.1, 0.005  # of each principal point and direction, an axis
PLACEMENT_MM = 0.02  # of each coordinate of each marker
TOGETHER = 8  # poses of a set-up
SHARE = 24 / 512  # set-ups for each pose of the sheet
FEWEST = 3
EXPANSION = 23e-6  # of aluminium, a kelvin
COVERAGE = 2.0  # k of the expanded uncertainty U
# What is wrong in each of the measurements of an image, beside its noise.
ALL, NOISE, CALIBRATION, MARKERS = "all", "noise", "calibration", "markers"
KINDS = ("depth", "across", "rotation")


def parts(setup: Setup) -> int:
    """How many set-ups."""
    return setup.part(SHARE, FEWEST)


def run(setup: Setup, k: int) -> dict[str, list[Row]]:
    """Render the poses of a set-up, and measure them in the four ways."""
    rng = setup.rng(NAME, k)
    rig, handle = believed(setup, rng)
    right_rig = replace(setup.rig, covariance=rig.covariance)
    right_handle = replace(setup.handle, placement_sigma_mm=handle.placement_sigma_mm)
    poses = sobol_poses(setup.field, parts(setup) * TOGETHER, setup.seed).poses
    mine = [poses[k * TOGETHER + i] for i in range(TOGETHER)]
    frames = [render_rig(setup.rig, setup.handle, T, Bench(), rng) for T in mine]
    files = {
        ALL: (rig, handle),
        NOISE: (right_rig, right_handle),
        CALIBRATION: (rig, right_handle),
        MARKERS: (right_rig, handle),
    }
    rows = {}
    for name, pair in files.items():
        (found,) = measure_frames(frames, *pair, {name: setup.parameters}).values()
        rows[name] = [tracks.row_of(float(i), one.pose) for i, one in enumerate(found)]
    return rows


def believed(setup: Setup, rng: np.random.Generator) -> tuple[Rig, Handle]:
    """Rig and handle as their files have them: off, and they say by how much. What the files of the
    sheet state is taken for that, else what is good.
    """
    rig = setup.rig
    if _states_errors(rig):
        assert rig.covariance is not None
        zeros = np.zeros(len(rig.covariance.matrix))
        delta = rng.multivariate_normal(zeros, rig.covariance.matrix, method="eigh")
        rig = displaced(rig, delta)
    else:
        rig = miscalibrated(rig, CALIBRATION_PX, CALIBRATION_DEG, rng)
        rig = replace(rig, covariance=covariance_of_such(rig, CALIBRATION_PX, CALIBRATION_DEG))
    handle = setup.handle
    placement_mm = handle.placement_sigma_mm or PLACEMENT_MM
    beside = placement_mm * rng.standard_normal(handle.marker_centres.shape)
    offsets = handle.marker_centres - handle.stated_centres + beside
    rows = tuple((x, y, z) for x, y, z in offsets.tolist())
    return rig, replace(handle, offsets_mm=rows, placement_sigma_mm=placement_mm)


def _states_errors(rig: Rig) -> bool:
    """Whether a rig says that it is not exact."""
    return rig.covariance is not None and not rig.covariance.is_exact


def judge(setup: Setup, rows: list[dict[str, list[Row]]]) -> Answer:
    """The budget: each component's standard uncertainty, the combined one, and the expanded one with
    the share of errors that it holds.
    """
    poses = sobol_poses(setup.field, len(rows) * TOGETHER, setup.seed).poses
    off = {}
    found = np.ones(len(rows) * TOGETHER, bool)
    sigmas = np.empty((0, 2))
    for name in (ALL, NOISE, CALIBRATION, MARKERS):
        track = tracks.as_track([row for part in rows for row in part[name]])
        errors, measured = tracks.errors(track, poses, setup, one_track=False)
        off[name] = _by_kind(errors, setup)
        found &= measured
        if name == ALL:
            sigmas = track.sigmas
            everything = errors
    n = int(found.sum())
    answer = Answer([share(NAME, "poses measured", n, len(found), setup.seed)])
    answer.notes += _notes(setup, len(rows))
    if not n:
        return answer
    set_up = np.repeat(np.arange(len(rows)), TOGETHER)[found]
    squares = {name: errors[found] ** 2 for name, errors in off.items()}
    for axis, kind in enumerate(KINDS):
        answer.numbers += _budget(squares, axis, kind, set_up, setup.seed)
    distances, angles = tracks.lengths(everything[found])
    answer.numbers += [
        _over_set_ups("position error", distances**2, "mm", set_up, setup.seed),
        _reproducibility(everything[found], set_up, setup.seed),
        *_true_by_reported(distances, angles, sigmas[found], set_up, setup.seed),
        far_count(NAME, int(((distances > FAR_MM) | (angles > FAR_DEG)).sum()), n, setup.seed),
    ]
    answer.pictures.append(_picture(poses.translation[found], distances))
    return answer


def _by_kind(off: Array, setup: Setup) -> Array:
    """Errors (n, 6) as depth, the root of the mean square of the two axes across it, mm, and the
    angle, deg, shape (n, 3).
    """
    depth = off[:, :3] @ setup.rig.cameras[0].axis
    across = np.sqrt(np.maximum((off[:, :3] ** 2).sum(axis=1) - depth**2, 0.0) / 2)
    return np.column_stack([depth, across, tracks.lengths(off)[1]])


def _budget(
    squares: dict[str, Array], axis: int, kind: str, set_up: np.ndarray, seed: int
) -> list[Number]:
    """The lines of one kind of error, squares (n, 3) of it: what noise, calibration and markers make
    of it, together, and the expanded uncertainty.
    """
    unit = "deg" if kind == "rotation" else "mm"
    one = {name: values[:, axis] for name, values in squares.items()}
    noise = one[NOISE]
    lines = [
        ("images' noise (type A)", noise),
        ("calibration (type B)", one[CALIBRATION] - noise),
        ("markers' places (type B)", one[MARKERS] - noise),
        ("combined, u", one[ALL]),
    ]
    numbers = [
        _over_set_ups(f"{kind}: {what}", values, unit, set_up, seed) for what, values in lines
    ]
    combined = numbers[-1]
    expanded = replace(
        combined,
        what=f"{kind}: expanded, U = {COVERAGE:g} u",
        value=COVERAGE * combined.value,
        low=COVERAGE * combined.low,
        high=COVERAGE * combined.high,
        note=f"{_freedom(numbers[:3], set_up):.0f} effective degrees of freedom; "
        f"{100 * np.mean(one[ALL] <= (COVERAGE * combined.value) ** 2):.0f} % of the errors lie within",
    )
    return [*numbers, expanded]


def _freedom(components: list[Number], set_up: np.ndarray) -> float:
    """Effective degrees of freedom of the combined uncertainty, of noise from all poses, and of
    calibration and markers from the set-ups (Welch 1947, Satterthwaite 1946: GUM, annex G.4).
    """
    set_ups = len(np.unique(set_up))
    freedoms = (len(set_up) - 1, max(set_ups - 1, 1), max(set_ups - 1, 1))
    u = np.array([number.value for number in components])
    return float((u**2).sum() ** 2 / (u**4 / np.array(freedoms)).sum())


def _over_set_ups(what: str, squares: Array, unit: str, set_up: np.ndarray, seed: int) -> Number:
    """The root of a mean square, with an interval over set-ups: within one all poses share its
    calibration.
    """
    means = np.array([float(squares[set_up == k].mean()) for k in np.unique(set_up)])
    interval = by_bootstrap(means, _root_of_mean)
    value = _root_of_mean(means)
    number = Number(NAME, what, "rms", value, unit, len(squares), seed)
    return number.within(_of_the_set_ups(interval))


def _root_of_mean(squares: Array) -> float:
    """Zero where noise makes a difference of squares negative."""
    return float(max(squares.mean(), 0.0)) ** 0.5


def _of_the_set_ups(interval: Interval) -> Interval:
    how = f"{interval.how} of the set-ups" if interval.how else ""
    return interval._replace(how=how)


def _reproducibility(off: Array, set_up: np.ndarray, seed: int) -> Number:
    """By how much all poses of a set-up are off together: what another calibration and mounting
    would change.
    """
    together = np.array([off[set_up == k, :3].mean(axis=0) for k in np.unique(set_up)])
    size = np.linalg.norm(together, axis=1)
    number = Number(
        NAME,
        "position, common to a set-up (reproducibility)",
        "rms",
        rms(size),
        "mm",
        len(size),
        seed,
    )
    return number.within(_of_the_set_ups(by_bootstrap(size, rms)))


def _true_by_reported(
    distances: Array, angles: Array, sigmas: Array, set_up: np.ndarray, seed: int
) -> list[Number]:
    """True error divided by the reported standard deviation."""
    numbers = []
    for kind, error, sigma in (
        ("position", distances, sigmas[:, 0]),
        ("angle", angles, sigmas[:, 1]),
    ):
        what = f"true / reported {kind} error"
        numbers.append(_over_set_ups(what, (error / sigma) ** 2, "", set_up, seed))
    return numbers


def _notes(setup: Setup, set_ups: int) -> list[str]:
    if _states_errors(setup.rig):
        calibration = "cameras as the rig's covariance says"
    else:
        calibration = (
            f"principal points by {CALIBRATION_PX:g} px and directions by {CALIBRATION_DEG:g} deg an "
            "axis, as a good calibration is"
        )
    placement_mm = setup.handle.placement_sigma_mm or PLACEMENT_MM
    warmer = 10 * EXPANSION * _depth_mm(setup)
    return [
        f"{set_ups} set-ups of {TOGETHER} poses each. The files are off, and state it: {calibration}, and "
        f"each coordinate of each marker by {placement_mm:g} mm. Depth is along the first camera's axis; "
        "across it is the root mean square of an axis. Nothing is registered: an error of the first "
        "camera's direction moves all poses.",
        "The reference is exact by construction: the bench renders each pose. The budget of a real rig has "
        "two lines more, its reference's own uncertainty and the temperature: a rig of aluminium that is "
        f"10 K warmer than at its calibration is larger by {1e6 * 10 * EXPANSION:.0f} parts in a million, "
        f"{warmer:.2f} mm of depth in the middle of the field.",
    ]


def _depth_mm(setup: Setup) -> float:
    """Of the middle of the field before the first camera."""
    return float(setup.rig.cameras[0].T_cam_world.apply(setup.field.centre)[2])


def _picture(places: Array, distances: Array) -> Picture:
    return Picture(
        "map_combined",
        "Where in the field the position error is how large with a calibration of your own, seen along y: a "
        "dot per pose, its colour the error on a logarithmic scale.",
        figures.as_png(
            figures.plot_error_map(
                places[:, [0, 2]], distances, ["x / mm", "z / mm"], "position error / mm"
            )
        ),
    )
