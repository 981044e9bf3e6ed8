"""Footage and recordings: videos and image folders give the same frames; what does not fit is
named.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from cases import cases, unescaped

from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.files import recording_writer
from trinolab.files.images import read_grey
from trinolab.files.recording import (
    find_footage,
    instants,
    open_folder,
    open_recording,
    read_timestamps,
    some_instants,
)
from trinolab.files.rigs import write_rig

SIZE = (32, 24)


@pytest.fixture(scope="module")
def rig():
    pair = load_rig("paper_pair")
    return replace(pair, cameras=tuple(replace(camera, size=SIZE) for camera in pair.cameras))


@pytest.fixture(scope="module")
def images():
    """Five instants of noise, (5, 2, height, width)."""
    return np.random.default_rng(0).integers(0, 256, (5, 2, *SIZE[::-1]), dtype=np.uint8)


@pytest.fixture
def folder(tmp_path, rig, images):
    partial = recording_writer.begin(
        tmp_path / "r", rig, load_handle("coded"), dict(zip(rig.names, images[0], strict=True))
    )
    for k, instant in enumerate(images):
        recording_writer.add(partial, rig, k, instant)
    recording_writer.finish(tmp_path / "r", np.arange(5) / 25)
    return tmp_path / "r"


def write_video(path, frames, codec="FFV1", fps=30):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), fps, SIZE, isColor=False)
    for frame in frames:
        writer.write(frame)
    writer.release()


def videos(tmp_path, rig, images):
    for c, name in enumerate(rig.names):
        write_video(tmp_path / f"{name}.mkv", images[:, c])
    return {name: tmp_path / f"{name}.mkv" for name in rig.names}


@pytest.fixture(params=["folders", "videos"])
def sources(request, folder, tmp_path, rig, images):
    """The footage of each camera, as folders of images and as videos."""
    if request.param == "folders":
        return find_footage(folder, rig)
    return videos(tmp_path, rig, images)


def test_a_written_folder_is_read_back(folder, rig, images):
    assert not folder.with_name("r.partial").exists()
    recording, handle = open_folder(folder)
    assert recording.rig.names == rig.names
    assert handle == load_handle("coded")
    found = list(instants(recording))
    assert recording.length == 5
    assert [one.frame for one in found] == [0, 1, 2, 3, 4]
    assert [one.t_s for one in found] == pytest.approx(np.arange(5) / 25)
    np.testing.assert_array_equal([one.images for one in found], images)


def test_a_folder_opens_with_another_rig_and_without_timestamps(tmp_path, folder, rig):
    (folder / "timestamps.csv").unlink()
    first, second = rig.cameras
    write_rig(
        Rig((replace(first, name="ccd2"), replace(second, name="ccd1"))), tmp_path / "other.toml"
    )
    recording, _ = open_folder(folder, rig=tmp_path / "other.toml")
    assert recording.rig.names == ("ccd2", "ccd1")
    assert [one.path.name for one in recording.footage] == ["ccd2", "ccd1"]
    assert (recording.times_s, recording.rate) == (None, 30.0)
    (folder / "handle.toml").unlink()
    with pytest.raises(ValueError, match=r"handle\.toml"):
        open_folder(folder)
    with pytest.raises(ValueError, match="none: no such folder"):
        open_folder(tmp_path / "none")


@pytest.mark.parametrize("fast", [False, True])
def test_written_images_are_whole_and_exact(tmp_path, images, fast):
    image = images[0, 0, :, :31]  # rows that are not contiguous
    recording_writer.write_image(image, tmp_path / "x.png", fast)
    back = cv2.imread(str(tmp_path / "x.png"), cv2.IMREAD_UNCHANGED)
    assert (back.dtype, back.shape) == (np.uint8, (24, 31))
    np.testing.assert_array_equal(back, image)
    np.testing.assert_array_equal(read_grey(tmp_path / "x.png", (31, 24)), image)
    assert [path.name for path in tmp_path.iterdir()] == ["x.png"]


def test_folders_and_lossless_videos_give_the_same_frames(sources, rig, images):
    recording = open_recording(sources, rig, fps=30.0)
    for first in (0, 3):
        found = list(instants(recording, first))
        assert [one.frame for one in found] == list(range(first, 5))
        assert found[0].t_s == pytest.approx(first / 30)
        np.testing.assert_array_equal([one.images for one in found], images[first:])
    found = list(some_instants(recording, [1, 4]))
    assert [one.frame for one in found] == [1, 4]
    np.testing.assert_array_equal([one.images for one in found], images[[1, 4]])
    assert list(some_instants(recording, [])) == []


def test_what_a_video_does_not_have_is_said_when_it_is_read(tmp_path, rig, images):
    (tmp_path / "t.csv").write_text("frame,t_s\n0,0\n1,0.1\n")
    sources = videos(tmp_path, rig, images)
    with pytest.raises(ValueError, match=r"ccd1\.mkv: ends before frame 7"):
        list(some_instants(open_recording(sources, rig), [7]))
    with pytest.raises(ValueError, match="no time for frame 2,"):
        list(instants(open_recording(sources, rig, timestamps=tmp_path / "t.csv")))


def test_a_conversion_is_said_once_for_the_videos_of_all_cameras(tmp_path, rig, caplog):
    for name in rig.names:
        writer = cv2.VideoWriter(
            str(tmp_path / f"{name}.mkv"), cv2.VideoWriter_fourcc(*"FFV1"), 30, SIZE
        )
        for _ in range(2):
            writer.write(np.full((*SIZE[::-1], 3), (10, 200, 60), np.uint8))
        writer.release()
    caplog.set_level("INFO")
    recording = open_recording(find_footage(tmp_path, rig), rig)
    for _ in range(2):  # each reader says it again
        found = list(instants(recording))
        assert len(found) == 2
        assert abs(int(found[0].images[1][5, 5]) - (0.114 * 10 + 0.587 * 200 + 0.299 * 60)) < 3
    said = f"{tmp_path / rig.names[0]}.mkv: colour converted to grey; said once"
    assert caplog.messages == [said, said]


@pytest.mark.parametrize("camera", [0, 1])
def test_what_all_cameras_have_is_taken(sources, camera, folder, tmp_path, rig, images, caplog):
    caplog.set_level("INFO")
    name = rig.names[camera]
    for k in (3, 4):
        (folder / "images" / name / f"{k:06d}.png").unlink()
    write_video(tmp_path / "short.mkv", images[:3, camera])
    for short in (folder / "images" / name, tmp_path / "short.mkv"):
        caplog.clear()
        found = list(instants(open_recording({**sources, name: short}, rig)))
        np.testing.assert_array_equal([one.images for one in found], images[:3])
        (line,) = caplog.messages
        assert line.startswith(f"{short}: ends after 3 frames, another camera")


@pytest.mark.parametrize(
    ("fps", "suffix"), [(5.0, "mkv"), (30.0, "avi"), (59.94, "mp4"), (60.0, "avi"), (120.0, "mkv")]
)
def test_the_rate_of_a_video_is_used(fps, suffix, tmp_path, rig, images, caplog):
    caplog.set_level("INFO")
    codec = "mp4v" if suffix == "mp4" else "FFV1"
    sources = {name: tmp_path / f"{name}.{suffix}" for name in rig.names}
    for k, path in enumerate(sources.values()):
        write_video(path, images[:, k], codec, fps)
    times = [one.t_s for one in instants(open_recording(sources, rig))]
    assert np.allclose(times, np.arange(5) / fps, rtol=2e-3)
    assert bool(caplog.messages) == (fps != 30)
    assert open_recording(sources, rig, fps=7.0).time_of(3) == pytest.approx(3 / 7)
    write_video(sources["ccd2"], images[:, 1], codec, 1.1 * fps)
    with pytest.raises(ValueError, match=rf"ccd2\.{suffix}: states .* frames a second, "):
        open_recording(sources, rig)


def test_what_does_not_fit_is_named(tmp_path, folder, rig, images):
    sources = find_footage(folder, rig)
    (tmp_path / "empty.mkv").touch()
    (tmp_path / "text.mkv").write_text("no video")
    (tmp_path / "nothing").mkdir()
    for camera, name, message in (
        ("ccd2", "no.mkv", "no.mkv: no such file"),
        ("ccd2", "empty.mkv", "empty.mkv: cannot be read as a video"),
        ("ccd2", "text.mkv", "text.mkv: cannot be read as a video"),
        ("ccd2", "nothing", "nothing: no image in it"),
        ("ccd9", "text.mkv", "ccd9: a camera"),
    ):
        with pytest.raises(ValueError, match=message):
            open_recording({**sources, camera: tmp_path / name}, rig)
    with pytest.raises(ValueError, match="ccd2: no video"):
        open_recording({"ccd1": sources["ccd1"]}, rig)
    (tmp_path / "t.csv").write_text("frame,t_s\n0,0\n1,0.1\n")
    with pytest.raises(ValueError, match="no time for frame 2 of 5"):
        open_recording(sources, rig, timestamps=tmp_path / "t.csv")
    (sources["ccd2"] / "000002.png").unlink()
    with pytest.raises(ValueError, match=r"ccd2: 4 images, .*ccd1 has 5"):
        open_recording(sources, rig)
    write_video(folder / "ccd1.mkv", images[:, 0])
    with pytest.raises(ValueError, match=r"video of camera ccd1, got ccd1 and ccd1\.mkv"):
        find_footage(folder, rig)


@pytest.mark.parametrize(("text", "message"), cases(Path(__file__).with_name("wrong.txt"), "times"))
def test_bad_timestamps_are_named(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(unescaped(text))
    with pytest.raises(ValueError, match=message) as caught:
        read_timestamps(tmp_path / "t.csv")
    assert str(caught.value).startswith(str(tmp_path / "t.csv"))


def test_what_cannot_be_written_is_named_and_left_as_it_was(tmp_path, folder, rig):
    with pytest.raises(ValueError, match="exists already"):
        recording_writer.begin(folder, rig)
    with pytest.raises(ValueError, match=r"none: cannot be written \(No such file"):
        recording_writer.give_name(tmp_path / "none")
    (tmp_path / "f" / "a.png").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"a\.png: cannot be written"):
        recording_writer.write_image(np.zeros((3, 4), np.uint8), tmp_path / "f" / "a.png")
    assert [path.name for path in (tmp_path / "f").iterdir()] == ["a.png"]


@pytest.mark.parametrize("suffix", [".avi", ".MP4", ".mkv"])
def test_a_folder_of_videos_is_a_recording(suffix, tmp_path, rig):
    for name in (*rig.names, "notes"):
        (tmp_path / f"{name}{suffix}").touch()
    places = {name: tmp_path / f"{name}{suffix}" for name in rig.names}
    assert find_footage(tmp_path, rig) == places


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (
            "left.avi right.avi",
            "got neither images/ccd1 nor ccd1.mkv, but left.avi, right.avi: name them as the cameras, "
            "or give track, refine and preflight each by --video NAME=PATH",
        ),
        ("ccd1.avi ccd1.mp4", "camera ccd1, got ccd1.avi and ccd1.mp4"),
        ("ccd1.avi", "camera ccd2, got neither images/ccd2 nor ccd2.mkv, but ccd1.avi"),
        ("", "got neither images/ccd1 nor ccd1.mkv$"),
    ],
)
def test_videos_called_otherwise_are_named_with_the_way_out(files, said, tmp_path, rig):
    for name in files.split():
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match=said):
        find_footage(tmp_path, rig)
