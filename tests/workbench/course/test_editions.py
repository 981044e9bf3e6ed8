"""The course as a zip: each exercise stands in its chapter, and students get no solution."""

import io
import json
import zipfile
from contextlib import redirect_stdout

import nbformat
import pytest
from chapters import NOTEBOOKS

from workbench.cli import main as trinolab
from workbench.course.editions import (
    chapter_file,
    exercise_notebook,
    exercises_of,
    main,
    self_contained,
    write_edition,
)
from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.course.stubs import solved, stub
from workbench.course.texts import texts_of, without_solutions
from workbench.sweep.notebook import read_notebook, run_notebook

FORM = """\
## Exercises

```{exercise} 4.2 Write it yourself: a filter of one number
:label: ex-kalman-write
:nonumber:
Write a function.

Check it with `check("04.2", filter_number)`.
```

```{hint} First hint to 4.2
:class: dropdown
What grows?
```

```{hint} Second hint to 4.2
:class: dropdown
The variance.
```

```{solution} ex-kalman-write
:class: dropdown
    return means

Because.
```

## Takeaways
"""


def chapter_of(text):
    return nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(text)])


def test_an_exercise_is_read_from_its_chapter():
    (one,) = texts_of(chapter_of(FORM), "04.ipynb")
    assert one[:4] == ("04.2", "write", "A filter of one number", "ex-kalman-write")
    assert one.statement.startswith("Write a function.\n\nCheck it")
    assert one.hints == ("What grows?", "The variance.")
    assert one.solution == "    return means\n\nBecause."
    left = without_solutions(FORM, "04.ipynb")
    assert left.endswith("The variance.\n```\n\n## Takeaways")
    assert without_solutions(left, "04.ipynb") == left
    with pytest.raises(ValueError, match=r"04\.ipynb: the chapter and .* do not agree"):
        exercise_notebook("04", chapter_of(FORM), "04.ipynb", "student", {})


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("4.2 Write it yourself: a", "Write it: a", "expected a title as in '4.2 Pencil"),
        ("{hint} First hint to 4.2", "{hint} First hint to 4.3", "4.2: expected {hint} First"),
        ("{solution} ex-kalman-write", "{solution} ex-other", "found .* {solution} ex-other"),
        ("What grows?\n", "", "exercise 4.2: its hint is empty"),
        ("Because.\n```", "Because.", "its closing ``` is not there"),
        ("```{exercise}", "```{note}", "expected an {exercise} before any hint"),
    ],
)
def test_a_broken_form_is_said_in_a_line(old, new, says):
    with pytest.raises(ValueError, match=says) as caught:
        texts_of(chapter_of(FORM.replace(old, new)), "04.ipynb")
    assert str(caught.value).startswith("04.ipynb: ")
    assert "\n" not in str(caught.value)


def test_nothing_leads_out_of_the_zip():
    text = "See {ref}`26 <claim-26>`, a {term}`rig`, [Eq. 6](../book/equations.md#equation-6), {glue:text}`n:.0f`."
    assert self_contained(text) == "See 26, a rig, Eq. 6, {glue:text}`n:.0f`."


@pytest.fixture(scope="module")
def editions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("editions")
    for edition in ("student", "teacher"):
        with redirect_stdout(io.StringIO()):
            assert main([edition, "--out", str(folder / f"{edition}.zip")]) == 0
        with zipfile.ZipFile(folder / f"{edition}.zip") as whole:
            whole.extractall(folder / edition)
    return folder


def test_the_same_sources_give_the_same_bytes(tmp_path):
    for name in ("one.zip", "again.zip"):
        write_edition("teacher", tmp_path / name, chapters=["04"])
    assert (tmp_path / "again.zip").read_bytes() == (tmp_path / "one.zip").read_bytes()


@pytest.mark.parametrize("edition", ["student", "teacher"])
def test_an_edition_is_whole(editions, edition):
    folder = editions / edition
    for path in sorted(folder.glob("*/*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
        assert "../book/" not in text, path
        assert "{ref}" not in text, path
    assert {path.name for path in folder.glob("chapters/*")} == {path.name for path in NOTEBOOKS}
    assert len(list(folder.glob("exercises/*.ipynb"))) == len(CHAPTERS)
    for name in ("README.md", "environment.txt", "lab/trinolab-numbers/static/remoteEntry.js"):
        assert (folder / name).is_file(), name


def lines_of(text):
    """The lines of a text that say enough to be known again."""
    return {line.strip() for line in text.splitlines() if len(line.strip()) > 25}


def handed_out(folder, chapter):
    """The lines of a chapter's exercises: of their notebook, and of the chapter behind its heading."""
    texts = []
    for part in ("exercises", "chapters"):
        (path,) = folder.glob(f"{part}/{chapter}_*.ipynb")
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        texts.append("\n".join("".join(cell["source"]) for cell in cells))
    exercises, whole = texts
    assert whole.count("\n## Exercises\n") == 1
    return lines_of(exercises + whole.partition("\n## Exercises\n")[2])


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_students_get_no_line_of_a_solution(editions, chapter):
    students = handed_out(editions / "student", chapter)
    teachers = handed_out(editions / "teacher", chapter)
    path = chapter_file(chapter)
    for asked, text in exercises_of(chapter, read_notebook(path), path.name):
        secret = lines_of(text.solution)
        if isinstance(asked, FunctionExercise):
            secret |= lines_of(solved(asked))
        # what the task itself says is no secret
        secret -= lines_of(text.statement) | lines_of(stub(asked))
        assert secret & students == set(), asked.number
        assert secret & lines_of(solved(asked)) <= teachers, asked.number


@pytest.mark.parametrize(
    "chapter", [pytest.param(one, marks=[pytest.mark.heavy] * (one != "04")) for one in CHAPTERS]
)
def test_an_untouched_notebook_has_no_point_and_the_teachers_all(
    editions, chapter, capsys, monkeypatch
):
    said = {}
    for edition in ("student", "teacher"):
        monkeypatch.chdir(editions / edition / "exercises")
        trinolab(["check", chapter])
        said[edition] = capsys.readouterr().out.splitlines()
    *lines, last = said["student"]
    assert last.startswith("0 of ")
    assert len(lines) == len(of_chapter(chapter))
    assert [line for line in lines if "still to be" not in line] == []
    got, _, of = said["teacher"][-1].removesuffix(" points").partition(" of ")
    assert got == of, said["teacher"]


@pytest.mark.heavy
def test_a_chapter_runs_in_a_fresh_folder(editions):
    run = run_notebook(editions / "student" / "chapters" / "02_workspace.ipynb")
    assert run.results["E_t_mm"] > 0


def test_a_mistake_of_the_caller_is_one_line(tmp_path):
    with pytest.raises(ValueError, match="edition: expected one of student, teacher"):
        write_edition("both", tmp_path / "both.zip")
    with pytest.raises(ValueError, match="an edition is made in a checkout"):
        write_edition("student", tmp_path / "one.zip", checkout=tmp_path)
    assert list(tmp_path.iterdir()) == []
