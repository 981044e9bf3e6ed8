"""Print the lines of code of the package, the workbench, the satellites, the tables' scripts and the
tests (no blank lines, comments or docstrings), and the words of README, chapters and pages; with
``--words`` those of each page.
"""

import ast
import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("trinolab", "book", "data/tables", "tests")
# A part of a module's path and what it counts as; the first that it has.
KINDS = {
    "tests": "tests",
    "trinolab": "trinolab",
    "satellites": "satellites",
    "book": "workbench",
    "tables": "scripts of tables",
}
PAGES = ("README.md", "notebooks/*.ipynb", "book/*.md")
WITH_DOCSTRING = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def lines_of_code(text):
    """The number of lines of a module that are code."""
    docstrings = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, WITH_DOCSTRING) and ast.get_docstring(node, clean=False) is not None:
            docstrings.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") and number not in docstrings
        for number, line in enumerate(text.splitlines(), 1)
    )


def words(path):
    """The number of words of a page without its template's statements, or of a notebook's Markdown cells."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return len(re.sub(r"\{%.*?%\}|\{\{.*?\}\}", "", text).split())
    cells = json.loads(text)["cells"]
    return sum(
        len("".join(cell["source"]).split()) for cell in cells if cell["cell_type"] == "markdown"
    )


def main():
    """Print both sizes."""
    sizes = dict.fromkeys(KINDS.values(), 0)
    for path in [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]:
        parts = path.relative_to(ROOT).parts
        kind = next(KINDS[name] for name in KINDS if name in parts)
        sizes[kind] += lines_of_code(path.read_text(encoding="utf-8"))
    print("lines of code:", ", ".join(f"{name} {size:,}" for name, size in sizes.items()))
    pages = {path: words(path) for pattern in PAGES for path in sorted(ROOT.glob(pattern))}
    if "--words" in sys.argv:
        for path, count in pages.items():
            print(f"{count:7,} {path.relative_to(ROOT)}")
    chapters = sum(count for path, count in pages.items() if path.suffix == ".ipynb")
    print(f"words: chapters {chapters:,}, README and pages {sum(pages.values()) - chapters:,}")


if __name__ == "__main__":
    main()
