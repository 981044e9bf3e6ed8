"""Build the book: run what is stale, two jobs at a time, build the pages strictly, print the
scoreboard and what decided how long it took.

    .venv/bin/python book/build.py

Nothing here has a time limit: how long a rendering takes depends on the machine. On a terminal a
line says what is running, in a log there is one per minute; Ctrl-C stops it.

A rendering of a recording is a job as a chapter is; only the chapters that read the recording wait
for it. Of the jobs that wait for nothing the one with the longest way to the end starts first.

A chapter is stale when its own code has changed, the package's code that it imports, the data or
the environment: ``_build/made_from.json`` has the hashes that each finished result was made from.
Jupyter Book takes the outputs of the chapters from a jupyter-cache. That cache knows a notebook by
its code cells alone, so it is filled from here.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NamedTuple

import nbformat
import pandas as pd
from jupyter_cache import get_cache
from jupyter_cache.cache.main import CacheBundleIn
from nbclient.exceptions import CellExecutionError, DeadKernelError

from trinolab.files.outputs import write_whole

from ..cli import QUESTION_WIDTH, as_text, essential, not_run
from ..provenance import (
    hash_files,
    hash_text,
    made_from_module,
    made_from_notebook,
    source_of,
    surroundings,
)
from ..sweep.notebook import ONE_THREAD, read_notebook, run_notebook
from .contents import pages

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "_build"
CACHE = BUILD / ".jupyter_cache"  # the same folder as `execute: cache` in _config.yml
EXECUTED = BUILD / "executed"
# a result's name -> a hash of each thing that it was made from
MADE_FROM = BUILD / "made_from.json"
SCOREBOARD = BUILD / "scoreboard.csv"
NEW_SCOREBOARD = BUILD / "scoreboard.new.csv"
# parts of pages: from the ledger of equations, and of the reference in a folder
GENERATED = BUILD / "generated"
HTML = BUILD / "html"
SECONDS = BUILD / "seconds.json"  # a result's name -> how long it took, s
PAGES_MADE_FROM = BUILD / "pages_made_from"  # a hash; it is there as long as the pages are whole
# the standard recordings that chapters use, and their length, s
RECORDINGS = ("calm", "hard")
RECORDED_S = 2.0
TASK = "task"  # the recording of the task of chapter 11, and its film
WORKERS = min(2, os.cpu_count() or 1)  # jobs at a time, and processes for the pages
# How long a job takes until `SECONDS` knows better, s. Only the order follows from it: the longest are
# here, and the recordings, whose time is not kept, since most often they are there.
EXPECTED_S = {
    "recording calm": 20.0,
    "recording hard": 55.0,
    "recording task": 80.0,
    "03_background": 29.0,
    "07_calibration": 27.0,
    "10_estimators": 39.0,
    "10b_trust": 39.0,
}
USUAL_S = 15.0  # of all others
SIGN_OF_LIFE_S = 60.0  # in a log
# what most often ends a kernel, or a whole job, from outside
KILLED = "most often the machine had no memory left: close other programs"
BUILD_COMMAND = (sys.executable, "-m", "workbench.pages.build")
AGAIN = "`make book`, or `python book/build.py`, goes on from there"

# Jupyter Book's own has no title, no language and no icon, which a browser then asks for in vain.
INDEX = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>trinolab</title>
<link rel="icon" href="_static/icon.svg" type="image/svg+xml">
<meta http-equiv="refresh" content="0; url=book/start.html">
</head>
<body><main><h1>trinolab</h1><p><a href="book/start.html">The book</a></p></main></body>
</html>
"""
# Shown by a host at any address that it does not know, so that no relative link would do.
NOT_FOUND = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>trinolab: no such page</title>
</head>
<body><main><h1>No such page</h1><p><a href="index.html">To the beginning</a></p></main></body>
</html>
"""


class Job(NamedTuple):
    """Something that has to run: its name, its command, a hash of each thing that its result is made
    from, and the jobs that it waits for. A recording has no hashes: the user's cache knows it.
    """

    name: str
    command: list[str]
    made_from: dict[str, str]
    needs: tuple[str, ...] = ()


class Running(NamedTuple):
    """A job that is running."""

    job: Job
    process: subprocess.Popen
    log: IO[str]
    start: float


class Ended(NamedTuple):
    """A job that has run: when it began and ended, s, and whether it went well."""

    name: str
    start: float
    end: float
    good: bool


def main() -> int:
    """Build everything and return the exit code."""
    begin = time.monotonic()
    os.chdir(ROOT)
    EXECUTED.mkdir(parents=True, exist_ok=True)
    try:
        ended = run_all(stale_jobs())
        if failed := [one.name for one in ended if not one.good]:
            print(f"\nFAILED: {', '.join(failed)}. What they said is above; all else is kept.")
            print(f"Mend it, or try again if the machine was at fault: {AGAIN}.")
            return 1
        start = time.monotonic()
        if not build_pages():
            print(f"\nFAILED: the pages; the warnings above say why. Mend it: {AGAIN}.")
            return 1
        end = time.monotonic()
    except KeyboardInterrupt:
        print(f"\nstopped; what is finished is kept, and {AGAIN}")
        return 130
    except (ValueError, OSError) as error:
        print(f"\nFAILED: {error}\nWhat is finished is kept. Mend it: {AGAIN}.")
        return 1
    board = pd.read_csv(SCOREBOARD, dtype=str, keep_default_na=False)
    shown = as_text(essential(board), QUESTION_WIDTH)
    print("\n".join(filter(None, ["", shown, not_run(board)])))
    print(f"All {len(board)} rows: `trinolab scoreboard`, and the page scoreboard.")
    print("\n".join(["", *times_said(ended, Ended("the pages", start, end, True))]))
    print(f"The book: {HTML / 'index.html'}, after {time.monotonic() - begin:.0f} s")
    return 0


def stale_jobs() -> list[Job]:
    """Return what has to run, the recordings that it needs first."""
    board = [str(tool("trinolab")), "scoreboard", "--csv", str(NEW_SCOREBOARD)]
    jobs = [
        Job("scoreboard", board, made_from_module("workbench.studies.scoreboard")),
        Job(
            "ledger",
            [*BUILD_COMMAND, "--ledger"],
            {**made_from_module("workbench.paper.errata"), "labels": " ".join(labels())},
        ),
        *(
            Job(
                path.stem,
                [*BUILD_COMMAND, "--chapter", str(path)],
                made_from(path),
                tuple(f"recording {name}" for name in recordings_of(path)),
            )
            for path in chapters()
        ),
    ]
    stale = []
    for job in jobs:
        if is_finished(job.name, job.made_from):
            print(f"{job.name}: unchanged")
        else:
            stale.append(job)
    needed = {name for job in stale for name in job.needs}
    recordings = [
        Job(f"recording {name}", [*BUILD_COMMAND, "--recording", name], {})
        for name in (*RECORDINGS, TASK)
        if f"recording {name}" in needed
    ]
    return recordings + stale


def recordings_of(path: Path) -> list[str]:
    """Return the recordings that a chapter's code names. One that is overlooked here is rendered by
    the chapter itself, or waited for by its worker.
    """
    code = source_of(read_notebook(path))
    reads = "read_recording(" in code
    found = [name for name in RECORDINGS if reads and f'"{name}"' in code]
    return found + [TASK] * bool(re.search(r"\btask\.(recording|performed)\(", code))


def run_recording(name: str) -> int:
    """Render a recording, if it is not there."""
    from trinolab.bench.rendering import standard_recording

    from ..teleop import task

    try:
        if name == TASK:
            task.performed()
        else:
            standard_recording(name, seconds=RECORDED_S)
    except (ValueError, OSError) as error:
        print(error)
        return 1
    return 0


def executed(path: Path) -> Path | None:
    """Return the executed copy of a notebook, or None if there is none or it is stale."""
    return result_of(path.stem) if is_finished(path.stem, made_from(path)) else None


def is_finished(name: str, now: dict[str, str]) -> bool:
    """Return whether the result of a job is there, and made from what is there now."""
    return result_of(name).exists() and read_finished().get(name) == now


def made_from(path: Path) -> dict[str, str]:
    """Return a hash of each thing that a chapter's outputs depend on."""
    return made_from_notebook(read_notebook(path), path.parent)


def read_finished() -> dict[str, dict[str, str]]:
    """Return name -> what it was made from, of all finished results."""
    return json.loads(MADE_FROM.read_text(encoding="utf-8")) if MADE_FROM.exists() else {}


def read_seconds() -> dict[str, float]:
    """Return name -> how long it took to make, s, of all finished results."""
    return json.loads(SECONDS.read_text(encoding="utf-8")) if SECONDS.exists() else {}


def result_of(name: str) -> Path:
    """Return the file that a job leaves, the last one if it leaves several."""
    files = {"scoreboard": SCOREBOARD, "ledger": GENERATED / "equations.md"}
    return files.get(name, EXECUTED / f"{name}.ipynb")


def tool(name: str) -> Path:
    """Return the path of a command of this environment."""
    return Path(sys.executable).with_name(name)


def chapters() -> list[Path]:
    """Return the notebooks that the table of contents names, in its order."""
    notebooks = [ROOT / f"{page}.ipynb" for page in pages(ROOT)]
    return [path for path in notebooks if path.exists()]


def run_all(jobs: list[Job]) -> list[Ended]:
    """Run jobs, at most two at a time, each when what it needs is there and the longest way to the end
    first; return those that have run. What needs a job that failed is left out.
    """
    way = ways(jobs)
    waiting = sorted(jobs, key=lambda job: -way[job.name])
    missing = {job.name for job in jobs}
    running = list[Running]()
    ended = list[Ended]()
    said = time.monotonic()
    try:
        while waiting or running:
            ready = [job for job in waiting if missing.isdisjoint(job.needs)]
            for job in ready[: WORKERS - len(running)]:
                waiting.remove(job)
                running.append(start(job))
            said = show_progress(running, said)
            time.sleep(0.2)
            for one in [one for one in running if one.process.poll() is not None]:
                running.remove(one)
                good = finish(one, f"{len(ended) + 1} of {len(jobs)}")
                ended.append(Ended(one.job.name, one.start, time.monotonic(), good))
                if good:
                    missing.remove(one.job.name)
                    continue
                for job in [job for job in waiting if one.job.name in job.needs]:
                    waiting.remove(job)
                    say(f"{job.name}: not run, it needs {one.job.name}")
    finally:
        # only after Ctrl-C; a chapter that is terminated stops its kernel first
        for one in running:
            one.process.terminate()
            one.process.wait()
    return ended


def ways(jobs: list[Job]) -> dict[str, float]:
    """Return how long the way to the end is from the start of each job, s: its own time, and the
    longest of those that wait for it.
    """
    took = {**EXPECTED_S, **read_seconds()}
    return {
        job.name: took.get(job.name, USUAL_S)
        + max((took.get(one.name, USUAL_S) for one in jobs if job.name in one.needs), default=0.0)
        for job in jobs
    }


def critical_path(ended: list[Ended]) -> list[Ended]:
    """Return the jobs that decided when all had ended: the last one, the one whose end it waited for,
    for its result or its worker, and so on to the first.
    """
    path = list[Ended]()
    until = float("inf")
    while before := [one for one in ended if one.end <= until]:
        path.insert(0, max(before, key=lambda one: one.end))
        until = path[0].start
    return path


def times_said(ended: list[Ended], pages: Ended) -> list[str]:
    """Return the lines that say what decided how long a build took, and how long its workers had
    nothing to do.
    """
    path = [*critical_path(ended), pages]
    said = ", ".join(f"{one.name} {one.end - one.start:.0f} s" for one in path)
    lines = [f"One after the other: {said}."]
    if ended:
        wall = max(one.end for one in ended) - min(one.start for one in ended)
        busy = sum(one.end - one.start for one in ended) / WORKERS
        lines.append(
            f"{len(ended)} jobs took {wall:.0f} s, in which the workers ({WORKERS}) were idle "
            f"{1 - busy / wall:.0%} of the time."
        )
    return lines


def start(job: Job) -> Running:
    """Start a job; what it prints goes to a temporary file."""
    say(f"{job.name}: started")
    log = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115  closed in finish()
    process = subprocess.Popen(
        job.command,
        cwd=ROOT,
        env={**os.environ, **ONE_THREAD, "PYTHONIOENCODING": "utf-8"},
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=subprocess.STDOUT,
    )
    return Running(job, process, log, time.monotonic())


def finish(one: Running, place: str = "") -> bool:
    """Keep the result of a finished job; report it and its place, with all that it printed if it
    failed.
    """
    good = one.process.returncode == 0
    word = "done" if good else "FAILED"
    say(f"{one.job.name}: {word} after {time.monotonic() - one.start:.0f} s ({place})")
    if not good:
        one.log.seek(0)
        # without what each kernel says when it starts, which is not why this one failed
        print(re.sub(r"^\[IPKernelApp\].*\n", "", one.log.read(), flags=re.MULTILINE).rstrip())
        if one.process.returncode < 0:
            print(f"{one.job.name}: ended by signal {-one.process.returncode}; {KILLED}")
    elif one.job.made_from:
        keep(one.job)
        took = {**read_seconds(), one.job.name: round(time.monotonic() - one.start, 1)}
        write_whole(SECONDS, json.dumps(took, indent=1) + "\n")
    one.log.close()
    return good


def show_progress(running: list[Running], said: float) -> float:
    """Say what is running and for how long: in one line on a terminal, now and then in a log; when
    it was said last, `said` or now.
    """
    now = time.monotonic()
    line = "running: " + ", ".join(f"{one.job.name} {now - one.start:.0f} s" for one in running)
    if sys.stdout.isatty():
        print(f"\r\033[K{line}", end="", flush=True)
    elif now - said < SIGN_OF_LIFE_S:
        return said
    else:
        print(line, flush=True)
    return now


def say(line: str) -> None:
    """Print a line, over the line of `show_progress` if there is one."""
    print(("\r\033[K" if sys.stdout.isatty() else "") + line, flush=True)


def run_chapter(path: Path) -> int:
    """Execute one notebook and store it beside the cache; print the traceback if it raises."""
    try:
        run = run_notebook(path)
    except DeadKernelError:
        print(f"{path.name}: its kernel died; {KILLED}")
        return 1
    except (CellExecutionError, ValueError) as error:
        print(re.sub(r"\x1b\[[0-9;]*m", "", str(error)))
        return 1
    EXECUTED.mkdir(
        parents=True, exist_ok=True
    )  # whoever runs one chapter need not have built the book
    write_whole(result_of(path.stem), nbformat.writes(run.notebook))
    return 0


def run_ledger() -> int:
    """Write the parts of pages that come from the ledger of equations, with the effects of the
    misprints.
    """
    from ..paper.errata import effects
    from ..paper.ledger import write_pages

    shutil.rmtree(GENERATED, ignore_errors=True)
    write_pages(GENERATED, effects(), labels())
    return 0


def labels() -> list[str]:
    """The labels of equations, "eq-20", that chapters have before a formula."""
    found = set[str]()
    for path in chapters():
        cells = read_notebook(path).cells
        text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
        found |= set(re.findall(r"^\((eq-\d+)\)=$", text, flags=re.MULTILINE))
    return sorted(found)


def keep(job: Job) -> None:
    """Take over the result of a job, in this process alone: the cache's database suffers only one
    writer at a time.
    """
    if job.name == "scoreboard":
        NEW_SCOREBOARD.replace(SCOREBOARD)
    elif job.name != "ledger":
        put_into_cache(result_of(job.name))
    write_whole(
        MADE_FROM, json.dumps({**read_finished(), job.name: job.made_from}, indent=1) + "\n"
    )


def put_into_cache(copy: Path) -> None:
    """Give an executed notebook to the cache that Jupyter Book reads.

    The cache knows a cell by its metadata, too: the times that were recorded there do not go along,
    or Jupyter Book would take the notebook for another one and run it again.
    """
    original = next(path for path in chapters() if path.name == copy.name)
    notebook = read_notebook(copy)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    bundle = CacheBundleIn(notebook, str(original))
    get_cache(CACHE).cache_notebook_bundle(bundle, overwrite=True)


def is_cached(path: Path) -> bool:
    """Return whether the cache that Jupyter Book reads has the outputs of a notebook."""
    try:
        get_cache(CACHE).match_cache_file(str(path))
    except KeyError:
        return False
    return True


def build_pages() -> bool:
    """Build the pages if anything in them has changed, with every warning an error; return whether
    they are there.

    All pages are read anew then: an unchanged page would not repeat its warning.
    """
    now = pages_made_from()
    if PAGES_MADE_FROM.exists() and PAGES_MADE_FROM.read_text() == now:
        print("the pages: unchanged")
        return True
    print("building the pages", flush=True)
    write_reference()
    PAGES_MADE_FROM.unlink(missing_ok=True)
    shutil.rmtree(HTML, ignore_errors=True)
    for path in chapters():
        if not is_cached(path):  # somebody has emptied the cache
            put_into_cache(result_of(path.stem))
    pages = [*BUILD_COMMAND, "--pages", str(ROOT)]
    if subprocess.run(pages, cwd=ROOT, stdin=subprocess.DEVNULL).returncode != 0:
        return False
    write_whole(HTML / "index.html", INDEX)
    write_whole(HTML / "404.html", NOT_FOUND)
    write_crate()
    write_whole(PAGES_MADE_FROM, now)
    return True


def run_pages(folder: Path) -> int:
    """Build the pages of a folder as ``jupyter-book build -n -W --keep-going --all -q`` does, which
    cannot be told to use several processes.
    """
    from jupyter_book.sphinx import build_sphinx

    result = build_sphinx(
        folder,
        folder / "_build" / "html",
        noconfig=True,
        path_config=folder / "_config.yml",
        confoverrides={
            "external_toc_path": (folder / "_toc.yml").as_posix(),
            "latex_individualpages": False,
            "nitpicky": True,
            # a type variable has no page
            "nitpick_ignore": [("py:class", "trinolab.uncertainty.assessment.F")],
        },
        warningiserror=True,
        keep_going=True,
        freshenv=True,
        quiet=True,
        jobs=WORKERS,
    )
    return 0 if result == 0 else 1


def write_reference() -> None:
    """Write the API reference and the commands' help as the package is now, the numbers of all pages, the
    article's figures, the links to where the book runs, and the film.
    """
    from . import article, commandhelp, numbers, online, reference

    reference.write_pages()
    commandhelp.write_help()
    article.write_parts(numbers.write_numbers(BUILD), GENERATED / "article")
    online.write_page(GENERATED / "online")
    write_film()


def write_crate() -> None:
    """Put what the pages stand on beside them, and describe both as an RO-Crate."""
    from . import crate

    crate.write_crate(HTML)


def write_film() -> None:
    """Write chapter 1's film, which the start page shows as well."""
    chapter = nbformat.read(result_of("01_structure"), as_version=4)
    outputs = (
        output.get("data", {}) for cell in chapter.cells for output in cell.get("outputs", [])
    )
    (film,) = [data["text/html"] for data in outputs if "<video" in data.get("text/html", "")]
    (GENERATED / "start").mkdir(parents=True, exist_ok=True)
    write_whole(GENERATED / "start" / "film.html", film)


def pages_made_from() -> str:
    """Return a hash of all that the pages are built from."""
    sources = [
        *ROOT.glob("*.yml"),
        *ROOT.glob("book/**/*"),
        *ROOT.glob("notebooks/*.ipynb"),
        *ROOT.glob("data/**/*"),
        *ROOT.glob("trinolab/**/*.py"),
    ]
    results = [SCOREBOARD, *GENERATED.glob("*.md"), *(result_of(path.stem) for path in chapters())]
    return hash_text(surroundings([])["the environment"] + hash_files([*sources, *results], ROOT))


def command(arguments: Sequence[str]) -> int:
    """Do what the command line asks for, and return the exit code."""
    match list(arguments):
        case ["--chapter", chapter]:
            return run_chapter(Path(chapter))
        case ["--ledger"]:
            return run_ledger()
        case ["--pages", folder]:
            return run_pages(Path(folder))
        case ["--recording", name]:
            return run_recording(name)
        case []:
            return main()
    print(
        "usage: python book/build.py [--chapter NOTEBOOK | --ledger | --pages FOLDER | --recording NAME]",
        file=sys.stderr,
    )
    return 2


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))
