"""`markers.markers_at` as a compiled loop over the places: what `blobs` and `markers.blob_at` do with
OpenCV, for one blob of a few hundred pixels at a time.

Compiled code does not detect an index out of bounds: the tests run the loop with bounds checked.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from .blobs import RAYS, RING_PX

# a blob as `blob` writes it
U, V, MAJOR, MINOR, CONTRAST, THRESHOLD, LEVEL = range(7)
FAR = 99  # px, further away than the ring

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def measure(image, uv, reach, limits, table):
    """Measure the blobs at places.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Bright markers.
    uv : ndarray, shape (n, 2)
    reach : float
        px.
    limits : ndarray, shape (5,)
        Of `MarkerParameters`: the diameters, and the least axis ratio, fill and contrast.
    table : ndarray, shape (n, 6)
        Filled with the first six numbers of each blob; NaN where there is none.
    """
    height, width = image.shape
    blob_row = np.empty(7)
    for k in range(len(uv)):
        table[k] = np.nan
        u = uv[k, 0]
        v = uv[k, 1]
        if not (-0.5 < u < width - 0.5 and -0.5 < v < height - 0.5):
            continue
        is_clear, halfway, second = thresholds(image, u, v, reach, limits[4])
        if not is_clear:
            continue
        if blob(image, u, v, reach, halfway, limits, blob_row) or blob(
            image, u, v, reach, second, limits, blob_row
        ):
            take_halfway(image, limits, blob_row)
            table[k] = blob_row[:6]


@_compiled
def thresholds(image, u, v, reach, min_contrast):
    """Whether rays from a place show some contrast, and two thresholds for what is there, the likelier
    one first; see `blobs.candidates`.
    """
    height, width = image.shape
    _, steps, rays = RAYS.shape
    inside = np.empty(rays)
    valley = np.empty(rays)
    for ray in range(rays):
        for step in range(steps):
            x = np.rint(np.float32(u) + RAYS[0, step, ray] * np.float32(reach))
            y = np.rint(np.float32(v) + RAYS[1, step, ray] * np.float32(reach))
            grey = float(image[int(min(max(y, 0), height - 1)), int(min(max(x, 0), width - 1))])
            if step == 0:
                inside[ray] = grey
                valley[ray] = grey
            valley[ray] = min(valley[ray], grey)
    inside.sort()
    valley.sort()
    top = inside.mean()
    level = valley[7]
    saddle = valley[-1]
    peak = max(top, inside[-3])
    is_clear = peak - saddle >= min_contrast / 2 and top - level >= 0.8 * min_contrast
    halfway = max((level + peak) / 2, 0.75 * saddle + 0.25 * peak)
    return is_clear, halfway, 0.4 * saddle + 0.6 * peak


@_compiled
def take_halfway(image, limits, blob_row):
    """A blob with its contour about halfway up its flank if it is like a marker there, in place; see
    `markers.halfway`.
    """
    again = np.empty(7)
    for _ in range(2):
        halfway = blob_row[LEVEL] + blob_row[CONTRAST] / 2
        if abs(blob_row[THRESHOLD] - halfway) > blob_row[CONTRAST] / 5 and blob(
            image, blob_row[U], blob_row[V], blob_row[MAJOR], halfway, limits, again
        ):
            blob_row[:] = again


@_compiled
def blob(image, u, v, reach, threshold, limits, blob_row):
    """Whether what exceeds a threshold at a place is like a marker; `blob_row` (7,) is filled if it is.
    See `markers.blob_at`.
    """
    least = limits[0]
    most = limits[1]
    min_axis_ratio = limits[2]
    min_fill = limits[3]
    min_contrast = limits[4]
    # the part of the image that it may be in
    margin = int(reach) + RING_PX + 1
    u = round(u)
    v = round(v)
    left = max(u - margin, 0)
    top = max(v - margin, 0)
    grey = image[top : v + margin + 1, left : u + margin + 1]
    height, width = grey.shape
    away = np.full((height, width), FAR, np.int8)  # from the blob; 0 inside it
    members = np.empty((height * width, 2), np.int64)
    count = fill_at(grey, threshold, u - left, v - top, max(int(reach / 4), 1), away, members)
    if count == 0:
        return False
    us = members[:count, 0]
    vs = members[:count, 1]
    first_u, last_u, first_v, last_v = us.min(), us.max(), vs.min(), vs.max()
    if first_u == 0 or first_v == 0 or last_u == width - 1 or last_v == height - 1:
        return False
    major, minor = axes(us, vs)
    is_round = minor >= min_axis_ratio * major and count >= min_fill * np.pi / 4 * major * minor
    if not (least <= major <= most and is_round):
        return False
    light = 0.0
    for i in range(count):
        light += grey[vs[i], us[i]]
        widen(away, us[i], vs[i])
    level, total, by_u, by_v = surroundings(grey, threshold, away, first_u, last_u, first_v, last_v)
    contrast = light / count - level
    if contrast < min_contrast or total == 0:
        return False
    blob_row[U] = left + by_u / total
    blob_row[V] = top + by_v / total
    blob_row[MAJOR] = major
    blob_row[MINOR] = minor
    blob_row[CONTRAST] = contrast
    blob_row[THRESHOLD] = threshold
    blob_row[LEVEL] = level
    return True


@_compiled
def surroundings(grey, threshold, away, first_u, last_u, first_v, last_v):
    """The median grey of the ring around a blob, infinity where there is none, and the sums of
    light above it up to the ring: of the light, of light times u and of light times v. The light of
    other blobs is ignored.
    """
    height, width = grey.shape
    rows = range(max(first_v - RING_PX, 0), min(last_v + RING_PX + 1, height))
    columns = range(max(first_u - RING_PX, 0), min(last_u + RING_PX + 1, width))
    ring = np.empty(len(rows) * len(columns))
    n = 0
    for y in rows:
        for x in columns:
            if away[y, x] == RING_PX and grey[y, x] <= threshold:
                ring[n] = grey[y, x]
                n += 1
    if n == 0:
        return np.inf, 0.0, 0.0, 0.0
    ring[:n].sort()
    level = ring[n // 2]
    total = by_u = by_v = 0.0
    for y in rows:
        for x in columns:
            if away[y, x] == 0 or (away[y, x] < RING_PX and grey[y, x] <= threshold):
                light = max(grey[y, x] - level, 0.0)
                total += light
                by_u += light * x
                by_v += light * y
    return level, total, by_u, by_v


@_compiled
def fill_at(grey, threshold, u, v, near, away, members):
    """Fill the blob at a place; where that is dark, the blob of which most lies within `near` px, of
    several the first as OpenCV numbers them, by blocks of 2 x 2. Returns how many pixels it has, see
    `fill`.
    """
    if grey[v, u] > threshold:
        return fill(grey, threshold, u, v, away, members)
    height, width = grey.shape
    rows = range(max(v - near, 0), min(v + near + 1, height))
    columns = range(max(u - near, 0), min(u + near + 1, width))
    most = first = 0
    best_u = best_v = -1
    for y in rows:
        for x in columns:
            if grey[y, x] > threshold and away[y, x] != 0:
                count = fill(grey, threshold, x, y, away, members)
                inside = 0
                block = height * width
                for i in range(count):
                    inside += abs(members[i, 0] - u) <= near and abs(members[i, 1] - v) <= near
                    block = min(block, members[i, 1] // 2 * width + members[i, 0] // 2)
                if inside > most or (inside == most and block < first):
                    most = inside
                    first = block
                    best_u = x
                    best_v = y
    if most == 0:
        return 0
    away[:] = FAR
    return fill(grey, threshold, best_u, best_v, away, members)


@_compiled
def fill(grey, threshold, u, v, away, members):
    """Fill the 8-connected blob of what exceeds a threshold from one of its pixels: `away` becomes 0
    there. Its pixels (u, v) are written into `members`; returns how many there are.
    """
    height, width = grey.shape
    away[v, u] = 0
    members[0, 0] = u
    members[0, 1] = v
    count = 1
    done = 0
    while done < count:
        u = members[done, 0]
        v = members[done, 1]
        done += 1
        for y in range(max(v - 1, 0), min(v + 2, height)):
            for x in range(max(u - 1, 0), min(u + 2, width)):
                if away[y, x] != 0 and grey[y, x] > threshold:
                    away[y, x] = 0
                    members[count, 0] = x
                    members[count, 1] = y
                    count += 1
    return count


@_compiled
def axes(us, vs):
    """Major and minor axis of the ellipse with the pixels' second moments; see `blobs.ellipse`."""
    u = us.mean()
    v = vs.mean()
    uu = vv = uv = 0.0
    for i in range(len(us)):
        du = us[i] - u
        dv = vs[i] - v
        uu += du * du
        vv += dv * dv
        uv += du * dv
    mean = (uu + vv) / 2
    half = math.hypot((uu - vv) / 2, uv)
    major = (mean + half) / len(us) + 1 / 12
    minor = (mean - half) / len(us) + 1 / 12
    return 4 * math.sqrt(major), 4 * math.sqrt(max(minor, 1 / 12))


@_compiled
def widen(away, u, v):
    """Lower the distances, as a chessboard has them, of the pixels around one of a blob's outermost
    pixels.
    """
    if not (away[v, u - 1] or away[v, u + 1] or away[v - 1, u] or away[v + 1, u]):
        return
    height, width = away.shape
    for y in range(max(v - RING_PX, 0), min(v + RING_PX + 1, height)):
        for x in range(max(u - RING_PX, 0), min(u + RING_PX + 1, width)):
            away[y, x] = min(away[y, x], max(abs(y - v), abs(x - u)))
