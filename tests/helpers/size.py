"""Print the lines of code of the package, the workbench, the satellites, the tables' scripts and the
tests: no blank lines, comments or docstrings.
"""

import ast
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


if __name__ == "__main__":
    sizes = dict.fromkeys(KINDS.values(), 0)
    for path in [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]:
        parts = path.relative_to(ROOT).parts
        kind = next(KINDS[name] for name in KINDS if name in parts)
        sizes[kind] += lines_of_code(path.read_text(encoding="utf-8"))
    print("lines of code:", ", ".join(f"{name} {size:,}" for name, size in sizes.items()))
