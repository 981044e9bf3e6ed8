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


def test_of_a_phone_that_was_turned_between_two_images_that_is_said(tmp_path, looked_at):
    write_views(tmp_path, [[EMPTY, np.rot90(EMPTY), EMPTY], [EMPTY] * 3])
    says = r"01\.png: 360 x 480 pixels, .* have 480 x 360; likely it was turned between them$"
    with pytest.raises(ValueError, match=says):
        read_views(FOLDERS, CHESSBOARD)
