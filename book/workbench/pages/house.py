"""The folders of the packages and the modules at the top of `trinolab`, and what each imports.

    .venv/bin/python -m workbench.pages.house

writes a table of the folders as ``house.md`` into ``_build/generated/api``.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from ..imports import PACKAGES, import_graph
from .reference import first_line

ROOT = Path(__file__).resolve().parents[3]
GENERATED = ROOT / "_build" / "generated" / "api"
NOT_SHOWN = {
    "trinolab",
    "trinolab.__main__",
    "satellites",
    "workbench",
    "workbench.browser",
    "workbench.pages",
}

Graph = dict[str, set[str]]


def rooms() -> Graph:
    """For each room, a folder or a module at the top, the rooms that it imports, wherever the import
    stands.
    """
    imports = import_graph()
    room_of = {module: ".".join(module.split(".")[:2]) for module in imports.modules}
    graph: Graph = {room: set() for room in room_of.values() if room not in NOT_SHOWN}
    for module, room in room_of.items():
        if room in graph:
            imported = {room_of[name] for name in imports.find_modules_directly_imported_by(module)}
            graph[room] |= imported & set(graph) - {room}
    return graph


def is_folder(room: str) -> bool:
    """Whether a room is a folder."""
    package, name = room.split(".")
    return (PACKAGES[package] / name).is_dir()


def table_text() -> str:
    """The folders, as a table in MyST Markdown: what each is, by its docstring, and what it
    imports.
    """
    rows = ["| folder | what it is | imports |", "|---|---|---|"]
    for room, imported in rooms().items():
        if is_folder(room):
            name = room.partition(".")[2]
            by_kind = sorted(imported, key=lambda other: (not is_folder(other), other))
            names = ", ".join(f"`{other.partition('.')[2]}`" for other in by_kind)
            what = first_line(import_module(room))
            rows.append(f"| {{doc}}`{name} </book/api/{name}>` | {what} | {names} |")
    return "\n".join([*rows, ""])


def write_house(folder: Path = GENERATED) -> None:
    """Write the table into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "house.md").write_text(table_text(), encoding="utf-8")


if __name__ == "__main__":
    write_house()
