"""The operator's monitor shows what there is, says what is missing, and never fails over it."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_rig
from trinolab.following.posetracker import Tracked
from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose
from trinolab.window import Window
from workbench.films.overlay import camera_view
from workbench.teleop.monitor import Readings, blue_first, monitor_picture, slave_size

CAMERAS = load_rig("raised_40deg").cameras
IMAGES = [np.full((1024, 1280), grey, np.uint8) for grey in (60, 90, 255)]
SLAVE = np.full((396, 717, 3), (250, 120, 10), np.uint8)
FINE = Readings(12.345, "measured", True, None, (), 5.0)
WINDOW_RGB, FORCE_RGB, OVER_RGB = (0, 200, 200), (86, 180, 233), (255, 120, 100)


def tracked(pose=True, cameras=3):
    """A handle in the middle of the sight, with two markers and a stranger in each camera."""
    T = RigidTransform.from_translation([0.0, 0.0, 549.0])
    found = type("Found", (), {"uv": np.array([(600.0, 500.0), (640.0, 520.0), (900.0, 200.0)])})()
    one = Pose("measured", T, np.eye(6), 0.1, 6, 3) if pose else LOST
    labels = (np.array([3, 5, -1]),) * cameras
    return Tracked(
        Measurement(one, (found,) * cameras, labels), (Window(500, 400, 300, 250),) * cameras
    )


@pytest.fixture
def written(monkeypatch):
    """All that is written into pictures, and the scales of the letters."""
    texts, put = [], cv2.putText

    def record(image, text, at, font, scale, *rest):
        texts.append((text, scale))
        return put(image, text, at, font, scale, *rest)

    monkeypatch.setattr(cv2, "putText", record)
    return texts


def words(written):
    return [text for text, _ in written]


@pytest.mark.parametrize("count", [1, 3])
def test_the_cameras_views_are_those_of_the_overlay(count):
    seen = tracked(cameras=count)
    picture = monitor_picture(IMAGES[:count], seen, CAMERAS[:count], SLAVE, FINE)
    assert picture.shape == (720, 1280, 3)
    assert picture.dtype == np.uint8
    for c in range(count):
        begin, end = (round(1280 * k / count) for k in (c, c + 1))
        left = begin + (end - begin - 400) // 2
        shown = picture[2:322, left : left + 400]
        expected = camera_view(IMAGES[c], CAMERAS[c], seen, c, 400, None)[..., ::-1]
        assert np.array_equal(shown[:280], expected[:280])
        assert (shown[:280] == WINDOW_RGB).all(axis=2).any()
    assert np.array_equal(blue_first(picture), picture[..., ::-1])


def test_the_slave_is_shown_as_it_is_where_it_fits_and_smaller_or_larger_where_not():
    assert slave_size() == (717, 396)
    pattern = np.random.default_rng(0).integers(0, 256, (396, 717, 3)).astype(np.uint8)
    assert np.array_equal(
        monitor_picture(IMAGES, None, CAMERAS, pattern, FINE)[324:, :717], pattern
    )
    for height, width in ((200, 200), (1000, 1001), (3, 900)):
        small = np.full((height, width, 3), (250, 120, 10), np.uint8)
        v, u = np.nonzero(
            (monitor_picture(IMAGES, None, CAMERAS, small, FINE) == (250, 120, 10)).all(axis=2)
        )
        shown = v.max() - v.min() + 1, u.max() - u.min() + 1
        assert v.min() >= 324
        assert u.max() < 717
        assert shown[0] == 396 or shown[1] == 717
        assert shown[1] / shown[0] == pytest.approx(
            width / height, rel=0.3 if height == 3 else 0.01
        )


@pytest.mark.parametrize(
    ("readings", "said"),
    [
        (FINE, ["12.35 s", "measured", "CLOSED: coupled", "no", "none", "5.0 N of 20 N"]),
        (
            Readings(np.nan, "lost", False, "handle lost", ("joint 3", "speed"), 25.0, 10.0),
            ["--", "LOST: no pose", "OPEN: not coupled", "HOLD: handle lost", "joint 3, speed"]
            + ["25.0 N over 10 N"],
        ),
        (
            Readings(1.0, "measured", True, "größer\nals", scale=0.5),
            ["1.00 s", "measured", "CLOSED: coupled, scale 0.5", "HOLD: gr??er als", "none"]
            + ["no reading"],
        ),
        (
            Readings(0.0, "", None, "", ["workspace"], np.nan),
            ["0.00 s", "--", "--", "HOLD: no reason given", "workspace", "no reading"],
        ),
    ],
)
def test_the_strip_says_all_in_words(readings, said, written):
    monitor_picture([None] * 3, None, CAMERAS, SLAVE, readings)
    shown = words(written)[-12:]
    assert shown[::2] == ["time", "pose", "clutch", "hold", "limits", "force"]
    assert shown[1::2] == said


def test_words_that_are_too_long_are_cut_inside_their_field(written):
    long = Readings(
        1.0, "measured" * 30, True, "a reason without an end " * 20, ("joint",) * 90, 1.0
    )
    picture = monitor_picture(IMAGES, None, CAMERAS, SLAVE, long)
    assert sum(text.endswith("..") for text in words(written)) == 3
    for text, scale in written:  # letters are large enough
        (_, height), below = cv2.getTextSize("Hg", cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
        assert height + below >= 14, text
    usual = monitor_picture(IMAGES, None, CAMERAS, SLAVE, FINE)
    assert np.array_equal(picture[:, 1270:], usual[:, 1270:])


@pytest.mark.parametrize(
    ("force", "share", "colour"),
    [
        (0.0, 0.0, FORCE_RGB),
        (5.0, 0.25, FORCE_RGB),
        (21.0, 1.0, OVER_RGB),
        (np.nan, 0.0, FORCE_RGB),
    ],
)
def test_the_bar_is_as_long_as_the_force(force, share, colour):
    readings = Readings(1.0, "lost", force_n=force)
    picture = monitor_picture(IMAGES, None, CAMERAS, SLAVE, readings)
    filled = (picture[684:, 717:] == colour).all(axis=2).sum(axis=1).max()
    assert filled == pytest.approx(share * (1280 - 717 - 32), abs=4)


@pytest.mark.parametrize(
    ("seen", "said"),
    [(None, "not tracked"), (tracked(), "2 markers"), (tracked(False), "2 markers")],
)
def test_missing_pieces_are_named_and_markers_counted(written, seen, said):
    picture = monitor_picture([IMAGES[0], None, IMAGES[2]], seen, CAMERAS, None, FINE)
    assert picture.shape == (720, 1280, 3)
    named = [text for text in words(written) if text.startswith(("ccd", "slave")) and ":" in text]
    assert named == [f"ccd1: {said}", "ccd2: no image", f"ccd3: {said}", "slave: no picture"]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"images": IMAGES[:2]}, "images: expected 3, one per camera, got 2"),
        ({"images": [None, IMAGES[1][:-1], None]}, r"images\[1\]: expected 1280 x 1024 pixels"),
        ({"images": [None, None, 5.0 * IMAGES[1]]}, r"images\[2\]: expected grey levels from 0"),
        ({"tracked": tracked(cameras=2)}, "tracked: expected 3, one per camera, got 2"),
        ({"cameras": (), "images": ()}, "cameras: expected one or more, got none"),
        ({"slave": np.zeros((20, 30), np.uint8)}, "slave: expected a picture of shape"),
        ({"size": (640, 480)}, "size: expected even sides of 960 x 540 px or more, got 640 x 480"),
        ({"size": "large"}, "size: expected"),
        ({"readings": None}, "readings: expected Readings, got NoneType"),
    ],
)
def test_a_wrong_argument_is_one_line(change, line):
    right = {"images": IMAGES, "cameras": CAMERAS, "slave": SLAVE, "readings": FINE}
    with pytest.raises(ValueError, match=f"^{line}.*$"):
        monitor_picture(**{"tracked": None} | right | change)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("t_s", "now"),
        ("t_s", np.inf),
        ("status", None),
        ("hold", True),
        ("limits", "joint 3"),
        ("force_n", [1.0]),
        ("full_n", 0.0),
    ],
)
def test_a_wrong_reading_is_named(field, value):
    with pytest.raises(ValueError, match=f"{field}: expected"):
        Readings(**{"t_s": 0.0, "status": "lost", field: value})
