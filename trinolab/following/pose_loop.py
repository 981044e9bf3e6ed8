"""The fit of one pose to the markers near it, compiled: what `identity.hypotheses` does for many poses
at once in NumPy, one call of which takes longer than all of this.

Compiled code does not detect an index out of bounds: the tests run the loop with bounds checked.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..estimators.loops import solve

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def approach(R, t, views, layout, limits, uv, seen):
    """A pose after two Gauss-Newton steps towards the markers that are seen, and one more towards
    those of them that lie where it then has them.

    Parameters
    ----------
    R, t : ndarray, shapes (3, 3), (3,)
        T_world_handle.
    views : tuple of ndarray
        Rotations, translations, focal lengths and principal points of `layout.Views`.
    layout : tuple of ndarray
        Centres, normals, tangents, slants and shift of `layout.Layout`.
    limits : ndarray, shape (3,)
        Cosines of the slant up to which a marker counts in full and of `Layout.limb`; how far from
        its place a marker may lie for the last step, px.
    uv : ndarray, shape (C, 2, n)
        Where each marker was detected, ideal pixels.
    seen : ndarray of bool, shape (C, n)
        Whether it was detected.

    Returns
    -------
    R, t : ndarray
    """
    steep, limb, gate_px = limits
    # of each marker: its pixel, the cosine of its slant, and the point that is seen as its centroid,
    # camera frame
    at = np.empty((*seen.shape, 6))
    for _ in range(2):
        project(R, t, views, layout, at)
        R, t = stepped(R, t, views, steep, uv, seen, at)
    project(R, t, views, layout, at)
    return stepped(R, t, views, steep, uv, nearest(uv, seen, limb, gate_px, at), at)


@_compiled
def project(R, t, views, layout, at):
    """Write the markers' images by a pose into `at` (C, n, 6); see `hypotheses.predict`."""
    rotations, translations, focal, principal = views
    centres, normals, tangents, slants, shift = layout
    per_rad = (len(slants) - 1) / slants[-1]
    for c in range(at.shape[0]):
        from_handle = (rotations[c] @ R).T
        arms = centres @ from_handle
        turned_normals = normals @ from_handle
        turned_tangents = tangents @ from_handle
        origin = rotations[c] @ t + translations[c]
        for k in range(at.shape[1]):
            towards = across = square = 0.0
            for i in range(3):
                X = arms[k, i] + origin[i]
                towards -= turned_normals[k, i] * X
                across -= turned_tangents[k, i] * X
                square += X * X
            slant = min(per_rad * math.atan2(abs(across), towards), len(slants) - 1.0)
            j = max(min(int(slant), len(slants) - 2), 0)  # also of what is no number
            along = shift[0, j] + (slant - j) * (shift[0, j + 1] - shift[0, j])
            aside = shift[1, j] + (slant - j) * (shift[1, j + 1] - shift[1, j])
            aside = math.copysign(aside, across)
            for i in range(3):
                away = along * turned_normals[k, i] + aside * turned_tangents[k, i]
                at[c, k, 3 + i] = arms[k, i] + origin[i] + away
            depth = at[c, k, 5]
            at[c, k, 0] = at[c, k, 3] / depth * focal[c, 0] + principal[c, 0]
            at[c, k, 1] = at[c, k, 4] / depth * focal[c, 1] + principal[c, 1]
            at[c, k, 2] = towards / math.sqrt(square) if depth > 0 else -1.0


@_compiled
def stepped(R, t, views, steep, uv, seen, at):
    """A pose after a Gauss-Newton step, large residuals held back; see `hypotheses.fit`."""
    rotations, translations, focal, _ = views
    normal = np.zeros((6, 6))
    right = np.zeros(6)
    slope = np.empty((2, 6))
    for c in range(at.shape[0]):
        origin = rotations[c] @ t + translations[c]
        for k in range(at.shape[1]):
            error = uv[c, :, k] - at[c, k, :2]
            size = math.sqrt(error @ error)
            if not seen[c, k] or not np.isfinite(size):
                continue
            point = at[c, k, 3:]
            arm = (point - origin) @ rotations[c]
            for axis in range(2):
                by_shift = rotations[c, axis] - point[axis] / point[2] * rotations[c, 2]
                by_shift *= focal[c, axis] / point[2]
                slope[axis, :3] = by_shift
                slope[axis, 3:] = np.cross(arm, by_shift)
            weight = min(max(at[c, k, 2] / steep, 0.1), 1.0) / max(size, 1.0)
            normal += weight * slope.T @ slope
            right += weight * (error @ slope)
    for i in range(6):
        normal[i, i] = normal[i, i] * (1 + 1e-6) + 1e-6
    solve(normal, right.reshape(6, 1), 6)
    return turn(right[3:]) @ R, t + right[:3]


@_compiled
def turn(vector):
    """The rotation matrix of a rotation vector; see `rigid.rotation_matrix`."""
    x, y, z = vector[0], vector[1], vector[2]
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.sqrt(vector @ vector)
    if angle == 0:
        return np.eye(3)
    return np.eye(3) + math.sin(angle) / angle * W + 2 * (math.sin(angle / 2) / angle) ** 2 * W @ W


@_compiled
def nearest(uv, seen, limb, gate_px, at):
    """Pairs of markers and places in a camera that are each other's nearest by their numbers, and
    lie within the gate, bool (C, n); see `hypotheses.explain`.
    """
    kept = np.zeros(seen.shape, np.bool_)
    for c in range(seen.shape[0]):
        for k in range(seen.shape[1]):
            own = squared(uv, at, c, k, k)
            if not seen[c, k] or at[c, k, 2] <= limb or not own < gate_px**2:
                continue
            kept[c, k] = True
            for other in range(seen.shape[1]):
                is_visible = at[c, other, 2] > limb
                if (is_visible and squared(uv, at, c, k, other) < own) or (
                    seen[c, other] and squared(uv, at, c, other, k) < own
                ):
                    kept[c, k] = False
    return kept


@_compiled
def squared(uv, at, c, marker, place):
    """The squared distance of a detected marker and a predicted place."""
    du = uv[c, 0, marker] - at[c, place, 0]
    dv = uv[c, 1, marker] - at[c, place, 1]
    return du * du + dv * dv
