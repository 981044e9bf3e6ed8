"""The students' book has no solution, no teacher's note and no exam, and all else."""

import json
import re
import zipfile

import nbformat
import pytest
from chapters import LESSONS, NOTEBOOKS
from pages import built

from workbench.course.texts import texts_of
from workbench.pages import coursezip, studentbook
from workbench.pages.build import GENERATED
from workbench.pages.template import NUMBERS
from workbench.sweep.notebook import read_notebook

pytestmark = built


def sentences_of_solutions():
    """A sentence of each solution that is long enough to stand nowhere else."""
    for path in LESSONS:
        for one in texts_of(read_notebook(path), path.name):
            words = [
                line
                for line in one.solution.splitlines()
                if len(line) > 60 and not re.search(r"[$`*\[{<&\"'_\\]", line)
            ]
            if words:
                yield one.number, words[0]


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("student") / "book"
    studentbook.write_sources(folder)
    return folder


def test_the_sources_hold_no_solution_and_keep_the_rest(sources):
    names = {path.name for path in sources.glob("notebooks/*.ipynb")}
    assert names == {path.name for path in NOTEBOOKS}
    for path in NOTEBOOKS:
        before, after = (
            nbformat.read(one, as_version=4).cells
            for one in (path, sources / "notebooks" / path.name)
        )
        code = [
            [cell.source for cell in book if cell.cell_type == "code"] for book in (before, after)
        ]
        assert code[0] == code[1]
        text = ["\n".join(cell.source for cell in book) for book in (before, after)]
        assert "{solution}" not in text[1]
        assert text[0].count("{hint}") == text[1].count("{hint}")


def test_no_page_of_the_teachers_is_left(sources):
    toc = (sources / "_toc.yml").read_text(encoding="utf-8")
    assert "book/lab_sheet" in toc
    assert "teaching" not in toc
    for gone in ("book/teaching", "data/exercises"):
        assert not list(sources.glob(gone))
    assert "course" not in json.loads((sources / NUMBERS).read_text(encoding="utf-8"))
    assert not [path for path in sources.glob("book/*.md") if "`teaching/" in path.read_text()]
    assert (sources / "_build" / "generated" / "api").exists() == (GENERATED / "api").exists()


@pytest.mark.heavy
def test_the_zip_is_whole_and_holds_no_solution(tmp_path):
    target = tmp_path / "student.zip"
    assert coursezip.main(["student", "--out", str(target)]) == 0
    solutions = dict(sentences_of_solutions())
    assert len(solutions) > 20
    with zipfile.ZipFile(target) as whole:
        names = whole.namelist()
        assert {"README.md", "environment.txt", "book/index.html"} <= set(names)
        assert [name for name in names if name.endswith(".whl")]
        for path in NOTEBOOKS:
            assert {f"chapters/{path.name}", f"book/notebooks/{path.stem}.html"} <= set(names)
        for name in names:
            if name.endswith((".html", ".ipynb", ".md", ".js", ".json", ".txt")):
                text = " ".join(whole.read(name).decode("utf-8", "replace").split())
                assert not [number for number, words in solutions.items() if words in text], name
                assert "teaching/exam" not in text, name
        assert "exercises/kalman" not in whole.read("book/_modules/index.html").decode()


def test_without_a_book_it_says_what_to_do(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(coursezip, "HTML", tmp_path)
    assert coursezip.main(["teacher", "--out", str(tmp_path / "teacher.zip")]) == 2
    assert "run `make book` first" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.zip"))
