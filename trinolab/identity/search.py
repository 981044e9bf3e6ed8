"""The search for poses that explain the found markers: from seeds to a few poses fitted to all they
explain.

A seed comes from three found markers that may be three markers of the layout. Two cameras turn
pairs of found markers into points, and three points make a triangle with known sides. One camera
alone sees three directions: the perspective-three-point problem.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..checks import Array
from ..work import Work
from .hypotheses import FAR, Explained, Observed, Poses, explain, fit
from .layout import Layout, Views
from .p3p import three_point_depths
from .parameters import IdentityParameters
from .scoring import explains_all, judge

# The work of the poses from one triplet, in units of `work.Work`.
PAIR_UNITS = 8.0
SINGLE_UNITS = 25.0


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


def candidate_points(observed: Observed, pair: int, p: IdentityParameters) -> Candidates:
    """The points of two cameras' found markers whose rays pass each other within half of `gate_px`
    (Eq. 17, 20).

    `pair` counts in `observed.pairs`; where there are matches, of these alone.
    """
    views, uv = observed.views, observed.uv
    first, second = observed.pairs[pair]
    a, b = rays_through(views, uv)[[first, second]]
    base = views.centres[first] - views.centres[second]
    focal = views.focal.mean(axis=1)
    # Each ray meets the other one's nearest point at the depths s and t.
    cosine = a @ b.T
    along_a = (a @ base)[:, None]
    along_b = b @ base
    square = np.maximum(1 - cosine**2, 1e-12)
    s = (cosine * along_b - along_a) / square
    t = (along_b - cosine * along_a) / square
    gap_px = (
        np.abs(a @ np.cross(b, base).T) / np.sqrt(square) * focal[second] / np.maximum(t, 1e-12)
    )
    widest = p.gate_px / 2
    if observed.offsets is not None:
        apart = observed.offsets.apart_px(first, second)
        widest = float(np.hypot(widest, p.side_sigmas * apart))
    near = (s > 0) & (t > 0) & (gap_px < widest)
    near &= (uv[first, 0] < FAR)[:, None] & (uv[second, 0] < FAR)
    if observed.matches is not None:
        allowed = np.zeros_like(near)
        allowed[tuple(observed.matches[pair].T)] = True
        near &= allowed
    i, j = np.argwhere(near)[np.argsort(gap_px[near], kind="stable")[: p.max_pairs]].T
    aside = p.sigma_px / focal[first] * s[i, j]
    ahead = np.hypot(aside, p.sigma_px / focal[second] * t[i, j]) / np.sqrt(square[i, j])
    return Candidates(
        np.stack([i, j], axis=1), views.centres[first] + s[i, j, None] * a[i], a[i], ahead, aside
    )


def pair_seeds(
    candidates: Candidates, camera: int, observed: Observed, p: IdentityParameters, tries: int
) -> Iterator[Poses]:
    """Poses from triangles of candidate points: each time of all that show one triplet of the first
    camera's markers.

    Parameters
    ----------
    candidates : Candidates
    camera : int
        The first of the two. Triplets of its markers that face it are preferred, where their axes
        are given.
    observed : Observed
    p : IdentityParameters
    tries : int
        Triplets.
    """
    layout = observed.layout
    low, high = _side_range(candidates, p)
    distances = np.sort(layout.distances[np.isfinite(layout.distances)])
    fits = np.searchsorted(distances, high) > np.searchsorted(distances, low)
    fits &= (candidates.names[:, None] != candidates.names).all(axis=2)
    upper = np.triu(fits)
    corners = np.argwhere(upper[:, :, None] & upper & fits[:, None])
    names = np.sort(candidates.names[corners, 0], axis=1)
    score = _score(observed.uv[camera], observed.axes_of(camera), names)
    score *= fits.sum(axis=1)[corners].min(axis=1, initial=len(fits))
    for chosen in _best_triplets(names, score, tries):
        yield _from_triangles(
            candidates, corners[(names == chosen).all(axis=1)], low, high, layout, p
        )


def single_seeds(
    camera: int, observed: Observed, p: IdentityParameters, tries: int
) -> Iterator[Poses]:
    """Poses from triplets of one camera's markers: each time all that show one triplet as three
    markers that face it.

    Parameters
    ----------
    camera : int
    observed : Observed
        The axes of the markers, where they are given, show roughly how far away a marker is.
    p : IdentityParameters
    tries : int
        Triplets.
    """
    views, layout, uv = observed[:3]
    axes = observed.axes_of(camera)
    markers = np.flatnonzero(uv[camera, 0] < FAR)[: p.max_single]
    names = np.array(list(combinations(markers, 3)), dtype=int).reshape(-1, 3)
    if axes is not None:
        # No further apart than markers of the handle can be, by their size.
        ends = uv[camera][:, names]
        widest = np.sqrt(((ends - np.roll(ends, -1, axis=2)) ** 2).sum(axis=0)).max(axis=1)
        names = names[
            widest * layout.marker_mm
            < 1.3 * np.nanmax(layout.distances) * axes[names, 0].max(axis=1)
        ]
    rays = rays_through(views, uv)[camera]
    labels = np.argwhere(layout.triplets)
    for chosen in _best_triplets(names, _score(uv[camera], axes, names), tries):
        poses = _from_three(rays[chosen], labels, layout, p)
        if axes is not None:
            nominal = (
                layout.marker_mm
                * views.focal[camera, 0]
                / np.sqrt((poses.translations**2).sum(axis=1))
            )
            ratio = np.median(axes[chosen, 0]) / nominal
            poses = poses.take((ratio > 0.6) & (ratio < 2.0))  # motion blur makes a marker longer
        yield Poses(poses.rotations, poses.translations + views.centres[camera])


def _side_range(c: Candidates, p: IdentityParameters) -> tuple[Array, Array]:
    """Shortest and longest distance that each two candidates may have, shapes (m, m): the depths
    are uncertain.
    """
    edges = c.points[:, None] - c.points
    ahead = np.abs((edges * c.rays).sum(axis=2))
    across = np.sqrt(np.maximum((edges * edges).sum(axis=2) - ahead**2, 0.0))
    slack = p.side_sigmas * np.hypot(c.ahead[:, None], c.ahead)
    aside = p.side_sigmas * np.hypot(c.aside[:, None], c.aside)
    shortest = np.hypot(np.maximum(across - aside, 0.0), np.maximum(ahead - slack, 0.0))
    return shortest, np.hypot(across + aside, ahead + slack)


def _from_triangles(
    c: Candidates,
    triangles: np.ndarray,
    low: Array,
    high: Array,
    layout: Layout,
    p: IdentityParameters,
) -> Poses:
    """Poses that carry three markers onto candidate points (t, 3), where the sides fit and the
    markers face the ray.
    """
    ends = np.roll(triangles, -1, axis=1)
    shortest = low[triangles, ends][..., None, None]
    longest = high[triangles, ends][..., None, None]
    with np.errstate(invalid="ignore"):
        fits = (layout.distances >= shortest) & (layout.distances <= longest)  # (t, 3, n, n)
    # Sides 01, 12 and 20 of the triangle as axes of the markers 0, 1, 2.
    first = fits[:, 0, :, :, None]
    second = fits[:, 1, None]
    third = fits[:, 2].swapaxes(1, 2)[:, :, None]
    t, *labels = np.nonzero(first & second & third & layout.triplets)
    corners = np.stack(labels, axis=1)
    chosen = triangles[t]
    return _facing(
        _carried(layout.centres[corners], c.points[chosen]), corners, c.rays[chosen], layout, p
    )


def _from_three(rays: Array, labels: np.ndarray, layout: Layout, p: IdentityParameters) -> Poses:
    """Poses at which markers `labels` (k, 3) lie on three rays and face their origin, relative to
    that.
    """
    triangles = layout.centres[labels]
    sides = np.sqrt(((triangles - np.roll(triangles, -1, axis=1)) ** 2).sum(axis=2))
    depths = three_point_depths(rays, sides)
    solved = np.isfinite(depths[:, 0])
    corners = np.concatenate([labels, labels])[solved]
    return _facing(
        _carried(layout.centres[corners], depths[solved][..., None] * rays),
        corners,
        rays,
        layout,
        p,
    )


def _facing(
    poses: Poses, labels: np.ndarray, rays: Array, layout: Layout, p: IdentityParameters
) -> Poses:
    """The poses whose markers `labels` (h, 3) face the rays (h, 3, 3) or (3, 3) that meet them."""
    normals = layout.normals[labels] @ poses.rotations.transpose(0, 2, 1)
    return poses.take(((normals * rays).sum(axis=2) < p.away_cosine).all(axis=1))


def _carried(source: Array, target: Array) -> Poses:
    """The motions that carry triangles (h, 3, 3) onto others: frame onto frame."""
    rotations = _frames(target) @ _frames(source).transpose(0, 2, 1)
    return Poses(
        rotations, target.mean(axis=1) - (rotations @ source.mean(axis=1)[..., None])[..., 0]
    )


def _frames(triangles: Array) -> Array:
    """Axes for each triangle (h, 3, 3), as columns: x along 01, z across its plane."""
    x = triangles[:, 1] - triangles[:, 0]
    z = np.cross(x, triangles[:, 2] - triangles[:, 0])
    x = x / np.maximum(np.sqrt((x * x).sum(axis=1, keepdims=True)), 1e-12)
    z = z / np.maximum(np.sqrt((z * z).sum(axis=1, keepdims=True)), 1e-12)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _score(uv: Array, axes: Array | None, names: np.ndarray) -> Array:
    """Scores of triplets (t, 3): high for large ones of round markers, which face the camera."""
    (ax, bx, cx), (ay, by, cy) = uv[:, names].transpose(0, 2, 1)
    area = np.abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    return area if axes is None else area * (axes[:, 1] / axes[:, 0])[names].prod(axis=1)


def _best_triplets(names: np.ndarray, score: Array, tries: int) -> Iterator[np.ndarray]:
    """Triplets (3,) by falling score; each chosen one puts those off that share two markers with
    it.
    """
    for _ in range(tries):
        if not score.max(initial=0.0) > 0:
            return
        chosen = names[score.argmax()]
        yield chosen
        shared = (names[:, :, None] == chosen).any(axis=2).sum(axis=1)
        score = score * np.array([1.0, 1.0, 1e-3, 0.0])[shared]


def search(observed: Observed, p: IdentityParameters, work: Work) -> tuple[Poses, Explained] | None:
    """Find poses that explain the found markers, good and bad ones; None if there is nothing to
    try.

    Pairs of cameras come first. If they do not decide, single cameras are tried, unless there are
    matches. The search begins at the `cursor` of the work, which points to the first untried part
    when the work is spent.
    """
    tried = list(_tried(observed, p, work))
    if not tried:
        return None
    poses, explained = zip(*tried, strict=True)
    return (
        Poses(*map(np.concatenate, zip(*poses, strict=True))),
        Explained(*map(np.concatenate, zip(*explained, strict=True))),
    )


def _tried(
    observed: Observed, p: IdentityParameters, work: Work
) -> Iterator[tuple[Poses, Explained]]:
    """The poses of one triplet after the other, fitted, until some are beyond doubt."""
    sources = _sources(observed, p)
    first = work.cursor % max(len(sources), 1)
    agreed = False
    for number in (*range(first, len(sources)), *range(first)):
        camera, seeds = sources[number]
        if agreed and camera is not None:
            continue
        for poses in seeds:
            if not len(poses.rotations):
                continue
            if not work.takes(PAIR_UNITS if camera is None else SINGLE_UNITS):
                work.was_cut = True
                return
            work.cursor = number + 1
            if camera is None:
                poses = _best(poses, observed, p.seeds_kept, p, different=True)
            else:
                poses = _in_one(poses, camera, observed, p)
            tried = _refined(poses, observed, p)
            yield tried
            if _beyond_doubt(tried[1], p):
                return
            agreed |= camera is None and _beyond_doubt(tried[1], p, in_spite=True)
    work.cursor = 0


def _sources(observed: Observed, p: IdentityParameters) -> list[tuple[int | None, Iterator[Poses]]]:
    """Poses to try, one triplet after the other, with the camera or None for a pair: of pairs of
    cameras, first those with most in common; then of single cameras, first the one that found most,
    unless there are matches.

    Whatever explains all that was found explains any triplet of it: a few triplets are enough.
    """
    points = [candidate_points(observed, pair, p) for pair in range(len(observed.pairs))]
    pairs = sorted(range(len(points)), key=lambda k: -len(np.unique(points[k].names[:, 0])))
    sources: list[tuple[int | None, Iterator[Poses]]] = [
        (None, pair_seeds(points[k], observed.pairs[k][0], observed, p, tries=2)) for k in pairs
    ]
    if observed.matches is None:
        count = (observed.uv[:, 0] < FAR).sum(axis=1)
        for camera in np.argsort(-count, kind="stable").tolist():
            sources.append((camera, single_seeds(camera, observed, p, tries=3)))
    return sources


def _in_one(seeds: Poses, camera: int, observed: Observed, p: IdentityParameters) -> Poses:
    """The best of one camera's poses fitted to all its markers, each at the distance that suits the
    others best.
    """
    alone = observed.only(camera)
    for keep in (5 * p.seeds_kept, p.seeds_kept):
        seeds = _best(seeds, alone, keep, p)
        seeds = fit(seeds, explain(seeds, alone, 2 * p.gate_px, p).labels, alone, p, steps=2)
    steps = round(p.depth_range / p.depth_step)
    depths = 1 + p.depth_step * np.arange(-steps, steps + 1)
    centre = alone.views.centres
    ways = centre + (seeds.translations - centre)[:, None] * depths[:, None]  # (seeds, depths, 3)
    moved = Poses(np.repeat(seeds.rotations, len(depths), axis=0), ways.reshape(-1, 3))
    cost = explain(moved, observed, 4 * p.gate_px, p).cost.reshape(-1, len(depths))
    return moved.take(cost.argmin(axis=1) + np.arange(len(cost)) * len(depths))


def _best(
    seeds: Poses, observed: Observed, keep: int, p: IdentityParameters, different: bool = False
) -> Poses:
    """The poses of least cost; with `different`, at most one per labelling."""
    explained = explain(seeds, observed, 2 * p.gate_px, p)
    order = np.argsort(explained.cost, kind="stable")[: 10 * keep]
    if different:
        _, first = np.unique(
            explained.labels[order].reshape(len(order), -1), axis=0, return_index=True
        )
        order = order[np.sort(first)]
    return seeds.take(order[:keep])


def _refined(poses: Poses, observed: Observed, p: IdentityParameters) -> tuple[Poses, Explained]:
    """Poses fitted to all that they explain, with a gate that narrows."""
    for gate in p.fit_gates:
        explained = explain(poses, observed, gate * p.gate_px, p)
        poses = fit(poses, explained.labels, observed, p)
    return poses, explain(poses, observed, p.gate_px, p)


def _beyond_doubt(explained: Explained, p: IdentityParameters, in_spite: bool = False) -> bool:
    """Whether one of the poses is beyond doubt: it explains everything, or plenty and no camera
    speaks against it.

    With `in_spite` a camera may: another pair of cameras has been asked, and a single one would be
    outvoted.
    """
    v = judge(explained, p)
    everything = explains_all(explained, p) & (v.evidence <= np.log(p.chance))
    plenty = (v.supports.sum(axis=1) >= 2) & (v.evidence <= p.enough_evidence)
    plenty &= 4 * explained.lacking <= explained.hits.sum(axis=1)
    plenty &= in_spite | ~v.against.any(axis=1)
    return bool((v.holds & (everything | plenty)).any())
