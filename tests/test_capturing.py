"""Recording from cameras: videos in their place, and devices that fail in every way."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from trinolab import capturing, cli, devices, outputs, recorder
from trinolab.camera import Rig
from trinolab.capturing import capture, side_by_side
from trinolab.datasets import data_path, load_rig
from trinolab.devices import drain, instants_of, open_source
from trinolab.recording import find_footage, instants, open_recording, read_timestamps
from trinolab.rigfile import read_rig, write_rig

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
        write_video(tmp_path / f"{c}.mkv", images[:, c])
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_video(path, frames, fps=FPS):
    height, width = frames[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), fps, (width, height), isColor=False)
    for frame in frames:
        writer.write(frame)
    writer.release()


class Device:
    """A camera that delivers frames of one grey level until `frames` are over, and then fails or raises."""

    def __init__(self, frames=10**6, size=SIZE, then=None, sizes=None):
        self.k, self.frames, self.then, self.asked, self.released = -2, frames, then, {}, False  # two are let go
        self.sizes = sizes or {}
        self.size = size

    def isOpened(self):
        return True

    def grab(self):
        time.sleep(0.002)
        self.k += 1
        if self.k > self.frames and self.then:
            raise self.then
        return self.k <= self.frames

    def retrieve(self):
        width, height = self.sizes.get(self.k, self.size)
        return True, np.full((height, width, 3), self.k % 256, np.uint8)

    def set(self, key, value):
        self.asked[key] = value

    def release(self):
        self.released = True


@pytest.fixture
def cameras(monkeypatch):
    """Two devices, and what names them."""
    made = {0: Device(), 1: Device()}
    monkeypatch.setattr(devices, "_open_index", made.__getitem__)
    return made


TWO = {"ccd1": "0", "ccd2": "1"}
VIDEOS = {"ccd2": "1.mkv", "ccd1": "0.mkv"}


def test_videos_become_a_recording(folder, images):
    done = capture(VIDEOS, "r", "rig.toml", data_path("handles", "coded.toml"), preview=True)
    assert sorted(path.name for path in folder.joinpath("r").iterdir()) == ["handle.toml", "images", "rig.toml",
                                                                             "timestamps.csv"]
    assert not (folder / "r.partial").exists()
    rig = read_rig("r/rig.toml")
    found = list(instants(open_recording(find_footage("r", rig), rig, timestamps="r/timestamps.csv")))
    np.testing.assert_array_equal([one.images for one in found], images)  # grey again, to the level
    assert [one.t_s for one in found] == pytest.approx(done.times_s, abs=1e-8)
    assert done.dropped == 0
    assert done.times_s[0] == 0
    # twelve frames at 200 a second: never faster, and not much slower
    assert 11 / FPS - 0.01 < done.times_s[-1] < 11 / FPS + 1.0
    assert (done.spread_s >= 0).all()


def test_without_a_rig_there_is_no_rig_file_and_any_size_will_do(folder, images):
    write_video(folder / "small.mkv", images[:, 0, :16])
    capture({"left": "0.mkv", "right": "small.mkv"}, "r", fps=100.0)
    assert sorted(path.name for path in Path("r").iterdir()) == ["images", "timestamps.csv"]
    assert len(list(Path("r/images/right").iterdir())) == 12
    assert np.diff(read_timestamps("r/timestamps.csv")).mean() > 0.008  # s; a hundred a second were asked for


def test_cameras_are_asked_for_size_and_rate(cameras, folder):
    capture(TWO, "r", "rig.toml", seconds=0.03, fps=60.0)
    assert cameras[1].asked == {cv2.CAP_PROP_FPS: 60.0, cv2.CAP_PROP_FRAME_WIDTH: 32, cv2.CAP_PROP_FRAME_HEIGHT: 24}
    assert cameras[0].released
    cameras[0].asked = {}
    capture(TWO, "other", size=(64, 48), seconds=0.03)  # it may give another one
    assert cameras[0].asked == {cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}


def test_the_time_is_the_middle_of_the_grabs(cameras):
    sources = [open_source("a", "0"), open_source("b", "1")]
    stream = instants_of(sources)
    before = time.perf_counter()
    taken = next(stream)
    after = time.perf_counter()
    assert taken.spread_s >= 0.002  # the second grab takes as long
    assert before + 0.002 + taken.spread_s / 2 <= taken.t_s <= after - taken.spread_s / 2
    assert [device.k for device in cameras.values()] == [-1, -1]


def test_frames_that_a_camera_has_kept_are_let_go(cameras, monkeypatch):
    class Kept(Device):
        def grab(self):
            time.sleep(0.1 * (self.k >= 2))  # four frames are there at once
            self.k += 1
            return True

    monkeypatch.setattr(devices, "WAITED_S", 0.05)
    cameras[0] = Kept()
    drain([open_source("a", "0"), open_source("b", "1")])
    assert cameras[0].k == 4  # the kept ones, one that had to be waited for, and one more
    assert cameras[1].k == 18  # it never waits as long: ten each time


def test_seconds_end_it(cameras, tmp_path):
    done = capture(TWO, tmp_path / "r", seconds=0.1)
    assert 0 < done.times_s[-1] < 0.1


def test_an_interruption_ends_it_and_keeps_what_was_taken(cameras, tmp_path):
    cameras[1].frames, cameras[1].then = 7, KeyboardInterrupt()
    done = capture(TWO, tmp_path / "r")
    assert len(done.times_s) == len(read_timestamps(tmp_path / "r" / "timestamps.csv")) == 7
    assert len(list((tmp_path / "r" / "images" / "ccd2").iterdir())) == 7


def test_a_second_interruption_says_where_the_images_are(cameras, tmp_path, monkeypatch, capfd):
    real = threading.Thread.join

    def join(thread):
        real(thread)
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt

    cameras[1].frames, cameras[1].then = 7, KeyboardInterrupt()
    monkeypatch.setattr(capturing, "drain", lambda _: None)  # its threads are joined, too
    monkeypatch.setattr(capturing.Thread, "join", join)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["capture", "--camera", "ccd1=0", "ccd2=1", "--out", "r"]) == 130
    assert capfd.readouterr().err.splitlines()[-1].endswith(f"interrupted, what was written is in {tmp_path}/r.partial")


def test_an_interruption_before_the_first_instant_leaves_nothing(cameras, tmp_path):
    cameras[1].frames, cameras[1].then = 0, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        capture(TWO, tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


def test_what_the_disk_cannot_take_is_dropped_and_counted(cameras, tmp_path, monkeypatch):
    real = recorder.write_image
    monkeypatch.setattr(capturing, "QUEUE", 1)
    monkeypatch.setattr(recorder, "write_image", lambda *a: (time.sleep(0.05), real(*a)))
    done = capture(TWO, tmp_path / "r", seconds=0.4)
    taken = cameras[0].k - 1  # the last one is over the time
    assert done.dropped > 10
    assert len(done.times_s) == taken - done.dropped
    times = read_timestamps(tmp_path / "r" / "timestamps.csv")
    assert len(times) == len(list((tmp_path / "r" / "images" / "ccd1").iterdir()))
    assert np.diff(times).max() > 0.03  # s; the gap stands in the times


def test_a_queue_that_fills_is_written_without_compression(cameras, tmp_path, monkeypatch):
    how, real = [], recorder.write_image
    monkeypatch.setattr(capturing, "QUEUE", 8)
    monkeypatch.setattr(recorder, "write_image", lambda image, path, fast: (
        how.append(fast), time.sleep(0 if fast else 0.05), real(image, path, fast)))
    done = capture(TWO, tmp_path / "r", seconds=0.3)
    assert not how[0]
    assert True in how
    assert len(done.times_s) == len(how) / 2
    grey = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((tmp_path / "r/images/ccd1").iterdir())]
    assert len({image.shape for image in grey}) == 1


def test_a_preview_is_kept_up_to_date(cameras, tmp_path, monkeypatch):
    seen, real = [], recorder.write_image
    monkeypatch.setattr(recorder, "write_image", lambda *a: (seen.append(a[:2]), real(*a)))
    monkeypatch.setattr(capturing, "PREVIEW_S", 0.05)
    capture(TWO, tmp_path / "r", seconds=0.3, preview=True)
    shown = [image for image, path in seen if path == tmp_path / "r.partial" / "preview.png"]
    assert 2 <= len(shown) <= 7
    assert shown[0].shape == (24, 64)


def test_preview_is_small_and_its_cameras_equally_high():
    image = side_by_side([np.full((1024, 1280), 10, np.uint8), np.full((480, 640), 20, np.uint8)], 640)
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
    before = sorted(folder.rglob("*"))
    none = Device(frames=0)
    for change, message in (({"cameras": {**VIDEOS, "ccd2": "no.mkv"}}, r"ccd2: no\.mkv: no such camera or video"),
                            ({"cameras": {**VIDEOS, "ccd2": "text.mkv"}}, r"text\.mkv: cannot be read as a video"),
                            ({"cameras": {**VIDEOS, "ccd2": "small.mkv"}}, "ccd2: 32 x 16 pixels .*expected 32 x 24"),
                            ({"cameras": {**VIDEOS, "ccd2": "0"}, "device": none}, "ccd2: delivers no image after 0 "),
                            ({"cameras": {"ccd1": "0.mkv"}}, "ccd2: this camera of the rig is not named"),
                            ({"cameras": {**VIDEOS, "ccd3": "0.mkv"}}, "ccd3: a camera that the rig does not have"),
                            ({"cameras": {"ccd1": "0", "ccd2": "00"}}, "cameras: expected each camera once"),
                            ({"cameras": {"a/b": "0"}, "rig": None}, "camera: expected a name that a folder can have"),
                            ({"cameras": {"..": "0"}, "rig": None}, "camera: expected a name that a folder can have"),
                            ({"cameras": {}}, "cameras: expected one or more"),
                            ({"seconds": 0.0}, "seconds: expected a number"),
                            ({"fps": -1.0}, "fps: expected a number"),
                            ({"rig": "no.toml"}, r"no\.toml: cannot be read"),
                            ({"out": "no/r"}, "no such folder to write into"),
                            ({"out": "full"}, "full: exists already"),
                            ({"out": "old"}, r"old\.partial: an unfinished recording")):
        cameras[0] = change.pop("device", Device())
        with pytest.raises(ValueError, match=message):
            capture(**{"cameras": VIDEOS, "out": "r", "rig": "rig.toml", **change})
        assert sorted(folder.rglob("*")) == before, message


@pytest.mark.parametrize(("spoiled", "message"), [
    (Device(frames=5), "ccd2: delivers no image after 5 instants"),
    (Device(sizes={6: (30, 24)}), "ccd2: 30 x 24 pixels after 5 instants, expected 32 x 24")])
def test_a_camera_that_fails_ends_it_and_what_was_taken_is_kept(cameras, tmp_path, spoiled, message):
    cameras[1] = spoiled
    with pytest.raises(ValueError, match=rf"{message}; the 5 instants before are kept in .*r$"):
        capture(TWO, tmp_path / "r")
    assert len(read_timestamps(tmp_path / "r" / "timestamps.csv")) == 5
    assert [len(list((tmp_path / "r" / "images" / name).iterdir())) for name in TWO] == [5, 5]
    assert not (tmp_path / "r.partial").exists()


def test_a_video_that_ends_before_another_is_a_camera_that_stops(folder, images):
    write_video(folder / "short.mkv", images[:4, 1])
    with pytest.raises(ValueError, match="ccd2: delivers no image after 4 instants; the 4 instants before are kept"):
        capture({"ccd1": "0.mkv", "ccd2": "short.mkv"}, "r")


def full_disk(monkeypatch, allowed, also_text):
    """From the write of image number `allowed` on, the disk is full."""
    real, left = Path.write_bytes, iter(range(allowed))

    def write(path, data):
        if next(left, None) is None:
            raise OSError(28, "No space left on device")
        return real(path, data)

    def whole(path, _):
        raise ValueError(f"{path}: cannot be written (No space left on device)")

    monkeypatch.setattr(Path, "write_bytes", write)
    if also_text:
        monkeypatch.setattr(recorder, "write_whole", whole)


def test_a_full_disk_ends_it_and_whole_instants_are_kept(cameras, tmp_path, monkeypatch):
    full_disk(monkeypatch, 7, also_text=False)  # three instants and a half
    with pytest.raises(ValueError, match=r"000003\.png: cannot be written \(No space left.*the 3 instants before"):
        capture(TWO, tmp_path / "r")
    assert len(read_timestamps(tmp_path / "r" / "timestamps.csv")) == 3
    assert [len(list((tmp_path / "r" / "images" / name).iterdir())) for name in TWO] == [3, 3]


def test_a_full_disk_that_takes_no_times_leaves_the_images_unfinished(cameras, tmp_path, monkeypatch):
    full_disk(monkeypatch, 7, also_text=True)
    with pytest.raises(ValueError, match=r"No space left.*the images of 3 instants are in .*r\.partial"):
        capture(TWO, tmp_path / "r")
    assert len(list((tmp_path / "r.partial" / "images" / "ccd1").iterdir())) == 3


def test_a_disk_that_is_full_from_the_start_leaves_nothing(cameras, tmp_path, monkeypatch):
    full_disk(monkeypatch, 0, also_text=False)
    with pytest.raises(ValueError, match=r"000000\.png: cannot be written \(No space left on device\)$"):
        capture(TWO, tmp_path / "r")
    assert list(tmp_path.iterdir()) == []
    write_rig(load_rig("paper_pair"), tmp_path / "rig.toml")
    monkeypatch.setattr(outputs.os, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    for device in cameras.values():
        device.size = (1280, 1024)
    with pytest.raises(ValueError, match=r"rig\.toml: cannot be written \(No space left on device\)$"):
        capture(TWO, tmp_path / "r", tmp_path / "rig.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]


# --- as a command


def test_command_says_what_it_recorded(folder, capfd):
    assert cli.main(["capture", "--camera", "ccd1=0.mkv", "ccd2=1.mkv", "--out", "r", "--preview"]) == 0
    out, _ = capfd.readouterr()
    assert re.fullmatch(r"12 instants in \d\.\d\d s \(\d+\.\d a second\), 0 dropped; "
                        r"cameras within \d+\.\d ms \(median\), \d+\.\d ms \(longest\); written to r\n", out)


def test_control_c_ends_the_command_normally(folder):
    write_video(folder / "long.mkv", [np.zeros(SIZE[::-1], np.uint8)] * 3000, fps=50)
    line = [sys.executable, "-m", "trinolab.cli", "capture", "--camera", "a=long.mkv", "--out", "r"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        while running.poll() is None and not (folder / "r.partial" / "images" / "a" / "000005.png").exists():
            time.sleep(0.05)
        os.kill(running.pid, signal.SIGINT)
        out, err = running.communicate(timeout=120)
    assert running.returncode == 0, err
    assert out.endswith("written to r\n")
    assert err == "recording to r; Ctrl-C ends it\ninterrupted: writing what was taken\n"
    count = len(list((folder / "r" / "images" / "a").iterdir()))
    assert 6 <= count == len(read_timestamps(folder / "r" / "timestamps.csv")) < 3000
