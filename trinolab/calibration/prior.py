"""The prior of a rig and a handle in a bundle adjustment, and the unknowns that it leaves.

**Unknowns of unit variance.** With P = B B^T and g = B u the prior of u is the unit matrix. A parameter
that is known exactly has no column in B, and u has no units.

**Gauge.** Three motions change no image: of the world, of the handle's frame with all markers in
it, and the scale. The world is held by the first camera, whose place and direction do not change.
The handle's frame is held by the markers: their changes have no part that is a rigid motion of all
of them, so that columns of B are orthogonal to these six. This defines the new frame: the one in which
the markers move least. The scale is held by a length that is stated, else by the prior.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, null_space

from ..camera import Rig
from ..checks import Array, frozen
from ..default_covariance import known_covariance, known_placement_mm
from ..handle import Handle
from ..rigid import cross_matrices
from ..sensitivity import students_factor

POSE = 6  # of a camera's parameters, the last ones: its place and direction
_ROUNDING = 1e-12


class Length(NamedTuple):
    """A length that is known, mm: the distance of two ``cameras``' centres, or of two ``markers``'
    centres, by their indices.
    """

    of: str
    first: int
    second: int
    mm: float


class Prior(NamedTuple):
    """The prior of a rig and a handle.

    Attributes
    ----------
    rig : ndarray, shape (15 c, 15 c)
        The matrix of `camera.RigCovariance`, with zeros for the first camera's place and direction.
    placement_sigma_mm : float
        Of each coordinate of each marker's centre; 0 holds them all.
    length : Length or None
        The length that fixes the scale; None where the covariances above do.
    """

    rig: Array
    placement_sigma_mm: float
    length: Length | None


def prior_of(rig: Rig, handle: Handle, length: Length | None = None) -> Prior:
    """The prior of a rig and a handle: the covariances that they state, else the `default_covariance`.

    If no length is given, the distance of the first two cameras fixes the scale of a rig that states no
    covariance. The same holds for a rig that is stated to be exact, such as the bench's, because an
    adjustment assumes that it may be wrong; and for a handle.
    """
    if known_covariance(rig).is_exact:
        rig = replace(rig, covariance=None)
    if handle.placement_sigma_mm == 0:
        handle = replace(handle, placement_sigma_mm=None)
    if rig.covariance is None:
        first, second = (camera.centre for camera in rig.cameras[:2])
        baseline_mm = float(np.linalg.norm(first - second))
        length = length or Length("cameras", 0, 1, baseline_mm)
    known = known_covariance(rig)
    covariance = _held_by_first(rig, students_factor(known.freedom) * known.matrix)
    return Prior(frozen(covariance), known_placement_mm(handle), length)


def _held_by_first(rig: Rig, covariance: Array) -> Array:
    """The covariance of a rig in the world of its first camera: an error of that camera's place and
    direction is a motion of the world, which becomes an error of the other cameras.
    """
    n = len(rig.parameters)
    of_first = slice(n - POSE, n)
    change = np.eye(len(covariance))
    first = rig.cameras[0].T_cam_world.rotation
    for c, camera in enumerate(rig.cameras):
        turn = (camera.T_cam_world.rotation * first.inv()).as_matrix()
        pose = slice(n * (c + 1) - POSE, n * (c + 1))
        change[pose, of_first] -= block_diag(turn, turn)
    held = change @ covariance @ change.T
    held[of_first] = 0.0
    held[:, of_first] = 0.0
    return (held + held.T) / 2


def basis(handle: Handle, prior: Prior) -> Array:
    """The matrix B, (15 c + 3 m, q): a column for each unknown of unit variance."""
    sigma = np.sqrt(np.diag(prior.rig))
    scale = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(prior.rig / np.outer(scale, scale))
    free = values > _ROUNDING
    cameras = sigma[:, None] * vectors[:, free] * np.sqrt(values[free])
    X = handle.marker_centres
    if prior.placement_sigma_mm == 0:
        return block_diag(cameras, np.zeros((X.size, 0)))
    moves = np.broadcast_to(np.eye(3), (len(X), 3, 3))
    rigid = np.concatenate([moves, -cross_matrices(X - X.mean(axis=0))], axis=2).reshape(-1, 6)
    return block_diag(cameras, prior.placement_sigma_mm * null_space(rigid.T))
