"""From images of a target to a rig file: rendered truth, missing and spoiled views, mistakes, a
real stereo pair.
"""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from boards import SIZE, board_frames, make_rig, motion, positions, write_views

from trinolab.calibration.calibrate import as_lines, calibrate_rig
from trinolab.calibration.hints import hint, larger
from trinolab.calibration.target import (
    COUNTED,
    Target,
    appearances,
    detect_target,
    find_target,
    upright_corners,
)
from trinolab.camera import Rig
from trinolab.files.rigs import read_rig
from workbench.plotting.calibration import picture_of_residuals

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
CIRCLES = Target("circles", 7, 6, 15.0)
ACIRCLES = Target("acircles", 4, 9, 10.0)
CHARUCO = Target("charuco", 6, 5, 20.0)
FILES = ("rig.toml", "rig.covariance.toml", "rig_views.csv", "rig_residuals.png")
GREY = np.full(SIZE[::-1], 90, np.uint8)
STRAIGHT = make_rig(np.zeros(5))


def pattern(target, scale=8, border=20.0):
    """A print of circles or ChArUco squares, and the matrix from its pixels to the target's mm;
    `scale` px a mm.
    """
    if target.kind.endswith("circles"):
        extent = target.points[:, :2].max(axis=0) + 2 * border
        image = np.full((int(extent[1] * scale), int(extent[0] * scale)), 255, np.uint8)
        for x, y in target.points[:, :2]:  # 4 bits behind the point
            centre = np.rint(16 * (scale * (np.array([x, y]) + border) - 0.5)).astype(int)
            cv2.circle(image, centre.tolist(), int(16 * 4.0 * scale), 0, -1, cv2.LINE_AA, 4)
        first = -border
    else:
        counts, square = (target.columns, target.rows), target.square_mm
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        board = cv2.aruco.CharucoBoard(counts, square, 0.75 * square, dictionary)
        image = board.generateImage((int(scale * square) * np.array(counts)).tolist())
        image = cv2.copyMakeBorder(image, *[6 * scale] * 4, cv2.BORDER_CONSTANT, value=255)
        first = -square - 6.0
    at = first + 0.5 / scale
    return image, np.array([[1 / scale, 0, at], [0, 1 / scale, at], [0, 0, 1]])


def printed(camera, target, T_world_target, rng, sub=4):
    """A frame of a printed pattern, without lens distortion: a warp at `sub` x `sub` samples a
    pixel, blur, noise.
    """
    image, to_mm = pattern(target)
    T = camera.T_cam_world * T_world_target
    H = camera.matrix @ np.column_stack([T.rotation.as_matrix()[:, :2], T.translation]) @ to_mm
    fine = np.array([[sub, 0, (sub - 1) / 2], [0, sub, (sub - 1) / 2], [0, 0, 1.0]])
    shape = (SIZE[0] * sub, SIZE[1] * sub)
    image = cv2.GaussianBlur((0.65 * image + 30).astype(np.uint8), (0, 0), 1.2)
    warped = cv2.warpPerspective(image, fine @ H, shape, flags=cv2.INTER_LINEAR, borderValue=90)
    frame = warped.reshape(SIZE[1], sub, SIZE[0], sub).mean(axis=(1, 3))
    frame = cv2.GaussianBlur(frame, (0, 0), 0.6) + rng.normal(0, 1.5, frame.shape)
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8)


def off_sigma(result, truth):
    """How far each estimated parameter is from the truth, in its standard deviations."""
    values = []
    for camera in truth.cameras:
        T = camera.T_world_cam
        turn = np.rad2deg(T.rotation.as_rotvec())
        lens = np.concatenate([camera.focal, camera.principal_point, camera.distortions])
        values += [*lens, *T.translation, *turn]
    table = result.parameters
    return ((table["value"] - values) / table["sigma"])[table["sigma"] > 0]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with the rendered images in a and b."""
    write_views(tmp_path, board_frames(10))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def calibrated(target=CHESSBOARD, **rest):
    """A calibration with all distortions, unless others are given, and without the picture of its
    residuals: to choose and to draw take longer.
    """
    return calibrate_rig({"a": "a", "b": "b"}, target, "rig.toml", **{"distortion_terms": 5} | rest)


def printed_views(rig, target, count):
    rng = np.random.default_rng(1)
    return [[printed(camera, target, T, rng) for T in positions(count)] for camera in rig.cameras]


# --- what is right


def test_chessboards_give_the_truth_within_the_stated_uncertainty(folder, caplog):
    result = calibrated(picture=picture_of_residuals)
    off = off_sigma(result, make_rig())
    assert len(off) == 24
    assert off.abs().max() < 4
    assert np.sqrt((off**2).mean()) < 2
    assert caplog.messages == []
    again, found = read_rig("rig.toml"), result.calibrated
    np.testing.assert_array_equal(again.covariance.matrix, found.rig_covariance.matrix)
    np.testing.assert_array_equal(again.cameras[1].matrix, found.cameras[1].matrix)
    assert [path.name for path in sorted(folder.iterdir()) if path.is_file()] == sorted(FILES)
    assert cv2.imread("rig_residuals.png").std() > 10
    table = pd.read_csv("rig_views.csv")
    assert (table["status"] == "used").all()
    assert (table["worst_px"] > table["rms_px"]).all()
    lines = as_lines(result._replace(passed_over=10))
    assert lines[1].split()[:3] == ["a", "10", "420"]
    assert lines[3].split()[:3] == ["all", "10", "840"]
    assert float(lines[3].split()[3]) < 0.12
    assert len(re.findall(r"\+- \d", "".join(lines))) == 9 + 15
    assert lines[-1].endswith("evenly among the others: 10")


@pytest.mark.parametrize("target", [CIRCLES, ACIRCLES, CHARUCO], ids=str)
def test_printed_targets_give_the_truth(target, tmp_path, monkeypatch):
    write_views(tmp_path, printed_views(STRAIGHT, target, 7))
    monkeypatch.chdir(tmp_path)
    result = calibrated(target, distortion_terms=0)
    assert (result.views["status"] == "used").all()
    # a circle's blob has its centre off the circle's by up to 0.05 px here: more than its noise
    assert off_sigma(result, STRAIGHT).abs().max() < (4 if target is CHARUCO else 10)
    # along z it is worth 0.8 mm
    here, there = (rig.cameras[1] for rig in (result.calibrated, STRAIGHT))
    np.testing.assert_allclose(here.centre, there.centre, rtol=0, atol=3.0)
    np.testing.assert_allclose(here.focal, there.focal, rtol=5e-3)
    assert result.calibrated.rms_px < 0.12


@pytest.mark.parametrize("look", appearances(CHARUCO), ids=str)
@pytest.mark.parametrize("target", [CHESSBOARD, CIRCLES, CHARUCO], ids=str)
def test_targets_in_light_on_dark_and_in_a_mirror(target, look):
    usual = board_frames(10)[0][0]
    if target is not CHESSBOARD:
        usual = printed_views(STRAIGHT, target, 1)[0][0]
    expected = np.array(find_target(usual, target))
    taken = 255 - usual if look.inverted else usual
    if look.mirrored:
        taken = np.ascontiguousarray(taken[:, ::-1])
        expected[:, 0] = SIZE[0] - 1 - expected[:, 0]
    seen = detect_target(taken, target, appearances(target))
    assert seen.appearance.inverted == look.inverted
    ways = [expected]
    if target is CHARUCO:
        assert seen.appearance.mirrored == look.mirrored
    elif look.mirrored or target is CIRCLES:
        # what looks the same in a mirror is counted from another corner
        grid = expected.reshape(6, 7, 2)
        ways = [grid[::a, ::b].reshape(-1, 2) for a in (1, -1) for b in (1, -1)]
    elif look.inverted:
        ways = [expected[::-1]]
    assert min(np.abs(seen.uv - way).max() for way in ways) < 0.02  # px


def test_a_board_in_light_on_dark_between_two_cameras_that_face_each_other(tmp_path, monkeypatch):
    first = STRAIGHT.cameras[0]
    behind = motion([0, 0, 960], [0, np.pi, 0])
    rig = Rig((first, replace(first, name="b", T_cam_world=behind.inv())))
    write_views(tmp_path, [[255 - image for image in of] for of in printed_views(rig, CHARUCO, 7)])
    monkeypatch.chdir(tmp_path)
    result = calibrated(CHARUCO, distortion_terms=0)
    negative, mirrored, scale = result.notes
    assert "negative of 14 of the 14 images that show it: the target is light on dark" in negative
    assert "seen as in a mirror by b in 7 of 7 images" in mirrored
    apart = np.linalg.norm(result.calibrated.cameras[1].centre)
    assert apart == pytest.approx(960, rel=0.01)
    assert re.search(rf"squares of 20 mm .*: b {apart:.4g} mm, the target \d+ to \d+ mm$", scale)


@pytest.mark.usefixtures("folder")
def test_a_size_in_another_unit_is_refused_or_asked_about(caplog):
    for square, unit in ((0.015, "m"), (15e3, "micrometres")):
        says = rf"^square: with {square:g} mm .* likely it is in {unit}, and --square 15 is meant"
        with pytest.raises(ValueError, match=says):
            calibrated(replace(CHESSBOARD, square_mm=square))
    assert not Path("rig.toml").exists()
    result = calibrated(replace(CHESSBOARD, square_mm=1.5))
    (asked,) = caplog.messages
    assert "likely it is in cm or inches, and --square 15 or --square 38.1 is meant" in asked
    assert result.notes[-1].startswith("with squares of 1.5 mm the distance from a is: b 1")


def test_part_of_a_charuco_board_is_enough_and_too_little_is_said(tmp_path, monkeypatch):
    frames = printed_views(STRAIGHT, CHARUCO, 6)
    half, most = (find_target(frames[c][k], CHARUCO)[:, 0] for c, k in ((0, 1), (1, 2)))
    frames[0][1][:, int(half.mean()) :] = 90  # hidden
    frames[1][2][:, int(np.sort(most)[4]) :] = 90
    write_views(tmp_path, frames)
    monkeypatch.chdir(tmp_path)
    result = calibrated(CHARUCO, distortion_terms=0)
    rows = result.views.set_index(["camera", "view"])
    assert rows.loc[("a", "01.png"), "status"] == "used"
    assert 6 <= rows.loc[("a", "01.png"), "points"] < 20
    assert rows.loc[("b", "02.png"), "status"] == "dropped"
    assert re.match("too few points|no target found", rows.loc[("b", "02.png"), "reason"])
    assert off_sigma(result, STRAIGHT).abs().max() < 4


@pytest.mark.usefixtures("folder")
def test_views_that_are_missing_empty_bent_or_of_another_pair():
    frames = board_frames(10)
    Path("a/03.png").unlink()
    cv2.imwrite("b/05.png", GREY)
    v, u = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float32)
    bent = cv2.remap(frames[0][4], u + 3 * np.sin(v / 25).astype(np.float32), v, cv2.INTER_LINEAR)
    cv2.imwrite("a/04.png", bent)
    cv2.imwrite("b/07.png", frames[1][1])  # another view under this name
    result = calibrated()
    dropped = result.views[result.views["status"] != "used"]
    why = {f"{row.camera}/{row.view}": row.reason or row.status for row in dropped.itertuples()}
    assert set(why) == {"a/03.png", "b/05.png", "a/04.png", "b/07.png"}
    assert why["a/03.png"] == "missing"
    assert why["b/05.png"] == "no target found"
    assert re.fullmatch(r"residual \d\.\d\d px, far above .* \(0\.\d\d px .*\)", why["a/04.png"])
    assert why["b/07.png"] == "the target lies elsewhere than for a, against all other views"
    assert off_sigma(result, make_rig()).abs().max() < 4
    text = as_lines(result)
    assert "views dropped: 3" in text
    assert "  b: no target found in 1 of its views: 05.png" in text
    assert "  a: no image in 1 of its views: 03.png" in text


# --- targets


def test_a_target_that_can_be_counted_in_two_ways_is_counted_upright():
    target, rng = Target("circles", 5, 4, 15.0), np.random.default_rng(0)
    camera = STRAIGHT.cameras[0]
    for turn, way in ((0, 1), (0.7, 1), (-0.7, 1), (3.14, -1), (3.5, -1)):
        turned = motion([0, 0, 480], np.deg2rad([10, 15, 0])) * motion([0, 0, 0], [0, 0, turn])
        T = turned * motion(-target.points.mean(axis=0))
        uv = find_target(printed(camera, target, T, rng), target)
        expected = camera.project(T.apply(np.array(target.points)))
        np.testing.assert_allclose(uv[::way], expected, rtol=0, atol=0.15)
    upright = np.array(target.points[:, :2]) + 50.0
    mirrored = upright.reshape(4, 5, 2)[:, ::-1].reshape(-1, 2)
    for counted in (upright, upright[::-1], mirrored, mirrored[::-1]):
        np.testing.assert_array_equal(upright_corners(counted, target), upright)


@pytest.mark.parametrize(
    ("shown", "sought"),
    [
        (ACIRCLES, ("circles", 4, 9)),
        (CIRCLES, ("acircles", 4, 9)),
        (CIRCLES, ("acircles", 6, 7)),
        (CHARUCO, ("circles", 4, 4)),
        (CHARUCO, ("chessboard", 6, 5)),
        (CHESSBOARD, ("circles", 5, 4)),
    ],
    ids=str,
)
def test_a_grid_that_is_not_there_is_not_found(shown, sought):
    images = board_frames(10)[0]
    if shown is not CHESSBOARD:
        images = printed_views(STRAIGHT, shown, 2)[0]
    for image in images[:2]:
        assert np.isnan(find_target(image, Target(*sought, 15.0))).all()


def flat(board, width, height):
    """A ChArUco board as it is drawn, 3 px a mm, and where its corner lies."""
    image = board.generateImage((3 * width, 3 * height))
    return cv2.copyMakeBorder(image, *[30] * 4, cv2.BORDER_CONSTANT, value=255)


def test_charuco_boards_of_other_numbers_and_of_old(tmp_path, monkeypatch):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((6, 5), 20.0, 15.0, dictionary, np.arange(17, 32))
    image = flat(board, 120, 100)
    right = Target("charuco", 6, 5, 20.0, 15.0, "5X5_100", 17)
    expected = right.points[:, :2] * 3 + 30 + 60 - 0.5
    np.testing.assert_allclose(find_target(image, right), expected, atol=0.1)
    for old, name in ((False, "5X5_100"), (True, "DICT_5X5_100")):
        target = Target("charuco", 6, 4, 20.0, 12.0, name)
        board = cv2.aruco.CharucoBoard((6, 4), 20.0, 12.0, dictionary)
        board.setLegacyPattern(old)
        expected = target.points[:, :2] * 3 + 30 + 60 - 0.5
        np.testing.assert_allclose(find_target(flat(board, 120, 80), target), expected, atol=0.1)
    monkeypatch.chdir(tmp_path)
    write_views(tmp_path, [[image] * 3] * 2)
    says = "markers 17 to 31 of 5X5_100 are seen, the board has 0 to 14: .*--first-marker 17"
    with pytest.raises(ValueError, match=says):
        calibrated(replace(right, first_marker=0))


@pytest.mark.parametrize("target", [CHESSBOARD, CIRCLES, CHARUCO], ids=str)
def test_nothing_to_find(target):
    for image in (GREY, np.zeros((6, 6), np.uint8)):
        uv = find_target(image, target)
        assert uv.shape == (len(target.points), 2)
        assert np.isnan(uv).all()
    assert COUNTED[target.kind] in hint(target)
    assert ("as in a mirror" in hint(target)) == (target is CHARUCO)
    with pytest.raises(ValueError, match="image: expected 8 bit"):
        find_target(np.zeros((9, 9)), target)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (("stars", 5, 5, 10.0), "board: expected one of chessboard, .*, got 'stars'"),
        (("chessboard", 2, 5, 10.0), r"columns: expected a number in \[3"),
        (("charuco", 5, 3, 10.0), r"rows: expected a number in \[4"),
        (("circles", 5, 5.5, 10.0), "rows: expected a whole number"),
        (("acircles", 4, 10, 10.0), "rows: expected an odd number, got 10"),
        (("circles", 5, 5, np.nan), "square_mm: expected"),
        (("charuco", 5, 5, 10.0, 10.0), "marker_mm: expected less than a square"),
        (("charuco", 5, 5, 10.0, 5.0, "7X7"), "dictionary: expected a name"),
        (("charuco", 12, 12, 10.0), "dictionary: 4X4_50 has 50 markers, the board has 72"),
        (("charuco", 6, 5, 10.0, None, None, 36), "50 markers, the board has 15 from 36 on"),
        (("chessboard", 5, 5, 10.0, 5.0), "marker_mm: a chessboard"),
        (("circles", 5, 5, 10.0, None, None, 3), "first_marker: a circles"),
    ],
)
def test_target_refuses(fields, message):
    with pytest.raises(ValueError, match=message):
        Target(*fields)


# --- what is wrong; as a command: test_faults


def never_together(folder):
    for k in range(10):
        cv2.imwrite(f"{'ab'[k % 2]}/{k:02d}.png", GREY)


def always_one_view(folder):
    for path in folder.glob("[ab]/0[1-9].png"):
        shutil.copy(path.with_name("00.png"), path)


def another_size(folder):
    cv2.imwrite("b/01.png", GREY[:-8])


def a_video(folder):
    writer = cv2.VideoWriter("b.mkv", cv2.VideoWriter_fourcc(*"FFV1"), 30, SIZE, isColor=False)
    writer.write(GREY)
    writer.release()


def no_image(folder):
    for image in folder.glob("[ab]/*.png"):
        image.write_bytes(b"never read")


BOTH = {"a": "a", "b": "b"}


@pytest.mark.parametrize(
    ("spoil", "sources", "out", "says"),
    [
        (never_together, BOTH, "rig.toml", "^b: no view in which it sees .* together with a$"),
        (
            always_one_view,
            BOTH,
            "rig.toml",
            "^a: camera a: the target is in the same place in all 10",
        ),
        (another_size, BOTH, "rig.toml", r"01\.png: 480 x 352 pixels, .* images have 480 x 360"),
        (
            a_video,
            {"a": "a", "b": "b.mkv"},
            "rig.toml",
            "images or videos of all cameras, got both",
        ),
        (no_image, {"a": "a"}, "rig.toml", "images: expected two or more"),
        (no_image, {}, "rig.toml", "images: expected two or more cameras, got none"),
        (no_image, {"a": "a", "metadata": "b"}, "rig.toml", "called metadata"),
        (no_image, BOTH, "rig.txt", r"rig\.txt: expected a name that ends in \.toml"),
        (no_image, {"a": "a", "b": "there/b*.png"}, "rig.toml", "no such folder there"),
        (
            no_image,
            {"a": "a", "b": "b/left*.png"},
            "rig.toml",
            r"left\*\.png: no image of that name",
        ),
    ],
)
def test_sources_that_are_refused(folder, spoil, sources, out, says):
    spoil(folder)
    with pytest.raises(ValueError, match=says):
        calibrate_rig(sources, CHESSBOARD, out)
    assert not any((folder / name).exists() for name in FILES)


@pytest.mark.usefixtures("folder")
def test_a_part_of_a_chessboard_is_said_to_be_one():
    result = calibrated(Target("chessboard", 5, 4, 15.0))
    (said,) = [note for note in result.warnings if "are a part" in note]
    assert said.startswith("a chessboard of 7 x 6 inner corners is in ")
    assert "likely --columns 7 --rows 6 is meant" in said
    images = board_frames(10)[0][:5]
    assert larger(images, CHESSBOARD) == larger(images, Target("chessboard", 6, 7, 15.0)) == ""
    assert larger(images, Target("circles", 5, 5, 15.0)) == larger([], CHESSBOARD) == ""
