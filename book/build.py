"""Build the book: run what is stale, two jobs at a time, build the pages strictly, print the scoreboard.

    .venv/bin/python book/build.py

Jupyter Book takes the outputs of the chapters from a jupyter-cache, which knows a notebook by its code cells alone.
So this script drops that cache whenever the package, the data or the environment has changed.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO, NamedTuple

import nbformat
import pandas as pd
import yaml
from jupyter_cache import get_cache
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from trinolab.cli import as_text
from trinolab.errata import effects
from trinolab.ledger import write_pages
from trinolab.notebookrun import ONE_THREAD, run_notebook

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "_build"
CACHE = BUILD / ".jupyter_cache"  # the same folder as `execute: cache` in _config.yml
EXECUTED = BUILD / "executed"
FINGERPRINT = BUILD / "fingerprint"
SCOREBOARD = BUILD / "scoreboard.csv"
NEW_SCOREBOARD = BUILD / "scoreboard.new.csv"
GENERATED = BUILD / "generated"  # parts of pages that come from the ledger of equations
HTML = BUILD / "html"


class Job(NamedTuple):
    """A command that is running."""

    name: str
    process: subprocess.Popen
    log: IO[str]
    start: float


def main() -> int:
    """Build everything and return the exit code."""
    os.chdir(ROOT)
    EXECUTED.mkdir(parents=True, exist_ok=True)
    drop_if_changed()
    try:
        if not run_all(stale_commands()) or not build_pages():
            return 1
    except KeyboardInterrupt:
        print("\nstopped; the chapters that were finished are kept")
        return 130
    print(f"\n{as_text(pd.read_csv(SCOREBOARD, dtype=str, keep_default_na=False))}")
    print(f"\nThe book: {HTML / 'index.html'}")
    return 0


def drop_if_changed() -> None:
    """Drop every stored result when the package, the data or the environment is not what it was."""
    now = fingerprint()
    if not FINGERPRINT.exists() or FINGERPRINT.read_text() != now:
        shutil.rmtree(CACHE, ignore_errors=True)
        shutil.rmtree(GENERATED, ignore_errors=True)
        SCOREBOARD.unlink(missing_ok=True)
        FINGERPRINT.write_text(now)


def fingerprint() -> str:
    """Return a hash of all that a result depends on besides the notebook itself."""
    files = [*ROOT.glob("trinolab/**/*.py"), *ROOT.glob("data/**/*"), ROOT / "environment.txt"]
    state = hashlib.sha256(f"{sys.version} {os.environ.get('TRINOLAB_DATA')}".encode())
    for path in sorted(path for path in files if path.is_file() and "__pycache__" not in path.parts):
        content = path.read_bytes()
        state.update(f"{path.relative_to(ROOT).as_posix()} {len(content)}\n".encode() + content)
    return state.hexdigest()


def stale_commands() -> dict[str, list[str]]:
    """Return name -> command of what has to run, the scoreboard first because it takes longest."""
    commands = {}
    if not SCOREBOARD.exists():
        trinolab = Path(sys.executable).with_name("trinolab")
        commands["scoreboard"] = [str(trinolab), "scoreboard", "--csv", str(NEW_SCOREBOARD)]
    if not (GENERATED / "equations.md").exists():  # the one that is written last
        commands["ledger"] = [sys.executable, __file__, "--ledger"]
    for path in chapters():
        try:
            get_cache(CACHE).match_cache_file(str(path))
            print(f"{path.stem}: unchanged")
        except KeyError:
            commands[path.stem] = [sys.executable, __file__, "--chapter", str(path)]
    return commands


def chapters() -> list[Path]:
    """Return the notebooks that the table of contents names, in its order."""
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    entries = [entry["file"] for part in toc["parts"] for entry in part["chapters"]]
    return [ROOT / f"{entry}.ipynb" for entry in entries if (ROOT / f"{entry}.ipynb").exists()]


def run_all(commands: dict[str, list[str]]) -> bool:
    """Run the commands, at most two at a time; return whether all of them succeeded."""
    waiting, running, good = list(commands.items()), [], True
    try:
        while waiting or running:
            while waiting and len(running) < min(2, os.cpu_count() or 1):
                running.append(start(*waiting.pop(0)))
            show_progress(running)
            time.sleep(0.2)
            for job in [job for job in running if job.process.poll() is not None]:
                running.remove(job)
                good &= finish(job)
    finally:
        for job in running:  # only after Ctrl-C; a chapter that is terminated stops its kernel first
            job.process.terminate()
            job.process.wait()
    return good


def start(name: str, command: list[str]) -> Job:
    """Start one command; what it prints goes to a temporary file."""
    say(f"{name}: started")
    log = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115  closed in finish()
    process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, **ONE_THREAD, "PYTHONIOENCODING": "utf-8"},
                               stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)
    return Job(name, process, log, time.monotonic())


def finish(job: Job) -> bool:
    """Report a finished command, with all that it printed if it failed."""
    good = job.process.returncode == 0
    say(f"{job.name}: {'done' if good else 'FAILED'} after {time.monotonic() - job.start:.0f} s")
    if not good:
        job.log.seek(0)
        print(job.log.read())
    else:
        keep(job.name)
    job.log.close()
    return good


def show_progress(running: list[Job]) -> None:
    """On a terminal keep one line that says what is running and for how long."""
    if sys.stdout.isatty():
        jobs = (f"{job.name} {time.monotonic() - job.start:.0f} s" for job in running)
        print("\r\033[Krunning: " + ", ".join(jobs), end="", flush=True)


def say(line: str) -> None:
    """Print a line, over the line of `show_progress` if there is one."""
    print(("\r\033[K" if sys.stdout.isatty() else "") + line, flush=True)


def run_chapter(path: Path) -> int:
    """Execute one notebook and store it beside the cache; print the traceback if it raises."""
    try:
        run = run_notebook(path)
    except (CellExecutionError, CellTimeoutError, DeadKernelError, ValueError) as error:
        print(re.sub(r"\x1b\[[0-9;]*m", "", str(error)))
        return 1
    nbformat.write(run.notebook, EXECUTED / path.name)
    return 0


def run_ledger() -> int:
    """Write the parts of pages that come from the ledger of equations, with the effects of the misprints."""
    write_pages(GENERATED, effects())
    return 0


def keep(name: str) -> None:
    """Take over the result of a job, in this process alone: the cache's database suffers only one writer at a time."""
    if name == "scoreboard":
        NEW_SCOREBOARD.replace(SCOREBOARD)
    elif name != "ledger":
        path = EXECUTED / f"{name}.ipynb"
        get_cache(CACHE).cache_notebook_file(str(path), uri=str(ROOT / "notebooks" / path.name), overwrite=True)


def build_pages() -> bool:
    """Build the pages with every warning an error. All are read anew: an unchanged page repeats no warning."""
    print("building the pages", flush=True)
    shutil.rmtree(HTML, ignore_errors=True)
    jupyter_book = str(Path(sys.executable).with_name("jupyter-book"))
    command = [jupyter_book, "build", str(ROOT), "-n", "-W", "--keep-going", "--all", "-q"]
    return subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL).returncode == 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--chapter"]:
        sys.exit(run_chapter(Path(sys.argv[2])))
    sys.exit(run_ledger() if sys.argv[1:2] == ["--ledger"] else main())
