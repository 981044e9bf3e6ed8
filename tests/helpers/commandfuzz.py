"""Whole commands on files of which one is wrong, each in a process with 2 GB of memory."""

import io
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from threading import Timer
from typing import NamedTuple

from healthy import BOARDS, CAPTURE, EVALUATE, FOLLOW, MEASURE, TRACK, VIDEOS, run
from processes import CLI, HANGS_S

MIB = 1 << 20
LIMIT = 2048 * MIB  # of a command's address space
IMAGE = "rec/images/ccd1/000001.png"
# each command with the files that it reads
READ = {
    EVALUATE: ("found.csv", "truth.csv", "handle.toml"),
    MEASURE: ("rig.toml", "handle.toml", IMAGE),
    TRACK: ("rec/rig.toml", "rec/handle.toml", "rec/timestamps.csv", IMAGE),
    VIDEOS: ("ccd1.mkv", "ccd2.mkv"),
    CAPTURE: ("ccd1.mkv", "rig.toml"),
    FOLLOW: ("path.csv", "rig.toml", "handle.toml"),
    BOARDS: ("a/02.png", "b/03.png"),
    "bag rec --out new": ("rec/handle.toml", "rec/timestamps.csv", "rec/rig.toml"),
    "track bag --out poses.csv": ("bag/metadata.yaml", "bag/bag.mcap"),
    "track bag/bag.mcap --out poses.csv": ("bag/bag.mcap",),
}
LONGEST = 30_000_000  # bytes that a stretch grows to


class Ran(NamedTuple):
    """A command's exit code, its lines on standard error, the most memory that it had, bytes, and its
    processor time, s.
    """

    code: int
    lines: list[str]
    peak: int
    seconds: float


class Attempt(NamedTuple):
    """A command line, the file that was wrong, what was wrong with it, and what the command did."""

    line: str
    file: str
    what: str
    ran: Ran


def run_limited(line, folder):
    """Run a command in a process that gets no more than `LIMIT` bytes of address space."""
    with subprocess.Popen(
        [sys.executable, "-c", CLI, *shlex.split(line)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (LIMIT, LIMIT)),
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    ) as process:
        hangs = Timer(HANGS_S, process.kill)
        hangs.start()
        lines = process.stderr.read().decode(errors="replace").splitlines()
        _, status, usage = os.wait4(process.pid, 0)
        hangs.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = usage.ru_utime + usage.ru_stime
    return Ran(process.returncode, lines, usage.ru_maxrss * 1024, seconds)  # Linux counts in KiB


def make_bag(folder):
    """Add a bag to a healthy folder, which is the working folder; whether there could be one."""
    with redirect_stdout(io.StringIO()):
        if run("bag rec --out bag") != 0:  # without the extra
            return False
    (mcap,) = Path(folder, "bag").glob("*.mcap")
    about = Path(folder, "bag", "metadata.yaml")
    about.write_text(about.read_text().replace(mcap.name, "bag.mcap"))
    mcap.rename(mcap.with_name("bag.mcap"))
    return True


def attempts(rng, healthy, work, count):
    """Run so many commands, each in a new copy of the healthy folder, which is the working folder."""
    lines = [line for line in READ if "bag/" not in READ[line][0] or (healthy / "bag").is_dir()]
    for _ in range(count):
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(healthy, work)
        line = lines[rng.integers(len(lines))]
        file = READ[line][rng.integers(len(READ[line]))]
        what = make_wrong(rng, work / file)
        yield Attempt(line, file, what, run_limited(line, work))


def make_wrong(rng, path):
    """Make one file wrong, and say how."""
    ways = (_bytes, _bytes, _numbers, _numbers, _numbers, _grown, _grown, _cut, _replaced)
    way = ways[rng.integers(len(ways))]
    return way(rng, path)


def finding(attempt):
    """What a command must not do, or nothing: end otherwise than with an answer or one line of what is
    wrong.
    """
    code, lines = attempt.ran.code, attempt.ran.lines
    last = lines[-1] if lines else ""
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if any(line.startswith("Traceback") for line in lines):
        return f"traceback: {last}"
    if code == 2 and not last.startswith(f"trinolab {attempt.line.split()[0]}: "):
        return f"no line of what is wrong: {last}"
    return f"memory: {last}" if "not enough memory" in last else ""


def _bytes(rng, path):
    content = bytearray(path.read_bytes())
    for place in rng.integers(len(content), size=int(10 ** rng.uniform(0, 1.5))):
        content[place] = rng.integers(256)
    path.write_bytes(content)
    return "other bytes"


def _numbers(rng, path):
    """Another number where digits stand; in a file that is no text that is a matter of luck."""
    content = path.read_bytes()
    places = [match.span() for match in re.finditer(rb"\d+(?:\.\d+)?", content)]
    if not places:
        return _bytes(rng, path)
    others = (b"0", b"-1", b"65535", b"99999", b"1e308", b"nan", b"inf", b"9" * 400, b"1e-320")
    for _ in range(rng.integers(1, 4)):
        start, stop = places[rng.integers(len(places))]
        if stop <= len(content):
            content = content[:start] + others[rng.integers(len(others))] + content[stop:]
    path.write_bytes(content)
    return "other numbers"


def _grown(rng, path):
    """A stretch of it, again and again."""
    content = path.read_bytes()
    start = rng.integers(len(content))
    piece = content[start : start + rng.integers(1, 40)]
    times = int(10 ** rng.uniform(1, 7))
    grown = piece * min(times, LONGEST // len(piece))
    path.write_bytes(content[:start] + grown + content[start:])
    return "a stretch repeated"


def _cut(rng, path):
    content = path.read_bytes()
    path.write_bytes(content[: rng.integers(len(content))])
    return "cut off"


def _replaced(rng, path):
    path.unlink()
    ways = {
        "a pipe": os.mkfifo,  # that nobody writes into
        "a device": lambda path: path.symlink_to("/dev/zero"),
        "a folder": Path.mkdir,
        "nothing": Path.touch,
    }
    name = list(ways)[rng.integers(len(ways))]
    ways[name](path)
    return name
