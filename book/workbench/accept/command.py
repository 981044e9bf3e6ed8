"""What ``trinolab accept`` does: a rig and a handle in, a data sheet out."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from trinolab.checks import as_whole
from trinolab.files.journal import fingerprint
from trinolab.files.outputs import check_targets, write_together
from trinolab.files.poses import read_poses
from trinolab.files.recording import find_footage, open_folder
from trinolab.files.rigs import read_rig
from trinolab.following.track import track_folder

from ..provenance import code_hash, commit, machine, versions
from . import arm, availability, history, pointer, rest
from .arm import Noise
from .numbers import Answer
from .setup import Field, field_of
from .sheet import NUMBERS, PAGE, TABLE, Sheet, contents, glance, interval_text, value_text
from .size import POSES, check_chart
from .tracks import Track, as_track, track_of_table
from .work import RENDERED, TESTS, Checkpoint, Found, Part, Source, do, setup_of

KEPT = "measured.jsonl"
WORKERS = 2
# A7 without a measurement at rest: of the standard rig
DEFAULT_NOISE = Noise(0.003, 0.03, "the standard rig has at rest")


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
    progress: bool = True,
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
    progress : bool
        Show progress bars on standard error, if that is a terminal.

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
    with Checkpoint(folder / KEPT, made_from(source)) as kept_work:
        try:
            if recordings:
                answers, left_out = _recorded(
                    source, recordings, folder, kept_work, workers, progress
                )
            else:
                answers, left_out = _rendered(source, kept_work, workers, progress)
        except KeyboardInterrupt:
            count = len(kept_work.lines())
            raise KeyboardInterrupt(
                f"{count} parts are kept in {kept_work.path}; the same command goes on"
            ) from None
        cpu_s = sum(found.cpu_s for found in kept_work.found().values())
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


def made_from(source: Source) -> str:
    """What tells the parts of one sheet from another's: the files' contents, size, seed, code."""
    files = [Path(path).read_bytes() for path in (source.rig, source.handle)]
    contents = [hashlib.sha256(text).hexdigest() for text in files]
    what = [*contents, source.poses, source.seed, code_hash("workbench.accept.work")]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def _rendered(
    source: Source, kept: Checkpoint, workers: int, progress: bool
) -> tuple[dict[str, Answer], dict[str, str]]:
    """All tests on images of the bench."""
    setup = setup_of(source)
    left_out = {}
    counts = {}
    for name in RENDERED:
        try:
            counts[name] = TESTS[name].parts(setup)
        except ValueError as error:  # the field of view has no room for it
            left_out[name] = str(error)
    parts = [Part(name, k) for name in RENDERED if name in counts for k in range(counts[name])]
    done = do(source, parts, kept, workers, progress, "tests")
    answers = {
        name: TESTS[name].judge(setup, [done[Part(name, k).key].rows for k in range(count)])
        for name, count in counts.items()
    }
    at_rest = [as_track(done[Part("A1", k).key].rows) for k in range(counts.get("A1", 0))]
    noise = _noise(rest.jitter_of(at_rest), "it has in test A1")
    _lead_arm(source, noise, kept, workers, progress, answers, left_out)
    return answers, left_out


def _noise(jitter: tuple[float, float] | None, source: str) -> Noise:
    """The noise of a handle at rest, to six digits, so that it is the same on another processor."""
    if jitter is None:
        return DEFAULT_NOISE
    return Noise(float(f"{jitter[0]:.6g}"), float(f"{jitter[1]:.6g}"), source)


def _lead_arm(
    source: Source,
    noise: Noise,
    kept: Checkpoint,
    workers: int,
    progress: bool,
    answers: dict[str, Answer],
    left_out: dict[str, str],
) -> None:
    """The arm's test, behind the others because their noise leads it."""
    if why := arm.why_not():
        left_out[arm.NAME] = why
        return
    setup = setup_of(source)
    parts = [Part(arm.NAME, k, noise) for k in range(arm.parts(setup))]
    done = do(source, parts, kept, workers, progress, "arm")
    answers[arm.NAME] = arm.judge(setup, [done[part.key].rows for part in parts], noise)


def _recorded(
    source: Source,
    recordings: Sequence[str | Path],
    folder: Path,
    kept: Checkpoint,
    workers: int,
    progress: bool,
) -> tuple[dict[str, Answer], dict[str, str]]:
    """The tests that need no truth, on recordings."""
    answers: dict[str, Answer] = {}
    resting = []
    for k, path in enumerate(recordings):
        name = f"recording {Path(path).name}"
        track = _track(source, path, folder / f"poses_{k}_{Path(path).name}.csv", kept, progress)
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
    _lead_arm(source, noise, kept, workers, progress, answers, left_out)
    return answers, left_out


def _add(answers: dict[str, Answer], name: str, more: Answer) -> None:
    answer = answers.setdefault(name, Answer())
    answer.numbers += more.numbers
    answer.pictures += more.pictures
    answer.notes += more.notes


def _track(source: Source, path: str | Path, out: Path, kept: Checkpoint, progress: bool) -> Track:
    """The poses of a recording folder: those that are kept, or tracked now."""
    files = [source.rig, source.handle]
    key = f"recording {fingerprint(files, find_footage(path, read_rig(source.rig)))}"
    if key in kept.found() and out.exists():
        return track_of_table(read_poses(out))
    begin = time.process_time()
    table = track_folder(path, out, source.rig, source.handle, progress=progress)
    kept.add(key, Found(None, time.process_time() - begin))
    return track_of_table(table)


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
