"""How much of Table 1's position errors the images can make, whatever their size: errors of two cameras
are long in depth, and the table's are equal in all directions. Chapter 9.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Rig
from trinolab.checks import Array, as_array, as_whole
from trinolab.handle import Handle, facing_pixels
from trinolab.sensitivity import motion_slopes, pixel_slopes

from .deviations import Source
from .pattern import rigid_field

SHARES = np.linspace(0.0, 1.0, 201)  # of the mean square, on which the likelihood is computed


class Bound(NamedTuple):
    """The share of the observed mean square, after the registration, that errors of the images make.

    Attributes
    ----------
    likeliest : float
    at_most : float
        The upper end of its interval, one-sided.
    refused : float
        Twice the logarithm of the likelihood of isotropic errors, divided by that of errors of the
        images alone.
    """

    likeliest: float
    at_most: float
    refused: float


def mauchly(errors: ArrayLike) -> float:
    """The p value of Mauchly's test (1940) that errors, shape (n, 3), have the same variance in all
    directions.
    """
    e = as_array(errors, "errors", (None, 3))
    free = len(e) - 1
    S = np.cov(e.T)
    W = np.linalg.det(S) / (np.trace(S) / 3) ** 3
    return float(stats.chi2.sf(-(free - 23 / 18) * np.log(W), 5))


def of_points(rig: Rig, points: ArrayLike) -> Array:
    """Covariances of points triangulated from pixels with an error of 1 px per coordinate, shape (n,
    3, 3), mm^2.
    """
    x = as_array(points, "points", (None, 3))
    J = np.array([pixel_slopes(camera, x)[1] for camera in rig.cameras])  # (cameras, n, 2, 3)
    return np.linalg.inv(np.einsum("cnik,cnil->nkl", J, J))


def of_rods(rig: Rig, handle: Handle, poses: RigidTransform, max_slant_deg: float = 70.0) -> Array:
    """Covariances of the positions of poses fitted to the pixels of all markers by least squares, the
    pixels having an error of 1 px per coordinate, shape (n, 3, 3), mm^2.
    """
    found = []
    for T in poses:
        uv = [facing_pixels(handle, camera, T, max_slant_deg) for camera in rig.cameras]
        camera, marker = np.nonzero(np.isfinite(uv).all(axis=2))
        points = T.apply(handle.marker_centres[marker])
        J = motion_slopes(rig, camera, points, T.translation).reshape(-1, 6)
        found.append(np.linalg.inv(J.T @ J)[:3, :3])
    return np.array(found)


def of_source(source: Source) -> Array:
    """Covariances of the position errors of a source that is new in each pose, shape (n, 3, 3)."""
    roots = source.roots[:, :3]
    return np.einsum("niq,njq->nij", roots, roots)


def of_images(
    errors: ArrayLike, positions: ArrayLike, covariances: ArrayLike, level: float = 0.05
) -> Bound:
    """The share of position errors that the images make, by the restricted likelihood (Patterson and
    Thompson 1971): a part with the covariances of the images, of free size, and an isotropic rest;
    the six numbers of the registration are projected out.

    Parameters
    ----------
    errors : array_like, shape (n, 3)
        mm.
    positions : array_like, shape (n, 3)
        mm.
    covariances : array_like, shape (n, 3, 3)
        Of errors of the images, to a factor.
    level : float
        Of the interval's upper end.
    """
    Q, spread = _directions(positions, covariances)
    e = as_array(errors, "errors", (len(Q) // 3, 3))
    return bounds(Q.T @ e.ravel(), spread, level)[0]


def power(
    positions: ArrayLike,
    covariances: ArrayLike,
    share: float,
    tables: int,
    rng: np.random.Generator,
    level: float = 0.05,
) -> list[Bound]:
    """The bounds of drawn tables in which the images make a share of the mean square; parameters as
    in `of_images`.
    """
    _, spread = _directions(positions, covariances)
    scale = np.sqrt(1 - share + share * spread)
    y = scale * rng.standard_normal((as_whole(tables, "tables", 1), len(spread)))
    return bounds(y, spread, level)


def bounds(components: Array, spread: Array, level: float) -> list[Bound]:
    """The bounds of tables whose independent components, shape (..., q), have variances in proportion
    to 1 - share + share * spread.
    """
    y = np.atleast_2d(components)
    variance = 1 - SHARES[:, None] + SHARES[:, None] * spread
    size = y**2 @ (1 / variance).T / len(spread)
    twice_log = -len(spread) * np.log(size) - np.log(variance).sum(axis=1)
    best = twice_log.argmax(axis=1)
    near = twice_log.max(axis=1)[:, None] - twice_log <= stats.chi2.ppf(1 - 2 * level, 1)
    last = near.shape[1] - 1 - near[:, ::-1].argmax(axis=1)
    refused = twice_log[:, 0] - twice_log[:, -1]
    rows = np.arange(len(y))
    of_observed = np.minimum(SHARES * size / size[:, :1], 1.0)
    ends = of_observed[rows, best], of_observed[rows, last]
    return [Bound(*map(float, row)) for row in zip(*ends, refused, strict=True)]


def _directions(positions: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array]:
    """Directions (3 n, 3 n - 6) that a rigid motion does not reach and in which the images' errors are
    independent, and the variance of each, by their mean.
    """
    field = rigid_field(positions)
    n = len(field)
    A = np.zeros((3 * n, 3 * n))
    blocks = as_array(covariances, "covariances", (n, 3, 3))
    for k, block in enumerate(blocks):
        A[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    free = np.linalg.qr(field.reshape(3 * n, -1), mode="complete")[0][:, field.shape[2] :]
    values, vectors = np.linalg.eigh(free.T @ A @ free)
    return free @ vectors, values / values.mean()
