"""Image folders: what is read, and what is refused and how."""

import logging
import os
import shutil
import subprocess
import sys
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
    return replace(
        load_rig("paper_pair"),
        cameras=tuple(replace(camera, size=SIZE) for camera in load_rig("paper_pair").cameras),
    )


def read_instant(instant, rig):
    return next(read_instants([instant], rig))


@pytest.fixture
def folder(tmp_path, rig):
    """Two instants of noise, as grey PNG files."""
    rng = np.random.default_rng(0)
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for name in ("a.png", "b.png"):
            cv2.imwrite(
                str(tmp_path / camera / name), rng.integers(0, 256, SIZE[::-1], dtype=np.uint8)
            )
    return tmp_path


def test_instants_are_in_the_order_of_the_names(tmp_path, rig):
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for name in ("c.png", "010.png", "9.png", "B.PNG", "notes.txt"):
            (tmp_path / camera / name).touch()
    found = list_instants(tmp_path, rig)
    assert [instant.frame for instant in found] == [0, 1, 2, 3]
    assert [instant.paths[0].name for instant in found] == ["010.png", "9.png", "B.PNG", "c.png"]
    assert [path.parent.name for path in found[0].paths] == ["ccd1", "ccd2"]


@pytest.mark.parametrize(
    ("names", "frames"),
    [
        (["000020.png", "000021.png", "000024.png"], [20, 21, 24]),
        (["left_10.png", "left_9.png"], [10, 9]),
        (["take2-1.jpg", "take2-3.png"], [1, 3]),
        (["7.png"], [7]),
        (["a.png", "b.png"], [0, 1]),
        (["1.png", "b.png"], [0, 1]),
        (["a_1.png", "b_2.png"], [0, 1]),  # what the number counts depends on what stands before
        (["1.jpg", "1.png"], [0, 1]),
        (["1699999999.25.png", "1700000000.5.png"], [0, 1]),  # seconds
        (["1700000000000000000.png", "1700000000033333333.png"], [0, 1]),  # nanoseconds
    ],
)
def test_a_frame_is_the_number_in_the_name(names, frames):
    assert frames_named(names) == frames


def test_instants_are_in_the_order_of_their_frames(tmp_path, rig):
    for camera in rig.names:
        (tmp_path / camera).mkdir()
        for name in ("left_10.png", "left_9.png", "left_100.png"):
            (tmp_path / camera / name).touch()
    found = list_instants(tmp_path, rig)
    assert [(one.frame, one.paths[1].name) for one in found] == [
        (9, "left_9.png"),
        (10, "left_10.png"),
        (100, "left_100.png"),
    ]


def test_images_are_read_as_they_are(folder, rig):
    instant = list_instants(folder, rig)[1]
    for image, path in zip(read_instant(instant, rig), instant.paths, strict=True):
        assert image.dtype == np.uint8
        assert np.array_equal(image, cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


@pytest.mark.parametrize("code", [cv2.COLOR_GRAY2BGR, cv2.COLOR_GRAY2BGRA])
def test_grey_in_colour_is_the_same_grey(folder, rig, code, caplog):
    instant = list_instants(folder, rig)[0]
    before = read_instant(instant, rig)
    for image, path in zip(before, instant.paths, strict=True):
        cv2.imwrite(str(path), cv2.cvtColor(image, code))
    with caplog.at_level(logging.INFO, logger="trinolab"):
        after = read_instant(instant, rig)
    assert np.array_equal(before, after)
    assert caplog.messages == [f"{instant.paths[0]}: colour converted to grey; said once"]


def test_sixteen_bits_keep_their_fractions(folder, rig, caplog):
    instant = list_instants(folder, rig)[0]
    levels = np.random.default_rng(1).integers(0, 65536, SIZE[::-1], dtype=np.uint16)
    for path in instant.paths:
        cv2.imwrite(str(path), levels)
    with caplog.at_level(logging.INFO, logger="trinolab"):
        image = read_instant(instant, rig)[0]
    assert np.allclose(image, levels * (255 / 65535), atol=1e-4)  # grey levels; float32
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("colour", [False, True])
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
        assert np.allclose(found, levels[some] * (255 / full), atol=1e-3)
    assert caplog.messages[-1].endswith(f": {bits} bit scaled to grey levels 0 to 255; said once")
    with camera_bits(16):
        assert np.allclose(read_grey(paths[0]), levels[0] / 257, atol=1e-3)


@pytest.mark.parametrize("setting", ["OPENCV_IPP=disabled", "OPENCV_LOG_LEVEL=VERBOSE"])
def test_what_opencv_says_of_itself_is_no_damage(setting, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((6, 8), np.uint8))
    program = (
        "import logging, sys, pathlib\n"
        "logging.basicConfig(level=20, stream=sys.stdout)\n"
        "from trinolab.files.images import read_grey\n"
        "print(read_grey(pathlib.Path('a.png')).shape)\n"
    )
    name, value = setting.split("=")
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, name: value},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "(6, 8)\n"


def test_a_value_beyond_the_bits_is_refused(tmp_path):
    for k in range(50):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), np.full((6, 8), 4095 if k == 4 else 900, "u2"))
    assert read_grey(tmp_path / "00.png")[0, 0] == pytest.approx(900 / 1023 * 255)
    with pytest.raises(
        ValueError, match=r"04\.png: has the value 4095, beyond the 10 bit .* --bits"
    ):
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
        stream = read_instants([first, second, second], rig)
        next(stream)
        assert caplog.messages == []
        next(stream)
        assert len(caplog.messages) == 2  # colour and 16 bit
        next(stream)
        assert len(caplog.messages) == 2
        read_instant(second, rig)  # another reader says it again
    assert len(caplog.messages) == 4


def test_what_is_no_camera_is_left_alone(folder, rig):
    """Folders without an image, and files beside the cameras' folders."""
    (folder / "notes").mkdir()
    (folder / "notes" / "a.txt").touch()
    (folder / "overview.png").touch()
    assert len(list_instants(folder, rig)) == 2


def spoil_root(folder):
    os.rename(folder, folder.with_name("elsewhere"))
    return f"{folder}: no such folder"


def spoil_camera(folder):
    os.rename(folder / "ccd2", folder / "ccd3")
    return f"{folder / 'ccd2'}: no such folder; each camera of the rig needs one"


def spoil_all_images(folder):
    for path in (folder / "ccd1").iterdir():
        path.unlink()
    return f"{folder / 'ccd1'}: no image in it"


def spoil_one_name(folder):
    (folder / "ccd1" / "b.png").unlink()
    return f"{folder / 'ccd1' / 'b.png'}: missing"


def spoil_other_name(folder):
    (folder / "ccd2" / "b.png").rename(folder / "ccd2" / "bb.png")
    return f"{folder / 'ccd1' / 'bb.png'}: missing"


@pytest.mark.parametrize(
    "spoil",
    [
        spoil_root,
        spoil_camera,
        spoil_all_images,
        spoil_one_name,
        spoil_other_name,
    ],
)
def test_incomplete_folder_is_named(folder, rig, spoil):
    message = spoil(folder)
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        list_instants(folder, rig)
    assert str(caught.value).startswith(message)


def test_a_rig_of_some_of_the_cameras_is_taken(folder, rig, caplog):
    shutil.copytree(folder / "ccd2", folder / "ccd3")
    with caplog.at_level("INFO", logger="trinolab"):
        found = list_instants(folder, rig)
    assert [path.parent.name for path in found[0].paths] == ["ccd1", "ccd2"]
    assert caplog.messages == [
        f"{folder / 'ccd3'}: left out, the rig has no such camera (ccd1, ccd2)"
    ]


def encoded(image, suffix=".png"):
    return cv2.imencode(suffix, image)[1].tobytes()


GREY = np.random.default_rng(2).integers(0, 256, SIZE[::-1], dtype=np.uint8)
BAD_IMAGES = {
    "empty": (b"", "cannot be read as an image"),
    "text": (b"this is no image\n", "cannot be read as an image"),
    "cut_off": (encoded(GREY)[:300], "cannot be read as an image (its end is missing)"),
    "signature_alone": (encoded(GREY)[:8], "cannot be read as an image (its end is missing)"),
    "float": (
        encoded(GREY.astype(np.float32), ".tiff"),
        "cannot be read as an image of 8 or 16 bit",
    ),
    "turned": (encoded(GREY.T), "24 x 32 pixels, the rig says 32 x 24"),
    "larger": (encoded(np.zeros((25, 32), np.uint8)), "32 x 25 pixels, the rig says 32 x 24"),
}


@pytest.mark.parametrize(("content", "message"), BAD_IMAGES.values(), ids=BAD_IMAGES)
def test_bad_image_is_named(folder, rig, content, message, capfd):
    (folder / "ccd2" / "a.png").write_bytes(content)
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        read_instant(list_instants(folder, rig)[0], rig)
    assert str(caught.value).startswith(f"{folder / 'ccd2' / 'a.png'}: {message}")
    assert capfd.readouterr().err == ""


def test_folder_or_broken_link_in_place_of_an_image_is_named(folder, rig):
    path = folder / "ccd1" / "a.png"
    path.unlink()
    path.symlink_to("nowhere.png")
    with pytest.raises(ValueError, match=r"a\.png: cannot be read \(No such file"):
        read_instant(list_instants(folder, rig)[0], rig)
    path.unlink()
    path.mkdir()
    with pytest.raises(ValueError, match=r"a\.png: cannot be read \(Is a directory"):
        read_instant(list_instants(folder, rig)[0], rig)


def test_what_another_thread_says_meanwhile_is_not_said_of_the_image(
    tmp_path, monkeypatch, caplog, capfd
):
    """Standard error is one file for all of a process."""
    path, real = tmp_path / "a.png", cv2.imdecode
    cv2.imwrite(str(path), np.zeros((6, 8), np.uint8))

    def decode(*arguments):
        os.write(2, b"Malformed HTTP message\n")
        os.write(2, said)
        return real(*arguments)

    monkeypatch.setattr(cv2, "imdecode", decode)
    said = b""
    with caplog.at_level("INFO"):
        read_grey(path)
        assert caplog.messages == []
        said = b"libpng warning: IDAT: Too much image data\n"
        read_grey(path)
    assert caplog.messages == [
        f"{path}: may be damaged (libpng warning: IDAT: Too much image data)"
    ]
    assert capfd.readouterr().err.count("Malformed HTTP message\n") == 2
