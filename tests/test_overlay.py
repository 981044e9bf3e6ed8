"""The film of a track, and the same in a page."""

import base64

import cv2
import numpy as np
import pytest
from films import frames_in

from trinolab.datasets import load_rig
from trinolab.files.video import Film, PageVideo
from trinolab.following.overlay import picture
from trinolab.following.posetracker import Tracked
from trinolab.measurement import Measurement
from trinolab.pose import LOST

RIG = load_rig("paper_pair")


def nothing():
    found = type("Found", (), {"uv": np.empty((0, 2))})()
    return Tracked(Measurement(LOST, (found, found), (np.empty(0, int),) * 2), (None, None))


@pytest.mark.parametrize("width", [640, 320])
def test_a_picture_is_as_wide_as_asked(width):
    images = [np.full((1024, 1280), grey, np.uint8) for grey in (40, 90)]
    shown = picture(images, nothing(), RIG, 3, 0.1, width)
    assert shown.shape == (width * 4 // 5, 2 * width, 3)
    assert [int(shown[100, u, 0]) for u in (width - 9, 2 * width - 9)] == [40, 90]


def test_a_film_in_a_page_holds_all_its_pictures(tmp_path, capfd):
    pictures = [np.full((64, 96, 3), 20 * k, np.uint8) for k in range(7)]
    with Film(tmp_path / "f.webm", 15.0) as film:
        for one in pictures:
            film.add(one)
    bundle = PageVideo(tmp_path / "f.webm", 'a "film" of greys', pictures[3])._repr_mimebundle_()
    (tmp_path / "f.webm").unlink()
    assert frames_in(bundle["text/html"], tmp_path) == 7
    assert 'aria-label="a &quot;film&quot; of greys"' in bundle["text/html"]
    assert all(word in bundle["text/html"] for word in ("controls", "muted", "loop"))
    still = cv2.imdecode(
        np.frombuffer(base64.b64decode(bundle["image/png"]), np.uint8), cv2.IMREAD_COLOR
    )
    assert np.array_equal(still, pictures[3])
    assert capfd.readouterr().err == ""  # OpenCV's remark on every .webm
