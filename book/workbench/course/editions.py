"""The course as a zip, for students and for teachers: ``python -m workbench.course.editions``.

Both are made from the chapters and the modules of exercises. The students' has no solution: the
chapters without theirs, and for each chapter a notebook of exercises with stubs. The teachers' has
the solutions in both.
"""

from __future__ import annotations

import argparse
import copy
import io
import json
import re
import sys
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from trinolab.files.outputs import write_together

from ..sweep.notebook import glued, read_notebook
from .exercise import Exercise
from .exercises import CHAPTERS, of_chapter
from .plan import planned
from .stubs import checked, solved, stub
from .texts import HINTS, KIND_OF, ExerciseText, texts_of, without_solutions

EDITIONS = ("student", "teacher")
CHECKOUT = Path(__file__).resolve().parents[3]
LAB = "trinolab-numbers"  # the extension of JupyterLab that shows the numbers in the text
THE_SAME_DATE = (1980, 1, 1, 0, 0, 0)  # of each file in a zip, so that its bytes stay the same
# What leads out of a notebook: a role of the book, and a link to one of its pages.
ROLE = re.compile(
    r"\{(?:ref|doc|term|numref|cite|cite:t|cite:p)\}`(?:([^`<]*?)\s*<[^`>]*>|([^`]*))`"
)
PAGE = re.compile(r"\[([^\]]*)\]\(\.\./book/[^)\s]*\)")
GLUED = re.compile(r"\{glue:text\}`([^`:]*):?([^`]*)`")
CHAPTER_LINK = re.compile(r"\]\((\d\d[a-z]?_\w+\.ipynb)")


def main(argv: Sequence[str] | None = None) -> int:
    """Write an edition and return the exit code: 2 for a mistake in the input."""
    parser = argparse.ArgumentParser(
        prog="python -m workbench.course.editions", description=(__doc__ or "").partition("\n\n")[0]
    )
    parser.add_argument("edition", choices=EDITIONS)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.zip")
    arguments = parser.parse_args(argv)
    try:
        write_edition(arguments.edition, arguments.out)
    except ValueError as error:
        print(f"{parser.prog} {arguments.edition}: {error}", file=sys.stderr)
        return 2
    print(f"written: {arguments.out}")
    return 0


def write_edition(
    edition: str,
    out: str | Path,
    chapters: Sequence[str] = tuple(CHAPTERS),
    checkout: Path = CHECKOUT,
) -> None:
    """Write the course's notebooks as a zip. The same sources give the same bytes.

    Parameters
    ----------
    edition
        One of `EDITIONS`.
    out
        The zip.
    chapters
        The numbers of the chapters that it gets.
    checkout
        The folder with the notebooks of the chapters, ``book/lab`` and ``environment.txt``.

    Raises
    ------
    ValueError
        An exercise does not stand in its chapter as it should, or a file is missing.
    """
    write_together({out: _zipped(edition_files(edition, chapters, checkout))})


def edition_files(
    edition: str, chapters: Sequence[str] = tuple(CHAPTERS), checkout: Path = CHECKOUT
) -> dict[str, str]:
    """Return the texts of an edition by their places in the zip; as in `write_edition`."""
    if edition not in EDITIONS:
        raise ValueError(f"edition: expected one of {', '.join(EDITIONS)}, got {edition!r}")
    files = {"README.md": _readme(edition)}
    for name in ("environment.txt", f"{LAB}/package.json", f"{LAB}/static/remoteEntry.js"):
        source = checkout / ("book/lab" if name.startswith(LAB) else "") / name
        if not source.is_file():
            raise ValueError(
                f"{source}: is not there; an edition is made in a checkout of trinolab"
            )
        files[f"lab/{name}" if name.startswith(LAB) else name] = source.read_text(encoding="utf-8")
    for chapter in chapters:
        path = chapter_file(chapter, checkout)
        source = read_notebook(path)
        numbers = numbers_of(path, checkout)
        files[f"exercises/{path.name}"] = _text(
            exercise_notebook(chapter, source, path.name, edition, numbers)
        )
        files[f"chapters/{path.name}"] = _text(chapter_notebook(source, path.name, edition))
        for study in sorted(path.parent.glob(f"{chapter}[a-z]_*.ipynb")):
            files[f"chapters/{study.name}"] = _text(
                chapter_notebook(read_notebook(study), study.name, edition)
            )
    return files


def numbers_of(path: Path, checkout: Path = CHECKOUT) -> dict[str, Any]:
    """Return what a lesson and its studies have glued, as far as they have run."""
    numbers: dict[str, Any] = {}
    for executed in sorted((checkout / "_build" / "executed").glob(f"{path.stem[:2]}*.ipynb")):
        numbers |= glued(read_notebook(executed))
    return numbers


def chapter_file(chapter: str, checkout: Path = CHECKOUT) -> Path:
    """Return the notebook of a chapter, by its number; ValueError if there is none."""
    paths = sorted((checkout / "notebooks").glob(f"{chapter}_*.ipynb"))
    if len(paths) != 1:
        raise ValueError(f"{checkout / 'notebooks'}: expected one notebook {chapter}_*.ipynb")
    return paths[0]


def exercises_of(chapter: str, notebook: Any, name: str) -> list[tuple[Exercise, ExerciseText]]:
    """Return a chapter's exercises, each with what its notebook tells of it.

    Raises
    ------
    ValueError
        The module of exercises and the chapter do not agree.
    """
    texts = texts_of(notebook, name)
    exercises = of_chapter(chapter)
    in_chapter = [(one.number, one.kind, one.title, one.label) for one in texts]
    wanted = [(one.number, one.kind, one.title, one.label) for one in exercises]
    if in_chapter != wanted:
        odd = next(
            (one for one in [*in_chapter, *wanted] if one not in in_chapter or one not in wanted),
            "",
        )
        where = "the chapter" if odd in in_chapter else "the module of exercises"
        raise ValueError(
            f"{name}: the chapter and workbench.course.exercises.{CHAPTERS[chapter]} do not "
            f"agree: {odd or 'their order'} is in {where} alone"
        )
    return list(zip(exercises, texts, strict=True))


def chapter_notebook(source: Any, name: str, edition: str) -> Any:
    """Return a chapter for an edition: nothing in it leads out of the zip."""
    notebook = copy.deepcopy(source)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            text = without_solutions(cell.source, name) if edition == "student" else cell.source
            cell.source = self_contained(text)
    return notebook


def self_contained(text: str) -> str:
    """Return markdown whose links to other pages of the book are plain words."""
    return PAGE.sub(r"\1", ROLE.sub(lambda role: role[1] or role[2], text))


def exercise_notebook(
    chapter: str, source: Any, name: str, edition: str, numbers: Mapping[str, Any]
) -> Any:
    """Return the notebook of a chapter's exercises: statements with hints, stubs, checks; for
    teachers the solutions in place of the stubs, and their texts. `numbers` are those that the
    chapter has glued: its texts quote them.
    """
    import nbformat

    heading = source.cells[0].source.splitlines()[0].removeprefix("# ")
    told = exercises_of(chapter, source, name)
    points = sum(asked.points for asked, _ in told)
    markdown, code = nbformat.v4.new_markdown_cell, nbformat.v4.new_code_cell
    intro = (
        f"# Exercises {int(chapter)}: {heading}\n\n"
        f"The chapter: [{heading}](../chapters/{name}). Run each cell with Shift and Enter. "
        f"`check` says what is right, or which mistake it is and where to read. In a shell "
        f"`trinolab check {chapter}` checks this file as a whole; there are {points} points."
    )
    cells = [
        markdown(intro, id=f"exercises-{chapter}"),
        code("from workbench.course import check", id=f"import-{chapter}"),
    ]
    for asked, text in told:
        place = asked.number.replace(".", "-")
        teacher = edition == "teacher"
        cells.append(markdown(_asked(asked, text, numbers), id=f"exercise-{place}"))
        cells.append(code(solved(asked) if teacher else stub(asked), id=f"answer-{place}"))
        cells.append(code(checked(asked), id=f"check-{place}"))
        if teacher:
            solution = f"**Solution to {_shown(asked)}**\n\n{_as_text(text.solution, numbers)}"
            cells.append(markdown(solution, id=f"solution-{place}"))
    return nbformat.v4.new_notebook(cells=cells, metadata=source.metadata)


def _shown(asked: Exercise) -> str:
    return asked.number.removeprefix("0")


def _asked(asked: Exercise, text: ExerciseText, numbers: Mapping[str, Any]) -> str:
    """The statement, and the hints, folded."""
    (kind,) = (words for words, kind in KIND_OF.items() if kind == asked.kind)
    worth = f"{asked.points} points, about {planned()[asked.number].minutes} minutes"
    parts = [f"## {_shown(asked)} {kind}: {asked.title} ({worth})", text.statement]
    for name, hint in zip(HINTS, text.hints, strict=True):
        parts.append(f"````{{hint}} {name} hint\n:class: dropdown\n{hint}\n````")
    return _as_text("\n\n".join(parts), numbers)


def _as_text(text: str, numbers: Mapping[str, Any]) -> str:
    """Markdown that stands beside the chapters, with the numbers of their outputs in it."""

    def number(quoted: re.Match[str]) -> str:
        name, form = quoted.groups()
        if name not in numbers:
            raise ValueError(
                f"{name}: an exercise quotes this number of its chapter, which has not run; "
                f"run `make book` first"
            )
        return format(numbers[name], form)

    text = GLUED.sub(number, self_contained(text))
    return CHAPTER_LINK.sub(r"](../chapters/\1", text)


def _text(notebook: Any) -> str:
    return json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _zipped(files: dict[str, str]) -> bytes:
    """A zip of texts, in the order of their names."""
    store = io.BytesIO()
    with zipfile.ZipFile(store, "w") as whole:
        for name in sorted(files):
            whole.writestr(entry_of(name), files[name])
    return store.getvalue()


def entry_of(name: str) -> zipfile.ZipInfo:
    """An entry of a zip that is the same whenever it is made."""
    entry = zipfile.ZipInfo(name, THE_SAME_DATE)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    return entry


def _readme(edition: str) -> str:
    text = README.replace("{wheel}", f"trinolab-{version('trinolab')}-py3-none-any.whl")
    return text + (FOR_TEACHERS if edition == "teacher" else FOR_STUDENTS)


README = """\
# Three cameras, a rod, and a robot that follows

Twelve chapters that run (`chapters/`), and the exercises of each (`exercises/`). The book to read is `book/index.html`;
it needs no network.

## Install

You need Python 3.11 or later, from python.org, your system or conda. Unpack this zip, open a shell in its folder
(Windows: PowerShell), and type

| | Linux, Mac | Windows |
|---|---|---|
| a place for the packages | `python3 -m venv .venv` | `py -m venv .venv` |
| use it, in each new shell | `. .venv/bin/activate` | `.venv\\Scripts\\Activate.ps1` |

Windows may say that running scripts is disabled. `Set-ExecutionPolicy -Scope Process Bypass` allows it in this shell.

**Small**: the chapters 1 to 10, all exercises and the grader, some 200 MB to fetch:

    python -m pip install "./{wheel}[course]"

**All**: with the robot of the chapters 11 and 12, in the versions with which the book was built, some 500 MB to fetch:

    python -m pip install --require-hashes -r environment.txt
    python -m pip install --no-deps ./{wheel}

The second way needs a system for which each of these versions has a wheel: Linux, Windows on Intel or AMD, and Mac
with an M processor from macOS 14 on. On Windows for ARM processors OpenCV has no wheel: take Python for Intel (the
installer "64-bit"), which runs there as well, and the small way. For a Mac with an Intel processor, or one older than
macOS 13, OpenCV has no wheel that is new enough; conda-forge has one, and then the wheel of this folder needs no more:

    conda create -n trinolab -c conda-forge python=3.12 py-opencv scipy pandas matplotlib jupyterlab ipywidgets \
        myst-nb jinja2 pooch cloudpickle tqdm tomli-w grimp
    conda activate trinolab
    python -m pip install --no-deps ./{wheel}

The small way was tried on Linux, and its wheels were looked up for Windows and Mac; the others are not tried.

## Open

    jupyter lab --LabApp.extra_labextensions_path=lab

opens JupyterLab in a browser. A chapter shows its numbers once it has run (menu Run, Run All Cells): some take a
minute, and longer where a recording has to be rendered the first time.

## Check

In a notebook of `exercises/` run the first cell. A hint opens when you click it. Write your function, or put your
values where the three dots stand, and run the cell below: it says what is right, or which mistake it is and where to
read. For a whole chapter, in a shell:

    cd exercises
    trinolab check 04

Nothing leaves your computer. To look up the solutions in the package is possible, and teaches nothing.
"""

FOR_STUDENTS = """
## Hand in

The notebook of the chapter, under its own name, in a folder with yours: `submissions/ada/04_kalman.ipynb`. Save it
first (Ctrl and S). The points count that `trinolab check` gives to what you hand in. A prediction counts, also a
wrong one, if you have checked it before the run: hand in `predictions.json`, which keeps it, with the notebook.
"""

FOR_TEACHERS = """
## For teachers

In this edition the notebooks have the solutions. Do not hand it out; `make student` makes the one for students.
Students hand in `submissions/<name>/04_kalman.ipynb`, and

    trinolab check --all submissions

makes a table with a row per student: the points of each exercise, and what the grader says to each that is not right.
Each file runs as a program: install bubblewrap first (Linux), or use a container. The book's part *The course*
has plans for lessons, misconceptions, projects and an exam.
"""

if __name__ == "__main__":
    sys.exit(main())
