"""The book in an hour: of each chapter one question, one picture and one number, as its notebooks have
them when they are executed.

The text is ``hour.md.j2``. A number or a picture is named by its chapter, and may stand in the lesson or
in the study behind it.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from trinolab.files.outputs import write_together

from ..sweep.notebook import glued, read_notebook

TEMPLATE = "hour.md.j2"


class Picture(NamedTuple):
    """A figure of a chapter: the bytes of its PNG file, and what is said to who does not see it."""

    png: bytes
    alt: str


class Quoted(NamedTuple):
    """What can be quoted of a chapter: values by the names that they are glued with, and figures by
    their labels.
    """

    values: dict[str, Any]
    pictures: dict[str, Picture]


def write_pages(executed: Path, folder: Path) -> None:
    """Write the text and its pictures, from a folder of executed notebooks."""
    text, pictures = text_and_pictures(read_chapters(executed))
    folder.mkdir(parents=True, exist_ok=True)
    files: dict[str | Path, str | bytes] = {folder / "text.md": text + "\n"}
    for label, picture in pictures.items():
        files[folder / f"{label}.png"] = picture.png
    write_together(files)


def read_chapters(executed: Path) -> dict[int, Quoted]:
    """What can be quoted, chapter by chapter. Where a lesson and its study have the same name, it is
    the lesson's.
    """
    chapters: dict[int, Quoted] = {}
    for path in sorted(executed.glob("[0-9][0-9]*.ipynb")):
        values, pictures = chapters.setdefault(int(path.stem[:2]), Quoted({}, {}))
        notebook = read_notebook(path)
        for name, value in glued(notebook).items():
            values.setdefault(name, value)
        for label, picture in _pictures(notebook).items():
            pictures.setdefault(label, picture)
    return chapters


def _pictures(notebook: Any) -> dict[str, Picture]:
    """The figures of an executed notebook that have a label."""
    found = {}
    for cell in notebook.cells:
        about = cell.metadata.get("mystnb", {})
        label = about.get("figure", {}).get("name")
        for output in cell.get("outputs", []):
            png = output.get("data", {}).get("image/png")
            if label is not None and png is not None:
                alt = about.get("image", {}).get("alt", "")
                found[label] = Picture(base64.b64decode(png), alt)
    return found


def text_and_pictures(chapters: Mapping[int, Quoted]) -> tuple[str, dict[str, Picture]]:
    """The text, in MyST, and the pictures that it shows.

    Raises
    ------
    ValueError
        If the text quotes what a chapter does not have; it names both.
    """
    shown: dict[str, Picture] = {}

    def number(chapter: int, name: str, form: str = ".0f") -> str:
        return format(_quoted(chapters, chapter, "values", name), form)

    def words(chapter: int, name: str) -> str:
        return str(_quoted(chapters, chapter, "values", name))

    def picture(chapter: int, label: str, caption: str) -> str:
        shown[label] = _quoted(chapters, chapter, "pictures", label)
        return "\n".join(
            (
                f"```{{figure}} ../_build/generated/hour/{label}.png",
                f":name: hour-{chapter}",
                f":alt: {shown[label].alt}",
                "",
                f"{caption} ({{numref}}`{label}` of the chapter.)",
                "```",
            )
        )

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined
    )
    template = environment.get_template(TEMPLATE)
    return template.render(number=number, words=words, picture=picture), shown


def _quoted(chapters: Mapping[int, Quoted], chapter: int, kind: str, name: str) -> Any:
    """A value or a picture of a chapter."""
    known = getattr(chapters.get(chapter, Quoted({}, {})), kind)
    if name not in known:
        raise ValueError(f"hour: chapter {chapter} has no {name!r} among its {kind}")
    return known[name]
