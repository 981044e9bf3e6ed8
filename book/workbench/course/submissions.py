"""Files that students hand in: one chapter's, or those of a whole class."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from trinolab.files.kept import KeptLines
from trinolab.files.outputs import check_target, write_whole

from ..provenance import code_hash, hash_files
from . import exercises
from .exercise import Exercise, FunctionExercise, ValueExercise
from .exercises import CHAPTERS, of_chapter
from .grading import Verdict, call_of, judge_outcomes, judge_values
from .running import Found, run_file

__all__ = ["as_text", "check_class", "check_file", "file_of", "is_line", "verdict_of"]

KEPT = ".checked.jsonl"  # in the class's folder: what is already checked


def file_of(chapter: str, folder: Path) -> Path:
    """Return the file in a folder that has a chapter's answers: ``04*.ipynb`` or ``04*.py``.

    Raises ValueError if there is none or more than one.
    """
    of_chapter(chapter)  # there is one
    files = _files(chapter, folder)
    if len(files) != 1:
        names = ", ".join(path.name for path in files) or "none"
        raise ValueError(
            f"{folder}: expected one file {chapter}*.ipynb or {chapter}*.py, found {names}"
        )
    return files[0]


def _files(chapter: str, folder: Path) -> list[Path]:
    files = [*folder.glob(f"{chapter}*.ipynb"), *folder.glob(f"{chapter}*.py")]
    return sorted(path for path in files if path.is_file())


def check_file(chapter: str, file: Path) -> list[Verdict]:
    """Check the answers to a chapter's exercises.

    Parameters
    ----------
    chapter
        Its number, ``"04"``.
    file
        A notebook or a Python file that makes the functions and the values asked for, by their
        names. It runs in a process of its own, in its folder.

    Returns
    -------
    list of Verdict
        One an exercise, in their order.

    Raises
    ------
    ValueError
        There is no such chapter or file, or the file is no notebook.
    """
    asked = of_chapter(chapter)
    if not file.is_file():
        raise ValueError(f"{file}: there is no such file")
    functions = [one for one in asked if isinstance(one, FunctionExercise)]
    values = [one.name for one in asked if isinstance(one, ValueExercise)]
    if file.suffix == ".ipynb":
        _check_notebook(file)
    outcome_of_run = run_file(file, [call_of(one) for one in functions], values)
    return [verdict_of(one, outcome_of_run) for one in asked]


def _check_notebook(file: Path) -> None:
    try:
        json.loads(file.read_text(encoding="utf-8"))["cells"]
    except (ValueError, TypeError, KeyError):
        raise ValueError(f"{file}: is no notebook that can be read") from None


def verdict_of(asked: Exercise, found: Found) -> Verdict:
    if isinstance(asked, ValueExercise) and asked.name in found.values:
        return judge_values(asked, found.values[asked.name])
    if isinstance(asked, FunctionExercise) and asked.name in found.outcomes:
        return judge_outcomes(asked, found.outcomes[asked.name])
    why = f"{asked.name} is not there"
    if found.stuck:
        why = f"{why}, because {found.stuck}"
    elif found.raised:
        place, error = next(iter(found.raised.items()))
        why = f"{why}; {place} raises {error}"
    return Verdict(asked.number, False, 0, asked.points, f"{why}.")


def as_text(verdicts: Sequence[Verdict]) -> str:
    """A line an exercise, and the points."""
    points, of = sum(one.points for one in verdicts), sum(one.of for one in verdicts)
    return "\n".join([*map(str, verdicts), f"{points} of {of} points"])


def check_class(folder: Path, out: Path) -> pd.DataFrame:
    """Check what a class has handed in: a folder a student, in it a file a chapter.

    What is checked is kept in the class's folder. Stopped and started again, or started again after
    more was handed in, only what is new is checked.

    Parameters
    ----------
    folder
        Of the class.
    out
        The table to write, CSV.

    Returns
    -------
    pandas.DataFrame
        A row a student: the points of each exercise of the chapters that anybody handed in, the
        sum, and what is said of those that are not right. Nothing stands where nothing was handed
        in.

    Raises
    ------
    ValueError
        Nobody has handed in anything, or another process checks this class.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: expected a folder that has a folder a student")
    check_target(out)
    tasks = [
        (student.name, chapter, file_of(chapter, student))
        for student in sorted(folder.iterdir())
        if student.is_dir() and not student.name.startswith(".")
        for chapter in CHAPTERS
        if _files(chapter, student)
    ]
    if not tasks:
        raise ValueError(f"{folder}: no folder in it has a file like 04_kalman.ipynb")
    head = json.dumps({"code": [code_hash(name) for name in _judges()]}) + "\n"
    now = []
    with KeptLines(folder / KEPT, head, is_line) as lines:
        done = {(line["student"], line["chapter"], line["hash"]): line for line in _read(lines)}
        for student, chapter, file in tqdm(tasks, unit="file", disable=None):
            key = (student, chapter, hash_files([file], file.parent))
            if key not in done:
                verdicts = [one._asdict() for one in check_file(chapter, file)]
                done[key] = {
                    "student": student,
                    "chapter": chapter,
                    "hash": key[2],
                    "verdicts": verdicts,
                }
                lines.add_line(json.dumps(done[key]))
            now.append(done[key])
    table = _table(now)
    write_whole(out, table.to_csv(index=False, lineterminator="\n"))
    return table


def _judges() -> list[str]:
    """The modules that decide what is said. Those of the chapters are imported when they are asked
    for, where a hash of this module does not see them.
    """
    return [__name__, *(f"{exercises.__name__}.{name}" for name in CHAPTERS.values())]


def is_line(_: int, text: str) -> bool:
    try:
        return {"student", "chapter", "hash", "verdicts"} <= set(json.loads(text))
    except (ValueError, TypeError):
        return False


def _read(kept: KeptLines) -> list[dict]:
    return list(map(json.loads, kept.lines()))


def _table(lines: Sequence[dict]) -> pd.DataFrame:
    rows: dict[str, dict] = {}
    for line in lines:
        row = rows.setdefault(line["student"], {"said": []})
        for verdict in (Verdict(**one) for one in line["verdicts"]):
            row[verdict.number] = verdict.points
            if not verdict.right:
                row["said"].append(str(verdict))
    numbers = sorted({name for row in rows.values() for name in row} - {"said"})
    table = pd.DataFrame(
        [
            {
                "student": student,
                **{number: row.get(number) for number in numbers},
                "points": sum(row.get(number, 0) for number in numbers),
                "said": " ".join(row["said"]),
            }
            for student, row in rows.items()
        ]
    )
    return table.astype({number: "Int64" for number in numbers})
