"""Files that students hand in: one chapter's, or those of a whole class."""

from __future__ import annotations

import hashlib
import io
import json
import re
import tokenize
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from tqdm import tqdm

from trinolab.files.journal import Journal
from trinolab.files.outputs import check_target, write_whole

from ..provenance import code_hash
from . import exercises
from .exercise import Exercise, FunctionExercise, ValueExercise
from .exercises import CHAPTERS, of_chapter
from .grading import Verdict, call_of, judge_outcomes, judge_values
from .plain import printable
from .predictions import KEPT as PREDICTIONS
from .predictions import first_guesses
from .running import Found, run_file

SUFFIXES = (".ipynb", ".py")
KEPT = ".checked.jsonl"  # in the class's folder: what is already checked
LARGEST = 20 * 2**20  # bytes of a file that is read
# Canvas' name of a file: the student's, late or not, numbers of the student and of what was handed in
CANVAS = re.compile(
    r"(?P<student>[^_]+)_(?:LATE_)?(?P<id>\d{2,})_\d{2,}_(?P<name>.+)", re.DOTALL | re.IGNORECASE
)
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet computes what begins so


class Submission(NamedTuple):
    """A file of a student's.

    Parameters
    ----------
    student
        As the table names the student.
    chapter
        Of which it has the answers; None where its name does not say so.
    path
        The file; None where a student has handed in none.
    beside
        The student's folder; None if there is none.
    wrong
        Why it cannot be read, in words; None if nobody has seen that yet.
    """

    student: str
    chapter: str | None
    path: Path | None
    beside: Path | None
    wrong: str | None = None


def file_of(chapter: str, folder: Path) -> Path:
    """Return the file in a folder that has a chapter's answers: ``04*.ipynb`` or ``04*.py``.

    Raises ValueError if there is none or more than one.
    """
    of_chapter(chapter)  # there is one
    every = [*folder.glob(f"{chapter}*.ipynb"), *folder.glob(f"{chapter}*.py")]
    files = sorted(path for path in every if path.is_file())
    if len(files) != 1:
        names = ", ".join(path.name for path in files) or "none"
        raise ValueError(
            f"{folder}: expected one file {chapter}*.ipynb or {chapter}*.py, found {names}"
        )
    return files[0]


def check_file(chapter: str, file: Path) -> list[Verdict]:
    """Check the answers to a chapter's exercises.

    Parameters
    ----------
    chapter
        Its number, ``"04"``.
    file
        A notebook or a Python file that makes the functions and the values asked for, by their
        names. It runs in a process of its own, in a copy of its folder.

    Returns
    -------
    list of Verdict
        One an exercise, in their order.

    Raises
    ------
    ValueError
        There is no such chapter or file, or the file is no notebook that can be read.
    """
    alone = CANVAS.fullmatch(file.name) is not None  # what lies beside it is others'
    return _checked(chapter, file, None if alone else file.parent)


def _checked(chapter: str, file: Path, beside: Path | None) -> list[Verdict]:
    asked = of_chapter(chapter)
    if not file.is_file():
        raise ValueError(f"{file}: there is no such file")
    cells = cells_of(file)
    functions = [one for one in asked if isinstance(one, FunctionExercise)]
    values = [one.name for one in asked if isinstance(one, ValueExercise)]
    found = run_file(cells, [call_of(one) for one in functions], values, beside)
    guesses = {} if beside is None else first_guesses(beside)
    return [verdict_of(one, found, guesses.get(one.number)) for one in asked]


def cells_of(file: Path) -> list[tuple[str, str]]:
    """The pieces of code of a notebook or a Python file, each with its place.

    A notebook may be of an older format, and either may begin with a byte-order mark.

    Raises
    ------
    ValueError
        Says what is wrong with the file.
    """
    size = file.stat().st_size
    if size > LARGEST:
        raise ValueError(f"{file}: has {size / 2**20:.0f} MB, more than {LARGEST // 2**20}")
    with file.open("rb") as stream:
        content = stream.read(LARGEST + 1)
    if file.suffix.lower() != ".ipynb":
        return [(file.name, _python_text(file, content))]
    try:
        notebook = json.loads(content.decode("utf-8-sig"))
        sources = list(_code(notebook))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ValueError(f"{file}: is no notebook that can be read") from None
    return [(f"cell {k}", source) for k, source in enumerate(sources, start=1)]


def _python_text(file: Path, content: bytes) -> str:
    try:
        encoding, _ = tokenize.detect_encoding(io.BytesIO(content).readline)
        text = content.decode(encoding)
    except (SyntaxError, ValueError, LookupError):
        raise ValueError(f"{file}: is no text that can be read; save it as UTF-8") from None
    return text.replace("\r\n", "\n")


def _code(notebook: dict) -> Iterator[str]:
    """The code cells of a notebook, of the formats 3 and 4."""
    sheets = [notebook] if "cells" in notebook else notebook["worksheets"]
    for sheet in sheets:
        for cell in sheet["cells"]:
            if cell["cell_type"] == "code":
                source = cell["source"] if "source" in cell else cell["input"]
                if not isinstance(source, str | list):
                    raise TypeError("source: expected text")
                yield "".join(source)


def verdict_of(asked: Exercise, found: Found, guess: Mapping | None = None) -> Verdict:
    """Judge an answer by what became of its file, and by the first guess where one was kept."""
    if isinstance(asked, ValueExercise) and asked.name in found.values:
        return judge_values(asked, found.values[asked.name], guess)
    if isinstance(asked, FunctionExercise) and asked.name in found.outcomes:
        return judge_outcomes(asked, found.outcomes[asked.name])
    why = f"{asked.name} is not there"
    if found.stuck:
        why = f"{why}, because {found.stuck}"
    elif found.raised:
        place, error = next(iter(found.raised.items()))
        why = f"{why}; {place} raises {error}"
    return Verdict(asked.number, False, 0, asked.points, printable(f"{why}."))


def as_text(verdicts: Sequence[Verdict]) -> str:
    """A line per exercise, and the points."""
    points, of = sum(one.points for one in verdicts), sum(one.of for one in verdicts)
    return "\n".join([*map(str, verdicts), f"{points} of {of} points"])


def handed_in(folder: Path, table: Path) -> list[Submission]:
    """Return what a class has handed in: folders of students, as Moodle makes them as well, and files
    that lie in no folder, by the names that Canvas gives them.

    Nothing is left out: what cannot be read is there with the reason.
    """
    submissions: list[Submission] = []
    loose = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == "__MACOSX" or path == table:
            continue
        if path.is_symlink():
            wrong = f"{path.name} cannot be read: it is a link"
            submissions.append(Submission(_named(path), None, path, None, wrong))
        elif path.is_dir():
            try:
                submissions += _of_folder(path)
            except (OSError, RecursionError):
                wrong = f"{path.name} cannot be read"
                submissions.append(Submission(path.name, None, path, None, wrong))
        elif path.name != "points.csv":
            loose.append(path)
    return submissions + _of_loose(loose)


def _of_folder(folder: Path) -> list[Submission]:
    by_chapter: dict[str, list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith((".", "__")) for part in path.relative_to(folder).parts)
        chapter = _chapter_of(path)
        if chapter is not None and not hidden:
            by_chapter.setdefault(chapter, []).append(path)
    if not by_chapter:
        wrong = "no file like 04_kalman.ipynb is in the folder"
        return [Submission(folder.name, None, None, None, wrong)]
    return [
        _one_of(folder.name, chapter, paths, folder)
        for chapter, paths in sorted(by_chapter.items())
    ]


def _of_loose(paths: Sequence[Path]) -> list[Submission]:
    """Files in no folder: the student is whom Canvas names, or else the file."""
    matches = {path: CANVAS.fullmatch(path.name) for path in paths}
    pairs = {(match["student"], match["id"]) for match in matches.values() if match}
    names = Counter(student for student, _ in pairs)
    by_task: dict[tuple[str, str | None], list[Path]] = {}
    for path, match in matches.items():
        student = match["student"] if match else _named(path)
        if match and names[student] > 1:
            student = f"{student}_{match['id']}"
        by_task.setdefault((student, _chapter_of(path)), []).append(path)
    return [_one_of(student, chapter, files, None) for (student, chapter), files in by_task.items()]


def _named(path: Path) -> str:
    return path.stem if path.suffix.lower() in SUFFIXES else path.name


def _chapter_of(path: Path) -> str | None:
    """The chapter that a file's name says; None if it says none."""
    match = CANVAS.fullmatch(path.name)
    name = match["name"] if match else path.name
    says = name[:2] in CHAPTERS and not name[2:3].isdigit()
    return name[:2] if says and path.suffix.lower() in SUFFIXES else None


def _one_of(
    student: str, chapter: str | None, paths: Sequence[Path], beside: Path | None
) -> Submission:
    """The file of a student with a chapter's answers, of all whose names say so."""
    path = paths[0]
    whole_way = [path, *(place for place in path.parents if beside in place.parents)]
    names = ", ".join(one.name for one in paths)
    wrong = None
    if chapter is None:
        wrong = "its name does not say the chapter, as 04_kalman.ipynb does"
    elif len(paths) > 1:
        wrong = f"these are {len(paths)} files, and one counts; remove the rest"
    elif any(place.is_symlink() for place in whole_way):
        wrong = "it is a link"
    elif not path.is_file():
        wrong = "it is no file"
    why = None if wrong is None else f"{names} cannot be read: {wrong}"
    return Submission(student, chapter, path, beside, why)


def check_class(folder: Path, out: Path) -> pd.DataFrame:
    """Check what a class has handed in: a folder per student, in it a file per chapter; or files alone,
    as `handed_in` finds them.

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
        A row per student: the points of each exercise of the chapters that anybody handed in, the
        sum, and what is said of those that are not right. Nothing stands where nothing was handed
        in.

    Raises
    ------
    ValueError
        Nobody has handed in anything, or another process checks this class.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: expected a folder that has a folder per student")
    check_target(out)
    submissions = handed_in(folder, out)
    if not any(it.chapter for it in submissions):
        raise ValueError(f"{folder}: no folder in it has a file like 04_kalman.ipynb")
    code = json.dumps({"code": [code_hash(name) for name in _judges()]})
    now = []
    with Journal(folder / KEPT, code + "\n", is_line) as lines:
        done = {_key_of(line): line for line in map(json.loads, lines.lines())}
        for submission in tqdm(submissions, unit="file", disable=None):
            line = _line_of(submission, done)
            if line["hash"] and _key_of(line) not in done:
                lines.add_line(json.dumps(line))
                done[_key_of(line)] = line
            now.append(line)
    table = _table(now)
    write_whole(out, table.to_csv(index=False, lineterminator="\n"))
    return table


def _key_of(line: Mapping) -> tuple[str, str, str]:
    return line["student"], line["chapter"], line["hash"]


def _line_of(submission: Submission, done: Mapping[tuple, dict]) -> dict:
    """What is kept of a file; one that cannot be read has no hash, and is looked at again next time."""
    student, chapter, path, beside, wrong = submission
    line: dict = {"student": student, "chapter": chapter, "hash": "", "verdicts": []}
    if wrong is None:
        assert chapter is not None
        assert path is not None
        try:
            digest = _hash(path, beside)
            if (student, chapter, digest) in done:
                return done[student, chapter, digest]
            verdicts = _checked(chapter, path, beside)
            return line | {"hash": digest, "verdicts": [one._asdict() for one in verdicts]}
        except Exception as error:  # whatever one file is, the class goes on
            reason = str(error).removeprefix(f"{path}: ") or type(error).__name__
            wrong = f"{path.name} cannot be read: {reason}"
    asked = of_chapter(chapter) if chapter else ()
    verdicts = [Verdict(one.number, False, 0, one.points, "cannot be read") for one in asked]
    return line | {"wrong": printable(wrong), "verdicts": [one._asdict() for one in verdicts]}


def _hash(path: Path, beside: Path | None) -> str:
    """Of all that a verdict is made of: the file, and the first guesses beside it."""
    digest = hashlib.sha256()
    places = [path] if beside is None else [path, beside / PREDICTIONS]
    for place in places:
        if place.is_file() and place.stat().st_size <= LARGEST:
            digest.update(hashlib.sha256(place.read_bytes()).digest())
    return digest.hexdigest()


def _judges() -> list[str]:
    """The modules that decide what is said. Those of the chapters are imported when they are asked
    for, where a hash of this module does not see them.
    """
    return [__name__, *(f"{exercises.__name__}.{name}" for name in CHAPTERS.values())]


def is_line(_: int, text: str) -> bool:
    """Whether a kept line is whole."""
    try:
        line = json.loads(text)
        if not {"student", "chapter", "hash", "verdicts"} <= set(line):
            return False
        return all(isinstance(Verdict(**one).points, int) for one in line["verdicts"])
    except (ValueError, TypeError, RecursionError):
        return False


def _table(lines: Sequence[dict]) -> pd.DataFrame:
    rows: dict[str, dict] = {}
    for line in lines:
        row = rows.setdefault(line["student"], {"said": []})
        if line.get("wrong"):
            row["said"].append(line["wrong"])
        for verdict in (Verdict(**one) for one in line["verdicts"]):
            row[verdict.number] = verdict.points
            if not verdict.right and not line.get("wrong"):
                row["said"].append(str(verdict))
    numbers = sorted({name for row in rows.values() for name in row} - {"said"})
    table = pd.DataFrame(
        [
            {
                "student": _field(student),
                **{number: row.get(number) for number in numbers},
                "points": sum(row.get(number, 0) for number in numbers),
                "said": _field(" ".join(row["said"])),
            }
            for student, row in sorted(rows.items())
        ]
    )
    return table.astype({number: "Int64" for number in numbers})


def _field(text: str) -> str:
    """A text as a field that a spreadsheet shows and does not compute."""
    clean = " ".join(map(printable, text.split(" ")))
    return f"'{clean}" if clean.lstrip().startswith(FORMULA) else clean
