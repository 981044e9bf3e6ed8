"""What `trinolab preflight` does: from a recording to a table that says whether the set-up is good.

Up to 300 instants are looked at, of a longer recording those in its middle. With a rig and a handle
the handle is tracked as `trinolab track` does. Without a rig only images are judged, without a handle
only light, time and cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.files.images import is_image
from trinolab.files.outputs import check_target, write_whole
from trinolab.files.recording import (
    VIDEO_SUFFIXES,
    Footage,
    Frames,
    find_footage,
    frames_of,
    open_footage,
    rate_of,
    read_timestamps,
)
from trinolab.files.rigs import read_handle, read_rig
from trinolab.handle import Handle
from trinolab.methods import DEFAULT, estimator_of
from trinolab.sensitivity import offsets_at
from workbench.capture.capture import HAND_MM_S

from . import criteria
from .criteria import NOT_MEASURED, NOT_USABLE, of_cameras, overall, row
from .seen import Seen

MOST_INSTANTS = 300
FEWEST = 5  # instants with a pose that tell something
FARTHEST = 10.0  # baselines to the place at which axes meet
PART_MARKERS = 2  # from which on a camera takes part in a pose

Row = dict[str, str | float]
T = TypeVar("T")


class Clip(NamedTuple):
    """What is looked at: the cameras' names and footage, their times (s) if they are known, and
    frames per second.
    """

    names: tuple[str, ...]
    footage: tuple[Footage, ...]
    times_s: Array | None
    fps: float


def preflight(
    folder: str | Path | None,
    sources: Mapping[str, str | Path] | None = None,
    rig: str | Path | None = None,
    handle: str | Path | None = None,
    fps: float | None = None,
    timestamps: str | Path | None = None,
    out: str | Path | None = None,
    progress: bool = True,
) -> pd.DataFrame:
    """Judge a set-up by a recording.

    Parameters
    ----------
    folder : path or None
        A recording folder; its ``rig.toml`` and ``handle.toml`` are used if they are there.
    sources : mapping of str to path, optional
        For each camera's name its video, or its folder of images, instead of `folder`.
    rig, handle : path, optional
        Other files than the folder's.
    fps : float, optional
        Frames a second, where there are no timestamps; without it what the videos state, or else 30.
    timestamps : path, optional
        CSV with the columns ``frame`` and ``t_s``.
    out : path, optional
        CSV of the table to write.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        A row per question, with the columns `criteria.COLUMNS`.

    Raises
    ------
    ValueError
        If there is not exactly one of `folder` and `sources`; names the file that is missing, cannot
        be read or does not fit the rig.
    """
    if (folder is None) == (not sources):
        raise ValueError("expected a recording folder, or else --video for each camera")
    if out is not None:
        check_target(out)
    root = None if folder is None else Path(folder)
    the_rig = _read(rig, root, "rig.toml", read_rig)
    the_handle = _read(handle, root, "handle.toml", read_handle)
    clip = _clip(root, sources, the_rig, fps, timestamps)
    seen = look(clip, the_rig, the_handle, progress)
    table = pd.DataFrame(rows_of(seen, clip, the_rig, the_handle), columns=criteria.COLUMNS)
    if out is not None:
        write_whole(out, table.to_csv(index=False, float_format="%.6g"))
    return table


def _read(
    given: str | Path | None, root: Path | None, name: str, read: Callable[[str | Path], T]
) -> T | None:
    """A file that is given, or the folder's if it has one; None without."""
    if given is not None:
        return read(given)
    return read(root / name) if root is not None and (root / name).exists() else None


def _clip(
    root: Path | None,
    sources: Mapping[str, str | Path] | None,
    rig: Rig | None,
    fps: float | None,
    timestamps: str | Path | None,
) -> Clip:
    """Open the footage; of a folder without a rig what lies there."""
    if sources is None:
        assert root is not None
        sources = _lying_in(root) if rig is None else find_footage(root, rig)
        if timestamps is None and (root / "timestamps.csv").exists():
            timestamps = root / "timestamps.csv"
    names = tuple(sources) if rig is None else rig.names
    if rig is not None and set(sources) != set(names):
        raise ValueError(
            f"expected a video or folder for each camera of the rig ({', '.join(names)}), got "
            f"{', '.join(sources)}"
        )
    footage = tuple(open_footage(sources[name]) for name in names)
    times = None if timestamps is None else read_timestamps(timestamps)
    return Clip(names, footage, times, rate_of(footage if times is None else (), fps))


def _lying_in(root: Path) -> dict[str, Path]:
    """The cameras of a recording folder that has no rig: its folders of images, or its videos."""
    if not root.is_dir():
        raise ValueError(f"{root}: no such folder")
    inside = root / "images" if (root / "images").is_dir() else root
    files = {
        path.name: path
        for path in sorted(inside.iterdir())
        if path.is_dir() and any(map(is_image, path.iterdir()))
    }
    videos = {p.stem: p for p in sorted(root.iterdir()) if p.suffix.lower() in VIDEO_SUFFIXES}
    if not (files or videos):
        raise ValueError(f"{root}: neither folders of images nor videos in it")
    return files or videos


def look(clip: Clip, rig: Rig | None, handle: Handle | None, progress: bool = True) -> Seen:
    """See what there is to see."""
    count = min(max(one.length for one in clip.footage) or MOST_INSTANTS, MOST_INSTANTS)
    seen = Seen(clip.names, rig, handle, count)
    frames = _instants(clip, rig)
    with tqdm(total=count, unit="instant", disable=None if progress else True) as bar:
        if rig is None or handle is None:
            for now in frames:
                seen.add(now, None)
                bar.update()
        else:
            # a recording that is refused need not wait for the tracker
            from trinolab.following import posetracker
            from trinolab.following.parameters import FollowParameters

            for now, tracked in posetracker.track_instants(
                frames, rig, handle, FollowParameters(estimator=estimator_of(DEFAULT))
            ):
                seen.add(now, tracked)
                bar.update()
    if not seen.times_s:
        raise ValueError(f"{clip.footage[0].path}: no frame in it")
    return seen


def _instants(clip: Clip, rig: Rig | None) -> Iterator[Frames]:
    """The instants that are looked at, in their order; they end with the shortest footage."""
    length = min(one.length for one in clip.footage)
    first = max(0, (length - MOST_INSTANTS) // 2)
    sizes = map(_size_of, clip.footage) if rig is None else [c.size for c in rig.cameras]
    reported: set[str] = set()
    streams = [
        frames_of(one, size, first, reported) for one, size in zip(clip.footage, sizes, strict=True)
    ]
    together = zip(*streams, strict=False)
    for frame, images in enumerate(islice(together, MOST_INSTANTS), first):
        if clip.times_s is None:
            yield Frames(frame, frame / clip.fps, list(images))
        elif frame < len(clip.times_s):
            yield Frames(frame, float(clip.times_s[frame]), list(images))


def _size_of(footage: Footage) -> tuple[int, int] | None:
    """Width and height of a camera's first frame, which all of them must have; None without one."""
    first = next(frames_of(footage), None)
    return None if first is None else (first.shape[1], first.shape[0])


def rows_of(seen: Seen, clip: Clip, rig: Rig | None, handle: Handle | None) -> list[Row]:
    """All rows that this recording has something to say about."""
    rows = _of_images(seen) if handle is None else _of_markers(seen)
    rows += _of_time(seen, clip)
    if rig is not None and handle is not None:
        rows += [_smear(seen, handle), _apart(seen, rig)]
    if rig is not None:
        rows += of_rig(rig, place_of_handle(seen, rig))
    if rig is not None and handle is not None:
        rows += _of_poses(seen)
    return rows


def _of_images(seen: Seen) -> list[Row]:
    """Light, without a handle to measure it by."""
    return [
        of_cameras(criteria.RANGE, seen.names, np.median(seen.ranges, axis=0)),
        of_cameras(criteria.WHITE_PIXELS, seen.names, 100 * np.median(seen.whites, axis=0), 1),
    ]


def _of_markers(seen: Seen) -> list[Row]:
    """Light and edges of the markers."""
    names = seen.names
    spots = [seen.of_camera(c) for c in range(len(names))]
    if not any(spots):
        return [row(criteria.CONTRAST, 0.0, "nothing like a marker was found")]
    contrast = np.array([_median([s.contrast for s in some]) for some in spots])
    size = np.array([_median([s.size_px for s in some]) for some in spots])
    white = [_mean([s.white for s in some]) for some in spots]
    blur = np.array([_median(seen.blurs_px(c)) for c in range(len(names))])
    greys = [
        f" ({_median([s.grey for s in some]):.0f} on {_median([s.ground for s in some]):.0f})"
        for some in spots
    ]
    rows = [of_cameras(criteria.CONTRAST, names, contrast, notes=greys)]
    if seen.noises:
        noise = np.maximum(np.median(seen.noises, axis=0), 0.3)
        rows.append(of_cameras(criteria.NOISE, names, contrast / noise))
    rows += [
        of_cameras(criteria.WHITE, names, 100 * np.array(white)),
        of_cameras(criteria.WHITE_PIXELS, names, 100 * np.median(seen.whites, axis=0), 1),
        of_cameras(criteria.FOCUS, names, blur, 1),
        of_cameras(criteria.SIZE, names, size, 1),
    ]
    return rows


def _of_time(seen: Seen, clip: Clip) -> list[Row]:
    """What should not change from frame to frame, and the frames themselves."""
    n = len(seen.times_s)
    if n < 3:
        return []
    gains = seen.gains()
    swing = 100 * np.subtract(*np.quantile(gains, [0.975, 0.025], axis=0)) / 2
    repeated = 100 * seen.repeated / (n - 1)
    steps = np.diff(seen.times_s)
    missed = (
        100 * float((steps > 1.5 * np.median(steps)).mean()) if clip.times_s is not None else 0.0
    )
    rows = [of_cameras(criteria.FLICKER, seen.names, swing, 1)]
    worst = max(missed, float(repeated.max()))
    text = f"{missed:.1f} % missing" if clip.times_s is not None else "no times"
    rows.append(row(criteria.STEPS, worst, f"{text}; repeated: {repeated.max():.1f} %"))
    return rows


def _smear(seen: Seen, handle: Handle) -> Row:
    """How far a marker of a hand's motion moves while the shutter is open, by its diameter."""
    exposure = seen.exposure()
    if exposure is None:
        return row(criteria.SMEAR, np.nan, "the rod hardly moved", "move the rod while recording")
    by_time = HAND_MM_S / handle.marker_diameter_mm
    if exposure.time_s >= exposure.shortest_s:
        share = exposure.time_s * by_time
        text = f"{share:.2f} of a marker: an exposure of {1e3 * exposure.time_s:.0f} ms"
        return row(criteria.SMEAR, share, text)
    share = exposure.shortest_s * by_time
    text = (
        f"less than {share:.2f} of a marker: an exposure below {1e3 * exposure.shortest_s:.0f} ms"
    )
    if criteria.SMEAR.verdict(share) == criteria.GOOD:
        return row(criteria.SMEAR, share, text)
    return row(criteria.SMEAR, np.nan, text, "move the rod faster: so slowly no more can be said")


def _apart(seen: Seen, rig: Rig) -> Row:
    """How far apart in time the cameras are."""
    if sum(T is not None for T in seen.poses) < FEWEST:
        return row(criteria.APART, np.nan, "too few poses", "the rows above and below say why")
    from trinolab.following.sync import estimate_offsets

    offsets = estimate_offsets(np.array(seen.times_s), np.stack(seen.uv, axis=1), rig)
    known = np.isfinite(offsets.offset_s)
    if known.sum() < 2:
        reason = next((reason for reason in offsets.reasons if reason), "")
        return row(
            criteria.APART, np.nan, reason, "move the rod while recording, across the images"
        )
    late = 1e3 * (offsets.offset_s - np.nanmin(offsets.offset_s))
    sigma = 1e3 * offsets.sigma_s
    text = ", ".join(
        f"{name} +{ms:.1f} (+- {s:.1f})" if np.isfinite(ms) else f"{name} -"
        for name, ms, s in zip(rig.names, late, sigma, strict=True)
    )
    # what is not surely there does not count
    surely = float(np.nanmax(np.maximum(late - 2 * np.nan_to_num(sigma), 0.0)))
    if not known.all() and criteria.APART.verdict(surely) == criteria.GOOD:
        return row(criteria.APART, np.nan, f"{text} ms", "one camera shows nothing of the others")
    return row(criteria.APART, surely, f"{text} ms")


def of_rig(rig: Rig, place: Array | None) -> list[Row]:
    """What the rig file alone decides, where the handle is."""
    if place is None:
        nowhere = ("nobody knows where the rod will be: the axes hardly meet", "record the rod")
        return [row(one, np.nan, *nowhere) for one in (criteria.ANGLE, criteria.COST)]
    sights = np.stack([place - camera.centre for camera in rig.cameras])
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    angles = {
        (i, j): float(np.rad2deg(np.arccos(np.clip(sights[i] @ sights[j], -1, 1))))
        for i, j in rig.pairs
    }
    text = ", ".join(
        f"{rig.names[i]}-{rig.names[j]} {angle:.0f}" for (i, j), angle in angles.items()
    )
    widest = max(min(angle, 180 - angle) for angle in angles.values())
    rows = [row(criteria.ANGLE, widest, f"{text} deg")]
    cost = cost_mm(rig, place)
    if cost is None:
        rows.append(
            row(
                criteria.COST,
                np.nan,
                "the rig has no covariance file",
                "trinolab calibrate writes RIG.covariance.toml: keep it beside the rig",
            )
        )
    else:
        rows.append(row(criteria.COST, cost, f"{cost:.2f} mm, one sigma, of the position"))
    return rows


def cost_mm(rig: Rig, place: Array) -> float | None:
    """Standard deviation of a position there by the errors of the calibration, mm; None where no
    calibration has stated them.
    """
    offsets = offsets_at(rig, place)
    if rig.covariance is None or offsets is None:
        return None
    gain = np.linalg.pinv(offsets.by_position)
    return float(np.sqrt(np.trace(gain @ offsets.covariance @ gain.T)))


def place_of_handle(seen: Seen, rig: Rig) -> Array | None:
    """Where the handle is in the middle of its poses; without poses the point nearest to all
    cameras' axes, if that is near: cameras that look straight ahead say nothing of it.
    """
    places = [T.translation for T in seen.poses if T is not None]
    if places:
        return np.median(places, axis=0)
    axes = np.stack([camera.axis for camera in rig.cameras])
    centres = np.stack([camera.centre for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    right = (across @ centres[..., None]).sum(axis=0)[:, 0]
    point = np.linalg.lstsq(across.sum(axis=0), right, rcond=None)[0]
    widest = max(np.linalg.norm(centres[i] - centres[j]) for i, j in rig.pairs)
    distance = np.linalg.norm(centres - point, axis=1).max()
    return point if distance < FARTHEST * widest else None


def _of_poses(seen: Seen) -> list[Row]:
    """What came of it."""
    used = np.array(seen.cameras_used)
    with_pose = np.flatnonzero(used > 0)
    if len(with_pose) < FEWEST:
        return [row(criteria.FOUND, 0.0, f"a pose in {len(with_pose)} of {len(used)} instants")]
    # before the rod comes and after it is gone there is nothing to be found
    between = used[with_pose[0] : with_pose[-1] + 1]
    share = 100 * float((between >= 2).mean())
    residual = float(np.nanmedian(seen.residuals_px))
    part = 100 * (np.array(seen.took_part) >= PART_MARKERS).mean(axis=0)
    return [
        of_cameras(criteria.PART, seen.names, part),
        row(criteria.AGREE, residual, f"{residual:.2f} px, rms of a pose's markers"),
        row(criteria.FOUND, share, f"{share:.0f} % of {len(between)} instants"),
    ]


def _median(values: Sequence[float] | Array) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def as_lines(table: pd.DataFrame) -> list[str]:
    """The table for a terminal, with what to do below each row that is not good; the last line has
    the verdict.
    """
    width = max(len(what) for what in table["what"])
    lines = []
    for one in table.itertuples():
        lines.append(f"{one.what:<{width}}  {one.verdict:<12}  {one.measured}")
        lines.append(f"{'':<{width}}  wanted: {one.wanted}")
        if one.do:
            lines.append(f"{'':<{width}}  -> {one.do}")
    verdict = overall(table)
    bad = table.loc[table["verdict"] == (NOT_USABLE if verdict == NOT_USABLE else "usable"), "what"]
    because = f": {', '.join(bad)}" if len(bad) else ""
    unknown = table.loc[table["verdict"] == NOT_MEASURED, "what"]
    rest = f" (not measured: {', '.join(unknown)})" if len(unknown) else ""
    return [*lines, "", f"the set-up is {verdict}{because}{rest}"]
