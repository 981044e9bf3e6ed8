"""Files that ask for far more memory or time than they are long, and commands that are run with
little memory.

Each is made by a few lines; `BOMBS` has the command that reads it, and what it says.
"""

import os
import shlex
import subprocess
import sys
from threading import Timer
from typing import NamedTuple

import cv2
import numpy as np
from healthy import BOARDS, EVALUATE, TRACK, VIDEOS
from processes import CLI, HANGS_S

MIB = 1 << 20
LIMIT = 2048 * MIB  # of a command's address space


class Ran(NamedTuple):
    """A command's exit code, its lines on standard error, the most memory that it had, bytes, and its
    processor time, s.
    """

    code: int
    lines: list[str]
    peak: int
    seconds: float


def run_limited(line, limit=LIMIT, folder=None):
    """Run a command in a process that gets no more than `limit` bytes of address space."""
    import resource

    def before():
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, "-c", CLI, *shlex.split(line)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=before,
        cwd=folder,
        env=environment,
    ) as process:
        hangs = Timer(HANGS_S, process.kill)
        hangs.start()
        lines = process.stderr.read().decode(errors="replace").splitlines()
        _, status, usage = os.wait4(process.pid, 0)
        hangs.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = usage.ru_utime + usage.ru_stime
    return Ran(process.returncode, lines, usage.ru_maxrss * 1024, seconds)  # Linux counts in KiB


# --- the files


def pipe(path):
    """A FIFO that nobody writes into: whoever opens it waits for ever."""
    os.mkfifo(path)


def endless(path):
    """A link to a device that never ends."""
    path.symlink_to("/dev/zero")


def dotted(path):
    """200 KB of a key within a key within a key."""
    path.write_text(".".join(["a"] * 100_000) + " = 1\n")


def dotted_header(path):
    """The same as the name of a table."""
    path.write_text("[" + ".".join(["a"] * 100_000) + "]\nx = 1\n")


def dotted_inside(path):
    """The same within a table within a line, its parts in quotes."""
    path.write_text('x = { "a" . ' + ". ".join(["'a'"] * 50_000) + " = 1 }\n")


def dotted_twice(path):
    """Many keys that are each a part of the next one."""
    keys = [".".join(["a"] * 30 + [f"b{k}"]) for k in range(10_000)]
    path.write_text("".join(f"{key} = 1\n" for key in keys))


def many_cameras(path):
    """10^5 cameras in 13 MB."""
    path.write_text("".join(f"[c{k}]\n{CAMERA.format(k=k)}" for k in range(100_000)))


def some_cameras(path):
    """Nearly as many cameras as a file may have tables and lists."""
    path.write_text("".join(f"[c{k}]\nname='{k}'\n" for k in range(15_000)))


def many_markers(path):
    """A handle with 99,900 markers in 2 MB."""
    rows = [0.01 * k for k in range(2700)]
    path.write_text(
        "name = 'bomb'\nradius_mm = 1000.0\nlength_mm = 100.0\ntop_mm = 50.0\n"
        f"marker_diameter_mm = 0.001\ncolumns_deg = {[9.0 * k for k in range(37)]}\n"
        f"rows_mm = {[rows] * 37}\n"
    )


def long_word(path):
    """A handle whose markers are a word of a million letters."""
    path.write_text(
        "name = 'bomb'\nradius_mm = 5.0\nlength_mm = 100.0\ntop_mm = 50.0\n"
        f"marker_diameter_mm = 3.0\ncolumns_deg = [0.0]\nrows_mm = '{'a' * 1_000_000}'\n"
    )


def commas(path):
    """10 MB of commas as the first line of a table."""
    path.write_text("frame" + "," * 10_000_000 + "\n")


def commas_below(path):
    """A million of them in the second line."""
    path.write_text("frame,x_mm\n0" + "," * 1_000_000 + "\n")


def repeated_names(path):
    """300 KB of one name again and again."""
    path.write_text(",".join(["a"] * 150_000) + "\n" + ",".join(["1"] * 150_000) + "\n")


def empty_lines(path):
    """A hundred million lines without anything."""
    path.write_text("frame\n" + "\n" * 100_000_000)


def png_bomb(path):
    """A grey PNG of 30,000 x 30,000 pixels in 900 KB."""
    import zlib

    rows = zlib.compress(bytes(30_001) * 1000, 9)  # of another length than the whole: only begun
    head = np.array([30_000, 30_000], ">u4").tobytes() + bytes([16, 2, 0, 0, 0])
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + b"".join(map(_chunk, (b"IHDR", b"IDAT", b"IEND"), (head, rows, b"")))
    )


def whole_png_bomb(path):
    """A PNG of 16,384 x 16,384 pixels that can be decoded."""
    image = np.zeros((16_384, 16_384), np.uint16)
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def tiff_bomb(path):
    """A TIFF of 16,384 x 16,384 pixels in colour, of which each strip is a run of zeros."""
    image = np.zeros((16_384, 16_384), np.uint8)
    path.write_bytes(cv2.imencode(".tiff", image)[1].tobytes())


def _chunk(name, data):
    import zlib

    check = zlib.crc32(name + data)
    return len(data).to_bytes(4) + name + data + check.to_bytes(4)


def mcap_bomb(path, size=3 << 30, stated=None):
    """An MCAP of 100 KB whose one chunk is 3 GiB long when it is decompressed, and says so or not."""
    from backports import zstd

    packer = zstd.ZstdCompressor(level=3)
    block = bytes(16 * MIB)
    packed = b"".join(packer.compress(block) for _ in range(size // len(block))) + packer.flush()
    header = _sized(1, _text(b"ros2") + _text(b"bomb"))
    chunk = _mcap_chunk(packed, stated or size, b"zstd")
    path.write_bytes(MAGIC + header + chunk + _sized(2, bytes(20)) + MAGIC)


def lying_mcap_bomb(path):
    """The same, whose header states a thousand bytes."""
    mcap_bomb(path, stated=1000)


def mcap_of_one_time(path):
    """An MCAP with a hundred chunks of 32 MiB, all of one time: who merges them has all in memory."""
    from backports import zstd

    packed = zstd.compress(bytes(32 * MIB))
    content = MAGIC + _sized(1, _text(b"ros2") + _text(b"bomb"))
    index = b""
    for _ in range(100):
        chunk = _mcap_chunk(packed, 32 * MIB, b"zstd")
        places = (0, 10, len(content), len(chunk))
        index += _sized(
            8,
            b"".join(place.to_bytes(8, "little") for place in places)
            + bytes(4 + 8)
            + _text(b"zstd")
            + len(packed).to_bytes(8, "little")
            + (32 * MIB).to_bytes(8, "little"),
        )
        content += chunk
    start = len(content).to_bytes(8, "little")
    path.write_bytes(content + index + _sized(2, start + bytes(12)) + MAGIC)


MAGIC = b"\x89MCAP0\r\n"
CAMERA = (
    "name = 'c{k}'\nsize = [8, 6]\nmatrix = [[9, 0, 4], [0, 9, 3], [0, 0, 1]]\n"
    "rotation = [0, 0, 0]\ntranslation = [{k}, 0, 0]\n"
)


def _mcap_chunk(packed, size, how):
    times = bytes(16)
    stated = size.to_bytes(8, "little") + bytes(4)
    records = len(packed).to_bytes(8, "little") + packed
    return _sized(6, times + stated + _text(how) + records)


def _sized(kind, record):
    return bytes([kind]) + len(record).to_bytes(8, "little") + record


def _text(text):
    return len(text).to_bytes(4, "little") + text


class Bomb(NamedTuple):
    """What makes a file, its name in a healthy folder, the command that reads it, and how the one line
    begins that it says.
    """

    make: object
    name: str
    line: str
    said: str


IMAGE = "rec/images/ccd1/000001.png"
OWN_RIG = f"{TRACK} --rig rig.toml"
OWN_HANDLE = f"{TRACK} --handle handle.toml"
BAG = "track b.mcap --out poses.csv"
PIXELS = "expected at most 50 million pixels, got more"
MANY_DOTS = "a name of more than 32 dots"
PIPE, DEVICE = (
    f"cannot be read ({what}, expected a regular file)"
    for what in ("a pipe", "a device or a socket")
)
HELD = "b.mcap: 3,072.0 MiB of messages at one time when decompressed, expected at most 64"
BOMBS = {
    "a pipe for a rig": Bomb(pipe, "rig.toml", OWN_RIG, f"rig.toml: {PIPE}"),
    "a pipe for an image": Bomb(pipe, IMAGE, TRACK, f"{IMAGE}: {PIPE}"),
    "a pipe for poses": Bomb(pipe, "truth.csv", EVALUATE, f"truth.csv: {PIPE}"),
    "a pipe for a video": Bomb(pipe, "ccd1.mkv", VIDEOS, f"ccd1.mkv: {PIPE}"),
    "a pipe for a view": Bomb(pipe, "a/02.png", BOARDS, f"a/02.png: {PIPE}"),
    "/dev/zero for a handle": Bomb(endless, "handle.toml", OWN_HANDLE, f"handle.toml: {DEVICE}"),
    "/dev/zero for poses": Bomb(endless, "truth.csv", EVALUATE, f"truth.csv: {DEVICE}"),
    "/dev/zero for an image": Bomb(endless, IMAGE, TRACK, f"{IMAGE}: {DEVICE}"),
    "10^5 dots": Bomb(dotted, "rig.toml", OWN_RIG, f"rig.toml: {MANY_DOTS}"),
    "10^5 dots of a table": Bomb(dotted_header, "rig.toml", OWN_RIG, f"rig.toml: {MANY_DOTS}"),
    "dots between quotes": Bomb(dotted_inside, "rig.toml", OWN_RIG, f"rig.toml: {MANY_DOTS}"),
    "300,000 dots in all": Bomb(
        dotted_twice,
        "rig.toml",
        OWN_RIG,
        "rig.toml: expected at most 10,000 dots in its names, got 300,000",
    ),
    "10^5 cameras": Bomb(
        many_cameras, "rig.toml", OWN_RIG, "rig.toml: 12.5 MiB, expected at most 1"
    ),
    "15,000 cameras": Bomb(
        some_cameras, "rig.toml", OWN_RIG, "rig.toml: expected at most 16 cameras, got 15,000"
    ),
    "99,900 markers": Bomb(
        many_markers,
        "handle.toml",
        OWN_HANDLE,
        "handle.toml: expected at most 200 markers, got 99,900",
    ),
    "a word of 1 MB": Bomb(
        long_word,
        "handle.toml",
        OWN_HANDLE,
        "handle.toml: rows_mm: expected 1 lists, one per column",
    ),
    "10^7 commas": Bomb(
        commas,
        "truth.csv",
        EVALUATE,
        "truth.csv: expected at most 10,000,000 cells, got 10,000,001",
    ),
    "10^6 commas below": Bomb(
        commas_below,
        "truth.csv",
        EVALUATE,
        "truth.csv: expected at most 1,000 columns, got 1,000,001",
    ),
    "150,000 names alike": Bomb(
        repeated_names,
        "truth.csv",
        EVALUATE,
        "truth.csv: expected at most 1,000 columns, got 150,000",
    ),
    "10^8 empty lines": Bomb(
        empty_lines, "truth.csv", EVALUATE, "truth.csv: expected at most 1,000,000 lines, got"
    ),
    "a PNG of 900 megapixels": Bomb(png_bomb, IMAGE, TRACK, f"{IMAGE}: {PIXELS}"),
    "a view of 900 megapixels": Bomb(png_bomb, "a/02.png", BOARDS, f"a/02.png: {PIXELS}"),
    "a PNG of 268 megapixels": Bomb(whole_png_bomb, IMAGE, TRACK, f"{IMAGE}: {PIXELS}"),
    "a TIFF of 268 megapixels": Bomb(tiff_bomb, IMAGE, TRACK, f"{IMAGE}: {PIXELS}"),
    "an MCAP of 3 GiB": Bomb(mcap_bomb, "b.mcap", BAG, HELD),
    "an MCAP that lies": Bomb(
        lying_mcap_bomb, "b.mcap", BAG, "b.mcap: cannot be decompressed (more than 1,000 bytes)"
    ),
    "an MCAP of one time": Bomb(mcap_of_one_time, "b.mcap", BAG, "b.mcap: 96.0 MiB of messages"),
}
