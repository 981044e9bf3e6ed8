"""Cameras that mirror their images, as many webcams do for video calls: told by how cameras contradict
each other (Sect. 6.2).

One camera alone cannot tell. A chessboard looks the same in a mirror, and any flat target seen in a
mirror is, for one camera, a target that is turned over. Two cameras of which one mirrors disagree on
how they stand to each other from view to view; with the images of one of them flipped they agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera
from ..checks import Array, frozen
from .adjust import Poses
from .eq25 import relative_pose
from .start import homography, intrinsics, target_pose
from .target import Target, upright_corners
from .views import TargetViews

FEWEST_SHARED = 3  # views, by which two cameras contradict each other or agree
FEWEST_POINTS = 6  # of a view
CLEARER = 3.0  # times as far must relative poses spread in the one case as in the other


class Flipped(NamedTuple):
    """Views with the images of some cameras flipped left to right.

    Attributes
    ----------
    seen : TargetViews
    cameras : tuple of str
        Those whose images are flipped.
    sure : bool
        Whether they are the ones that mirror. Without markers two groups of as many cameras leave it
        open which of both does.
    """

    seen: TargetViews
    cameras: tuple[str, ...]
    sure: bool

    @property
    def line(self) -> str:
        """What was done, and what a user does next."""
        names = ", ".join(self.cameras)
        others = ", ".join(name for name in self.seen.cameras if name not in self.cameras)
        rule = (
            f"the rig holds for images of {names} flipped left to right, in recordings as well "
            "(ffmpeg -i IN -vf hflip OUT)"
        )
        if self.sure:
            return f"images of {names} are mirrored, else the cameras contradict each other: {rule}"
        return (
            f"images of {names} or of {others} are mirrored, else they contradict each other: taken is "
            f"{names}, and {rule}; if writing reads backwards in those of {others}, flip these and "
            "calibrate again"
        )


def unmirrored(seen: TargetViews, target: Target) -> Flipped | None:
    """The views with the images of those cameras flipped that contradict the others; None where
    nothing speaks for a flip.

    The cameras are put into two groups, within which they agree as they are. A target with markers
    tells which of them see it as in a mirror. Without them the larger group is taken to be right, or
    of two equal ones that of the first camera.
    """
    turned = _flipped_pixels(seen, target)
    as_they_are = _poses(seen.uv, seen, target)
    as_in_a_mirror = _poses(turned, seen, target)
    group = _groups(as_they_are, as_in_a_mirror)
    if group is None or not group.any():
        return None
    visible = np.array(np.isfinite(seen.uv).any(axis=(2, 3)))
    shares = [seen.mirrored[of].sum() / visible[of].sum() for of in (~group, group)]
    sure = True
    flipped: np.ndarray
    if shares[0] != shares[1]:
        flips_group = bool(shares[1] > shares[0])
    else:
        flips_group = bool(2 * group.sum() <= group.size)
        sure = 2 * int(group.sum()) != group.size
    flipped = np.equal(group, flips_group)
    uv = np.where(flipped[:, None, None, None], turned, seen.uv)
    mirrored = seen.mirrored ^ (flipped[:, None] & visible & (target.kind == "charuco"))
    names = tuple(
        name for name, is_flipped in zip(seen.cameras, flipped, strict=True) if is_flipped
    )
    return Flipped(seen._replace(uv=frozen(uv), mirrored=frozen(mirrored)), names, sure)


def flipped_lens(camera: Camera) -> Camera:
    """The lens for images that are flipped left to right: with x for -x the second tangential
    coefficient changes its sign.
    """
    matrix = np.array(camera.matrix)
    matrix[0, 2] = camera.size[0] - 1 - matrix[0, 2]
    distortions = camera.distortions * np.array([1, 1, 1, -1, 1])
    return Camera(camera.name, camera.size, matrix, distortions, camera.T_cam_world)


def _flipped_pixels(seen: TargetViews, target: Target) -> Array:
    """The target's points (cameras, views, n, 2), px, as they are found in flipped images."""
    uv = np.array(seen.uv)
    for pixels, (width, _) in zip(uv, seen.sizes, strict=True):
        pixels[..., 0] = width - 1 - pixels[..., 0]
    if target.kind == "charuco":  # its markers name the points
        return uv
    for at in np.ndindex(uv.shape[:2]):
        if np.isfinite(uv[at]).all():
            uv[at] = _recounted(uv[at], target)
    return uv


def _recounted(uv: Array, target: Target) -> Array:
    """The points (n, 2) of a flipped chessboard or grid, in the order in which a detector counts them."""
    if target.two_ways:
        return upright_corners(uv, target)
    grid = uv.reshape(target.rows, target.columns, 2)
    # across an odd number of squares the colours are the same from both ends
    return (grid[::-1] if target.rows % 2 == 0 else grid[:, ::-1]).reshape(-1, 2)


def _poses(uv: Array, seen: TargetViews, target: Target) -> list[Poses]:
    """T_cam_target of each camera and view by Zhang's start, None where there is none."""
    return [_of_camera(views, size, target) for views, size in zip(uv, seen.sizes, strict=True)]


def _of_camera(views: Array, size: tuple[int, int], target: Target) -> Poses:
    xy = np.asarray(target.points)[:, :2]
    enough = np.isfinite(views).all(axis=2).sum(axis=1) >= FEWEST_POINTS
    H = [homography(xy, uv) if many else None for uv, many in zip(views, enough, strict=True)]
    try:
        K = intrinsics(np.stack([h for h in H if h is not None]), size)
        return [None if h is None else target_pose(h, K) for h in H]
    except (ValueError, np.linalg.LinAlgError):
        return [None] * len(views)


def _groups(as_they_are: Sequence[Poses], as_in_a_mirror: Sequence[Poses]) -> np.ndarray | None:
    """Which cameras, bool (cameras,), agree with the first one only as in a mirror; None if views do
    not tell it of each camera.
    """
    count = len(as_they_are)
    # of two cameras, by how much one of both cases is the better one, and whether it is the mirror's
    ties = list[tuple[float, int, int, bool]]()
    for b in range(count):
        for a in range(b):
            plain = _spread(as_they_are[a], as_they_are[b])
            flipped = _spread(as_they_are[a], as_in_a_mirror[b])
            if plain is not None and flipped is not None:
                clearer = max(plain, flipped) / max(min(plain, flipped), 1e-9)
                ties.append((clearer, a, b, flipped < plain))
    group: dict[int, bool] = {0: False}
    while len(group) < count:
        reaching = [tie for tie in ties if (tie[1] in group) != (tie[2] in group)]
        if not reaching or max(reaching)[0] < CLEARER:
            return None
        _, a, b, differ = max(reaching)
        known, new = (a, b) if a in group else (b, a)
        group[new] = group[known] ^ differ
    return np.array([group[k] for k in range(count)])


def _spread(first: Poses, second: Poses) -> float | None:
    """How far the relative poses of two cameras turn from view to view, rad: the middle, from the one
    that is nearest to most; None for too few views.
    """
    shared = [(a, b) for a, b in zip(first, second, strict=True) if a is not None and b is not None]
    if len(shared) < FEWEST_SHARED:
        return None
    left, right = (RigidTransform.concatenate(side) for side in zip(*shared, strict=True))
    turns = relative_pose(left, right).rotation
    apart = np.array([(turns * turn.inv()).magnitude() for turn in turns])
    return float(np.median(apart, axis=1).min())
