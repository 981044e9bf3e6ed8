"""What the live page records is whole up to any moment, whatever ends it."""

import sys

import numpy as np
import pytest
from livepage import HANDLE, HELD, RIG
from processes import ended, started, wait_until

from satellites.live import recorder as live
from satellites.live.recorder import Recorder
from trinolab.bench.rendering import render
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


def test_a_full_disk_ends_it_with_words_and_what_is_there_is_whole(tmp_path, monkeypatch):
    """Its last line is cut off."""
    left = [4]
    write = live.Journal.add_line

    def until_full(file, text):
        left[0] -= 1
        if left[0] >= 0:
            return write(file, text)
        with file.path.open("a") as cut_off:
            cut_off.write(text[:-1])
        raise ValueError("x: cannot be written (No space left on device)")

    monkeypatch.setattr(live.Journal, "add_line", until_full)
    recorder = Recorder(tmp_path, RIG, HANDLE)
    recorder.start()
    for k in range(1000):
        if not recorder.running:
            break
        writer = recorder.clock_now.writer
        recorder.add(Taken(k / 30, 0.0, HELD), bool(k))
        wait_until(lambda writer=writer, k=k: len(writer.written) > k or writer.error is not None)
    recorder.close()
    folder = the_only(tmp_path)
    assert "No space left" in recorder.status
    assert f"{folder}" in recorder.status
    found, _ = open_folder(folder)
    assert found.length == 2 == len(list(instants(found)))
    texts = [(folder / name).read_text() for name in (live.TIMES, live.CLUTCH)]
    assert len(texts[0].splitlines()) == 1 + 2  # a line that was cut off is no instant
    assert all(text.endswith("\n") for text in texts)


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
        with pytest.raises(ValueError, match=f"{folder.name}: another process works on it$"):
            capture({"ccd1": "0"}, out)
        with pytest.raises(ValueError, match=f"{folder.name}: another process works on it$"):
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
