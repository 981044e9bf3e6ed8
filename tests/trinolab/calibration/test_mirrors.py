"""Cameras that mirror their images, among others that do not: points of drawn views, whose cameras are
known.
"""

from dataclasses import replace

import numpy as np
import pytest
from boards import (
    CALIBRATE,
    SIZE,
    board_frames,
    corners,
    make_rig,
    motion,
    positions,
    write_views,
)
from healthy import run
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import calibrate
from trinolab.calibration.mirrors import ahead, flipped_lens, shifted, unmirrored, upright
from trinolab.calibration.target import Target, find_target, upright_corners
from trinolab.calibration.views import TargetViews
from trinolab.camera import Rig
from trinolab.files.rigs import read_rig, rig_text

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
TURNED = Target("chessboard", 6, 7, 15.0)  # its colours are counted from the other side
TWO_WAYS = Target("chessboard", 7, 5, 15.0)
CIRCLES = Target("circles", 7, 6, 15.0)
CHARUCO = Target("charuco", 8, 7, 15.0)
NOISE_PX = 0.1
VIEWS = 6


def counted_in_a_mirror(uv, target):
    """As OpenCV counts the points (n, 2) in mirrored images: from a corner with the same colours, to
    the right and down.
    """
    if target.kind == "charuco":
        return uv
    if target.two_ways:
        return upright_corners(uv, target)
    grid = uv.reshape(target.rows, target.columns, 2)
    return (grid[::-1] if target is CHESSBOARD else grid[:, ::-1]).reshape(-1, 2)


def as_views(uv, size=SIZE, in_mirror=False):
    names = tuple("abc"[: len(uv)])
    nothing = np.zeros(uv.shape[:2], bool)
    numbers = tuple(map(str, range(uv.shape[1])))
    sizes = (size,) * len(uv)
    return TargetViews(names, sizes, numbers, uv, ~nothing, 0, nothing, nothing | in_mirror)


def views_of(target, mirrored):
    """What cameras see of the target in the positions of the boards, some of them in a mirror."""
    rig = make_rig(cameras=len(mirrored))
    uv = corners(rig, positions(VIEWS), target, NOISE_PX)
    for c, v in np.ndindex(uv.shape[:2]):
        if target.two_ways:
            uv[c, v] = upright_corners(uv[c, v], target)
        if mirrored[c]:
            uv[c, v, :, 0] = SIZE[0] - 1 - uv[c, v, :, 0]
            uv[c, v] = counted_in_a_mirror(uv[c, v], target)
    marked = np.array(mirrored)[:, None] & (target.kind == "charuco")
    return as_views(uv, in_mirror=marked)


@pytest.mark.parametrize("target", [CHESSBOARD, TURNED, TWO_WAYS, CIRCLES, CHARUCO], ids=str)
@pytest.mark.parametrize(
    ("mirrored", "flipped"),
    [
        ((False, False, True), ("c",)),
        ((True, False, False), ("a",)),
        ((False, True), ("b",)),
    ],
)
def test_the_camera_that_mirrors_is_flipped(target, mirrored, flipped):
    seen = views_of(target, mirrored)
    result = unmirrored(seen, target)
    assert result.cameras == flipped
    np.testing.assert_allclose(
        result.seen.uv, views_of(target, (False,) * len(mirrored)).uv, rtol=0, atol=5 * NOISE_PX
    )
    assert not result.seen.mirrored.any()
    # two cameras and no markers: either may be the one
    assert result.unambiguous == (len(mirrored) == 3 or target is CHARUCO)
    assert ("writing reads backwards" in result.line) == (not result.unambiguous)


@pytest.mark.parametrize("target", [CHESSBOARD, TWO_WAYS, CHARUCO], ids=str)
@pytest.mark.parametrize("mirrored", [(False, False, False), (True, True)])
def test_cameras_that_agree_are_left_as_they_are(target, mirrored):
    seen = views_of(target, mirrored)
    assert unmirrored(seen, target) is None
    if not any(mirrored):
        assert upright(seen, target) == (seen, "")


def test_markers_tell_which_cameras_mirror_even_if_they_are_more():
    result = unmirrored(views_of(CHARUCO, (True, False, True)), CHARUCO)
    assert result.cameras == ("a", "c")
    assert result.unambiguous


ROLLS = {"upside down": 180, "on its side": 90, "on its other side": -90, "aslant": 60}


def rolled(target, rolls_deg):
    """What two cameras see that are turned about their axes, each counted as its image has it, and as
    cameras that know the target would count it.
    """
    rng = np.random.default_rng(3)
    poses, cameras = [], []
    for _ in range(8):
        turn = Rotation.from_euler("xyz", rng.uniform(-25, 25, 3) * [1, 1, 0.4], degrees=True)
        place = rng.uniform(-25, 25, 3) + [0, 0, 480] - turn.apply(target.points.mean(axis=0))
        poses.append(RigidTransform.from_components(place, turn))
    for camera, roll in zip(make_rig().cameras, rolls_deg, strict=True):
        R = motion([0, 0, 0], [0, 0, np.deg2rad(roll)])
        cameras.append(replace(camera, size=(900, 900), T_cam_world=R * camera.T_cam_world))
    known = corners(Rig(tuple(cameras)), poses, target, NOISE_PX)
    counted = np.array([[upright_corners(uv, target) for uv in of] for of in known])
    return as_views(counted, (900, 900)), known


@pytest.mark.parametrize("target", [TWO_WAYS, CIRCLES, Target("circles", 5, 5, 15.0)], ids=str)
@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("roll_deg", ROLLS.values(), ids=ROLLS)
def test_a_camera_that_is_turned_counts_from_another_corner(target, first, roll_deg):
    seen, known = rolled(target, (roll_deg, 0) if first else (0, roll_deg))
    again, line = upright(seen, target)
    # at 60 deg rows of an oblong target still run to the right
    assert ("counted from another corner by" in line) == (abs(roll_deg) > 60 or target.columns == 5)
    for v in range(8):  # one order for both cameras, whichever
        ways = [
            np.rot90(known[:, v].reshape(2, target.rows, -1, 2), k, (1, 2)).reshape(2, -1, 2)
            for k in target.turns
        ]
        assert any(np.array_equal(again.uv[:, v], way) for way in ways)


@pytest.mark.parametrize("by", [-3, -1, 1, 3])
@pytest.mark.parametrize("target", [CHESSBOARD, CIRCLES], ids=str)
def test_a_camera_whose_views_are_counted_from_another_one_on(target, by):
    seen, _ = rolled(target, (0, 0))
    late = shifted(seen, (0, by))
    assert ahead(late, target) == (0, -by)
    again = shifted(late, (0, -by))
    kept = slice(max(-by, 0), 8 - max(by, 0))
    np.testing.assert_array_equal(again.uv[:, kept], seen.uv[:, kept])
    assert again.present[1].sum() == 8 - abs(by)
    assert ahead(seen, target) is None


def test_too_few_views_and_chance_are_no_mirror():
    seen = views_of(CHESSBOARD, (False, True))
    few = seen.uv.copy()
    few[1, 2:] = np.nan
    assert unmirrored(seen._replace(uv=few), CHESSBOARD) is None
    shuffled = views_of(CHESSBOARD, (False, False)).uv.copy()
    shuffled[1] = np.roll(shuffled[1], 2, axis=0)
    assert unmirrored(seen._replace(uv=shuffled), CHESSBOARD) is None


def test_a_flipped_lens_sees_flipped_pixels():
    there = replace(make_rig().cameras[1], T_cam_world=RigidTransform.identity())
    xyz = np.array([[30.0, -40.0, 400.0], [-55.0, 20.0, 380.0]])
    uv, in_mirror = there.project(xyz), flipped_lens(there).project(xyz * [-1, 1, 1])
    expected = uv * [-1, 1] + [SIZE[0] - 1, 0]
    np.testing.assert_allclose(in_mirror, expected, atol=1e-9)  # px


def test_the_command_calibrates_a_camera_that_mirrors_and_says_so(tmp_path, monkeypatch, caplog):
    """With the lenses of mirrored images, too."""
    frames = [of[:VIEWS] for of in board_frames(10)]
    monkeypatch.chdir(tmp_path)
    write_views(tmp_path, [frames[0], [frame[:, ::-1] for frame in frames[1]]])
    uv = [[find_target(frame, CHESSBOARD) for frame in of] for of in frames]
    unflipped = calibrate(CHESSBOARD.points, np.array(uv), [SIZE] * 2, "ab", 5)
    first, second = (
        replace(camera, T_cam_world=RigidTransform.identity()) for camera in unflipped.cameras
    )
    lenses = rig_text(Rig((first, flipped_lens(second))))
    (tmp_path / "lenses.toml").write_text(lenses, encoding="utf-8")
    for line in (CALIBRATE, CALIBRATE.replace("--distortions 5", "--lenses lenses.toml")):
        assert run(line) == 0
        (said,) = [message for message in caplog.messages if "mirrored" in message]
        assert said.startswith("images of b or of a are mirrored, else they contradict each other")
        assert "ffmpeg -i IN -vf hflip OUT" in said
        caplog.clear()
        centre = read_rig("rig.toml").cameras[1].centre
        # mm: the same views unmirrored, whose corners the detector finds in another order
        np.testing.assert_allclose(centre, unflipped.cameras[1].centre, atol=0.02)
