"""Files that students hand in: one chapter's, or those of a whole class."""

from __future__ import annotations

import hashlib
import hmac
import io
import json
import os
import re
import secrets
import tokenize
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from tqdm import tqdm

from trinolab.files.fetch import cache_folder
from trinolab.files.kept import KeptLines
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
    return _checked(chapter, file, None if alone else file.parent)[0]


def _checked(
    chapter: str, file: Path, beside: Path | None
) -> tuple[list[Verdict], tuple[str, ...]]:
    """The verdicts, and what the system did not keep from the code."""
    asked = of_chapter(chapter)
    if not file.is_file():
        raise ValueError(f"{file}: there is no such file")
    cells = cells_of(file)
    functions = [one for one in asked if isinstance(one, FunctionExercise)]
    values = [one.name for one in asked if isinstance(one, ValueExercise)]
    found = run_file(cells, [call_of(one) for one in functions], values, beside)
    guesses = {} if beside is None else first_guesses(beside)
    return [verdict_of(one, found, guesses.get(one.number)) for one in asked], found.missing


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
    """A line an exercise, and the points."""
    points, of = sum(one.points for one in verdicts), sum(one.of for one in verdicts)
    return "\n".join([*map(str, verdicts), f"{points} of {of} points"])


def handed_in(folder: Path, table: Path) -> list[Submission]:
    """What a class has handed in: folders of students, as Moodle makes them as well, and files that
    lie in no folder, by the names that Canvas gives them.

    Nothing is left out: what cannot be read is there with the reason.
    """
    everything = sorted(folder.iterdir())
    all_submissions: list[Submission] = []
    loose = []
    for path in everything:
        if path.name.startswith(".") or path.name == "__MACOSX" or path == table:
            continue
        if path.is_symlink():
            wrong = f"{path.name} cannot be read: it is a link"
            all_submissions.append(Submission(_named(path), None, path, None, wrong))
        elif path.is_dir():
            all_submissions += _of_folder(path)
        elif path.name != "points.csv":
            loose.append(path)
    return all_submissions + _of_loose(loose)


def _of_folder(folder: Path) -> list[Submission]:
    student = folder.name
    try:
        files = [
            path
            for path in sorted(folder.rglob("*"))
            if path.suffix.lower() in (".ipynb", ".py")
            and not any(part.startswith((".", "__")) for part in path.relative_to(folder).parts)
        ]
    except (OSError, RecursionError):
        return [Submission(student, None, folder, None, f"{student}: cannot be read")]
    by_chapter: dict[str, list[Path]] = {}
    for path in files:
        match = CANVAS.fullmatch(path.name)
        chapter = _chapter_of(match["name"] if match else path.name)
        if chapter is not None:
            by_chapter.setdefault(chapter, []).append(path)
    if not by_chapter:
        wrong = "no file like 04_kalman.ipynb is in the folder"
        return [Submission(student, None, None, None, wrong)]
    return [
        _one_of(student, chapter, paths, folder) for chapter, paths in sorted(by_chapter.items())
    ]


def _of_loose(paths: Sequence[Path]) -> list[Submission]:
    """Files in no folder: the student is whom Canvas names, or else the file."""
    matches = {path: CANVAS.fullmatch(path.name) for path in paths}
    numbers: dict[str, set[str]] = {}
    for match in matches.values():
        if match:
            numbers.setdefault(match["student"], set()).add(match["id"])
    by_task: dict[tuple[str, str | None], list[Path]] = {}
    for path, match in matches.items():
        student = _named(path)
        if match:
            several = len(numbers[match["student"]]) > 1
            student = f"{match['student']}_{match['id']}" if several else match["student"]
        chapter = _chapter_of(match["name"] if match else path.name)
        if path.suffix.lower() not in (".ipynb", ".py"):
            chapter = None
        by_task.setdefault((student, chapter), []).append(path)
    submissions = []
    for (student, chapter), files in by_task.items():
        if chapter is None:
            names = ", ".join(path.name for path in files)
            wrong = f"{names} cannot be read: its name does not say the chapter, as 04_kalman.ipynb does"
            submissions.append(Submission(student, None, files[0], None, wrong))
        else:
            submissions.append(_one_of(student, chapter, files, None))
    return submissions


def _named(path: Path) -> str:
    return path.stem if path.suffix.lower() in (".ipynb", ".py") else path.name


def _chapter_of(name: str) -> str | None:
    return name[:2] if name[:2] in CHAPTERS and not name[2:3].isdigit() else None


def _one_of(student: str, chapter: str, paths: Sequence[Path], beside: Path | None) -> Submission:
    """The file of a student with a chapter's answers, of all whose names say so."""
    wrong: str | None
    if len(paths) > 1:
        names = ", ".join(path.name for path in paths)
        several = (
            f"{names} cannot be read: these are {len(paths)} files, and one counts; remove the rest"
        )
        return Submission(student, chapter, paths[0], None, several)
    path = paths[0]
    whole_way = [path, *(place for place in path.parents if beside in place.parents)]
    wrong = None
    if any(place.is_symlink() for place in whole_way):
        wrong = f"{path.name} cannot be read: it is a link"
    elif not path.is_file():
        wrong = f"{path.name} cannot be read: it is no file"
    return Submission(student, chapter, path, beside, wrong)


def check_class(folder: Path, out: Path) -> pd.DataFrame:
    """Check what a class has handed in: a folder a student, in it a file a chapter; or files alone,
    as `handed_in` finds them.

    What is checked is kept in the class's folder. Stopped and started again, or started again after
    more was handed in, only what is new is checked. Each line of it has a seal: what somebody else
    has written there is checked anew.

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
        in. Its attribute ``missing`` names what this system does not keep from the students' code.

    Raises
    ------
    ValueError
        Nobody has handed in anything, or another process checks this class.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: expected a folder that has a folder a student")
    check_target(out)
    submissions = handed_in(folder, out)
    if not any(it.chapter for it in submissions):
        raise ValueError(f"{folder}: no folder in it has a file like 04_kalman.ipynb")
    code = json.dumps({"code": [code_hash(name) for name in _judges()]})
    seal = _Seal(code)
    now = []
    missing: set[str] = set()
    with KeptLines(folder / KEPT, code + "\n", seal.is_line) as lines:
        done = {(it["student"], it["chapter"], it["hash"]): it for it in _read(lines)}
        for submission in tqdm(submissions, unit="file", disable=None):
            line, not_kept = _line_of(submission, done)
            missing |= set(not_kept)
            key = (line["student"], line["chapter"], line["hash"])
            if line["hash"] and key not in done:
                lines.add_line(json.dumps(seal.sealed(line)))
                done[key] = line
            now.append(line)
    table = _table(now)
    write_whole(out, table.to_csv(index=False, lineterminator="\n"))
    table.attrs["missing"] = sorted(missing)
    return table


def _line_of(submission: Submission, done: Mapping[tuple, dict]) -> tuple[dict, tuple[str, ...]]:
    """What is kept of a file, and what the system did not keep from its code."""
    student, chapter, path, beside, wrong = submission
    line: dict = {"student": student, "chapter": chapter, "hash": "", "verdicts": []}
    missing: tuple[str, ...] = ()
    if wrong is None:
        assert chapter is not None
        assert path is not None
        try:
            line["hash"] = _hash(path, beside)
            if (student, chapter, line["hash"]) in done:
                return done[student, chapter, line["hash"]], ()
            verdicts, missing = _checked(chapter, path, beside)
            line["verdicts"] = [one._asdict() for one in verdicts]
        except Exception as error:  # whatever one file is, the class goes on
            reason = str(error).removeprefix(f"{path}: ") or type(error).__name__
            wrong = f"{path.name} cannot be read: {reason}"
    if wrong is not None:
        line["hash"] = ""  # looked at again next time
        line["wrong"] = printable(wrong)
        line["verdicts"] = [
            Verdict(one.number, False, 0, one.points, "cannot be read")._asdict()
            for one in (of_chapter(chapter) if chapter else ())
        ]
    return line, missing


def _hash(path: Path, beside: Path | None) -> str:
    """Of all that a verdict is made of: the file, and the first guesses beside it."""
    digest = hashlib.sha256()
    places = [path] if beside is None else [path, beside / PREDICTIONS]
    for place in places:
        if place.is_file() and place.stat().st_size <= LARGEST:
            digest.update(hashlib.sha256(place.read_bytes()).digest())
    return digest.hexdigest()


class _Seal:
    """Marks lines as written here, by a key that lies in the teacher's own folder."""

    def __init__(self, code: str) -> None:
        self._key = _key() + code.encode()

    def sealed(self, line: Mapping) -> dict:
        return {**line, "seal": self._of(line)}

    def is_line(self, number: int, text: str) -> bool:
        if not is_line(number, text):
            return False
        line = json.loads(text)
        seal = str(line.pop("seal", ""))
        return hmac.compare_digest(seal.encode(), self._of(line).encode())

    def _of(self, line: Mapping) -> str:
        text = json.dumps(line, sort_keys=True)
        return hmac.new(self._key, text.encode(), hashlib.sha256).hexdigest()


def _key() -> bytes:
    """The key, which is made once; where it cannot be kept it lasts as long as this process."""
    path = cache_folder() / "seal"
    try:
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(number, "wb") as file:
                file.write(secrets.token_bytes(32))
        return path.read_bytes()
    except OSError:
        return secrets.token_bytes(32)


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


def _read(kept: KeptLines) -> list[dict]:
    lines = list(map(json.loads, kept.lines()))
    return [{name: it for name, it in line.items() if name != "seal"} for line in lines]


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
