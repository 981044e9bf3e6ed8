"""What ``trinolab accept`` does: a rig and a handle in, a data sheet out."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from trinolab.checks import as_whole
from trinolab.files.journal import fingerprint
from trinolab.files.outputs import check_targets, write_together
from trinolab.files.recording import find_footage, open_folder
from trinolab.files.rigs import read_rig
from trinolab.following.track import track_folder
from workbench.provenance import commit, machine, versions
from workbench.studies.carrier import results_of

from . import arm, availability, history, pointer, rest
from .arm import Noise
from .numbers import Answer
from .setup import Field, field_of
from .sheet import NUMBERS, PAGE, TABLE, Sheet, contents, glance, interval_text, value_text
from .size import POSES, check_chart
from .tracks import as_track, track_of_table
from .work import RENDERED, TESTS, Source, all_measured, setup_of

KEPT = "measured.jsonl"
WORKERS = 2
# A7 without a measurement at rest: of the standard rig
DEFAULT_NOISE = Noise(0.003, 0.03, "the standard rig has at rest")


class Outcome(NamedTuple):
    """Answers by their tests, why others were not run, and the processor time of all parts, s."""

    answers: dict[str, Answer]
    left_out: dict[str, str]
    cpu_s: float


class Done(NamedTuple):
    """A sheet that was written, where, and the processor time of all its parts, s."""

    sheet: Sheet
    page: Path
    cpu_s: float


def accept(
    rig: str | Path,
    handle: str | Path,
    out: str | Path,
    recordings: Sequence[str | Path] = (),
    poses: int = POSES,
    seed: int = 0,
    chart: str | Path | None = None,
    workers: int = WORKERS,
) -> Done:
    """Measure a rig and its handle by all tests, and write the sheet.

    Finished parts are kept in the folder, in ``measured.jsonl``: the same call goes on where an
    interrupted one has stopped.

    Parameters
    ----------
    rig, handle : path
        Rig and handle file.
    out : path
        A folder, made if it is not there: for ``index.html``, ``numbers.csv`` and ``sheet.json``.
    recordings : sequence of path
        Recording folders, see `files.recording`, in the place of the renderer: then only the tests
        are run that need no truth. Their poses are written beside the sheet.
    poses : int
        Of the test of static accuracy; the other tests grow and shrink with it.
    seed : int
        Of poses and noise.
    chart : path, optional
        CSV of a control chart, to which this sheet is added.
    workers : int
        Processes.

    Raises
    ------
    ValueError
        Names the file that is missing, unreadable or does not fit.
    KeyboardInterrupt
        Says how many parts are kept.
    """
    check_chart(chart, recordings)
    source = Source(str(rig), str(handle), poses, seed)
    setup_of.cache_clear()  # the files may have changed since another call
    setup = setup_of(source)
    for path in recordings:
        open_folder(path, rig, handle)  # all of them before the first one is followed
    if not recordings:
        field_of(setup.rig, setup.handle)  # a rig without one is refused before the folder is made
    workers = min(as_whole(workers, "workers", 1), os.cpu_count() or 1)
    folder = sheet_folder(out, [rig, handle, *([chart] if chart else [])])
    if chart is not None:
        check_targets([chart])
        if Path(chart).exists():
            history.read_history(chart)  # a wrong one is refused before anything is computed
    if recordings:
        answers, left_out, cpu_s = _recorded(source, recordings, folder, workers)
    else:
        answers, left_out, cpu_s = _rendered(source, folder, workers)
    about = _about(source, recordings, cpu_s, len(setup.rig.cameras))
    titles = {name: test.TITLE for name, test in TESTS.items()}
    sheet = Sheet(about, answers, titles, left_out)
    if chart is not None:
        _add_to_chart(sheet, chart, source)
    write_together({folder / name: text for name, text in contents(sheet).items()})
    return Done(sheet, folder / PAGE, cpu_s)


def sheet_folder(out: str | Path, inputs: Sequence[str | Path]) -> Path:
    """The folder of the sheet, made if need be. ValueError if it cannot be written."""
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"{folder}: cannot be written ({error.strerror})") from None
    check_targets([folder / name for name in (PAGE, TABLE, NUMBERS, KEPT)], inputs)
    return folder


def _rendered(source: Source, folder: Path, workers: int) -> Outcome:
    """All tests on images of the bench."""
    setup = setup_of(source)
    left_out = {}
    counts = {}
    for name in RENDERED:
        try:
            counts[name] = TESTS[name].parts(setup)
        except ValueError as error:  # the field of view has no room for it
            left_out[name] = str(error)
    found = all_measured(source, counts, folder / KEPT, workers)
    answers = {name: TESTS[name].judge(setup, rows) for name, rows in found.rows.items()}
    at_rest = [as_track(rows) for rows in found.rows.get("A1", [])]
    noise = _noise(rest.jitter_of(at_rest), "it has in test A1")
    outcome = Outcome(answers, left_out, found.cpu_s)
    return _with_arm(outcome, source, noise, folder, workers)


def _noise(jitter: tuple[float, float] | None, source: str) -> Noise:
    """The noise of a handle at rest, to six digits, so that it is the same on another processor."""
    if jitter is None:
        return DEFAULT_NOISE
    return Noise(float(f"{jitter[0]:.6g}"), float(f"{jitter[1]:.6g}"), source)


def _with_arm(
    outcome: Outcome, source: Source, noise: Noise, folder: Path, workers: int
) -> Outcome:
    """The arm's test as well, behind the others because their noise leads it."""
    answers, left_out, cpu_s = outcome
    if why := arm.why_not():
        return Outcome(answers, left_out | {arm.NAME: why}, cpu_s)
    setup = setup_of(source)
    counts = {arm.NAME: arm.parts(setup)}
    found = all_measured(source, counts, folder / KEPT, workers, noise)
    answer = arm.judge(setup, found.rows[arm.NAME], noise)
    return Outcome(answers | {arm.NAME: answer}, left_out, cpu_s + found.cpu_s)


def _recorded(
    source: Source,
    recordings: Sequence[str | Path],
    folder: Path,
    workers: int,
) -> Outcome:
    """The tests that need no truth, on recordings."""
    answers: dict[str, Answer] = {}
    resting = []
    found = _tracks(source, recordings, folder)
    for path, (columns, _) in zip(recordings, found, strict=True):
        name = f"recording {Path(path).name}"
        track = track_of_table(pd.DataFrame(columns))
        _add(answers, availability.NAME, availability.judge_recording(track, name))
        _add(answers, pointer.NAME, pointer.judge_recording(track, name))
        if rest.at_rest(track):
            resting.append(track)
            _add(answers, rest.NAME, rest.judge_tracks([track], None, name))
    left_out = {
        name: "it needs the true poses, which a recording does not have"
        for name in ("A0", "A2", "A3")
    }
    left_out["A5"] = "it needs the time of a known motion, which a recording does not have"
    if not resting:
        left_out[rest.NAME] = (
            f"in no recording does the handle rest (95 % of the instants within {rest.REST_MM:g} "
            f"mm and {rest.REST_DEG:g} deg of their median)"
        )
    if not answers[pointer.NAME].numbers:
        del answers[pointer.NAME]
        left_out[pointer.NAME] = (
            "in no recording does the handle turn about one point (by "
            f"{pointer.PIVOT_DEG:g} deg or more, to {pointer.PIVOT_MM:g} mm)"
        )
    noise = _noise(rest.jitter_of(resting), "the recordings of a handle at rest have")
    outcome = Outcome(answers, left_out, sum(cpu_s for _, cpu_s in found))
    return _with_arm(outcome, source, noise, folder, workers)


def _add(answers: dict[str, Answer], name: str, more: Answer) -> None:
    answer = answers.setdefault(name, Answer())
    answer.numbers += more.numbers
    answer.pictures += more.pictures
    answer.notes += more.notes


def _tracks(source: Source, recordings: Sequence[str | Path], folder: Path) -> list[Any]:
    """Columns of the poses of each recording folder, and the processor time that it took, s."""
    rig = read_rig(source.rig)
    settings = [
        {
            "path": str(path),
            "out": str(folder / f"poses_{k}_{Path(path).name}.csv"),
            "rig": source.rig,
            "handle": source.handle,
            "footage": fingerprint([source.rig, source.handle], find_footage(path, rig)),
        }
        for k, path in enumerate(recordings)
    ]
    return results_of("recordings", _tracked, settings, 1, folder / KEPT, source.made_from)


def _tracked(path: str, out: str, rig: str, handle: str, footage: str) -> list[Any]:
    """Track a recording folder whose contents have a fingerprint, `footage`."""
    begin = time.process_time()
    table = track_folder(path, out, rig, handle)
    return [table.to_dict("list"), time.process_time() - begin]


def _about(
    source: Source, recordings: Sequence[str | Path], cpu_s: float, cameras: int
) -> dict[str, str | int]:
    """What a reader needs to make the sheet again."""
    setup = setup_of(source)
    sizes = sorted({f"{c.size[0]} x {c.size[1]}" for c in setup.rig.cameras})
    computer = machine()
    of = (
        f"images of {len(recordings)} recordings"
        if recordings
        else f"{source.poses} poses and more on rendered images"
    )
    about: dict[str, str | int] = {
        "summary": f"{cameras} cameras of {', '.join(sizes)} pixels; {of}; "
        f"estimator {setup.parameters.estimator}; seed {source.seed}.",
        "rig": Path(source.rig).stem,
        "handle": setup.handle.name,
        "images": "recordings" if recordings else "the own bench",
        "recordings": ", ".join(Path(path).name for path in recordings),
        "estimator": str(setup.parameters.estimator),
        "poses": source.poses,
        "seed": source.seed,
        "field of view": "" if recordings else _field_text(setup.field),
        "made": datetime.now(UTC).isoformat(timespec="minutes"),
        "commit": commit() or "no checkout",
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
        "computer": f"{computer['system']}, {computer['cores']} cores",
        "processor time": f"{cpu_s:.0f} s",
        "command": _command(source, recordings),
    }
    return {name: value for name, value in about.items() if value != ""}


def _field_text(field: Field) -> str:
    litres = field.volume_mm3 / 1e6
    return f"{litres:.1f} litres, up to {field.farthest_mm:.0f} mm before a camera"


def _command(source: Source, recordings: Sequence[str | Path]) -> str:
    """What makes the sheet again; files by their names alone."""
    names = [os.path.basename(path) for path in (source.rig, source.handle)]
    of = "".join(f" {Path(path).name}" for path in recordings)
    line = f"trinolab accept{of} --rig {names[0]} --handle {names[1]}"
    return f"{line} --poses {source.poses} --seed {source.seed} --out sheet"


def _add_to_chart(sheet: Sheet, chart: str | Path, source: Source) -> None:
    """One more row of each charted number, and the charts of all rows."""
    key = (str(sheet.about["rig"]), str(sheet.about["handle"]), source.poses, source.seed)
    table = history.extend(chart, history.rows_of(sheet.numbers, *key))
    sheet.charts += history.charts(table, *key)


def as_lines(done: Done) -> list[str]:
    """What a person reads when a sheet is made."""
    lines = []
    for test, _, quantity, number in glance(done.sheet.numbers):
        within = f"  ({interval_text(number)})" if interval_text(number) else ""
        lines.append(f"{test}  {quantity}: {value_text(number)}{within}, n {number.n}")
    for name, why in sorted(done.sheet.left_out.items()):
        lines.append(f"{name}  not run: {why}")
    return lines
