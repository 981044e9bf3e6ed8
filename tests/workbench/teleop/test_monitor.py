"""The operator's monitor shows what there is, says what is missing, and never fails over it."""

from itertools import product

import cv2
import numpy as np
import pytest
from films import frames_in
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_rig
from trinolab.following.posetracker import Tracked
from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose
from trinolab.window import Window
from workbench.films.overlay import camera_view
from workbench.films.video import Film, PageVideo
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


def strip(picture):
    return picture[324:, 717:]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_cameras_views_are_those_of_the_overlay(count):
    seen = tracked(cameras=count)
    picture = monitor_picture(IMAGES[:count], seen, CAMERAS[:count], SLAVE, FINE)
    assert picture.shape == (720, 1280, 3)
    assert picture.dtype == np.uint8
    for c in range(count):
        left = (
            round(1280 * c / count)
            + (round(1280 * (c + 1) / count) - round(1280 * c / count) - 400) // 2
        )
        shown = picture[2:322, left : left + 400]
        expected = camera_view(IMAGES[c], CAMERAS[c], seen, c, 400, None)[..., ::-1]
        assert np.array_equal(shown[:280], expected[:280])
        assert (shown[:280] == WINDOW_RGB).all(axis=2).any()


def test_the_slave_is_shown_as_it_is_where_it_fits_and_smaller_or_larger_where_not():
    assert slave_size() == (717, 396)
    pattern = np.random.default_rng(0).integers(0, 256, (396, 717, 3)).astype(np.uint8)
    assert np.array_equal(
        monitor_picture(IMAGES, None, CAMERAS, pattern, FINE)[324:, :717], pattern
    )
    for height, width in ((200, 200), (1000, 1001), (3, 900), (1, 1)):
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
            Readings(1.0, "measured", True, scale=0.5),
            ["1.00 s", "measured", "CLOSED: coupled, scale 0.5", "no", "none", "no reading"],
        ),
        (
            Readings(np.nan, "lost", False, "handle lost", ("joint 3", "speed"), 25.0, 10.0),
            [
                "--",
                "LOST: no pose",
                "OPEN: not coupled",
                "HOLD: handle lost",
                "joint 3, speed",
                "25.0 N over 10 N",
            ],
        ),
        (
            Readings(0.0, "predicted", None, "", ["workspace"], np.nan),
            ["0.00 s", "predicted", "--", "HOLD: no reason given", "workspace", "no reading"],
        ),
        (
            Readings(1.0, "", hold="größer\nals"),
            ["1.00 s", "--", "--", "HOLD: gr??er als", "none", "no reading"],
        ),
    ],
)
def test_the_strip_says_all_in_words(readings, said, written):
    monitor_picture([None] * 3, None, CAMERAS, SLAVE, readings)
    shown = words(written)[-12:]
    assert shown[::2] == ["time", "pose", "clutch", "hold", "limits", "force"]
    assert shown[1::2] == said


@pytest.mark.parametrize("size", [(960, 540), (1280, 720), (1920, 1080)])
def test_letters_are_large_enough(size, written):
    monitor_picture([IMAGES[0], None, IMAGES[2]], tracked(), CAMERAS, None, FINE, size)
    for text, scale in written:
        (_, height), below = cv2.getTextSize("Hg", cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
        assert height + below >= 14, text
    assert len(written) > 15


def test_words_that_are_too_long_are_cut_inside_their_field(written):
    long = Readings(
        1.0, "measured" * 30, True, "a reason without an end " * 20, ("joint",) * 90, 1.0
    )
    picture = monitor_picture(IMAGES, None, CAMERAS, SLAVE, long)
    assert sum(text.endswith("..") for text in words(written)) == 3
    usual = monitor_picture(IMAGES, None, CAMERAS, SLAVE, FINE)
    assert np.array_equal(picture[:, 1270:], usual[:, 1270:])


@pytest.mark.parametrize(
    ("force", "share", "colour"),
    [
        (0.0, 0.0, FORCE_RGB),
        (5.0, 0.25, FORCE_RGB),
        (20.0, 1.0, FORCE_RGB),
        (21.0, 1.0, OVER_RGB),
        (np.nan, 0.0, FORCE_RGB),
    ],
)
def test_the_bar_is_as_long_as_the_force(force, share, colour):
    panel = strip(
        monitor_picture(IMAGES, None, CAMERAS, SLAVE, Readings(1.0, "lost", force_n=force))
    )
    filled = (panel[360:] == colour).all(axis=2).sum(axis=1).max()
    assert filled == pytest.approx(share * (1280 - 717 - 32), abs=4)


def test_a_force_that_is_missing_is_no_force_of_zero():
    zero, missing = (
        strip(monitor_picture(IMAGES, None, CAMERAS, SLAVE, Readings(1.0, "lost", force_n=force)))
        for force in (0.0, np.nan)
    )
    assert (zero[360:] != missing[360:]).any()


def test_missing_pieces_are_named(written):
    monitor_picture([IMAGES[0], None, IMAGES[2]], None, CAMERAS, None, FINE)
    assert [text for text in words(written) if "no " in text] == [
        "ccd2: no image",
        "slave: no picture",
    ]
    assert [text for text in words(written) if "not tracked" in text] == [
        "ccd1: not tracked",
        "ccd3: not tracked",
    ]


@pytest.mark.parametrize("pieces", list(product([True, False], repeat=4)))
def test_whatever_is_missing_there_is_a_picture(pieces):
    image, pose, slave, force = pieces
    for seen in (None, tracked(pose)):
        picture = monitor_picture(
            [IMAGES[0] if image else None] * 3,
            seen,
            CAMERAS,
            SLAVE if slave else None,
            Readings(np.nan, "lost", force_n=1.0 if force else np.nan),
        )
        assert picture.shape == (720, 1280, 3)


def test_found_markers_are_counted(written):
    monitor_picture(IMAGES, tracked(), CAMERAS, SLAVE, FINE)
    assert [text for text in words(written) if "marker" in text] == [
        f"ccd{c}: 2 markers" for c in (1, 2, 3)
    ]


def test_a_film_of_the_monitor(tmp_path):
    pictures = [
        monitor_picture(IMAGES, tracked(), CAMERAS, SLAVE, Readings(k / 30, "measured"))
        for k in range(4)
    ]
    with Film(tmp_path / "m.webm", 30.0) as film:
        for picture in pictures:
            film.add(blue_first(picture))
    video = cv2.VideoCapture(str(tmp_path / "m.webm"))
    frame = video.read()[1]
    # red first on the way in, the codec's loss
    assert np.abs(frame[500, 300, ::-1].astype(int) - (250, 120, 10)).max() < 12
    page = PageVideo(
        tmp_path / "m.webm", "the monitor", blue_first(pictures[0])
    )._repr_mimebundle_()["text/html"]
    assert frames_in(page, tmp_path) == 4


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"images": IMAGES[:2]}, "images: expected 3, one per camera, got 2"),
        (
            {"images": [IMAGES[0], IMAGES[1][:-1], None]},
            r"images\[1\]: expected 1280 x 1024 pixels",
        ),
        (
            {"images": [None, None, 300.0 * np.ones((1024, 1280))]},
            r"images\[2\]: expected grey levels from 0 to 255",
        ),
        ({"tracked": tracked(cameras=2)}, "tracked: expected 3, one per camera, got 2"),
        ({"cameras": (), "images": ()}, "cameras: expected one or more, got none"),
        ({"slave": np.zeros((20, 30), np.uint8)}, "slave: expected a picture of shape"),
        ({"slave": np.zeros((20, 30, 3))}, "slave: expected a picture of shape"),
        ({"size": (640, 480)}, "size: expected even sides of 960 x 540 px or more, got 640 x 480"),
        ({"size": (1281, 720)}, "size: expected even sides"),
        ({"size": "large"}, "size: expected"),
        ({"readings": None}, "readings: expected Readings, got NoneType"),
    ],
)
def test_a_wrong_argument_is_one_line(change, line):
    right = {
        "images": IMAGES,
        "tracked": None,
        "cameras": CAMERAS,
        "slave": SLAVE,
        "readings": FINE,
    }
    with pytest.raises(ValueError, match=line) as caught:
        monitor_picture(**right | change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("t_s", "now"),
        ("t_s", np.inf),
        ("status", None),
        ("clutch_closed", "yes"),
        ("hold", True),
        ("limits", "joint 3"),
        ("limits", (1,)),
        ("force_n", [1.0]),
        ("full_n", 0.0),
        ("full_n", np.nan),
    ],
)
def test_a_wrong_reading_is_named(field, value):
    with pytest.raises(ValueError, match=f"{field}: expected"):
        Readings(**{"t_s": 0.0, "status": "lost", field: value})
