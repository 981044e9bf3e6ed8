"""What the live page records is whole up to any moment, whatever ends it."""

import sys
from functools import partial

import numpy as np
import pytest
from livepage import HANDLE, HELD, RIG
from processes import ended, started, wait_until
from sentences import BUSY

from satellites.live import recorder as live
from satellites.live.recorder import Recorder
from trinolab.bench.rendering import render
from trinolab.files import recording_writer as files
from trinolab.files.journal import locked
from trinolab.files.recording import instants, open_folder
from workbench.capture.capture import capture
from workbench.capture.devices import Taken
from workbench.teleop.teleoperate import recorded

TIMES = [5.0, 5.03, 5.07, 5.1]


def recorded_by(folder, times=TIMES, clutch=(False, True, True, False)):
    recorder = Recorder(folder, RIG, HANDLE)
    recorder.start()
    for t, closed in zip(times, clutch, strict=True):
        recorder.add(Taken(t, 0.0, HELD), closed)
    return recorder


def the_only(folder):
    (only,) = folder.iterdir()
    return only


def test_a_recording_is_what_track_and_teleop_read(tmp_path):
    recorder = recorded_by(tmp_path)
    assert recorder.running
    recorder.close()
    folder = the_only(tmp_path)
    assert recorder.status == f"recorded 4 instants: {folder}"
    found, handle = open_folder(folder)
    assert handle == HANDLE
    np.testing.assert_allclose(found.times_s, np.subtract(TIMES, 5.0), atol=1e-9)
    for now in instants(found):
        for image, taken in zip(now.images, HELD, strict=True):
            np.testing.assert_array_equal(image, taken)
    assert recorded(folder).length == 4
    assert (folder / "clutch.csv").read_text().split() == ["t_s,closed", "0,0", "0.03,1", "0.1,0"]


def test_nothing_taken_leaves_nothing(tmp_path):
    recorder = Recorder(tmp_path, RIG, HANDLE)
    recorder.start()
    recorder.close()
    assert recorder.status == "recording stopped: nothing was taken"
    assert list(tmp_path.iterdir()) == []


def test_another_recording_of_the_same_second_is_left_alone(tmp_path, monkeypatch):
    class Noon(live.datetime):
        @classmethod
        def now(cls):
            return cls(2026, 1, 1, 12)

    monkeypatch.setattr(live, "datetime", Noon)
    first = recorded_by(tmp_path)
    with pytest.raises(ValueError, match=BUSY), locked(the_only(tmp_path)):
        pass
    second = Recorder(tmp_path, RIG, HANDLE)
    second.start()
    assert "not recording" in second.status
    first.close()
    assert "recorded 4 instants" in first.status
    with locked(the_only(tmp_path)):  # free, since it has its name
        pass


def full_after(count, monkeypatch, what):
    """Let the disk be full after so many images, or lines."""
    left = [count]
    kind, name = (files, "write_image") if what == "image" else (live.Journal, "add_line")
    write = getattr(kind, name)

    def until_full(*arguments):
        left[0] -= 1
        if left[0] < 0:
            if what == "line":
                file, text = arguments
                with file.path.open("a") as cut_off:
                    cut_off.write(text[:-1])
            raise ValueError("x: cannot be written (No space left on device)")
        write(*arguments)

    monkeypatch.setattr(kind, name, until_full)


@pytest.mark.parametrize(("what", "count", "whole"), [("image", 8, 2), ("line", 4, 2)])
def test_a_full_disk_ends_it_with_words_and_what_is_there_is_whole(
    tmp_path, monkeypatch, what, count, whole
):
    full_after(count, monkeypatch, what)
    recorder = Recorder(tmp_path, RIG, HANDLE)
    recorder.start()
    for k in range(1000):
        if not recorder.running:
            break
        writer = recorder.clock_now.writer
        recorder.add(Taken(k / 30, 0.0, HELD), bool(k))
        wait_until(partial(_has_ended, writer, k + 1))
    recorder.close()
    folder = the_only(tmp_path)
    assert "No space left" in recorder.status
    assert f"{folder}" in recorder.status
    found, _ = open_folder(folder)
    assert found.length == whole == len(list(instants(found)))
    texts = [(folder / name).read_text() for name in (live.TIMES, live.CLUTCH)]
    assert len(texts[0].splitlines()) == 1 + whole  # a line that was cut off is no instant
    assert all(text.endswith("\n") for text in texts)


def _has_ended(writer, count):
    """Whether so many instants are written, or no more will be."""
    return len(writer.written) >= count or writer.error is not None


RECORD = """
import sys
sys.path[:0] = {path!r}
from pathlib import Path
from livepage import HANDLE, HELD, RIG
from workbench.capture.devices import Taken
from satellites.live.recorder import Recorder
recorder = Recorder(Path("."), RIG, HANDLE)
recorder.start()
k = 0
while True:
    recorder.add(Taken(k / 30, 0.0, HELD), False)
    k += 1
"""


def test_kill_9_leaves_what_is_whole_and_until_then_no_other_command_writes(tmp_path):
    process = started("", RECORD.format(path=sys.path), cwd=tmp_path)

    def growing():
        found = list(tmp_path.glob("*.partial/timestamps.csv"))
        return found and len(found[0].read_text().splitlines()) > 12 and found[0].parent

    folder = wait_until(growing, process)
    out = folder.with_suffix("")
    try:
        with pytest.raises(ValueError, match=f"{folder.name}: {BUSY}$"):
            capture({"ccd1": "0"}, out)
        with pytest.raises(ValueError, match=f"{folder.name}: {BUSY}$"):
            render(RIG, HANDLE, "calm", out, seconds=0.1, progress=False)
    finally:
        process.kill()
        ended(process)
    assert list(tmp_path.iterdir()) == [folder]
    found, _ = open_folder(folder)
    read = list(instants(found))
    assert len(read) == found.length == len(found.times_s) >= 11
    np.testing.assert_array_equal(read[-1].images[2], HELD[2])
    with locked(folder):  # free, however the process has ended
        pass


def test_an_image_without_its_time_is_no_instant(tmp_path):
    """As a process leaves it that is killed between an image and the time."""
    recorded_by(tmp_path).close()
    cut_off = the_only(tmp_path).rename(tmp_path / "r.partial")
    extra = files.image_paths(cut_off, RIG, 4)
    files.write_image(HELD[0], extra[0])
    extra[1].with_name(f".{extra[1].name}").write_bytes(b"half an image")
    found, _ = open_folder(cut_off)
    assert [len(one.names) for one in found.footage] == [4, 4, 4]
    assert len(list(instants(found))) == 4


def test_what_the_disk_cannot_take_is_dropped_and_the_rest_is_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.capture.capture.QUEUE", 2)
    monkeypatch.setattr(files, "write_image", _slow(files.write_image, gate := []))
    recorder = Recorder(tmp_path, RIG, HANDLE)
    recorder.start()
    writer = recorder.clock_now.writer
    for k in range(50):
        recorder.add(Taken(k / 30, 0.0, HELD), False)
    assert writer.dropped > 40
    gate.append(True)
    recorder.close()
    assert f"{writer.dropped} dropped" in recorder.status
    found, _ = open_folder(the_only(tmp_path))
    assert found.length == 50 - writer.dropped


def _slow(write, gate):
    def waiting(*arguments):
        wait_until(lambda: gate)
        write(*arguments)

    return waiting
