"""The search for poses that explain the found markers: from seeds to a few poses fitted to all they explain.

A seed comes from three found markers that may be three markers of the layout. Two cameras turn pairs of found markers
into points, and three points make a triangle with known sides. One camera alone sees three directions: the
perspective-three-point problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..checks import Array
from .hypotheses import FAR, Explained, Poses, explain, fit
from .layout import Layout, Views
from .p3p import three_point_depths
from .scoring import CHANCE, PART, IdentityParameters, judge

SIGMAS = 3.0  # a side may be off by as many standard deviations
MOST_PAIRS, MOST_MARKERS = 48, 24  # candidates of two cameras, and found markers of one, that are tried
AWAY = 0.1  # cosine between ray and normal from which on a marker faces away, with some leave
SURE = -35.0  # evidence with which the search ends
DEPTHS = 1 + 0.004 * np.arange(-10, 11)  # one camera alone knows the distance to some percent; the others choose
KEEP = 8  # poses of one set of seeds that are fitted
GATES = (4.0, 2.0, 1.0)  # of the fits, in `gate_px`


class Candidates(NamedTuple):
    """Points of m pairs of found markers.

    Attributes
    ----------
    names : ndarray of int, shape (m, 2)
        The found markers of the first and of the second camera.
    points, rays : ndarray, shape (m, 3)
        On the first camera's ray, world frame, mm; the ray's direction.
    ahead, aside : ndarray, shape (m,)
        Standard deviation along the ray and across it, mm.
    """

    names: np.ndarray
    points: Array
    rays: Array
    ahead: Array
    aside: Array


def rays_through(views: Views, uv: Array) -> Array:
    """Directions through ideal pixels (C, 2, N), world frame, shape (C, N, 3), length 1."""
    xy = (uv - views.principal[:, :, None]) / views.focal[:, :, None]
    local = np.concatenate([xy, np.ones_like(xy[:, :1])], axis=1).transpose(0, 2, 1)
    return (local / np.sqrt((local * local).sum(axis=2, keepdims=True))) @ views.rotations


def candidate_points(views: Views, pair: tuple[int, int], uv: Array, sigma_px: float, gate_px: float,
                     matches: np.ndarray | None = None) -> Candidates:
    """The points of all pairs of found markers of two cameras whose rays pass each other within `gate_px` (Eq. 17, 20).

    With `matches`, rows of indices (k, 2), of these pairs alone.
    """
    first, second = pair
    a, b = rays_through(views, uv)[[first, second]]
    base, focal = views.centres[first] - views.centres[second], views.focal.mean(axis=1)
    cosine, p, q = a @ b.T, (a @ base)[:, None], b @ base
    square = np.maximum(1 - cosine**2, 1e-12)
    s, t = (cosine * q - p) / square, (q - cosine * p) / square  # along the rays to where they are nearest
    gap_px = np.abs(a @ np.cross(b, base).T) / np.sqrt(square) * focal[second] / np.maximum(t, 1e-12)
    near = (s > 0) & (t > 0) & (gap_px < gate_px) & (uv[first, 0] < FAR)[:, None] & (uv[second, 0] < FAR)
    if matches is not None:
        allowed = np.zeros_like(near)
        allowed[tuple(matches.T)] = True
        near &= allowed
    i, j = np.argwhere(near)[np.argsort(gap_px[near], kind="stable")[:MOST_PAIRS]].T
    aside = sigma_px / focal[first] * s[i, j]
    ahead = np.hypot(aside, sigma_px / focal[second] * t[i, j]) / np.sqrt(square[i, j])
    return Candidates(np.stack([i, j], axis=1), views.centres[first] + s[i, j, None] * a[i], a[i], ahead, aside)


def pair_seeds(candidates: Candidates, uv: Array, axes: Array | None, layout: Layout, tries: int) -> Iterator[Poses]:
    """Poses from triangles of candidate points: each time of all that show one triplet of the first camera's markers.

    Parameters
    ----------
    candidates : Candidates
    uv : ndarray, shape (2, N)
        Pixels of the first camera's markers.
    axes : ndarray, shape (N, 2), or None
        Their major and minor axes, px: markers that face the camera are preferred.
    layout : Layout
    tries : int
        Triplets.
    """
    low, high = _side_range(candidates)
    known = np.sort(layout.distances[np.isfinite(layout.distances)])
    fits = np.searchsorted(known, high) > np.searchsorted(known, low)
    fits &= (candidates.names[:, None] != candidates.names).all(axis=2)
    upper = np.triu(fits)
    corners = np.argwhere(upper[:, :, None] & upper & fits[:, None])
    names = np.sort(candidates.names[corners, 0], axis=1)
    score = _score(uv, axes, names) * fits.sum(axis=1)[corners].min(axis=1, initial=len(fits))
    for chosen in _best_triplets(names, score, tries):
        yield _from_triangles(candidates, corners[(names == chosen).all(axis=1)], low, high, layout)


def single_seeds(camera: int, uv: Array, axes: Array | None, views: Views, layout: Layout,
                 tries: int) -> Iterator[Poses]:
    """Poses from triplets of one camera's markers: each time all that show one triplet as three markers that face it.

    Parameters
    ----------
    camera : int
    uv : ndarray, shape (C, 2, N)
        Pixels.
    axes : ndarray, shape (N, 2), or None
        Major and minor axes of this camera's markers, px: they say roughly how far away a marker is.
    views : Views
    layout : Layout
    tries : int
        Triplets.
    """
    known = np.flatnonzero(uv[camera, 0] < FAR)[:MOST_MARKERS]
    names = np.array(list(combinations(known, 3)), dtype=int).reshape(-1, 3)
    if axes is not None:  # as far apart as markers can be, by their size
        ends = uv[camera][:, names]
        widest = np.sqrt(((ends - np.roll(ends, -1, axis=2)) ** 2).sum(axis=0)).max(axis=1)
        names = names[widest * layout.marker_mm < 1.3 * np.nanmax(layout.distances) * axes[names, 0].max(axis=1)]
    rays, labels = rays_through(views, uv)[camera], np.argwhere(layout.triplets)
    for chosen in _best_triplets(names, _score(uv[camera], axes, names), tries):
        poses = _from_three(rays[chosen], labels, layout)
        if axes is not None:
            nominal = layout.marker_mm * views.focal[camera, 0] / np.sqrt((poses.translations**2).sum(axis=1))
            ratio = np.median(axes[chosen, 0]) / nominal
            poses = poses.take((ratio > 0.6) & (ratio < 2.0))  # not less: a moving marker is smeared
        yield Poses(poses.rotations, poses.translations + views.centres[camera])


def _side_range(c: Candidates) -> tuple[Array, Array]:
    """Shortest and longest distance that each two candidates may have, shapes (m, m): the depths are uncertain."""
    way = c.points[:, None] - c.points
    ahead = np.abs((way * c.rays).sum(axis=2))
    across = np.sqrt(np.maximum((way * way).sum(axis=2) - ahead**2, 0.0))
    slack, aside = (SIGMAS * np.hypot(sigma[:, None], sigma) for sigma in (c.ahead, c.aside))
    return (np.hypot(np.maximum(across - aside, 0.0), np.maximum(ahead - slack, 0.0)),
            np.hypot(across + aside, ahead + slack))


def _from_triangles(c: Candidates, triangles: np.ndarray, low: Array, high: Array, layout: Layout) -> Poses:
    """Poses that carry three markers onto candidate points (t, 3), where the sides fit and the markers face the ray."""
    ends = np.roll(triangles, -1, axis=1)
    shortest, longest = (side[triangles, ends][..., None, None] for side in (low, high))
    with np.errstate(invalid="ignore"):
        fits = (layout.distances >= shortest) & (layout.distances <= longest)  # (t, 3, n, n)
    t, *labels = np.nonzero(fits[:, 0, :, :, None] & fits[:, 1, None] & fits[:, 2].swapaxes(1, 2)[:, :, None]
                            & layout.triplets)
    corners, chosen = np.stack(labels, axis=1), triangles[t]
    return _facing(_carried(layout.centres[corners], c.points[chosen]), corners, c.rays[chosen], layout)


def _from_three(rays: Array, labels: np.ndarray, layout: Layout) -> Poses:
    """Poses at which markers `labels` (k, 3) lie on three rays and face their origin, relative to that."""
    triangles = layout.centres[labels]
    sides = np.sqrt(((triangles - np.roll(triangles, -1, axis=1)) ** 2).sum(axis=2))
    depths = three_point_depths(rays, sides)
    corners, solved = np.concatenate([labels, labels]), np.isfinite(depths[:, 0])
    corners, depths = corners[solved], depths[solved]
    return _facing(_carried(layout.centres[corners], depths[..., None] * rays), corners, rays, layout)


def _facing(poses: Poses, labels: np.ndarray, rays: Array, layout: Layout) -> Poses:
    """The poses whose markers `labels` (h, 3) face the rays (h, 3, 3) or (3, 3) that meet them."""
    normals = layout.normals[labels] @ poses.rotations.transpose(0, 2, 1)
    return poses.take(((normals * rays).sum(axis=2) < AWAY).all(axis=1))


def _carried(source: Array, target: Array) -> Poses:
    """The motions that carry triangles (h, 3, 3) onto others: frame onto frame."""
    rotations = _frames(target) @ _frames(source).transpose(0, 2, 1)
    return Poses(rotations, target.mean(axis=1) - (rotations @ source.mean(axis=1)[..., None])[..., 0])


def _frames(triangles: Array) -> Array:
    """Axes for each triangle (h, 3, 3), as columns: x along 01, z across its plane."""
    x = triangles[:, 1] - triangles[:, 0]
    z = np.cross(x, triangles[:, 2] - triangles[:, 0])
    x, z = (v / np.maximum(np.sqrt((v * v).sum(axis=1, keepdims=True)), 1e-12) for v in (x, z))
    return np.stack([x, np.cross(z, x), z], axis=2)


def _score(uv: Array, axes: Array | None, names: np.ndarray) -> Array:
    """How promising triplets (t, 3) are: large ones, of round markers, for these face the camera."""
    (ax, bx, cx), (ay, by, cy) = uv[:, names].transpose(0, 2, 1)
    area = np.abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    return area if axes is None else area * (axes[:, 1] / axes[:, 0])[names].prod(axis=1)


def _best_triplets(names: np.ndarray, score: Array, tries: int) -> Iterator[np.ndarray]:
    """Triplets (3,) by falling score; each chosen one puts those off that share two markers with it."""
    for _ in range(tries):
        if not score.max(initial=0.0) > 0:
            return
        chosen = names[score.argmax()]
        yield chosen
        shared = (names[:, :, None] == chosen).any(axis=2).sum(axis=1)
        score = score * np.array([1.0, 1.0, 1e-3, 0.0])[shared]


def search(views: Views, layout: Layout, uv: Array, axes: Array | None, pairs: Sequence[tuple[int, int]],
           matches: Sequence[np.ndarray] | None, p: IdentityParameters) -> tuple[Poses, Explained] | None:
    """Find poses that explain the found markers, good and bad ones; None if there is nothing to try.

    Parameters
    ----------
    views : Views
    layout : Layout
    uv : ndarray, shape (C, 2, N)
        Found markers, see `hypotheses.ideal_pixels`.
    axes : ndarray, shape (C, N, 2), or None
        Their major and minor axes, px.
    pairs : sequence of (int, int)
        Of the cameras.
    matches : sequence of ndarray of int, or None
        For each pair the markers, shape (k, 2), that may be the same; then single cameras are not tried.
    p : IdentityParameters
    """
    tried: list[tuple[Poses, Explained]] = []
    for seeds in _pair_seeds(views, layout, uv, axes, pairs, matches, p):
        tried.append(_refined(_best(seeds, views, layout, uv, 2 * p.gate_px, KEEP, True), views, layout, uv, p))
        if _settled(tried[-1][1], p):
            break
    if matches is None and not any(_settled(explained, p, in_spite=True) for _, explained in tried):
        for camera, seeds in _single_seeds(views, layout, uv, axes):
            tried.append(_refined(_in_one(seeds, camera, views, layout, uv, p), views, layout, uv, p))
            if _settled(tried[-1][1], p):
                break
    if not tried:
        return None
    poses, explained = zip(*tried, strict=True)
    return (Poses(*map(np.concatenate, zip(*poses, strict=True))),
            Explained(*map(np.concatenate, zip(*explained, strict=True))))


def _pair_seeds(views: Views, layout: Layout, uv: Array, axes: Array | None, pairs: Sequence[tuple[int, int]],
                matches: Sequence[np.ndarray] | None, p: IdentityParameters) -> Iterator[Poses]:
    """Poses to try, by pairs of cameras; first those with most in common.

    Whatever explains all that was found explains any triplet of it: a few triplets are enough.
    """
    points = [candidate_points(views, pair, uv, p.sigma_px, p.gate_px / 2, None if matches is None else matches[k])
              for k, pair in enumerate(pairs)]
    for k in sorted(range(len(pairs)), key=lambda k: -len(np.unique(points[k].names[:, 0]))):
        first = pairs[k][0]
        seeds = pair_seeds(points[k], uv[first], None if axes is None else axes[first], layout, tries=2)
        yield from (poses for poses in seeds if len(poses.rotations))


def _single_seeds(views: Views, layout: Layout, uv: Array, axes: Array | None) -> Iterator[tuple[int, Poses]]:
    """Poses to try, by single cameras; first the one that found most."""
    for camera in np.argsort(-(uv[:, 0] < FAR).sum(axis=1), kind="stable"):
        seeds = single_seeds(camera, uv, None if axes is None else axes[camera], views, layout, tries=3)
        yield from ((int(camera), poses) for poses in seeds if len(poses.rotations))


def _in_one(seeds: Poses, camera: int, views: Views, layout: Layout, uv: Array, p: IdentityParameters) -> Poses:
    """The best of one camera's poses fitted to all its markers, each at the distance that suits the others best."""
    view, pixels = views.only(camera), uv[[camera]]
    for keep in (40, KEEP):
        seeds = _best(seeds, view, layout, pixels, 2 * p.gate_px, keep)
        seeds = fit(seeds, explain(seeds, view, layout, pixels, 2 * p.gate_px).labels, view, layout, pixels, steps=2)
    ways = view.centres + (seeds.translations - view.centres)[:, None] * DEPTHS[:, None]  # (KEEP, depths, 3)
    moved = Poses(np.repeat(seeds.rotations, len(DEPTHS), axis=0), ways.reshape(-1, 3))
    cost = explain(moved, views, layout, uv, 4 * p.gate_px).cost.reshape(-1, len(DEPTHS))
    return moved.take(cost.argmin(axis=1) + np.arange(len(cost)) * len(DEPTHS))


def _best(seeds: Poses, views: Views, layout: Layout, uv: Array, gate_px: float, keep: int,
          different: bool = False) -> Poses:
    """The poses of least cost; if they shall be different, one for each labelling."""
    explained = explain(seeds, views, layout, uv, gate_px)
    order = np.argsort(explained.cost, kind="stable")[:10 * keep]
    if different:
        _, first = np.unique(explained.labels[order].reshape(len(order), -1), axis=0, return_index=True)
        order = order[np.sort(first)]
    return seeds.take(order[:keep])


def _refined(poses: Poses, views: Views, layout: Layout, uv: Array, p: IdentityParameters) -> tuple[Poses, Explained]:
    """Poses fitted to all that they explain, with a gate that narrows."""
    for gate in GATES:
        explained = explain(poses, views, layout, uv, gate * p.gate_px)
        poses = fit(poses, explained.labels, views, layout, uv)
    return poses, explain(poses, views, layout, uv, p.gate_px)


def _settled(explained: Explained, p: IdentityParameters, in_spite: bool = False) -> bool:
    """Whether one of the poses is beyond doubt: it explains everything, or plenty and no camera speaks against it.

    With `in_spite` a camera may: another pair of cameras has been asked, and a single one would be outvoted.
    """
    v = judge(explained, p)
    everything = (explained.strangers.sum(axis=1) == 0) & (explained.lacking < PART) & (v.evidence <= CHANCE)
    plenty = (v.supports.sum(axis=1) >= 2) & (v.evidence <= SURE)
    plenty &= (4 * explained.lacking <= explained.hits.sum(axis=1)) & (in_spite | ~v.against.any(axis=1))
    return bool((v.holds & (everything | plenty)).any())
