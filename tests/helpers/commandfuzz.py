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
        what = list(WAYS)[rng.integers(len(WAYS))]
        content = (work / file).read_bytes()
        (work / file).unlink()
        WAYS[what](rng, work / file, content)
        yield Attempt(line, file, what, run_limited(line, work))


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


def _bytes(rng, path, content):
    content = bytearray(content)
    for place in rng.integers(len(content), size=int(10 ** rng.uniform(0, 1.5))):
        content[place] = rng.integers(256)
    path.write_bytes(content)


def _numbers(rng, path, content):
    """Another number where digits stand; in a file that is no text that is a matter of luck."""
    others = (b"0", b"-1", b"65535", b"99999", b"1e308", b"nan", b"inf", b"9" * 400, b"1e-320")
    share = 3 / max(len(re.findall(rb"\d+(?:\.\d+)?", content)), 3)

    def other(match):
        return others[rng.integers(len(others))] if rng.random() < share else match[0]

    path.write_bytes(re.sub(rb"\d+(?:\.\d+)?", other, content))


def _grown(rng, path, content):
    """A stretch of it, again and again."""
    start = rng.integers(len(content))
    piece = content[start : start + rng.integers(1, 40)]
    times = min(int(10 ** rng.uniform(1, 7)), LONGEST // len(piece))
    path.write_bytes(content[:start] + piece * times + content[start:])


def _cut(rng, path, content):
    path.write_bytes(content[: rng.integers(len(content))])


WAYS = {
    "other bytes": _bytes,
    "other numbers": _numbers,
    "a stretch repeated": _grown,
    "cut off": _cut,
    "a pipe": lambda rng, path, content: os.mkfifo(path),  # that nobody writes into
    "a device": lambda rng, path, content: path.symlink_to("/dev/zero"),
    "a folder": lambda rng, path, content: path.mkdir(),
}
