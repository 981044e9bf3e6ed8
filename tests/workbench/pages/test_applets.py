"""The applets of the chapters in a browser: their numbers beside the package's, and how they are
used.

Both sides compute in double precision, by other orders of the same operations. A relative 1e-9 is a
million times what the rounding of a few dozen operations makes; where a tolerance is wider, the
reason stands beside it.
"""

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
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
from workbench.pages.browser import CHROMIUM, Browser
from workbench.paper.errata.workspace import printed_cones
from workbench.teleop import pointing

HTML = Path(__file__).resolve().parents[3] / "_build" / "html"
PAGES = {
    "cones": "02_workspace",
    "pixel": "03_background",
    "kalman": "04_kalman",
    "epipolar": "06_matching",
    "depth": "08_pose",
    "pointing": "11_master_slave",
    "threshold": "03_background",
    "nextplace": "04_kalman",
    "pairs": "06_matching",
}
CASES = 10
DIGITS = 1e-9
MM_PX = 25.4 / 96  # of the page's pixels
pytestmark = [
    pytest.mark.skipif(
        not (HTML / "index.html").exists(), reason="no built pages: run make book first"
    ),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"),
]


class Reader:
    """A browser that stays on a page as long as its applet is asked for."""

    def __init__(self, folder):
        self.browser = Browser(folder)
        self._page = ""

    def on(self, name):
        """The page of an applet."""
        if self._page != PAGES[name]:
            self.browser.open((HTML / "notebooks" / f"{PAGES[name]}.html").as_uri())
            # The theme scrolls smoothly: what is pressed would still be on its way.
            self.browser.evaluate("document.documentElement.style.scrollBehavior = 'auto'")
            self._page = PAGES[name]
        self.browser.evaluate(
            f"globalThis.applet = document.querySelector('.applet[data-applet={name}]'); null"
        )
        return self

    def computes(self, function, argument):
        """What a function of the applets gives, `function` as ``name.function``."""
        return self.browser.evaluate(f"trinolabApplets.{function}({json.dumps(argument)})")

    def one(self, selector, what="textContent"):
        """A property of the first element of the applet that is selected."""
        return self.browser.evaluate(f"applet.querySelector({json.dumps(selector)}).{what}")

    def can_be_held(self, selector):
        """Wait until the middle of an element lies open in the window, and nothing is over it."""
        at = "document.elementFromPoint({}, {})?.matches({})"
        wait_until(
            lambda: self.browser.evaluate(
                at.format(*self.browser.middle(selector), json.dumps(selector))
            )
        )

    def says(self):
        return self.one(".applet-says", "innerText")

    def press_button(self, text):
        self.browser.evaluate(
            f"[...applet.querySelectorAll('button')]"
            f".find(one => one.textContent.startsWith({json.dumps(text)})).click()"
        )


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    reader = Reader(tmp_path_factory.mktemp("profile"))
    yield reader
    reader.browser.close()


def as_floats(value):
    """An answer of the page as an array; what is no number there is null here."""
    return np.array(value, dtype=float)


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


def moved_by_a_key(reader, name):
    """A key moves a slider, the drawing's text says it, and Reset takes it back."""
    assert reader.browser.errors == []
    first = reader.one("output"), reader.one("svg[role=img]", "getAttribute('aria-label')")
    reader.one("input[type=range]", "focus({preventScroll: true})")
    reader.browser.press("ArrowRight")
    second = reader.one("output"), reader.one("svg[role=img]", "getAttribute('aria-label')")
    assert second[0] != first[0]
    assert reader.one("input[type=range]", "getAttribute('aria-valuetext')") == second[0]
    # the outline of what has the focus
    assert reader.one("input[type=range]", "matches(':focus-visible')")
    if name != "pointing":  # there the drawing has no scale
        assert second[1] != first[1]
    reader.press_button("Reset")
    again = reader.one("output"), reader.one("svg[role=img]", "getAttribute('aria-label')")
    assert again == first


def shown_on_a_phone(reader):
    """At 400 px all is large enough, and nothing is cut off."""
    reader.browser.resize(400)
    narrow = "applet.querySelector('svg').getBoundingClientRect().right < 400"
    wait_until(lambda: reader.browser.evaluate(narrow))
    found = reader.browser.evaluate(SMALLEST)
    reader.browser.resize(1280)
    wide = "applet.querySelector('svg').getBoundingClientRect().width > 500"
    wait_until(lambda: reader.browser.evaluate(wide))
    assert found["target"] >= 24  # px, WCAG 2.2, 2.5.8
    assert found["type"] >= 12  # px: 9 pt
    assert found["cut"] == []
    assert found["wide"] == 0


def is_used(reader, name):
    """An applet by keys, and on a phone."""
    reader.on(name)
    moved_by_a_key(reader, name)
    shown_on_a_phone(reader)
    assert reader.browser.errors == []


def drawn_cones(rng):
    """beta_1, beta_2, omega, deg, and a point: the sliders' ends, and some in between."""
    ends = [(30, 30, 4), (75, 75, 30), (30, 75, 30), (75, 30, 4)]
    inner = rng.uniform((30, 30, 4), (75, 75, 30), (CASES - len(ends), 3))
    return [(angles, rng.uniform((-0.5, -1, 0), (1.5, 2, 3.6))) for angles in [*ends, *inner]]


def test_the_cones_are_those_of_the_package(reader):
    reader.on("cones")
    for (beta1, beta2, omega), point in drawn_cones(np.random.default_rng(1)):
        given = {"beta1_deg": beta1, "beta2_deg": beta2, "omega_deg": omega, "point": list(point)}
        found = reader.computes("cones.compute", given)
        trio = cones.paper_cones(1.0, *np.deg2rad([beta1, beta2, omega]))
        for cone, here in zip(trio, found["cones"], strict=True):
            np.testing.assert_allclose(here["apex"], cone.apex, rtol=DIGITS, atol=DIGITS)
            np.testing.assert_allclose(here["axis"], cone.axis, rtol=DIGITS, atol=DIGITS)
        expected = [bool(cones.inside([cone], [point])[0]) for cone in trio]
        assert found["inside"] == expected
        toward = [point - cone.apex for cone in trio]
        angles = [
            np.rad2deg(np.arccos(one @ cone.axis / np.linalg.norm(one)))
            for one, cone in zip(toward, trio, strict=True)
        ]
        np.testing.assert_allclose(found["angles_deg"], angles, rtol=DIGITS)
        # A sum over directions 1/120 apart, of a surface that has edges: of these cases the worst is
        # off by 1.1e-4; with half as many directions by 4.4e-4, with twice as many by 0.4e-4.
        assert found["volume"] == pytest.approx(workspace.intersect(trio).volume, rel=3e-4)


def test_lines_through_a_cone_end_where_the_package_says(reader):
    reader.on("cones")
    rng = np.random.default_rng(2)
    apex, axis = np.array([0.2, -0.1, 0.3]), np.array([0.0, 0.6, 0.8])
    cone = cones.Cone(apex, axis, 0.4)
    # from the apex, from inside, from behind; along the axis, across it, along a generator
    starts = [apex, apex + axis, apex - axis, *rng.normal(size=(CASES - 3, 3))]
    directions = [axis, rng.normal(size=3), -axis, *rng.normal(size=(CASES - 4, 3))]
    directions.append(cone.generators([1.0])[0])
    for start, direction in zip(starts, directions, strict=True):
        unit = direction / np.linalg.norm(direction)
        about = json.dumps({"apex": list(apex), "axis": list(axis), "omega": 0.4})
        call = f"trinolabApplets.cones.chord({about}, {json.dumps(list(start))}, {json.dumps(list(unit))})"
        found = reader.browser.evaluate(f"{call}.map(String)")
        expected = [float(one[0]) for one in cones.chord(cone, start, unit[None])]
        low, high = (float(one.replace("Infinity", "inf")) for one in found)
        if expected[0] > expected[1]:  # it misses
            assert low > high
        elif np.abs(expected).max() < 1e9 or not np.isfinite(expected).all():
            np.testing.assert_allclose([low, high], expected, rtol=1e-7, atol=1e-9)


def test_the_cones_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "cones")


def test_a_pixel_has_the_history_that_the_package_gives_it(reader):
    reader.on("pixel")
    rng = np.random.default_rng(3)
    alphas = [0.0, 1.0, *rng.uniform(0.001, 0.5, CASES - 2)]
    for k, alpha in enumerate(alphas):
        levels = rng.uniform(0, 255, 60) if k < 5 else 45 + 30 * rng.standard_normal(60).cumsum()
        T = [0.0, 300.0, *rng.uniform(2, 44, CASES)][k]
        share = [0.0, 0.3][k % 2]
        slow = [None, 0.0, 0.001][k % 3]
        given = {
            "levels": list(levels),
            "alpha": alpha,
            "T": T,
            "shadowShare": share,
            "maskedRate": slow,
        }
        found = reader.computes("pixel.compute", given)
        B = np.array([[levels[0]]])
        before, moving = [], []
        for level in levels:
            frame = np.array([[level]])
            mask = background.difference(frame, B, T, share).mask
            before.append(float(B[0, 0]))
            moving.append(bool(mask[0, 0]))
            masked = {} if slow is None else {"mask": mask, "masked_rate": slow}
            B = background.update(B, frame, alpha, **masked)
        np.testing.assert_allclose(found["before"], before, rtol=DIGITS, atol=DIGITS)
        assert found["moving"] == moving
        assert found["last"] == pytest.approx(float(B[0, 0]), rel=DIGITS, abs=DIGITS)


def test_the_formula_says_how_long_a_jump_is_seen(reader):
    """A step of the grey level without noise, frame by frame through the package."""
    reader.on("pixel")
    rng = np.random.default_rng(4)
    jumps = [10.0, 15.0, *rng.uniform(16, 100, CASES - 2)]
    alphas = [0.01, 0.01, 0.9, *rng.uniform(0.005, 0.5, CASES - 3)]
    for jump, alpha in zip(jumps, alphas, strict=True):
        B, count = np.array([[45.0]]), 0
        frame = B + jump
        while background.difference(frame, B, 15.0).mask[0, 0]:
            B = background.update(B, frame, alpha)
            count += 1
        given = {"jump": jump, "alpha": alpha, "T": 15.0}
        frames = 30 * reader.computes("pixel.secondsSeen", given)
        assert count - 1 - DIGITS < frames <= count + DIGITS


def test_the_pixel_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "pixel")


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


def test_the_filter_is_that_of_the_package(reader):
    reader.on("kalman")
    rng = np.random.default_rng(5)
    refused = 0
    for k in range(CASES):
        times, uv, p = drawn_track(rng, k)
        gated = k % 2 == 1
        way = image_track.track(times, uv, p, gated)
        given = {
            "uv": [None if np.isnan(one[0]) else list(one) for one in uv],
            "dt": times[1],
            "q": p.jerk_intensity,
            "sigma": p.sigma_px,
            "velocitySigma": p.velocity_sigma,
            "accelerationSigma": p.acceleration_sigma,
            "gated": gated,
        }
        found = reader.computes("kalman.compute", given)
        for kind, state in (("predicted", way.predicted), ("updated", way.updated)):
            means = as_floats([one[kind]["X"] for one in found])
            covariances = as_floats([one[kind]["P"] for one in found])
            # px beside px/s^2: rounding is relative to the largest mean, and to both deviations
            scale = np.abs(state.mean).max()
            np.testing.assert_allclose(means, state.mean, rtol=DIGITS, atol=1e-12 * scale)
            sigma = np.sqrt(np.einsum("kii->ki", state.covariance))
            both = sigma[:, :, None] * sigma[:, None, :]
            assert (np.abs(covariances - state.covariance) <= DIGITS * both).all()
        nis = [np.nan if one["nis"] is None else one["nis"] for one in found]
        np.testing.assert_allclose(nis, way.nis, rtol=DIGITS)
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


def test_the_gain_does_not_depend_on_what_is_seen(reader):
    """By hand for the first correction: K = p / (p + sigma^2), of the variance p that is
    predicted.
    """
    reader.on("kalman")
    dt, q, sigma = 0.1, 100.0, 2.0
    given = {"dt": dt, "q": q, "sigma": sigma, "velocitySigma": 3.0, "accelerationSigma": 5.0}
    gains = []
    for second in (11.0, 250.0):
        found = reader.computes(
            "kalman.compute", {**given, "uv": [[10.0, 20.0], [second, 21.0]], "gated": False}
        )
        gains.append(found[1]["K"][0][0])
    p = sigma**2 + (3.0 * dt) ** 2 + (5.0 * dt**2 / 2) ** 2 + q * dt**5 / 20
    assert gains[0] == gains[1] == pytest.approx(p / (p + sigma**2), rel=1e-12)


def test_the_kalman_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "kalman")


def decoded(reader):
    """The epipolar applet's cameras as the package's, the corners of their parts, and the greys."""
    data = reader.browser.evaluate("trinolabApplets.epipolar.known.data.cameras")
    greys = reader.browser.evaluate(
        "trinolabApplets.epipolar.known.data.cameras.map(one => [...trinolabApplets.epipolar.decoded(one).image.grey])"
    )
    cameras, corners, images = [], [], []
    for about, grey in zip(data, greys, strict=True):
        turn = Rotation.from_matrix(about["rotation"])
        T = RigidTransform.from_components(about["translation"], turn)
        cameras.append(Camera(about["name"], (1280, 1024), about["matrix"], np.zeros(5), T))
        corners.append(np.array(about["corner"]))
        images.append(np.array(grey, np.uint8).reshape(about["size"][::-1]))
    return cameras, corners, images


def test_lines_and_correlations_are_those_of_the_package(reader):
    reader.on("epipolar")
    cameras, corners, images = decoded(reader)
    shipped = load_rig("raised_40deg").cameras
    for mine, theirs in zip(cameras, shipped, strict=True):
        np.testing.assert_allclose(mine.matrix, theirs.matrix)
        np.testing.assert_allclose(mine.centre, theirs.centre, atol=DIGITS)
    rng = np.random.default_rng(6)
    for k in range(CASES):
        right = 1 + k % 2
        # in 64ths of a pixel: so OpenCV interpolates without rounding, in its single precision
        places = rng.integers(0, 159 * 64, (2, 2)) / 64
        if k < 2:
            places[k] = [0.0, 199.0]  # a corner of the part: beyond it the last pixel repeats
        uv = [places[0] + corners[0], places[1] + corners[right]]
        call = f"""
        (() => {{
            const [left, , ] = trinolabApplets.epipolar.known.data.cameras.map(trinolabApplets.epipolar.decoded);
            const right = trinolabApplets.epipolar.decoded(trinolabApplets.epipolar.known.data.cameras[{right}]);
            return trinolabApplets.epipolar.compute({{left, right, windowPx: 21,
                uvLeft: {json.dumps(uv[0].tolist())}, uvRight: {json.dumps(uv[1].tolist())}}});
        }})()
        """
        found = reader.browser.evaluate(call)
        pair = cameras[0], cameras[right]
        line = epipolar_lines(*pair, uv[:1])[0]
        np.testing.assert_allclose(found["line"], line, rtol=DIGITS, atol=1e-9)
        D = matching.epipolar_distances(*pair, uv[:1], uv[1:])[0, 0]
        assert found["D"] == pytest.approx(D, rel=DIGITS, abs=1e-9)
        S = matching.ncc_matrix(images[0], images[right], places[:1], places[1:], 21)[0, 0]
        assert found["S"] == pytest.approx(S, abs=DIGITS)
        assert found["S"] == pytest.approx(
            matching.ncc(*(np.reshape(one, (21, 21)) for one in found["windows"])), abs=DIGITS
        )


def test_the_epipolar_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "epipolar")


def test_flat_windows_have_no_correlation_and_the_chapter_has_its_four_fifths(reader):
    reader.on("epipolar")
    ask = reader.browser.evaluate
    assert ask("trinolabApplets.epipolar.correlation([1, 2, 3, 4], [1, 3, 2, 4])") == (
        pytest.approx(0.8, rel=1e-12)
    )
    assert ask("trinolabApplets.epipolar.correlation([7, 7, 7, 7], [1, 3, 2, 4])") == 0
    left, right = load_rig("paper_pair").cameras
    about = [
        {
            "matrix": one.matrix.tolist(),
            "rotation": one.T_cam_world.rotation.as_matrix().tolist(),
            "translation": one.T_cam_world.translation.tolist(),
        }
        for one in (left, right)
    ]
    both = ", ".join(map(json.dumps, about))
    F = as_floats(ask(f"trinolabApplets.epipolar.fundamentalMatrix({both})"))
    expected = fundamental_matrix(left, right)
    np.testing.assert_allclose(F / np.linalg.norm(F), expected, rtol=1e-7, atol=1e-12)


def test_windows_are_dragged_in_the_images(reader):
    """The left one with the mouse, the right one with a finger."""
    reader.on("epipolar")
    before = [reader.one(f"input[name={name}]", "value") for name in ("u", "v", "s", "beside")]
    reader.can_be_held("[data-drag=left]")
    reader.browser.drag("[data-drag=left]", 20, -10)
    reader.can_be_held("[data-drag=right]")
    u, v = reader.browser.middle("[data-drag=right]")
    reader.browser.touch("touchStart", u, v)
    reader.browser.touch("touchMove", u, v + 20)
    reader.browser.touch("touchMove", u, v + 40)
    reader.browser.touch("touchEnd")
    after = [reader.one(f"input[name={name}]", "value") for name in ("u", "v", "s", "beside")]
    moved = as_floats(after) - as_floats(before)
    zoom = 2.0  # of the images at least, in a window of 1280 px
    assert 20 / 2.4 - 1 <= moved[0] <= 20 / zoom
    assert -10 / zoom <= moved[1] <= -10 / 2.4 + 1
    assert moved[2] > 40 / 2.4 - 1  # the line of CCD3 runs down
    reader.press_button("Reset")


def test_a_right_partner_may_look_less_alike_than_a_wrong_one(reader):
    """What the chapter's text says of the marker that the applet begins with."""
    reader.on("epipolar")
    cameras, corners, images = decoded(reader)
    markers = reader.browser.evaluate(
        "trinolabApplets.epipolar.known.data.cameras.map(one => one.markers)"
    )
    left = as_floats([markers[0][6]])
    right = as_floats([markers[2][k] for k in (6, 7)])
    D = matching.epipolar_distances(cameras[0], cameras[2], left, right)[0]
    S = matching.ncc_matrix(images[0], images[2], left - corners[0], right - corners[2], 21)[0]
    assert D.max() < 2
    assert S[1] > S[0] > 0.5


def ideal_pair(baseline_mm, vergence_deg, focal_px):
    """The depth applet's cameras as the package's."""
    matrix = [[focal_px, 0, 0], [0, focal_px, 0], [0, 0, 1]]
    cameras = []
    for name, sign in (("left", -1), ("right", 1)):
        turn = Rotation.from_euler("y", -sign * vergence_deg / 2, degrees=True)
        T = RigidTransform.from_components([sign * baseline_mm / 2, 0, 0], turn).inv()
        cameras.append(Camera(name, (1280, 1024), matrix, np.zeros(5), T))
    return cameras


def test_the_error_of_depth_is_that_of_the_package(reader):
    reader.on("depth")
    rng = np.random.default_rng(7)
    ends = [(20, 0, 900, 0.01), (400, 60, 300, 2.0), (99.2, 10.5, 568, 0.1)]
    inner = rng.uniform((20, 0, 300, 0.01), (400, 60, 900, 2), (CASES - len(ends), 4))
    for baseline, vergence, distance, sigma in [*ends, *inner]:
        cameras = ideal_pair(baseline, vergence, 2940.0)
        found = reader.computes(
            "depth.compute",
            {
                "baseline_mm": baseline,
                "vergence_deg": vergence,
                "distance_mm": distance,
                "sigma_px": sigma,
                "focal_px": 2940,
                "width_px": 1280,
            },
        )
        uv = np.stack([one.project([[0.0, 0.0, distance]]) for one in cameras])
        np.testing.assert_allclose(found["pixels"], uv[:, 0], rtol=DIGITS, atol=1e-9)
        covariance = triangulation.triangulation_covariance(Rig(cameras), uv, sigma)[0]
        # Differences over 2e-3 px of numbers rounded to 1e-13 mm: 5e-11 mm/px, of slopes from 0.05 on.
        # Where symmetry makes a covariance zero, the square of that is left.
        atol = 1e-8 * sigma**2
        np.testing.assert_allclose(found["covariance"], covariance, rtol=1e-8, atol=atol)
        assert found["seen"] == bool((np.abs(uv[:, 0, 0]) <= 640).all())


def test_the_depth_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "depth")


def test_points_of_two_pixels_are_those_of_the_package(reader):
    reader.on("depth")
    rng = np.random.default_rng(8)
    cameras = ideal_pair(150.0, 20.0, 2940.0)
    about = reader.computes(
        "depth.compute",
        {
            "baseline_mm": 150,
            "vergence_deg": 20,
            "distance_mm": 500,
            "sigma_px": 1,
            "focal_px": 2940,
            "width_px": 1280,
        },
    )["cameras"]
    behind = 0
    for k in range(CASES):
        uv = rng.uniform(-600, 600, (2, 2))
        if k == 0:
            uv = np.array([[-600.0, 0.0], [600.0, 0.0]])  # rays that part
        pixels = [json.dumps(one.tolist()) for one in uv]
        found = reader.browser.evaluate(
            f"trinolabApplets.depth.triangulate({json.dumps(about)}, {', '.join(pixels)})"
        )
        expected = triangulation.triangulate_pair(*cameras, uv[:1], uv[1:])[0]
        if np.isnan(expected[0]):
            behind += 1
            assert found is None
        else:
            np.testing.assert_allclose(found, expected, rtol=DIGITS, atol=1e-9)
    assert 0 < behind < CASES


def test_the_tool_follows_the_hand_as_the_mapping_lets_it(reader):
    """Strokes of the clutch, and a filter that is taken out of the way by a very high cutoff."""
    reader.on("pointing")
    rng = np.random.default_rng(9)
    for k in range(CASES):
        scale = [0.5, 4.0, *rng.uniform(0.5, 4, CASES)][k]
        hand = np.cumsum(rng.normal(0, 2, 40))
        closed = [True] * 40 if k == 0 else [False] * 40 if k == 1 else list(rng.random(40) < 0.7)
        closed = [bool(one) for one in closed]
        p = mapping.MappingParameters(scale, filtering=OneEuroParameters(1e9, 1e9))
        state = mapping.State(0.0, RigidTransform.identity())
        tools = []
        for n in range(40):
            T = RigidTransform.from_translation([hand[n], 0, 0])
            state = mapping.step(state, mapping.Sample((n + 1) / 30, T, "measured", closed[n]), p)
            tools.append(state.target.translation[0])
        samples = [{"hand": h, "closed": c} for h, c in zip(hand, closed, strict=True)]
        found = reader.computes("pointing.follow", {"scale": scale, "samples": samples})
        # the filter leaves 5e-9 of a step of some mm
        np.testing.assert_allclose(found, tools, rtol=0, atol=1e-6)


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.5, 4.0])
def test_the_hand_that_plays_brings_the_tool_to_its_target(reader, scale):
    """In strokes of the clutch that are no longer than a hand reaches."""
    reader.on("pointing")
    samples = reader.computes("pointing.demonstration", {"scale": scale, "until": 8})
    tools = reader.computes("pointing.follow", {"scale": scale, "samples": samples})
    assert tools[-1] == pytest.approx(120)
    assert max(one["hand"] for one in samples) <= 60 + DIGITS
    assert np.abs(np.diff([one["hand"] for one in samples])).max() < 3  # mm in 20 ms
    closings = np.diff([float(one["closed"]) for one in samples]) > 0
    assert closings.sum() + 1 == np.ceil(120 / (60 * scale))


def test_the_pad_plays_by_itself_until_it_is_pressed(reader):
    browser = reader.on("pointing").browser
    reader.press_button("Reset")
    reader.press_button("Play")
    wait_until(lambda: "the hand is at" in reader.says())
    assert browser.evaluate("applet.querySelector('svg circle.four') !== null")
    Hand(browser).taps()
    assert browser.evaluate("applet.querySelector('[name=until]').value") == "0"
    assert reader.one(".applet-play", "textContent") == "Play"
    assert "No run yet" in reader.says() or "throughput" in reader.says()
    assert browser.errors == []


def test_the_pointing_applet_is_used_by_keys_and_on_a_phone(reader):
    is_used(reader, "pointing")


def drawn_log(rng, k):
    trials = pointing.conditions(repeats=[1, 2, 3, 5][k % 4])
    begin = np.cumsum(rng.uniform(2, 4, len(trials)))
    log = pd.DataFrame(
        {
            "task": np.arange(len(trials)),
            "operator": ['a, "b"', "person", "Zoë"][k % 3],
            "scale": rng.uniform(0.5, 4),
            "delay_s": 0.025 * k,
            "distance_mm": trials[:, 0],
            "width_mm": trials[:, 1],
            "start_s": begin,
            "end_s": begin + rng.uniform(0.3, 1.9, len(trials)),
            "error_mm": rng.normal(0, 4, len(trials)) * (k != 3),
            "moves": rng.integers(1, 5, len(trials)),
        }
    )
    return log.round(6)


def test_logs_and_throughputs_are_those_of_the_package(reader, tmp_path):
    reader.on("pointing")
    rng = np.random.default_rng(10)
    for k in range(CASES):
        log = drawn_log(rng, k)
        found = reader.computes("pointing.performance", log.to_dict("records"))
        for name, value in pointing.performance(log)._asdict().items():
            here = np.nan if found[name] is None else found[name]
            assert here == pytest.approx(value, rel=DIGITS, nan_ok=True), name
        text = reader.computes("pointing.csv", log.to_dict("records"))
        (tmp_path / "page.csv").write_text(text, encoding="utf-8", newline="")
        pointing.write_log(pointing.read_log(tmp_path / "page.csv"), tmp_path / "ours.csv")
        assert (tmp_path / "ours.csv").read_text(encoding="utf-8") == text
    for repeats in (1, 3):
        expected = pointing.conditions(repeats=repeats).tolist()
        assert reader.computes("pointing.conditions", repeats) == expected
    assert reader.browser.evaluate("trinolabApplets.pointing.difficulty(40, 5)") == pytest.approx(
        float(pointing.difficulty(40, 5)), rel=DIGITS
    )


def test_a_late_picture_shows_the_tool_of_so_long_ago(reader):
    reader.on("pointing")
    history = "[[0, 0], [100, 1], [200, 2], [300, 3]]"
    asked = [(300, 0), (300, 150), (299, 100), (50, 100), (700, 100)]
    shown = [
        reader.browser.evaluate(f"trinolabApplets.pointing.shownAt({history}, {t}, {delay})")
        for t, delay in asked
    ]
    assert shown == [3, 1, 1, 0, 3]


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

    def goes(self, right_px):
        u, v = self._place
        self._place = (u + right_px, v)
        self._browser.touch("touchMove", *self._place, time_s=self._at)

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
    browser = reader.on("pointing").browser
    browser.evaluate(
        "const set = (name, value, kind) => {"
        " const one = applet.querySelector(`[name=${name}]`); one.value = value;"
        " one.dispatchEvent(new Event(kind, {bubbles: true})); };"
        "set('scale', 4, 'input'); set('delay', 0.05, 'input'); set('repeats', 2, 'change');"
    )
    reader.press_button("Start a run")
    assert "Trial 1 of 18" in reader.says()
    rng = np.random.default_rng(11)
    hand = Hand(browser)
    played = []
    for distance, _ in pointing.conditions(repeats=2):
        pixels = np.round(distance / 4 / MM_PX) + rng.integers(-5, 6)
        first = np.round(pixels / 2)
        hand.waits(0.5)
        hand.presses()
        hand.waits(0.3)
        hand.goes(first)
        hand.lifts()
        hand.waits(0.2)
        hand.presses()
        hand.waits(0.3)
        hand.goes(pixels - first)
        hand.lifts()
        hand.waits(float(rng.uniform(0.1, 0.6)))
        hand.taps()
        played.append(4 * MM_PX * pixels - distance)
    assert "throughput" in reader.says()
    text = browser.evaluate(
        "fetch(applet.querySelector('.applet-download').href).then(file => file.text())"
    )
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    log = pointing.read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log["error_mm"], played, atol=1e-5)  # six digits in the file
    assert (log["moves"] == 2).all()
    assert (log["scale"] == 4).all()
    assert (log["delay_s"] == 0.05).all()
    found = pointing.performance(log)
    said = re.search(r"throughput ([\d.]+) bit/s, ([\d.]+) s a trial, (\d+) %", reader.says())
    assert float(said[1]) == pytest.approx(found.throughput_bit_s, abs=0.005)  # two digits
    assert float(said[2]) == pytest.approx(found.movement_s, abs=0.005)
    assert float(said[3]) == pytest.approx(100 * found.error_share, abs=0.5)
    assert reader.one(".applet-download", "download") == "pointing-1.csv"
    rows = browser.evaluate("applet.querySelectorAll('details tbody tr').length")
    assert rows == 18
    assert reader.browser.errors == []


def test_the_task_is_done_by_keys_alone(reader):
    browser = reader.on("pointing").browser
    reader.press_button("Reset")
    reader.press_button("Start a run")
    assert browser.evaluate("document.activeElement.className") == "applet-pad"
    browser.press("Enter")
    for _ in range(3):
        browser.press("ArrowRight")
    browser.press("Enter")
    # the first target is 40 mm away
    assert "ended 37.0 mm beside the middle" in reader.says()
    reader.press_button("Stop the run")


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


def test_a_button_plays_and_stops_at_the_end(reader):
    reader.on("kalman")
    reader.press_button("Play")
    label = "applet.querySelector('.applet-play').textContent"
    assert reader.browser.evaluate(label) == "Pause"
    assert reader.one(".applet-says", "getAttribute('aria-live')") == "off"
    wait_until(lambda: reader.browser.evaluate(label) == "Play")
    assert reader.one("[name=k]", "value") == "39"
    assert reader.one(".applet-says", "getAttribute('aria-live')") == "polite"
    reader.press_button("Reset")


def test_who_wants_no_motion_gets_a_step(tmp_path):
    still = """
        const asked = window.matchMedia.bind(window);
        window.matchMedia = query => (query.includes('reduced-motion') ? {matches: true} : asked(query));
    """
    browser = Browser(tmp_path)
    try:
        browser.open((HTML / "notebooks" / "04_kalman.html").as_uri(), before=still)
        button = "document.querySelector('[data-applet=kalman] .applet-play')"
        place = "document.querySelector('[data-applet=kalman] [name=k]').value"
        before = int(browser.evaluate(place))
        browser.evaluate(f"{button}.click()")
        assert browser.evaluate(f"{button}.textContent") == "One step"
        assert int(browser.evaluate(place)) == before + 1
    finally:
        browser.close()


@pytest.mark.parametrize(
    ("name", "handle", "moves", "stays"),
    [
        ("cones", "above", ("x", "z"), ("y", "omega")),
        ("cones", "side", ("y", "z"), ("x", "beta1")),
        ("cones", "ccd1", ("beta1",), ("beta2", "x")),
        ("cones", "ccd2", ("beta2",), ("beta1", "x")),
        ("pixel", "threshold", ("T",), ("alpha",)),
        ("kalman", "observation", ("du", "dv"), ("q", "k")),
        ("depth", "point", ("distance",), ("baseline",)),
        ("depth", "right", ("baseline",), ("distance",)),
    ],
)
def test_a_picture_is_dragged(reader, name, handle, moves, stays):
    reader.on(name)
    reader.press_button("Reset")
    value = "applet.querySelector('[name={}]').value"
    before = {one: reader.browser.evaluate(value.format(one)) for one in (*moves, *stays)}
    place = f"[data-applet={name}] [data-drag={handle}]"
    reader.can_be_held(place)
    reader.browser.drag(place, 30, -34)
    after = {one: reader.browser.evaluate(value.format(one)) for one in before}
    assert [one for one in before if after[one] != before[one]] == list(moves)
    reader.press_button("Reset")
    assert {one: reader.browser.evaluate(value.format(one)) for one in before} == before


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
        given = {
            "uv": [None if np.isnan(one[0]) else list(one) for one in uv],
            "dt": dt,
            "q": p.jerk_intensity,
            "sigma": p.sigma_px,
            "velocitySigma": 1200.0,
            "accelerationSigma": 6000.0,
            "gated": k % 4 == 3,
            "printed": dict.fromkeys(printed, True),
        }
        found = reader.computes("kalman.compute", given)[1:]
        expected = printed_filter(uv, dt, p, k % 4 == 3, printed)
        for one, (X, P, used) in zip(found, expected, strict=True):
            # the printed forms lose digits from step to step: where S nearly vanishes, six of sixteen
            np.testing.assert_allclose(
                one["updated"]["X"], X, rtol=1e-5, atol=1e-5 * np.abs(X).max()
            )
            np.testing.assert_allclose(
                one["updated"]["P"], P, rtol=1e-5, atol=1e-5 * np.abs(P).max()
            )
            assert one["used"] == used
            least = least_eigenvalue(P)
            if abs(least + 1e-6) > 1e-7:  # on the verge either is right
                assert (one["fault"] == "negative") == (least < -1e-6)
            faults.add(one["fault"])
    assert faults <= {None} if printed == ("eq12",) else "negative" in faults


def test_ccd3_as_printed_looks_along_the_baseline_and_the_three_share_nothing(reader):
    reader.on("cones")
    rng = np.random.default_rng(16)
    for (beta1, beta2, omega), point in drawn_cones(rng):
        given = {"beta1_deg": beta1, "beta2_deg": beta2, "omega_deg": omega, "point": list(point)}
        found = reader.computes("cones.compute", {**given, "printed3": True})
        angles = np.deg2rad([beta1, beta2, omega])
        third = printed_cones(1.0, *angles)[2]
        np.testing.assert_allclose(found["cones"][2]["apex"], third.apex, atol=DIGITS)
        np.testing.assert_allclose(found["cones"][2]["axis"], third.axis, atol=DIGITS)
        first, second, _ = cones.paper_cones(1.0, *angles)
        assert found["volume"] == workspace.intersect([first, second, third]).volume == 0
        assert found["inside"][2] == bool(cones.inside([third], [point])[0])


def test_the_ellipse_grows_with_the_error_and_with_nothing_else(reader):
    reader.on("depth")
    rng = np.random.default_rng(17)
    for _ in range(CASES):
        A = rng.normal(size=(3, 3)) * [0.01, 0.01, 0.1]
        covariance = A @ A.T
        enlarged = 10 ** rng.uniform(0, 3)
        arguments = map(json.dumps, ([0, 0, 500.0], covariance.tolist(), enlarged))
        outline = as_floats(
            reader.browser.evaluate(f"trinolabApplets.depth.ellipse({', '.join(arguments)})")
        )
        away = (outline - [0, 500]) / enlarged
        seen = covariance[np.ix_([0, 2], [0, 2])]
        squared = np.einsum("ki,ij,kj->k", away, np.linalg.inv(seen), away)
        np.testing.assert_allclose(squared, 1, rtol=1e-6)  # of numbers beside 500
    outline = []
    for baseline in (300, 100, 30):
        given = {"baseline_mm": baseline, "vergence_deg": 10, "distance_mm": 568, "sigma_px": 0.1}
        call = json.dumps({**given, "focal_px": 2940, "width_px": 1280})
        points = reader.browser.evaluate(
            f"(one => trinolabApplets.depth.ellipse(one.point, one.covariance, 500))"
            f"(trinolabApplets.depth.compute({call}))"
        )
        outline.append(np.ptp(as_floats(points)[:, 1]))
    assert outline[0] < outline[1] < outline[2]


def test_eq_18_as_printed(reader):
    """A window that begins at its place, and a last sum over y' alone."""
    reader.on("epipolar")
    _, corners, images = decoded(reader)
    rng = np.random.default_rng(18)
    for k in range(CASES):
        right = 1 + k % 2
        places = rng.integers(0, 139 * 64, (2, 2)) / 64
        uv = json.dumps([(places[0] + corners[0]).tolist(), (places[1] + corners[right]).tolist()])
        call = """
        (([uvLeft, uvRight], k, eq18) => {
            const {known: {data}, decoded, compute} = trinolabApplets.epipolar;
            const [left, right] = [0, k].map(one => decoded(data.cameras[one]));
            return compute({left, right, windowPx: 21, uvLeft, uvRight, eq18}).S;
        })"""
        by_corner = reader.browser.evaluate(f"{call}({uv}, {right}, 'corner')")
        expected = matching.ncc_matrix(images[0], images[right], places[:1], places[1:] + 10, 21)
        assert by_corner == pytest.approx(expected[0, 0], abs=DIGITS)
        found = reader.browser.evaluate(f"{call}({uv}, {right}, 'sum')")
        T, one = (
            cv2.getRectSubPix(image.astype(np.float32), (21, 21), place).astype(float)
            for image, place in ((images[0], places[0]), (images[right], places[1]))
        )
        T, one = T - T.mean(), one - one.mean()
        by_sum = (T * one).sum() / np.sqrt((T**2).sum() * (one[:, 0] ** 2).sum())
        assert found == pytest.approx(by_sum, rel=1e-9, abs=1e-9)


def known(reader, name):
    return reader.on(name).browser.evaluate(f"trinolabApplets.{name}.known.data")


def test_masks_and_their_agreement_are_those_of_the_package(reader):
    for number, one in enumerate(known(reader, "threshold")["rounds"]):
        grey, before, packed = (
            np.frombuffer(base64.b64decode(one[kind]), np.uint8)
            for kind in ("frame", "background", "moves")
        )
        shape = one["size"][::-1]
        moves = np.unpackbits(packed)[: grey.size].astype(bool).reshape(shape)
        found = {}
        for T in (0, 15, 44, 100):
            mask = background.difference(grey.reshape(shape), before.reshape(shape), T).mask
            found[T] = reader.browser.evaluate(
                f"(({{decoded, maskOf, agreement, known}}) => {{"
                f" const one = decoded(known.data.rounds[{number}]);"
                f" return agreement(maskOf(one, {T}), one.moves); }})(trinolabApplets.threshold)"
            )
            assert found[T] == pytest.approx((mask & moves).sum() / (mask | moves).sum(), rel=1e-12)
        best = reader.browser.evaluate(
            f"(({{decoded, bestOf, known}}) => bestOf(decoded(known.data.rounds[{number}])))"
            "(trinolabApplets.threshold)"
        )
        assert best["share"] >= max(found.values())


def test_no_threshold_of_the_game_is_right_for_all_of_its_images(reader):
    """What the text behind the game says."""
    rounds = known(reader, "threshold")["rounds"]
    share = []
    for number, one in enumerate(rounds):
        share.append(
            reader.browser.evaluate(
                "(({decoded, maskOf, agreement, known}) => {"
                f" const one = decoded(known.data.rounds[{number}]);"
                " return [...Object.values(one.rules)].map(T => agreement(maskOf(one, T), one.moves));"
                "})(trinolabApplets.threshold)"
            )
        )
        assert one["rules"]["the chapter's T"] == 15
    chapter, otsu = np.transpose(share)
    assert (chapter[:3] > otsu[:3]).all()
    assert (chapter[3:] < 0.6).all()
    assert (otsu > 0.85).all()


def test_the_rules_of_the_next_place_know_only_what_was_before(reader):
    data = known(reader, "nextplace")
    z = as_floats(data["places"])
    times = np.arange(len(z)) / 30
    p = KalmanParameters(9.5e8, 1.5, 1200.0, 6000.0)
    for k in range(8, 23):
        state = image_track.track(times[:k], z[:k], p, False).updated
        last = kalman.State(state.mean[-1], state.covariance[-1])
        expected = kalman.predict_motion(last, 1 / 30, p).mean[:2]
        # the page's places are rounded to 0.1 px
        np.testing.assert_allclose(data["rules"]["the filter"][k], expected, atol=0.5)
        np.testing.assert_allclose(data["rules"]["last place"][k], z[k - 1])
        step = data["rules"]["last place + last step"][k]
        np.testing.assert_allclose(step, 2 * z[k - 1] - z[k - 2], atol=0.2)
    guesses = z[8:23] + [3.0, 4.0]
    argument = json.dumps(guesses.tolist())
    found = reader.browser.evaluate(
        f"(({{scores, known}}) => scores(known.data, {argument}))(trinolabApplets.nextplace)"
    )
    assert found["you"] == pytest.approx(5.0)
    missed = np.hypot(*(as_floats(data["rules"]["the filter"][8:23]) - z[8:23]).T).mean()
    assert found["the filter"] == pytest.approx(missed)


def test_the_next_place_is_pressed_and_typed(reader):
    reader.on("nextplace")
    reader.press_button("Reset")
    surface = "[data-applet=nextplace] .applet-surface"
    reader.can_be_held(surface)
    reader.browser.click(surface)  # the middle: the last place
    data = known(reader, "nextplace")
    z = as_floats(data["places"])
    assert f"You were {np.hypot(*(z[8] - z[7])):.0f} px off" in reader.says()
    reader.one(".applet-surface", "focus()")
    reader.browser.press("ArrowRight")
    reader.browser.press("Enter")
    assert f"You were {np.hypot(*(z[9] - z[8] - [5, 0])):.0f} px off" in reader.says()
    for _ in range(13):
        reader.browser.press("Enter")
    assert "That was the last of 15 frames." in reader.says()
    rows = reader.browser.evaluate("applet.querySelectorAll('tbody tr').length")
    assert rows == 4
    reader.press_button("Reset")


def test_pairs_are_judged_by_the_truth(reader):
    shots = known(reader, "pairs")["shots"]
    totals = dict.fromkeys(shots[0]["rules"], 0)
    for shot in shots:
        left, right = map(np.array, shot["labels"])
        due = len((set(left) & set(right)) - {-1})
        for name, pairs in shot["rules"].items():
            good = sum(left[a] == right[b] >= 0 for a, b in pairs)
            argument = json.dumps([shot, pairs])
            found = reader.browser.evaluate(f"trinolabApplets.pairs.judged(...{argument})")
            assert found == {"right": good, "wrong": len(pairs) - good, "due": due}
            totals[name] += 2 * int(good) - len(pairs)
    # what the text behind the game says
    assert max(totals, key=totals.get) == "the layout"


def test_spots_are_paired_by_pressing_them(reader):
    shot = known(reader, "pairs")["shots"][0]
    reader.press_button("Reset")
    spots = "[...applet.querySelectorAll('.applet-spots button')]"
    n = len(shot["labels"][0])
    partner = shot["labels"][1].index(shot["labels"][0][0])
    reader.browser.evaluate(f"{spots}[0].click()")
    assert reader.browser.evaluate(f"{spots}[0].getAttribute('aria-pressed')") == "true"
    reader.browser.evaluate(f"{spots}[{n + partner}].click()")
    assert "Pairs so far: 1" in reader.says()
    reader.browser.evaluate(f"{spots}[1].click(), {spots}[{n + partner}].click()")
    assert "Pairs so far: 1" in reader.says()  # a spot has one partner
    reader.browser.evaluate(f"{spots}[0].click(), {spots}[{n + partner}].click()")
    reader.press_button("These are the pairs")
    mine = reader.browser.evaluate("applet.querySelector('tbody tr').innerText").split()
    assert mine == ["you", "1", "0", str(len(set(shot["labels"][0]) - {-1}))]
    reader.press_button("Reset")


def test_the_mask_is_painted(reader):
    reader.on("threshold")
    reader.press_button("Reset")
    before = reader.says()
    easel = "[data-applet=threshold] .applet-easel"
    reader.can_be_held(easel)
    reader.browser.drag(easel, 30, 20)
    assert "by your painting" in reader.says() != before
    reader.press_button("This is the mask")
    assert "Image 2 of 5" in reader.says()
    reader.press_button("Reset")
    assert reader.says() == before


@pytest.mark.parametrize("name", ["threshold", "nextplace", "pairs"])
def test_a_game_is_shown_on_a_phone(reader, name):
    reader.on(name)
    shown_on_a_phone(reader)
    assert reader.browser.errors == []
