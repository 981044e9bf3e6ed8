"""The catalogue of faults, as tables: what is spoiled in a healthy folder, the command line, and what the
answer names.

`FAULTS` are mistakes that are refused, `NO_MISTAKE` is what cameras see, which is answered by a status.
"""

import os
import shutil
import zlib
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from boards import SIZE
from healthy import (
    BOARDS,
    CAPTURE,
    CODED,
    EVALUATE,
    FOLLOW,
    MEASURE,
    RENDER,
    RIG,
    SWEEP,
    TRACK,
    VIDEOS,
    write_video,
)

from trinolab.camera import Rig
from trinolab.files.rigs import write_rig

# --- what can be done to a folder


def nothing():
    pass


def text(name, content):
    return lambda: Path(name).write_text(content)


def blob(name, content):
    return lambda: Path(name).write_bytes(content)


def changed(name, old, new):
    def change():
        before = Path(name).read_text()
        assert old in before
        Path(name).write_text(before.replace(old, new, 1))

    return change


def image(name, pixels):
    return lambda: cv2.imwrite(name, pixels)


def cut(name, share=0.5):
    return lambda: Path(name).write_bytes(
        Path(name).read_bytes()[: int(share * Path(name).stat().st_size)]
    )


def damaged(name):
    """Bytes in the middle of a file are zero."""

    def change():
        data = Path(name).read_bytes()
        third = len(data) // 3
        Path(name).write_bytes(data[:third] + bytes(third) + data[2 * third :])

    return change


def gone(*names):
    return lambda: [Path(name).unlink() for name in names]


def moved(name, other):
    return lambda: Path(name).rename(other)


def emptied(name):
    return lambda: shutil.rmtree(name) or Path(name).mkdir()


def loop(name):
    """A link to itself: nobody can read it, whatever they may."""
    return lambda: (Path(name).unlink(missing_ok=True), Path(name).symlink_to(Path(name).name))


def huge_png(name):
    """A PNG whose head promises ten thousand million pixels."""
    data = cv2.imencode(".png", np.zeros((2, 2), np.uint8))[1].tobytes()
    head = b"IHDR" + (100000).to_bytes(4, "big") * 2 + data[24:29]
    return blob(name, data[:12] + head + zlib.crc32(head).to_bytes(4, "big") + data[33:])


def twin(name="rig.toml"):
    """The second camera of a rig stands where the first one does."""
    return lambda: write_rig(Rig((RIG.cameras[0], replace(RIG.cameras[0], name="ccd2"))), name)


def layout(columns, rows, name="handle.toml"):
    """A handle file with other markers."""
    table = {**asdict(CODED), "columns_deg": columns, "rows_mm": rows}
    return text(name, tomli_w.dumps(table))


def renamed_camera(name):
    """The second camera has another name."""
    return changed("rig.toml", 'name = "ccd2"', f'name = "{name}"')


def spoiled(number, pixels):
    """An image of CCD2 in the recording."""
    return image(f"rec/images/ccd2/{number:06d}.png", pixels)


def deep_manifest():
    Path("out.partial").mkdir()
    Path("out.partial/made_from.json").write_text(9999 * "[")


def damaged_manifest(content):
    def make():
        Path("new").mkdir()
        Path("new/manifest.json").write_text(content)

    return make


def other_sweep():
    damaged_manifest(
        '{"what": "n.ipynb", "parameters": ["b"], "grid": "x", "runs": 3, "made_from": {}}'
    )()


def only_view(*kept):
    def remove():
        for name, numbers in zip("ab", kept, strict=True):
            for path in Path(name).iterdir():
                if int(path.stem) not in numbers:
                    path.unlink()

    return remove


TIMED = "frame,t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,status"


def rows(*lines, head="frame,x_mm,y_mm,z_mm,qw,qx,qy,qz,status"):
    return "\n".join([head, *lines]) + "\n"


CCD2_0, CCD2_1 = "rec/images/ccd2/000000.png", "rec/images/ccd2/000001.png"
GREY, WRONG_SIZE = np.full(SIZE[::-1], 90, np.uint8), np.zeros((256, 318), np.uint8)
POSE, TIMES = "0,0,570,1,0,0,0,measured", "rec/timestamps.csv"


def read(name):
    return cv2.imread(name, cv2.IMREAD_GRAYSCALE)


# name -> what is spoiled, the command, a part of its one line
FAULTS = {
    # images
    "images: no folder": (nothing, MEASURE.replace("rec/images", "no"), "no: no such folder"),
    "images: none": (emptied("rec/images/ccd1"), MEASURE, "rec/images/ccd1: no image in it"),
    "images: none, track": (emptied("rec/images/ccd1"), TRACK, "rec/images/ccd1: no image in it"),
    "images: camera missing": (
        moved("rec/images/ccd2", "rec/images/ccd9"),
        MEASURE,
        "rec/images/ccd2: no such folder",
    ),
    "images: camera missing, track": (
        moved("rec/images/ccd2", "rec/images/ccd9"),
        TRACK,
        "rec: expected one folder or video of camera ccd2, got neither",
    ),
    "images: one missing": (
        gone(CCD2_1),
        MEASURE,
        f"{CCD2_1}: missing, another camera has this image",
    ),
    "images: one missing, track": (
        gone(CCD2_1),
        TRACK,
        "rec/images/ccd2: 5 images, rec/images/ccd1 has 6",
    ),
    "images: folder and video": (
        lambda: shutil.copy("ccd1.mkv", "rec"),
        TRACK,
        "got ccd1 and ccd1.mkv",
    ),
    "image: empty": (text(CCD2_0, ""), MEASURE, f"{CCD2_0}: cannot be read as an image"),
    "image: empty, track": (text(CCD2_0, ""), TRACK, f"{CCD2_0}: cannot be read as an image"),
    "image: text": (text(CCD2_1, "hello\n"), MEASURE, f"{CCD2_1}: cannot be read as an image"),
    "image: truncated": (
        cut(CCD2_1),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image (its end is missing)",
    ),
    "image: truncated, track": (
        cut(CCD2_0),
        TRACK,
        f"{CCD2_0}: cannot be read as an image (its end is missing)",
    ),
    "image: damaged": (
        damaged(CCD2_1),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image of 8 or 16 bit",
    ),
    "image: truncated TIFF": (
        blob(CCD2_1, cv2.imencode(".tiff", GREY)[1].tobytes()[:300]),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image of 8 or 16 bit",
    ),
    "image: truncated JPEG": (
        blob(CCD2_1, cv2.imencode(".jpg", GREY[:256, :320])[1].tobytes()[:300]),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image of 8 or 16 bit",
    ),
    "image: truncated BMP": (
        blob(CCD2_1, cv2.imencode(".bmp", GREY[:256, :320])[1].tobytes()[:300]),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image of 8 or 16 bit",
    ),
    "image: huge": (
        huge_png(CCD2_1),
        MEASURE,
        f"{CCD2_1}: expected at most 50 million pixels, got more",
    ),
    "image: unreadable": (loop(CCD2_1), MEASURE, f"{CCD2_1}: cannot be read (Too many levels"),
    "image: float": (
        lambda: (
            cv2.imwrite("x.tiff", np.zeros((256, 320), np.float32))
            and Path("x.tiff").rename(CCD2_1)
        ),
        MEASURE,
        f"{CCD2_1}: cannot be read as an image of 8 or 16 bit",
    ),
    "image: size": (
        spoiled(1, WRONG_SIZE),
        MEASURE,
        f"{CCD2_1}: 318 x 256 pixels, the rig says 320 x 256",
    ),
    "image: size, track": (
        spoiled(0, WRONG_SIZE),
        TRACK,
        f"{CCD2_0}: 318 x 256 pixels, the rig says 320 x 256",
    ),
    "images: long name": (nothing, MEASURE.replace("rec/images", "a" * 300), "File name too long"),
    # videos
    "video: missing": (gone("ccd2.mkv"), VIDEOS, "ccd2.mkv: no such file or folder"),
    "video: empty": (text("ccd2.mkv", ""), VIDEOS, "ccd2.mkv: cannot be read as a video"),
    "video: text": (text("ccd2.mkv", "hello\n"), VIDEOS, "ccd2.mkv: cannot be read as a video"),
    "video: truncated head": (
        lambda: Path("ccd2.mkv").write_bytes(Path("ccd2.mkv").read_bytes()[:200]),
        VIDEOS,
        "ccd2.mkv: cannot be read as a video",
    ),
    "video: unreadable": (loop("ccd2.mkv"), VIDEOS, "ccd2.mkv: "),
    "video: no frame in one": (
        lambda: Path("ccd2.mkv").write_bytes(Path("ccd2.mkv").read_bytes()[:1000]),
        VIDEOS,
        "ccd2.mkv: ends after 0 frames, another camera goes on",
    ),
    "video: no frame in any": (
        lambda: [
            Path(f"ccd{k}.mkv").write_bytes(Path(f"ccd{k}.mkv").read_bytes()[:1000]) for k in (1, 2)
        ],
        VIDEOS,
        "ccd1.mkv: no frame in it",
    ),
    "video: size": (
        lambda: write_video("ccd2.mkv", [WRONG_SIZE] * 3),
        VIDEOS,
        "ccd2.mkv: 318 x 256 pixels, the rig",
    ),
    "video: no name": (
        nothing,
        VIDEOS.replace("ccd2=ccd2.mkv", "ccd2.mkv"),
        "--video: expected NAME=PATH, got",
    ),
    "video: camera twice": (
        nothing,
        VIDEOS.replace("ccd2=", "ccd1="),
        "--video: camera ccd1 is named twice",
    ),
    "video: twice": (
        nothing,
        VIDEOS.replace("=ccd2.mkv", "=./ccd1.mkv"),
        "ccd1.mkv is given for more than one camera",
    ),
    "video: other camera": (
        nothing,
        VIDEOS + " --video ccd9=rec/images/ccd1",
        "ccd9: a camera that the rig does not have (ccd1, ccd2)",
    ),
    "video: camera missing": (
        nothing,
        VIDEOS.replace("ccd2=ccd2.mkv", ""),
        "ccd2: no video or folder for this camera",
    ),
    # times
    "times: repeated": (
        text(TIMES, "frame,t_s\n0,0\n1,0.04\n2,0.04\n"),
        TRACK,
        f"{TIMES}: frame 2: column 't_s'",
    ),
    "times: decreasing": (
        text(TIMES, "frame,t_s\n0,0\n1,0.04\n2,0.02\n"),
        TRACK,
        f"{TIMES}: frame 2: column 't_s'",
    ),
    "times: NaN": (
        text(TIMES, "frame,t_s\n0,0\n1,nan\n"),
        TRACK,
        f"{TIMES}: frame 1: column 't_s'",
    ),
    "times: text": (
        text(TIMES, "frame,t_s\n0,0\n1,soon\n"),
        TRACK,
        f"{TIMES}: no valid CSV (could not convert string",
    ),
    "times: no column": (
        text(TIMES, "frame,t\n0,0\n"),
        TRACK,
        f"{TIMES}: no valid CSV (column ",
    ),
    "times: too few": (
        text(TIMES, "frame,t_s\n0,0\n1,0.04\n"),
        TRACK,
        f"{TIMES}: no time for frame 2 of 6",
    ),
    "times: gap": (
        text(TIMES, "frame,t_s\n0,0\n2,0.04\n"),
        TRACK,
        f"{TIMES}: column 'frame' expects 0, 1, 2",
    ),
    "times: empty": (text(TIMES, ""), TRACK, f"{TIMES}: no valid CSV"),
    "times: binary": (blob(TIMES, b"\x89PNG\xff\xfe\x00"), TRACK, f"{TIMES}: no valid CSV"),
    "times: missing": (
        nothing,
        VIDEOS + " --timestamps no.csv",
        "no.csv: cannot be read (No such file",
    ),
    "times: rate": (nothing, VIDEOS + " --fps nan", "fps: expected a number"),
    "times: no rate": (nothing, VIDEOS + " --fps 0", "fps: expected a number"),
    # the rig
    "rig: missing": (gone("rig.toml"), MEASURE, "rig.toml: cannot be read (No such file"),
    "rig: missing, track": (
        gone("rec/rig.toml"),
        TRACK,
        "rec: not a recording folder with its rig (no rig.toml in it)",
    ),
    "rig: no such name": (
        nothing,
        MEASURE.replace("rig.toml", "raised"),
        "raised: no such file, and no shipped rig (paper_pair, paper_trinocular, raised_40deg)",
    ),
    "handle: no such name": (
        nothing,
        EVALUATE.replace("handle.toml", "coder"),
        "coder: no such file, and no shipped handle (coded, paper)",
    ),
    "rig: a folder": (
        nothing,
        MEASURE.replace("rig.toml", "rec"),
        "rec: cannot be read (Is a directory",
    ),
    "rig: unreadable": (loop("rig.toml"), MEASURE, "rig.toml: cannot be read (Too many levels"),
    "rig: text": (text("rig.toml", "[ccd1\n"), MEASURE, "rig.toml: no valid TOML"),
    "rig: binary": (blob("rig.toml", b"\xff\xfe\x00\x01"), MEASURE, "rig.toml: no valid TOML"),
    "rig: deep": (text("rig.toml", "a = " + 9999 * "["), MEASURE, "rig.toml: no valid TOML"),
    "rig: empty": (text("rig.toml", ""), MEASURE, "rig.toml: cameras: expected two or more, got 0"),
    "rig: truncated": (cut("rig.toml", 0.3), MEASURE, "rig.toml: "),
    "rig: a handle": (nothing, MEASURE.replace("rig.toml", "handle.toml"), "handle.toml: "),
    "rig: field missing": (
        changed("rig.toml", "matrix", "matrox"),
        MEASURE,
        "rig.toml: [ccd1]: 'matrix' is missing",
    ),
    "rig: NaN": (
        changed("rig.toml", "739.051675", "nan"),
        MEASURE,
        "rig.toml: [ccd1]: matrix: expected finite",
    ),
    "rig: text in the matrix": (
        changed("rig.toml", "739.051675", '"739.051675"'),
        MEASURE,
        "rig.toml: [ccd1]: matrix: expected numbers",
    ),
    "rig: zero focal length": (
        changed("rig.toml", "739.051675", "0.0"),
        MEASURE,
        "rig.toml: [ccd1]: matrix: fx: expected a number in [1e-06",
    ),
    "rig: negative focal length": (
        changed("rig.toml", "739.051675", "-739.0"),
        RENDER,
        "rig.toml: [ccd1]: matrix: fx",
    ),
    "rig: half a size": (
        changed("rig.toml", "256,\n", "256.5,\n"),
        MEASURE,
        "rig.toml: [ccd1]: size: expected width",
    ),
    "rig: no size": (
        changed("rig.toml", "256,\n", "0,\n"),
        RENDER,
        "rig.toml: [ccd1]: size: expected width",
    ),
    "rig: endless size": (
        changed("rig.toml", "256,\n", "1e30,\n"),
        RENDER,
        "rig.toml: [ccd1]: size: expected width",
    ),
    "rig: a matrix as rotation": (
        changed(
            "rig.toml", "rotation = [", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nold = ["
        ),
        MEASURE,
        "rig.toml: [ccd1]: rotation: expected shape (3,)",
    ),
    "rig: no rotation": (
        changed("rig.toml", "rotation = [", "rotation = [1.0, "),
        MEASURE,
        "[ccd1]: rotation: expected",
    ),
    "rig: NaN in the rotation": (
        changed("rig.toml", "rotation = [\n    0.0", "rotation = [\n    nan"),
        MEASURE,
        "rig.toml: [ccd1]: rotation: expected finite numbers",
    ),
    "rig: rotation overflows": (
        changed("rig.toml", "rotation = [\n    0.0", "rotation = [\n    1e300"),
        MEASURE,
        "rig.toml: [ccd1]: rotation: expected finite numbers of at most 1e+36, got 1",
    ),
    "rig: endless rotation": (
        changed("rig.toml", "rotation = [\n    0.0", "rotation = [\n    1e30"),
        MEASURE,
        "rig.toml: [ccd1]: rotation: the largest: expected",
    ),
    "rig: duplicate name": (
        renamed_camera("ccd1"),
        MEASURE,
        "rig.toml: cameras: expected different names, got",
    ),
    "rig: duplicate table": (
        lambda: text("rig.toml", 2 * Path("rig.toml").read_text())(),
        MEASURE,
        "rig.toml: no valid TOML",
    ),
    "rig: duplicate place": (
        twin(),
        MEASURE,
        "rig.toml: rotation, translation: expected cameras in different places",
    ),
    "rig: duplicate place, track": (
        twin("rec/rig.toml"),
        TRACK,
        "rec/rig.toml: rotation, translation: expected",
    ),
    "rig: other names": (
        renamed_camera("left"),
        MEASURE,
        "rec/images/left: no such folder; each camera of the rig",
    ),
    "rig: other names, track": (
        renamed_camera("left"),
        VIDEOS,
        "left: no video or folder for this camera of the rig",
    ),
    "rig: other names, capture": (
        renamed_camera("left"),
        CAPTURE,
        "left: this camera of the rig is not named",
    ),
    "rig: a name of two lines": (
        renamed_camera("a\\nb"),
        MEASURE,
        "rig.toml: [ccd2]: name: expected",
    ),
    "rig: a name that is a path": (
        renamed_camera("../x"),
        RENDER,
        "camera: expected a name that a folder can have",
    ),
    # the handle
    "handle: missing": (gone("handle.toml"), MEASURE, "handle.toml: cannot be read (No such file"),
    "handle: missing, track": (
        gone("rec/handle.toml"),
        TRACK,
        "rec/handle.toml: cannot be read (No such file",
    ),
    "handle: text": (
        text("handle.toml", "radius_mm = five\n"),
        MEASURE,
        "handle.toml: no valid TOML",
    ),
    "handle: word": (
        changed("handle.toml", "radius_mm = 5.0", 'radius_mm = "5.0"'),
        EVALUATE,
        "handle.toml: radius_mm: expected a number",
    ),
    "handle: unknown field": (
        changed("handle.toml", "radius_mm", "radius"),
        MEASURE,
        "handle.toml: 'radius' is not a field",
    ),
    "handle: NaN": (
        changed("handle.toml", "radius_mm = 5.0", "radius_mm = nan"),
        EVALUATE,
        "handle.toml: radius_mm",
    ),
    "handle: negative": (
        changed("handle.toml", "length_mm = 200.0", "length_mm = -200.0"),
        RENDER,
        "handle.toml: length_mm: expected",
    ),
    "handle: colour": (
        changed("handle.toml", '"bright"', '"pink"'),
        MEASURE,
        "handle.toml: markers: expected",
    ),
    "handle: no column": (layout([], []), MEASURE, "handle.toml: columns_deg: expected a list"),
    "handle: collinear": (
        layout([0.0], [[10.0, 0.0, -10.0]]),
        MEASURE,
        "handle.toml: columns_deg, rows_mm: expected markers that fix a pose",
    ),
    "handle: collinear, track": (
        layout([0.0, 90.0], [[10.0], [0.0]], "rec/handle.toml"),
        TRACK,
        "rec/handle.toml: columns_deg, rows_mm: expected markers that fix a pose",
    ),
    "handle: coincident": (
        layout([0.0, 360.0], [[10.0, 0.0], [10.0, 0.0]]),
        MEASURE,
        "handle.toml: columns_deg, rows_mm: markers 0 and 2 overlap, 0 mm apart",
    ),
    "handle: beside the body": (
        layout([0.0, 90.0], [[10.0], [99.0]]),
        RENDER,
        "handle.toml: rows_mm: a marker leaves the body",
    ),
    # poses that are known, and poses to follow
    "prior: missing": (nothing, MEASURE + " --prior no.csv", "no.csv: cannot be read"),
    "prior: text": (
        text("bad.csv", "hello\n"),
        MEASURE + " --prior bad.csv",
        "bad.csv: column 'frame' is missing",
    ),
    "prior: elsewhere": (
        text("bad.csv", rows(f"77,{POSE}")),
        MEASURE + " --prior bad.csv",
        "bad.csv: no frame in common",
    ),
    "start: missing": (nothing, TRACK + " --start no.csv", "no.csv: cannot be read"),
    "start: empty": (
        text("bad.csv", ""),
        TRACK + " --start bad.csv",
        "bad.csv: no valid CSV (it is empty)",
    ),
    "start: no pose": (
        text("bad.csv", rows("0,,,,,,,,lost")),
        TRACK + " --start bad.csv",
        "bad.csv: no row holds a pose",
    ),
    "start: elsewhere": (
        text("bad.csv", rows(f"77,{POSE}")),
        TRACK + " --start bad.csv",
        "bad.csv: no frame in common",
    ),
    "path: gap": (
        text("path.csv", rows(f"0,{POSE}", f"2,{POSE}")),
        FOLLOW,
        "path.csv: frame 1 is missing",
    ),
    "path: late": (
        text("path.csv", rows(f"1,{POSE}", f"2,{POSE}")),
        FOLLOW,
        "path.csv: frame 0 is missing",
    ),
    "path: all lost": (text("path.csv", rows("0,,,,,,,,lost")), FOLLOW, "path.csv: no pose in it"),
    "path: no row": (text("path.csv", rows()), FOLLOW, "path.csv: no pose in it"),
    "path: bad pose": (
        text("path.csv", rows("0,0,0,570,2,0,0,0,measured")),
        FOLLOW,
        "path.csv: frame 0: no pose",
    ),
    "path: repeated times": (
        text(
            "path.csv",
            rows(f"0,0.1,{POSE}", f"1,0.1,{POSE}", head=TIMED),
        ),
        FOLLOW,
        "path.csv: column 't_s' expects increasing seconds",
    ),
    "path: decreasing times": (
        text(
            "path.csv",
            rows(f"0,0.1,{POSE}", f"1,0.0,{POSE}", head=TIMED),
        ),
        FOLLOW,
        "path.csv: column 't_s' expects increasing seconds",
    ),
    # poses and their truth
    "poses: missing": (gone("found.csv"), EVALUATE, "found.csv: cannot be read"),
    "truth: missing": (gone("truth.csv"), EVALUATE, "truth.csv: cannot be read"),
    "poses: empty": (text("found.csv", ""), EVALUATE, "found.csv: no valid CSV"),
    "poses: no row": (
        text("found.csv", rows()),
        EVALUATE,
        "found.csv, truth.csv: no frame in common",
    ),
    "poses: binary": (
        blob("found.csv", b"\x89PNG\r\n\x1a\n\xff"),
        EVALUATE,
        "found.csv: no valid CSV",
    ),
    "poses: an archive": (
        text("found.csv.zip", "PK"),
        EVALUATE.replace("found.csv", "found.csv.zip"),
        "found.csv.zip: column 'frame' is missing",
    ),
    "poses: an address": (
        nothing,
        EVALUATE.replace("found.csv", "http://127.0.0.1:9/p.csv"),
        "p.csv: cannot be read",
    ),
    "poses: frame twice": (
        changed("found.csv", "\n1,", "\n0,"),
        EVALUATE,
        "found.csv: column 'frame' has a number twice",
    ),
    "truth: negative": (
        changed("truth.csv", "\n1,", "\n-1,"),
        EVALUATE,
        "truth.csv: column 'frame' expects whole",
    ),
    "poses: half a frame": (
        changed("found.csv", "\n1,", "\n1.5,"),
        EVALUATE,
        "found.csv: column 'frame' expects whole",
    ),
    "poses: quaternion": (
        text("found.csv", rows("1,0,0,0,2,0,0,0,lost", "2,0,0,0,2,0,0,0,measured")),
        EVALUATE,
        "found.csv: frame 2: no pose",
    ),
    "poses: overflow": (
        text("found.csv", rows("1,1e300,0,0,1,0,0,0,measured")),
        EVALUATE,
        "found.csv: frame 1: no pose",
    ),
    "poses: status": (
        changed("found.csv", "measured", "guessed"),
        EVALUATE,
        "found.csv: status 'guessed' is none of",
    ),
    "poses: status of two lines": (
        text("found.csv", rows('0,0,0,0,1,0,0,0,"a\nb"')),
        EVALUATE,
        r"found.csv: status 'a\nb' is none of",
    ),
    "truth: word": (
        changed("truth.csv", "\n1,,", "\n1,,x"),
        EVALUATE,
        "truth.csv: column 'x_mm' holds something",
    ),
    "poses: nothing in common": (
        text("found.csv", rows(f"9,{POSE}")),
        EVALUATE,
        "found.csv, truth.csv: no frame in common",
    ),
    "poses: other times": (
        lambda: [
            text(
                f"{name}.csv",
                rows(f"0,{t},{POSE}", f"1,{t + 0.04},{POSE}", head=TIMED),
            )()
            for name, t in (("found", 0.0), ("truth", 0.8))
        ],
        EVALUATE,
        "found.csv, truth.csv: frame 0 is at 0 s in the one and at 0.8 s in the other",
    ),
    # where to write
    "out: no folder": (
        nothing,
        TRACK.replace("poses.csv", "no/p.csv"),
        "no/p.csv: no such folder to write into",
    ),
    "out: no folder, measure": (
        nothing,
        MEASURE.replace("poses.csv", "no/p.csv"),
        "no/p.csv: no such folder",
    ),
    "out: under a file": (
        nothing,
        TRACK.replace("poses.csv", "rig.toml/p.csv"),
        "rig.toml/p.csv: no such folder",
    ),
    "out: a folder": (
        nothing,
        MEASURE.replace("poses.csv", "rec"),
        "rec: cannot be written (a folder",
    ),
    "out: a device": (
        nothing,
        TRACK.replace("poses.csv", os.devnull),
        f"{os.devnull}: cannot be written (a folder or a",
    ),
    "out: a loop": (loop("poses.csv"), MEASURE, "poses.csv: a link that leads to itself"),
    "out: a loop, render": (loop("out"), RENDER, "out: a link that leads to itself"),
    "out: TUM is a folder": (
        lambda: Path("poses.tum").mkdir(),
        TRACK,
        "poses.tum: cannot be written (a folder",
    ),
    "out: named like TUM": (
        nothing,
        TRACK.replace("poses.csv", "p.tum"),
        "p.tum: expected a file of its own",
    ),
    "out: over the handle": (
        nothing,
        VIDEOS.replace("poses.csv", "handle.toml"),
        "handle.toml: expected a file of its",
    ),
    "out: over the times": (
        nothing,
        TRACK.replace("poses.csv", TIMES),
        f"{TIMES}: expected a file of its own",
    ),
    "out: over the prior": (
        nothing,
        MEASURE.replace("poses", "found") + " --prior found.csv",
        "found.csv: expected a file of its own",
    ),
    "out: no permission": (
        lambda: Path("locked").mkdir(mode=0o500),
        TRACK.replace("poses.csv", "locked/p.csv"),
        "locked/p.csv: cannot be written (no permission in its folder)",
    ),
    "overlay: no folder": (
        nothing,
        TRACK + " --overlay no/o.webm",
        "no/o.webm: no such folder to write into",
    ),
    "overlay: other name": (
        nothing,
        TRACK + " --overlay o.mp4",
        "o.mp4: expected a name that ends in .webm",
    ),
    "out: there, render": (
        lambda: Path("out/images").mkdir(parents=True),
        RENDER,
        "out: exists already",
    ),
    "out: a file, render": (text("out", ""), RENDER, "out: exists already"),
    "out: no folder, render": (
        nothing,
        RENDER.replace("--out out", "--out no/out"),
        "no such folder to write into",
    ),
    "out: foreign, render": (
        lambda: Path("out.partial/images").mkdir(parents=True),
        RENDER,
        "out.partial: an unfinished recording with another",
    ),
    "out: deep manifest, render": (
        deep_manifest,
        RENDER,
        "out.partial: an unfinished recording with another",
    ),
    "out: there, capture": (
        lambda: Path("new/images").mkdir(parents=True),
        CAPTURE,
        "new: exists already",
    ),
    "out: unfinished, capture": (
        lambda: Path("new.partial").mkdir(),
        CAPTURE,
        "new.partial: an unfinished recording",
    ),
    "out: no folder, capture": (
        nothing,
        CAPTURE.replace("--out new", "--out no/new"),
        "no such folder to write into",
    ),
    "out: no folder, scoreboard": (
        nothing,
        "scoreboard --csv no/b.csv",
        "no/b.csv: no such folder to write into",
    ),
    # render's and capture's other arguments
    "motion: no file": (
        nothing,
        RENDER.replace("hard", "no.csv"),
        "motion: no.csv: no such file",
    ),
    "motion: unknown": (
        nothing,
        RENDER.replace("hard", "wild"),
        "motion: expected calm, hard, slow or a CSV of poses, got",
    ),
    "seed: negative": (nothing, RENDER.replace("--seed 3", "--seed -1"), "seed: expected"),
    "seed: text": (
        nothing,
        RENDER.replace("--seed 3", "--seed x"),
        "argument --seed: invalid int value: 'x'",
    ),
    "seconds: none": (nothing, RENDER.replace("0.1", "0"), "seconds: expected"),
    "seconds: too few": (
        nothing,
        RENDER.replace("0.1", "0.001"),
        "seconds: expected one frame or more at 30 frames",
    ),
    "seconds: endless": (nothing, RENDER.replace("0.1", "inf"), "seconds: expected"),
    "seconds: none, path": (nothing, FOLLOW + " --seconds 0", "seconds: expected"),
    "fps: none, render": (nothing, RENDER + " --fps 0", "fps: expected"),
    "fps: NaN, render": (nothing, RENDER + " --fps nan", "fps: expected"),
    "camera: no such index": (
        nothing,
        "capture --camera ccd1=9999 --out new",
        "ccd1: camera 9999 cannot be opened",
    ),
    "camera: no equals": (
        nothing,
        CAPTURE.replace("ccd1=", ""),
        "--camera: expected NAME=INDEX, as ccd1=0, or NAME=VIDEO, got 'ccd1.mkv'",
    ),
    "camera: no name": (
        nothing,
        CAPTURE.replace("ccd1=", "="),
        "--camera: expected NAME=INDEX, as ccd1=0, or NAME=VIDEO, got '=ccd1.mkv'",
    ),
    "camera: no path": (
        nothing,
        CAPTURE.replace("=ccd1.mkv", "="),
        "--camera: expected NAME=INDEX, as ccd1=0, or NAME=VIDEO, got 'ccd1='",
    ),
    "camera: named twice": (
        nothing,
        CAPTURE.replace("ccd2=", "ccd1="),
        "--camera: camera ccd1 is named twice",
    ),
    "camera: a folder": (
        nothing,
        CAPTURE.replace("ccd1.mkv", "rec"),
        "ccd1: rec: expected a camera's index or a video, got a folder",
    ),
    "camera: a text": (text("ccd2.mkv", "hello"), CAPTURE, "ccd2.mkv: cannot be read as a video"),
    "camera: no file": (gone("ccd2.mkv"), CAPTURE, "ccd2: ccd2.mkv: no such camera or video"),
    "camera: size": (
        lambda: write_video("ccd2.mkv", [WRONG_SIZE] * 3),
        CAPTURE,
        "ccd2: 318 x 256 pixels after 0 instants",
    ),
    # sweeps
    "sweep: no notebook": (gone("n.ipynb"), SWEEP, "n.ipynb: no such notebook"),
    "sweep: no chapter": (
        nothing,
        SWEEP.replace("n.ipynb", "99_end"),
        "99_end: no such notebook; the chapters are 01_structure, 02_workspace",
    ),
    "sweep: no JSON": (text("n.ipynb", "{"), SWEEP, "n.ipynb: expected a notebook, got"),
    "sweep: another file": (
        nothing,
        SWEEP.replace("n.ipynb", "rig.toml"),
        "rig.toml: expected a notebook, got",
    ),
    "sweep: no parameters": (
        changed("n.ipynb", '"parameters"', '"other"'),
        SWEEP,
        "n.ipynb: expected one code cell tagged 'parameters', got 0",
    ),
    "sweep: parameters that are computed": (
        changed("n.ipynb", "a = 0", "a = f(0)"),
        SWEEP,
        "n.ipynb: the cell tagged 'parameters' may only hold name = literal",
    ),
    "sweep: kernel": (
        changed("n.ipynb", '"name": "python3"', '"name": "klingon"'),
        SWEEP,
        "n.ipynb: its kernel klingon is not installed",
    ),
    "sweep: unknown parameter": (
        nothing,
        SWEEP + " -p c=1",
        "n.ipynb: unknown parameter c; it has a, b, name",
    ),
    "sweep: another type": (
        nothing,
        SWEEP + " -p b=small",
        "n.ipynb: b: expected float as in 0.5, got 'small'; it has a, b, name",
    ),
    "sweep: half a number": (
        nothing,
        SWEEP.replace("0,1", "0:1:3"),
        "n.ipynb: a: expected int as in 0, got 0.0",
    ),
    "sweep: twice": (nothing, SWEEP + " -p a=3", "a: given more than once"),
    "sweep: no equals": (nothing, SWEEP + " -p b", "-p b: expected NAME=VALUES or @file.csv"),
    "sweep: empty": (
        nothing,
        SWEEP + " -p b=",
        "-p b=: expected a:b:n, log:a:b:n, a list like 0,1,2, or @file.csv",
    ),
    "sweep: empty range": (
        nothing,
        SWEEP + " -p b=0:1:0",
        "-p b=0:1:0: expected 2 to 1,000,000 points, got 0",
    ),
    "sweep: no count": (nothing, SWEEP + " -p b=0:1:", "-p b=0:1:: '' is no value"),
    "sweep: interval": (
        nothing,
        SWEEP + " -p b=0:1",
        "b: an interval needs a number of points (a:b:n), or a sample",
    ),
    "sweep: log of 0": (
        nothing,
        SWEEP + " -p b=log:0:1:3",
        "-p b=log:0:1:3: log needs numbers above 0",
    ),
    "sweep: code": (nothing, SWEEP + " -p b=1+1", "-p b=1+1: '1+1' is no value"),
    "sweep: no number": (nothing, SWEEP + " -p b=nan", "-p b=nan: expected a:b:n"),
    "sweep: a million runs": (
        nothing,
        SWEEP.replace("0,1", "1:1000:1000") + " -p b=0:1:1000",
        "the grid has 1,000,000 runs; more than 100,000 must be confirmed (--yes",
    ),
    "sweep: no sample": (nothing, SWEEP + " --sample 0", "sample: expected at least 1 run, got 0"),
    "sweep: seed": (nothing, SWEEP + " --sample 2 --sample-seed -1", "sample_seed: expected"),
    "sweep: no file": (nothing, SWEEP + " -p @no.csv", "no.csv: cannot be read (No such file"),
    "sweep: empty file": (
        text("b.csv", "b\n"),
        SWEEP + " -p @b.csv",
        "b.csv: expected a row per run, got none",
    ),
    "sweep: empty cell": (
        text("b.csv", "b,name\n1,\n"),
        SWEEP + " -p @b.csv",
        "b.csv: row 1, name: '' is no value",
    ),
    "sweep: no worker": (
        nothing,
        SWEEP.replace("--workers 1", "--workers 0"),
        "--workers: expected",
    ),
    "sweep: no cluster": (
        nothing,
        SWEEP.replace("--workers 1", "--scheduler tcp://127.0.0.1:9"),
        "tcp://127.0.0.1:9: no Dask scheduler answers",
    ),
    "sweep: no address": (
        nothing,
        SWEEP.replace("--workers 1", "--scheduler a://b"),
        "a://b: no Dask scheduler answers",
    ),
    "sweep: cluster and workers": (
        nothing,
        SWEEP + " --scheduler tcp://127.0.0.1:9",
        "argument --scheduler: not allowed with argument --workers",
    ),
    "sweep: no time": (nothing, SWEEP + " --timeout 0", "--timeout: expected"),
    "sweep: out is a file": (
        text("new", ""),
        SWEEP,
        "new: expected a folder for the sweep, got a file",
    ),
    "sweep: out is something else": (
        nothing,
        SWEEP.replace("new", "rec"),
        "rec: holds something that is no sweep",
    ),
    "sweep: out under a file": (
        nothing,
        SWEEP.replace("new", "rig.toml/s"),
        "rig.toml/s: cannot be written",
    ),
    "sweep: out is another sweep": (
        other_sweep,
        SWEEP,
        "new: holds another sweep (n.ipynb over b; 3 runs); name another folder",
    ),
    "sweep: damaged manifest": (
        damaged_manifest("[1"),
        SWEEP,
        "new/manifest.json: expected the manifest of a sweep",
    ),
    "sweep: deep manifest": (
        damaged_manifest(9999 * "["),
        SWEEP,
        "new/manifest.json: expected the manifest of",
    ),
    # views of a board
    "board: no equals": (
        nothing,
        BOARDS.replace("b=b", "b"),
        "--images: expected NAME=PATH, got 'b'",
    ),
    "board: camera twice": (
        nothing,
        BOARDS.replace("b=b", "a=b"),
        "--images: camera a is named twice",
    ),
    "board: folder twice": (
        nothing,
        BOARDS.replace("b=b", "b=a"),
        "--images: a is given for more than one camera",
    ),
    "board: one camera": (
        nothing,
        BOARDS.replace("b=b", ""),
        "images: expected two or more cameras, got a",
    ),
    "board: no folder": (nothing, BOARDS.replace("b=b", "b=c"), "c: no such file or folder"),
    "board: no image": (emptied("b"), BOARDS, "b: no image in it"),
    "board: no match": (
        nothing,
        BOARDS.replace("b=b", "b=b/x*.png"),
        "b/x*.png: no image of that name",
    ),
    "board: no pattern folder": (
        nothing,
        BOARDS.replace("b=b", "b=c/x*.png"),
        "c/x*.png: no such folder c",
    ),
    "board: no video": (
        text("b.mkv", "hello"),
        BOARDS.replace("b=b", "b=b.mkv"),
        "b.mkv: cannot be read as a video",
    ),
    "board: images and video": (
        nothing,
        BOARDS.replace("b=b", "b=ccd1.mkv"),
        "images: expected images or videos of all",
    ),
    "board: other names": (
        lambda: [
            path.rename(f"b/{'x' * (1 + int(path.stem))}.png") for path in list(Path("b").iterdir())
        ],
        BOARDS,
        "b: no view in common with a, whose views are called 00.png, 01.png",
    ),
    "board: no common view": (only_view((0, 1, 2), (3, 4)), BOARDS, "b: no view in common with a"),
    "board: two views": (
        only_view((0, 1, 2, 3), (2, 3)),
        BOARDS,
        "b: camera b: target (chessboard, 7 x 6 inner "
        "corners) found in 2 of 2 images, expected three or more",
    ),
    "board: metadata": (
        nothing,
        BOARDS.replace("b=b", "metadata=b"),
        "images: a camera cannot be called metadata",
    ),
    "board: text image": (
        text("a/00.png", "hello"),
        BOARDS,
        "a/00.png: cannot be read as an image",
    ),
    "board: empty image": (text("a/00.png", ""), BOARDS, "a/00.png: cannot be read as an image"),
    "board: truncated image": (
        cut("a/00.png"),
        BOARDS,
        "a/00.png: cannot be read as an image (its end is missing)",
    ),
    "board: sizes": (
        image("a/01.png", GREY[:300]),
        BOARDS,
        "a/01.png: 480 x 300 pixels, the camera's other images",
    ),
    "board: black": (
        lambda: [cv2.imwrite(f"a/{k:02d}.png", 0 * GREY) for k in range(5)],
        BOARDS,
        "a: camera a: target (chessboard, 7 x 6 inner corners) found in 0 of 5 images, expected three",
    ),
    "board: white": (
        lambda: [cv2.imwrite(f"b/{k:02d}.png", 0 * GREY + 255) for k in range(5)],
        BOARDS,
        "b: camera b: target (chessboard, 7 x 6 inner corners) found in 0 of 5 images, expected three",
    ),
    "board: a pixel": (
        lambda: [cv2.imwrite(f"a/{k:02d}.png", GREY[:1, :1]) for k in range(5)],
        BOARDS,
        "a: camera a: target (chessboard, 7 x 6 inner corners) found in 0 of 5 images, expected three",
    ),
    "board: frozen": (
        lambda: [shutil.copy("a/00.png", f"a/{k:02d}.png") for k in range(1, 5)],
        BOARDS,
        "a: camera a: the target is in the same place in all 5 views: expected it moved and turned",
    ),
    "board: never found": (
        nothing,
        BOARDS.replace("--columns 7", "--columns 8"),
        "a: camera a: target (chessboard, 8 x",
    ),
    "board: columns": (
        nothing,
        BOARDS.replace("--columns 7", "--columns 2"),
        "columns: expected a number in [3, 200]",
    ),
    "board: too many": (
        nothing,
        BOARDS.replace("--columns 7", "--columns 99999"),
        "columns: expected a number in [3, 200]",
    ),
    "board: rows": (
        nothing,
        BOARDS.replace("--rows 6", "--rows 6.5"),
        "argument --rows: invalid int value: '6.5'",
    ),
    "board: square": (
        nothing,
        BOARDS.replace("--square 15", "--square 0"),
        "square_mm: expected a number in (0",
    ),
    "board: square NaN": (
        nothing,
        BOARDS.replace("--square 15", "--square nan"),
        "square_mm: expected a number in (0",
    ),
    "board: kind": (
        nothing,
        BOARDS.replace("chessboard", "stars"),
        "argument --board: invalid choice: 'stars'",
    ),
    "board: marker": (
        nothing,
        BOARDS + " --marker 9",
        "marker_mm: a chessboard target has no markers",
    ),
    "board: views": (
        nothing,
        BOARDS + " --views 2",
        "views: expected a number of 3 or more, got 2",
    ),
    "board: distortions": (
        nothing,
        BOARDS + " --distortions 3",
        "argument --distortions: invalid choice: 3",
    ),
    "board: out folder": (
        nothing,
        BOARDS.replace("new.toml", "no/new.toml"),
        "no/new.toml: no such folder to write into",
    ),
    "board: out is a folder": (
        lambda: Path("new.toml").mkdir(),
        BOARDS,
        "new.toml: cannot be written (a folder",
    ),
    "board: picture is a folder": (
        lambda: Path("new_residuals.png").mkdir(),
        BOARDS,
        "new_residuals.png: cannot be written",
    ),
    "board: out name": (
        nothing,
        BOARDS.replace("new.toml", "rig"),
        "rig: expected a name that ends in .toml",
    ),
    # the command line itself
    "no command": (nothing, "", "the following arguments are required: COMMAND"),
    "unknown command": (nothing, "meassure", "invalid choice: 'meassure'"),
    "unknown option": (nothing, EVALUATE + " --fast", "unrecognized arguments: --fast"),
    "missing option": (
        nothing,
        "measure --rig rig.toml",
        "arguments are required: --out",
    ),
    "missing options": (
        nothing,
        "measure --rig rig.toml --out poses.csv",
        "expected a recording folder, or else all of --rig, --handle and --images",
    ),
    "method": (
        nothing,
        MEASURE + " --method magic",
        "--method: expected one of paper, reprojection",
    ),
    "folder and video": (
        nothing,
        TRACK + " --video ccd1=ccd1.mkv ccd2=ccd2.mkv",
        "--video: not beside a recording folder (rec), which has its own",
    ),
    "folder: empty": (
        lambda: Path("none").mkdir(),
        TRACK.replace("rec", "none"),
        "none: not a recording folder with its rig (no rig.toml in it)",
    ),
    "folder: a file": (
        nothing,
        TRACK.replace("rec", "truth.csv"),
        "truth.csv: expected a recording folder, got a file",
    ),
    "no video": (
        nothing,
        "track --rig rig.toml --out p.csv",
        "expected a recording folder, or else all of --rig",
    ),
    "no recording": (nothing, TRACK.replace("rec", "no"), "no: no such folder"),
    # what shows when instants have been tracked
    "times of a video too few": (
        text("t.csv", "frame,t_s\n0,0\n1,0.04\n"),
        VIDEOS + " --timestamps t.csv",
        "t.csv: no time for frame 2, they end with frame 1",
    ),
    "image truncated": (
        cut(CCD2_1),
        TRACK,
        f"{CCD2_1}: cannot be read as an image (its end is missing)",
    ),
    "image empty": (text(CCD2_1, ""), TRACK, f"{CCD2_1}: cannot be read as an image"),
    "image damaged": (damaged(CCD2_1), TRACK, f"{CCD2_1}: cannot be read as an image"),
    "image size": (
        spoiled(1, WRONG_SIZE),
        TRACK,
        f"{CCD2_1}: 318 x 256 pixels, the rig says 320 x 256",
    ),
}


def each(change, cameras=(1, 2)):
    """Every image of some cameras, changed."""

    def spoil():
        for path in [
            path for k in cameras for path in sorted(Path(f"rec/images/ccd{k}").iterdir())
        ]:
            cv2.imwrite(str(path), change(read(str(path))))

    return spoil


def frozen():
    for path in Path("rec/images/ccd2").iterdir():
        if path.name != "000000.png":
            shutil.copy(CCD2_0, path)


# name -> what the cameras see, the statuses of the poses; None for any
NO_MISTAKE = {
    "all black": (each(lambda image: 0 * image), {"lost"}),
    "all white": (each(lambda image: 0 * image + 255), {"lost"}),
    "one black": (each(lambda image: 0 * image, (2,)), None),
    "one white": (each(lambda image: 0 * image + 255, (1,)), None),
    "one frozen": (frozen, None),
    "colour": (each(lambda image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)), {"measured"}),
    "colour with alpha": (
        each(lambda image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGRA), (2,)),
        {"measured"},
    ),
    "16 bit": (each(lambda image: image.astype(np.uint16) * 257), {"measured"}),
    "16 bit colour": (
        each(lambda image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).astype(np.uint16) * 257, (1,)),
        {"measured"},
    ),
}
