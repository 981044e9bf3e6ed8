"""The command ``trinolab refine``: a recording of the moving handle to a better rig and a better
handle file.

The handle is followed, instants that spread over its motion are chosen, the centres of their
markers are measured, and `calibration.bundle` adjusts rig, marker layout and poses together. The
handle is followed with the prior of that adjustment, so that a pose is not refused for an expected
error of the rig.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from ..calibration.bundle import Centres, fit_poses
from ..calibration.misfits import Cleaned, adjust_robustly, view_rms
from ..calibration.prior import Length, Prior, prior_of
from ..camera import Rig, RigCovariance
from ..checks import Array, as_number, as_whole
from ..datasets import handle_file, handle_of, rig_file, rig_of
from ..default_covariance import assumed
from ..files.journal import fingerprint, locked
from ..files.outputs import write_together, write_whole
from ..files.poses import poses_text, read_poses, transforms
from ..files.recording import Recording, open_recording, some_instants
from ..files.recording_writer import partial_of
from ..files.rigs import covariance_text, handle_text, rig_text
from ..handle import Handle
from ..methods import BEST
from .centres import MAX_WAY_PX, Motion, measured_centres, motion, spread_out
from .losses import lost_lines
from .parameters import FollowParameters
from .track import follow, known_poses, parts_of_folder

log = logging.getLogger("trinolab")

FEWEST = 10  # instants; with fewer nearly all would come from what was known before
# Times that the centres are measured: where they lie in a marker's image depends on pose and layout.
PASSES = 2
ADVICE = "record a minute at about 30 mm/s, through all of the volume, and turn the handle"
# the centres are measured anew anyhow
FOLLOWED_BY = FollowParameters(estimator=BEST)


class Refined(NamedTuple):
    """A rig and a handle adjusted to a recording.

    Attributes
    ----------
    start_rig, start_handle
        The rig and the handle before.
    cleaned : Cleaned
        The adjustment.
    prior : Prior
        The prior of the adjustment.
    frames : ndarray of int
        The chosen frames, in the order of `cleaned.reasons`.
    still, length : int
        Numbers of instants at which the handle is still enough, and of all instants.
    before_px, after_px : float
        Rms distance of the centres from their predictions by the old rig and handle, with the poses
        that fit those best, and by the new ones.
    views : pandas.DataFrame
        A row per camera and instant: `frame`, `camera`, `status` (``used``, ``left out``, ``nothing
        seen``), `centres`, `rms_px` (NaN if not used), `reason`.
    """

    start_rig: Rig
    start_handle: Handle
    cleaned: Cleaned
    prior: Prior
    frames: np.ndarray
    still: int
    length: int
    before_px: float
    after_px: float
    views: pd.DataFrame


class _Task(NamedTuple):
    """A refinement to do: the recording and its handle, which say how well they are known; poses
    known at some frames, the prior, how many instants are taken, where finished work is kept, and
    what tells this work from another.
    """

    recording: Recording
    handle: Handle
    known: Mapping[int, RigidTransform]
    prior: Prior
    most: int
    kept: Path
    made_from: str
    progress: bool


class _TooLittleError(ValueError):
    """A recording that does not say enough of rig and handle."""


def refine_files(
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    sources: Mapping[str, str | Path],
    out: str | Path,
    start: str | Path | None = None,
    fps: float | None = None,
    timestamps: str | Path | None = None,
    instants: int = 300,
    length: tuple[str, str, float] | None = None,
    progress: bool = True,
) -> Refined:
    """Adjust a rig and a handle's markers to a recording of the moving handle, and write both.

    Finished work, the poses of all instants and then the centres of each, is stored in the folder
    ``<out>.partial``. The same call resumes an interrupted one.

    Parameters
    ----------
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones: the initial values. Their
        uncertainty is in the rig's covariance (file) and the handle's `placement_sigma_mm`;
        defaults stand for what they do not state, see `calibration.prior.prior_of`.
    sources : mapping of str to path
        For each camera's name its video, or its folder of images (in the order of their names).
    out : path
        A new or empty folder for ``rig.toml``, ``rig.covariance.toml``, ``handle.toml`` and
        ``views.csv``.
    start : path, optional
        CSV of poses known at some frames: for a handle that looks alike from several sides.
    fps, timestamps
        As for `track.track_files`.
    instants : int
        Most instants to adjust; of more, those that spread most are chosen.
    length : (str, str, float), optional
        A known length that fixes the scale: two cameras, or two markers by their numbers, and their
        distance in mm.
    progress : bool
        Show progress bars on standard error, if that is a terminal.

    Raises
    ------
    ValueError
        Names the file or the argument: missing, unreadable, does not fit, a length between cameras
        or markers that do not exist, a handle that is seen still in too few instants, or whose
        identity is not known, centres that no rig explains. Finished work is kept, unless the
        recording contains too little, since the same call would be refused again.
    KeyboardInterrupt
        Says where finished work is kept.
    """
    the_rig, the_handle = rig_of(rig), handle_of(handle)
    values = [what for what in (rig, handle) if isinstance(what, Rig | Handle)]
    rig_name = "rig" if isinstance(rig, Rig) else rig_file(rig)
    handle_name = "handle" if isinstance(handle, Handle) else handle_file(handle)
    recording = open_recording(sources, the_rig, fps, timestamps)
    prior = prior_of(the_rig, the_handle, _as_length(length, the_rig, the_handle))
    most = as_whole(instants, "instants", low=FEWEST)
    known = known_poses(start, recording)
    if len(the_handle.symmetries) > 1 and not known:
        raise ValueError(
            f"start: {handle_name} looks alike from {len(the_handle.symmetries)} sides; expected a pose "
            "that says which marker is which"
        )
    recording = recording._replace(
        rig=replace(the_rig, covariance=RigCovariance(the_rig.names, prior.rig))
    )
    lines = assumed(the_rig, the_handle, rig_name, handle_name)
    the_handle = replace(the_handle, placement_sigma_mm=prior.placement_sigma_mm)
    files = [path for path in (rig_name, handle_name) if isinstance(path, Path)]
    files += [Path(path) for path in (start, timestamps) if path is not None]
    options = (start is None, fps, most, length, prior.rig.tolist())
    made_from = fingerprint(files, sources, *options, *map(_content_of, values))
    partial = partial_of(out)
    partial.mkdir(exist_ok=True)
    with locked(partial):
        task = _Task(recording, the_handle, known, prior, most, partial, made_from, progress)
        try:
            refined = _refined(task)
            _write(refined, partial, Path(out))
        except _TooLittleError:
            shutil.rmtree(partial)
            raise
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"what is finished is kept in {partial}; the same command goes on"
            ) from None
    for line in lines:
        log.info(line)
    return refined


def refine_folder(
    folder: str | Path,
    out: str | Path,
    rig: Rig | str | Path | None = None,
    handle: Handle | str | Path | None = None,
    timestamps: str | Path | None = None,
    **options: Any,
) -> Refined:
    """Refine the rig and the handle of a recording folder, see `files.recording`; the rest as for
    `refine_files`, and others than the folder's rig and handle as for `track.track_folder`.
    """
    rig, handle, sources, times = parts_of_folder(folder, rig, handle, timestamps)
    return refine_files(rig, handle, sources, out, timestamps=times, **options)


def _content_of(value: Rig | Handle) -> str:
    """The text of a rig or a handle with all that is known of it."""
    if isinstance(value, Handle):
        return handle_text(value)
    known = value.covariance
    return rig_text(value) + ("" if known is None else covariance_text(known))


def _as_length(length: tuple[str, str, float] | None, rig: Rig, handle: Handle) -> Length | None:
    """The stated length; its ends are cameras, else markers."""
    if length is None:
        return None
    *ends, mm = length
    mm = as_number(mm, "length", low=0.0, high=1e6, open_low=True)
    markers = [str(k) for k in range(len(handle.marker_centres))]
    for of, names in (("cameras", list(rig.names)), ("markers", markers)):
        if all(end in names for end in ends) and ends[0] != ends[1]:
            return Length(of, names.index(ends[0]), names.index(ends[1]), mm)
    raise ValueError(
        f"length: expected two cameras of {', '.join(rig.names)}, or two markers of 0 to "
        f"{len(markers) - 1}, got {ends[0]} and {ends[1]}"
    )


def _refined(task: _Task) -> Refined:
    """Follow, choose, then measure and adjust, and once again with what the first time gave."""
    table = _followed(task)
    measured = table[table["status"] == "measured"]
    moved = motion(measured, task.recording.rig, FOLLOWED_BY.exposure_s)
    good = measured[moved.still]
    if len(good) < FEWEST:
        raise _TooLittleError(
            f"{task.recording.footage[0].path}: {len(good)} instants show the handle still "
            f"enough, expected {FEWEST} or more; {_to_record(task, table, moved)}"
        )
    rows = good.iloc[spread_out(transforms(good), task.most)]
    frames = rows["frame"].to_numpy()
    poses = transforms(rows)
    rig = task.recording.rig
    handle = task.handle
    for number in range(PASSES):
        seen = measured_centres(
            task.recording._replace(rig=rig),
            handle,
            frames,
            poses,
            task.kept / f"centres_{number}.json",
            fingerprint(
                [],
                {},
                task.made_from,
                rig_text(rig),
                handle_text(handle),
                poses.as_matrix().tolist(),
            ),
            task.progress,
        )
        try:
            adjusted = adjust_robustly(task.recording.rig, task.handle, poses, seen, task.prior)
        except ValueError as error:
            raise _TooLittleError(str(error)) from None
        rig = adjusted.bundle.rig
        handle = adjusted.bundle.handle
        new = dict(zip(adjusted.instants.tolist(), adjusted.bundle.poses, strict=True))
        poses = RigidTransform.concatenate([new.get(k, pose) for k, pose in enumerate(poses)])
    counts = (len(good), len(table))
    return _as_refined(task, adjusted, frames, counts, seen)


def _to_record(task: _Task, table: pd.DataFrame, moved: Motion) -> str:
    """A line about a handle that was not still enough, and what to record instead."""

    def images_of(numbers: list[int]) -> Iterator[Sequence[np.ndarray]]:
        frames = table["frame"].iloc[numbers].tolist()
        return (now.images for now in some_instants(task.recording, frames))

    shown = f"it is measured in {len(moved.speed)} of {len(table)}"
    causes = lost_lines(table, task.recording.rig, task.handle, images_of)
    if len(moved.speed) < FEWEST:
        return "; ".join([shown, *causes, ADVICE])
    slowest = np.percentile(moved.way_px, 10)
    # the speed that would be still in the middle of the volume
    moving = moved.way_px > 0
    enough = MAX_WAY_PX * np.median(moved.speed[moving] / moved.way_px[moving])
    return (
        f"{shown}, and moves at {np.median(moved.speed):.0f} mm/s there: {np.median(moved.way_px):.1f} px while "
        f"the shutter is open ({slowest:.1f} px in the stillest tenth), where {MAX_WAY_PX:g} px or "
        f"{enough:.0f} mm/s count as still; {ADVICE}"
    )


def _followed(task: _Task) -> pd.DataFrame:
    """The poses of all instants: those that are kept, or followed now."""
    kept = task.kept / f"poses_{task.made_from}.csv"
    if not kept.exists():
        table, _ = follow(task.recording, task.handle, FOLLOWED_BY, task.known, task.progress)
        write_whole(kept, poses_text(table))
    return read_poses(kept)


def _as_refined(
    task: _Task, cleaned: Cleaned, frames: np.ndarray, counts: tuple[int, int], seen: Centres
) -> Refined:
    rig = task.recording.rig
    before = fit_poses(rig, task.handle, cleaned.bundle.poses, cleaned.seen)
    return Refined(
        rig,
        task.handle,
        cleaned,
        task.prior,
        frames,
        *counts,
        _rms(before.residuals_px),
        _rms(cleaned.bundle.residuals_px),
        _view_table(rig, cleaned, frames, seen),
    )


def _rms(residuals: Array) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))


def _view_table(rig: Rig, cleaned: Cleaned, frames: np.ndarray, seen: Centres) -> pd.DataFrame:
    """The table `Refined.views`."""
    shape = cleaned.reasons.shape
    count = np.zeros(shape, int)
    np.add.at(count, (seen.instant, seen.camera), 1)
    used = cleaned.seen._replace(instant=cleaned.instants[cleaned.seen.instant])
    rms = view_rms(used, cleaned.bundle, shape)
    seen_or_not = np.where(count > 0, "left out", "nothing seen")
    status = np.where(np.isfinite(rms), "used", seen_or_not)
    rows = [
        {
            "frame": int(frames[i]),
            "camera": rig.names[c],
            "status": str(status[i, c]),
            "centres": int(count[i, c]),
            "rms_px": rms[i, c],
            "reason": cleaned.reasons[i, c],
        }
        for i, c in np.ndindex(shape)
    ]
    return pd.DataFrame(rows)


def _write(refined: Refined, partial: Path, out: Path) -> None:
    """Write the result, and give it its name when it is whole; then drop the kept work."""
    bundle = refined.cleaned.bundle
    result = partial / "result"
    result.mkdir(exist_ok=True)
    assert bundle.rig.covariance is not None
    write_together(
        {
            result / "rig.toml": rig_text(bundle.rig),
            result / "rig.covariance.toml": covariance_text(bundle.rig.covariance),
            result / "handle.toml": handle_text(bundle.handle),
            result / "views.csv": refined.views.to_csv(index=False, float_format="%.6g"),
        }
    )
    try:
        result.rename(out.resolve())
    except OSError as error:
        raise ValueError(f"{out}: cannot be written ({error.strerror})") from None
    shutil.rmtree(partial)
