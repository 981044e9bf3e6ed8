"""What the chapters' solutions say, for tests that compute their numbers anew."""

import json
import re
from functools import cache
from pathlib import Path

from workbench.course.exercises import exercise

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


@cache
def solution(number: str) -> str:
    """The solution's text, with single spaces."""
    (file,) = NOTEBOOKS.glob(f"{number[:2]}_*.ipynb")
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    text = "\n\n".join("".join(cell["source"]) for cell in cells)
    label = exercise(number).label
    (found,) = re.findall(rf"```{{solution}} {label}\n(.*?)\n```\n", text, re.DOTALL)
    return " ".join(found.split())


def says(number: str, *sentences: str) -> None:
    """The solution has each of these, to the digit."""
    for sentence in sentences:
        assert sentence in solution(number), sentence
