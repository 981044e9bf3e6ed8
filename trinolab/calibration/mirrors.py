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

from ..camera import Camera
from ..checks import Array, frozen
from .start import target_poses
from .target import Target
from .views import TargetViews

FEWEST_SHARED = 3  # views, by which two cameras contradict each other or agree
FEWEST_POINTS = 6  # of a view
CLEARER = 3.0  # times as far must relative poses spread in the one case as in the other


class Order(NamedTuple):
    """Another order in which a camera may have counted the points of a target. It makes the camera's
    rotation R of the target to ``image @ R @ board``.
    """

    mirrored: bool
    image: Array
    board: Array


class Flipped(NamedTuple):
    """Views with the images of some cameras flipped left to right.

    Attributes
    ----------
    seen : TargetViews
    cameras : tuple of str
        Those whose images are flipped.
    unambiguous : bool
        Whether they are the ones that mirror. Without markers two groups of as many cameras leave it
        open which of both does.
    """

    seen: TargetViews
    cameras: tuple[str, ...]
    unambiguous: bool

    @property
    def line(self) -> str:
        """A line for the user: what was done, and what to do next."""
        names = ", ".join(self.cameras)
        others = ", ".join(name for name in self.seen.cameras if name not in self.cameras)
        rule = (
            f"the rig holds for images of {names} flipped left to right, in recordings as well "
            "(ffmpeg -i IN -vf hflip OUT)"
        )
        if self.unambiguous:
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
    orders = _agreeing(
        [_rotations(uv, size, target) for uv, size in zip(seen.uv, seen.sizes, strict=True)],
        _orders(target),
    )
    if orders is None or not any(order.mirrored for order in orders):
        return None
    group = np.array([order.mirrored for order in orders])
    visible = np.array(np.isfinite(seen.uv).any(axis=(2, 3)))
    shares = [seen.mirrored[of].sum() / visible[of].sum() for of in (~group, group)]
    unambiguous = True
    flipped: np.ndarray
    if shares[0] != shares[1]:
        flips_group = bool(shares[1] > shares[0])
    else:
        flips_group = bool(2 * group.sum() <= group.size)
        unambiguous = 2 * int(group.sum()) != group.size
    flipped = np.equal(group, flips_group)
    uv = np.array(seen.uv)
    for k in np.flatnonzero(flipped):
        uv[k] = _flipped_pixels(uv[k], seen.sizes[k][0], target)
    mirrored = seen.mirrored ^ (flipped[:, None] & visible & (target.kind == "charuco"))
    names = tuple(
        name for name, is_flipped in zip(seen.cameras, flipped, strict=True) if is_flipped
    )
    return Flipped(seen._replace(uv=frozen(uv), mirrored=frozen(mirrored)), names, unambiguous)


def flipped_lens(camera: Camera) -> Camera:
    """The lens for images that are flipped left to right: with x for -x the second tangential
    coefficient changes its sign.
    """
    matrix = np.array(camera.matrix)
    matrix[0, 2] = camera.size[0] - 1 - matrix[0, 2]
    distortions = camera.distortions * np.array([1, 1, 1, -1, 1])
    return Camera(camera.name, camera.size, matrix, distortions, camera.T_cam_world)


def _flipped_pixels(uv: Array, width: int, target: Target) -> Array:
    """A target's points (views, n, 2), px, as they are found in flipped images."""
    flipped = uv * [-1, 1] + [width - 1, 0]
    if target.kind == "charuco":  # its markers name the points
        return flipped
    grid = flipped.reshape(len(uv), target.rows, target.columns, 2)
    return (grid[:, ::-1] if _by_rows(target) else grid[:, :, ::-1]).reshape(uv.shape)


def _by_rows(target: Target) -> bool:
    """Whether the order of the rows is reversed in a mirror, else that of the columns: across an odd
    number of squares a chessboard's colours are the same from both ends.
    """
    return not target.two_ways and target.rows % 2 == 0


def _orders(target: Target) -> list[Order]:
    """The orders in which a camera may have counted: as it is, and as in a mirror."""
    axis = 2 if target.kind == "charuco" else int(_by_rows(target))
    reflection = np.eye(3)
    reflection[axis, axis] = -1
    return [
        Order(False, np.eye(3), np.eye(3)),
        Order(True, np.diag([-1.0, 1, 1]), reflection),
    ]


def _rotations(views: Array, size: tuple[int, int], target: Target) -> Array:
    """Rotations (views, 3, 3) of T_cam_target, NaN where there is none."""
    enough = np.isfinite(views).all(axis=2).sum(axis=1) >= FEWEST_POINTS
    poses = target_poses(target.points, np.where(enough[:, None, None], views, np.nan), size)
    unknown = np.full((3, 3), np.nan)
    return np.stack([unknown if T is None else T.rotation.as_matrix() for T in poses])


def _agreeing(rotations: Sequence[Array], orders: Sequence[Order]) -> list[Order] | None:
    """The order of each camera with which the cameras agree, where the first one has the first order;
    None if views do not tell it of each camera. The next camera is the one of which they tell it most
    clearly.
    """
    chosen = {0: orders[0]}
    while len(chosen) < len(rotations):
        told = list[tuple[float, int, int]]()
        for b in range(len(rotations)):
            for a, order in chosen.items() if b not in chosen else ():
                spreads = [_spread(rotations[a], order, rotations[b], other) for other in orders]
                best, second = sorted(spreads)[:2]
                if np.isfinite(best):
                    told.append((second / max(best, 1e-9), b, spreads.index(best)))
        if not told or max(told)[0] < CLEARER:
            return None
        _, b, number = max(told)
        chosen[b] = orders[number]
    return [chosen[k] for k in range(len(rotations))]


def _spread(first: Array, order: Order, second: Array, other: Order) -> float:
    """The change of the relative rotation of two cameras from view to view, rad: the median, from
    the rotation that is nearest to most; infinite for too few views.
    """
    left = order.image @ first @ order.board
    relative = other.image @ second @ other.board @ left.transpose(0, 2, 1)
    relative = relative[np.isfinite(relative).all(axis=(1, 2))].reshape(-1, 9)
    if len(relative) < FEWEST_SHARED:
        return np.inf
    cosines = (relative @ relative.T - 1) / 2
    return float(np.median(np.arccos(cosines.clip(-1, 1)), axis=1).min())
