"""The film of a track, and the same in a page."""

import base64

import cv2
import numpy as np
import pytest
from films import frames_in
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_rig
from trinolab.files.recording import Frames, Recording
from trinolab.following.posetracker import Tracked
from trinolab.measurement import Measurement
from trinolab.pose import LOST, Pose
from trinolab.window import Window
from workbench.films.overlay import filmed, inset, picture
from workbench.films.video import Film, PageVideo

RIG = load_rig("paper_pair")
GREYS = [np.full((64, 96, 3), 20 * k, np.uint8) for k in range(7)]


def nothing():
    found = type("Found", (), {"uv": np.empty((0, 2))})()
    return Tracked(Measurement(LOST, (found, found), (np.empty(0, int),) * 2), (None, None))


@pytest.mark.parametrize("width", [640, 320])
def test_a_picture_is_as_wide_as_asked(width):
    images = [np.full((1024, 1280), grey, np.uint8) for grey in (40, 90)]
    shown = picture(images, nothing(), RIG, 3, 0.1, width)
    assert shown.shape == (width * 4 // 5, 2 * width, 3)
    assert [int(shown[100, u, 0]) for u in (width - 9, 2 * width - 9)] == [40, 90]


def found(pose=None, windows=(None, None)):
    """Two markers that both cameras see, 40 px apart."""
    markers = type("Found", (), {"uv": np.array([[600.0, 500.0], [640.0, 500.0]])})()
    labels = (np.array([3, 11]),) * 2
    return Tracked(Measurement(pose or LOST, (markers, markers), labels), windows)


@pytest.fixture
def written(monkeypatch):
    """All that is written into pictures: the words, and their lower left corners."""
    texts, put = [], cv2.putText

    def record(image, text, at, *rest):
        texts.append((text, at))
        return put(image, text, at, *rest)

    monkeypatch.setattr(cv2, "putText", record)
    return texts


def test_the_window_is_enlarged_in_a_corner(written):
    images = [np.full((1024, 1280), 40, np.uint8) for _ in range(2)]
    for image in images:
        image[495:506, 595:606] = 250
    window = Window(570, 450, 120, 100)
    small = inset(images[0], found(windows=(window, None)), 0, 640)
    # 0.4 of 512 px are 204.8 px high; a pixel of the image is 2.048 of them
    assert small.shape == (205, 246, 3)
    shown = picture(images, found(windows=(window, None)), RIG, 0, 0.0)
    assert np.array_equal(shown[:205, 640 - 246 : 640], small)
    # the marker's middle, 30 and 50 px from the window's corner, half a pixel more to its edge
    bright = np.argwhere(small[..., 0] > 200)[:, ::-1].mean(axis=0)
    np.testing.assert_allclose(bright, 2.048 * np.array([30.5, 50.5]) - 0.5, atol=1.0)
    # numbers stand beside the enlarged markers, or where nothing is enlarged beside the markers
    # themselves: each on the side that is away from the other
    three, eleven = (dict(written[:2])[label] for label in ("3", "11"))
    assert three[0] < 2.048 * 30 < 2.048 * 70 < eleven[0]
    assert [text for text, _ in written].count("3") == 1 + 1 + 1


@pytest.mark.parametrize("window", [None, Window(0, 0, 1280, 1024), Window(100, 100, 900, 700)])
def test_what_would_hardly_be_larger_is_not_enlarged(window):
    assert inset(np.zeros((1024, 1280), np.uint8), found(windows=(window, None)), 0) is None


@pytest.mark.parametrize(("z_mm", "letters"), [(560.0, 2), (-560.0, 0)])
def test_the_caption_has_the_pose_and_the_axes_have_letters(written, z_mm, letters):
    """Not those behind the cameras."""
    turn = Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
    T = RigidTransform.from_components([1.0, -2.0, z_mm], turn)
    pose = Pose("measured", T, np.eye(6), 0.1, 6, 2)
    picture([np.zeros((1024, 1280), np.uint8)] * 2, found(pose), RIG, 7, 0.25)
    words = [text for text, _ in written]
    assert words[-1] == "frame 7  0.250 s  measured"
    assert words[-2] == f"(1.0, -2.0, {z_mm:.1f}) mm  (170.0, 15.0, 40.0) deg"
    assert [words.count(letter) for letter in "xyz"] == [letters] * 3


def test_a_track_is_filmed_at_its_recording_s_rate(tmp_path):
    recording = Recording(RIG, (), 2, None, 12.5)
    images = [np.full((1024, 1280), 40, np.uint8)] * 2
    with filmed(tmp_path / "o.webm") as watch:
        for k in range(2):
            watch(recording, Frames(k, k / 12.5, images), nothing())
    video = cv2.VideoCapture(str(tmp_path / "o.webm"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    assert [video.read()[1].shape for _ in range(2)] == [(512, 1280, 3)] * 2


def test_a_film_is_written_by_one_alone(tmp_path):
    with Film(tmp_path / "f.webm", 30.0) as film:
        film.add(GREYS[0])
        with pytest.raises(ValueError, match=r"[/\\]f\.webm: another process works on it$"):
            Film(tmp_path / "f.webm", 30.0).__enter__()
        film.add(GREYS[1])
    with Film(tmp_path / "f.webm", 30.0):  # a film without a picture leaves the one that is there
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["f.webm"]
    video = cv2.VideoCapture(str(tmp_path / "f.webm"))
    assert [video.read()[0] for _ in range(3)] == [True, True, False]


def test_a_film_in_a_page_holds_all_its_pictures(tmp_path, capfd):
    with Film(tmp_path / "f.webm", 15.0) as film:
        for one in GREYS:
            film.add(one)
    bundle = PageVideo(tmp_path / "f.webm", 'a "film" of greys', GREYS[3])._repr_mimebundle_()
    (tmp_path / "f.webm").unlink()
    assert frames_in(bundle["text/html"], tmp_path) == 7
    for word in ('aria-label="a &quot;film&quot; of greys"', "controls", "muted", "loop"):
        assert word in bundle["text/html"]
    png = np.frombuffer(base64.b64decode(bundle["image/png"]), np.uint8)
    assert np.array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR), GREYS[3])
    assert capfd.readouterr().err == ""  # OpenCV's remark on every .webm
