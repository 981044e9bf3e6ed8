"""Cameras that contradict each other, by what one camera alone cannot tell: which mirrors its images, as
many webcams do for video calls, which sees a target turned that looks the same then, and whose views are
counted from another one on (Sect. 6.2).

A chessboard looks the same in a mirror, and any flat target seen in a mirror is, for one camera, a target
that is turned over. Two cameras of which one mirrors, is upside down, or is a view ahead disagree on how
they stand to each other from view to view; with the images of one flipped, its points counted from another
corner, or its views shifted, they agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..camera import Camera
from ..checks import Array, frozen
from .start import target_poses
from .target import Target
from .views import TargetViews

FEWEST_SHARED = 3  # views, by which two cameras contradict each other or agree
FEWEST_POINTS = 6  # of a view
CLEARER = 3.0  # times as far must relative poses spread in the one case as in the other
ELSEWHERE_RAD = np.pi / 4  # from a relative rotation: one of other orders
LATEST_SHARE = 0.5  # of the views, by which a camera may be ahead


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
    agreed = _agreeing(_rotations(seen, target), _orders(target), _turns(target))
    if agreed is None or not any(order.mirrored for order, _ in agreed):
        return None
    group = np.array([order.mirrored for order, _ in agreed])
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
    seen, _ = upright(seen._replace(uv=frozen(uv), mirrored=frozen(mirrored)), target)
    return Flipped(seen, names, unambiguous)


def upright(seen: TargetViews, target: Target) -> tuple[TargetViews, str]:
    """The views of a target that looks the same when it is turned, each counted from the corner with
    which the cameras agree, and a line if these are other ones.
    """
    turns = _turns(target)
    rotations = _rotations(seen, target)
    agreed = None if len(turns) == 1 else _agreeing(rotations, _orders(target)[:1], turns)
    if agreed is None:
        return seen, ""
    uv = np.array(seen.uv)
    counts = dict[str, int]()
    for v in range(len(seen.views)):
        common = None
        for k, (_, R) in enumerate(agreed):
            ways = R.T @ rotations[k][v] @ turns  # in the first camera's frame
            if not np.isfinite(ways).all():
                continue
            common = ways[0] if common is None else common
            turn = int(np.einsum("kij,ij->k", ways, common).argmax())
            if turn:
                grid = uv[k, v].reshape(target.rows, target.columns, 2)
                uv[k, v] = np.rot90(grid, target.turns[turn]).reshape(-1, 2)
                counts[seen.cameras[k]] = counts.get(seen.cameras[k], 0) + 1
    if not counts:
        return seen, ""
    turned = ", ".join(f"{name} in {count}" for name, count in counts.items())
    line = (
        f"the target looks the same when it is turned, and is counted from another corner by {turned} of "
        f"{len(seen.views)} views, with which the cameras agree"
    )
    return seen._replace(uv=frozen(uv)), line


def ahead(seen: TargetViews, target: Target) -> tuple[int, ...] | None:
    """By how many views each camera is ahead of the first one, if the cameras agree then and not as they
    are; None if views do not tell it.
    """
    rotations = _rotations(seen, target)
    order, turns = _orders(target)[0], _turns(target)
    most = int(LATEST_SHARE * len(seen.views))
    shifts = [0]
    for other in rotations[1:]:
        spreads = {
            by: _spread(rotations[0], order, _shifted(other, by), order, turns)[0]
            for by in range(-most, most + 1)
        }
        best = min(spreads, key=lambda by: spreads[by])
        rest = [spread for by, spread in spreads.items() if abs(by - best) > 1]
        if not (rest and CLEARER * spreads[best] < np.median(rest)):
            return None
        shifts.append(best)
    return tuple(shifts) if any(shifts) else None


def shifted(seen: TargetViews, by: Sequence[int]) -> TargetViews:
    """Views of which each camera's are that many later ones."""
    uv, present, inverted, mirrored = (
        frozen(np.stack([_shifted(of, n) for of, n in zip(part, by, strict=True)]))
        for part in (seen.uv, seen.present, seen.inverted, seen.mirrored)
    )
    return seen._replace(uv=uv, present=present, inverted=inverted, mirrored=mirrored)


def _shifted(of_views: np.ndarray, by: int) -> np.ndarray:
    """Values of views, later ones by a number; those that are missing are NaN, or False."""
    missing = np.nan if of_views.dtype == float else False
    moved = np.full(of_views.shape, missing, of_views.dtype)
    count = len(of_views)
    moved[max(by, 0) : count + min(by, 0)] = of_views[max(-by, 0) : count - max(by, 0)]
    return moved


def flipped_lens(camera: Camera) -> Camera:
    """The lens for images that are flipped left to right: with x for -x the second tangential
    coefficient changes its sign.
    """
    matrix = np.array(camera.matrix)
    matrix[0, 2] = camera.size[0] - 1 - matrix[0, 2]
    distortions = camera.distortions * np.where(np.arange(len(camera.distortions)) == 3, -1, 1)
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
    number of squares a chessboard's colours are the same from both ends, and asymmetric circles with an
    odd number of rows are where their rows are reversed.
    """
    return not target.two_ways and (target.rows % 2 == 0 or target.kind == "acircles")


def _orders(target: Target) -> list[Order]:
    """The orders in which a camera may have counted: as it is, and as in a mirror."""
    axis = 2 if target.kind == "charuco" else int(_by_rows(target))
    reflection = np.eye(3)
    reflection[axis, axis] = -1
    return [
        Order(False, np.eye(3), np.eye(3)),
        Order(True, np.diag([-1.0, 1, 1]), reflection),
    ]


def _turns(target: Target) -> Array:
    """Rotations (k, 3, 3) of a target after which it looks the same, none first."""
    return Rotation.from_euler("z", [[90.0 * k] for k in target.turns], degrees=True).as_matrix()


def _rotations(seen: TargetViews, target: Target) -> list[Array]:
    """Each camera's rotations (views, 3, 3) of T_cam_target, NaN where there is none."""
    unknown = np.full((3, 3), np.nan)
    rotations = []
    for views, size in zip(seen.uv, seen.sizes, strict=True):
        enough = np.isfinite(views).all(axis=2).sum(axis=1) >= FEWEST_POINTS
        poses = target_poses(target.points, np.where(enough[:, None, None], views, np.nan), size)
        rotations.append(
            np.stack([unknown if T is None else T.rotation.as_matrix() for T in poses])
        )
    return rotations


def _agreeing(
    rotations: Sequence[Array], orders: Sequence[Order], turns: Array
) -> list[tuple[Order, Array]] | None:
    """The order of each camera with which the cameras agree, where the first one has the first order, and
    its rotation from the first one; None if views do not tell it of each camera. The next camera is the
    one of which they tell it most clearly.
    """
    chosen = {0: (orders[0], np.eye(3))}
    while len(chosen) < len(rotations):
        candidates = list[tuple[float, int, int, int]]()
        for b in range(len(rotations)):
            for a, (order, _) in chosen.items() if b not in chosen else ():
                spreads = [_spread(rotations[a], order, rotations[b], of, turns) for of in orders]
                best = min(spread for spread, _, _ in spreads)
                number = [spread for spread, _, _ in spreads].index(best)
                others = [spread for k, (spread, _, _) in enumerate(spreads) if k != number]
                second = min([*others, spreads[number][1]])
                if np.isfinite(best):
                    candidates.append((second / max(best, 1e-9), b, a, number))
        if not candidates or max(candidates)[0] < CLEARER:
            return None
        _, b, a, number = max(candidates)
        order, R = chosen[a]
        chosen[b] = (
            orders[number],
            _spread(rotations[a], order, rotations[b], orders[number], turns)[2] @ R,
        )
    return [chosen[k] for k in range(len(rotations))]


def _spread(
    first: Array, order: Order, second: Array, other: Order, turns: Array
) -> tuple[float, float, Array]:
    """The change of the relative rotation of two cameras from view to view, rad: the median, from
    the rotation that is nearest to most, which of the target's turns makes least of it; that of the best
    rotation elsewhere, infinite if there is none; and the rotation. Infinite for too few views.
    """
    left = order.image @ first @ order.board
    right = (other.image @ second @ other.board)[:, None] @ turns
    relative = right @ left.transpose(0, 2, 1)[:, None]
    relative = relative[np.isfinite(relative).all(axis=(1, 2, 3))].reshape(-1, 9)
    if len(relative) < FEWEST_SHARED * len(turns):
        return np.inf, np.inf, np.eye(3)
    angles = np.arccos(((relative @ relative.T - 1) / 2).clip(-1, 1))
    spreads = np.median(angles.reshape(len(angles), -1, len(turns)).min(axis=2), axis=1)
    best = int(spreads.argmin())
    elsewhere = spreads[angles[best] > ELSEWHERE_RAD] if len(turns) > 1 else np.empty(0)
    return (
        float(spreads[best]),
        float(elsewhere.min(initial=np.inf)),
        np.asarray(relative[best].reshape(3, 3)),
    )
