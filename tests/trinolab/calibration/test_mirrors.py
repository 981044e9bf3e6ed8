"""Cameras that mirror their images, among others that do not: points of drawn views, whose cameras are
known.
"""

from dataclasses import replace

import numpy as np
import pytest
from boards import CALIBRATE, LENS, SIZE, board_frames, make_rig, positions, write_views
from healthy import run
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import calibrate
from trinolab.calibration.mirrors import ahead, flipped_lens, shifted, unmirrored, upright
from trinolab.calibration.target import Target, find_target, upright_corners
from trinolab.calibration.views import TargetViews
from trinolab.camera import Camera
from trinolab.files.rigs import read_rig

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
TURNED = Target("chessboard", 6, 7, 15.0)  # its colours are counted from the other side
TWO_WAYS = Target("chessboard", 7, 5, 15.0)
CIRCLES = Target("circles", 7, 6, 15.0)
CHARUCO = Target("charuco", 8, 7, 15.0)
NOISE_PX = 0.1
VIEWS = 6


def cameras(count):
    T = RigidTransform.from_components([-90, 14, 22], Rotation.from_rotvec([0.05, 0.2, -0.03]))
    two = make_rig().cameras
    return [*two, Camera("c", SIZE, two[0].matrix, LENS / 2, T.inv())][:count]


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


def views_of(target, mirrored):
    """What cameras see of the target in the positions of the boards, some of them in a mirror."""
    rng = np.random.default_rng(1)
    uv = np.empty((len(mirrored), VIEWS, len(target.points), 2))
    for c, camera in enumerate(cameras(len(mirrored))):
        for v, T in enumerate(positions(VIEWS)):
            pixels = camera.project(T.apply(target.points))
            pixels += rng.normal(0, NOISE_PX, pixels.shape)
            if target.two_ways:
                pixels = upright_corners(pixels, target)
            if mirrored[c]:
                pixels[:, 0] = SIZE[0] - 1 - pixels[:, 0]
                pixels = counted_in_a_mirror(pixels, target)
            uv[c, v] = pixels
    nothing = np.zeros(uv.shape[:2], bool)
    in_mirror = nothing | (np.array(mirrored)[:, None] & (target.kind == "charuco"))
    names = tuple("abc"[: len(mirrored)])
    views = tuple(map(str, range(VIEWS)))
    sizes = (SIZE,) * len(names)
    return TargetViews(names, sizes, views, uv, ~nothing, 0, nothing, in_mirror)


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
    assert unmirrored(views_of(target, mirrored), target) is None


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
    poses = list[RigidTransform]()
    for _ in range(8):
        turn = Rotation.from_euler("xyz", rng.uniform(-25, 25, 3) * [1, 1, 0.4], degrees=True)
        place = rng.uniform(-25, 25, 3) + [0, 0, 480]
        middle = target.points.mean(axis=0)
        poses.append(RigidTransform.from_components(place - turn.apply(middle), turn))
    known = np.empty((2, 8, len(target.points), 2))
    counted = np.empty_like(known)
    for c, (camera, roll) in enumerate(zip(cameras(2), rolls_deg, strict=True)):
        R = Rotation.from_euler("z", roll, degrees=True)
        there = replace(
            camera,
            size=(900, 900),
            T_cam_world=RigidTransform.from_rotation(R) * camera.T_cam_world,
        )
        for v, pose in enumerate(poses):
            known[c, v] = there.project(pose.apply(target.points))
            known[c, v] += rng.normal(0, NOISE_PX, known[c, v].shape)
            counted[c, v] = upright_corners(known[c, v], target)
    nothing = np.zeros((2, 8), bool)
    names, views = ("a", "b"), tuple(map(str, range(8)))
    return TargetViews(
        names, ((900, 900),) * 2, views, counted, ~nothing, 0, nothing, nothing
    ), known


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


@pytest.mark.parametrize("target", [TWO_WAYS, CIRCLES, CHESSBOARD], ids=str)
def test_views_of_upright_cameras_are_counted_as_they_are(target):
    seen = views_of(target, (False, False, False))
    assert upright(seen, target) == (seen, "")


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


def test_too_few_views_say_nothing():
    seen = views_of(CHESSBOARD, (False, True))
    few = seen.uv.copy()
    few[1, 2:] = np.nan
    assert unmirrored(seen._replace(uv=few), CHESSBOARD) is None


def test_views_that_contradict_each_other_by_chance_are_no_mirror():
    seen = views_of(CHESSBOARD, (False, False))
    shuffled = seen.uv.copy()
    shuffled[1] = np.roll(shuffled[1], 2, axis=0)
    assert unmirrored(seen._replace(uv=shuffled), CHESSBOARD) is None


def test_a_flipped_lens_sees_flipped_pixels():
    camera = make_rig().cameras[1]
    xyz = np.array([[30.0, -40.0, 400.0], [-55.0, 20.0, 380.0]])
    here = flipped_lens(
        Camera("b", SIZE, camera.matrix, camera.distortions, RigidTransform.identity())
    )
    there = Camera("b", SIZE, camera.matrix, camera.distortions, RigidTransform.identity())
    u = there.project(xyz)[:, 0]
    in_mirror = here.project(xyz * [-1, 1, 1])
    np.testing.assert_allclose(in_mirror[:, 0], SIZE[0] - 1 - u, atol=1e-9)  # px
    np.testing.assert_allclose(in_mirror[:, 1], there.project(xyz)[:, 1], atol=1e-9)


@pytest.fixture
def webcam(tmp_path, monkeypatch):
    """Folders of rendered boards, of which b's are mirrored, and the rig of those that are not."""
    frames = board_frames(6)
    monkeypatch.chdir(tmp_path)
    write_views(tmp_path, [frames[0], [frame[:, ::-1] for frame in frames[1]]])
    uv = [[find_target(frame, CHESSBOARD) for frame in of] for of in frames]
    return calibrate(CHESSBOARD.points, np.array(uv), [SIZE] * 2, "ab", 5)


def test_the_command_calibrates_a_camera_that_mirrors_and_says_so(webcam, caplog):
    assert run(CALIBRATE) == 0
    (line,) = [line for line in caplog.messages if "mirrored" in line]
    assert line.startswith(
        "images of b or of a are mirrored, else they contradict each other: taken"
    )
    assert "ffmpeg -i IN -vf hflip OUT" in line
    centre = read_rig("rig.toml").cameras[1].centre
    # mm: the same views unmirrored, whose corners the detector finds in another order
    np.testing.assert_allclose(centre, webcam.cameras[1].centre, atol=0.02)


def test_with_lenses_of_mirrored_images_the_place_is_the_same(webcam, capfd):
    write = webcam.rig.cameras
    lens = flipped_lens(write[1])
    text = "".join(
        f"[cam_{k}]\nname = '{camera.name}'\nsize = {list(SIZE)}\nmatrix = {camera.matrix.tolist()}\n"
        f"distortions = {camera.distortions.tolist()}\nrotation = [0.0, 0.0, 0.0]\n"
        "translation = [0.0, 0.0, 0.0]\n"
        for k, camera in enumerate((write[0], lens))
    )
    with open("lenses.toml", "w", encoding="utf-8") as file:
        file.write(text)
    assert run(CALIBRATE.replace("--distortions 5", "--lenses lenses.toml")) == 0
    capfd.readouterr()
    centre = read_rig("rig.toml").cameras[1].centre
    np.testing.assert_allclose(centre, webcam.cameras[1].centre, atol=0.02)
