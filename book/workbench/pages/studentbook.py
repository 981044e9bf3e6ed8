"""The book for students: built from the same sources without solutions, teacher's notes and exam.

    python -m workbench.pages.studentbook

builds it into ``_build/student/_build/html`` from the outputs that `make book` has stored: no
chapter runs again.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import yaml

from trinolab.files.outputs import write_whole

from ..course.texts import without_solutions
from ..sweep.notebook import read_notebook
from .build import BUILD, BUILD_COMMAND, CACHE, GENERATED, HTML, INDEX, ROOT, chapters
from .template import NUMBERS

STUDENT = BUILD / "student"
STUDENT_HTML = STUDENT / "_build" / "html"
TEACHING = "book/teaching/"
# Of the modules with the solutions no page shows the source.
KEPT_BACK = "workbench.course.exercises"


def main() -> int:
    """Build the students' book, and return the exit code."""
    if not (HTML / "index.html").exists():
        print("no built pages: run `make book` first", file=sys.stderr)
        return 2
    print("building the students' pages", flush=True)
    return 0 if build_student_book() else 1


def build_student_book() -> bool:
    """Build the students' pages, with every warning an error; return whether they are there."""
    shutil.rmtree(STUDENT, ignore_errors=True)
    write_sources(STUDENT)
    command = [*BUILD_COMMAND, "--pages", str(STUDENT)]
    if subprocess.run(command, cwd=STUDENT, stdin=subprocess.DEVNULL).returncode != 0:
        return False
    write_whole(STUDENT_HTML / "index.html", INDEX)
    return True


def write_sources(folder: Path) -> None:
    """Write what the students' pages are built from into a folder of their own."""
    kept_back = shutil.ignore_patterns("teaching", "workbench", "satellites", "lab", "__pycache__")
    shutil.copytree(ROOT / "book", folder / "book", ignore=kept_back)
    shutil.copytree(GENERATED, folder / "_build" / "generated")
    numbers = json.loads((GENERATED / NUMBERS.name).read_text(encoding="utf-8"))
    del numbers["course"]  # wrong answers with what the grader says
    write_whole(folder / NUMBERS, json.dumps(numbers))
    shutil.copytree(ROOT / "data", folder / "data", ignore=shutil.ignore_patterns("exercises"))
    shutil.copytree(CACHE, folder / "_build" / CACHE.name)
    for path in chapters():
        place = folder / path.relative_to(ROOT)
        place.parent.mkdir(exist_ok=True)
        write_whole(place, nbformat.writes(without_their_solutions(path)))
    for page in (folder / "book").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        write_whole(page, text.replace("{doc}`teaching/index`", "The teacher's part of the book"))
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    write_whole(folder / "_toc.yml", yaml.safe_dump(contents(toc), sort_keys=False))
    config = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    sphinx = config["sphinx"]["config"]
    sphinx["extensions"].append("workbench.pages.studentbook")
    sphinx["html_copy_source"] = False
    write_whole(folder / "_config.yml", yaml.safe_dump(config, sort_keys=False))


def without_their_solutions(path: Path) -> Any:
    """A chapter whose texts have lost their solutions. Its code, by which the cache knows it, stays."""
    notebook = read_notebook(path)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = without_solutions(cell.source, path.name)
    return notebook


def contents(toc: dict[str, Any]) -> dict[str, Any]:
    """A table of contents without the teacher's pages."""
    parts = [
        {
            **part,
            "chapters": [one for one in part["chapters"] if not one["file"].startswith(TEACHING)],
        }
        for part in toc["parts"]
    ]
    return {**toc, "parts": [part for part in parts if part["chapters"]]}


def setup(app: Any) -> dict[str, bool]:
    """As an extension of Sphinx it keeps the sources of the solutions back."""
    app.connect("viewcode-find-source", _keep_back)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _keep_back(app: Any, module: str) -> tuple[str, dict[str, Any]] | None:
    """What viewcode shows of a module: of those with solutions nothing, of others what it finds."""
    return ("", {}) if module.startswith(KEPT_BACK) else None


if __name__ == "__main__":
    sys.exit(main())
