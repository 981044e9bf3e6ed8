"""Which of many images are looked at: a few first, spread over all, and the others if these show the
target.
"""

import cv2
import numpy as np
import pytest
from boards import SIZE, board_frames, write_views

from trinolab.calibration import views
from trinolab.calibration.calibrate import calibrate_rig
from trinolab.calibration.target import Target, find_target
from trinolab.calibration.views import read_views

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
EMPTY = np.full(SIZE[::-1], 90, np.uint8)
LARGE = np.full((720, 960), 90, np.uint8)
SMALL = EMPTY[:6, :6]  # too small to look for a target in it
FOLDERS = {"a": "a", "b": "b"}


@pytest.fixture
def looked_at(tmp_path, monkeypatch):
    """The images in which a target is looked for."""
    images, sight = [], views.detect_target

    def counted(image, *others):
        images.append(image)
        return sight(image, *others)

    monkeypatch.setattr(views, "detect_target", counted)
    monkeypatch.chdir(tmp_path)
    return images


def film(path, frames, rate=30, code="FFV1"):
    size = frames[0].shape[::-1]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), rate, size, isColor=False)
    for frame in frames:
        writer.write(frame)
    writer.release()


@pytest.mark.parametrize("kind", ["images", "videos"])
def test_many_images_without_a_target_are_refused_by_a_few(kind, tmp_path, looked_at):
    sources = FOLDERS
    if kind == "images":
        write_views(tmp_path, [[LARGE] * 30] * 2)
    else:
        sources = {name: f"{name}.avi" for name in FOLDERS}
        for path in sources.values():
            film(path, [LARGE] * 30, code="MJPG")
    says = "^images of a, b: .*found in none of 4, spread evenly over all 60; .*dark on light"
    with pytest.raises(ValueError, match=says):
        calibrate_rig(sources, CHESSBOARD, "rig.toml")
    assert [max(image.shape) for image in looked_at] == [views.FIRST_PX] * 12 + [960] * 4
    assert not any(tmp_path.glob("rig*"))


def test_a_set_whose_small_copies_show_nothing_is_looked_at_whole(tmp_path, looked_at, monkeypatch):
    write_views(tmp_path, [[EMPTY] * 14 + of[:6] for of in board_frames(10)])
    monkeypatch.setattr(views, "FIRST_PX", 40)  # a size at which no board is detected
    seen = read_views(FOLDERS, CHESSBOARD)
    assert len(looked_at) == 12 + 40  # at full size each once
    assert seen.unseen == 0
    found = np.isfinite(seen.uv).all(axis=(2, 3))
    np.testing.assert_array_equal(found, [[False] * 14 + [True] * 6] * 2)
    assert seen.present.all()


def test_of_many_cameras_each_is_looked_at(tmp_path, looked_at):
    sources = {}
    for k in range(8):
        write_views(tmp_path / str(k), [[EMPTY] * 6])
        sources[f"c{k}"] = f"{k}/a"
    seen = read_views(sources, CHESSBOARD)
    assert seen.unseen == 40
    # a dozen small copies, and of each camera the image in the middle
    np.testing.assert_array_equal(np.argwhere(seen.present), [[k, 3] for k in range(8)])
    assert len(looked_at) == 12 + 8


NAMES = {
    "the case of the ending": ("{:03d}.PNG", "{:03d}.png"),
    "the format": ("{:03d}.png", "{:03d}.jpg"),
    "zeros": ("img{}.png", "img{:02d}.png"),
    "a prefix": ("left_{}.png", "right_{}.png"),
    "a camera's number": ("cam1_{}.png", "cam2_{}.png"),
    "the case of the name": ("IMG{:03d}.png", "img{:03d}.png"),
    "a suffix": ("{:04d}_L.png", "{:04d}_R.png"),
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_names_that_nearly_agree_pair_by_their_numbers(names, tmp_path, looked_at, caplog):
    for camera, name in zip("ab", names, strict=True):
        (tmp_path / camera).mkdir()
        for k in range(6):
            cv2.imwrite(str(tmp_path / camera / name.format(k)), SMALL)
    seen = read_views({name: tmp_path / name for name in "ab"}, CHESSBOARD, progress=False)
    assert seen.present.shape == (2, 6)
    assert seen.present.all()
    assert list(seen.views) == sorted(names[0].format(k) for k in range(6))
    assert not caplog.messages


def test_a_video_that_begins_later_is_paired_by_the_frames_that_it_lacks(tmp_path, looked_at):
    sources = {name: tmp_path / f"{name}.mkv" for name in "ab"}
    for path in sources.values():
        film(path, [np.full((48, 64), 10 * k, np.uint8) for k in range(6)])
    seen = read_views(sources, CHESSBOARD, progress=False, late={"b": 2})
    assert seen.views[0] == "000000"
    np.testing.assert_array_equal(seen.times, np.arange(8.0))
    np.testing.assert_array_equal(
        seen.present, [[True] * 6 + [False] * 2, [False] * 2 + [True] * 6]
    )
    levels = [image[0, 0] for image in looked_at]
    np.testing.assert_array_equal(levels, [10 * k for k in range(6)] * 2)
    # of more than are asked for some are passed over
    thinned = read_views(sources, CHESSBOARD, most=3, progress=False)
    assert thinned.passed_over == 3
    assert thinned.views == ("000000", "000002", "000004")


def test_patterns_pair_by_what_the_star_stands_for(tmp_path, looked_at):
    for name in "ab":
        for k in range(3):
            cv2.imwrite(str(tmp_path / f"{name}_{k}.png"), EMPTY)
    seen = read_views({name: tmp_path / f"{name}_*.png" for name in "ab"}, CHESSBOARD)
    assert seen.views == ("0", "1", "2")
    assert seen.present.all()


@pytest.mark.parametrize(
    ("bits", "scale", "offset"), [(16, 257, 0), (12, 16, 0), (10, 4, 0), (16, 2, 29000)]
)
def test_colour_and_16_bit_are_converted_and_said(bits, scale, offset, tmp_path, looked_at, caplog):
    """The last are the counts of a thermal camera, 510 about a large number."""
    frames = [of[:1] for of in board_frames(10)]
    grey = frames[1][0].astype(np.uint16)
    write_views(
        tmp_path, [[cv2.cvtColor(frames[0][0], cv2.COLOR_GRAY2BGR)], [grey * scale + offset]]
    )
    caplog.set_level("INFO", logger="trinolab")
    seen = read_views(FOLDERS, CHESSBOARD)
    assert caplog.messages == [
        "a/00.png: colour converted to grey; said once",
        f"b/00.png: {bits} bit scaled to grey levels 0 to 255; said once",
    ]
    for uv, (frame,) in zip(seen.uv, frames, strict=True):
        # px; without a stretch a tenth
        np.testing.assert_allclose(uv[0], find_target(frame, CHESSBOARD), rtol=0, atol=0.02)


def test_names_that_agree_are_kept_and_few_pairs_are_said(tmp_path, looked_at, caplog):
    for camera, first in (("a", 0), ("b", 9)):
        (tmp_path / camera).mkdir()
        for k in range(first, first + 12):
            cv2.imwrite(str(tmp_path / camera / f"{k}.png"), SMALL)
    seen = read_views({name: tmp_path / name for name in "ab"}, CHESSBOARD, progress=False)
    assert len(seen.views) == 21
    (line,) = caplog.messages
    assert "only 3 views are in more than one camera, whose views are called 0.png, " in line


def test_of_a_phone_that_was_turned_between_two_images_that_is_said(tmp_path, looked_at):
    write_views(tmp_path, [[EMPTY, np.rot90(EMPTY), EMPTY], [EMPTY] * 3])
    says = r"01\.png: 360 x 480 pixels, .* have 480 x 360; likely it was turned between them$"
    with pytest.raises(ValueError, match=says):
        read_views(FOLDERS, CHESSBOARD)
