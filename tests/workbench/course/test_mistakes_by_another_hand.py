"""The usual mistakes, written a second time from what is said of them: by other algorithms, with other
names, as students write. Each has to be recognised in this form as well.
"""

import math

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from workbench.course.child import outcome
from workbench.course.exercises import exercise
from workbench.course.grading import call_of, judge_outcomes


def skew(t):
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def seen_by_camera(p, pose, K, wh, slip):
    M = np.array(pose, float)
    if slip == "other way":
        M = np.linalg.inv(M)
    if slip == "transposed":
        M[:3, :3] = M[:3, :3].T.copy()
    q = (M @ np.append(p, 1.0))[:3]
    if q[2] <= 0 and slip != "behind":
        return False
    col = K[0, 0] * q[0] / q[2] + K[0, 2]
    row = K[1, 1] * q[1] / q[2] + K[1, 2]
    w, h = wh[::-1] if slip == "swapped" else wh
    if slip == "from zero":
        return 0 <= col <= w and 0 <= row <= h
    if slip == "centres":
        return 0 <= col <= w - 1 and 0 <= row <= h - 1
    return abs(col - (w - 1) / 2) <= w / 2 and abs(row - (h - 1) / 2) <= h / 2


def film(pictures, t, b0, m, slip):
    """By the weights of all pictures at once, from the last one back."""
    t = np.asarray(t, float)
    start = np.asarray(b0).astype(np.float64)
    if slip == "first frame" and len(pictures):
        start = pictures[0].astype(float)
    if slip == "black":
        start = start * 0
    gaps = t - np.concatenate([[0.0], t[:-1]]) if len(t) else t
    if slip == "start":
        gaps = t
    if slip == "one rate" and len(t):
        gaps = np.ones(len(t)) * t[-1] / len(t)
    kept = 1 - gaps / m if slip == "linear" else np.exp(-gaps / m)
    if slip == "swapped":
        kept = 1 - kept
    if slip == "whole":
        state = start
        for picture, k in zip(pictures, kept, strict=True):
            state = np.floor(k * state + (1 - k) * picture)
        return state
    total, share = np.zeros(start.shape), 1.0
    for picture, k in zip(pictures[::-1], kept[::-1], strict=True):
        total = total + share * (1 - k) * picture
        share = share * k
    return total + share * start


def two_ends(lamp, lamp_s, hand, hand_s, T, fps, slip):
    """By logarithms."""
    if slip == "frames":
        fps = 1
    if slip == "ends":
        lamp, lamp_s, hand, hand_s = hand, hand_s, lamp, lamp_s
    ends = []
    for jump, seconds in ((lamp, lamp_s), (hand, hand_s)):
        kept = math.exp(math.log(T / jump) / seconds / fps)
        if slip == "logarithm":
            kept = 1 + math.log(kept)
        if slip == "linear":
            kept = 1 - (jump - T) / jump / seconds / fps
        ends.append(kept)
    if ends[0] < ends[1] and slip != "none":
        return [math.nan, math.nan]
    return ends if slip == "left" else [1 - one for one in ends]


def one_number(zs, m, s2, q, r, slip):  # noqa: C901
    """By precisions."""
    out = []
    for z in zs:
        was = s2
        if slip not in ("after", "never"):
            s2 += q
        gate = 3 * math.sqrt(r if slip == "noise gate" else max(s2 + r, 0))
        if slip == "square":
            gate = math.sqrt(3 * max(s2 + r, 0))
        believed = bool(abs(z - m) < gate) or (slip == "no gate" and not math.isnan(z))
        if believed or (slip == "spoilt" and math.isnan(z)):
            k = s2 / (s2 + r)
            if slip == "noise":
                k = 1 - k
            if slip == "brackets":
                k = 1 + r
            m = (1 - k) * m + k * z
            if slip != "uncorrected":
                s2 = s2 * (1 - k)
        elif slip == "waits":
            s2 = was
        if slip == "after":
            s2 += q
        if believed or slip != "left out":
            out += [m]
    return out[-1] if slip == "last" else np.array(out)


def six_numbers(x, P, z, h, Q, R, slip):
    F = np.eye(6)
    if slip != "unpredicted":
        for k in range(4):
            F[k, k + 2] = h
        for k in range(2):
            F[k, k + 4] = h * h * (1 if slip == "half" else 0.5)
    xp = F.dot(x)
    Pp = F.dot(P).dot(F if slip == "untransposed" else F.T)
    if slip != "end":
        Pp = Pp + Q
    if np.any(np.isnan(z)):
        if slip == "nan":
            xp = xp * np.nan
            S = Pp[:2, :2] + R
            Pp = Pp - Pp[:, :2] @ np.linalg.inv(S) @ Pp[:2]
        return xp, Pp + (Q if slip == "end" else 0)
    S = Pp[:2, :2] + (0 if slip == "no R" else R)
    gain = np.linalg.solve(S.T, Pp[:, :2].T).T
    nu = z - xp[:2]
    if slip == "turned":
        nu = -nu
    old = P if slip == "old" else Pp
    return xp + gain @ nu, old - gain @ old[:2] + (Q if slip == "end" else 0)


def long_run(img, slip):
    """By SciPy's labels and a table of lengths."""
    img = np.array(img).astype(int)
    corners = np.ones((3, 3)) if slip != "corners" else None
    n = [
        ndimage.label(img >= t if slip == "as bright" else img > t, corners)[1]
        for t in range(img.max())
    ]
    if slip == "rest":
        n = [k + 1 for k in n]
    table = []
    for t, k in enumerate(n):
        if table and table[-1][2] == k:
            table[-1][1] = t
        else:
            table.append([t, t, k])
    if slip == "last run":
        table = table[:-1]
    if slip != "any count":
        table = [row for row in table if row[2] >= 4]
    if not table:
        return float("nan")
    if slip == "largest":
        top = max(k for *_, k in table)
        a, b, k = next(row for row in table if row[2] == top)
    else:
        length = max(b - a for a, b, _ in table)
        equals = [row for row in table if row[1] - row[0] == length]
        a, b, k = equals[-1 if slip == "last of equals" else 0]
    return {"beyond": (a + b + 1) / 2, "count": k, "length": b - a + 1}.get(slip, (a + b) / 2)


def line_of(Kl, Kr, turn, t, pixel, slip):
    """By two points of the ray, where nothing is wrong; else by the matrix that is meant."""
    l_inv, r_inv = np.linalg.inv(Kl), np.linalg.inv(Kr)
    if slip == "swapped":
        pixel = pixel[1], pixel[0]
    if slip == "other way":
        turn, t = turn.T, -turn.T.dot(t)
    E = skew(t) @ turn
    if slip == "exchanged":
        E = turn @ skew(t)
    F = (r_inv if slip == "inverse alone" else r_inv.T) @ E @ l_inv
    if slip == "transposed":
        F = F.T
    abc = F.dot([pixel[0], pixel[1], 1.0])
    if slip == "undivided":
        return abc
    if slip == "length":
        return abc / math.sqrt(sum(abc**2))
    if slip == "sign":
        abc = (r_inv.T @ skew(t).T @ turn @ l_inv).dot([pixel[0], pixel[1], 1.0])
    return abc / math.sqrt(abc[0] ** 2 + abc[1] ** 2)


def alike_at_best(clean, a, b, slip):
    """By moments."""
    clean = np.array(clean, float).ravel()
    s2 = (clean**2).mean() - (0 if slip == "brightness" else clean.mean() ** 2)
    if np.ptp(clean) == 0 and slip != "flat":
        return 0
    if np.ptp(clean) == 0:
        return math.nan
    va, vb = (a, b) if slip == "deviations" else (a * a, b * b)
    if slip == "left":
        vb = 0
    if slip == "mean":
        va = vb = (va + vb) / 2
    below = (s2 + va) * (s2 + vb)
    if slip != "root":
        below = below**0.5
    return (s2 + (a * b if slip == "common" else 0)) / below


def scatter(F, left, right, s, slip):
    """By differences of the distance itself."""
    if slip in ("right", "alike"):
        return s * (2**0.5 if slip == "alike" else 1)

    def distance(of_left, of_right):
        p, q = np.append(of_left, 1.0), np.append(of_right, 1.0)
        line = q @ F if slip == "left image" else F @ p
        other = p if slip == "left image" else q
        return line @ other / (1.0 if slip == "undivided" else np.hypot(line[0], line[1]))

    p, q, h = np.array(left, float), np.array(right, float), 1e-3
    by_left = [(distance(p + h * e, q) - distance(p - h * e, q)) / (2 * h) for e in np.eye(2)]
    by_right = [(distance(p, q + h * e) - distance(p, q - h * e)) / (2 * h) for e in np.eye(2)]
    if slip == "same":
        back, line = F @ np.append(q, 1.0), F @ np.append(p, 1.0)
        by_left = back[:2] / np.linalg.norm(line[:2])
    if slip == "added":
        return s * (np.linalg.norm(by_left) + np.linalg.norm(by_right))
    total = s * np.linalg.norm([*by_left, *by_right])
    return total**2 if slip == "variance" else total


def lens(Hs, wh, slip, px=True):
    """By the four entries of B in pixels, or in units of the image, from a null space."""
    unit = 1.0 if px else float(max(wh))
    shift = np.zeros(2) if px else np.array([(wh[0] - 1) / 2, (wh[1] - 1) / 2])
    N = np.diag([1 / unit, 1 / unit, 1.0]) @ np.array(
        [[1, 0, -shift[0]], [0, 1, -shift[1]], [0, 0, 1]]
    )
    A = []
    for H in Hs:
        G = N @ H
        G = G / np.sqrt((G * G).sum())
        a, b = (G[0], G[1]) if slip == "rows" else (G[:, 0], G[:, 1])

        def form(p, q):
            return np.array(
                [
                    p[0] * q[0] + p[1] * q[1],
                    p[0] * q[2] + p[2] * q[0],
                    p[1] * q[2] + p[2] * q[1],
                    p[2] * q[2],
                ]
            )

        A += [form(a, b), form(a, a) - form(b, b)]
    B = np.linalg.svd(np.array(A))[2][-1]
    B = B / B[0]
    u, v = -B[1], -B[2]
    f2 = B[3] if slip == "principal point" else B[3] - u * u - v * v
    with np.errstate(invalid="ignore"):
        f = f2 if slip == "square" else np.sqrt(f2)
    if slip == "signs":
        u, v = -u, -v
    if slip == "units":
        return np.array([[f, 0, u], [0, f, v], [0, 0, 1]])
    f, u, v = f * unit, u * unit + shift[0], v * unit + shift[1]
    if slip == "middle":
        u, v = wh[0] / 2, wh[1] / 2
    return f if slip == "focal" else np.array([[f, 0, u], [0, f, v], [0, 0, 1]])


def from_two_pixels(left, right, turn, t, slip):
    """By solving z of both equations with lstsq."""
    if slip == "inverted":
        turn, t = np.linalg.inv(turn), -np.linalg.inv(turn) @ t
    ray = np.array([left[0], left[1], 1.0])
    g = turn @ ray
    A = np.array([[g[0] - right[0] * g[2]], [g[1] - right[1] * g[2]]])
    b = np.array([right[0] * t[2] - t[0], right[1] * t[2] - t[1]])
    with np.errstate(all="ignore"):
        z = np.linalg.lstsq(A, b, rcond=None)[0][0]
        if slip in ("first", "first anywhere"):
            z = b[0] / A[0, 0]
        if slip == "second":
            z = b[1] / A[1, 0]
        if slip == "mean":
            z = (b[0] / A[0, 0] + b[1] / A[1, 0]) / 2
    deep = g[2] * z + (-t[2] if slip == "less T" else t[2])
    ahead = z > 0 and (deep > 0 or slip == "left alone")
    if not ahead and slip not in ("anywhere", "first anywhere"):
        return np.array([np.nan] * 3)
    return np.array([left[0], left[1], z]) if slip == "ray" else ray * z


def motion(rod, world, slip):
    ok = ~np.isnan(world[:, 0])
    if slip == "missing":
        ok[:] = True
    a, b = rod[ok], world[ok]
    F = np.eye(4)
    if slip == "any matrix":
        F[:3] = (np.linalg.pinv(np.c_[a, np.ones(len(a))]) @ b).T
        return F
    ca, cb = a.mean(0), b.mean(0)
    W = (a - ca).T @ (b - cb)
    U, _, Vt = np.linalg.svd(W)
    V = Vt.T
    d = np.sign(np.linalg.det(V @ U.T))
    R = V @ np.diag([1, 1, d]) @ U.T
    if slip == "no guard":
        R = V @ U.T
    if slip == "minus":
        R = d * (V @ U.T)
    if slip == "axis":
        R = V @ U.T @ np.diag([1, 1, d])
    if slip == "back":
        R = R.T
    t = cb - R @ ca
    if slip == "means":
        t = cb - ca
    if slip == "over all":
        t = cb - R @ rod.mean(0)
    F[:3, :3], F[:3, 3] = R, t
    if slip == "way back":
        F[:3, :3], F[:3, 3] = R.T, -R.T @ t
    return F


def between(c1, d1, c2, d2, slip):
    """By the cross product."""
    if slip == "unit":
        c = d1 @ d2
        s = ((c2 - c1) @ d1 - c * ((c2 - c1) @ d2)) / (1 - c * c)
        u = (c * ((c2 - c1) @ d1) - (c2 - c1) @ d2) / (1 - c * c)
        return 0.5 * (c1 + s * d1 + c2 + u * d2)
    n = np.cross(d1, d2)
    s = np.cross(c2 - c1, d2) @ n / (n @ n)
    u = np.cross(c2 - c1, d1) @ n / (n @ n)
    p, q = c1 + s * d1, c2 + u * d2
    if slip == "sign":
        q = c2 - u * d2
    return {"left": p, "right": q, "sum": p + q, "line": q - p}.get(slip, (p + q) / 2)


def angles(measured, truth, slip):  # noqa: C901
    rows = []
    for m, s in zip(measured, truth, strict=True):
        if np.isnan(m).any() and slip not in ("spoil", "neither"):
            continue
        d = m - s
        if slip not in ("no wrap", "neither"):
            d = np.rad2deg(np.arctan2(np.sin(np.deg2rad(d)), np.cos(np.deg2rad(d))))
        rows.append(d)
    if not rows:
        return np.nan if slip == "one mean" else np.array([np.nan] * 3)
    d = np.array(rows)
    if slip == "signed":
        return d.mean(0)
    if slip == "absolute of mean":
        return abs(d.mean(0))
    d = abs(d)
    if slip == "sum":
        return d.sum(0)
    if slip == "rms":
        return (d * d).mean(0) ** 0.5
    if slip == "one mean":
        return d.mean()
    if slip == "lost as right":
        return d.sum(0) / len(truth)
    return np.radians(d.mean(0)) if slip == "radians" else d.mean(0)


def askew(abc, turn, where, slip):
    """By matrices, pose by pose."""
    letters = {"small": "zyx", "order": "XYZ"}.get(slip, "ZYX")
    turn = np.array(turn, float)
    C = cv2.Rodrigues(turn if slip == "radians" else np.deg2rad(turn))[0]
    if slip == "back":
        C = C.T
    out = []
    for row in abc:
        R = Rotation.from_euler(letters, row, degrees=True).as_matrix()
        right = (where == "handle") != (slip == "side")
        now = Rotation.from_matrix(R @ C if right else C @ R).as_euler(letters, degrees=True)
        d = row - now if slip == "set less" else now - row
        out.append(d if slip == "no wrap" else (d + 180) % 360 - 180)
    return np.array(out)


def without(J, C, slip):
    """By whitened rows and a pseudo-inverse; the covariance of each row of views by itself."""
    n = len(J)
    if n < 4:
        return np.full(n, np.inf)
    rows = []
    for Ji, Ci in zip(J, C, strict=True):
        W = {"covariance": Ci, "no weights": np.eye(2)}.get(slip, np.linalg.inv(Ci))
        rows.append(np.linalg.cholesky(W).T @ Ji)

    def size(some):
        A = np.vstack(some)
        if slip == "information":
            return (A[:, :3] ** 2).sum()
        columns = A[:, :3] if slip == "angles known" else A
        G = np.linalg.pinv(columns)
        return (G[: 6 if slip == "six" else 3] ** 2).sum()

    out = []
    for k in range(n):
        out.append(size(rows if slip == "nothing" else rows[:k] + rows[k + 1 :]))
    out = np.array(out)
    if slip == "growth":
        out = out - size(rows)
    return np.sqrt(out) if slip == "root" else out


def strokes_of(hand, task, error, tolerance, slip):
    """By counting strokes until the tool is there."""
    k = error / tolerance if slip == "inverse" else tolerance / error
    reach = [h * (1.0 if slip == "scale" else k) for h in hand]
    if slip == "diagonals":
        reach, task = [math.dist(reach, [0, 0, 0])], [math.dist(task, [0, 0, 0])]
    if slip == "ratio":
        return k, max(t / r for t, r in zip(task, reach, strict=True))
    counts = []
    for t, r in zip(task, reach, strict=True):
        n = 0
        while n * r < t or (slip == "many" and n * r <= t):
            n += 1
        if slip == "down" and n * r > t:
            n -= 1
        counts.append(n)
    pick = {"sum": sum, "fewest": min}.get(slip, max)
    return k, pick(counts)


def clutch(hand, shut, tool, k, slip):  # noqa: C901
    """By steps, with a state of a word."""
    out = []
    state, last, anchor, anchor_tool = "open", None, None, None
    start = next((p for p in hand if not np.isnan(p).any()), None)
    tool0 = tool = np.array(tool, float)
    if slip == "no scale":
        k = 1.0
    for p, s in zip(hand, shut, strict=True):
        lost = bool(np.isnan(p).any())
        if not s and not (slip == "never released" and state == "held"):
            state = "open"
        elif slip == "never released" and state == "held":
            pass
        elif lost and slip == "NaN":
            if state == "open":
                state, anchor, anchor_tool = "on", p, tool
            tool = anchor_tool + k * (p - anchor)
        elif lost:
            if slip == "jumps":
                pass
            elif slip == "by itself":
                state = "open"
            else:
                state = "held"
        elif state != "held":
            if slip == "from the start":
                tool = tool0 + k * (p - start)
            elif slip == "first tool":
                if state == "open":
                    state, anchor = "on", p
                tool = tool0 + k * (p - anchor)
            elif slip == "open step":
                if last is not None:
                    tool = tool + k * (p - last)
                state = "on"
            else:
                if state == "open":
                    state, anchor, anchor_tool = "on", p, tool
                tool = anchor_tool + k * (p - anchor)
        last = None if lost else p
        out.append(tool)
    return np.array([out[-1]] * len(out)) if slip == "one array" else np.array(out)


def four_channels(push, T, wall, k_w, slip):
    """By whole arrays of what has been sent, zero before the beginning."""
    n = len(push)
    h, m, b, kc, bc = 2e-4, 0.2, 2.0, 200.0, 2.0
    xm, vm, xs, vs = np.zeros((4, n + 1))
    force = np.zeros(n)
    for i in range(n):
        deep = xs[i] - wall
        force[i] = k_w * deep if deep > 0 or slip == "pulls" else 0.0
        j = i - T
        was = (xm[j], vm[j], xs[j], vs[j]) if j >= 0 else (0, 0, 0, 0)
        sent = j - 1 if slip == "step late" else j
        came = force[sent] if sent >= 0 else 0.0
        lead = (xm[i], vm[i]) if slip == "prompt slave" else was[:2]
        pull = kc * (lead[0] - xs[i]) + bc * (lead[1] - vs[i])
        spring = kc * (xm[i] - was[2]) + bc * (vm[i] - was[3])
        back = {"now": force[i], "spring": spring, "both": spring + came, "sign": -came}.get(
            slip, came
        )
        vm[i + 1] = vm[i] + h / m * (push[i] - back - b * vm[i])
        vs[i + 1] = vs[i] + h / m * (pull - (0 if slip == "no wall" else force[i]) - b * vs[i])
        a = i if slip == "old speed" else i + 1
        xm[i + 1], xs[i + 1] = xm[i] + h * vm[a], xs[i] + h * vs[a]
    return np.column_stack([xm[:n], xs[:n]])


def alike(deg, rows, slip):
    """By the set of places, to a millionth."""

    def places(a, r):
        return {(round(x % 360, 5) % 360, round(y, 5)) for x, y in zip(a, r, strict=True)}

    if slip == "columns":
        return 2 * len({round(x, 6) for x in deg})
    here = places(deg, rows)
    count = 0
    for up in (1,) if slip == "turns" else (1, -1):
        way = 1 if slip == "mirrored" else up
        for goal in {round((x - way * deg[0]) % 360, 5) % 360 for x in deg}:
            moved = [way * x + goal for x in deg]
            if slip == "no wrap":
                raw = {(round(x, 4), round(y, 4)) for x, y in zip(deg, rows, strict=True)}
                new = {(round(x, 4), round(up * y, 4)) for x, y in zip(moved, rows, strict=True)}
                count += new <= raw
            elif slip == "each":
                new = places(moved, [up * y for y in rows])
                count += {a for a, _ in new} <= {a for a, _ in here} and {r for _, r in new} <= {
                    r for _, r in here
                }
            else:
                count += places(moved, [up * y for y in rows]) == here
    return count


def differing(frame, bench, limit, slip):
    """Pixel by pixel, in Python's own numbers."""
    out = np.zeros(np.shape(frame), bool)
    for place, grey in np.ndenumerate(frame):
        a, b = int(grey), float(bench[place])
        if slip == "seven bits":
            a, b = a - 256 * (a > 127), int(b) - 256 * (int(b) > 127)
        d = a - b if slip == "brighter" else abs(a - b)
        if slip == "shorter":
            d = min(d, 256 - d)
        out[place] = d >= limit if slip == "from T" else d > limit
    return ~out if slip == "turned" else out


def looked_for(x, P, h, Q, n, slip):
    """By one power of the matrix and a sum over the frames."""
    An = np.array([[1.0, n * h], [0.0, 1.0]])
    S = An @ P if slip == "transpose" else An @ P @ An.T
    for k in range(n):
        Ak = np.array([[1.0, k * h], [0.0, 1.0]])
        if slip == "transpose":
            S = S + Ak @ Q
        elif slip == "once":
            S = S + (Ak @ Q @ Ak.T if k == n - 1 else 0)
        else:
            S = S + Ak @ Q @ Ak.T
    if slip in ("factor", "speed"):
        S = P + n * Q
    half = 3 * S[0, 0] ** 0.5
    if slip == "factor":
        half = half * n
    if slip == "speed":
        half = half + abs(n * h * x[1])
    return x[0] + n * h * x[1], half


def middle_of_spot(image, u, v, half, slip):
    """By sums over the columns and over the rows."""
    image = np.array(image, float)
    low, high = half + (slip == "before"), half + 1 + (slip == "behind") - (slip == "added")
    rows, columns = np.arange(v - low, v + high), np.arange(u - low, u + high)
    part = image[np.ix_(rows, columns)]
    if slip != "ground":
        part = part - part.min()
    shift = {"before": 1.0, "added": 0.5}.get(slip, 0.0)
    place = np.array([columns @ part.sum(0), rows @ part.sum(1)]) / part.sum() + shift
    return place[::-1] if slip == "row" else place


def between_cameras(R1, t1, R2, t2, slip):
    """By 4 x 4 matrices."""

    def four(R, t):
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = R, t
        return M

    A, B = four(R1, t1), four(R2, t2)
    M = A @ np.linalg.inv(B) if slip == "other way" else B @ np.linalg.inv(A)
    R, T = M[:3, :3], M[:3, 3]
    if slip == "not turned":
        T = t2 - t1
    if slip == "signs":
        T = -T
    if slip == "order":
        R = R1.T @ R2
        T = t2 - R @ t1
    if slip == "centres":
        T = np.linalg.inv(A)[:3, 3] - np.linalg.inv(B)[:3, 3]
    return R, T


def out_of_camera(points, R, t, slip):
    """Point by point, by solving."""
    out = []
    for p in points:
        if slip == "behind":
            out.append(np.linalg.solve(R, p) - t)
        elif slip == "from the world":
            out.append(R @ p + t)
        elif slip == "no turn":
            out.append(p - t)
        else:
            out.append(np.linalg.solve(R, p + t if slip == "added" else p - t))
    return np.array(out).T if slip == "columns" else np.array(out)


def tool_after(tool, deg, k, slip):
    """By OpenCV's Rodrigues."""
    rad = np.array(deg, float) * math.pi / 180
    if slip == "conversion":
        rad = np.array(deg, float) * 180 / math.pi
    if slip == "ratio":
        k = 1.0
    if slip == "back":
        rad = -rad
    M = cv2.Rodrigues(k * rad)[0]
    if slip == "angles":
        X, Y, Z = (cv2.Rodrigues(k * rad[i] * np.eye(3)[i])[0] for i in range(3))
        M = Z @ Y @ X
    return tool @ M if slip == "right" else M @ tool


# of each exercise the function, and of each slip how the sentence begins that is to be said of it
SLIPS = {
    "01.3": (alike, {
        "turns": "You count the turns alone", "mirrored": "Upside down is a rotation",
        "no wrap": "Angles are compared without", "each": "Angles and rows are compared each",
        "columns": "Two poses for each column",
    }),
    "02.3": (seen_by_camera, {
        "behind": "Points behind the camera", "other way": "The motion is used the other way",
        "transposed": "The rotation is transposed", "swapped": "Width and height",
        "from zero": "Half a pixel", "centres": "This lets in what lies between",
    }),
    "03.3": (film, {
        "linear": "The rate is the gap by the memory", "swapped": "The two shares",
        "start": "The rate is made of the time since", "one rate": "All frames get one rate",
        "first frame": "The first frame is taken", "whole": "The background is cut down",
        "black": "The background begins with black",
    }),
    "03.4": (two_ends, {
        "frames": "Seconds are taken for frames", "linear": "The way from the jump",
        "logarithm": "ln(jump / T)", "ends": "The two ends", "none": "Where the lowest rate",
        "left": "This is 1 - alpha",
    }),
    "03.7": (differing, {
        "brighter": "Only what is brighter", "shorter": "The difference is taken the shorter",
        "seven bits": "int8 reaches", "from T": "A difference of just T", "turned": "What does not move",
    }),
    "04.2": (one_number, {
        "uncorrected": "The variance is never corrected", "after": "The variance grows after",
        "noise": "The gain is the noise's share", "brackets": "The gain lacks its brackets",
        "never": "The variance never grows", "waits": "The variance does not grow while",
        "spoilt": "A missing observation", "no gate": "Every observation is believed",
        "noise gate": "The gate is made of the noise", "square": "The square of the innovation",
        "left out": "Means are left out", "last": "Only the last mean",
    }),
    "04.3": (six_numbers, {
        "untransposed": "Eq. 10 is used as printed", "old": "Eq. 14 is used",
        "no R": "R is missing", "half": "The half is missing", "turned": "The innovation is turned",
        "end": "Q is added after", "unpredicted": "The state is not carried on",
        "nan": "All is right, but where nothing",
    }),
    "04.6": (looked_for, {
        "transpose": "To the right of P", "once": "Q is added once",
        "factor": "The window is made wider", "speed": "The way that the target goes",
    }),
    "05.3": (long_run, {
        "last run": "The last run is forgotten", "last of equals": "Of runs of one length you take the last",
        "any count": "Runs of any count", "largest": "The run with the largest count",
        "as bright": "Pixels that equal", "corners": "Pixels that touch at a corner",
        "rest": "The dark rest", "beyond": "The middle is half a threshold",
        "count": "This is how many contours", "length": "This is how long",
    }),
    "05.6": (middle_of_spot, {
        "added": "Half a pixel is added", "before": "The window begins one pixel earlier",
        "behind": "The window is one pixel too long", "row": "Row and column",
        "ground": "The ground counts",
    }),
    "06.3": (line_of, {
        "undivided": "The line is not divided", "length": "The line is divided by the length",
        "other way": "This is the line for the motion", "transposed": "F is transposed",
        "exchanged": "R and the matrix", "swapped": "u and v are swapped",
        "inverse alone": "The inverse of K_right", "sign": "All three numbers have the other sign",
    }),
    "06.4": (alike_at_best, {
        "deviations": "Standard deviations are added", "root": "The root under the fraction",
        "brightness": "The mean square of the patch", "common": "Noise stands above",
        "left": "Only the left image", "mean": "The two variances are averaged",
        "flat": "A flat patch",
    }),
    "06.5": (scatter, {
        "right": "Only the right pixel", "alike": "This is sigma times", "same": "For the left pixel's share",
        "left image": "This is the scatter of the distance in the left", "added": "The two standard deviations",
        "variance": "This is the variance", "undivided": "This is the scatter of a u",
    }),
    "07.3": (lens, {
        "square": "This focal length is its own square", "principal point": "The principal point",
        "signs": "The principal point",
        "middle": "The principal point is taken", "focal": "Only the focal length",
    }),
    "08.3": (from_two_pixels, {
        "first": "This is the first form alone. ", "first anywhere": "This is the first form alone, which",
        "second": "This is the second form", "mean": "This is the mean of both",
        "inverted": "R and T have been inverted", "anywhere": "A point behind a camera",
        "left alone": "The point is in front of the left", "less T": "The depth in the right camera",
        "ray": "x and y are those of the ray",
    }),
    "08.4": (motion, {
        "no guard": "The guard against reflections", "minus": "A reflection has been turned",
        "axis": "The sign is at the wrong place", "any matrix": "This is the best matrix",
        "back": "The rotation is transposed", "way back": "This motion leads",
        "means": "The shift is the difference", "missing": "Markers that were not measured",
        "over all": "The rod's mean is over all",
    }),
    "08.5": (between, {
        "left": "This point lies on the left", "right": "This point lies on the right",
        "sum": "The two nearest points", "line": "This is the way", "sign": "The right ray has",
        "unit": "This formula takes",
    }),
    "08.8": (out_of_camera, {
        "behind": "The shift is undone behind", "from the world": "This goes from the world",
        "added": "The shift is added", "columns": "The points come out as columns",
        "no turn": "The rotation is left out",
    }),
    "09.3": (angles, {
        "no wrap": "The differences are not brought into (-180, 180]: 180", "signed": "The differences keep",
        "absolute of mean": "The absolute value comes", "sum": "This is the sum",
        "rms": "This is the root mean", "one mean": "This is one mean", "radians": "The means are in radians",
        "lost as right": "Lost poses count", "spoil": "One lost pose",
        "neither": "The differences are not brought into (-180, 180], and",
    }),
    "09.4": (askew, {
        "side": "The sides are exchanged", "radians": "The rotation vector", "back": "The turn goes backwards",
        "set less": "You have set less", "no wrap": "The differences are not brought",
        "small": "In SciPy the small", "order": "Alpha is taken about x",
    }),
    "10.3": (without, {
        "angles known": "The angles are taken for known", "six": "The trace is that of all six",
        "information": "This is the trace of the information", "root": "This is the root",
        "covariance": "The weight is the covariance", "no weights": "The centroids count alike",
        "nothing": "No view is left out", "growth": "This is by how much",
    }),
    "11.2": (strokes_of, {
        "inverse": "The scale is the other way", "ratio": "Strokes come in whole",
        "down": "The number of strokes is rounded", "many": "There is a stroke too many",
        "sum": "The strokes of the three", "fewest": "This is the direction that needs",
        "scale": "The strokes are those of scale 1", "diagonals": "The diagonals",
    }),
    "11.3": (clutch, {
        "from the start": "The hand's way is counted", "first tool": "At each closing",
        "open step": "The step from the last",
        "jumps": "When the pose is back, the tool jumps", "by itself": "When the pose is back, the tool goes on",
        "never released": "Once the pose was lost", "no scale": "The scale is left out",
        "NaN": "The NaN of a lost pose", "one array": "All rows are the last",
    }),
    "11.6": (tool_after, {
        "conversion": "The angle is multiplied by 180", "right": "The turn is multiplied from the right",
        "angles": "The three numbers", "ratio": "The ratio is left out", "back": "The tool turns the other",
    }),
    "12.3": (four_channels, {
        "now": "The master gets the wall's force of now", "spring": "This is position-position",
        "both": "The master gets the spring's force and", "sign": "The sign of the master's",
        "pulls": "The wall pulls", "prompt slave": "The slave knows", "no wall": "The wall does not push",
        "step late": "The force that is sent", "old speed": "The places move by",
    }),
}  # fmt: skip


def judged(number, function):
    asked = exercise(number)
    return judge_outcomes(asked, [outcome(function, case) for case in call_of(asked).cases])


@pytest.mark.parametrize("number", SLIPS)
def test_another_algorithm_is_right(number):
    function, _ = SLIPS[number]
    verdict = judged(number, lambda *arguments: function(*arguments, ""))
    assert verdict.right, verdict


@pytest.mark.parametrize(
    ("number", "slip"), [(number, slip) for number, (_, slips) in SLIPS.items() for slip in slips]
)
def test_a_mistake_is_recognised_as_another_hand_writes_it(number, slip):
    function, slips = SLIPS[number]
    verdict = judged(number, lambda *arguments: function(*arguments, slip))
    assert not verdict.right
    assert verdict.says.startswith(slips[slip]), verdict


# What rows of H give depends on how the equations are weighted, since no camera fits them, and where
# NaN spreads: whoever makes this mistake in another way than the grader is told the difference alone.
@pytest.mark.parametrize("slip", ["square", "principal point", "signs", "units"])
def test_a_mistake_in_units_of_the_image_is_recognised_too(slip):
    verdict = judged("07.3", lambda Hs, size: lens(Hs, size, slip, px=False))
    names = {
        "square": "This focal length is its own square",
        "principal point": "The principal point",
        "signs": "The principal point",
        "units": "The result is still in the units",
    }
    assert not verdict.right
    assert verdict.says.startswith(names[slip]), verdict
