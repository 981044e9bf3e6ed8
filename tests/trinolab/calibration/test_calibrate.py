"""From images of a target to a rig file: rendered truth, missing and spoiled views, mistakes, a
real stereo pair.
"""

import re
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from boards import CALIBRATE, LENS, SIZE, board_frames, make_rig, positions, write_views
from healthy import contents, run
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration import calibrate, views
from trinolab.calibration.calibrate import as_lines, calibrate_rig
from trinolab.calibration.hints import hint, larger
from trinolab.calibration.outliers import calibrate_robustly, too_few
from trinolab.calibration.target import (
    Appearance,
    Target,
    appearances,
    detect_target,
    find_target,
    upright_corners,
)
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_real_sets, real_set
from trinolab.files import outputs
from trinolab.files.rigs import read_rig
from workbench.plotting import calibration as figures
from workbench.studies.real_recordings import load_caliscope

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
CIRCLES = Target("circles", 7, 6, 15.0)
ACIRCLES = Target("acircles", 4, 9, 10.0)
CHARUCO = Target("charuco", 6, 5, 20.0)
FILES = ("rig.toml", "rig.covariance.toml", "rig_views.csv", "rig_residuals.png")


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
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        board = cv2.aruco.CharucoBoard(
            (target.columns, target.rows), target.square_mm, 0.75 * target.square_mm, dictionary
        )
        side, margin = int(scale * target.square_mm), int(scale * 6)
        image = cv2.copyMakeBorder(
            board.generateImage((side * target.columns, side * target.rows)),
            margin,
            margin,
            margin,
            margin,
            cv2.BORDER_CONSTANT,
            value=255,
        )
        first = -target.square_mm - 6.0
    return image, np.array(
        [[1 / scale, 0, first + 0.5 / scale], [0, 1 / scale, first + 0.5 / scale], [0, 0, 1]]
    )


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
        values += [
            *camera.focal,
            *camera.principal_point,
            *camera.distortions,
            *T.translation,
            *np.rad2deg(T.rotation.as_rotvec()),
        ]
    table = result.parameters
    return ((table["value"] - values) / table["sigma"])[table["sigma"] > 0]


@pytest.fixture(scope="module")
def frames():
    return board_frames(10)


@pytest.fixture(scope="module")
def rendered(frames, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    write_views(folder, frames)
    return folder


@pytest.fixture
def folder(rendered, tmp_path, monkeypatch):
    """The working folder: a copy of the rendered images, in a and b."""
    for name in "ab":
        shutil.copytree(rendered / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def calibrated(target=CHESSBOARD, **rest):
    """A calibration with all distortions, unless others are given, and without the picture of its
    residuals: to choose and to draw take longer.
    """
    return calibrate_rig({"a": "a", "b": "b"}, target, "rig.toml", **{"distortion_terms": 5} | rest)


def reasons(result):
    dropped = result.views[result.views["status"] != "used"]
    return {f"{row.camera}/{row.view}": row.reason or row.status for row in dropped.itertuples()}


# --- what is right


def test_command_on_rendered_chessboards(folder, capfd):
    assert run(CALIBRATE) == 0
    out, err = capfd.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].split() == ["camera", "views", "points", "rms", "/", "px"]
    assert [line.split()[:3] for line in lines[1:4]] == [
        ["a", "10", "420"],
        ["b", "10", "420"],
        ["all", "10", "840"],
    ]
    assert float(lines[3].split()[3]) < 0.12
    assert "a, the world frame" in lines
    assert len(re.findall(r"\+- \d", out)) == 9 + 15
    assert "views dropped: none" in lines
    assert lines[-1] == f"written: {', '.join(FILES)}"
    assert [path.name for path in sorted(folder.iterdir()) if path.is_file()] == sorted(FILES)
    rig = read_rig("rig.toml")
    assert rig.names == ("a", "b")
    np.testing.assert_array_equal(rig.cameras[0].T_cam_world.as_matrix(), np.eye(4))
    picture = cv2.imread("rig_residuals.png")
    assert picture.shape[0] > 500
    assert picture.std() > 10
    table = pd.read_csv("rig_views.csv")
    assert list(table.columns) == [
        "camera",
        "view",
        "status",
        "points",
        "rms_px",
        "worst_px",
        "reason",
    ]
    assert (table["status"] == "used").all()
    assert (table["worst_px"] > table["rms_px"]).all()


@pytest.mark.usefixtures("folder")
def test_chessboards_give_the_truth_within_the_stated_uncertainty():
    result = calibrated()
    off = off_sigma(result, make_rig())
    assert len(off) == 24
    assert off.abs().max() < 4
    assert np.sqrt((off**2).mean()) < 2
    for path in result.files:
        assert path.is_file()
    again = read_rig("rig.toml")
    np.testing.assert_array_equal(again.covariance.matrix, result.found.rig_covariance.matrix)
    written = again.cameras[1]
    np.testing.assert_array_equal(written.matrix, result.found.cameras[1].matrix)


@pytest.mark.parametrize("target", [CIRCLES, ACIRCLES, CHARUCO], ids=str)
def test_printed_targets_give_the_truth(target, tmp_path, monkeypatch):
    rig, rng = make_rig(np.zeros(5)), np.random.default_rng(1)
    write_views(
        tmp_path,
        [[printed(camera, target, T, rng) for T in positions(7)] for camera in rig.cameras],
    )
    monkeypatch.chdir(tmp_path)
    result = calibrated(target, distortion_terms=0)
    assert (result.views["status"] == "used").all()
    # a circle's blob has its centre off the circle's by up to 0.05 px here: more than its noise
    off = off_sigma(result, rig)
    assert off.abs().max() < (4 if target is CHARUCO else 10)
    b = result.found.cameras[1]
    # along z it is worth 0.8 mm
    np.testing.assert_allclose(b.centre, rig.cameras[1].centre, rtol=0, atol=3.0)
    np.testing.assert_allclose(b.focal, rig.cameras[1].focal, rtol=5e-3)
    assert result.found.rms_px < 0.12


@pytest.mark.parametrize("look", appearances(CHARUCO), ids=str)
@pytest.mark.parametrize("target", [CHESSBOARD, CIRCLES, CHARUCO], ids=str)
def test_targets_in_light_on_dark_and_in_a_mirror(target, look, frames):
    if target is CHESSBOARD:
        usual = frames[0][0]
    else:
        camera, rng = make_rig(np.zeros(5)).cameras[0], np.random.default_rng(1)
        usual = printed(camera, target, positions(1)[0], rng)
    expected = np.array(find_target(usual, target))
    assert np.isfinite(expected).all()
    taken = 255 - usual if look.inverted else usual
    if look.mirrored:
        taken = np.ascontiguousarray(taken[:, ::-1])
        expected[:, 0] = SIZE[0] - 1 - expected[:, 0]
    seen = detect_target(taken, target, appearances(target))
    assert seen.appearance.inverted == look.inverted
    if target is CHARUCO:
        assert seen.appearance.mirrored == look.mirrored
        np.testing.assert_allclose(seen.uv, expected, rtol=0, atol=0.02)  # px
    else:
        # what looks the same in a mirror is counted from another corner
        ways = [
            expected.reshape(6, 7, 2)[::a, ::b].reshape(-1, 2) for a in (1, -1) for b in (1, -1)
        ]
        assert min(np.abs(seen.uv - way).max() for way in ways) < 0.02


def test_a_chessboard_is_counted_from_one_corner_whether_or_not_it_is_inverted(frames):
    """Views of one board have one order, be they found in the image or in its negative."""
    for image in frames[0][:3]:
        inverted = detect_target(255 - image, CHESSBOARD, [Appearance(inverted=True)]).uv
        np.testing.assert_allclose(inverted[::-1], find_target(image, CHESSBOARD), atol=1e-9)


def test_a_board_in_light_on_dark_between_two_cameras_that_face_each_other(
    tmp_path, monkeypatch, capfd
):
    first = make_rig(np.zeros(5)).cameras[0]
    behind = RigidTransform.from_components([0, 0, 960], Rotation.from_rotvec([0, np.pi, 0]))
    rig = Rig((first, replace(first, name="b", T_cam_world=behind.inv())))
    rng = np.random.default_rng(1)
    write_views(
        tmp_path,
        [[255 - printed(camera, CHARUCO, T, rng) for T in positions(7)] for camera in rig.cameras],
    )
    monkeypatch.chdir(tmp_path)
    line = (
        "calibrate --images a=a b=b --board charuco --columns 6 --rows 5 --square 20 "
        "--distortions 0 --out rig.toml"
    )
    assert run(line) == 0
    out = capfd.readouterr().out.splitlines()
    assert (
        "found in the negative of 14 of the 14 images that show it: the target is light on dark (inverted)"
        in out
    )
    assert (
        "seen as in a mirror by b in 7 of 7 images: from behind, or the camera mirrors its images"
        in out
    )
    apart = np.linalg.norm(read_rig("rig.toml").cameras[1].centre)
    assert apart == pytest.approx(960, rel=0.01)
    assert "b, its place and rotation in the frame of a" in out
    assert (
        "places here are camera to world (T_world_cam), rotations as vectors in deg; rig.toml has world "
        "to camera (T_cam_world), in rad"
    ) in out
    (scale,) = [text for text in out if text.startswith("with squares of 20 mm")]
    assert re.search(rf": b {apart:.4g} mm, the target \d+ to \d+ mm$", scale)


def test_only_one_print_is_looked_for_when_it_is_sure():
    counts = Counter({Appearance(inverted=True): views.SURE})
    every = views._likeliest(CHARUCO, Counter(), Counter())
    assert every == list(appearances(CHARUCO))
    assert views._likeliest(CHARUCO, Counter({Appearance(True, True): 1}), counts) == [
        Appearance(True, True),
        Appearance(True, False),
    ]
    assert len(views._likeliest(CHESSBOARD, Counter(), counts)) == 2


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (
            CHARUCO,
            "tried dark on light and light on dark, each as in a mirror as well: check --board, "
            "--dictionary, --columns and --rows, which count squares, and that the board is whole and "
            "sharp",
        ),
        (
            CIRCLES,
            "tried dark on light and light on dark: check --board, --columns and --rows, which count "
            "circles, and that the board is whole and sharp",
        ),
        (
            Target("chessboard", 8, 6, 15.0),
            "tried dark on light and light on dark: check --board, --columns and --rows, which count "
            "inner corners, and that the board is whole and sharp",
        ),
    ],
    ids=str,
)
def test_where_a_target_is_not_found_it_says_what_was_tried(target, said):
    assert hint(target) == said


@pytest.mark.usefixtures("folder")
def test_a_size_in_another_unit_is_refused_or_asked_about(caplog):
    with pytest.raises(
        ValueError,
        match=r"^square: with 0\.015 mm the target would be 0\.\d+ mm away from the cameras; likely it is "
        r"in m, and --square 15 is meant$",
    ):
        calibrated(Target("chessboard", 7, 6, 0.015))
    assert not Path("rig.toml").exists()
    with pytest.raises(ValueError, match="likely it is in micrometres, and --square 15 is meant"):
        calibrated(Target("chessboard", 7, 6, 15000.0))
    result = calibrated(Target("chessboard", 7, 6, 1.5))
    (asked,) = caplog.messages
    assert re.search(
        r"^square: with 1\.5 mm the target would be \d+\.?\d* mm away from the cameras; likely it is in cm or "
        r"inches, and --square 15 or --square 38\.1 is meant; is it so\?$",
        asked,
    )
    assert result.notes[-1].startswith("with squares of 1.5 mm the distance from a is: b 1")
    caplog.clear()
    calibrated()
    assert caplog.messages == []


@pytest.mark.usefixtures("folder")
def test_a_wrong_count_of_corners_is_refused_with_what_to_check():
    with pytest.raises(
        ValueError,
        match=r"camera a: target \(chessboard, 8 x 6 inner corners\) found in 0 of 10 images, "
        r"expected three or more; tried .* --columns and --rows, which count inner corners, .*sharp$",
    ):
        calibrated(Target("chessboard", 8, 6, 15.0))


def test_part_of_a_charuco_board_is_enough_and_too_little_is_said(tmp_path, monkeypatch):
    rig, rng = make_rig(np.zeros(5)), np.random.default_rng(1)
    frames = [[printed(camera, CHARUCO, T, rng) for T in positions(6)] for camera in rig.cameras]
    uv = find_target(frames[0][1], CHARUCO)
    assert np.isfinite(uv).all()
    frames[0][1][:, int(uv[:, 0].mean()) :] = 90  # half of the board is hidden
    # nearly all of it
    frames[1][2][:, int(np.sort(find_target(frames[1][2], CHARUCO)[:, 0])[4]) :] = 90
    write_views(tmp_path, frames)
    monkeypatch.chdir(tmp_path)
    result = calibrated(CHARUCO, distortion_terms=0)
    rows = result.views.set_index(["camera", "view"])
    assert rows.loc[("a", "01.png"), "status"] == "used"
    assert 6 <= rows.loc[("a", "01.png"), "points"] < 20
    assert rows.loc[("b", "02.png"), "status"] == "dropped"
    assert re.match("too few points|no target found", rows.loc[("b", "02.png"), "reason"])
    assert off_sigma(result, rig).abs().max() < 4


# --- views that are missing, and views that do not fit


@pytest.mark.usefixtures("folder")
def test_missing_and_empty_views():
    Path("a/03.png").unlink()
    cv2.imwrite("b/05.png", np.full(SIZE[::-1], 90, np.uint8))
    result = calibrated()
    assert reasons(result) == {"a/03.png": "missing", "b/05.png": "no target found"}
    assert off_sigma(result, make_rig()).abs().max() < 4
    text = as_lines(result)
    assert "views dropped: 1" in text
    assert "  b: no target found in 1 of its views: 05.png" in text
    assert "  a: no image in 1 of its views: 03.png" in text


@pytest.mark.usefixtures("folder")
def test_a_bent_view_and_a_wrong_pair_are_left_out(frames):
    v, u = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float32)
    bent = cv2.remap(frames[0][4], u + 3 * np.sin(v / 25).astype(np.float32), v, cv2.INTER_LINEAR)
    cv2.imwrite("a/04.png", bent)
    cv2.imwrite("b/07.png", frames[1][1])  # another view under this name
    why = reasons(result := calibrated())
    assert set(why) == {"a/04.png", "b/07.png"}
    assert re.fullmatch(
        r"residual \d\.\d\d px, far above the others \(0\.\d\d px in the middle\)", why["a/04.png"]
    )
    assert why["b/07.png"] == "the target lies elsewhere than for a, against all other views"
    assert off_sigma(result, make_rig()).abs().max() < 4


def test_a_camera_that_contradicts_two_others_is_the_one_left_out():
    rig, poses = make_rig(), positions(8)
    third = Camera(
        "c", SIZE, rig.cameras[0].matrix, LENS, RigidTransform.from_translation([50.0, 0, 0])
    )
    uv = np.stack(
        [
            [camera.project(T.apply(np.array(CHESSBOARD.points))) for T in poses]
            for camera in (*rig.cameras, third)
        ]
    )
    uv += np.random.default_rng(0).normal(0, 0.05, uv.shape)
    uv[0, 2] = uv[0, 5]
    uv[1, 3, 10] += 6.0
    found, why = calibrate_robustly(np.array(CHESSBOARD.points), uv, [SIZE] * 3, ("a", "b", "c"))
    assert sorted(zip(*map(list, np.nonzero(why != "")), strict=True)) == [(0, 2), (1, 3)]
    assert why[0, 2] == "the target lies elsewhere than for b, c, against all other views"
    assert "far above the others" in why[1, 3]
    assert found.sigma_px == pytest.approx(0.05, rel=0.1)


# --- sources


@pytest.mark.usefixtures("folder")
def test_patterns_pair_by_what_the_star_stands_for():
    Path("photos").mkdir()
    for name in "ab":
        for path in Path(name).iterdir():
            path.rename(f"photos/{name}_{path.name}")
    result = calibrate_rig(
        {"a": "photos/a_*.png", "b": "photos/b_*.png"}, CHESSBOARD, "rig.toml", distortion_terms=5
    )
    assert list(result.views["view"][:2]) == ["00", "01"]
    assert (result.views["status"] == "used").all()


def test_videos_are_paired_by_frame_and_thinned(tmp_path, monkeypatch, frames):
    monkeypatch.chdir(tmp_path)
    for name, side in zip("ab", frames, strict=True):
        writer = cv2.VideoWriter(
            f"{name}.mkv", cv2.VideoWriter_fourcc(*"FFV1"), 30, SIZE, isColor=False
        )
        for frame in side[: 10 if name == "a" else 8]:
            for _ in range(2):
                writer.write(frame)
        writer.release()
    result = calibrate_rig(
        {"a": "a.mkv", "b": "b.mkv"}, CHESSBOARD, "rig.toml", most_views=10, distortion_terms=5
    )
    assert result.passed_over == 10
    assert list(result.views["view"][:3]) == ["000000", "000002", "000004"]
    assert reasons(result) == {"b/000016": "missing", "b/000018": "missing"}
    assert off_sigma(result, make_rig()).abs().max() < 4
    assert as_lines(result)[-1] == "views not looked at, evenly among the others: 10"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("bits", "scale", "offset"), [(16, 257, 0), (12, 16, 0), (10, 4, 0), (16, 2, 29000)]
)
def test_colour_and_16_bit_are_converted_and_said(bits, scale, offset, caplog, frames):
    """The last are the counts of a thermal camera, 510 about a large number."""
    for k, frame in enumerate(frames[0]):
        cv2.imwrite(f"a/{k:02d}.png", cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
        cv2.imwrite(f"b/{k:02d}.png", frames[1][k].astype(np.uint16) * scale + offset)
    caplog.set_level("INFO", logger="trinolab")
    converted = calibrated()
    assert caplog.messages == [
        "a/00.png: colour converted to grey; said once",
        f"b/00.png: {bits} bit scaled to grey levels 0 to 255; said once",
    ]
    assert off_sigma(converted, make_rig()).abs().max() < 4
    assert converted.views["rms_px"].mean() < 0.06  # 8 bit: 0.05; without a stretch 0.19


# --- targets


def test_a_target_that_can_be_counted_in_two_ways_is_counted_upright():
    target, rng = Target("circles", 5, 4, 15.0), np.random.default_rng(0)
    camera = make_rig(np.zeros(5)).cameras[0]
    for turn, way in ((0, 1), (40, 1), (-40, 1), (180, -1), (200, -1)):
        R = Rotation.from_rotvec(np.deg2rad([10.0, 15, 0])) * Rotation.from_rotvec(
            np.deg2rad([0.0, 0, turn])
        )
        T = RigidTransform.from_components([0, 0, 480] - R.apply(target.points.mean(axis=0)), R)
        uv = find_target(printed(camera, target, T, rng), target)
        np.testing.assert_allclose(
            uv[::way], camera.project(T.apply(np.array(target.points))), rtol=0, atol=0.15
        )


def test_points_that_are_counted_as_in_a_mirror_are_turned_over():
    target = Target("circles", 4, 3, 10.0)
    upright = np.array(target.points[:, :2]) + 50.0
    mirrored = upright.reshape(3, 4, 2)[:, ::-1].reshape(-1, 2)
    for counted in (upright, upright[::-1], mirrored, mirrored[::-1]):
        np.testing.assert_array_equal(upright_corners(counted, target), upright)


@pytest.mark.parametrize(
    ("shown", "sought"),
    [
        (ACIRCLES, ("circles", 4, 9)),
        (ACIRCLES, ("circles", 9, 4)),
        (ACIRCLES, ("chessboard", 4, 9)),
        (CIRCLES, ("acircles", 4, 9)),
        (CIRCLES, ("acircles", 6, 7)),
        (CIRCLES, ("chessboard", 7, 6)),
        (CHARUCO, ("circles", 4, 4)),
        (CHARUCO, ("chessboard", 6, 5)),
        (CHESSBOARD, ("circles", 5, 4)),
        (CHESSBOARD, ("acircles", 4, 11)),
    ],
    ids=str,
)
def test_a_grid_that_is_not_there_is_not_found(shown, sought, frames):
    target, rng = Target(*sought, 15.0), np.random.default_rng(1)
    camera = make_rig(np.zeros(5)).cameras[0]
    for k, T in enumerate(positions(6)):
        image = frames[0][k] if shown is CHESSBOARD else printed(camera, shown, T, rng)
        assert np.isnan(find_target(image, target)).all()


def test_a_charuco_board_whose_markers_begin_at_another_number(tmp_path, monkeypatch):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((6, 5), 20.0, 15.0, dictionary, np.arange(17, 32))
    image = cv2.copyMakeBorder(
        board.generateImage((360, 300)), 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255
    )
    right = Target("charuco", 6, 5, 20.0, 15.0, "5X5_100", 17)
    expected = right.points[:, :2] * 3 + 30 + 60 - 0.5  # 3 px a mm
    np.testing.assert_allclose(find_target(image, right), expected, atol=0.1)
    monkeypatch.chdir(tmp_path)
    write_views(tmp_path, [[image] * 3] * 2)
    with pytest.raises(
        ValueError, match="markers 17 to 31 of 5X5_100 are seen, the board has 0 to 14"
    ) as caught:
        calibrated(replace(right, first_marker=0))
    assert "--first-marker 17" in str(caught.value)


def test_an_image_of_a_few_pixels_shows_no_target():
    for target in (CHESSBOARD, CIRCLES, CHARUCO):
        found = find_target(np.zeros((6, 6), np.uint8), target)
        assert np.isnan(found).all()
        assert found.shape == (len(target.points), 2)


def test_points_on_one_line_or_too_few_are_no_view():
    points = np.array(CHESSBOARD.points)
    uv = np.full((1, 4, len(points), 2), np.nan)
    on_one_line = points[:, 1] == 0
    uv[0, 1, on_one_line] = points[on_one_line, :2]
    uv[0, 2, :3] = points[:3, :2]
    uv[0, 3] = points[:, :2]
    assert too_few(points, uv).tolist() == [
        [
            "no target found",
            "the 7 points found lie on one line",
            "too few points: 3 of 42, expected 6 or more",
            "",
        ]
    ]


def test_a_square_chessboard_is_counted_upright_as_well():
    y, x = np.mgrid[:180, :180] // 30
    image = cv2.GaussianBlur(np.where((x + y) % 2 == 0, 30, 220).astype(np.uint8), (5, 5), 1)
    image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=220)
    target = Target("chessboard", 5, 5, 30.0)
    for turn in range(4):
        uv = find_target(np.rot90(image, turn).copy(), target)
        np.testing.assert_allclose(uv, target.points[:, :2] + 69.5, rtol=0, atol=0.05)


@pytest.mark.parametrize("target", [CHESSBOARD, CIRCLES, CHARUCO], ids=str)
def test_nothing_to_find(target):
    uv = find_target(np.full(SIZE[::-1], 120, np.uint8), target)
    assert uv.shape == (len(target.points), 2)
    assert np.isnan(uv).all()


def test_an_old_charuco_board_is_found_as_well():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    for old, name in ((False, "5X5_100"), (True, "DICT_5X5_100")):
        target = Target("charuco", 6, 4, 20.0, 12.0, name)
        board = cv2.aruco.CharucoBoard((6, 4), 20.0, 12.0, dictionary)
        board.setLegacyPattern(old)
        image = cv2.copyMakeBorder(
            board.generateImage((360, 240)), 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255
        )
        expected = target.points[:, :2] * 3 + 30 + 60 - 0.5  # 3 px a mm
        np.testing.assert_allclose(find_target(image, target), expected, atol=0.1)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            ("stars", 5, 5, 10.0),
            "board: expected one of chessboard, circles, acircles, charuco, got 'stars'",
        ),
        (("chessboard", 2, 5, 10.0), "columns: expected a number in [3"),
        (("charuco", 5, 3, 10.0), "rows: expected a number in [4"),
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
    with pytest.raises(ValueError, match=re.escape(message)):
        Target(*fields)


def test_find_target_takes_8_bit_only():
    with pytest.raises(ValueError, match="image: expected 8 bit"):
        find_target(np.zeros((9, 9)), CHESSBOARD)


# --- what is wrong; as a command: test_faults


def only_view(*kept):
    for name, numbers in zip("ab", kept, strict=True):
        for path in Path(name).iterdir():
            if int(path.stem) not in numbers:
                path.unlink()


GREY = np.full(SIZE[::-1], 90, np.uint8)


@pytest.mark.usefixtures("folder")
def test_cameras_that_never_see_the_target_together():
    for k in range(10):
        cv2.imwrite(f"{'ab'[k % 2]}/{k:02d}.png", GREY)
    with pytest.raises(
        ValueError, match=r"^b: no view in which it sees the target together with a$"
    ):
        calibrated()


def test_images_and_videos_together(folder, frames):
    writer = cv2.VideoWriter("b.mkv", cv2.VideoWriter_fourcc(*"FFV1"), 30, SIZE, isColor=False)
    writer.write(frames[1][0])
    writer.release()
    with pytest.raises(
        ValueError, match="images: expected images or videos of all cameras, got both"
    ):
        calibrate_rig({"a": "a", "b": "b.mkv"}, CHESSBOARD, "rig.toml")


@pytest.mark.parametrize(
    ("sources", "out", "says"),
    [
        ({"a": "a"}, "rig.toml", "images: expected two or more"),
        ({}, "rig.toml", "images: expected two or more cameras, got none"),
        ({"a": "a", "metadata": "b"}, "rig.toml", "called metadata"),
        ({"a": "a", "b": "b"}, "rig.txt", "rig.txt: expected a name that ends in .toml"),
        ({"a": "a", "b": "there/b*.png"}, "rig.toml", "no such folder there"),
        ({"a": "a", "b": "b/left*.png"}, "rig.toml", "b/left*.png: no image of that name"),
    ],
)
def test_sources_that_are_refused_before_an_image_is_looked_at(folder, sources, out, says):
    for image in folder.glob("[ab]/*.png"):
        image.write_bytes(b"never read")
    with pytest.raises(ValueError, match=re.escape(says)):
        calibrate_rig(sources, CHESSBOARD, out)


def test_images_of_two_sizes_are_refused_with_both(folder):
    cv2.imwrite("b/01.png", GREY[:-8])
    with pytest.raises(
        ValueError,
        match=r"01\.png: 480 x 352 pixels, the camera's other images have 480 x 360",
    ):
        calibrate_rig({"b": "b", "a": "a"}, CHESSBOARD, "rig.toml")


@pytest.mark.heavy
def test_views_that_say_too_little_name_the_cameras(folder):
    only_view((0, 1, 2, 3), (0, 1, 2, 3))
    for name in "ab":
        for k in range(1, 4):
            shutil.copy(f"{name}/00.png", f"{name}/{k:02d}.png")
    with pytest.raises(
        ValueError, match=r"^images of a, b: (camera a: )?.*expected (positions|views)"
    ):
        calibrated()
    assert not any((folder / name).exists() for name in FILES)


@pytest.mark.parametrize(
    "place",
    [
        (views, "detect_target"),
        (calibrate, "calibrate_robustly"),
        (figures, "plot_residuals"),
        (outputs.os, "replace"),
    ],
)
def test_an_interruption_leaves_nothing(folder, monkeypatch, capfd, place):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(*place, interrupted)
    before = contents(folder)
    assert run(CALIBRATE) == 130
    assert "interrupted" in capfd.readouterr().err
    assert contents(folder) == before


# --- a real stereo pair, and another program that reads the rig

# mm
ANIPOSE_POINTS = [[0, 0, 400], [120, -60, 500], [-90, 80, 350], [40, 100, 650], [-150, -110, 600]]
# aniposelib 0.8.0: CameraGroup.load of the file that the command below wrote, then
# .project(points); px
ANIPOSE_PIXELS = [
    [
        [342.305623636319, 234.899557154631],
        [467.742828743888, 172.220067546083],
        [209.492176625097, 353.023450687489],
        [374.898098032708, 316.404431753756],
        [212.50960557094, 139.775930827598],
    ],
    [
        [219.038967515479, 247.487728601076],
        [368.597045283466, 182.636586420738],
        [84.562787754263, 361.331814397773],
        [294.321070228063, 328.782546503898],
        [130.586428357559, 154.059689170046],
    ],
]
ANIPOSE_RIG = """\
[left]
name = "left"
size = [640, 480]
matrix = [
  [533.6557300730143, 0.0, 342.3056236363187],
  [0.0, 533.6711607546888, 234.89955715463077],
  [0.0, 0.0, 1.0]]
distortions = [-0.2871337638856575, 0.08116521677704466, 0.0011302524892365317,
  -0.00013026803964868736, 0.0318076922839632]
rotation = [0.0, 0.0, 0.0]
translation = [-0.0, -0.0, -0.0]
[right]
name = "right"
size = [640, 480]
matrix = [
  [537.2179114505733, 0.0, 327.1526708452543],
  [0.0, 536.7786243628619, 249.8637799993868],
  [0.0, 0.0, 1.0]]
distortions = [-0.2962837122799967, 0.14394033647411686, -0.000553476909857081,
  0.00024672772803050657, -0.05880404419803758]
rotation = [0.006772913530720046, 0.004244893967515615, -0.0035289125583115215]
translation = [-83.16785362283068, 0.929460536686809, -0.0802480722946533]
"""


def test_aniposelib_projects_as_we_do(tmp_path):
    (tmp_path / "rig.toml").write_text(ANIPOSE_RIG, encoding="utf-8")
    rig = read_rig(tmp_path / "rig.toml")
    found = np.stack([camera.project(ANIPOSE_POINTS) for camera in rig.cameras])
    # px; 5e-13 when it was taken
    np.testing.assert_allclose(found, ANIPOSE_PIXELS, rtol=0, atol=1e-6)


def test_a_real_stereo_pair(tmp_path, monkeypatch, capfd):
    source = real_set("opencv_stereo")
    if source is None:
        pytest.skip("no opencv_stereo: TRINOLAB_DATA names no folder that has it")
    monkeypatch.chdir(tmp_path)
    images = " ".join(f"'{side}={source}/{side}*.jpg'" for side in ("left", "right"))
    assert (
        run(
            f"calibrate --images {images} --board chessboard --columns 9 --rows 6 --square 25 "
            "--distortions 5 --out rig.toml"
        )
        == 0
    )
    out = capfd.readouterr().out
    assert re.search(r"^all +13 +1404 +0\.201 ", out, flags=re.MULTILINE)
    assert "views dropped: none" in out
    rig, reference = read_rig("rig.toml"), load_real_sets()["opencv_stereo"].reference
    T, squares = rig.cameras[1].T_cam_world, rig.cameras[1].T_cam_world.translation / 25
    # what a window makes of it
    spread = {
        key: np.abs(np.subtract(reference[f"{key}_win7"], reference[f"{key}_win11"]))
        for key in ("T_squares", "rvec_deg")
    }
    assert np.linalg.norm(T.translation) == pytest.approx(reference["baseline_mm_win7"], abs=0.05)
    assert (np.abs(squares - reference["T_squares_win7"]) < spread["T_squares"]).all()
    assert (
        np.abs(np.rad2deg(T.rotation.as_rotvec()) - reference["rvec_deg_win7"]) < spread["rvec_deg"]
    ).all()
    # the same rig as when aniposelib read it: what the detector's last bits may do
    found = np.stack([camera.project(ANIPOSE_POINTS) for camera in rig.cameras])
    np.testing.assert_allclose(found, ANIPOSE_PIXELS, rtol=0, atol=1e-3)


@pytest.mark.heavy
def test_real_corners_of_a_board_that_is_seen_in_part():
    tracks = load_caliscope()
    if tracks is None:
        pytest.skip("no caliscope: TRINOLAB_DATA names no folder that has it")
    # every second view, for time
    uv = np.array(tracks.uv).reshape(4, -1, len(tracks.points), 2)[:, ::2]
    found, why = calibrate_robustly(
        np.array(tracks.points),
        uv,
        [camera.size for camera in tracks.rig.cameras],
        tracks.rig.names,
    )
    assert 0 < np.count_nonzero([reason.startswith("too few points") for reason in why.flat]) < 12
    assert found.rms_px < 0.8  # px; the cameras were not triggered together
    for k, (camera, stored) in enumerate(zip(found.cameras, tracks.rig.cameras, strict=True)):
        assert (np.abs(camera.focal - stored.focal) < 4 * found.intrinsic_sigma[k, :2]).all()
        # 1.2 % at most: both calibrations leave out views, and not the same ones
        assert np.linalg.norm(camera.centre) == pytest.approx(
            np.linalg.norm(stored.centre - tracks.rig.cameras[0].centre), rel=0.025
        )


def test_a_part_of_a_chessboard_is_said_to_be_one(folder):
    result = calibrated(Target("chessboard", 5, 4, 15.0))
    (said,) = [note for note in result.warnings if "are a part" in note]
    assert said.startswith("a chessboard of 7 x 6 inner corners is in ")
    assert "likely --columns 7 --rows 6 is meant" in said


def test_of_the_whole_board_nothing_is_said(frames):
    images = frames[0][:5]
    assert larger(images, CHESSBOARD) == larger(images, Target("chessboard", 6, 7, 15.0)) == ""
    assert larger(images, Target("circles", 5, 5, 15.0)) == larger([], CHESSBOARD) == ""
