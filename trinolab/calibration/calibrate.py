"""The command ``trinolab calibrate``: from images of a target to a rig file, with a report by which to
judge it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from ..camera import Camera, of_one_model
from ..checks import Array, frozen
from ..files.journal import sole_writer
from ..files.outputs import check_target, write_together
from ..files.rigs import covariance_path, covariance_text, rig_text
from ..rigid import left_jacobian
from . import distortions
from .adjust import FREE, TERMS, UNEXPLAINED, Calibrated
from .distortions import Choice, calibrate_by_choice
from .hints import hint, larger
from .mirrors import ahead, flipped_lens, shifted, unmirrored, upright
from .outliers import FEWEST_POINTS, UNSEEN, calibrate_robustly
from .scale import check_scale, distance_of_target
from .start import homography, intrinsics
from .synchrony import Synchrony, synchronised
from .tables import read_corners, read_lenses
from .target import Target
from .views import TargetViews, check_connected, look_lines, read_views, some

# cameras that are not triggered together come to 0.8; a camera that is frozen to 10 and more
LEAST_MOVED_PX = 1.0  # by a point of the target, from view to view
WORST_RMS_PX = 3.0
WIDE_DEG = 40.0  # off the axis, from which on a lens may be none of the models'
MOST_LOOKS = 3  # at videos, after each of which their frames are paired again
_PLACE = ("x / mm", "y / mm", "z / mm", "rotation x / deg", "rotation y / deg", "rotation z / deg")


class RigCalibration(NamedTuple):
    """A rig from images of a target.

    Attributes
    ----------
    calibrated : Calibrated
    parameters : pandas.DataFrame
        Columns `camera`, `parameter`, `value`, `sigma`: lens, and place and rotation vector of
        T_world_cam, which is zero for the first camera. `sigma` is the standard deviation, 0 for
        what is fixed.
    views : pandas.DataFrame
        A row per camera and view: `camera`, `view`, `status` (``used``, ``dropped``, ``missing``),
        `points` found, `rms_px` and `worst_px` (NaN if not used), `reason` for what was dropped.
    passed_over : int
        Views that were not looked at.
    notes : tuple of str
        Remarks about the target: its appearance, and the distances that follow from its size.
    warnings : tuple of str
        Faults of the views, each with its remedy.
    choice : Choice or None
        The choice of the number of distortions; None if it was given.
    files : tuple of Path
        The files written: rig, its covariance, views, picture.
    synchrony : Synchrony or None
        The times at which the cameras take their images, after whole frames are paired again; None
        where the cameras are synchronous as far as the views show. The calibration includes them where
        the lenses are known or the residuals become smaller; elsewhere the covariance includes the
        difference.
    """

    calibrated: Calibrated
    parameters: pd.DataFrame
    views: pd.DataFrame
    passed_over: int
    notes: tuple[str, ...]
    choice: Choice | None
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()
    synchrony: Synchrony | None = None


def calibrate_rig(
    sources: Mapping[str, str | Path] | str | Path,
    target: Target,
    out: str | Path,
    most_views: int = 50,
    distortion_terms: int | None = None,
    progress: bool = True,
    picture: Callable[[TargetViews, Calibrated], bytes] | None = None,
    size: Sequence[int] | None = None,
    lenses: str | Path | None = None,
) -> RigCalibration:
    """Calibrate two or more cameras from images or videos of a target, and write the rig.

    The world frame is the first camera's. Beside ``RIG.toml`` appear ``RIG.covariance.toml`` (see
    `files.rigs.read_covariance`), ``RIG_views.csv`` (the table `views`) and, with `picture`,
    ``RIG_residuals.png``; all of them, or none.

    Parameters
    ----------
    sources : mapping of str to path, or path
        For each camera's name a folder of images (paired by file name), a pattern such as
        ``photos/left*.png`` (paired by what the ``*`` stands for), or a video (paired by frame). A
        view may be missing in a camera. Colour and 16-bit images are converted, and the log says
        so. Or a table of points that another program has found, see `tables.read_corners`.
    target : Target
    out : path
        The rig file, ``.toml``.
    most_views : int
        Of more views than that some are passed over, evenly.
    distortion_terms : int, optional
        How many of k1, k2, p1, p2, k3, k4, k5, k6 are estimated, in this order: 0, 1, 2, 4, 5 or 8.
        By default as many as the views determine, see `distortions`.
    progress : bool
        Show progress bars on standard error, if that is a terminal.
    picture : callable, optional
        Draws the residuals of the views, and returns a PNG's bytes.
    size : (int, int), optional
        Width and height of the images of a table.
    lenses : path, optional
        A file with the lenses of the cameras, see `tables.read_lenses`: they are held, and the places
        alone are estimated.

    Raises
    ------
    ValueError
        Names the file, camera or argument: what `views.read_views` refuses, a file that cannot be
        written or that another process writes, a camera with fewer than three views of the target or
        none in common with the others, a size of the target that cannot be, views that contradict
        each other, and what `tables.read_corners` and `adjust.calibrate` refuse.
    """
    files = _outputs(out, picture is not None)
    if not isinstance(sources, (str, Path)) and size is not None:
        raise ValueError("size: images have their own; expected it beside a table of points only")
    if lenses is not None and distortion_terms is not None:
        raise ValueError("distortions: are held with the lenses; expected one of both alone")

    def look(late: Mapping[str, int]) -> TargetViews:
        if isinstance(sources, (str, Path)):
            return read_corners(sources, target, most_views, size, late)
        return read_views(sources, target, most_views, progress, late)

    with sole_writer(out):
        if lenses is not None and not isinstance(sources, (str, Path)):
            read_lenses(lenses, tuple(sources))  # before a search that takes long
        late = dict[str, int]()
        for _ in range(MOST_LOOKS):
            seen = look(late)
            _check_seen(seen, sources, target)
            check_scale(seen, target)
            known = None if lenses is None else _known(lenses, seen)
            terms = distortion_terms if known is None else len(known[0].distortions)
            with _reporting(len(seen.cameras), terms, progress) as report:
                solved = _solved(seen, target, terms, known, report)
            later = _later(solved)
            if not any(later):
                return _written(solved, target, late, files, picture)
            late = {
                name: late.get(name, 0) + by for name, by in zip(seen.cameras, later, strict=True)
            }
    raise ValueError(
        f"images of {', '.join(seen.cameras)}: the cameras do not take their images together, and their "
        "views cannot be paired otherwise: expected videos that begin together, or a target that is held "
        "still for each view"
    )


class _Solved(NamedTuple):
    """A calibration, the views from which it was made, and the changes to these."""

    seen: TargetViews
    calibrated: Calibrated
    reasons: np.ndarray
    choice: Choice | None
    synchrony: Synchrony | None
    allowed_for: bool  # in the calibration
    ahead: tuple[int, ...]  # views
    lines: tuple[str, ...]


def _solved(
    seen: TargetViews,
    target: Target,
    terms: int | None,
    known: list[Camera] | None,
    report: Callable[[str], object],
) -> _Solved:
    """The calibration of the views or, if they contradict each other, of flipped or shifted views."""
    seen, turned = upright(seen, target)
    lines = [turned] if turned else []
    shifts = (0,) * len(seen.cameras)
    try:
        calibrated, reasons, choice = _calibrated(seen, target, terms, known, report)
    except ValueError:
        flipped = unmirrored(seen, target)
        by = None if flipped else ahead(seen, target)
        if flipped is not None:
            seen = flipped.seen
            lines.append(flipped.line)
            known = known and [
                flipped_lens(lens) if lens.name in flipped.cameras else lens for lens in known
            ]
        elif by is not None:
            shifts = by
            seen, _ = upright(shifted(seen, by), target)
        else:
            raise
        calibrated, reasons, choice = _calibrated(seen, target, terms, known, report)
    report("when the cameras take their images")
    timed = None
    if seen.times is not None:
        held = known is not None
        timed = synchronised(target.points, seen.uv, calibrated, seen.times, held)
    # with lenses that are free, what no model of them describes may look like jitter
    allowed = timed is not None and (known is not None or timed[0].rms_px < calibrated.rms_px)
    if timed is not None and allowed:
        calibrated = timed[0]
    elif timed is not None:
        spread = distortions.spread_of_cameras(timed[0], calibrated)
        calibrated = replace(calibrated, covariance=frozen(calibrated.covariance + spread))
    return _Solved(
        seen, calibrated, reasons, choice, timed and timed[1], allowed, shifts, tuple(lines)
    )


def _later(solved: _Solved) -> list[int]:
    """The number of frames by which each camera's views are to be shifted; 0 where another program has
    paired them by their times.
    """
    seen, synchrony = solved.seen, solved.synchrony
    frames = _frames_per_view(seen)
    if synchrony is None or not frames:
        return [0] * len(seen.cameras)
    whole = np.rint(synchrony.delays).astype(int)
    by = np.array(solved.ahead) if whole.any() else 0
    return [int(later) for later in whole + frames * by]


def _frames_per_view(seen: TargetViews) -> int:
    """The frames from one view to the next; 0 where views are no frames of videos."""
    if seen.times is None or seen.time_unit != "frames":
        return 0
    return round(float(seen.times[1] - seen.times[0]))


def _written(
    solved: _Solved,
    target: Target,
    late: Mapping[str, int],
    files: tuple[Path, ...],
    picture: Callable[[TargetViews, Calibrated], bytes] | None,
) -> RigCalibration:
    """A calibration whose files are written."""
    seen, calibrated, reasons, choice, synchrony, allowed_for, *_ = solved
    views = _view_table(seen, calibrated, reasons)
    contents: list[str | bytes] = [
        rig_text(calibrated.rig),
        covariance_text(calibrated.rig_covariance),
        views.to_csv(index=False, float_format="%.6g"),
    ]
    if picture is not None:
        contents.append(picture(seen, calibrated))
    write_together(dict(zip(files, contents, strict=True)))
    part = larger(seen.showing, target)
    warnings = [*solved.lines, *_paired_again(solved, late), *([part] if part else [])]
    warnings += [] if synchrony is None else [_not_simultaneous(seen, synchrony, allowed_for)]
    notes = (*look_lines(seen), distance_of_target(calibrated, target))
    parameters = _parameter_table(calibrated)
    return RigCalibration(
        calibrated,
        parameters,
        views,
        seen.passed_over,
        notes,
        choice,
        files,
        tuple(warnings),
        synchrony,
    )


def _paired_again(solved: _Solved, late: Mapping[str, int]) -> list[str]:
    """A line if views or frames of other names were paired, by which the cameras agree."""
    seen = solved.seen
    frames = _frames_per_view(seen)
    unit = "frames" if frames else "views"
    total = {
        name: late.get(name, 0) + (frames or 1) * by
        for name, by in zip(seen.cameras, solved.ahead, strict=True)
    }
    if not any(total.values()):
        return []
    begins = ", ".join(f"{name} {by:+d}" for name, by in total.items() if by)
    return [
        f"the cameras begin at different {unit}: {begins} after {seen.cameras[0]}, by how they agree on the "
        "target; their views are paired accordingly"
    ]


def _not_simultaneous(seen: TargetViews, synchrony: Synchrony, allowed_for: bool) -> str:
    """The line about cameras that are not triggered together."""
    scale, unit = (1e3, "ms") if seen.time_unit == "s" else (1.0, seen.time_unit)
    delays = ", ".join(
        f"{name} {scale * delay:+.3g} {unit}"
        for name, delay in zip(seen.cameras[1:], synchrony.delays[1:], strict=True)
    )
    done = (
        "the faster the target, the less a view weighs"
        if allowed_for
        else "+- holds what this may cost; with known lenses (--lenses) it is allowed for"
    )
    return (
        f"the cameras are not simultaneous: {delays} after {seen.cameras[0]}, and "
        f"+-{scale * synchrony.sigma:.2g} {unit} from view to view, by how they disagree on the moving "
        f"target; {done}"
    )


def _outputs(out: str | Path, pictured: bool) -> tuple[Path, ...]:
    """The files to write, each found to be writable."""
    rig = Path(out)
    if rig.suffix.lower() != ".toml":
        raise ValueError(f"{out}: expected a name that ends in .toml")
    files = [rig, covariance_path(rig), rig.with_name(f"{rig.stem}_views.csv")]
    if pictured:
        files.append(rig.with_name(f"{rig.stem}_residuals.png"))
    for path in files:
        check_target(path)
    return tuple(files)


@contextmanager
def _reporting(
    cameras: int, terms: int | None, progress: bool
) -> Iterator[Callable[[str], object]]:
    """A function that shows a step's name in a progress bar."""
    # each camera, all of them, each number of coefficients, their times, the files
    steps = cameras + 3 + (len(TERMS) if terms is None else 0)
    with tqdm(total=steps, unit="step", leave=False, disable=None if progress else True) as bar:

        def report(step: str) -> None:
            bar.update()
            bar.set_description(step)

        yield report


def _check_seen(
    seen: TargetViews,
    sources: Mapping[str, str | Path] | str | Path,
    target: Target,
) -> None:
    """Refuse cameras that saw too little of the target."""

    def source_of(name: str) -> str | Path:
        return sources if isinstance(sources, (str, Path)) else sources[name]

    if seen.unseen:
        count = int(seen.present.sum())
        raise ValueError(
            f"images of {', '.join(seen.cameras)}: target ({target}) found in none of {count}, spread evenly "
            f"over all {count + seen.unseen}; expected it in most; {hint(target, seen.markers)}"
        )
    enough = np.isfinite(seen.uv).all(axis=3).sum(axis=2) >= FEWEST_POINTS
    for name, has, images in zip(
        seen.cameras, enough.sum(axis=1), seen.present.sum(axis=1), strict=True
    ):
        if has < 3:
            raise ValueError(
                f"{source_of(name)}: camera {name}: target ({target}) found in {has} of {images} images, "
                f"expected three or more; {hint(target, seen.markers)}"
            )
    check_connected(seen.cameras, enough, "no view in which it sees the target together")
    for name, has, uv in zip(seen.cameras, enough, seen.uv, strict=True):
        if _moved_px(uv[has]) < LEAST_MOVED_PX:
            raise ValueError(
                f"{source_of(name)}: camera {name}: the target is in the same place in all {has.sum()} views: "
                "expected it moved and turned (do the images differ?)"
            )


def _known(lenses: str | Path, seen: TargetViews) -> list[Camera]:
    """The lenses of the cameras, which hold for images of one size."""
    known = of_one_model(read_lenses(lenses, seen.cameras))
    for camera, size in zip(known, seen.sizes, strict=True):
        if camera.size != size:
            raise ValueError(
                f"{lenses}: camera {camera.name} has {camera.size[0]} x {camera.size[1]} pixels, its images "
                f"have {size[0]} x {size[1]}"
            )
    return list(known)


def _moved_px(uv: np.ndarray) -> float:
    """The distance that a point moves over the views (views, n, 2): the median of those that are
    seen.
    """
    valid = np.isfinite(uv)
    last = np.max(uv, axis=0, where=valid, initial=-np.inf)
    moved = (last - np.min(uv, axis=0, where=valid, initial=np.inf)).max(axis=1)
    return float(np.median(moved[np.isfinite(moved)]))


def _calibrated(
    seen: TargetViews,
    target: Target,
    terms: int | None,
    lenses: Sequence[Camera] | None,
    report: Callable[[str], object],
) -> tuple[Calibrated, np.ndarray, Choice | None]:
    """The calibration, the reasons for dropped views, and the choice of the distortions; errors name
    the cameras.
    """
    given = (target.points, seen.uv, seen.sizes, seen.cameras)
    choice = None
    try:
        if terms is None:
            calibrated, reasons, choice = calibrate_by_choice(*given, report)
        else:
            calibrated, reasons = calibrate_robustly(*given, terms, report, lenses)
    except ValueError as error:
        if not str(error).startswith("uv: "):
            raise
        text = re.sub(
            r"\bcamera (\d+)",
            lambda number: f"camera {seen.cameras[int(number[1])]}",
            str(error)[4:],
        )
        if UNEXPLAINED.endswith(text):
            text += f"; likely {_causes(seen, target)}"
        elif FREE.endswith(text) and (wide := _wide_lens(seen, target)):
            text += f"; likely {wide}"
        raise ValueError(f"images of {', '.join(seen.cameras)}: {text}") from None
    if calibrated.rms_px > WORST_RMS_PX:
        raise ValueError(
            f"images of {', '.join(seen.cameras)}: a residual of {calibrated.rms_px:.1f} px, expected at most "
            f"{WORST_RMS_PX:g}: {_causes(seen, target)}"
        )
    return calibrated, reasons, choice


def _causes(seen: TargetViews, target: Target) -> str:
    """Possible faults of views that no cameras explain."""
    causes = ["views of one name do not show one position of the target"]
    if target.two_ways:
        causes.append(
            "a camera is turned: this target looks the same then, and all cameras must stand upright"
        )
    wide = _wide_lens(seen, target)
    return "; or ".join([*([wide] if wide else []), *causes])


def _wide_lens(seen: TargetViews, target: Target) -> str:
    """A clause about the widest lens by the closed form, if it is a wide one."""
    widest, name = 0.0, ""
    for camera, views, size in zip(seen.cameras, seen.uv, seen.sizes, strict=True):
        H = [homography(target.points[:, :2], uv) for uv in views]
        try:
            K = intrinsics([h for h in H if h is not None], size)
        except (ValueError, np.linalg.LinAlgError):
            continue
        xy = (views - K[:2, 2]) / np.diag(K)[:2]
        angle = float(np.rad2deg(np.arctan(np.nanmax(np.linalg.norm(xy, axis=-1)))))
        widest, name = max((widest, name), (angle, camera))
    if widest < WIDE_DEG:
        return ""
    return (
        f"the lens of {name} is none that k1 to k6 describe, as a fisheye: its points lie about {widest:.0f} "
        "deg off the axis"
    )


def _view_table(seen: TargetViews, calibrated: Calibrated, reasons: np.ndarray) -> pd.DataFrame:
    """The table `RigCalibration.views`."""
    distances = np.linalg.norm(calibrated.residuals_px, axis=3)
    rows = []
    for k, v in np.ndindex(reasons.shape):
        used = np.isfinite(distances[k, v]).any()
        status = "used" if used else "dropped" if seen.present[k, v] else "missing"
        rows.append(
            {
                "camera": seen.cameras[k],
                "view": seen.views[v],
                "status": status,
                "points": int(np.isfinite(seen.uv[k, v]).all(axis=1).sum()),
                "rms_px": calibrated.view_rms_px[k, v],
                "worst_px": np.nanmax(distances[k, v]) if used else np.nan,
                "reason": reasons[k, v] if status == "dropped" else "",
            }
        )
    return pd.DataFrame(rows)


def _parameter_table(calibrated: Calibrated) -> pd.DataFrame:
    """The table `RigCalibration.parameters`."""
    rows = []
    for k, camera in enumerate(calibrated.cameras):
        lens = [*camera.focal, *camera.principal_point, *camera.distortions]
        names = [
            name if unit == "1" else f"{name} / {unit}" for name, unit in camera.parameters[:-6]
        ]
        values = [*lens, *_place(calibrated, k)[0]]
        sigmas = [*calibrated.intrinsic_sigma[k], *_place(calibrated, k)[1]]
        rows += [
            {"camera": camera.name, "parameter": name, "value": float(value), "sigma": float(sigma)}
            for name, value, sigma in zip([*names, *_PLACE], values, sigmas, strict=True)
        ]
    return pd.DataFrame(rows)


def _place(calibrated: Calibrated, camera: int) -> tuple[Array, Array]:
    """Translation (mm) and rotation vector (deg) of T_world_cam, (6,), and their standard
    deviations.
    """
    T = calibrated.cameras[camera].T_world_cam
    covariance = calibrated.relative_covariance(camera)
    rotvec = T.rotation.as_rotvec()
    # from small turns in the world to changes of the vector
    back = np.linalg.inv(left_jacobian(rotvec))
    turned = back @ covariance[3:, 3:] @ back.T
    sigmas = np.sqrt(np.concatenate([np.diag(covariance)[:3], np.diag(turned)]))
    units = np.repeat([1.0, 180 / np.pi], 3)
    return np.concatenate([T.translation, rotvec]) * units, sigmas * units


def as_lines(result: RigCalibration) -> list[str]:
    """A calibration as lines of text: errors, parameters with their standard deviations, and dropped
    views with their reasons.
    """
    calibrated, views = result.calibrated, result.views
    lines = [f"{'camera':12s} {'views':>6s} {'points':>7s} {'rms / px':>9s}"]
    for name, rows in views[views["status"] == "used"].groupby("camera", sort=False):
        rms = np.sqrt((rows["rms_px"] ** 2 * rows["points"]).sum() / rows["points"].sum())
        lines.append(f"{name:12s} {len(rows):6d} {rows['points'].sum():7d} {rms:9.3f}")
    lines.append(
        f"{'all':12s} {sum(T is not None for T in calibrated.T_world_target):6d} "
        f"{views.loc[views['status'] == 'used', 'points'].sum():7d} {calibrated.rms_px:9.3f}    "
        f"(noise of a coordinate {calibrated.sigma_px:.3f} px)"
    )
    first = calibrated.cameras[0].name
    for name, rows in result.parameters.groupby("camera", sort=False):
        visible_rows = rows[: -len(_PLACE)] if name == first else rows
        frame = (
            "the world frame"
            if name == first
            else f"its place and rotation in the frame of {first}"
        )
        lines += ["", f"{name}, {frame}", *map(_line, visible_rows.itertuples())]
    lines += [
        "",
        "places here are camera to world (T_world_cam), rotations as vectors in deg; "
        f"{result.files[0].name} has world to camera (T_cam_world), in rad",
        *result.notes,
    ]
    lines += ["", *distortions.as_lines(result.choice)] if result.choice else []
    dropped = views[views["status"] == "dropped"]
    lines += ["", f"views dropped: {len(dropped) or 'none'}"]
    known = dropped[dropped["reason"] != UNSEEN]
    lines += [f"  {row.camera} {row.view}: {row.reason}" for row in known.itertuples()]
    lines += _by_camera(dropped[dropped["reason"] == UNSEEN], UNSEEN)
    lines += _by_camera(views[views["status"] == "missing"], "no image")
    if result.passed_over:
        lines.append(f"views not looked at, evenly among the others: {result.passed_over}")
    return lines


def _by_camera(rows: pd.DataFrame, reason: str) -> list[str]:
    """A line for each camera that has views of a common reason."""
    return [
        f"  {name}: {reason} in {len(of)} of its views: {some(list(of['view']))}"
        for name, of in rows.groupby("camera", sort=False)
    ]


def _line(row: Any) -> str:
    uncertain = f" +- {row.sigma:.5f}" if row.sigma > 0 else "    fixed"
    return f"  {row.parameter:18s} {row.value:12.5f}{uncertain}"
