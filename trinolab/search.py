"""The search for poses that explain the found markers: from seeds to a few poses fitted to all they explain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .checks import Array
from .hypotheses import FAR, Explained, Poses, explain, fit
from .layout import Layout, Views
from .seeds import candidate_points, pair_seeds, single_seeds
from .verdict import CHANCE, PART, IdentityParameters, judge

SURE = -35.0  # evidence with which the search ends
DEPTHS = 1 + 0.004 * np.arange(-10, 11)  # one camera alone knows the distance to some percent; the others choose
KEEP = 8  # poses of one set of seeds that are fitted
GATES = (4.0, 2.0, 1.0)  # of the fits, in `gate_px`


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
