"""Print the lines of code of the package, the workbench, the tables' scripts and the tests: no blank
lines, comments or docstrings.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {
    "trinolab": "trinolab",
    "workbench": "book",
    "scripts of tables": "data/tables",
    "tests": "tests",
}
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


def size(folder):
    """The lines of code below a folder."""
    paths = (ROOT / folder).rglob("*.py")
    return sum(lines_of_code(path.read_text(encoding="utf-8")) for path in paths)


if __name__ == "__main__":
    print("lines of code:", ", ".join(f"{name} {size(of):,}" for name, of in FOLDERS.items()))
