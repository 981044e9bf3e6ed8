"""The image model in NumPy, a stack of windows at a time: the reference of `estimators.loops`."""

from typing import NamedTuple

import numpy as np

from trinolab.estimators.appearance import shading_basis
from trinolab.estimators.imagemodel import BORDER_PX, CLEAR_PX, ENOUGH, Noise, Reduced
from trinolab.estimators.loops import GRAZING
from trinolab.estimators.movingmodel import in_handle


class Layers(NamedTuple):
    """What the cells of windows show, before the blur.

    Attributes
    ----------
    marker, body : ndarray, shape (k, p)
        Share of the cell's area that the view's marker covers (or any marker), and that all of the
        body does.
    marker_by_body : ndarray, shape (k, p)
        How fast the marker's share grows with the body's.
    marker_point, body_point : ndarray, shape (3, k, p)
        Where the ray meets the body, and where it is nearest to the axis; handle frame, mm.
    marker_push, body_push : ndarray, shape (3, k, p)
        How fast the shares grow as the handle moves there, 1/mm: the marker's by its own edge, the
        body's.
    turn : ndarray, shape (k, p)
        Angle about the axis from the marker's column, rad.
    clear : ndarray, shape (k, p)
        Distance from whatever else is there, the body's end or another marker's edge, in cells;
        negative inside it.
    """

    marker: object
    body: object
    marker_by_body: object
    marker_point: object
    body_point: object
    marker_push: object
    body_push: object
    turn: object
    clear: object


class _Rays(NamedTuple):
    """Rays in the handle's frame: start (3, k, 1), direction (3, k, p), its derivatives by u and v
    (3, k, 1).
    """

    start: object
    direction: object
    by_u: object
    by_v: object


class _Place(NamedTuple):
    """Points of the body beside a marker's middle: angle about the axis, rad; along it, and
    distance, mm; (k, p).
    """

    turn: object
    along: object
    distance: object


def layers(
    rig,
    handle,
    T_world_handle,
    views,
    at,
    any_marker=False,
):
    """What each cell of windows shows of the handle at a pose (see `Layers`).

    With `any_marker` the neighbours of a view's marker count as it does, and are nothing else that
    is in the way.
    """
    rays = _rays(rig, T_world_handle, views, at)
    depth, P, outward, distance = _nearest_to_axis(rays)
    body, body_rate, width = _edge(handle.radius_mm - distance, depth, outward, rays)
    radius = handle.marker_radii[views.marker, None]
    inside = _within_outline(radius, distance, width)
    depth, X, normal = _surface(inside, radius, rays, depth, P)
    clear = np.minimum(handle.top_mm - X[1], X[1] - handle.bottom_mm)
    angle = np.arctan2(X[0], X[2])
    edge = handle.marker_diameter_mm / 2
    own = nearest = _place(handle, views.marker, angle, X[1])
    for others in _neighbours(handle)[views.marker].T:
        beside = _place(handle, others, angle, X[1])
        if any_marker:
            nearer = beside.distance < nearest.distance
            nearest = _Place(
                *(np.where(nearer, *pair) for pair in zip(beside, nearest, strict=True))
            )
        else:
            clear = np.minimum(clear, beside.distance - edge)
    gradient = _inwards(nearest, X)
    facing = np.minimum(_dot(normal, rays.direction), -GRAZING)
    # as the ray's point slides along the surface
    gradient -= normal * (_dot(gradient, rays.direction) / facing)
    covered, marker_rate, width = _edge(edge - nearest.distance, depth, gradient, rays)
    marker_push = gradient * -(body * marker_rate)
    body_push = outward * body_rate
    return Layers(
        covered * body, body, covered, X, P, marker_push, body_push, own.turn, clear / width
    )


def _rays(rig, T_world_handle, views, at):
    R_handle_world = T_world_handle.as_matrix()[:3, :3].T
    turns = [R_handle_world @ camera.T_world_cam.as_matrix()[:3, :3] for camera in rig.cameras]
    starts = [
        R_handle_world @ (camera.centre - T_world_handle.translation) for camera in rig.cameras
    ]
    R = np.stack(turns)[views.camera].transpose(2, 1, 0)[..., None]
    start = np.stack(starts)[views.camera].T[..., None]
    by_u, by_v = (
        R[0] * at.xy_per_cell[:, 0, k, None] + R[1] * at.xy_per_cell[:, 1, k, None] for k in (0, 1)
    )
    return _Rays(start, R[0] * at.xy[0] + R[1] * at.xy[1] + R[2], by_u, by_v)


def _nearest_to_axis(rays):
    """Depth (k, p), point (3, k, p), direction from the axis and distance, mm, where rays pass the
    axis nearest by.
    """
    (ox, _, oz), (dx, _, dz) = rays.start, rays.direction
    depth = -(ox * dx + oz * dz) / (dx * dx + dz * dz)
    P = rays.start + depth * rays.direction
    outward = P.copy()
    outward[1] = 0
    distance = np.maximum(np.hypot(P[0], P[2]), 1e-6)
    return depth, P, outward / distance, distance


def _within_outline(radius, distance, width):
    """How far within the outline that lies, in the mean, which a cell shows of the body, mm, (k, p);
    0 where it shows nothing. The ray of the cell's middle passes the axis at a distance (k, p), and
    the cell is some mm wide.

    Towards the outline the surface turns away ever faster: a cell that the outline cuts shows
    another part of it than its middle's ray meets.
    """
    inside = radius - distance
    in_cut_cell = np.clip((inside + width / 2) / 2, 0.0, radius)
    return np.where(inside > width / 2, inside, in_cut_cell)


def _surface(inside, radius, rays, depth, P):
    """Depth (k, p), point (3, k, p) and normal where a ray that passes the outline `inside` mm
    within meets the cylinder that the view's marker is wrapped on, of a radius (k, 1); where it
    passes that nearest by if `inside` is 0.
    """
    dx, _, dz = rays.direction
    half = np.sqrt(inside * (2 * radius - inside) / (dx * dx + dz * dz))
    X = P - half * rays.direction
    normal = X / np.hypot(X[0], X[2])
    normal[1] = 0
    return depth - half, X, normal


def _place(handle, markers, angle, axial):
    """Where points of the body, by angle and axial coordinate (k, p), lie beside the middle of a
    marker each (k,).
    """
    turn = _wrapped(angle - handle.marker_angles[markers, None])
    along = axial - handle.marker_centres[markers, 1, None]
    across = handle.marker_radii[markers, None] * turn
    return _Place(turn, along, np.maximum(np.hypot(across, along), 1e-9))


def _inwards(place, X):
    """Gradient (3, k, p) of the distance into the marker, at points X of the body."""
    across = place.turn * X[2], -place.turn * X[0]
    return -np.stack([across[0], place.along, across[1]]) / place.distance


def _neighbours(handle, nearest=2):
    """Indices (markers, nearest) of each marker's nearest neighbours on the surface."""
    theta = handle.marker_angles
    axial = handle.marker_centres[:, 1]
    gap = np.hypot(handle.radius_mm * _wrapped(theta[:, None] - theta), axial[:, None] - axial)
    np.fill_diagonal(gap, np.inf)
    return gap.argsort(axis=1)[:, :nearest]


def _edge(inside, depth, gradient, rays):
    """Share (k, p) of a cell's area on the inner side of an edge, how fast it grows with `inside`,
    1/mm, and mm to a cell.

    The edge is straight within a cell: `inside` mm away, with a gradient (3, k, p) at the ray's
    point, `depth` along the ray. The share is then the integral of a trapezoid.
    """
    by_u, by_v = (np.abs(depth * _dot(gradient, step)) for step in (rays.by_u, rays.by_v))
    # zero in the very middle
    long, short = (np.maximum(part(by_u, by_v), 1e-6) for part in (np.maximum, np.minimum))
    away = np.abs(inside)
    remainder = np.maximum((long + short) / 2 - away, 0.0)  # to where the edge leaves the cell
    corner = remainder < short  # it cuts off no more than a corner
    outer = np.where(corner, remainder**2 / (2 * long * short), 0.5 - away / long)
    rate = np.where(corner, remainder / short, 1.0) / long
    return np.where(inside > 0, 1 - outer, outer), rate, np.hypot(long, short)


def _wrapped(angle):
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class Linear(NamedTuple):
    """The model about a state.

    Attributes
    ----------
    greys : ndarray, shape (k, 6 or 9)
        Of the state, or found where it had none.
    predicted, residual, weight : ndarray, shape (k, p)
    by_pose : ndarray, shape (k, 7 or 13, p)
        Derivatives by a small motion of the handle (nu mm, omega rad; handle frame), where there is
        motion blur by that (handle frame), and by the blur's variance.
    by_greys : ndarray, shape (k, 6 or 9, p)
    by_gloss : ndarray, shape (k, 3, p)
        Derivatives by the gloss, whether it is among the greys or not.
    marker, body : ndarray, shape (k, p)
        Shares after the blur.
    """

    greys: object
    predicted: object
    residual: object
    weight: object
    by_pose: object
    by_greys: object
    by_gloss: object
    marker: object
    body: object


def estimate_noise(residual, predicted, used, marker, body):
    """Estimate the noise from residuals on the body and on markers, away from all edges: from
    medians, so that wrong pixels do not count; what too few pixels show is left at a usual value.

    All arrays have one shape; `marker` and `body` are the shares of each pixel that these cover.
    """
    dark, bright = (used & (body > 0.99) & part for part in (marker < 0.01, marker > 0.99))
    if min(dark.sum(), bright.sum()) < ENOUGH:
        return Noise()
    low, high = (_robust_variance(residual[part]) for part in (dark, bright))
    level, higher = (float(predicted[part].mean()) for part in (dark, bright))
    slope = min(max((high - low) / (higher - level or 1.0), 0.0), 0.7 * low / max(level, 1.0))
    beyond = residual[used & (body < 0.05)]
    is_seen = beyond.size >= ENOUGH
    texture = max(_robust_variance(beyond) - low, 25.0) if is_seen else Noise().texture
    return Noise(max(low - slope * level, 0.01), slope, texture)


def _robust_variance(residual):
    """From the median of sizes, for a normal distribution; grey levels squared."""
    return float((1.4826 * np.median(np.abs(residual))) ** 2)


def blur_matrices(side, blur_px2):
    """Matrices (n, side, side) that blur a row of pixels by a Gaussian; its weights at a border sum
    up to 1, too.
    """
    x = np.arange(side)
    weight = np.exp(-0.5 * (x[:, None] - x) ** 2 / blur_px2[:, None, None])
    return weight / weight.sum(axis=2, keepdims=True)


def blurred(B, stack):
    """Windows (k, m, p) blurred in both directions by their matrices (k, side, side)."""
    k, m, p = stack.shape
    side = B.shape[1]
    rows = (stack.reshape(k, m * side, side) @ B.transpose(0, 2, 1)).reshape(k, m, side, side)
    return np.matmul(B[:, None], rows).reshape(k, m, p)


def half_laplacian(grey, at):
    """Derivative of blurred windows (k, p) by the blur's variance, px^2: the heat equation."""
    window = grey.reshape(-1, *at.shape)
    middle = 2 * window[:, 1:-1, 1:-1]
    across = window[:, 1:-1, 2:] + window[:, 1:-1, :-2] - middle
    down = window[:, 2:, 1:-1] + window[:, :-2, 1:-1] - middle
    result = np.zeros_like(window)
    result[:, 1:-1, 1:-1] = (across / at.cell[0] ** 2 + down / at.cell[1] ** 2) / 2
    return result.reshape(grey.shape)


def linearise(state, here, rig, handle):
    """The model and its derivatives at a state, of a handle that is still."""
    shown = layers(rig, handle, state.T_world_handle, here.views, here.at)
    B = blur_matrices(here.at.shape[0], state.blur_px2)[here.views.camera]
    usable = here.valid & (shown.clear > CLEAR_PX) & _inner(here.at.shape[0])
    basis = shading_basis(shown.turn).transpose(1, 0, 2)
    lights = (blurred(B, share[:, None] * basis) for share in (shown.marker, shown.body))
    at = explained(state, here, usable, *lights)
    moves = blurred(B, by_grey_motion(shown, basis, at.greys))
    by_blur = half_laplacian(at.predicted, here.at)[:, None]
    return at._replace(by_pose=np.concatenate([moves, by_blur], axis=1))


def explained(state, here, usable, of_marker, of_body):
    """What the blurred lights of marker and body, at grey level 1 and for each function of
    `shading_basis`, shapes (k, 4, p), make of the windows with the greys of a state, or the best ones
    where it has none; `by_pose` is left empty.
    """
    behind = 1 - of_body[:, :1]
    greys = state.greys
    if greys is None:
        columns = np.concatenate([of_marker[:, :1], of_body, behind], axis=1)
        greys = _first_greys(columns, usable, here.grey)
    marker, body = greys[:, :1, None], greys[:, 1:2, None]
    shade, gloss = _shade(greys), _gloss(greys)
    by_gloss = of_body[:, 1:]
    shares = [shade @ of_marker, shade @ of_body]
    by_shade = marker * of_marker[:, 1:] + body * of_body[:, 1:]
    glossy = by_gloss[:, : gloss.shape[2]]
    by_greys = np.concatenate([*shares, by_shade, glossy, behind], axis=1)
    # the shading is a factor, of which the derivative is no part of the sum
    factors = np.concatenate([greys[:, :2], 0 * greys[:, 2:5], greys[:, 5:]], axis=1)
    predicted = (factors[:, None] @ by_greys)[:, 0]
    noise = state.noise
    variance = noise.base + noise.slope * np.maximum(predicted, 0)
    weight = usable * (here.at.pixels / (variance + noise.texture * behind[:, 0] ** 2))
    none = np.empty((len(greys), 0, predicted.shape[1]))
    residual, seen = here.grey - predicted, (of_marker[:, 0], of_body[:, 0])
    return Linear(greys, predicted, residual, weight, none, by_greys, by_gloss, *seen)


def unblurred(shown, basis, greys):
    """The grey levels before any blur, shape (k, p); `basis` (k, 4, p) is `shading_basis` there."""
    shading, sent_back = _lit(basis, greys)
    lit = greys[:, :1] * shown.marker + greys[:, 1:2] * shown.body
    return lit * shading + sent_back * shown.body + greys[:, -1:] * (1 - shown.body)


def by_grey_motion(shown, basis, greys):
    """Derivative of the unblurred grey levels by a motion of the handle (nu mm, omega rad), shape
    (k, 6, p); `basis` (k, 4, p) is `shading_basis` there.
    """
    shading, sent_back = _lit(basis, greys)
    marker = greys[:, :1] * shading
    body = greys[:, 1:2] * shading + sent_back - greys[:, -1:]
    F = marker * shown.marker_push
    G = (marker * shown.marker_by_body + body) * shown.body_push
    turn = np.cross(shown.marker_point, F, axis=0) + np.cross(shown.body_point, G, axis=0)
    return np.concatenate([F + G, turn]).transpose(1, 0, 2)


def _lit(basis, greys):
    """The shading, and the grey levels that gloss adds to marker and body, shapes (k, p)."""
    return (_shade(greys) @ basis)[:, 0], (
        _gloss(greys) @ basis[:, 1 : 1 + _gloss(greys).shape[2]]
    )[:, 0]


def _shade(greys):
    """The factors of `shading_basis`, shape (k, 1, 4)."""
    return np.concatenate([np.ones((len(greys), 1)), greys[:, 2:5]], axis=1)[:, None]


def _gloss(greys):
    """The factors of `shading_basis` but the first, in grey levels, shape (k, 1, 3); (k, 1, 0) where
    there is no gloss.
    """
    return greys[:, None, 5:-1]


def reduce(by_other, at):
    """Normal equations for unknowns with derivatives `by_other` (k, m, p), the greys of each window
    eliminated.
    """
    n = by_other.shape[1]
    every = np.concatenate([by_other, at.by_greys, at.residual[:, None]], axis=1, dtype=float)
    products = (every * at.weight[:, None]) @ every.transpose(0, 2, 1)
    CC, OC = products[:, n:-1, n:-1], products[:, :n, n:-1]
    size = np.trace(CC, axis1=1, axis2=2)[:, None, None]
    CC += (1e-9 * size + 1e-12) * np.eye(CC.shape[1])
    gain = np.linalg.solve(CC, products[:, n:-1, :n])
    greys = np.linalg.solve(CC, products[:, n:-1, -1:])[..., 0]
    gradient = products[:, :n, -1] - (OC @ greys[..., None])[..., 0]
    return Reduced(products[:, :n, :n] - OC @ gain, gradient, greys, gain)


def advanced(at, by_other, normal, step):
    """The model after a step (k, m) of the other unknowns, to first order; the greys follow."""
    greys = normal.greys - (normal.greys_by_other @ step[..., None])[..., 0]
    change = (step[:, None] @ by_other + greys[:, None] @ at.by_greys)[:, 0]
    return at._replace(
        greys=at.greys + greys, predicted=at.predicted + change, residual=at.residual - change
    )


def noise_of(at, pixels):
    """The noise of a pixel that a fit leaves in its windows, whose cells are means of so many."""
    residual = np.sqrt(pixels) * at.residual
    return estimate_noise(residual, at.predicted, at.weight > 0, at.marker, at.body)


def misfit(at):
    """Reduced chi-square of each window, shape (k,): about 1 where the window shows what the state
    predicts.
    """
    count = (at.weight > 0).sum(axis=1)
    return (at.weight * at.residual**2).sum(axis=1) / np.maximum(count - at.greys.shape[1], 1)


def _first_greys(C, usable, grey):
    """Greys (k, 6) by linear least squares, the marker's shading left out."""
    weighted = C * usable[:, None]
    CC = weighted @ C.transpose(0, 2, 1)
    CC += (1e-6 * np.trace(CC, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(CC.shape[1])
    greys = np.linalg.solve(CC, weighted @ grey[..., None])[..., 0]
    greys[:, 2:-1] = np.clip(greys[:, 2:-1] / np.maximum(np.abs(greys[:, 1:2]), 1.0), -1, 1)
    return greys


def _inner(side):
    """Pixels of a window that are not at its border, bool (p,)."""
    inside = np.minimum(np.arange(side), np.arange(side)[::-1]) >= BORDER_PX
    return (inside[:, None] & inside).ravel()


def linearise_moving(state, here, rig, handle):
    """The model and its derivatives at a state, of a handle that moves while the shutter is open."""
    # neighbours are smeared into each other
    shown = layers(rig, handle, state.T_world_handle, here.views, here.drawn, any_marker=True)
    basis = shading_basis(shown.turn).transpose(1, 0, 2)
    ways = here.ways_px(state.motion_blur.motion)
    spread = -2 * np.pi**2 * state.blur_px2[here.views.camera, None, None]

    def turn(f_u, f_v):
        return f_u * ways[:, :1, None] + f_v * ways[:, 1:, None]  # f . d, (k, rows, columns)

    def lens(f_u, f_v):
        return np.exp(spread * (f_u**2 + f_v**2))

    def smeared(f_u, f_v):
        return lens(f_u, f_v) * np.sinc(turn(f_u, f_v))

    def by_u(f_u, f_v):
        return lens(f_u, f_v) * slope_of_sinc(turn(f_u, f_v)) * f_u

    def by_v(f_u, f_v):
        return lens(f_u, f_v) * slope_of_sinc(turn(f_u, f_v)) * f_v

    def seen(stack, kernel):
        """Drawn windows (k, m, cells), or one for all m, after a filter."""
        whole = stack.reshape(*stack.shape[:2], *here.drawn.shape)
        spectrum = np.fft.fft2(whole) * even(kernel, *frequencies(here.drawn))[:, None]
        return middle(np.fft.ifft2(spectrum).real, here)

    reach = np.abs(ways).max(initial=0.0) / 2 / min(here.at.cell)
    clear = middle(shown.clear[:, None], here)[:, 0] > CLEAR_PX + reach
    lights = (seen(share[:, None] * basis, smeared) for share in (shown.marker, shown.body))
    at = explained(state, here, here.valid & clear, *lights)
    by_pose = seen(by_grey_motion(shown, basis, at.greys), smeared)
    grey = unblurred(shown, basis, at.greys)[:, None]
    by_ways = np.concatenate([seen(grey, by_u), seen(grey, by_v)], axis=1)
    by_exposure = here.by_motion.transpose(0, 2, 1) @ by_ways
    by_blur = half_laplacian(at.predicted, here.at)[:, None]
    every = [by_pose, in_handle(by_exposure, state), by_blur]
    return at._replace(by_pose=np.concatenate(every, axis=1))


def frequencies(at):
    """The frequencies of windows along u, (columns,), and along v, (rows, 1), cycles a pixel."""
    rows, columns = at.shape
    f_u = np.fft.fftfreq(columns, at.cell[0])
    f_v = np.fft.fftfreq(rows, at.cell[1])
    return f_u.astype(float), f_v[:, None].astype(float)


def slope_of_sinc(along):
    """Derivative of `numpy.sinc`: of the mean of ``exp(-2 pi i s along)`` over times s of the
    exposure from -1/2 to 1/2.
    """
    is_small = np.abs(along) < 1e-3
    safe = np.where(is_small, 1.0, along)
    slope = (np.cos(np.pi * safe) - np.sinc(safe)) / safe
    return np.where(is_small, -(np.pi**2) / 3 * along, slope)


def even(kernel_of, f_u, f_v):
    """The spectrum of a real kernel: the highest frequency of an even number of cells is its own
    opposite, and gets the mean of both.
    """
    other_u, other_v = (np.where(f == f.min(), -f, f) if f.size % 2 == 0 else f for f in (f_u, f_v))
    return sum(kernel_of(u, v) for u in (f_u, other_u) for v in (f_v, other_v)) / 4


def middle(drawn, here):
    """The windows' own part (k, m, p) of drawn windows (k, m, cells) or (k, m, rows, columns)."""
    rows, columns = here.at.shape
    k, m = drawn.shape[:2]
    whole = drawn.reshape(k, m, *here.drawn.shape)
    top = (whole.shape[2] - rows) // 2
    left = (whole.shape[3] - columns) // 2
    return whole[:, :, top : top + rows, left : left + columns].reshape(k, m, rows * columns)
