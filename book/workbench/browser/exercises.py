"""What a chapter's page needs so that its exercises can be answered there: each one's beginning,
and the line that checks it. The solutions are no part of it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..course.exercises import CHAPTERS, of_chapter
from ..course.stubs import checked, stub


def exercises_of(chapter: Path) -> list[dict[str, Any]]:
    """The exercises of a chapter as the page's script takes them; none of a study."""
    number = chapter.stem.partition("_")[0]
    if number not in CHAPTERS:
        return []
    return [
        {
            "number": one.number,
            "title": one.title,
            "label": one.label,
            "name": one.name,
            "source": stub(one),
            "check": checked(one),
        }
        for one in of_chapter(number)
    ]


def with_exercises(page: str, exercises: list[dict[str, Any]]) -> str:
    """A chapter's page with a place for the answer to each of its exercises.

    Raises
    ------
    ValueError
        If an exercise is not on the page.
    """
    if not exercises:
        return page
    for one in exercises:
        if f'id="{one["label"]}"' not in page:
            raise ValueError(
                f"exercise {one['number']}: {one['label']} is not on its chapter's page"
            )
    data = json.dumps(exercises).replace("</", "<\\/")
    added = (
        f'<script type="application/json" id="browser-exercises">{data}</script>\n'
        '<script type="module" src="../_browser/static/exercises.js"></script>\n'
    )
    return page.replace("</head>", f"{added}</head>", 1)
