"""The applets of the chapters in a browser: their numbers beside the package's, and how they are
used.

Both sides compute in double precision, by other orders of the same operations. A relative 1e-9 is a
million times what the rounding of a few dozen operations makes; where a tolerance is wider, the
reason stands beside it.
"""

import base64
import json
import re
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from pages import HTML, built
from processes import wait_until
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from trinolab import background, image_track, kalman, matching, triangulation, workspace
from trinolab.camera import Camera, Rig, epipolar_lines, fundamental_matrix
from trinolab.datasets import load_rig
from trinolab.kalman import KalmanParameters
from trinolab.slave import mapping
from trinolab.slave.oneeuro import OneEuroParameters
from trinolab.window import Window
from trinolab.workspace import cones
from workbench.paper.errata.workspace import printed_cones
from workbench.teleop import operators, pointing

PAGES = {
    "cones": "02_workspace",
    "pixel": "03_background",
    "threshold": "03_background",
    "kalman": "04_kalman",
    "nextplace": "04_kalman",
    "epipolar": "06_matching",
    "pairs": "06_matching",
    "depth": "08_pose",
    "pointing": "11_master_slave",
}
GAMES = {"threshold", "nextplace", "pairs"}
CASES = 10
DIGITS = 1e-9
MM_PX = 25.4 / 96  # of the page's pixels
pytestmark = built


class Reader:
    """A browser that stays on a page as long as its applets are asked for."""

    def __init__(self, browser):
        self.browser = browser
        self.ask = browser.evaluate

    def on(self, name):
        """The page of an applet, which is as it begins."""
        address = (HTML / "notebooks" / f"{PAGES[name]}.html").as_uri()
        if self.ask("location.href.split('#')[0]") != address:
            self.browser.open(address)
            # The theme scrolls smoothly: what is pressed would still be on its way.
            self.ask("document.documentElement.style.scrollBehavior = 'auto'")
        self.ask(f"globalThis.applet = document.querySelector('.applet[data-applet={name}]'); null")
        self.press_button("Reset")
        return self

    def known(self, name):
        """What the book has computed for an applet."""
        return self.on(name).ask(f"trinolabApplets.{name}.known.data")

    def one(self, selector, what="textContent"):
        """A property of the first element of the applet that is selected."""
        return self.ask(f"applet.querySelector({json.dumps(selector)}).{what}")

    def values(self, *names):
        """Of sliders, by their names."""
        return {name: float(self.one(f"[name={name}]", "value")) for name in names}

    def can_be_held(self, selector):
        """Wait until the middle of an element lies open in the window, and nothing is over it."""
        at = "document.elementFromPoint({}, {})?.matches({})"
        wait_until(
            lambda: self.ask(at.format(*self.browser.middle(selector), json.dumps(selector)))
        )

    def says(self):
        return self.one(".applet-says", "innerText")

    def press_button(self, text):
        self.ask(
            f"[...applet.querySelectorAll('button')]"
            f".find(one => one.textContent.startsWith({json.dumps(text)})).click()"
        )


@pytest.fixture(scope="module")
def reader(browser):
    return Reader(browser)


# --- the formulas


class Case(NamedTuple):
    """An expression of the page, what the package gives in its place, and how near they must be."""

    call: str
    expected: Any
    rtol: float = DIGITS
    atol: float = DIGITS


def call(function, *arguments):
    """The call of a function of the applets, `function` as ``name.function``."""
    said = ", ".join(json.dumps(one, default=np.ndarray.tolist) for one in arguments)
    return f"trinolabApplets.{function}({said})"


def as_floats(value):
    """An answer of the page as an array; what is no number there is null here."""
    return np.array(value, dtype=float)


def agree(found, expected, case):
    """Compare an answer with what is expected: dicts by their keys, all else as numbers."""
    if isinstance(expected, dict):
        for name, value in expected.items():
            agree(found[name], value, case)
    elif isinstance(expected, str):
        assert found == expected
    else:
        np.testing.assert_allclose(
            as_floats(found), as_floats(expected), case.rtol, case.atol, err_msg=case.call[:300]
        )


def cones_cases(reader):
    """The sliders' ends, and some in between; each with CCD3 as corrected and as printed."""
    rng = np.random.default_rng(1)
    ends = [(30, 30, 4), (75, 75, 30), (30, 75, 30), (75, 30, 4)]
    inner = rng.uniform((30, 30, 4), (75, 75, 30), (CASES - len(ends), 3))
    for beta1, beta2, omega in [*ends, *inner]:
        point = rng.uniform((-0.5, -1, 0), (1.5, 2, 3.6))
        angles = np.deg2rad([beta1, beta2, omega])
        given = {"beta1_deg": beta1, "beta2_deg": beta2, "omega_deg": omega, "point": point}
        corrected = cones.paper_cones(1.0, *angles)
        as_printed = [*corrected[:2], printed_cones(1.0, *angles)[2]]
        for more, trio in (({}, corrected), ({"printed3": True}, as_printed)):
            asked = call("cones.compute", {**given, **more})
            toward = [point - cone.apex for cone in trio]
            expected = {
                "apexes": [cone.apex for cone in trio],
                "axes": [cone.axis for cone in trio],
                "inside": [cones.inside([cone], [point])[0] for cone in trio],
                "angles_deg": [
                    np.rad2deg(np.arccos(one @ cone.axis / np.linalg.norm(one)))
                    for one, cone in zip(toward, trio, strict=True)
                ],
            }
            seen = (
                f"(one => ({{...one, apexes: one.cones.map(cone => cone.apex),"
                f" axes: one.cones.map(cone => cone.axis)}}))({asked})"
            )
            yield Case(seen, expected)
            # A sum over directions 1/120 apart, of a surface that has edges: of these cases the worst
            # is off by 1.1e-4; with half as many directions by 4.4e-4, with twice as many by 0.4e-4.
            # As printed the three share nothing.
            yield Case(f"{asked}.volume", workspace.intersect(trio).volume, 3e-4, 0)


def chord_cases(reader):
    """From the apex, from inside, from behind; along the axis, across it, along a generator."""
    rng = np.random.default_rng(2)
    apex, axis = np.array([0.2, -0.1, 0.3]), np.array([0.0, 0.6, 0.8])
    cone = cones.Cone(apex, axis, 0.4)
    starts = [apex, apex + axis, apex - axis, *rng.normal(size=(CASES - 3, 3))]
    directions = [axis, rng.normal(size=3), -axis, *rng.normal(size=(CASES - 4, 3))]
    directions.append(cone.generators([1.0])[0])
    for start, direction in zip(starts, directions, strict=True):
        unit = direction / np.linalg.norm(direction)
        low, high = (float(one[0]) for one in cones.chord(cone, start, unit[None]))
        asked = call("cones.chord", {"apex": apex, "axis": axis, "omega": 0.4}, start, unit)
        missed = f"{asked}.reduce((low, high) => low > high)"
        yield Case(missed, low > high)
        if low <= high:  # beyond 1e9 a line is endless
            ends = f"{asked}.map(one => Math.max(-1e9, Math.min(1e9, one)))"
            yield Case(ends, np.clip([low, high], -1e9, 1e9), 1e-7)


def pixel_cases(reader):
    """Histories of a grey level, frame by frame, and for how long a jump without noise is seen."""
    rng = np.random.default_rng(3)
    for k, alpha in enumerate([0.0, 1.0, *rng.uniform(0.001, 0.5, CASES - 2)]):
        levels = rng.uniform(0, 255, 60) if k < 5 else 45 + 30 * rng.standard_normal(60).cumsum()
        T = [0.0, 300.0, *rng.uniform(2, 44, CASES)][k]
        share, slow = [0.0, 0.3][k % 2], [None, 0.0, 0.001][k % 3]
        B, before, moving = np.array([[levels[0]]]), [], []
        for level in levels:
            frame = np.array([[level]])
            mask = background.difference(frame, B, T, share).mask
            before.append(B[0, 0])
            moving.append(mask[0, 0])
            masked = {} if slow is None else {"mask": mask, "masked_rate": slow}
            B = background.update(B, frame, alpha, **masked)
        given = {
            **{"levels": levels, "alpha": alpha, "T": T},
            **{"shadowShare": share, "maskedRate": slow},
        }
        expected = {"before": before, "moving": moving, "last": B[0, 0]}
        yield Case(call("pixel.compute", given), expected)
    jumps = [10.0, 15.0, *rng.uniform(16, 100, CASES - 2)]
    alphas = [0.01, 0.01, 0.9, *rng.uniform(0.005, 0.5, CASES - 3)]
    for jump, alpha in zip(jumps, alphas, strict=True):
        B, count = np.array([[45.0]]), 0
        frame = B + jump
        while background.difference(frame, B, 15.0).mask[0, 0]:
            B = background.update(B, frame, alpha)
            count += 1
        seconds = call("pixel.secondsSeen", {"jump": jump, "alpha": alpha, "T": 15.0})
        yield Case(f"Math.ceil(30 * {seconds} - {DIGITS})", count)


def gain_cases(reader):
    """By hand for the first correction: K = p / (p + sigma^2), of the variance p that is predicted;
    it does not depend on what is seen.
    """
    dt, q, sigma = 0.1, 100.0, 2.0
    p = sigma**2 + (3.0 * dt) ** 2 + (5.0 * dt**2 / 2) ** 2 + q * dt**5 / 20
    for second in (11.0, 250.0):
        given = {
            **{"uv": [[10.0, 20.0], [second, 21.0]], "dt": dt, "q": q, "sigma": sigma},
            **{"velocitySigma": 3.0, "accelerationSigma": 5.0, "gated": False},
        }
        yield Case(f"{call('kalman.compute', given)}[1].K[0][0]", p / (p + sigma**2), 1e-12, 0)


def decoded(reader):
    """The epipolar applet's cameras as the package's, the corners of their parts, and the greys."""
    cameras, corners, images = [], [], []
    for about in reader.known("epipolar")["cameras"]:
        turn = Rotation.from_matrix(about["rotation"])
        T = RigidTransform.from_components(about["translation"], turn)
        cameras.append(Camera(about["name"], (1280, 1024), about["matrix"], np.zeros(5), T))
        corners.append(np.array(about["corner"]))
        grey = np.frombuffer(base64.b64decode(about["grey"]), np.uint8)
        images.append(grey.reshape(about["size"][::-1]))
    return cameras, corners, images


def epipolar_cases(reader):
    """Two places in 64ths of a pixel: so OpenCV interpolates without rounding, in its single
    precision. Eq. 18 as corrected; as printed, a window begins at its place, or the last sum is over y'
    alone.
    """
    cameras, corners, images = decoded(reader)
    rng = np.random.default_rng(6)
    for k in range(CASES):
        right = 1 + k % 2
        places = rng.integers(0, 139 * 64, (2, 2)) / 64
        if k < 2:
            places[k] = [0.0, 199.0]  # a corner of the part: beyond it the last pixel repeats
        uv = [places[0] + corners[0], places[1] + corners[right]]
        pair, seen = (cameras[0], cameras[right]), (images[0], images[right])
        shown = (
            """
            (([uvLeft, uvRight], right, eq18) => {
                const {known: {data}, decoded, compute} = trinolabApplets.epipolar;
                const [one, other] = [0, right].map(k => decoded(data.cameras[k]));
                return compute({left: one, right: other, windowPx: 21, uvLeft, uvRight, eq18});
            })"""
            + f"({json.dumps(np.array(uv).tolist())}, {right}"
        )
        T, one = (
            cv2.getRectSubPix(image.astype(np.float32), (21, 21), place).astype(float)
            for image, place in zip(seen, places, strict=True)
        )
        expected = {
            "line": epipolar_lines(*pair, uv[0][None])[0],
            "D": matching.epipolar_distances(*pair, uv[0][None], uv[1][None])[0, 0],
            "S": matching.ncc_matrix(*seen, places[:1], places[1:], 21)[0, 0],
            "windows": [T.ravel(), one.ravel()],
        }
        yield Case(f"{shown})", expected)
        by_corner = matching.ncc_matrix(*seen, places[:1], places[1:] + 10, 21)
        yield Case(f"{shown}, 'corner').S", by_corner[0, 0])
        T, one = T - T.mean(), one - one.mean()
        by_sum = (T * one).sum() / np.sqrt((T**2).sum() * (one[:, 0] ** 2).sum())
        yield Case(f"{shown}, 'sum').S", by_sum)


def pair_cases(reader):
    """The chapter's four fifths, flat windows, and Eq. 25's matrix."""
    yield Case(call("epipolar.correlation", [1, 2, 3, 4], [1, 3, 2, 4]), 0.8, 1e-12, 0)
    yield Case(call("epipolar.correlation", [7, 7, 7, 7], [1, 3, 2, 4]), 0, 0, 0)
    left, right = load_rig("paper_pair").cameras
    about = [
        {
            "matrix": one.matrix,
            "rotation": one.T_cam_world.rotation.as_matrix(),
            "translation": one.T_cam_world.translation,
        }
        for one in (left, right)
    ]
    unit = "(F => F.map(row => row.map(one => one / Math.hypot(...F.flat()))))"
    expected = fundamental_matrix(left, right)
    yield Case(f"{unit}({call('epipolar.fundamentalMatrix', *about)})", expected, 1e-7, 1e-12)


def ideal_pair(baseline_mm, vergence_deg, focal_px):
    """The depth applet's cameras as the package's."""
    matrix = [[focal_px, 0, 0], [0, focal_px, 0], [0, 0, 1]]
    cameras = []
    for name, sign in (("left", -1), ("right", 1)):
        turn = Rotation.from_euler("y", -sign * vergence_deg / 2, degrees=True)
        T = RigidTransform.from_components([sign * baseline_mm / 2, 0, 0], turn).inv()
        cameras.append(Camera(name, (1280, 1024), matrix, np.zeros(5), T))
    return cameras


def depth_asked(baseline, vergence, distance, sigma):
    given = {"baseline_mm": baseline, "vergence_deg": vergence, "distance_mm": distance}
    return call("depth.compute", {**given, "sigma_px": sigma, "focal_px": 2940, "width_px": 1280})


def depth_cases(reader):
    """The covariance of a point in the middle, and the points of two pixels."""
    rng = np.random.default_rng(7)
    ends = [(20, 0, 900, 0.01), (400, 60, 300, 2.0), (99.2, 10.5, 568, 0.1)]
    inner = rng.uniform((20, 0, 300, 0.01), (400, 60, 900, 2), (CASES - len(ends), 4))
    for baseline, vergence, distance, sigma in [*ends, *inner]:
        cameras = ideal_pair(baseline, vergence, 2940.0)
        asked = depth_asked(baseline, vergence, distance, sigma)
        uv = np.stack([one.project([[0.0, 0.0, distance]]) for one in cameras])
        seen = (np.abs(uv[:, 0, 0]) <= 640).all()
        yield Case(asked, {"pixels": uv[:, 0], "seen": seen})
        covariance = triangulation.triangulation_covariance(Rig(cameras), uv, sigma)[0]
        # Differences over 2e-3 px of numbers rounded to 1e-13 mm: 5e-11 mm/px, of slopes from 0.05 on.
        # Where symmetry makes a covariance zero, the square of that is left.
        yield Case(f"{asked}.covariance", covariance, 1e-8, 1e-8 * sigma**2)
    cameras = ideal_pair(150.0, 20.0, 2940.0)
    parting = np.array([[-600.0, 0.0], [600.0, 0.0]])  # their rays meet behind the cameras
    for uv in [parting, *rng.uniform(-600, 600, (CASES, 2, 2))]:
        given = f"{depth_asked(150, 20, 500, 1)}.cameras, ...{json.dumps(uv.tolist())}"
        expected = triangulation.triangulate_pair(*cameras, uv[:1], uv[1:])[0]
        found = f"(trinolabApplets.depth.triangulate({given}) ?? [null, null, null])"
        yield Case(found, expected)


def ellipse_cases(reader):
    """An outline is one standard deviation from its middle, as often as it is enlarged."""
    rng = np.random.default_rng(17)
    for _ in range(CASES):
        A = rng.normal(size=(3, 3)) * [0.01, 0.01, 0.1]
        covariance, enlarged = A @ A.T, 10 ** rng.uniform(0, 3)
        inverse = np.linalg.inv(covariance[np.ix_([0, 2], [0, 2])]) / enlarged**2
        (a, b), (_, d) = inverse
        squared = f"([x, z]) => {a} * x * x + 2 * {b} * x * (z - 500) + {d} * (z - 500) ** 2"
        outline = call("depth.ellipse", [0, 0, 500.0], covariance, enlarged)
        yield Case(f"((all, of) => [all(Math.min), all(Math.max)])(pick => pick(...{outline}.map({squared})))",
                   [1, 1], 1e-6)  # of numbers beside 500  # fmt: skip


def tool_cases(reader):
    """Strokes of the clutch, and a filter that is taken out of the way by a very high cutoff."""
    rng = np.random.default_rng(9)
    for k in range(CASES):
        scale = [0.5, 4.0, *rng.uniform(0.5, 4, CASES)][k]
        hand = np.cumsum(rng.normal(0, 2, 40))
        closed = [True] * 40 if k == 0 else [False] * 40 if k == 1 else list(rng.random(40) < 0.7)
        p = mapping.MappingParameters(scale, filtering=OneEuroParameters(1e9, 1e9))
        state = mapping.State(0.0, RigidTransform.identity())
        tools, samples = [], []
        for n in range(40):
            T = RigidTransform.from_translation([hand[n], 0, 0])
            coupled = bool(closed[n])
            state = mapping.step(state, mapping.Sample((n + 1) / 30, T, "measured", coupled), p)
            tools.append(state.target.translation[0])
            samples.append({"hand": hand[n], "closed": coupled})
        # the filter leaves 5e-9 of a step of some mm
        yield Case(call("pointing.follow", {"scale": scale, "samples": samples}), tools, 0, 1e-6)


def drawn_log(rng, k):
    """A run of an operator's model, as a file holds it; of the fourth every press is in the middle."""
    trials = pointing.conditions(repeats=[1, 2, 3, 5][k % 4])
    log = operators.point(trials, "continuous", rng.uniform(0.5, 4), 0.025 * k, rng)
    name = ['a, "b"', "person", "Zoë"][k % 3]
    return log.assign(operator=name, error_mm=log["error_mm"] * (k != 3)).round(6)


def log_cases(reader):
    """What a log says of its run, the trials, and how late a picture is."""
    rng = np.random.default_rng(10)
    for k in range(CASES):
        log = drawn_log(rng, k)
        records = log.to_dict("records")
        yield Case(
            call("pointing.performance", records), pointing.performance(log)._asdict(), atol=0
        )
    for repeats in (1, 3):
        yield Case(call("pointing.conditions", repeats), pointing.conditions(repeats=repeats), 0, 0)
    yield Case(call("pointing.difficulty", 40, 5), pointing.difficulty(40, 5), atol=0)
    history = [[0, 0], [100, 1], [200, 2], [300, 3]]
    for t_ms, delay_ms, shown in (
        (300, 0, 3),
        (300, 150, 1),
        (299, 100, 1),
        (50, 100, 0),
        (700, 100, 3),
    ):
        yield Case(call("pointing.shownAt", history, t_ms, delay_ms), shown, 0, 0)


def threshold_cases(reader):
    """The agreement of masks with what moves."""
    for number, one in enumerate(reader.known("threshold")["rounds"]):
        grey, before, packed = (
            np.frombuffer(base64.b64decode(one[kind]), np.uint8)
            for kind in ("frame", "background", "moves")
        )
        shape = one["size"][::-1]
        moves = np.unpackbits(packed)[: grey.size].astype(bool).reshape(shape)
        for T in (0, 15, 44, 100):
            mask = background.difference(grey.reshape(shape), before.reshape(shape), T).mask
            share = (mask & moves).sum() / (mask | moves).sum()
            decode = f"decoded(known.data.rounds[{number}])"
            yield Case(
                f"(({{decoded, maskOf, agreement, bestOf, known}}) => {{ const one = {decode};"
                f" const share = agreement(maskOf(one, {T}), one.moves);"
                " return [share, bestOf(one).share >= share]; })(trinolabApplets.threshold)",
                [share, True],
                1e-12,
                0,
            )


def judge_cases(reader):
    """Pairs are judged by the truth, and no rule is better than the layout, as the text says."""
    totals = {}
    for shot in reader.known("pairs")["shots"]:
        left, right = map(np.array, shot["labels"])
        for name, pairs in shot["rules"].items():
            good = sum(left[a] == right[b] >= 0 for a, b in pairs)
            due = len((set(left) & set(right)) - {-1})
            expected = {"right": good, "wrong": len(pairs) - good, "due": due}
            yield Case(call("pairs.judged", shot, pairs), expected, 0, 0)
            totals[name] = totals.get(name, 0) + 2 * int(good) - len(pairs)
    assert max(totals, key=totals.get) == "the layout"


def next_cases(reader):
    """By how much guesses miss, and those of the filter, which are the package's, on average."""
    data = reader.known("nextplace")
    z = as_floats(data["places"])
    p = KalmanParameters(9.5e8, 1.5, 1200.0, 6000.0)
    track = image_track.track(np.arange(len(z)) / 30, z, p, False)
    rules = {
        "last place": z[7:22],
        "last place + last step": 2 * z[7:22] - z[6:21],
        "the filter": track.predicted.mean[8:23, :2],
    }
    scores = "(({scores, known}, guesses) => scores(known.data, guesses))"
    asked = f"{scores}(trinolabApplets.nextplace, {json.dumps((z[8:23] + [3.0, 4.0]).tolist())})"
    yield Case(f"{asked}.you", 5.0)
    missed = {name: np.hypot(*(rule - z[8:23]).T).mean() for name, rule in rules.items()}
    # the page's places are rounded to 0.1 px
    yield Case(asked, missed, 0, 0.1)


FORMULAS = {
    "cones": (cones_cases, chord_cases),
    "pixel": (pixel_cases,),
    "threshold": (threshold_cases,),
    "kalman": (gain_cases,),
    "nextplace": (next_cases,),
    "epipolar": (epipolar_cases, pair_cases),
    "pairs": (judge_cases,),
    "depth": (depth_cases, ellipse_cases),
    "pointing": (tool_cases, log_cases),
}


@pytest.fixture(scope="module", params=PAGES)
def name(request):
    """An applet's name: all tests of one applet come one after the other, on its page."""
    return request.param


def test_the_formulas_are_those_of_the_package(reader, name):
    """All of an applet in one call of the page."""
    reader.on(name)
    cases = [case for kind in FORMULAS[name] for case in kind(reader)]
    answers = reader.ask(f"[{', '.join(case.call for case in cases)}]")
    for found, case in zip(answers, cases, strict=True):
        agree(found, case.expected, case)


def test_logs_are_those_of_the_package(reader, tmp_path):
    reader.on("pointing")
    rng = np.random.default_rng(10)
    for k in range(CASES):
        text = reader.ask(call("pointing.csv", drawn_log(rng, k).to_dict("records")))
        (tmp_path / "page.csv").write_text(text, encoding="utf-8", newline="")
        pointing.write_log(pointing.read_log(tmp_path / "page.csv"), tmp_path / "ours.csv")
        assert (tmp_path / "ours.csv").read_text(encoding="utf-8") == text


def drawn_track(rng, k):
    """Times, points, and the parameters of a filter; one is hidden for a while, one starts with
    P = 0, one is refused by the gate.
    """
    times = np.arange(25) * [1 / 30, 0.1, 1 / 120][k % 3]
    uv = 600 + np.cumsum(rng.normal(0, 12, (25, 2)), axis=0)
    uv[12] += [400 * (k % 2), 0]
    uv[5 : 5 + k % 4] = np.nan
    speed = [0.0, 0.0] if k == 1 else [1200.0, 6000.0]
    return times, uv, KalmanParameters(10 ** rng.uniform(4, 13), rng.uniform(0.3, 30), *speed)


def filtered(reader, uv, dt, p, gated, printed=()):
    """What the applet's filter makes of points, a place a time."""
    given = {
        "uv": [None if np.isnan(one[0]) else list(one) for one in uv],
        "dt": dt,
        "q": p.jerk_intensity,
        "sigma": p.sigma_px,
        "velocitySigma": p.velocity_sigma,
        "accelerationSigma": p.acceleration_sigma,
        "gated": gated,
        "printed": dict.fromkeys(printed, True),
    }
    return reader.ask(call("kalman.compute", given))


def test_the_filter_is_that_of_the_package(reader):
    reader.on("kalman")
    rng = np.random.default_rng(5)
    refused = 0
    for k in range(CASES):
        times, uv, p = drawn_track(rng, k)
        way = image_track.track(times, uv, p, k % 2 == 1)
        found = filtered(reader, uv, times[1], p, k % 2 == 1)
        for kind, state in (("predicted", way.predicted), ("updated", way.updated)):
            means = as_floats([one[kind]["X"] for one in found])
            covariances = as_floats([one[kind]["P"] for one in found])
            # px beside px/s^2: rounding is relative to the largest mean, and to both deviations
            scale = np.abs(state.mean).max()
            np.testing.assert_allclose(means, state.mean, rtol=DIGITS, atol=1e-12 * scale)
            sigma = np.sqrt(np.einsum("kii->ki", state.covariance))
            both = sigma[:, :, None] * sigma[:, None, :]
            assert (np.abs(covariances - state.covariance) <= DIGITS * both).all()
        np.testing.assert_allclose(as_floats([one["nis"] for one in found]), way.nis, rtol=DIGITS)
        used = [one["used"] and not np.isnan(uv[n, 0]) for n, one in enumerate(found)]
        assert used == way.used.tolist()
        refused += sum(~way.used & ~np.isnan(uv[:, 0]))
        box = Window(0, 0, 110, 150)  # the size alone counts
        predicted = zip(way.predicted.mean[1:], way.predicted.covariance[1:], strict=True)
        for one, state in zip(found[1:], predicted, strict=True):
            window = image_track.search_window(kalman.State(*state), box, (1280, 1024), p)
            wanted = window and [window.u, window.v, window.width, window.height]
            assert (one["window"] or None) == wanted
    assert refused > 0


def printed_filter(uv, dt, p, gated, printed):
    """Eq. 9-15 in the paper's letters, those in `printed` as printed: the states, and what is seen
    of each P.
    """
    F, Q = kalman.constant_acceleration(dt), kalman.white_jerk(dt, p.jerk_intensity)
    H, R = np.eye(2, 6), p.sigma_px**2 * np.eye(2)
    gate = chi2.ppf(0.999, 1 if "eq12" in printed else 2)
    if "eq12" in printed:
        H, R = np.array([[1.0, 1, 0, 0, 0, 0]]), np.array([[2 * p.sigma_px**2]])
    X, P = kalman.initial_state(uv[0], p)
    before = P
    found = []
    for place in uv[1:]:
        X = F @ X
        predicted = F @ P @ (F if "eq10" in printed else F.T) + Q
        P = predicted
        S = H @ predicted @ H.T + R
        K = predicted @ H.T @ np.linalg.inv(S)
        r = (place.sum(keepdims=True) if "eq12" in printed else place) - H @ X
        used = not np.isnan(r).any() and (not gated or r @ np.linalg.inv(S) @ r <= gate)
        if used:
            X = X + K @ r
            rest = np.eye(6) - K @ H
            P = rest @ before if "eq14" in printed else rest @ predicted @ rest.T + K @ R @ K.T
        before = predicted
        found.append((X, P, used))
    return found


def least_eigenvalue(P):
    """Of the symmetric part, in units of its own deviations."""
    scale = np.sqrt(np.maximum(P.diagonal(), 1e-200))
    return np.linalg.eigvalsh((P + P.T) / 2 / scale[:, None] / scale)[0]


@pytest.mark.parametrize("printed", [("eq10",), ("eq12",), ("eq14",), ("eq10", "eq12", "eq14")])
def test_the_misprinted_filter_is_that_of_the_printed_equations(reader, printed):
    reader.on("kalman")
    rng = np.random.default_rng([15, len(printed), int(printed[0][2:])])
    faults = set()
    for k in range(CASES):
        dt = [1 / 30, 1 / 60][k % 2]
        uv = 600 + np.cumsum(rng.normal(0, 12, (15, 2)), axis=0)
        uv[5 : 5 + k % 3] = np.nan
        p = KalmanParameters(10 ** rng.uniform(5, 10), rng.uniform(1, 30), 1200.0, 6000.0)
        found = filtered(reader, uv, dt, p, k % 4 == 3, printed)[1:]
        expected = printed_filter(uv, dt, p, k % 4 == 3, printed)
        for one, (X, P, used) in zip(found, expected, strict=True):
            # the printed forms lose digits from step to step: where S nearly vanishes, six of sixteen
            for letter, state in (("X", X), ("P", P)):
                atol = 1e-5 * np.abs(state).max()
                np.testing.assert_allclose(one["updated"][letter], state, rtol=1e-5, atol=atol)
            assert one["used"] == used
            least = least_eigenvalue(P)
            if abs(least + 1e-6) > 1e-7:  # on the verge either is right
                assert (one["fault"] == "negative") == (least < -1e-6)
            faults.add(one["fault"])
    assert faults <= {None} if printed == ("eq12",) else "negative" in faults


# --- what the chapters' texts say of what is shown


def test_the_applet_s_rig_is_shipped_and_a_right_partner_may_look_less_alike(reader):
    """What the text says of the marker that the applet begins with."""
    cameras, corners, images = decoded(reader)
    for mine, theirs in zip(cameras, load_rig("raised_40deg").cameras, strict=True):
        np.testing.assert_allclose(mine.matrix, theirs.matrix)
        np.testing.assert_allclose(mine.centre, theirs.centre, atol=DIGITS)
    markers = [one["markers"] for one in reader.known("epipolar")["cameras"]]
    left, right = as_floats([markers[0][6]]), as_floats([markers[2][k] for k in (6, 7)])
    D = matching.epipolar_distances(cameras[0], cameras[2], left, right)[0]
    S = matching.ncc_matrix(images[0], images[2], left - corners[0], right - corners[2], 21)[0]
    assert D.max() < 2
    assert S[1] > S[0] > 0.5


def test_no_threshold_of_the_game_is_right_for_all_of_its_images(reader):
    rules = [one["rules"] for one in reader.known("threshold")["rounds"]]
    assert {one["the chapter's T"] for one in rules} == {15}
    share = reader.ask(
        "(({decoded, maskOf, agreement, known}) => known.data.rounds.map(decoded).map(one =>"
        " Object.values(one.rules).map(T => agreement(maskOf(one, T), one.moves))))"
        "(trinolabApplets.threshold)"
    )
    chapter, otsu = np.transpose(share)
    assert (chapter[:3] > otsu[:3]).all()
    assert (chapter[3:] < 0.6).all()
    assert (otsu > 0.85).all()


# --- how they are used


def test_applets_are_loaded_where_they_are():
    for page in set(PAGES.values()):
        text = (HTML / "notebooks" / f"{page}.html").read_text(encoding="utf-8")
        names = [name for name, where in PAGES.items() if where == page]
        places = re.findall(r'<div class="applet" data-applet="(\w+)".*?><p>(.*?)</p>', text)
        assert sorted(name for name, _ in places) == sorted(names)
        assert all("JavaScript" in words for _, words in places)  # what is read without it
        assert text.count("window.trinolabApplets = ") == 1
    other = (HTML / "notebooks" / "05_markers.html").read_text(encoding="utf-8")
    assert "applet" not in other


SMALLEST = """
(() => {
    const box = applet;
    const sizes = some => [...box.querySelectorAll(some)].map(one => one.getBoundingClientRect())
        .map(one => Math.min(one.width, one.height));
    const types = [...box.querySelectorAll('svg text, p, label, li, button, td, th')]
        .map(one => parseFloat(getComputedStyle(one).fontSize));
    const cut = [...box.querySelectorAll('svg[role=img]')].flatMap(svg => {
        const frame = svg.getBoundingClientRect();
        return [...svg.querySelectorAll('text')].filter(one => {
            const text = one.getBoundingClientRect();
            return text.left < frame.left - 1 || text.right > frame.right + 1;
        }).map(one => one.textContent);
    });
    const targets = sizes('button, select, input, .applet-handle, .applet-pad');
    return {target: Math.min(...targets), type: Math.min(...types), cut,
        wide: document.documentElement.scrollWidth - document.documentElement.clientWidth};
})()
"""


def test_at_400_px_all_is_large_enough_and_nothing_is_cut_off(reader, name):
    reader.on(name)
    reader.browser.resize(400)
    wait_until(lambda: reader.one("svg", "getBoundingClientRect().right") < 400)
    found = reader.ask(SMALLEST)
    reader.browser.resize(1280)
    wait_until(lambda: reader.one("svg", "getBoundingClientRect().width") > 500)
    assert found["target"] >= 24  # px, WCAG 2.2, 2.5.8
    assert found["type"] >= 12  # px: 9 pt
    assert (found["cut"], found["wide"]) == ([], 0)
    assert reader.browser.errors == []


def test_a_key_moves_a_slider_the_drawing_s_text_says_it_and_reset_takes_it_back(reader, name):
    if name in GAMES:
        return  # they have no sliders
    reader.on(name)

    def said():
        return reader.one("output"), reader.one("svg[role=img]", "getAttribute('aria-label')")

    first = said()
    reader.one("input[type=range]", "focus({preventScroll: true})")
    reader.browser.press("ArrowRight")
    second = said()
    assert second[0] != first[0]
    assert reader.one("input[type=range]", "getAttribute('aria-valuetext')") == second[0]
    # the outline of what has the focus
    assert reader.one("input[type=range]", "matches(':focus-visible')")
    if name != "pointing":  # there the drawing has no scale
        assert second[1] != first[1]
    reader.press_button("Reset")
    assert said() == first
    assert reader.browser.errors == []


@pytest.mark.parametrize(
    ("shown", "handle", "moves", "stays"),
    [
        ("cones", "above", ("x", "z"), ("y", "omega")),
        ("cones", "side", ("y", "z"), ("x", "beta1")),
        ("cones", "ccd1", ("beta1",), ("beta2", "x")),
        ("cones", "ccd2", ("beta2",), ("beta1", "x")),
        ("pixel", "threshold", ("T",), ("alpha",)),
        ("kalman", "observation", ("du", "dv"), ("q", "k")),
        ("epipolar", "left", ("u", "v"), ("s",)),
        ("epipolar", "right", ("s", "beside"), ("u", "v")),
        ("depth", "point", ("distance",), ("baseline",)),
        ("depth", "right", ("baseline",), ("distance",)),
    ],
)
def test_a_picture_is_dragged(reader, shown, handle, moves, stays):
    reader.on(shown)
    before = reader.values(*moves, *stays)
    place = f"[data-applet={shown}] [data-drag={handle}]"
    reader.can_be_held(place)
    reader.browser.drag(place, 30, -34)
    after = reader.values(*moves, *stays)
    assert [one for one in before if after[one] != before[one]] == list(moves)
    reader.press_button("Reset")
    assert reader.values(*moves, *stays) == before


def test_a_button_plays_and_stops_at_the_end(reader):
    reader.on("kalman")
    reader.press_button("Play")
    assert reader.one(".applet-play") == "Pause"
    assert reader.one(".applet-says", "getAttribute('aria-live')") == "off"
    wait_until(lambda: reader.one(".applet-play") == "Play")
    assert reader.values("k") == {"k": 39}
    assert reader.one(".applet-says", "getAttribute('aria-live')") == "polite"


STILL = """
    const asked = window.matchMedia.bind(window);
    window.matchMedia = query => (query.includes('reduced-motion') ? {matches: true} : asked(query));
"""


class Hand:
    """A finger on the pad, with a clock of its own: the events' times do not depend on how fast
    the machine is.
    """

    def __init__(self, browser):
        self._browser = browser
        self._at = browser.evaluate("Date.now() / 1000")
        self._place = (0.0, 0.0)

    def presses(self):
        self._place = self._browser.middle(".applet-pad")
        self._browser.touch("touchStart", *self._place, time_s=self._at)

    def waits(self, seconds):
        self._at += seconds

    def strokes(self, right_px):
        """Closes the clutch, moves, and opens it."""
        self.presses()
        self.waits(0.3)
        u, v = self._place
        self._browser.touch("touchMove", u + right_px, v, time_s=self._at)
        self.lifts()

    def lifts(self):
        self._browser.touch("touchEnd", time_s=self._at)

    def taps(self):
        self.presses()
        self.waits(0.08)
        self.lifts()


def test_the_pointing_task_is_played_to_its_end(reader, tmp_path):
    """At a scale of 4 with strokes of the clutch; the log is the package's, and holds what was
    played.
    """
    reader.on("pointing").ask(
        "const set = (name, value, kind) => {"
        " const one = applet.querySelector(`[name=${name}]`); one.value = value;"
        " one.dispatchEvent(new Event(kind, {bubbles: true})); };"
        "set('scale', 4, 'input'); set('delay', 0.05, 'input'); set('repeats', 2, 'change');"
    )
    reader.press_button("Start a run")
    assert "Trial 1 of 18" in reader.says()
    rng = np.random.default_rng(11)
    hand = Hand(reader.browser)
    played = []
    for distance, _ in pointing.conditions(repeats=2):
        pixels = np.round(distance / 4 / MM_PX) + rng.integers(-5, 6)
        first = np.round(pixels / 2)
        hand.waits(0.5)
        hand.strokes(first)
        hand.waits(0.2)
        hand.strokes(pixels - first)
        hand.waits(float(rng.uniform(0.1, 0.6)))
        hand.taps()
        played.append(4 * MM_PX * pixels - distance)
    text = reader.ask(
        "fetch(applet.querySelector('.applet-download').href).then(file => file.text())"
    )
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    log = pointing.read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log["error_mm"], played, atol=1e-5)  # six digits in the file
    for column, value in (("moves", 2), ("scale", 4), ("delay_s", 0.05)):
        assert (log[column] == value).all(), column
    found = pointing.performance(log)
    said = re.search(r"throughput ([\d.]+) bit/s, ([\d.]+) s a trial, (\d+) %", reader.says())
    assert float(said[1]) == pytest.approx(found.throughput_bit_s, abs=0.005)  # two digits
    assert float(said[2]) == pytest.approx(found.movement_s, abs=0.005)
    assert float(said[3]) == pytest.approx(100 * found.error_share, abs=0.5)
    assert reader.one(".applet-download", "download") == "pointing-1.csv"
    assert reader.ask("applet.querySelectorAll('details tbody tr').length") == 18
    assert reader.browser.errors == []


def test_the_task_is_done_by_keys_alone(reader):
    reader.on("pointing")
    reader.press_button("Start a run")
    assert reader.ask("document.activeElement.className") == "applet-pad"
    for key in ("Enter", "ArrowRight", "ArrowRight", "ArrowRight", "Enter"):
        reader.browser.press(key)
    # the first target is 40 mm away
    assert "ended 37.0 mm beside the middle" in reader.says()
    reader.press_button("Stop the run")


def test_the_next_place_is_pressed_and_typed(reader):
    z = as_floats(reader.known("nextplace")["places"])
    surface = "[data-applet=nextplace] .applet-surface"
    reader.can_be_held(surface)
    reader.browser.click(surface)  # the middle: the last place
    assert f"You were {np.hypot(*(z[8] - z[7])):.0f} px off" in reader.says()
    reader.one(".applet-surface", "focus()")
    reader.browser.press("ArrowRight")
    reader.browser.press("Enter")
    assert f"You were {np.hypot(*(z[9] - z[8] - [5, 0])):.0f} px off" in reader.says()
    for _ in range(13):
        reader.browser.press("Enter")
    assert "That was the last of 15 frames." in reader.says()
    assert reader.ask("applet.querySelectorAll('tbody tr').length") == 4


def test_spots_are_paired_by_pressing_them(reader):
    shot = reader.known("pairs")["shots"][0]
    spots = "[...applet.querySelectorAll('.applet-spots button')]"
    partner = len(shot["labels"][0]) + shot["labels"][1].index(shot["labels"][0][0])
    reader.ask(f"{spots}[0].click()")
    assert reader.ask(f"{spots}[0].getAttribute('aria-pressed')") == "true"
    reader.ask(f"{spots}[{partner}].click()")
    assert "Pairs so far: 1" in reader.says()
    reader.ask(f"{spots}[1].click(), {spots}[{partner}].click()")
    assert "Pairs so far: 1" in reader.says()  # a spot has one partner
    reader.ask(f"{spots}[0].click(), {spots}[{partner}].click()")
    reader.press_button("These are the pairs")
    mine = reader.one("tbody tr", "innerText").split()
    assert mine == ["you", "1", "0", str(len(set(shot["labels"][0]) - {-1}))]


def test_the_mask_is_painted(reader):
    reader.on("threshold")
    before = reader.says()
    easel = "[data-applet=threshold] .applet-easel"
    reader.can_be_held(easel)
    reader.browser.drag(easel, 30, 20)
    assert "by your painting" in reader.says() != before
    reader.press_button("This is the mask")
    assert "Image 2 of 5" in reader.says()
    reader.press_button("Reset")
    assert reader.says() == before


def test_who_wants_no_motion_gets_a_step(browser):
    browser.open((HTML / "notebooks" / "04_kalman.html").as_uri(), before=STILL)
    button = "document.querySelector('[data-applet=kalman] .applet-play')"
    place = "document.querySelector('[data-applet=kalman] [name=k]').value"
    before = int(browser.evaluate(place))
    browser.evaluate(f"{button}.click()")
    assert browser.evaluate(f"{button}.textContent") == "One step"
    assert int(browser.evaluate(place)) == before + 1
    browser.open("about:blank")  # whoever comes next has a page of its own
