"""Which of many images are looked at: a few first, spread over all, and the others if these show the
target.
"""

import re

import cv2
import numpy as np
import pytest
from boards import SIZE, board_frames, write_views

from trinolab.calibration import views
from trinolab.calibration.calibrate import calibrate_rig
from trinolab.calibration.target import Target
from trinolab.calibration.views import read_views

CHESSBOARD = Target("chessboard", 7, 6, 15.0)
EMPTY = np.full(SIZE[::-1], 90, np.uint8)
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


@pytest.mark.parametrize("kind", ["images", "videos"])
def test_many_images_without_a_target_are_refused_by_a_few(kind, tmp_path, looked_at):
    sources = FOLDERS
    if kind == "images":
        write_views(tmp_path, [[EMPTY] * 30] * 2)
    else:
        sources = {name: f"{name}.avi" for name in FOLDERS}
        for path in sources.values():
            writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 30, SIZE, isColor=False)
            for _ in range(30):
                writer.write(EMPTY)
            writer.release()
    says = (
        "images of a, b: target (chessboard, 7 x 6 inner corners) found in none of 12, spread evenly over "
        "all 60; expected it in most; tried dark on light and light on dark: check --board, --columns and "
        "--rows, which count inner corners, and that the board is whole and sharp"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(says)}$"):
        calibrate_rig(sources, CHESSBOARD, "rig.toml")
    assert len(looked_at) == 12
    assert not any(tmp_path.glob("rig*"))


def test_a_set_whose_first_images_are_empty_is_looked_at_whole(tmp_path, looked_at):
    frames = board_frames(6)
    write_views(tmp_path, [[EMPTY] * 14 + of for of in frames])
    seen = read_views(FOLDERS, CHESSBOARD)
    assert len(looked_at) == 40  # each once
    assert seen.unseen == 0
    found = np.isfinite(seen.uv).all(axis=(2, 3))
    np.testing.assert_array_equal(found, [[False] * 14 + [True] * 6] * 2)
    assert seen.present.all()


def test_few_images_are_all_looked_at(tmp_path, looked_at):
    write_views(tmp_path, [[EMPTY] * 18] * 2)
    assert read_views(FOLDERS, CHESSBOARD).unseen == 0
    assert len(looked_at) == 36


def test_of_many_cameras_each_is_looked_at(tmp_path, looked_at):
    sources = {}
    for k in range(8):
        write_views(tmp_path / str(k), [[EMPTY] * 6])
        sources[f"c{k}"] = f"{k}/a"
    seen = read_views(sources, CHESSBOARD)
    assert seen.unseen == 24
    np.testing.assert_array_equal(seen.present.sum(axis=1), 3)
    # from the middle of each third
    np.testing.assert_array_equal(np.flatnonzero(seen.present[0]), [1, 3, 5])
    assert len(looked_at) == 24


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
        for k in range(12):
            cv2.imwrite(str(tmp_path / camera / name.format(k)), EMPTY)
    seen = read_views({name: tmp_path / name for name in "ab"}, CHESSBOARD, progress=False)
    assert seen.present.shape == (2, 12)
    assert seen.present.all()
    assert list(seen.views) == sorted(names[0].format(k) for k in range(12))
    assert not caplog.messages


def test_a_video_that_begins_later_is_paired_by_the_frames_that_it_lacks(tmp_path, looked_at):
    for name in "ab":
        size, code = (64, 48), cv2.VideoWriter_fourcc(*"FFV1")
        writer = cv2.VideoWriter(f"{name}.mkv", code, 30, size, isColor=False)
        for k in range(10):
            writer.write(np.full(size[::-1], 10 * k, np.uint8))
        writer.release()
    sources = {name: tmp_path / f"{name}.mkv" for name in "ab"}
    seen = read_views(sources, CHESSBOARD, progress=False, late={"b": 2})
    assert seen.views[0] == "000000"
    np.testing.assert_array_equal(seen.times, np.arange(12.0))
    np.testing.assert_array_equal(
        seen.present, [[True] * 10 + [False] * 2, [False] * 2 + [True] * 10]
    )
    levels = [image[0, 0] for image in looked_at]
    np.testing.assert_array_equal(levels, [10 * k for k in range(10)] * 2)


def test_names_that_agree_are_kept_and_few_pairs_are_said(tmp_path, looked_at, caplog):
    for camera, first in (("a", 0), ("b", 9)):
        (tmp_path / camera).mkdir()
        for k in range(first, first + 12):
            cv2.imwrite(str(tmp_path / camera / f"{k}.png"), EMPTY)
    seen = read_views({name: tmp_path / name for name in "ab"}, CHESSBOARD, progress=False)
    assert len(seen.views) == 21
    (line,) = caplog.messages
    assert "only 3 views are in more than one camera, whose views are called 0.png, " in line


def test_of_a_phone_that_was_turned_between_two_images_that_is_said(tmp_path, looked_at):
    write_views(tmp_path, [[EMPTY, np.rot90(EMPTY), EMPTY], [EMPTY] * 3])
    says = r"01\.png: 360 x 480 pixels, .* have 480 x 360; likely it was turned between them$"
    with pytest.raises(ValueError, match=says):
        read_views(FOLDERS, CHESSBOARD)
