"""The students' book has no solution, no teacher's note and no exam, and all else."""

import re
import zipfile

import nbformat
import pytest
import yaml
from chapters import LESSONS, NOTEBOOKS

from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.course.texts import texts_of
from workbench.pages import coursezip, studentbook
from workbench.pages.build import GENERATED, HTML
from workbench.sweep.notebook import read_notebook

pytestmark = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)


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
        before = nbformat.read(path, as_version=4)
        after = nbformat.read(sources / "notebooks" / path.name, as_version=4)
        assert [cell.source for cell in before.cells if cell.cell_type == "code"] == [
            cell.source for cell in after.cells if cell.cell_type == "code"
        ]
        text = "\n".join(cell.source for cell in after.cells)
        assert "{solution}" not in text
        assert text.count("{hint}") == sum(cell.source.count("{hint}") for cell in before.cells)


def test_no_page_of_the_teachers_is_left(sources):
    toc = yaml.safe_load((sources / "_toc.yml").read_text(encoding="utf-8"))
    files = [one["file"] for part in toc["parts"] for one in part["chapters"]]
    assert "book/lab_sheet" in files
    assert not [file for file in files if "teaching" in file]
    assert not (sources / "book" / "teaching").exists()
    assert not (sources / "data" / "exercises").exists()
    assert not [path for path in sources.glob("book/*.md") if "`teaching/" in path.read_text()]
    assert (sources / "_build" / "generated" / "api").exists() == (GENERATED / "api").exists()
    assert not list((sources / "_build" / "generated" / "course").glob("*"))


def test_the_source_of_the_solutions_is_kept_back():
    assert studentbook._keep_back(None, "workbench.course.exercises.kalman") == ("", {})
    assert studentbook._keep_back(None, "workbench.course.grading") is None


@pytest.mark.heavy
def test_the_zip_is_whole_and_holds_no_solution(tmp_path):
    target = tmp_path / "student.zip"
    assert coursezip.main(["student", "--out", str(target)]) == 0
    solutions = dict(sentences_of_solutions())
    assert len(solutions) > 20
    functions = [
        one.name for chapter in CHAPTERS for one in of_chapter(chapter) if one.kind == "write"
    ]
    with zipfile.ZipFile(target) as whole:
        names = whole.namelist()
        assert {"README.md", "environment.txt", "book/index.html"} <= set(names)
        assert [name for name in names if name.endswith(".whl")]
        for path in NOTEBOOKS:
            assert f"chapters/{path.name}" in names
            assert f"book/notebooks/{path.stem}.html" in names
        for name in names:
            if not name.endswith((".html", ".ipynb", ".md", ".js", ".json", ".txt")):
                continue
            text = " ".join(whole.read(name).decode("utf-8", "replace").split())
            assert not [number for number, words in solutions.items() if words in text], name
            assert "teaching/exam" not in text, name
        source = whole.read("book/_modules/index.html").decode()
        assert functions[0] not in source
        assert "exercises/kalman" not in source


def test_without_a_book_it_says_what_to_do(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(coursezip, "HTML", tmp_path)
    assert coursezip.main(["teacher", "--out", str(tmp_path / "teacher.zip")]) == 2
    assert "run `make book` first" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.zip"))
