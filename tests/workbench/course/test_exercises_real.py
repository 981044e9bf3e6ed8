"""The exercises on recordings that others made: their values by another way, and what their solutions
say. A recording that is not here is skipped with the reason.
"""

import logging
from itertools import combinations

import cv2
import numpy as np
import pandas as pd
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from solutions import ALL, TEXTS, agrees, gives, says

from trinolab.calibration.adjust import calibrate
from trinolab.calibration.target import find_corners
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.fetch import why_not
from trinolab.triangulation import mean_point, triangulate_pair
from workbench.studies import real_recordings

SETS = load_real_sets()
RECORDINGS = [one for one in ALL if one.kind == "recording"]


def needs(name):
    """A mark for a test: skipped where a recording is not here."""
    return pytest.mark.skipif(real_set(name) is None, reason=f"no {name}: {why_not(SETS[name])}")


def test_twelve_statements_say_how_the_recording_comes():
    assert len(RECORDINGS) == 12
    for asked in RECORDINGS:
        statement = TEXTS[asked.number].statement
        reads = [name for name in dir(real_recordings) if f"{name}(fetch=True)" in statement]
        assert len(reads) == 1, asked.number
        first = statement.split("\n\n")[0]
        assert "missing" in first or "exercise" in first  # what to do without it


@pytest.mark.parametrize("name", ["opencv_stereo", "trajectories"])
def test_what_is_not_here_is_said_in_a_line(name, monkeypatch, tmp_path, caplog):
    """Those two are fetched by nobody: who has not got them is told what to do."""
    monkeypatch.setenv("TRINOLAB_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with caplog.at_level(logging.INFO), pytest.raises(ValueError, match=name) as caught:
        getattr(real_recordings, f"load_{name}")(fetch=True)
    assert "\n" not in str(caught.value)
    assert "set TRINOLAB_DATA to a folder that has" in str(caught.value)


@needs("caliscope")
def test_who_sees_the_board():
    """From the table itself: a row is a corner that a camera sees."""
    rows = pd.read_csv(real_set("caliscope") / "xy.csv")
    corners = rows.groupby(["sync_index", "keypoint_id"]).cam_id.agg(frozenset)
    n = rows.sync_index.nunique() * rows.keypoint_id.nunique()
    shares = {least: 100 * (corners.map(len) >= least).sum() / n for least in (2, 3, 4)}
    shared = {pair: corners.map(set(pair).issubset).sum() for pair in combinations(range(4), 2)}
    best = max(shared, key=shared.get)
    cameras = real_recordings.load_caliscope().rig.cameras
    axes = [cameras[k].T_cam_world.rotation.as_matrix()[2] for k in range(4)]

    def angle_deg(i, j):
        return np.rad2deg(2 * np.arctan2(*(np.linalg.norm(axes[i] + s * axes[j]) for s in (-1, 1))))

    agrees("02.6", two=shares[2], three=shares[3], four=shares[4])
    agrees("02.6", pair=f"{best[0]} and {best[1]}", angle_deg=angle_deg(*best))
    exactly = {many: 100 * (corners.map(len) == many).sum() / n for many in (2, 3)}
    gives("02.6", two=exactly[2], three=exactly[3])


@needs("opencv_stereo")
def test_a_room_with_a_person_in_it():
    """The median by sorting, and Eq. 6 by its weights."""
    photographs = real_recordings.load_opencv_stereo()
    assert len(photographs.left) == 13
    *earlier, last = np.array(photographs.left, dtype=float)
    ordered = np.sort(earlier, axis=0)
    median = (ordered[5] + ordered[6]) / 2
    weights = 0.05 * 0.95 ** np.arange(11, -1, -1)
    weights[0] = 0.95**11
    renewed = np.tensordot(weights, earlier, axes=1)
    shares = {
        name: 100 * np.mean(np.abs(last - background) > 15)
        for name, background in (("median", median), ("eq6", renewed))
    }
    keyboard = np.s_[330:460, 20:140]
    false = 100 * np.mean(np.abs(last - median)[keyboard] > 15)
    agrees("03.8", **shares, first_weight=weights[0], keyboard=false)
    gives("03.8", median=100 * np.mean(np.abs(last - np.mean(earlier, axis=0)) > 15))


@needs("trajectories")
def test_one_more_step_like_the_last():
    """By differences of differences; and how far ahead a real hand is."""
    rows = np.loadtxt(real_set("trajectories") / "freiburg1_xyz-groundtruth.txt")
    places = 1e3 * rows[:, 1:4]

    def off(order, k):
        """The n-th difference is what a polynomial of the order n - 1 leaves."""
        left = places
        for _ in range(order):
            left = left[k:] - left[:-k]
        return np.linalg.norm(left[(3 - order) * k :], axis=1)

    rules = {"place": 1, "speed": 2, "acceleration": 3}
    soon = {f"{name}_mm": np.median(off(order, 3)) for name, order in rules.items()}
    medians = {name: np.median(off(order, 20)) for name, order in rules.items()}
    squares = {name: np.mean(off(order, 20) ** 2) ** 0.5 for name, order in rules.items()}
    best = {"best_median": min(medians, key=medians.get), "best_rms": min(squares, key=squares.get)}
    agrees("04.7", **soon, **best)
    gives("04.7", speed_mm=np.mean(off(2, 3) ** 2) ** 0.5)
    first, second, third = medians.values()
    says("04.7", f"the median errors are {first:.0f}, {second:.1f} and {third:.1f} mm")
    says("04.7", "the root mean squares {:.0f}, {:.0f} and {:.0f} mm".format(*squares.values()))

    way = np.linalg.norm(places[10:] - places[:-10], axis=1)
    first, later = (Rotation.from_quat(part) for part in (rows[:-10, 4:], rows[10:, 4:]))
    cosine = np.abs((first.as_quat() * later.as_quat()).sum(axis=1))
    turn = np.rad2deg(2 * np.arccos(np.minimum(cosine, 1)))
    ahead = {
        "lag_mm": np.median(way),
        "lag_95_mm": np.percentile(way, 95),
        "lag_deg": np.median(turn),
        "delay_ms": 500 / np.median(way),
    }
    agrees("11.7", **ahead)
    gives("11.7", lag_mm=way.mean())


def bright_particles():
    particles = real_recordings.load_trackpy_particles()
    return 255.0 - particles.image, particles.uv


def about(image, place, half):
    """The window about the brightest pixel near a place, and its first column and row."""
    u, v = np.rint(place).astype(int)
    near = image[v - 2 : v + 3, u - 2 : u + 3]
    row, column = np.unravel_index(near.argmax(), near.shape)
    first = np.array([u - 2 + column - half, v - 2 + row - half])
    side = 2 * half + 1
    return image[first[1] : first[1] + side, first[0] : first[0] + side], first


@needs("trackpy_particles")
def test_a_window_about_a_particle():
    """Centroids by SciPy."""
    image, uv = bright_particles()
    limits = np.array(image.shape[::-1]) - 14
    kept = uv[((uv >= 13) & (uv <= limits)).all(axis=1)]
    assert len(kept) == 318

    def off(half, ground):
        apart = []
        for place in kept:
            window, first = about(image, place, half)
            v, u = ndimage.center_of_mass(np.maximum(window - ground(window), 0))
            apart.append(np.linalg.norm(first + [u, v] - place))
        return np.median(apart)

    agrees("05.7", **{f"px_{half}": off(half, np.min) for half in (1, 3, 6)})
    without = off(6, lambda window: np.percentile(window, 75))
    says("05.7", f"below it, gives {without:.2f} px with 13 pixels")


@needs("trackpy_particles")
def test_344_are_wanted():
    image, uv = bright_particles()
    flat = image - cv2.blur(image, (9, 9))
    counts, centres = {}, {}
    for threshold in range(1, int(flat.max()) + 1):
        labels, counts[threshold] = ndimage.label(flat > threshold, np.ones((3, 3)))
        if threshold == 10:
            found = ndimage.center_of_mass(labels > 0, labels, range(1, counts[10] + 1))
            centres = np.array(found)[:, ::-1]
    particle_has, patch_has = (
        cKDTree(one).query(other)[0] < 2 for one, other in ((centres, uv), (uv, centres))
    )
    exists = "yes" if 344 in counts.values() else "no"
    agrees("05.8", at_10=counts[10], at_11=counts[11], exists=exists, found=particle_has.sum())
    gives("05.8", found=patch_has.sum())
    says("05.8", f"{(~particle_has).sum()} are missed", f"and {(~patch_has).sum()} patches belong")


@pytest.fixture(scope="module")
def corners():
    photographs = real_recordings.load_opencv_stereo()
    sides = [[find_corners(image, photographs.board) for image in side] for side in photographs[:2]]
    return np.array(photographs.board.points), np.array(sides)


@needs("opencv_stereo")
def test_epipolar_lines_of_two_real_cameras(corners):
    """By OpenCV's lines of pixels whose distortion is undone."""
    _, uv = corners
    left, right = real_recordings.photographed_calibration().cameras
    T = right.T_cam_world * left.T_cam_world.inv()
    x, y, z = T.translation
    E = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T.rotation.as_matrix()
    F = np.linalg.inv(right.matrix).T @ E @ np.linalg.inv(left.matrix)

    def distances(first, second):
        lines = cv2.computeCorrespondEpilines(first[:, None], 1, F)[:, 0]
        return np.abs(np.column_stack([second, np.ones(len(second))]) @ lines.T).T

    own, others, raw = [], [], []
    for first, second in zip(*uv, strict=True):
        undone = [
            cv2.undistortPoints(one[:, None], c.matrix, c.distortions, P=c.matrix)[:, 0]
            for one, c in ((first, left), (second, right))
        ]
        D = distances(*undone)
        own.append(np.diag(D))
        others.append((D < 2).sum(axis=1) - 1)
        raw.append(np.diag(distances(first, second)))
    strangers = np.mean(others, axis=1)
    mean, bent = np.mean(own), np.mean(raw)
    agrees("06.9", mean_px=mean, strangers=strangers.mean(), worst=strangers.max(), ignored_px=bent)
    gives("06.9", mean_px=np.median(own), ignored_px=np.median(raw))
    gives("06.9", worst=np.max(others))
    gives("06.9", mean_px=54 * mean)
    says("06.9", f"px on average, and by up to {np.max(raw):.0f} px")
    # a row of the board, 9 corners: how far it climbs from its first to its last
    climbs = np.mean([np.abs(side[:, 8, 1] - side[:, 0, 1]) for side in uv], axis=0)
    assert strangers.argmax() == climbs.argmin() == 0
    assert (strangers < 1).sum() == 10
    says("06.9", "In ten of the thirteen it is less than one")


@needs("opencv_stereo")
def test_the_same_camera_twice(corners):
    """By the package's own least squares; the standard deviations by OpenCV."""
    points, uv = corners
    lenses, sigmas = [], []
    for part in (slice(0, 6), slice(6, 13)):
        fit = calibrate(points, uv[:1, part], [(640, 480)], ("left",), distortion_terms=4)
        lenses.append(fit.cameras[0].matrix)
        theirs = mono(points, uv[0, part], cv2.CALIB_FIX_K3)
        sigmas.append(theirs[5].ravel()[:4])
    fx, cx = ((lenses[1] - lenses[0])[0, k] for k in (0, 2))
    cx_sigma = np.hypot(sigmas[0][2], sigmas[1][2])
    agrees("07.6", fx_apart=abs(fx), cx_apart=abs(cx), cx_sigmas=abs(cx) / cx_sigma)
    gives("07.6", cx_sigmas=cx / sigmas[0][2])
    gives("07.6", cx_sigmas=cx / (sigmas[0][2] + sigmas[1][2]))
    gives("07.6", cx_apart=abs((lenses[1] - lenses[0])[1, 2]))
    says("07.6", f"({sigmas[0][2]:.2f} and {sigmas[1][2]:.2f} px, added as squares)")


def mono(points, uv, flags):
    n = len(uv)
    return cv2.calibrateCameraExtended(
        [np.float32(points)] * n, list(np.float32(uv)), (640, 480), None, None, flags=flags
    )


@needs("opencv_stereo")
def test_a_camera_without_a_bent_lens(corners):
    """By the package's own least squares: the root of the mean square of both coordinates together."""
    points, uv = corners

    def fit(side, terms):
        fitted = calibrate(
            points, uv[side : side + 1], [(640, 480)], ("one",), distortion_terms=terms
        )
        camera = fitted.cameras[0]
        off = []
        for pixels in uv[side]:
            flat = cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortions)
            _, turn, shift = cv2.solvePnP(points, flat, np.eye(3), None)
            _, turn, shift = cv2.solvePnP(
                points, pixels, camera.matrix, camera.distortions, turn, shift, True
            )
            seen, _ = cv2.projectPoints(points, turn, shift, camera.matrix, camera.distortions)
            off.append(seen[:, 0] - pixels)
        return np.sqrt(np.mean(np.sum(np.square(off), axis=2))), camera.focal[0]

    (none, long), (one, _), (four, right) = (fit(0, terms) for terms in (0, 1, 4))
    agrees("07.7", rms_none=none, rms_one=one, fx_off=long - right)
    other, other_right = fit(1, 0), fit(1, 4)
    gives("07.7", rms_none=other[0], fx_off=other[1] - other_right[1])
    gives("07.7", rms_one=four)
    gives("07.7", fx_off=100 * (long / right - 1))
    says("07.7", f"all four bring it to {four:.3f} px")


def points_of(cameras, uv):
    """Eq. 22 by hand: the mean of the pairs that see a point."""
    pairs = [
        triangulate_pair(cameras[i], cameras[j], uv[i], uv[j])
        for i, j in combinations(range(len(cameras)), 2)
    ]
    return mean_point(np.array(pairs))


@needs("caliscope")
def test_a_board_as_a_ruler():
    tracks = real_recordings.load_caliscope()
    found = points_of(tracks.rig.cameras, tracks.uv).reshape(48, 4, 3, 3)
    lengths = np.concatenate(
        [np.linalg.norm(np.diff(found, axis=axis), axis=-1).ravel() for axis in (1, 2)]
    )
    lengths = lengths[np.isfinite(lengths)]
    mean, scatter = lengths.mean(), lengths.std()
    errors = (mean - 54) / (scatter / np.sqrt(len(lengths)))
    agrees("08.9", mean_mm=mean, scatter_mm=scatter, standard_errors=errors)
    gives("08.9", scatter_mm=scatter / np.sqrt(len(lengths)))
    gives("08.9", standard_errors=(mean - 54) / scatter)
    gives("08.9", mean_mm=np.median(lengths))
    says("08.9", f"{len(lengths)} distances have the mean {mean:.2f} mm")
    says("08.9", f"{scatter**2 / 54:.2f} mm here")


@needs("pymvg_mcsc")
def test_an_error_that_sixteen_instants_make():
    tracks = real_recordings.load_pymvg_mcsc()
    points = points_of(tracks.rig.cameras, tracks.uv)

    def off(k):
        camera = tracks.rig.cameras[k]
        inside = camera.T_cam_world.apply(points) @ camera.matrix.T
        apart = inside[:, :2] / inside[:, 2:] - tracks.uv[k]
        return apart[np.isfinite(apart).all(axis=1)]

    third = off(2)
    length = np.hypot(*third.T)
    assert len(length) == 320
    square = np.mean(length**2)
    worst = np.sort(length)[-16:]
    values = {
        "mean_px": length.mean(),
        "median_px": np.median(length),
        "rms_px": np.sqrt(square),
        "worst_share": 100 * np.sum(worst**2) / np.sum(length**2),
        "offset_share": 100 * (1 - third.var(axis=0).sum() / square),
    }
    agrees("09.7", **values)
    gives("09.7", rms_px=np.sqrt(square / 2))
    gives("09.7", mean_px=np.hypot(*off(3).T).mean())
    gives("09.7", offset_share=10 * np.sqrt(values["offset_share"]))


@needs("pymvg_mcsc")
def test_what_three_say_of_the_fourth():
    tracks = real_recordings.load_pymvg_mcsc()
    uv = tracks.uv[:, ~np.isnan(tracks.uv).any(axis=(0, 2))]
    assert uv.shape[1] == 207
    medians = {2: np.zeros((4, 3)), 3: np.zeros((4, 1))}
    squares = {2: np.zeros((4, 3)), 3: np.zeros((4, 1))}
    for k, judge in enumerate(tracks.rig.cameras):
        rest = [i for i in range(4) if i != k]
        for many in (2, 3):
            for place, chosen in enumerate(combinations(rest, many)):
                points = points_of([tracks.rig.cameras[i] for i in chosen], uv[list(chosen)])
                length = np.linalg.norm(judge.project(points) - uv[k], axis=1)
                medians[many][k, place] = np.median(length)
                squares[many][k, place] = np.sqrt(np.mean(length**2))
    two, three = medians[2].mean(), medians[3].mean()
    wins = (medians[2].min(axis=1) < medians[3][:, 0]).sum()
    agrees("10.6", two_px=two, three_px=three, pair_wins=wins)
    gives("10.6", two_px=medians[2].min(axis=1).mean())
    gives("10.6", two_px=squares[2].mean(), three_px=squares[3].mean())
