"""Recording from cameras: videos in their place, and devices that fail in every way."""

import re
import shutil
import signal
import threading
from dataclasses import replace
from pathlib import Path
from unittest.mock import DEFAULT, Mock

import cv2
import numpy as np
import pytest
from healthy import write_video
from processes import CLI, ended, started, wait_until

from trinolab.camera import Rig
from trinolab.datasets import data_path, load_rig
from trinolab.files import recording_writer
from trinolab.files.journal import locked
from trinolab.files.recording import instants, open_folder, read_timestamps
from trinolab.files.rigs import write_rig
from workbench import cli
from workbench.capture import capture as files_capture
from workbench.capture import devices
from workbench.capture.capture import Captured, capture, side_by_side, timing
from workbench.capture.devices import drain, instants_of, open_source

SIZE = (32, 24)
FPS = 200


@pytest.fixture(scope="module")
def images():
    """Twelve instants of noise, (12, 2, height, width)."""
    return np.random.default_rng(0).integers(0, 256, (12, 2, *SIZE[::-1]), dtype=np.uint8)


@pytest.fixture
def folder(tmp_path, monkeypatch, images):
    """The working folder: a rig file and a video a camera."""
    small = [replace(camera, size=SIZE) for camera in load_rig("paper_pair").cameras]
    write_rig(Rig(tuple(small)), tmp_path / "rig.toml")
    for c in range(2):
        write_video(tmp_path / f"{c}.mkv", images[:, c], fps=FPS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Clock(threading.local):
    """The time that `devices` asks for. It passes only when somebody waits, and for each thread by
    itself.
    """

    now = 100.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """Recordings of half a second take no time, and the same on each machine."""
    made = Clock()
    monkeypatch.setattr(devices, "time", made)
    return made


GRAB_S = 0.002


class Closed:
    """A camera that cannot be opened."""

    def isOpened(self):
        return False

    def release(self):
        pass


class Device:
    """A camera that delivers frames of one grey level until `frames` are over, and then fails or
    raises.
    """

    def __init__(self, frames=10**6, size=SIZE, then=None, sizes=None):
        # two are let go
        self.k, self.frames, self.then, self.asked, self.released = -2, frames, then, {}, False
        self.sizes = sizes or {}
        self.size = size
        self.at = {}  # what is done when a frame is grabbed, by the frame's number

    def isOpened(self):
        return True

    def grab(self):
        devices.time.sleep(GRAB_S)
        self.k += 1
        self.at.get(self.k, lambda: None)()
        if self.k > self.frames and self.then:
            raise self.then
        return self.k <= self.frames

    def retrieve(self):
        width, height = self.sizes.get(self.k, self.size)
        return True, np.full((height, width, 3), self.k % 256, np.uint8)

    def read(self):
        return self.grab(), self.retrieve()[1]

    def get(self, key):
        return {cv2.CAP_PROP_FPS: 30.0}[key]

    def set(self, key, value):
        self.asked[key] = value

    def release(self):
        self.released = True


@pytest.fixture
def cameras(monkeypatch):
    """Two devices, and what names them."""
    made = {0: Device(), 1: Device()}
    monkeypatch.setattr(devices, "open_index", made.__getitem__)
    return made


TWO = {"ccd1": "0", "ccd2": "1"}
VIDEOS = {"ccd2": "1.mkv", "ccd1": "0.mkv"}


def test_videos_become_a_recording(folder, images):
    done = capture(VIDEOS, "r", "rig.toml", data_path("handles", "coded.toml"), preview=True)
    names = sorted(path.name for path in folder.joinpath("r").iterdir())
    assert names == ["handle.toml", "images", "rig.toml", "timestamps.csv"]
    assert not (folder / "r.partial").exists()
    found = list(instants(open_folder("r")[0]))
    np.testing.assert_array_equal([one.images for one in found], images)  # grey again, to the level
    assert [one.t_s for one in found] == pytest.approx(done.times_s, abs=1e-8)
    assert done.dropped == 0
    assert done.times_s[0] == 0
    assert done.times_s == pytest.approx(np.arange(12) / FPS)
    assert done.spread_s.tolist() == [0.0] * 12
    # without a rig there is no rig file, and any size will do
    write_video(folder / "small.mkv", images[:, 0, :16])
    capture({"left": "0.mkv", "right": "small.mkv"}, "other", fps=100.0)
    assert sorted(path.name for path in Path("other").iterdir()) == ["images", "timestamps.csv"]
    assert len(list(Path("other/images/right").iterdir())) == 12
    assert read_timestamps("other/timestamps.csv") == pytest.approx(np.arange(12) / 100)


def test_cameras_are_asked_for_size_and_rate(cameras, folder):
    capture(TWO, "r", "rig.toml", seconds=0.03, fps=60.0)
    size = {cv2.CAP_PROP_FRAME_WIDTH: 32, cv2.CAP_PROP_FRAME_HEIGHT: 24}
    assert cameras[1].asked == {cv2.CAP_PROP_FPS: 60.0, **size}
    assert cameras[0].released
    cameras[0].asked = {}
    capture(TWO, "other", size=(64, 48), seconds=0.03)  # it may give another one
    assert cameras[0].asked == {cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}


def test_the_time_is_the_middle_of_the_grabs(cameras):
    sources = [open_source("a", "0"), open_source("b", "1")]
    taken = next(instants_of(sources))
    assert taken.spread_s == pytest.approx(GRAB_S)  # the second grab takes as long
    assert taken.t_s == pytest.approx(100.0 + 1.5 * GRAB_S)
    assert [device.k for device in cameras.values()] == [-1, -1]


def test_frames_that_a_camera_has_kept_are_let_go(cameras, clock, monkeypatch):
    """Four are there at once."""
    monkeypatch.setattr(devices, "WAITED_S", 0.05)
    cameras[0].at = {k: lambda: clock.sleep(0.1) for k in range(3, 20)}
    drain([open_source("a", "0"), open_source("b", "1")])
    assert cameras[0].k == 4  # the kept ones, one that had to be waited for, and one more
    assert cameras[1].k == 18  # it never waits as long: ten each time


def test_an_interruption_ends_it_and_keeps_what_was_taken(cameras, tmp_path, monkeypatch):
    """A second one, while images are still being written, says where they are."""
    cameras[0].frames, cameras[0].then = 0, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        capture(TWO, tmp_path / "r")
    assert list(tmp_path.iterdir()) == []  # before the first instant there is nothing
    cameras |= {0: Device(), 1: Device(frames=7, then=KeyboardInterrupt())}
    done = capture(TWO, tmp_path / "r")
    assert len(done.times_s) == len(read_timestamps(tmp_path / "r" / "timestamps.csv")) == 7
    assert len(list((tmp_path / "r" / "images" / "ccd2").iterdir())) == 7
    cameras |= {0: Device(), 1: Device(frames=7, then=KeyboardInterrupt())}
    monkeypatch.setattr(files_capture, "drain", lambda _: None)  # its threads are joined, too
    real = threading.Thread.join

    def join(thread):
        real(thread)
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt

    monkeypatch.setattr(files_capture.Thread, "join", join)
    with pytest.raises(KeyboardInterrupt, match=r"what was written is in .*other\.partial"):
        capture(TWO, tmp_path / "other")


def test_what_the_disk_cannot_take_is_dropped_and_counted(cameras, tmp_path, monkeypatch):
    real, free, begun, written = recording_writer.write_image, threading.Event(), [], []
    monkeypatch.setattr(files_capture, "QUEUE", 1)
    monkeypatch.setattr(
        recording_writer,
        "write_image",
        lambda *a: (begun.append(a), free.wait(), real(*a), written.append(a)),
    )

    def disk_is_free_again():
        free.set()
        # the instant that was being written, and the one in the queue
        wait_until(lambda: len(written) >= 4)

    # the first instant is being written before there are more
    cameras[0].at[2] = lambda: wait_until(lambda: begun)
    cameras[0].at[60] = disk_is_free_again
    done = capture(TWO, tmp_path / "r", seconds=0.4)
    taken = cameras[0].k - 1  # the last one is over the time
    assert done.dropped > 50
    assert len(done.times_s) == taken - done.dropped
    times = read_timestamps(tmp_path / "r" / "timestamps.csv")
    assert len(times) == len(list((tmp_path / "r" / "images" / "ccd1").iterdir()))
    assert times[-1] <= 0.4
    assert np.diff(times).max() > 50 * 2 * GRAB_S  # the gap stands in the times


def test_a_preview_is_kept_up_to_date_and_small(cameras, tmp_path, monkeypatch):
    seen, real = [], recording_writer.write_image
    monkeypatch.setattr(recording_writer, "write_image", lambda *a: (seen.append(a[:2]), real(*a)))
    monkeypatch.setattr(files_capture, "PREVIEW_S", 0.05)
    monkeypatch.setattr(files_capture, "QUEUE", 1000)
    done = capture(TWO, tmp_path / "r", seconds=0.299, preview=True)
    assert done.times_s == pytest.approx(2 * GRAB_S * np.arange(75))
    shown = [image for image, path in seen if path == tmp_path / "r.partial" / "preview.png"]
    assert len(shown) == 6  # of 75 instants, 4 ms apart, each 13th
    assert shown[0].shape == (24, 64)
    image = side_by_side(
        [np.full((1024, 1280), 10, np.uint8), np.full((480, 640), 20, np.uint8)], 640
    )
    # 480 high they are 600 and 640 wide; shrunk to 640 together 247 high, 308 and 329 wide
    assert image.shape == (247, 308 + 329)
    assert (image[0, 0], image[0, 307], image[0, 308], image[246, 636]) == (10, 10, 20, 20)


# --- what is wrong


def test_what_does_not_fit_leaves_no_folder(cameras, folder, images):
    write_video(folder / "small.mkv", images[:, 0, :16])
    (folder / "text.mkv").write_text("no video")
    (folder / "full").mkdir()
    (folder / "full" / "x").touch()
    (folder / "old.partial").mkdir()
    (folder / "grows.partial").mkdir()
    before = sorted(folder.rglob("*"))
    none = Device(frames=0)
    for change, message in (
        ({"cameras": {**VIDEOS, "ccd2": "no.mkv"}}, r"ccd2: no\.mkv: no such camera or video"),
        ({"cameras": {**VIDEOS, "ccd2": "text.mkv"}}, r"text\.mkv: cannot be read as a video"),
        ({"cameras": {**VIDEOS, "ccd2": "small.mkv"}}, "ccd2: 32 x 16 pixels .*expected 32 x 24"),
        ({"cameras": {**VIDEOS, "ccd2": "0"}, "device": none}, "ccd2: delivers no image after 0 "),
        ({"cameras": {"ccd1": "0.mkv"}}, "ccd2: this camera of the rig is not named"),
        ({"cameras": {**VIDEOS, "ccd3": "0.mkv"}}, "ccd3: a camera"),
        ({"cameras": {"ccd1": "0", "ccd2": "00"}}, "cameras: expected each camera once"),
        ({"cameras": {"a/b": "0"}, "rig": None}, "camera: expected a name"),
        ({"cameras": {"..": "0"}, "rig": None}, "camera: expected a name"),
        ({"cameras": {}}, "cameras: expected one or more"),
        ({"seconds": 0.0}, "seconds: expected a number"),
        ({"fps": -1.0}, "fps: expected a number"),
        ({"rig": "no.toml"}, r"no\.toml: cannot be read"),
        ({"out": "no/r"}, "no such folder to write into"),
        ({"out": "full"}, "full: exists already"),
        ({"out": "old"}, r"old\.partial: an unfinished recording"),
        ({"out": "grows"}, r"grows\.partial: another process works on it$"),
    ):
        cameras[0] = change.pop("device", Device())
        with locked(folder / "grows.partial"), pytest.raises(ValueError, match=message):
            capture(**{"cameras": VIDEOS, "out": "r", "rig": "rig.toml", **change})
        assert sorted(folder.rglob("*")) == before, message


FULL = OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("spoiled", "images", "message"),
    [
        (Device(frames=5), None, "ccd2: delivers no image after 5 instants"),
        (
            Device(sizes={6: (30, 24)}),
            None,
            "ccd2: 30 x 24 pixels after 5 instants, expected 32 x 24",
        ),
        (Device(), 11, r"000005\.png: cannot be written \(No space left on device\)"),
    ],
)
def test_what_fails_ends_it_and_whole_instants_are_kept(
    cameras, tmp_path, monkeypatch, spoiled, images, message
):
    """A camera, or a disk that is full after so many images."""
    cameras[1] = spoiled
    if images is not None:
        results = [DEFAULT] * images + [FULL] * 1000
        write = Mock(wraps=Path.write_bytes, side_effect=results)
        monkeypatch.setattr(Path, "write_bytes", lambda path, data: write(path, data))
    with pytest.raises(ValueError, match=rf"{message}; the 5 instants before are kept in .*r$"):
        capture(TWO, tmp_path / "r")
    assert len(read_timestamps(tmp_path / "r" / "timestamps.csv")) == 5
    assert [len(list((tmp_path / "r" / "images" / name).iterdir())) for name in TWO] == [5, 5]
    assert not (tmp_path / "r.partial").exists()


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (7, r"No space left.*the images of 3 instants are in .*r\.partial"),
        (0, r"000000\.png: cannot be written \(No space left on device\)$"),
    ],
)
def test_a_full_disk_leaves_images_without_times_or_nothing(
    cameras, tmp_path, monkeypatch, images, message
):
    write = Mock(wraps=Path.write_bytes, side_effect=[DEFAULT] * images + [FULL] * 1000)
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: write(path, data))
    no_times = Mock(side_effect=ValueError("No space left on device"))
    monkeypatch.setattr(recording_writer, "write_whole", no_times)
    with pytest.raises(ValueError, match=message):
        capture(TWO, tmp_path / "r")
    assert len(list(tmp_path.glob("r.partial/images/ccd1/*"))) == images // 2
    assert (tmp_path / "r.partial").exists() == (images > 0)


# --- as a command


# Takes eight instants; a ninth never comes.
WAITS = (
    """
import time
from workbench.capture import capture
real = capture.instants_of
def instants_of(*sources):
    for k, taken in enumerate(real(*sources)):
        while k == 8:
            time.sleep(0.01)
        yield taken
capture.instants_of = instants_of
"""
    + CLI
)


def test_command_judges_the_timing_of_cameras(cameras, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    line = ["capture", "--camera", "ccd1=0", "ccd2=1", "--out", "r", "--seconds", "0.099"]
    assert cli.main(line) == 0
    # 2 ms between the grabs, 4 ms between the instants; 300 mm/s times 2 ms, 0.1 mm by 2 ms
    out = capfd.readouterr().out
    for words in (
        "25 instants in 0.10 s (250.0 a second), 0 dropped; cameras within 2.0 ms (median)",
        "a hand at 300 mm/s moves 0.6 mm, and one at 50 mm/s 0.1 mm: fit for a slow hand",
        "another 4 ms apart",
    ):
        assert words in out


@pytest.mark.parametrize(
    ("spread_ms", "said"),
    [
        (5.1, "one at 20 mm/s 0.1 mm: fit for a handle at rest, not for a moving hand"),
        (4.9, "one at 20 mm/s 0.1 mm: fit for a slow hand, not for a quick one, if the cameras"),
        (0.3, "one at 3.3e+02 mm/s 0.1 mm: fit for a moving hand, if the cameras"),
        (0.0, "moves 0 mm, and one at 1e+05 mm/s 0.1 mm: fit for a moving hand, if the cameras"),
    ],
)
def test_a_verdict_on_the_timing(spread_ms, said):
    times = np.arange(100) / 30
    spread = np.full(100, spread_ms / 1e3)
    spread[:4] = 9.0  # a few bad instants do not spoil it
    assert said in timing(Captured(Path("r"), times, spread, 0, 3))
    assert timing(Captured(Path("r"), times, spread, 0, 1)) == ""
    spread[:6] = 9.0
    assert "fit for a handle at rest" in timing(Captured(Path("r"), times, spread, 0, 2))


def test_the_cameras_are_listed(cameras, tmp_path, monkeypatch, capfd):
    for index, name in ((0, "A good one"), (1, "Another"), (10, "")):
        (tmp_path / f"video{index}").mkdir()
        if name:
            (tmp_path / f"video{index}" / "name").write_text(f"{name}\n")
    monkeypatch.setattr(devices, "ABOUT", tmp_path)
    monkeypatch.setattr(devices, "DEVICES", Path("none"))
    cameras[1].frames, cameras[10] = -2, Closed()
    assert cli.main(["capture", "--list"]) == 0
    assert capfd.readouterr().out == (
        "  0  A good one: 32 x 24 px, 30 frames per second\n"
        "  1  Another: delivers no image\n"
        " 10  camera: there is no none/video10\n"
    )
    assert cameras[0].released
    monkeypatch.setattr(devices, "ABOUT", tmp_path / "none")  # another system: all are tried
    monkeypatch.setattr(devices, "open_index", lambda k: cameras.get(k, Closed()))
    assert [(one.number, one.size) for one in devices.list_cameras()] == [(0, SIZE)]
    monkeypatch.setattr(devices, "ABOUT", tmp_path)
    for index in (0, 1, 10):
        shutil.rmtree(tmp_path / f"video{index}")
    assert cli.main(["capture", "--list"]) == 0
    assert capfd.readouterr().out.startswith("no camera; a container")


def test_a_camera_that_cannot_be_opened_is_answered_by_those_that_are_there(tmp_path, monkeypatch):
    monkeypatch.setattr(devices, "open_index", lambda _: Closed())
    monkeypatch.setattr(devices, "DEVICES", tmp_path / "dev")
    monkeypatch.setattr(devices, "ABOUT", tmp_path / "none")

    def refusal():
        with pytest.raises(ValueError, match="a: camera 7 cannot be opened") as caught:
            open_source("a", "7")
        return str(caught.value)

    assert refusal().endswith("--list tries all")
    monkeypatch.setattr(devices, "ABOUT", tmp_path)
    assert re.search(r"\(there is no .*video7\); this computer has no camera$", refusal())
    (tmp_path / "video2").mkdir()
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev" / "video7").touch()
    assert re.search(r"\(another program uses it, .*\); there are 2 \(no name\)$", refusal())
    monkeypatch.setattr(devices.os, "access", lambda *_: False)
    assert "its users are in the group" in refusal()


def test_control_c_ends_the_command_normally(folder):
    with started("capture --camera a=0.mkv --out r", WAITS) as running:
        wait_until((folder / "r.partial" / "images" / "a" / "000007.png").exists, running)
        running.send_signal(signal.SIGINT)
        code, err = ended(running)
    assert (code, err) == (
        0,
        ["recording to r; Ctrl-C ends it\n", "interrupted: writing what was taken\n"],
    )
    assert len(list((folder / "r" / "images" / "a").iterdir())) == 8
    assert len(read_timestamps(folder / "r" / "timestamps.csv")) == 8
