"""Views of a target as files: each camera's images, the pairing of the images, and the points detected
in them.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from ..checks import Array, as_whole, frozen
from ..files.images import is_image, read_greys
from ..files.recording import Footage, frames_of, open_footage
from .target import Appearance, Detection, Target, appearances, detect_target

# An image without the target takes longest. So small copies of some images are searched first, then a few
# images at their full size, and the others only if one of these shows the target.
FIRST, FIRST_PX = 12, 480
FEW = 4
MOST_SHOWING = 5  # of all images with it
# Views by which light on dark leads dark on light, or is behind it, when only the leader is looked for:
# a target is printed in one way.
SURE = 5
LEAST_PAIRED = 0.5  # share of a camera's views, below which a warning says so
# grey levels between those percentiles of an image of 16 bit, of which fewer are stretched
FEW_LEVELS, EXTREMES = 128, (0.1, 99.9)

log = logging.getLogger("trinolab")


class TargetViews(NamedTuple):
    """The points of a target in the images of the cameras.

    Attributes
    ----------
    cameras : tuple of str
    sizes : tuple of (int, int)
        Width and height of each camera's images.
    views : tuple of str
        Names of the views: of their images, or the numbers of their frames from 0.
    uv : ndarray, shape (cameras, views, n, 2)
        The target's points, px; NaN for those not detected.
    present : ndarray of bool, shape (cameras, views)
        Whether the camera has an image of the view.
    passed_over : int
        Views that were skipped, because there were more than the number wanted.
    inverted, mirrored : ndarray of bool, shape (cameras, views)
        Whether the target was light on dark, and mirrored, see `target.Appearance`.
    showing : tuple of ndarray
        A few images that show it.
    markers : tuple of tuple of int
        Numbers of the ChArUco board's markers, or of others, in each image.
    unseen : int
        Images that were skipped, because none of the first sample shows the target.
    times : ndarray, shape (views,), or None
        When the views were taken, rising, by one clock; None for photographs.
    time_unit : str
        Of `times`: ``s``, or ``frames``.
    """

    cameras: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    views: tuple[str, ...]
    uv: Array
    present: np.ndarray
    passed_over: int
    inverted: np.ndarray
    mirrored: np.ndarray
    showing: tuple[np.ndarray, ...] = ()
    markers: tuple[tuple[int, ...], ...] = ()
    unseen: int = 0
    times: Array | None = None
    time_unit: str = "frames"


class _Source(NamedTuple):
    """A camera's footage, and for a video no files, else the file of each view."""

    footage: Footage
    files: dict[str, str] | None
    labels: list[str]


def read_views(
    sources: Mapping[str, str | Path],
    target: Target,
    most: int = 50,
    progress: bool = True,
    late: Mapping[str, int] | None = None,
) -> TargetViews:
    """Look for a target in the images or the video of each camera.

    Views of folders are paired by their files' names, of patterns by what the ``*`` stands for, or by the
    numbers in them where these pair more, of videos by the frames' numbers; a view may be missing in a
    camera. Of more than `most` views some are passed over, evenly. Of more than `FIRST` images copies of
    that many, at most `FIRST_PX` wide or high and spread evenly over cameras and views, are searched first.
    If none shows the target, `FEW` images are searched at full size, and the others only if one of these
    shows it.

    Parameters
    ----------
    sources : mapping of str to path
        For each camera's name a folder of images, a pattern such as ``photos/left*.png``, or a
        video.
    target : Target
    most : int
        Views to look at.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.
    late : mapping of str to int, optional
        By how many frames a camera's video began later than the first one's.

    Raises
    ------
    ValueError
        Names the file or camera: fewer than two cameras, videos beside images, no view in common, a
        file that cannot be read or has another size than the others of its camera.
    """
    if len(sources) < 2:
        raise ValueError(
            f"images: expected two or more cameras, got {', '.join(sources) or 'none'}"
        )
    if "metadata" in sources:
        raise ValueError("images: a camera cannot be called metadata in a rig file")
    most = as_whole(most, "views", low=3)
    opened = {name: _open(path, (late or {}).get(name, 0)) for name, path in sources.items()}
    if len({one.files is None for one in opened.values()}) > 1:
        raise ValueError(
            "images: expected images or videos of all cameras, got both; views could not be paired"
        )
    filmed = all(one.files is None for one in opened.values())
    if not filmed:
        opened = _paired(opened)
    every = sorted(
        {label for one in opened.values() for label in one.labels}, key=int if filmed else None
    )
    chosen = every[:: -(-len(every) // most)]
    has_view = np.array([[label in set(one.labels) for label in chosen] for one in opened.values()])
    check_connected(tuple(opened), has_view, "no view in common", _called(opened))
    return _found(opened, chosen, target, progress)._replace(
        passed_over=len(every) - len(chosen),
        times=frozen(np.array(chosen, float)) if filmed else None,
    )


def check_connected(cameras: tuple[str, ...], seen: np.ndarray, what: str, hint: str = "") -> None:
    """Refuse cameras that the views, bool (cameras, views), do not connect; the ValueError names one of
    them.
    """
    reached, more = {0}, {0}
    while more:
        known = seen[sorted(reached)].any(axis=0)
        more = {k for k in range(len(cameras)) if k not in reached and (seen[k] & known).any()}
        reached |= more
    if alone := [name for k, name in enumerate(cameras) if k not in reached]:
        others = ", ".join(cameras[k] for k in sorted(reached))
        raise ValueError(f"{alone[0]}: {what} with {others}{hint}")


def _open(path: str | Path, late: int = 0) -> _Source:
    pattern = Path(path)
    if "*" in pattern.name and not pattern.exists():
        return _matching(pattern)
    footage = open_footage(path)
    if footage.names:
        return _Source(footage, {name: name for name in footage.names}, list(footage.names))
    count = footage.length or sum(1 for _ in frames_of(footage))  # a header may say nothing
    if not count:
        raise ValueError(f"{path}: a video without a frame")
    return _Source(footage, None, [_frame_name(k) for k in range(late, late + count)])


def _paired(opened: dict[str, _Source]) -> dict[str, _Source]:
    """Images under names that pair them: their own, or the first camera's that has the same numbers where
    that pairs more. A warning where few pair.
    """
    numbers = {name: _by_number(one.labels) for name, one in opened.items()}
    names = dict[tuple[int | str, ...], str]()
    for of in numbers.values():
        names = {key: label for label, key in of.items()} | names
    renamed = {
        name: {names[numbers[name][label]]: file for label, file in (one.files or {}).items()}
        for name, one in opened.items()
        if numbers[name]
    }
    whole = all(len(renamed.get(name, ())) == len(one.labels) for name, one in opened.items())
    if whole and _pairs(renamed) > _pairs({name: one.labels for name, one in opened.items()}):
        opened = {
            name: one._replace(files=renamed[name], labels=list(renamed[name]))
            for name, one in opened.items()
        }
    fewest = min(len(one.labels) for one in opened.values())
    pairs = _pairs({name: one.labels for name, one in opened.items()})
    if 0 < pairs < LEAST_PAIRED * fewest:
        log.warning("images: only %d views are in more than one camera%s", pairs, _called(opened))
    return opened


def _called(opened: Mapping[str, _Source]) -> str:
    """A clause about the names of each camera's views, and the way to pair others."""
    names = "; ".join(f"{some(one.labels)} of {name}" for name, one in opened.items())
    return f", whose views are called {names}; a pattern such as 'left/img*.png' says by what they pair"


def _pairs(labels: Mapping[str, Iterable[str]]) -> int:
    """The number of views that two or more cameras have."""
    counts = Counter(label for of in labels.values() for label in set(of))
    return sum(count > 1 for count in counts.values())


def _by_number(labels: Sequence[str]) -> dict[str, tuple[int | str, ...]]:
    """Names of a camera's images with those of their numbers that differ from image to image, or the name
    itself without its ending where there is no number; empty where these are not different.
    """
    stems = [Path(label).stem if is_image(Path(label)) else label for label in labels]
    digits = [re.findall(r"\d+", stem) for stem in stems]
    if len({len(of) for of in digits}) > 1:
        digits = [of[-1:] for of in digits]
    if len({len(of) for of in digits}) > 1:
        return {}
    differ = [len(set(map(int, column))) > 1 for column in zip(*digits, strict=True)]
    keys: list[tuple[int | str, ...]] = [
        tuple(
            int(one) for one, differs in zip(of, differ, strict=True) if differs or len(labels) == 1
        )
        or (stem.casefold(),)
        for of, stem in zip(digits, stems, strict=True)
    ]
    return dict(zip(labels, keys, strict=True)) if len(set(keys)) == len(keys) else {}


def _matching(pattern: Path) -> _Source:
    """The images of a folder whose names match, each with what the star stands for."""
    before, after = pattern.name.split("*", 1)
    if not pattern.parent.is_dir():
        raise ValueError(f"{pattern}: no such folder {pattern.parent}")
    files = {
        file.name[len(before) : len(file.name) - len(after)]: file.name
        for file in sorted(pattern.parent.iterdir())
        if is_image(file)
        and file.name.startswith(before)
        and file.name.endswith(after)
        and len(file.name) >= len(before) + len(after)
    }
    if not files:
        raise ValueError(f"{pattern}: no image of that name")
    return _Source(Footage(pattern.parent, tuple(files.values()), len(files)), files, list(files))


def _found(
    opened: dict[str, _Source], chosen: list[str], target: Target, progress: bool
) -> TargetViews:
    """The target in the chosen views, none passed over; a few images are searched first."""
    every = {
        name: [label for label in chosen if label in set(source.labels)]
        for name, source in opened.items()
    }
    known = dict[tuple[str, str], Detection]()
    logged = set[str]()
    if _count(every) > FIRST and not _is_in_small_copies(opened, every, target, logged):
        few = _sample(every, FEW)
        seen = _detected(opened, chosen, few, target, progress, known, logged)
        if not np.isfinite(seen.uv).any():
            return seen._replace(unseen=_count(every) - _count(few))
    return _detected(opened, chosen, every, target, progress, known, logged)


def _is_in_small_copies(
    opened: dict[str, _Source], every: Mapping[str, list[str]], target: Target, logged: set[str]
) -> bool:
    """Whether the small copy of one of the first images shows the target."""
    first = _sample(every, FIRST)
    for name, source in opened.items():
        for _, image, _ in _images(source, first[name], logged):
            small = _small_copy(_eight_bit(image))
            if np.isfinite(detect_target(small, target, appearances(target)).uv).any():
                return True
    return False


def _small_copy(image: np.ndarray) -> np.ndarray:
    scale = min(1.0, FIRST_PX / max(image.shape))
    height, width = (max(1, round(scale * side)) for side in image.shape)
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def _sample(every: Mapping[str, list[str]], count: int) -> dict[str, list[str]]:
    """That many labels, one or more of each camera, spread evenly over its own."""
    of_each, more = divmod(count, len(every))
    return {
        name: _spread(labels, max(1, of_each + (k < more)))
        for k, (name, labels) in enumerate(every.items())
    }


def _count(labels: Mapping[str, list[str]]) -> int:
    return sum(map(len, labels.values()))


def _spread(labels: list[str], count: int) -> list[str]:
    """A number of the labels, each from the middle of an equal part of them."""
    if len(labels) <= count:
        return labels
    return [labels[(2 * k + 1) * len(labels) // (2 * count)] for k in range(count)]


def _detected(
    opened: dict[str, _Source],
    chosen: list[str],
    wanted: Mapping[str, list[str]],
    target: Target,
    progress: bool,
    known: dict[tuple[str, str], Detection],
    logged: set[str],
) -> TargetViews:
    """The target in the wanted views of each camera. `known` holds the detections by camera and label,
    and `logged` the warnings about files; new ones are added to them.
    """
    shape = (len(opened), len(chosen))
    uv = np.full((*shape, len(target.points), 2), np.nan)
    present, inverted, mirrored = (np.zeros(shape, bool) for _ in range(3))
    sizes = list[tuple[int, int]]()
    showing = list[np.ndarray]()
    markers = list[tuple[int, ...]]()
    by_all = Counter[Appearance]()
    with (
        logging_redirect_tqdm(),
        tqdm(total=_count(wanted), unit="image", disable=None if progress else True) as bar,
    ):
        for k, (name, source) in enumerate(opened.items()):
            size = None
            by_camera = Counter[Appearance]()
            for label, image, path in _images(source, wanted[name], logged):
                size = _same_size(image, size, path)
                v = chosen.index(label)
                grey = _eight_bit(image)
                if (name, label) not in known:
                    tried = _likeliest(target, by_camera, by_all)
                    known[name, label] = detect_target(grey, target, tried)
                uv[k, v], appearance, numbers = known[name, label]
                markers.append(numbers)
                present[k, v] = True
                bar.update()
                if np.isfinite(uv[k, v]).any():
                    inverted[k, v], mirrored[k, v] = appearance
                    by_camera[appearance] += 1
                    by_all[appearance] += 1
                    if len(showing) < MOST_SHOWING:
                        showing.append(grey)
            if size is None:
                raise ValueError(f"{source.footage.path}: no frame of camera {name} could be read")
            sizes.append(size)
    return TargetViews(
        tuple(opened),
        tuple(sizes),
        tuple(chosen),
        frozen(uv),
        frozen(present),
        0,
        frozen(inverted),
        frozen(mirrored),
        tuple(showing),
        tuple(markers),
    )


def _likeliest(
    target: Target, by_camera: Counter[Appearance], by_all: Counter[Appearance]
) -> list[Appearance]:
    """The target's appearances in the next image of a camera, the most frequent so far first."""
    light = sum(count for appearance, count in by_all.items() if appearance.inverted)
    dark = by_all.total() - light
    prints = {True: light, False: dark}
    # a chessboard may be found in an image and in its negative: one of both is never sure
    sure = abs(light - dark) >= SURE and target.kind != "chessboard"
    possible = [
        appearance
        for appearance in appearances(target)
        if not sure or prints[appearance.inverted] > prints[not appearance.inverted]
    ]
    return sorted(
        possible, key=lambda appearance: (-by_camera[appearance], -prints[appearance.inverted])
    )


def look_lines(seen: TargetViews) -> list[str]:
    """A line if the target is light on dark, and one if cameras see it mirrored."""
    showing = np.isfinite(seen.uv).any(axis=(2, 3))
    lines = list[str]()
    if count := int(seen.inverted.sum()):
        every = int(showing.sum())
        of_target = ": the target is light on dark (inverted)" if 2 * count > every else ""
        lines.append(
            f"found in the negative of {count} of the {every} images that show it{of_target}"
        )
    if seen.mirrored.any():
        cameras = [
            f"{name} in {mirrored} of {shown}"
            for name, mirrored, shown in zip(
                seen.cameras, seen.mirrored.sum(axis=1), showing.sum(axis=1), strict=True
            )
            if mirrored
        ]
        lines.append(
            f"seen as in a mirror by {', '.join(cameras)} images: from behind, or the camera mirrors "
            "its images"
        )
    return lines


def _images(
    source: _Source, wanted: list[str], logged: set[str]
) -> Iterator[tuple[str, np.ndarray, Path]]:
    """Name, grey image and file of wanted views that the source has."""
    if source.files is None:
        frames = [k for k, label in enumerate(source.labels) if label in set(wanted)]
        images = frames_of(source.footage, logged=logged, wanted=frames)
        for k, image in zip(frames, images, strict=False):  # a header may promise too many
            yield source.labels[k], image, source.footage.path
        return
    paths = [source.footage.path / source.files[label] for label in wanted]
    yield from zip(wanted, read_greys(paths, logged=logged), paths, strict=True)


def _same_size(image: np.ndarray, size: tuple[int, int] | None, path: Path) -> tuple[int, int]:
    new = (image.shape[1], image.shape[0])
    if size is not None and new != size:
        raise ValueError(
            f"{path}: {new[0]} x {new[1]} pixels, the camera's other images have {size[0]} x {size[1]}"
            + ("; likely it was turned between them" if new == size[::-1] else "")
        )
    return new


def _eight_bit(image: np.ndarray) -> np.ndarray:
    """A grey image in whole levels; one of 16 bit that uses few of them, as a thermal camera's, is
    stretched.
    """
    if image.dtype == np.uint8:
        return image
    low, high = np.percentile(image, EXTREMES)
    if 0 < high - low < FEW_LEVELS:
        image = np.clip((image - low) * (255 / (high - low)), 0, 255)
    return np.rint(image).astype(np.uint8)


def _frame_name(frame: int) -> str:
    return f"{frame:06d}"


def some(labels: Sequence[str]) -> str:
    """The first few of many names."""
    return ", ".join(labels[:4]) + (", ..." if len(labels) > 4 else "")
