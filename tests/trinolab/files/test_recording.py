"""Image folders: what is read, and what is refused and how."""

import logging
import os
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trinolab.datasets import load_rig
from trinolab.files.images import camera_bits, read_grey, read_greys
from trinolab.files.recording import frames_named, list_instants, read_instants

SIZE = (32, 24)


@pytest.fixture(scope="module")
def rig():
    """CCD1 and CCD2 with tiny images."""
    pair = load_rig("paper_pair")
    return replace(pair, cameras=tuple(replace(camera, size=SIZE) for camera in pair.cameras))


def read_instant(instant, rig):
    return next(read_instants([instant], rig))


@pytest.fixture
def folder(tmp_path, rig):
    """Two instants of noise, as grey PNG files."""
    rng = np.random.default_rng(0)
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for name in ("a.png", "b.png"):
            noise = rng.integers(0, 256, SIZE[::-1], dtype=np.uint8)
            cv2.imwrite(str(tmp_path / camera / name), noise)
    return tmp_path


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (
            ["c.png", "010.png", "9.png", "B.PNG", "notes.txt"],
            [(0, "010.png"), (1, "9.png"), (2, "B.PNG"), (3, "c.png")],
        ),
        (
            ["left_10.png", "left_9.png", "left_100.png"],
            [(9, "left_9.png"), (10, "left_10.png"), (100, "left_100.png")],
        ),
    ],
)
def test_instants_are_in_the_order_of_their_numbers_or_names(tmp_path, rig, names, order):
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for name in names:
            (tmp_path / camera / name).touch()
    found = list_instants(tmp_path, rig)
    assert [(one.frame, one.paths[1].name) for one in found] == order
    assert [path.parent.name for path in found[0].paths] == ["ccd1", "ccd2"]


@pytest.mark.parametrize(
    ("names", "frames"),
    [
        ("000020.png 000021.png 000024.png", [20, 21, 24]),
        ("left_10.png left_9.png", [10, 9]),
        ("take2-1.jpg take2-3.png", [1, 3]),
        ("7.png", [7]),
        ("a.png b.png", [0, 1]),
        ("1.png b.png", [0, 1]),
        ("a_1.png b_2.png", [0, 1]),  # what the number counts depends on what stands before
        ("1.jpg 1.png", [0, 1]),
        ("1699999999.25.png 1700000000.5.png", [0, 1]),  # seconds
        ("1700000000000000000.png 1700000000033333333.png", [0, 1]),  # nanoseconds
    ],
)
def test_a_frame_is_the_number_in_the_name(names, frames):
    assert frames_named(names.split()) == frames


@pytest.mark.parametrize("code", [None, cv2.COLOR_GRAY2BGR, cv2.COLOR_GRAY2BGRA])
def test_images_are_read_as_they_are_and_grey_in_colour_as_grey(folder, rig, code, caplog):
    instant = list_instants(folder, rig)[1]
    before = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in instant.paths]
    for image, path in zip(before, instant.paths, strict=True):
        cv2.imwrite(str(path), image if code is None else cv2.cvtColor(image, code))
    with caplog.at_level(logging.INFO, logger="trinolab"):
        after = read_instant(instant, rig)
    assert np.array_equal(before, after)
    assert after[0].dtype == np.uint8
    said = [f"{instant.paths[0]}: colour converted to grey; said once"]
    assert caplog.messages == said * (code is not None)


@pytest.mark.parametrize(("bits", "colour"), [(10, False), (12, True), (14, False), (16, True)])
def test_a_camera_of_fewer_bits_has_all_grey_levels(bits, colour, tmp_path, caplog):
    caplog.set_level(logging.INFO)
    full = 2**bits - 1
    rng = np.random.default_rng(bits)
    levels = rng.integers(0, full + 1, (20, 6, 8)).astype(np.uint16)
    levels[:, 0, 0] = full
    levels[3] //= 5  # a dark one is no other scale
    paths = [tmp_path / f"{k:02d}.png" for k in range(len(levels))]
    for path, one in zip(paths, levels, strict=True):
        cv2.imwrite(str(path), cv2.cvtColor(one, cv2.COLOR_GRAY2BGR) if colour else one)
    for some in (slice(None), slice(3, 4), slice(10, 12)):
        found = np.array(list(read_greys(paths[some])))
        assert np.allclose(found, levels[some] * (255 / full), atol=1e-3)  # float32
    assert caplog.messages[-1].endswith(f": {bits} bit scaled to grey levels 0 to 255; said once")
    with camera_bits(16):
        assert np.allclose(read_grey(paths[0]), levels[0] / 257, atol=1e-3)


def test_a_value_beyond_the_bits_is_refused(tmp_path):
    for k in range(50):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), np.full((6, 8), 4095 if k == 4 else 900, "u2"))
    assert read_grey(tmp_path / "00.png")[0, 0] == pytest.approx(900 / 1023 * 255)
    with pytest.raises(ValueError, match=r"04\.png: has the value 4095, beyond the 10 bit"):
        read_grey(tmp_path / "04.png")
    with camera_bits(12):
        assert read_grey(tmp_path / "04.png")[0, 0] == pytest.approx(255)
    with pytest.raises(ValueError, match="bits: expected 8 to 16, got 17"), camera_bits(17):
        pass


def test_a_conversion_is_said_once_for_all_cameras_whenever_it_begins(folder, rig, caplog):
    first, second = list_instants(folder, rig)
    for path in second.paths:
        cv2.imwrite(str(path), np.zeros((*SIZE[::-1], 3), np.uint16))
    with caplog.at_level(logging.INFO, logger="trinolab"):
        said = [len(caplog.messages) for _ in read_instants([first, second, second], rig)]
        assert said == [0, 2, 2]  # colour and 16 bit
        read_instant(second, rig)  # another reader says it again
    assert len(caplog.messages) == 4


def test_what_is_no_camera_of_the_rig_is_left_alone(folder, rig, caplog):
    """Folders without an image, files beside the cameras' folders, and other cameras, which are
    said.
    """
    (folder / "notes").mkdir()
    (folder / "notes" / "a.txt").touch()
    (folder / "overview.png").touch()
    shutil.copytree(folder / "ccd2", folder / "ccd3")
    with caplog.at_level("INFO", logger="trinolab"):
        found = list_instants(folder, rig)
    assert len(found) == 2
    assert [path.parent.name for path in found[0].paths] == ["ccd1", "ccd2"]
    assert caplog.messages == [
        f"{folder / 'ccd3'}: left out, the rig has no such camera (ccd1, ccd2)"
    ]


@pytest.mark.parametrize(
    ("gone", "named", "message"),
    [
        ("", "", "no such folder"),
        ("ccd2", "ccd2", "no such folder; each camera of the rig needs one"),
        ("ccd1/*", "ccd1", "no image in it"),
        ("ccd1/b.png", "ccd1/b.png", "missing"),
        ("ccd2/b.png", "ccd2/b.png", "missing"),
    ],
)
def test_incomplete_folder_is_named(folder, rig, gone, named, message):
    for path in sorted(folder.glob(gone)) if gone else [folder]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        list_instants(folder, rig)
    assert str(caught.value).startswith(f"{folder / named}: {message}")


def encoded(image, suffix=".png"):
    return cv2.imencode(suffix, image)[1].tobytes()


GREY = np.random.default_rng(2).integers(0, 256, SIZE[::-1], dtype=np.uint8)
NO_IMAGE, CUT_OFF = "cannot be read as an image of", "cannot be read as an image (its end"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", NO_IMAGE),
        (b"this is no image\n", NO_IMAGE),
        (encoded(GREY)[:300], CUT_OFF),
        (encoded(GREY)[:8], CUT_OFF),
        (encoded(GREY.astype(np.float32), ".tiff"), NO_IMAGE),
        (encoded(GREY.T), "24 x 32 pixels, the rig says 32 x 24"),
        (encoded(np.zeros((25, 32), np.uint8)), "32 x 25 pixels, the rig says 32 x 24"),
        ("nowhere.png", "cannot be read (No such file"),
        (".", "cannot be read (Is a directory"),
    ],
    ids=["empty", "text", "cut", "head", "float", "turned", "larger", "broken link", "folder"],
)
def test_bad_image_is_named(folder, rig, content, message, capfd):
    path = folder / "ccd2" / "a.png"
    path.unlink()
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.symlink_to(content)
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        read_instant(list_instants(folder, rig)[0], rig)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert capfd.readouterr().err == ""


def test_what_another_thread_says_meanwhile_is_not_said_of_the_image(
    tmp_path, monkeypatch, caplog, capfd
):
    """Standard error is one file for all of a process."""
    path, real = tmp_path / "a.png", cv2.imdecode
    cv2.imwrite(str(path), np.zeros((6, 8), np.uint8))
    damage = "libpng warning: IDAT: Too much image data"
    others = "Malformed HTTP message\n[ INFO:0@0.1] global registry.cpp IPP: disabled\n"

    def decode(*arguments):
        os.write(2, f"{others}{damage}\n".encode())
        return real(*arguments)

    monkeypatch.setattr(cv2, "imdecode", decode)
    with caplog.at_level("INFO"):
        read_grey(path)
    assert caplog.messages == [f"{path}: may be damaged ({damage})"]
    assert capfd.readouterr().err == others
