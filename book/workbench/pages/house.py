"""The picture of the house: the folders of the packages and the modules at the top of `trinolab`, each on a
floor above all that it imports.

    .venv/bin/python -m workbench.pages.house

writes ``house.svg`` into ``_build/generated/api``, and beside it ``house.md``, a table of the folders with
all that each imports.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from ..imports import PACKAGES, import_graph
from ..plotting.basics import COLOURS, subplots
from .reference import first_line

ROOT = Path(__file__).resolve().parents[3]
GENERATED = ROOT / "_build" / "generated" / "api"
TOGETHER = {"trinolab.datasets": "trinolab.files"}  # they import each other's modules, in no circle
NOT_SHOWN = {
    "trinolab",
    "trinolab.__main__",
    "satellites",
    "workbench",
    "workbench.browser",
    "workbench.pages",
}
WIDEST = 6  # boxes of a row

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


def floors(graph: Graph) -> dict[str, int]:
    """For each room its floor: one above the highest of those that it imports. ValueError if some
    form a circle.
    """
    joined = {
        room: {TOGETHER.get(other, other) for other in imported} - {room}
        for room, imported in graph.items()
        if room not in TOGETHER
    }
    for room, host in TOGETHER.items():
        if room in graph:
            joined[host] |= graph[room] - {host}
    floor: dict[str, int] = {}
    while waiting := {room: imported for room, imported in joined.items() if room not in floor}:
        ready = [room for room, imported in waiting.items() if imported <= set(floor)]
        if not ready:
            raise ValueError(f"imports: expected no circle, got one among {', '.join(waiting)}")
        for room in ready:
            floor[room] = max((floor[other] + 1 for other in joined[room]), default=0)
    return floor


def draw_house() -> Figure:
    """The picture: the algorithms below, the workbench above them."""
    floor = floors(rooms())
    rows: list[list[str]] = []
    for level in range(max(floor.values()) + 1):
        names = sorted(room for room in floor if floor[room] == level)
        rows += [names[k : k + WIDEST] for k in range(0, len(names), WIDEST)]
    fig, ax = subplots(figsize=(9, 0.42 * len(rows)))
    ax.set(xlim=(0, WIDEST), ylim=(-0.5, len(rows) - 0.5))
    ax.axis("off")
    for height, names in enumerate(rows):
        for k, room in enumerate(names):
            _draw_room(ax, room, (WIDEST - len(names)) / 2 + k, height)
    return fig


def _draw_room(ax: plt.Axes, room: str, x: float, y: float) -> None:
    folder = is_folder(room)
    workbench = not room.startswith("trinolab.")
    name = room.partition(".")[2]
    hosted = [guest.partition(".")[2] for guest, host in TOGETHER.items() if host == room]
    ax.add_patch(
        FancyBboxPatch(
            (x + 0.06, y - 0.36),
            0.88,
            0.72,
            boxstyle="round,pad=0,rounding_size=0.1",
            linewidth=1.2,
            edgecolor=COLOURS[2 if workbench else 1 if folder else 0],
            facecolor="#e5f4ee" if workbench else "#fff4e0" if folder else "#e8f1fa",
        )
    )
    ax.text(
        x + 0.5,
        y,
        ", ".join([name, *hosted]),
        ha="center",
        va="center",
        fontsize=9,
        fontweight="bold" if folder else "normal",
    )


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
    """Write picture and table into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "house.md").write_text(table_text(), encoding="utf-8")
    fig = draw_house()
    with plt.rc_context({"svg.hashsalt": "house"}):  # the same picture gives the same file
        fig.savefig(folder / "house.svg", metadata={"Date": None})
    plt.close(fig)


if __name__ == "__main__":
    write_house()
