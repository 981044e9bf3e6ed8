"""The image model of `imagemodel` as compiled loops over the cells of each window.

A loop draws a window's layers, blurs them, and computes the terms of the normal equations, while
all of it is in the processor's cache. Arrays have one row per quantity and one column per cell;
`rows` names the rows. A cell is a pixel, or a block of pixels that its mean represents.

After a small motion of the handle (nu mm, omega rad, handle frame) the point X of a ray lies, seen
from the handle, at X - nu - omega x X. With the gradient g of a distance there, that distance
changes by -g.nu - (X x g).omega.

Compiled code does not detect an index out of bounds: the tests run each loop with bounds checked.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from .rows import (
    BLUR,
    BODY,
    BODY_MOTION,
    BODY_SHARE,
    CLEARANCE,
    GLOSS,
    GREYS,
    LAYERS,
    MARKER,
    MARKER_MOTION,
    MARKER_SHARE,
    POSE,
    PREDICTED,
    RESIDUAL,
    SINE,
    VERSINE,
    WEIGHT,
)

# cosine of ray and normal: a surface that is turned away further counts as this oblique
GRAZING = 0.05
BLOCK = 16  # cells that are drawn together, so that the compiler computes several at a time

# the arctangent on [-1, 1] as an odd polynomial: 2e-9 rad
_NODES = np.cos(np.pi * (np.arange(400) + 0.5) / 400)
_POWERS = np.stack([_NODES ** (2 * k) for k in range(12)], axis=1)
ARCTANGENT = tuple(np.linalg.lstsq(_POWERS, np.arctan(_NODES) / _NODES, rcond=None)[0].tolist())

# sums may be taken in another order; no other licence
_reordered = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "nsz", "contract"}
)
_inlined = numba.njit(inline="always")


@_inlined
def angle(sine, cosine):
    """An angle by its sine and cosine, rad, to 4e-9: twice the arctangent of sine / (1 + cosine)."""
    across = abs(sine)
    along = 1.0 + cosine
    beyond = across > along  # a right angle
    t = (along if beyond else across) / max(across, along)
    q = t * t
    total = ARCTANGENT[11]
    for k in range(10, -1, -1):
        total = total * q + ARCTANGENT[k]
    half = math.pi / 2 - t * total if beyond else t * total
    return 2 * half if sine > 0 else -2 * half


@_inlined
def edge(inside, by_u, by_v):
    """The share of a cell's area on the inner side of a straight edge, how fast it grows with
    `inside` (1/mm), and the width of the cell, mm: the integral of a trapezoid.
    """
    long = max(max(by_u, by_v), 1e-6)
    short = max(min(by_u, by_v), 1e-6)
    away = abs(inside)
    remainder = max((long + short) / 2 - away, 0.0)  # to where the edge leaves the cell
    cuts_corner = remainder < short
    outer = remainder * remainder / (2 * long * short) if cuts_corner else 0.5 - away / long
    rate = (remainder / short if cuts_corner else 1.0) / long
    share = 1 - outer if inside > 0 else outer
    return share, rate, math.sqrt(long * long + short * short)


@_reordered
def draw(x, y, R, start, by_u, by_v, marker, others, body, any_marker, layers):
    """Draw the layers of one window.

    Parameters
    ----------
    x, y : ndarray, shape (p,)
        Normalised ideal coordinates of the cells.
    R : ndarray, shape (3, 3)
        From the camera's frame to the handle's.
    start : ndarray, shape (3,)
        The camera's centre in the handle's frame, mm.
    by_u, by_v : ndarray, shape (3,)
        Derivatives of the ray's direction by a cell along u and along v, handle frame.
    marker : ndarray, shape (4,)
        Cosine and sine of its angle about the axis, axial coordinate and distance from the axis, mm.
    others : ndarray, shape (2, 3)
        Cosine, sine and axial coordinate of its two neighbours.
    body : ndarray, shape (4,)
        Radius, top, bottom, and a marker's radius, mm.
    any_marker : bool
        Whether the neighbours count as markers like this one, and not as obstacles.
    layers : ndarray, shape (LAYERS, p)
        Filled.
    """
    radius, top, bottom, rim = body
    cos_0, sin_0, axial_0, r = marker
    cos_1, sin_1, axial_1 = others[0, 0], others[0, 1], others[0, 2]
    cos_2, sin_2, axial_2 = others[1, 0], others[1, 1], others[1, 2]
    ox, oy, oz = start[0], start[1], start[2]
    ux, uy, uz = by_u[0], by_u[1], by_u[2]
    vx, vy, vz = by_v[0], by_v[1], by_v[2]
    R00, R01, R02 = R[0, 0], R[0, 1], R[0, 2]
    R10, R11, R12 = R[1, 0], R[1, 1], R[1, 2]
    R20, R21, R22 = R[2, 0], R[2, 1], R[2, 2]
    block = np.empty(LAYERS * BLOCK)
    xs = np.zeros(BLOCK)
    ys = np.zeros(BLOCK)
    for first in range(0, x.size, BLOCK):
        count = min(BLOCK, x.size - first)
        for i in range(count):
            xs[i] = x[first + i]
            ys[i] = y[first + i]
        for i in range(BLOCK):
            # the ray, and where it passes the axis nearest by
            dx = R00 * xs[i] + R01 * ys[i] + R02
            dy = R10 * xs[i] + R11 * ys[i] + R12
            dz = R20 * xs[i] + R21 * ys[i] + R22
            flat = dx * dx + dz * dz
            depth = -(ox * dx + oz * dz) / flat
            px = ox + depth * dx
            py = oy + depth * dy
            pz = oz + depth * dz
            distance = max(math.sqrt(px * px + pz * pz), 1e-6)
            nx = px / distance
            nz = pz / distance
            along_u = abs(depth * (nx * ux + nz * uz))
            along_v = abs(depth * (nx * vx + nz * vz))
            body_share, body_rate, width = edge(radius - distance, along_u, along_v)
            # a cell that the outline cuts shows another part of the surface than its middle's ray meets
            inside = r - distance
            in_cut_cell = min(max((inside + width / 2) / 2, 0.0), r)
            within = inside if inside > width / 2 else in_cut_cell
            half = math.sqrt(within * (2 * r - within) / flat)
            X = px - half * dx
            Y = py - half * dy
            Z = pz - half * dz
            depth -= half
            per_radius = 1 / math.sqrt(X * X + Z * Z)
            mx = X * per_radius
            mz = Z * per_radius
            # the place beside each of three markers
            sine = mx * cos_0 - mz * sin_0
            cosine = mz * cos_0 + mx * sin_0
            turn = angle(sine, cosine)
            along = Y - axial_0
            away = max(math.sqrt(r * r * turn * turn + along * along), 1e-9)
            turn_1 = angle(mx * cos_1 - mz * sin_1, mz * cos_1 + mx * sin_1)
            along_1 = Y - axial_1
            away_1 = max(math.sqrt(r * r * turn_1 * turn_1 + along_1 * along_1), 1e-9)
            turn_2 = angle(mx * cos_2 - mz * sin_2, mz * cos_2 + mx * sin_2)
            along_2 = Y - axial_2
            away_2 = max(math.sqrt(r * r * turn_2 * turn_2 + along_2 * along_2), 1e-9)
            clearance = min(top - Y, Y - bottom)
            if any_marker:
                nearer = away_1 < away
                turn = turn_1 if nearer else turn
                along = along_1 if nearer else along
                away = away_1 if nearer else away
                nearer = away_2 < away
                turn = turn_2 if nearer else turn
                along = along_2 if nearer else along
                away = away_2 if nearer else away
            else:
                clearance = min(clearance, min(away_1, away_2) - rim)
            # the marker's edge: its gradient as the ray's point slides along the surface
            gx = -turn * Z / away
            gy = -along / away
            gz = turn * X / away
            facing = min(mx * dx + mz * dz, -GRAZING)
            slide = (gx * dx + gy * dy + gz * dz) / facing
            gx -= mx * slide
            gz -= mz * slide
            along_u = abs(depth * (gx * ux + gy * uy + gz * uz))
            along_v = abs(depth * (gx * vx + gy * vy + gz * vz))
            covered, marker_rate, width = edge(rim - away, along_u, along_v)
            rate = -body_share * marker_rate
            Fx = rate * gx
            Fy = rate * gy
            Fz = rate * gz
            Gx = body_rate * nx
            Gz = body_rate * nz
            block[MARKER_SHARE * BLOCK + i] = covered * body_share
            block[BODY_SHARE * BLOCK + i] = body_share
            block[SINE * BLOCK + i] = sine
            block[VERSINE * BLOCK + i] = 1 - cosine
            block[CLEARANCE * BLOCK + i] = clearance / width
            block[(MARKER_MOTION + 0) * BLOCK + i] = Fx + covered * Gx
            block[(MARKER_MOTION + 1) * BLOCK + i] = Fy
            block[(MARKER_MOTION + 2) * BLOCK + i] = Fz + covered * Gz
            block[(MARKER_MOTION + 3) * BLOCK + i] = Y * Fz - Z * Fy + covered * (py * Gz)
            block[(MARKER_MOTION + 4) * BLOCK + i] = Z * Fx - X * Fz + covered * (pz * Gx - px * Gz)
            block[(MARKER_MOTION + 5) * BLOCK + i] = X * Fy - Y * Fx - covered * (py * Gx)
            block[(BODY_MOTION + 0) * BLOCK + i] = Gx
            block[(BODY_MOTION + 1) * BLOCK + i] = 0.0
            block[(BODY_MOTION + 2) * BLOCK + i] = Gz
            block[(BODY_MOTION + 3) * BLOCK + i] = py * Gz
            block[(BODY_MOTION + 4) * BLOCK + i] = pz * Gx - px * Gz
            block[(BODY_MOTION + 5) * BLOCK + i] = -py * Gx
        for row in range(LAYERS):
            to = layers[row, first : first + count]
            part = block[row * BLOCK : row * BLOCK + count]
            for i in range(count):
                to[i] = part[i]


@_reordered
def add_pairs(of, taps, start, apart, total):
    """Add to `total` (m,) what symmetric taps (2 r + 1,) beside the middle one make of a flat
    array, in which the middle one begins at `start` and each next one `apart` further. It takes two
    taps at a time, because reading and writing `total` dominates the time.
    """
    m = total.size
    reach = taps.size // 2
    for t in range(1, reach, 2):
        near, far = taps[reach - t], taps[reach - t - 1]
        a = of[start - t * apart : start - t * apart + m]
        b = of[start + t * apart : start + t * apart + m]
        c = of[start - (t + 1) * apart : start - (t + 1) * apart + m]
        d = of[start + (t + 1) * apart : start + (t + 1) * apart + m]
        for i in range(m):
            total[i] += near * (a[i] + b[i]) + far * (c[i] + d[i])
    if reach % 2:
        last = taps[0]
        a = of[start - reach * apart : start - reach * apart + m]
        b = of[start + reach * apart : start + reach * apart + m]
        for i in range(m):
            total[i] += last * (a[i] + b[i])


@_reordered
def blur(stack, taps, norm, line, between, total, blurred):
    """Blur square windows (n, side, side) along both directions by symmetric taps (2 r + 1,).

    The factors `norm` (side,) make up for the taps that are missing at a border. The windows lie
    side by side with zeros between them, so that one loop goes over a row of all. `line` (n * width
    + 2 r,) and `between` (side + 2 r, n * width), zero at first, and `total` (n * width,) are room,
    width being side + 2 r; all may be larger.
    """
    n, side, _ = stack.shape
    reach = taps.size // 2
    width = side + 2 * reach
    length = n * width
    middle = taps[reach]
    before = (between.shape[0] - side) // 2  # rows that stay zero
    flat = between.ravel()
    for v in range(side):
        for j in range(n):
            to = line[j * width + reach : j * width + reach + side]
            of = stack[j, v]
            for u in range(side):
                to[u] = of[u]
        to = between[before + v, :length]
        centre = line[reach : reach + length]
        for i in range(length):
            to[i] = middle * centre[i]
        add_pairs(line, taps, reach, 1, to)
    sums = total[:length]
    for v in range(side):
        of = between[before + v, :length]
        for i in range(length):
            sums[i] = middle * of[i]
        add_pairs(flat, taps, (before + v) * between.shape[1], between.shape[1], sums)
        for j in range(n):
            to = blurred[j, v]
            of = sums[j * width : j * width + side]
            for u in range(side):
                to[u] = of[u] * (norm[v] * norm[u])


@_reordered
def border_factors(taps, size, factors):
    """The factors (size,) with which taps at the borders of a row of cells sum up to 1."""
    reach = taps.size // 2
    for place in range(size):
        total = 0.0
        for t in range(taps.size):
            if 0 <= place + t - reach < size:
                total += taps[t]
        factors[place] = 1 / total


@_reordered
def light(layers, lights):
    """Light from marker and body in each cell at grey level 1 for each function of the shading, (8,
    p): the marker's four, then the body's; see `appearance.shading_basis`.
    """
    sine = layers[SINE]
    versine = layers[VERSINE]
    for j in range(2):
        share = layers[j]
        for i in range(share.size):
            lights[4 * j, i] = share[i]
            lights[4 * j + 1, i] = share[i] * sine[i]
            lights[4 * j + 2, i] = share[i] * versine[i]
            lights[4 * j + 3, i] = share[i] * sine[i] * versine[i]


@_reordered
def light_motion(layers, greys, axis, by_motion):
    """The derivative (p,) of the unblurred grey levels by one of the six motions of the handle."""
    has_gloss = greys.size == 9
    e0 = greys[5] if has_gloss else 0.0
    e1 = greys[6] if has_gloss else 0.0
    e2 = greys[7] if has_gloss else 0.0
    marker, of_body, background = greys[0], greys[1], greys[greys.size - 1]
    s0, s1, s2 = greys[2], greys[3], greys[4]
    sine = layers[SINE]
    versine = layers[VERSINE]
    marker_motion = layers[MARKER_MOTION + axis]
    body_motion = layers[BODY_MOTION + axis]
    for i in range(by_motion.size):
        s = sine[i]
        c = versine[i]
        shading = 1 + s0 * s + s1 * c + s2 * s * c
        sent_back = e0 * s + e1 * c + e2 * s * c
        by_motion[i] = (
            marker * shading * marker_motion[i]
            + (of_body * shading + sent_back - background) * body_motion[i]
        )


@_reordered
def first_greys(lights, usable, grey, columns, greys):
    """The greys (6,) of a window by linear least squares, the marker's shading left out; `columns`
    (7, p) is room.
    """
    p = grey.size
    for i in range(p):
        columns[0, i] = lights[0, i]
        for j in range(4):
            columns[1 + j, i] = lights[4 + j, i]
        columns[5, i] = 1 - lights[4, i]
        columns[6, i] = grey[i]
    products = np.empty((7, 7))
    weighted_products(columns, usable, np.arange(7), products)
    trace = 0.0
    for j in range(6):
        trace += products[j, j]
    right = np.empty((6, 1))
    for j in range(6):
        right[j, 0] = products[j, 6]
        products[j, j] += 1e-6 * trace + 1e-12
    solve(products, right, 6)
    level = max(abs(right[1, 0]), 1.0)
    greys[0] = right[0, 0]
    greys[1] = right[1, 0]
    for j in range(2, 5):
        greys[j] = min(max(right[j, 0] / level, -1.0), 1.0)
    greys[5] = right[5, 0]


@_reordered
def explain(lights, grey, usable, greys, noise, pixels, model):
    """Fill the rows GREYS to BODY of a window's model (MODEL, p) from its blurred lights (8, p)."""
    n = greys.size
    marker, of_body, background = greys[0], greys[1], greys[n - 1]
    s0, s1, s2 = greys[2], greys[3], greys[4]
    e0 = greys[5] if n == 9 else 0.0
    e1 = greys[6] if n == 9 else 0.0
    e2 = greys[7] if n == 9 else 0.0
    for i in range(grey.size):
        b = lights[4, i]
        m_shaded = lights[0, i] + s0 * lights[1, i] + s1 * lights[2, i] + s2 * lights[3, i]
        b_shaded = b + s0 * lights[5, i] + s1 * lights[6, i] + s2 * lights[7, i]
        sent_back = e0 * lights[5, i] + e1 * lights[6, i] + e2 * lights[7, i]
        predicted = marker * m_shaded + of_body * b_shaded + sent_back + background * (1 - b)
        variance = noise[0] + noise[1] * max(predicted, 0.0) + noise[2] * (1 - b) * (1 - b)
        model[GREYS, i] = m_shaded
        model[GREYS + 1, i] = b_shaded
        model[GREYS + 2, i] = marker * lights[1, i] + of_body * lights[5, i]
        model[GREYS + 3, i] = marker * lights[2, i] + of_body * lights[6, i]
        model[GREYS + 4, i] = marker * lights[3, i] + of_body * lights[7, i]
        model[GLOSS, i] = lights[5, i]
        model[GLOSS + 1, i] = lights[6, i]
        model[GLOSS + 2, i] = lights[7, i]
        model[PREDICTED, i] = predicted
        model[RESIDUAL, i] = grey[i] - predicted
        model[WEIGHT, i] = usable[i] * pixels / variance
        model[MARKER, i] = lights[0, i]
        model[BODY, i] = b
    if n == 9:
        model[GREYS + 5 : GREYS + 8] = model[GLOSS : GLOSS + 3]
    model[GREYS + n - 1] = 1 - model[BODY]


@_reordered
def half_laplacian(grey, cell_u, cell_v, by_blur):
    """Derivative (rows, columns) of a blurred window by the blur's variance, px^-2: the heat
    equation. It is zero at the window's border.
    """
    rows, columns = grey.shape
    by_blur[:] = 0.0
    for v in range(1, rows - 1):
        for u in range(1, columns - 1):
            across = grey[v, u + 1] + grey[v, u - 1] - 2 * grey[v, u]
            down = grey[v + 1, u] + grey[v - 1, u] - 2 * grey[v, u]
            by_blur[v, u] = (across / (cell_u * cell_u) + down / (cell_v * cell_v)) / 2


@_reordered
def linearise(xy, R, start, by_u, by_v, marker, others, body, side, taps, reaches, camera,
              grey, valid, border, clear_px, greys, known, noise, pixels, model):  # fmt: skip
    """The linear model of all windows of a handle that is still.

    Parameters
    ----------
    xy : ndarray, shape (2, k, p)
        Normalised ideal coordinates of the pixels; p = side * side.
    R, start, by_u, by_v, marker, others, body
        As in `draw`, one entry per window but for the body.
    taps : ndarray, shape (cameras, n)
        Weights of each camera's blur, of which the first 2 * reach + 1 count.
    reaches : ndarray of int, shape (cameras,)
    camera : ndarray of int, shape (k,)
    grey, valid : ndarray, shape (k, p)
        Grey levels, and whether a pixel is not saturated.
    border : int
        Pixels at a window's border that do not count.
    clear_px : float
        Pixels nearer than this to another marker or to the body's end do not count.
    greys : ndarray, shape (k, 6 or 9)
        Filled where they are not `known`.
    noise : ndarray, shape (3,)
        Base, slope and texture, see `imagemodel.Noise`.
    pixels : float
        How many pixels a cell has.
    model : ndarray, shape (k, MODEL, p)
        Filled, except for the rows EXPOSURE.
    """
    count, p = grey.shape
    layers = np.empty((LAYERS, p))
    lights = np.empty((8, p))
    blurred = np.empty((8, p))
    motions = np.empty((6, p))
    columns = np.empty((7, p))
    usable = np.empty(p)
    norm = np.empty(side)
    widest = 8 * (side + taps.shape[1])
    line = np.empty(widest + taps.shape[1])
    between = np.zeros((side + taps.shape[1], widest))
    total = np.empty(widest)
    for k in range(count):
        reach = reaches[camera[k]]
        own_taps = taps[camera[k], : 2 * reach + 1]
        border_factors(own_taps, side, norm)
        draw(
            xy[0, k],
            xy[1, k],
            R[k],
            start[k],
            by_u[k],
            by_v[k],
            marker[k],
            others[k],
            body,
            False,
            layers,
        )
        for i in range(p):
            v = i // side
            u = i % side
            inner = border <= v < side - border and border <= u < side - border
            usable[i] = 1.0 if inner and valid[k, i] and layers[CLEARANCE, i] > clear_px else 0.0
        light(layers, lights)
        line[:] = 0.0
        square = (side, side)
        blur(
            lights.reshape((8, side, side)),
            own_taps,
            norm,
            line,
            between,
            total,
            blurred.reshape((8, side, side)),
        )
        if not known:
            first_greys(blurred, usable, grey[k], columns, greys[k])
        explain(blurred, grey[k], usable, greys[k], noise, pixels, model[k])
        for axis in range(6):
            light_motion(layers, greys[k], axis, motions[axis])
        line[:] = 0.0
        blur(
            motions.reshape((6, side, side)),
            own_taps,
            norm,
            line,
            between,
            total,
            model[k, POSE : POSE + 6].reshape((6, side, side)),
        )
        by_blur = model[k, BLUR].reshape(square)
        half_laplacian(model[k, PREDICTED].reshape(square), 1.0, 1.0, by_blur)


@_reordered
def draw_all(xy, R, start, by_u, by_v, marker, others, body, any_marker, layers, lights):
    """The layers (k, LAYERS, p) and lights (k, 8, p) of all windows."""
    for k in range(layers.shape[0]):
        draw(xy[0, k], xy[1, k], R[k], start[k], by_u[k], by_v[k], marker[k], others[k], body,
             any_marker, layers[k])  # fmt: skip
        light(layers[k], lights[k])


@_reordered
def explain_all(lights, grey, usable, greys, known, noise, pixels, shape, cell, model):
    """As `linearise`, from blurred lights (k, 8, p) and without the rows POSE and EXPOSURE."""
    count, p = grey.shape
    columns = np.empty((7, p))
    for k in range(count):
        if not known:
            first_greys(lights[k], usable[k], grey[k], columns, greys[k])
        explain(lights[k], grey[k], usable[k], greys[k], noise, pixels, model[k])
        half_laplacian(model[k, PREDICTED].reshape(shape), cell[0], cell[1],
                       model[k, BLUR].reshape(shape))  # fmt: skip


@_reordered
def move_all(layers, greys, by_motion, grey):
    """The derivatives (k, 6, p) of the unblurred grey levels by a motion of the handle, and these
    levels (k, p).
    """
    for k in range(layers.shape[0]):
        for axis in range(6):
            light_motion(layers[k], greys[k], axis, by_motion[k, axis])
        has_gloss = greys.shape[1] == 9
        for i in range(grey.shape[1]):
            s = layers[k, SINE, i]
            c = layers[k, VERSINE, i]
            b = layers[k, BODY_SHARE, i]
            shading = 1 + greys[k, 2] * s + greys[k, 3] * c + greys[k, 4] * s * c
            lit = greys[k, 0] * layers[k, MARKER_SHARE, i] + greys[k, 1] * b
            sent_back = 0.0
            if has_gloss:
                sent_back = greys[k, 5] * s + greys[k, 6] * c + greys[k, 7] * s * c
            background = greys[k, greys.shape[1] - 1]
            grey[k, i] = lit * shading + sent_back * b + background * (1 - b)


@_reordered
def smear_kernels(f_u, f_v, ways, lens_u, lens_v, mean, by_u, by_v):
    """Fill the spectra (k, rows, columns // 2 + 1) of the kernels of a smear and a lens's blur, and
    their derivatives by the way along u and along v.

    A way d attenuates a frequency f by sinc(f . d). `f_u` (columns // 2 + 1,) and `f_v` (rows,) are
    those of `scipy.fft.rfft2`, `lens_u` and `lens_v` (k, ...) their attenuation by the blur. The
    highest frequency of an even number of rows is its own opposite: it gets the mean of both.
    """
    rows = f_v.size
    for k in range(ways.shape[0]):
        for r in range(rows):
            signs = 2 if rows % 2 == 0 and r == rows // 2 else 1
            for c in range(f_u.size):
                left = 0.0
                slope_u = 0.0
                slope_v = 0.0
                for n in range(signs):
                    v = f_v[r] if n == 0 else -f_v[r]
                    turn = f_u[c] * ways[k, 0] + v * ways[k, 1]
                    if abs(turn) < 1e-3:
                        share = 1 - (math.pi * turn) ** 2 / 6
                        slope = -(math.pi**2) / 3 * turn
                    else:
                        share = math.sin(math.pi * turn) / (math.pi * turn)
                        slope = (math.cos(math.pi * turn) - share) / turn
                    left += share
                    slope_u += slope * f_u[c]
                    slope_v += slope * v
                lens = lens_u[k, c] * lens_v[k, r] / signs
                mean[k, r, c] = lens * left
                by_u[k, r, c] = lens * slope_u
                by_v[k, r, c] = lens * slope_v


# normal equations


@_reordered
def solve(A, b, n):
    """Solve a symmetric positive system in place by Cholesky's method: A (n, n), b (n, m)."""
    for j in range(n):
        for k in range(j):
            for i in range(j, n):
                A[i, j] -= A[i, k] * A[j, k]
        root = math.sqrt(max(A[j, j], 1e-300))
        for i in range(j, n):
            A[i, j] /= root
    for m in range(b.shape[1]):
        for i in range(n):
            for k in range(i):
                b[i, m] -= A[i, k] * b[k, m]
            b[i, m] /= A[i, i]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                b[i, m] -= A[k, i] * b[k, m]
            b[i, m] /= A[i, i]


@_reordered
def weighted_products(model, weight, rows, products):
    """The weighted products (n, n) of some rows (n,) of a model with each other."""
    weighted = np.empty(weight.size)
    for a in range(rows.size):
        one = model[rows[a]]
        for i in range(weight.size):
            weighted[i] = weight[i] * one[i]
        for b in range(a + 1):
            other = model[rows[b]]
            total = 0.0
            for i in range(weight.size):
                total += weighted[i] * other[i]
            products[a, b] = total
            products[b, a] = total


@_reordered
def reduce(model, rows, n, information, gradient, greys, greys_by_other):
    """The normal equations of each window with its greys eliminated (Schur complement), see
    `imagemodel.Reduced`.

    The rows are those of the `n` other unknowns, of the greys, and of the residual.
    """
    m = rows.size
    count = m - 1 - n  # greys
    products = np.empty((m, m))
    of_greys = np.empty((count, count))
    right = np.empty((count, n + 1))
    for k in range(model.shape[0]):
        weighted_products(model[k], model[k, WEIGHT], rows, products)
        trace = 0.0
        for j in range(count):
            trace += products[n + j, n + j]
        for i in range(count):
            for j in range(count):
                of_greys[i, j] = products[n + i, n + j]
            of_greys[i, i] += 1e-9 * trace + 1e-12
            for j in range(n):
                right[i, j] = products[n + i, j]
            right[i, n] = products[n + i, m - 1]
        solve(of_greys, right, count)
        for i in range(n):
            total = products[i, m - 1]
            for j in range(count):
                total -= products[i, n + j] * right[j, n]
            gradient[k, i] = total
            for j in range(n):
                total = products[i, j]
                for g in range(count):
                    total -= products[i, n + g] * right[g, j]
                information[k, i, j] = total
        for g in range(count):
            greys[k, g] = right[g, n]
            for j in range(n):
                greys_by_other[k, g, j] = right[g, j]


@_reordered
def advance(model, rows, n, step, greys_step, greys_by_other, greys):
    """Take a step (k, n) of the other unknowns in each window, to first order: the greys follow, and
    with them the rows PREDICTED and RESIDUAL.
    """
    count = greys.shape[1]
    change = np.empty(n + count)
    for k in range(model.shape[0]):
        for j in range(n):
            change[j] = step[k, j]
        for g in range(count):
            total = greys_step[k, g]
            for j in range(n):
                total -= greys_by_other[k, g, j] * step[k, j]
            change[n + g] = total
            greys[k, g] += total
        residual = model[k, RESIDUAL]
        predicted = model[k, PREDICTED]
        for j in range(n + count):
            row = model[k, rows[j]]
            amount = change[j]
            for i in range(residual.size):
                residual[i] -= amount * row[i]
                predicted[i] += amount * row[i]


@_reordered
def tally(model, sums):
    """Sums over each window (k, 4): chi-square, number of pixels that count, sum of squares of
    their residuals, and the largest weight.
    """
    for k in range(model.shape[0]):
        weight = model[k, WEIGHT]
        residual = model[k, RESIDUAL]
        chi_square = 0.0
        count = 0.0
        squares = 0.0
        heaviest = 0.0
        for i in range(weight.size):
            square = residual[i] * residual[i]
            used = 1.0 if weight[i] > 0 else 0.0
            chi_square += weight[i] * square
            count += used
            squares += used * square
            heaviest = max(heaviest, weight[i])
        sums[k, 0] = chi_square
        sums[k, 1] = count
        sums[k, 2] = squares
        sums[k, 3] = heaviest


@_reordered
def residuals_by_layer(model, used, scale, dark, bright, beyond):
    """Sizes of residuals on the body, on markers and beyond the body, away from all edges, in the
    windows that are `used` (k,), times `scale`; their numbers, and the mean grey level predicted on
    the body and on markers.
    """
    darks = 0
    brights = 0
    beyonds = 0
    level = 0.0
    higher = 0.0
    for k in range(model.shape[0]):
        if not used[k]:
            continue
        marker, body, weight = model[k, MARKER], model[k, BODY], model[k, WEIGHT]
        residual, predicted = model[k, RESIDUAL], model[k, PREDICTED]
        for i in range(weight.size):
            if weight[i] <= 0:
                continue
            size = abs(residual[i]) * scale
            if body[i] > 0.99 and marker[i] < 0.01:
                dark[darks] = size
                level += predicted[i]
                darks += 1
            elif body[i] > 0.99 and marker[i] > 0.99:
                bright[brights] = size
                higher += predicted[i]
                brights += 1
            elif body[i] < 0.05:
                beyond[beyonds] = size
                beyonds += 1
    return darks, brights, beyonds, level / max(darks, 1), higher / max(brights, 1)
