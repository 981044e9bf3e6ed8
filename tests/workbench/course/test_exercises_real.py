"""The values of exercises on recordings that others made, and of projects that go on from a chapter's
cells. A recording that is not here is skipped with the reason.
"""

import io
import logging
import re
from dataclasses import replace
from itertools import combinations

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest
from chapters import LESSONS
from executed import as_it_stands
from scipy import ndimage
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import RigidTransform
from solutions import ALL, TEXTS, agrees

from trinolab import matching, metrics
from trinolab.bench.board import board_positions
from trinolab.calibration import adjust
from trinolab.calibration.target import find_corners
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.fetch import why_not
from trinolab.following import posetracker
from trinolab.triangulation import mean_point, triangulate_pair
from workbench.course.child import BEING_CHECKED, executed
from workbench.course.submissions import cells_of
from workbench.studies import ground_truth, markertrack, real_recordings, tuning

RECORDINGS = [one for one in ALL if one.kind == "recording"]
READS = re.compile(r"real_recordings\.load_(\w+)\(fetch=True\)")


def needs(name):
    """A mark for a test: skipped where a recording is not here."""
    reason = f"no {name}: {why_not(load_real_sets()[name])}"
    return pytest.mark.skipif(real_set(name) is None, reason=reason)


def lesson(chapter):
    (path,) = (path for path in LESSONS if path.stem.startswith(chapter))
    return path


@pytest.fixture
def made_by(monkeypatch):
    """A function that runs a chapter's cells and returns what they make."""
    monkeypatch.setenv(BEING_CHECKED, "1")

    def run(chapter):
        said = io.StringIO()
        plt.close("all")
        made = executed(cells_of(lesson(chapter)), said)
        plt.close("all")
        assert '"raised"' not in said.getvalue()
        return made

    return run


def test_twelve_statements_say_what_to_do_without_the_recording():
    assert len(RECORDINGS) == 12
    for asked in RECORDINGS:
        statement = TEXTS[asked.number].statement
        names = READS.findall(statement)
        assert set(names) <= set(load_real_sets())
        first = statement.split("\n\n")[0]
        assert "missing" in first if names else "exercise" in first, asked.number


@pytest.mark.parametrize("name", ["opencv_stereo", "trajectories"])
def test_what_is_not_here_is_said_in_a_line(name, monkeypatch, tmp_path, caplog):
    """Those two are fetched by nobody: who has not got them is told what to do."""
    monkeypatch.setenv("TRINOLAB_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with caplog.at_level(logging.INFO), pytest.raises(ValueError, match=name) as caught:
        getattr(real_recordings, f"load_{name}")(fetch=True)
    assert "\n" not in str(caught.value)
    assert "set TRINOLAB_DATA to a folder that has" in str(caught.value)


@pytest.mark.heavy
def test_the_film_with_fewer_frames():
    for step in (1, 2, 4, 6):
        clip = ground_truth.read_recording("hard", range(0, 60, step))
        followed = posetracker.track_instants(clip.instants, clip.rig, clip.handle)
        kept = [
            (seen.measurement.pose.T_world_handle, now.T_world_handle)
            for now, seen in followed
            if seen.measurement.pose.status == "measured"
        ]
        agrees("01.5", **{f"measured_{step}": len(kept)})
        if step == 4:
            poses = map(RigidTransform.concatenate, zip(*kept, strict=True))
            agrees("01.5", mm_4=metrics.pose_errors(*poses).E_t_mm)


@needs("caliscope")
def test_who_sees_the_board():
    tracks = real_recordings.load_caliscope()
    seen = np.isfinite(tracks.uv[..., 0])
    shares = [100 * (seen.sum(axis=0) >= least).mean() for least in (2, 3, 4)]
    together = np.triu(seen.astype(int) @ seen.T, 1)
    i, j = np.unravel_index(together.argmax(), together.shape)
    axes = [camera.T_cam_world.rotation.as_matrix()[2] for camera in tracks.rig.cameras]
    angle = np.rad2deg(np.arccos(axes[i] @ axes[j]))
    agrees("02.6", **dict(zip(("two", "three", "four"), shares, strict=True)))
    agrees("02.6", pair=f"{i} and {j}", angle_deg=angle)


@pytest.mark.heavy
def test_the_second_lamp(made_by):
    made = made_by("03")
    cured = replace(made["cured"], shadow_share=0.3)
    frames, empty = made["hard"].images_of(2), made["hard"].empty[2]
    width = empty.shape[1]
    for name, part in (("right", np.s_[width // 2 :]), ("left", np.s_[: width // 2])):
        lit = [frame.astype(float) for frame in frames]
        for frame in lit[30:]:
            frame[:, part] *= 1.3
        shown = [np.clip(np.rint(frame), 0, 255).astype(np.uint8) for frame in lit]
        seen = ground_truth.watch(shown, empty, made["moving"][2], cured)
        agrees("03.6", **{f"false_{name}": 100 * seen.false[30:].mean()})


@needs("opencv_stereo")
def test_a_room_with_a_person_in_it():
    """The median by sorting, and Eq. 6 by its weights."""
    *earlier, last = np.array(real_recordings.load_opencv_stereo().left, dtype=float)
    ordered = np.sort(earlier, axis=0)
    weights = 0.05 * 0.95 ** np.arange(11, -1, -1)
    weights[0] = 0.95**11
    moving = np.abs(last - (ordered[5] + ordered[6]) / 2) > 15
    by_eq6 = np.abs(last - np.tensordot(weights, earlier, axes=1)) > 15
    keyboard = moving[330:460, 20:140]
    agrees("03.8", median=100 * moving.mean(), eq6=100 * by_eq6.mean())
    agrees("03.8", first_weight=weights[0], keyboard=100 * keyboard.mean())


@pytest.mark.heavy
def test_the_whole_recording(made_by):
    """Which is rendered first; that takes some minutes."""
    made = made_by("04")
    recording = ground_truth.read_recording("calm", range(20, 300), seconds=10.0)
    inside = 0
    for index, name in enumerate(recording.rig.names):
        images = recording.images_of(index)
        regions = markertrack.moving_regions(images, recording.empty[index])
        looks = markertrack.follow(images, recording.times_s, recording.handle, regions, made["p"])
        nis = np.array([look.nis for look in looks[11:]])
        nis = nis[np.isfinite(nis)]
        low, high = tuning.nis_band(len(nis))
        inside += low < nis.mean() < high
        agrees("04.5", **{name: nis.mean()})
    agrees("04.5", inside=inside)


@needs("trajectories")
def test_one_more_step_like_the_last():
    """By differences of differences: the n-th is what a polynomial of the order n - 1 leaves."""
    poses = real_recordings.load_trajectories().poses

    def off(order, k):
        left = poses.translation
        for _ in range(order):
            left = left[k:] - left[:-k]
        return np.linalg.norm(left[(3 - order) * k :], axis=1)

    rules = {"place": 1, "speed": 2, "acceleration": 3}
    agrees("04.7", **{f"{name}_mm": np.median(off(order, 3)) for name, order in rules.items()})
    medians = {name: np.median(off(order, 20)) for name, order in rules.items()}
    squares = {name: np.mean(off(order, 20) ** 2) for name, order in rules.items()}
    best = {"best_median": min(medians, key=medians.get), "best_rms": min(squares, key=squares.get)}
    agrees("04.7", **best)

    way = np.linalg.norm(poses[10:].translation - poses[:-10].translation, axis=1)
    turn = np.rad2deg((poses[10:].rotation * poses[:-10].rotation.inv()).magnitude())
    agrees("11.7", lag_mm=np.median(way), lag_95_mm=np.percentile(way, 95))
    agrees("11.7", lag_deg=np.median(turn), delay_ms=500 / np.median(way))


def bright_particles():
    particles = real_recordings.load_trackpy_particles()
    return 255.0 - particles.image, particles.uv


@needs("trackpy_particles")
def test_a_window_about_a_particle():
    """Centroids by SciPy."""
    image, uv = bright_particles()
    limits = np.array(image.shape[::-1]) - 14
    kept = uv[((uv >= 13) & (uv <= limits)).all(axis=1)]
    assert len(kept) == 318
    for half in (1, 3, 6):
        off = []
        for place in kept:
            u, v = np.rint(place).astype(int)
            near = image[v - 2 : v + 3, u - 2 : u + 3]
            row, column = np.unravel_index(near.argmax(), near.shape)
            u, v = u - 2 + column - half, v - 2 + row - half
            window = image[v : v + 2 * half + 1, u : u + 2 * half + 1]
            row, column = ndimage.center_of_mass(window - window.min())
            off.append(np.hypot(u + column - place[0], v + row - place[1]))
        agrees("05.7", **{f"px_{half}": np.median(off)})


@needs("trackpy_particles")
def test_344_are_wanted():
    image, uv = bright_particles()
    flat = image - cv2.blur(image, (9, 9))
    labels = [ndimage.label(flat > t, np.ones((3, 3))) for t in range(int(flat.max()) + 1)]
    counts = [count for _, count in labels]
    patches = labels[10][0]
    centres = ndimage.center_of_mass(patches > 0, patches, range(1, counts[10] + 1))
    apart = np.linalg.norm(uv[:, None] - np.array(centres)[:, ::-1], axis=2)
    exists = "yes" if 344 in counts[1:] else "no"
    found = (apart.min(axis=1) < 2).sum()
    agrees("05.8", at_10=counts[10], at_11=counts[11], exists=exists, found=found)


@pytest.mark.heavy
def test_pairs_by_the_largest_sum(made_by):
    made = made_by("06")
    found = np.zeros(2, int)
    for shot, i, j in made["places"]:
        near = matching.candidates(*made["spots_of"](shot, i, j), made["settings"])
        value = np.zeros((len(shot.labels[i]), len(shot.labels[j])))
        value[tuple(near.index.T)] = near.ncc
        pairs = np.column_stack(linear_sum_assignment(value, maximize=True))
        found += made["judge"](shot, i, j, pairs[value[tuple(pairs.T)] > 0])[:2]
    agrees("06.7", wrong=found[0], missing=found[1])
    glued = as_it_stands(lesson("06")).results
    agrees("06.6", wrong=glued["wrong_blind"], missing=glued["missing_blind"])


@pytest.fixture(scope="module")
def corners():
    photographs = real_recordings.load_opencv_stereo()
    sides = [[find_corners(image, photographs.board) for image in side] for side in photographs[:2]]
    return np.array(photographs.board.points), np.array(sides)


@needs("opencv_stereo")
def test_epipolar_lines_of_two_real_cameras(corners):
    """By OpenCV's lines of pixels whose distortion is undone."""
    left, right = real_recordings.photographed_calibration().cameras
    T = right.T_cam_world * left.T_cam_world.inv()
    x, y, z = T.translation
    E = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T.rotation.as_matrix()
    F = np.linalg.inv(right.matrix).T @ E @ np.linalg.inv(left.matrix)

    def distances(first, second):
        lines = cv2.computeCorrespondEpilines(first[:, None], 1, F)[:, 0]
        return np.abs(np.column_stack([second, np.ones(len(second))]) @ lines.T).T

    own, strangers, bent = [], [], []
    for pair in zip(*corners[1], strict=True):
        undone = [
            cv2.undistortPoints(one[:, None], c.matrix, c.distortions, P=c.matrix)[:, 0]
            for one, c in zip(pair, (left, right), strict=True)
        ]
        D = distances(*undone)
        own.append(np.diag(D))
        strangers.append((D < 2).sum(axis=1).mean() - 1)
        bent.append(np.diag(distances(*pair)))
    agrees("06.9", mean_px=np.mean(own), ignored_px=np.mean(bent))
    agrees("06.9", strangers=np.mean(strangers), worst=max(strangers))


@pytest.mark.heavy
def test_a_bent_board(made_by):
    made = made_by("07")
    board, rig, found = made["board"], made["rig"], []
    bent = np.array(board.points)
    x = bent[:, 0] - bent[:, 0].mean()
    bent[:, 2] = 0.2 * (1 - (x / x.max()) ** 2)
    for k in range(6):
        rng = np.random.default_rng([made["seed"], k])
        poses = board_positions(rig, board, made["positions"], rng)
        exact = np.stack([[c.project(T.apply(bent)) for T in poses] for c in rig.cameras])
        uv = exact + made["noise_px"] * rng.standard_normal(exact.shape)
        sizes = [camera.size for camera in rig.cameras]
        found.append(adjust.calibrate(board.points, uv, sizes, rig.names, distortion_terms=0))
    agrees("07.5", noise_px=np.mean([one.sigma_px for one in found]))
    agrees("07.5", chi_square=np.mean([made["chi_squared"](one) for one in found]))
    agrees("07.5", cost_mm=np.mean([made["cost_mm"](one.rig) for one in found]))


def mono(points, uv, flags):
    """OpenCV's calibration of one camera."""
    views = [np.float32(points)] * len(uv), list(np.float32(uv))
    return cv2.calibrateCameraExtended(*views, (640, 480), None, None, flags=flags)


@needs("opencv_stereo")
def test_the_same_camera_twice(corners):
    """By the package's own least squares; the standard deviations by OpenCV."""
    points, uv = corners
    lenses, sigmas = [], []
    for part in (slice(0, 6), slice(6, 13)):
        fit = adjust.calibrate(points, uv[:1, part], [(640, 480)], ("left",), distortion_terms=4)
        lenses.append(fit.cameras[0].matrix)
        sigmas.append(mono(points, uv[0, part], cv2.CALIB_FIX_K3)[5].ravel()[2])
    apart = np.abs(lenses[1] - lenses[0])
    agrees("07.6", fx_apart=apart[0, 0], cx_apart=apart[0, 2])
    agrees("07.6", cx_sigmas=apart[0, 2] / np.hypot(*sigmas))


@needs("opencv_stereo")
def test_a_camera_without_its_distortion(corners):
    points, uv = corners
    one_term = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    flags = {"none": one_term | cv2.CALIB_FIX_K1, "one": one_term, "four": cv2.CALIB_FIX_K3}
    found = {name: mono(points, uv[0], flag) for name, flag in flags.items()}
    agrees("07.7", rms_none=found["none"][0], rms_one=found["one"][0])
    agrees("07.7", fx_off=found["none"][1][0, 0] - found["four"][1][0, 0])


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
    agrees("08.9", mean_mm=mean, scatter_mm=scatter)
    agrees("08.9", standard_errors=(mean - 54) / (scatter / np.sqrt(len(lengths))))


@needs("pymvg_mcsc")
def test_an_error_that_sixteen_instants_make():
    tracks = real_recordings.load_pymvg_mcsc()
    points = points_of(tracks.rig.cameras, tracks.uv)
    camera = tracks.rig.cameras[2]
    inside = camera.T_cam_world.apply(points) @ camera.matrix.T
    off = inside[:, :2] / inside[:, 2:] - tracks.uv[2]
    off = off[np.isfinite(off).all(axis=1)]
    length = np.sort(np.hypot(*off.T))
    square = np.mean(length**2)
    agrees("09.7", mean_px=length.mean(), median_px=np.median(length), rms_px=np.sqrt(square))
    agrees("09.7", worst_share=100 * np.sum(length[-16:] ** 2) / np.sum(length**2))
    agrees("09.7", offset_share=100 * (1 - off.var(axis=0).sum() / square))


@needs("pymvg_mcsc")
def test_what_three_say_of_the_fourth():
    tracks = real_recordings.load_pymvg_mcsc()
    cameras, uv = tracks.rig.cameras, tracks.uv[:, ~np.isnan(tracks.uv).any(axis=(0, 2))]
    medians = {2: [], 3: []}
    for k, judge in enumerate(cameras):
        for many, of_many in medians.items():
            for chosen in map(list, combinations([i for i in range(4) if i != k], many)):
                points = points_of([cameras[i] for i in chosen], uv[chosen])
                of_many.append(np.median(np.linalg.norm(judge.project(points) - uv[k], axis=1)))
    pairs = np.reshape(medians[2], (4, 3))
    wins = (pairs.min(axis=1) < medians[3]).sum()
    agrees("10.6", two_px=pairs.mean(), three_px=np.mean(medians[3]), pair_wins=wins)
