"""The command ``trinolab evaluate``: poses compared with their truth, from files or tables.

Besides the mean errors it reports flips between equivalent poses, poses far off, and time lost.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from .datasets import handle_of, load_handle, shipped_handles
from .files.inputs import read_csv
from .files.joining import join
from .files.poses import STATUSES, as_poses, read_poses, transforms
from .files.rigs import read_handle
from .handle import Handle
from .metrics import (
    FAR_DEG,
    FAR_MM,
    PoseErrors,
    can_be_measured,
    euler_deg,
    far_off,
    flips,
    geodesic_deg,
    nearest_equivalent,
    nearest_index,
    pose_errors,
    track_equivalent,
    waits,
)

log = logging.getLogger("trinolab")

# a handle whose symmetries make the poses fit has this share of the angle between them, at most
EXPLAINS = 0.25
FEWEST = 3  # poses that show a symmetry
# beside the truth: for each frame how many markers each camera truly sees
COUNTS = "truth_markers.csv"
STEEP_DEG = 60.0  # of beta: alpha's and gamma's errors grow by 1 / cos(beta), twice here


@dataclass(frozen=True)
class TrackQuality:
    """The quality of a track that follows its truth.

    Attributes
    ----------
    flips : int
        How often the nearest equivalent changes from one measured pose to the next: each is an
        error.
    far_off : int
        Measured poses that are off by more than 2 mm or 5 deg, by one equivalent for the whole
        track.
    waits : tuple of int
        For each loss that ended, the instants without a measured pose until the next one, see
        `waits`.
    unended : int or None
        The same for a loss that did not end; None if the last instant was measured, or none was.
    """

    flips: int
    far_off: int
    waits: tuple[int, ...]
    unended: int | None


@dataclass(frozen=True)
class Evaluation:
    """A comparison of a table of poses with its truth.

    Attributes
    ----------
    instants : int
        Of the truth.
    measured, ambiguous, predicted, lost : int
        Instants by status; an instant of the truth that has no row counts as lost.
    errors : PoseErrors or None
        Over the rows that hold a pose, `predicted` ones left out; None if there is none.
    visible, visible_measured : int
        Instants at which one camera truly sees four markers, or two see three each, and how many of
        them are measured; 0 if the truth does not say how many markers are seen. The markers that
        two cameras share are in a file beside it, ``truth_markers.csv``, which `bench.rendering`
        writes.
    track : TrackQuality
        Of the `measured` rows: flips, poses far off, losses. A loss counts the visible instants, if
        they are known.
    steep : int
        Compared poses near gimbal lock, whose true beta is larger than `STEEP_DEG`: there errors of
        alpha and gamma may be more than twice as large as that of the rotation.
    steepest_deg : float
        The largest true beta, without its sign, of the compared poses; NaN without any.
    """

    instants: int
    measured: int
    ambiguous: int
    predicted: int
    lost: int
    errors: PoseErrors | None
    visible: int
    visible_measured: int
    track: TrackQuality
    steep: int = 0
    steepest_deg: float = np.nan


def evaluate(
    poses: str | Path | pd.DataFrame,
    truth: str | Path | pd.DataFrame,
    handle: Handle | str | Path,
) -> Evaluation:
    """Compare poses with their truth, up to the handle's symmetry (Eq. 26-27).

    The `measured` rows are compared as one track, with one equivalent for all; each `ambiguous` row
    is compared with its own nearest equivalent. The log reports where another handle's symmetry is
    likely the right one.

    Parameters
    ----------
    poses, truth : path or pandas.DataFrame
        A file of poses, or a table as `read_poses` and ``trinolab.track`` give it; joined on `frame`.
    handle : Handle or path or str
        A `Handle`, its file, or the name of a shipped one.

    Raises
    ------
    ValueError
        If a file or a table is missing or malformed, or the two do not belong together, see
        `joining.join`.
    """
    estimates, poses_name = _table_of(poses, "poses")
    true, truth_name = _table_of(truth, "truth")
    the_handle = handle_of(handle)
    both = join(estimates, true, poses_name, truth_name)
    true = true[true["status"] != "lost"].sort_values("frame")
    counts = both["status"].value_counts()
    measured, ambiguous, predicted = (
        int(counts.get(s, 0)) for s in ("measured", "ambiguous", "predicted")
    )
    lost = len(true) - measured - ambiguous - predicted
    rows = both[both["status"] == "measured"].sort_values("frame")
    measured_rows = true["frame"].isin(rows["frame"]).to_numpy()
    beside = None if isinstance(truth, pd.DataFrame) else Path(truth)
    called = handle.name if isinstance(handle, Handle) else str(handle)
    if beside is not None and not isinstance(poses, pd.DataFrame) and beside.samefile(poses):
        log.warning("%s: is given as the poses and as their truth", truth)
    for line in _symmetry_lines(both, true, the_handle, called, beside):
        log.warning(line)
    visible = _visible(true, None if beside is None else beside.with_name(COUNTS))
    lasted = waits(measured_rows, visible if visible.any() else None)
    compared = _compared(both, true, the_handle)
    beta = np.abs(euler_deg(compared[1])[:, 1]) if compared else np.empty(0)
    return Evaluation(
        len(true),
        measured,
        ambiguous,
        predicted,
        lost,
        pose_errors(*compared) if compared else None,
        int(visible.sum()),
        int((visible & measured_rows).sum()),
        _quality(rows, true, the_handle, *lasted),
        int((beta > STEEP_DEG).sum()),
        float(beta.max()) if len(beta) else np.nan,
    )


def _symmetry_lines(
    both: pd.DataFrame, true: pd.DataFrame, handle: Handle, file: str, truth: Path | None
) -> list[str]:
    """A line where the poses are likely of another handle than the given one, which has the name
    `file`; `truth` is the file of the true poses.
    """
    several = len(handle.symmetries)
    sides = "symmetry" if several == 1 else "symmetries"
    beside = None if truth is None else truth.with_name("handle.toml")
    theirs = None
    if beside is not None and beside.exists():
        with suppress(ValueError):
            theirs = read_handle(beside)
    if theirs is not None and len(theirs.symmetries) != several:
        return [
            f"{file}: the errors count up to the {several} {sides} of {handle.name}, but "
            f"{beside}, beside the truth, is {theirs.name} with {len(theirs.symmetries)}: likely "
            f"--handle {beside} is meant"
        ]
    rows = both[both["status"] == "measured"].sort_values("frame")
    if len(rows) < FEWEST:
        return []
    pair = transforms(rows), transforms(true.set_index("frame").loc[rows["frame"]])
    angle = _angle_deg(*pair, handle)
    if angle > FAR_DEG:
        for name in shipped_handles():
            if (fits := _angle_deg(*pair, load_handle(name))) <= EXPLAINS * angle:
                return [
                    f"{file}: under the symmetries of the shipped handle {name} the poses fit the truth far "
                    f"better (median {fits:.3g} deg instead of {angle:.3g}): likely --handle {name} is meant"
                ]
    elif (
        several > 1
        and theirs is None
        and not (
            (both["status"] == "ambiguous").any() or nearest_index(*pair, handle.symmetries).any()
        )
    ):
        return [
            f"{file}: no pose needs the {several} symmetries of {handle.name}, the errors are the same "
            "without: likely another handle was tracked, or this one from a known pose"
        ]
    return []


def _angle_deg(poses: RigidTransform, truth: RigidTransform, handle: Handle) -> float:
    """The median angle between the poses of a track and the truth, up to a handle's symmetry."""
    turned = track_equivalent(poses, truth, handle.symmetries)
    return float(np.median(geodesic_deg(turned, truth)))


def as_lines(result: Evaluation) -> list[str]:
    """The lines of an evaluation, for a person to read."""
    lines = [f"instants   {result.instants:8d}"]
    for status in STATUSES:
        count = getattr(result, status)
        lines.append(f"{status:10s} {count:8d}   {100 * count / result.instants:5.1f} %")
    if result.visible:
        share = 100 * result.visible_measured / result.visible
        lines.append(f"visible    {result.visible:8d}   {share:5.1f} % measured")
    if result.errors is None:
        return [*lines, "no pose to compare"]
    lines += _error_lines(result.errors)
    if result.steep:
        lines.append(
            f"near gimbal lock: |beta| > {STEEP_DEG:g} deg in {result.steep} of {result.errors.n}, up to "
            f"{result.steepest_deg:.1f} deg; alpha and gamma err more there than the rotation (geodesic)"
        )
    return [*lines, *_track_lines(result.track)]


def _error_lines(e: PoseErrors) -> list[str]:
    lines = [
        f"errors of {e.n} poses, up to the handle's symmetry:",
        "              mean   median      max",
        f"E_t       {e.E_t_mm:8.3f} {e.position_median_mm:8.3f} {e.position_max_mm:8.3f} mm    (Eq. 26)",
    ]
    for name in ("alpha", "beta", "gamma"):
        mean = getattr(e, f"E_{name}_deg")
        median = getattr(e, f"{name}_median_deg")
        lines.append(f"{'E_' + name:9s} {mean:8.3f} {median:8.3f}          deg   (Eq. 27)")
    geodesic = (e.geodesic_mean_deg, e.geodesic_median_deg, e.geodesic_max_deg)
    return [*lines, "geodesic  " + " ".join(f"{value:8.3f}" for value in geodesic) + " deg"]


def _track_lines(track: TrackQuality) -> list[str]:
    losses = len(track.waits) + (track.unended is not None)
    return [
        "the measured poses as one track:",
        f"flips      {track.flips:8d}",
        f"far off    {track.far_off:8d}   by more than {FAR_MM:g} mm or {FAR_DEG:g} deg",
        f"losses     {losses:8d}{how_long(track)}",
    ]


def how_long(track: TrackQuality) -> str:
    many = len(track.waits) > 8
    ended = f"at most {max(track.waits)}" if many else ", ".join(map(str, track.waits))
    phrases = [f"back after {ended} instants"] * bool(ended)
    phrases += [] if track.unended is None else [f"not back in the last {track.unended} instants"]
    return f"   {', '.join(phrases)}" if phrases else ""


def _table_of(poses: str | Path | pd.DataFrame, name: str) -> tuple[pd.DataFrame, str | Path]:
    """A table of poses, and what it is called where something is wrong with it."""
    if isinstance(poses, pd.DataFrame):
        return as_poses(poses, name), name
    if not isinstance(poses, (str, Path)):
        raise ValueError(f"{name}: expected a file or a table of poses, got {type(poses).__name__}")
    return read_poses(poses), poses


def _visible(true: pd.DataFrame, counts: Path | None) -> np.ndarray:
    """Whether enough is truly seen to fix the pose, a bool for each row of a truth; never if
    nothing says so.
    """
    markers = true["markers"] if "markers" in true else pd.Series(0, true.index)
    by_one = can_be_measured(markers.to_numpy(dtype=float)[:, None])
    if counts is None or not counts.exists():
        return by_one
    seen = read_csv(counts)
    if "frame" not in seen or not all(map(pd.api.types.is_numeric_dtype, seen.dtypes)):
        raise ValueError(f"{counts}: expected numbers in the column frame and one per camera")
    enough = can_be_measured(seen.drop(columns="frame").to_numpy())
    return by_one | true["frame"].isin(seen["frame"][enough]).to_numpy()


def _quality(
    rows: pd.DataFrame,
    true: pd.DataFrame,
    handle: Handle,
    ended: tuple[int, ...],
    unended: int | None,
) -> TrackQuality:
    """Quality of the measured rows, in the order of time."""
    if rows.empty:
        return TrackQuality(0, 0, ended, unended)
    pairs = transforms(rows), transforms(true.set_index("frame").loc[rows["frame"]])
    return TrackQuality(
        flips(*pairs, handle.symmetries), far_off(*pairs, handle.symmetries), ended, unended
    )


def _compared(
    both: pd.DataFrame, true: pd.DataFrame, handle: Handle
) -> tuple[RigidTransform, RigidTransform] | None:
    """Estimates and truths of the measured and the ambiguous rows of the joined table; None if there
    are none.
    """
    estimates, truths = [], []
    for status, equivalent in (("measured", track_equivalent), ("ambiguous", nearest_equivalent)):
        rows = both[both["status"] == status]
        if len(rows):
            true_poses = transforms(true.set_index("frame").loc[rows["frame"]])
            estimates.append(equivalent(transforms(rows), true_poses, handle.symmetries))
            truths.append(true_poses)
    if not estimates:
        return None
    return RigidTransform.concatenate(estimates), RigidTransform.concatenate(truths)
