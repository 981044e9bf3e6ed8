"""The applets of the chapters in a browser: their numbers beside the package's, and how they are
used.

Both sides compute in double precision, by other orders of the same operations. A relative 1e-9 is a
million times what the rounding of a few dozen operations makes; where a tolerance is wider, the
reason stands beside it.
"""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from processes import wait_until
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import background, image_track, kalman, matching, triangulation, workspace
from trinolab.camera import Camera, Rig, epipolar_lines, fundamental_matrix
from trinolab.datasets import load_rig
from trinolab.kalman import KalmanParameters
from trinolab.slave import mapping
from trinolab.slave.oneeuro import OneEuroParameters
from trinolab.window import Window
from trinolab.workspace import cones
from workbench.pages.browser import CHROMIUM, Browser
from workbench.teleop import pointing

HTML = Path(__file__).resolve().parents[3] / "_build" / "html"
PAGES = {
    "cones": "02_workspace",
    "pixel": "03_background",
    "kalman": "04_kalman",
    "epipolar": "06_matching",
    "depth": "08_pose",
    "pointing": "11_master_slave",
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
        self._name = ""

    def on(self, name):
        """The page of an applet."""
        if self._name != name:
            self.browser.open((HTML / "notebooks" / f"{PAGES[name]}.html").as_uri())
            # The theme scrolls smoothly: what is pressed would still be on its way.
            self.browser.evaluate("document.documentElement.style.scrollBehavior = 'auto'")
            self._name = name
        return self

    def computes(self, function, argument):
        """What a function of the applets gives, `function` as ``name.function``."""
        return self.browser.evaluate(f"trinolabApplets.{function}({json.dumps(argument)})")

    def one(self, selector, what="textContent"):
        """A property of the first element of the applet that is selected."""
        return self.browser.evaluate(
            f"document.querySelector('.applet').querySelector({json.dumps(selector)}).{what}"
        )

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
            f"[...document.querySelectorAll('.applet button')]"
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
    const box = document.querySelector('.applet');
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
    narrow = "document.querySelector('.applet svg').getBoundingClientRect().right < 400"
    wait_until(lambda: reader.browser.evaluate(narrow))
    found = reader.browser.evaluate(SMALLEST)
    reader.browser.resize(1280)
    wide = "document.querySelector('.applet svg').getBoundingClientRect().width > 500"
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
    data = reader.browser.evaluate("trinolabAppletData.epipolar.cameras")
    greys = reader.browser.evaluate(
        "trinolabAppletData.epipolar.cameras.map(one => [...trinolabApplets.epipolar.decoded(one).image.grey])"
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
            const [left, , ] = trinolabAppletData.epipolar.cameras.map(trinolabApplets.epipolar.decoded);
            const right = trinolabApplets.epipolar.decoded(trinolabAppletData.epipolar.cameras[{right}]);
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
    markers = reader.browser.evaluate("trinolabAppletData.epipolar.cameras.map(one => one.markers)")
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
        " const one = document.querySelector(`.applet [name=${name}]`); one.value = value;"
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
        "fetch(document.querySelector('.applet-download').href).then(file => file.text())"
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
    rows = browser.evaluate("document.querySelectorAll('.applet details tbody tr').length")
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


def test_applets_are_loaded_where_they_are(reader):
    for name, page in PAGES.items():
        text = (HTML / "notebooks" / f"{page}.html").read_text(encoding="utf-8")
        assert re.findall(r"applets/(\w+)\.js", text) == ["shared", name]
        (place,) = re.findall(r'<div class="applet" data-applet="\w+">(.*?)</div>', text, re.DOTALL)
        assert "JavaScript" in place  # what is read without it
    other = (HTML / "notebooks" / "05_markers.html").read_text(encoding="utf-8")
    assert "applets" not in other
