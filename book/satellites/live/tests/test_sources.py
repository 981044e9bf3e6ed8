"""The sources of the live system: always the latest frame, and words for what is wrong."""

import threading
from itertools import islice

import cv2
import numpy as np
import pytest
from livepage import HELD, RIG, Bench
from processes import wait_until

from satellites.live import command, sources
from satellites.live.command import chosen
from satellites.live.sources import Feed, SimulatedHand, Source, as_bytes
from trinolab.files import recording_writer

IMAGE = np.arange(12, dtype=np.uint8).reshape(3, 4)


def fed(count=2, live=False):
    """A source of feeds that a test pushes frames into."""
    feeds = [Feed(f"c{k}", lambda stopped: iter(()), live) for k in range(count)]
    return Source(RIG, None, feeds), feeds


def test_only_the_latest_frame_is_there_and_once():
    source, (first, second) = fed()
    for k in range(5):
        first.keep(float(k), [IMAGE + k])
    assert source.next(0.0) is None  # the second has none yet
    second.keep(3.9, [IMAGE])
    latest = source.next(0.0)
    assert latest.number == 1
    assert latest.t_s == pytest.approx(3.95)
    assert latest.spread_s == pytest.approx(0.1)
    np.testing.assert_array_equal(latest.images[0], IMAGE + 4)
    assert source.next(0.0) is None
    first.keep(6.0, [IMAGE])
    assert source.next(0.0) is None  # one of them is not new
    second.keep(6.0, [IMAGE])
    assert source.next(0.0).number == 2


def test_what_fails_is_said_and_opened_again():
    bench = Bench()
    with bench.source as source:
        assert source.next(60.0) is not None
        bench.broken = "delivers no image"
        wait_until(lambda: source.troubles() == ["ccd2: delivers no image"])
        bench.broken = ""
        wait_until(lambda: source.troubles() == [])
        assert source.next(60.0) is not None


@pytest.mark.parametrize("live", [True, False])
def test_a_camera_without_a_new_image_is_named(monkeypatch, live):
    """Or with the same one again and again; a video may stand still."""
    _, (feed, _) = fed(live=live)
    now = [100.0]
    monkeypatch.setattr(sources.time, "monotonic", lambda: now[0])
    for _ in range(8):
        feed.keep(now[0], [IMAGE.copy()])
        now[0] += 0.1
    assert feed.trouble(now[0]) == ("c0: the image stands still (frozen?)" if live else "")
    feed.keep(now[0], [IMAGE + 1])
    assert feed.trouble(now[0] + 0.4) == ""
    assert feed.trouble(now[0] + 3.0) == "c0: no new image for 3 s"


@pytest.fixture
def recording(tmp_path):
    """A recording of three instants, of another brightness each."""
    folder = tmp_path / "recording"
    recording_writer.begin(folder, RIG, chosen().handle)
    for k in range(3):
        images = [image // np.uint8(k + 1) for image in HELD]
        recording_writer.add(recording_writer.partial_of(folder), RIG, k, images)
    recording_writer.finish(folder, [0.0, 0.01, 0.02])
    return folder


def videos(recording):
    """A video of each camera, by its name."""
    paths = {}
    for c, camera in enumerate(RIG.cameras):
        path = paths[camera.name] = str(recording / f"{camera.name}.avi")
        code = cv2.VideoWriter.fourcc(*"MJPG")
        writer = cv2.VideoWriter(path, code, 100.0, camera.size, isColor=False)
        for k in range(3):
            writer.write(HELD[c] // np.uint8(k + 1))
        writer.release()
    return paths


def of_videos(recording):
    files = {"rig": recording / "rig.toml", "handle": recording / "handle.toml"}
    return chosen(videos(recording), **files, fps=100.0)


@pytest.mark.parametrize(
    "source", [lambda folder: chosen(recording=folder), of_videos], ids=["recording", "videos"]
)
def test_what_is_recorded_is_played_again_from_its_start(recording, source):
    threads = threading.active_count()
    with source(recording) as source:
        seen = set()

        def all_seen():
            latest = source.next(60.0)
            assert [(image.shape, image.dtype) for image in latest.images] == [
                ((512, 640), np.uint8)
            ] * 3
            ratio = latest.images[2].mean() / HELD[2].mean()
            seen.add(min(range(3), key=lambda k: abs(ratio - 1 / (k + 1))))
            return seen == {0, 1, 2} and latest.number > 5

        wait_until(all_seen)
    wait_until(lambda: threading.active_count() <= threads)


def settled(hand, start_s):
    """The pose of a hand that has had three seconds."""
    for t in start_s + np.arange(0, 3, 0.05):
        now = hand.pose(t)
    return now


def test_the_hand_goes_by_itself_smoothly_or_where_it_is_taken():
    hand = SimulatedHand(seed=1)
    places = np.array([hand.pose(t).translation for t in 100 + np.arange(0, 20, 1 / 30)])
    speed = 30 * np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert 10 < np.median(speed) < 120
    assert speed.max() < 300
    hand.go_home()
    home = settled(hand, 121)
    hand.move([10, -5, 3], [0, 0, 0.1])
    now = settled(hand, 125)
    np.testing.assert_allclose(now.translation - home.translation, [10, -5, 3], atol=1e-3)
    assert (now.rotation * home.rotation.inv()).magnitude() == pytest.approx(0.1, abs=1e-3)
    for _ in range(100):
        hand.move([50, 50, 50], [0, 0, 0])
    now = settled(hand, 129)
    np.testing.assert_allclose(now.translation, sources.RANGES_MM[:, 1], atol=1e-3)


def test_the_bench_draws_the_hand_where_it_is():
    source = chosen(seed=3)
    with source:
        latest = wait_until(lambda: source.next(60.0))
        assert [image.shape for image in latest.images] == [(512, 640)] * 3
        assert latest.images[0].max() > 150  # a marker in the light
        source.hand.go_home()
        source.hand.drawn = True
        # skin is brighter than the bench
        wait_until(lambda: np.count_nonzero(source.next(60.0).images[0] > 95) > 5000)


CAMERAS = [
    ({"ccd1": "0", "ccd2": "1"}, "ccd3: this camera of the rig is not named"),
    ({"ccd1": "0", "ccd2": "1", "ccd3": "2", "x": "3"}, "x: a camera"),
    ({"ccd1": "0", "ccd2": "1", "ccd3": "c.mkv"}, "expected cameras or videos, got both"),
    ({"ccd1": "990", "ccd2": "991", "ccd3": "992"}, "ccd1: camera 990 cannot be opened"),
    ({"ccd1": "a.mkv", "ccd2": "b.mkv", "ccd3": "c.mkv"}, "a.mkv: no such file"),
]


@pytest.mark.parametrize(("cameras", "message"), CAMERAS)
def test_cameras_that_are_not_the_rigs_are_refused(cameras, message):
    from trinolab.datasets import handle_file, rig_file

    with pytest.raises(ValueError, match=message):
        chosen(cameras, rig=rig_file("raised_40deg"), handle=handle_file("coded"))


def test_a_camera_that_ends_is_said_and_opened_anew(recording):
    """A video in its place, three frames long."""
    source = sources.of_cameras(videos(recording), RIG, chosen().handle)
    for _ in range(2):
        frames = source.feeds[0].latest_frames(threading.Event())
        seen = [image.mean() for _, (image,) in islice(frames, 3)]
        # JPEG's losses are below half a grey level in the mean
        np.testing.assert_allclose(
            seen, [(HELD[0] // np.uint8(k)).mean() for k in (1, 2, 3)], atol=0.5
        )
        with pytest.raises(ValueError, match="ccd1: delivers no image after 3 instants"):
            next(frames)


@pytest.mark.parametrize(
    ("system", "display", "opens"),
    [("linux", "", False), ("linux", ":0", True), ("darwin", "", True)],
)
def test_a_browser_is_opened_where_there_is_one(monkeypatch, tmp_path, system, display, opens):
    """By a file for its owner alone, since all users can read the command line of a process."""
    found = []
    monkeypatch.setattr(command.webbrowser, "open", found.append)
    monkeypatch.setattr(command.sys, "platform", system)
    monkeypatch.setattr(command.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with command.show("http://here/a-token/?a&b"):
        files = list(tmp_path.iterdir())
        assert found == [file.as_uri() for file in files]
        assert len(files) == opens
        for file in files:
            assert "token" not in file.name
            assert file.stat().st_mode & 0o777 == 0o600
            assert 'url=http://here/a-token/?a&amp;b"' in file.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == []


def test_grey_levels_become_bytes():
    assert as_bytes(IMAGE) is IMAGE
    np.testing.assert_array_equal(as_bytes(np.array([[-3.0, 4.6, 300.0]])), [[0, 5, 255]])
