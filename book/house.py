"""The picture of the house: the package's folders and the modules at its top, with an arrow for
each import.

    .venv/bin/python book/house.py

writes ``house.svg`` into ``_build/generated/api``. Whatever imports something stands above it. An
arrow that follows from others is left out: who imports the tracker may know what the tracker knows.
Beside it ``house.md``, a table of the folders with all that each imports.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Curve
from reference import first_line

from trinolab.files.provenance import modules_imported
from trinolab.plotting import COLOURS

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "trinolab"
GENERATED = ROOT / "_build" / "generated" / "api"
TOGETHER = {"datasets": "files"}  # they import each other's modules, in no circle: one box
ROUNDS = 60  # of ordering the floors

Graph = dict[str, set[str]]


def rooms(together: Mapping[str, str] = TOGETHER) -> Graph:
    """For each folder and each module at the top the others that it imports, wherever the import
    stands.
    """
    graph: Graph = {}
    for path in sorted(PACKAGE.glob("**/*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts in (("__init__",), ("__main__",)):
            continue
        package = ".".join(path.parent.relative_to(ROOT).parts)
        imported = modules_imported(path.read_text(encoding="utf-8"), package)
        names = {name.split(".")[1] for name in imported if name.startswith("trinolab.")}
        room = together.get(parts[0], parts[0])
        graph.setdefault(room, set()).update(together.get(name, name) for name in names)
    return {room: (others & set(graph)) - {room} for room, others in graph.items()}


def floors(graph: Graph) -> dict[str, int]:
    """For each room its floor: one above the highest of those that it imports. ValueError if some
    form a circle.
    """
    floor: dict[str, int] = {}
    while left := {room: others for room, others in graph.items() if room not in floor}:
        ready = [room for room, others in left.items() if others <= set(floor)]
        if not ready:
            raise ValueError(f"imports: expected no circle, got one among {', '.join(left)}")
        floor |= {
            room: max((floor[other] + 1 for other in graph[room]), default=0) for room in ready
        }
    return floor


def needed(graph: Graph, floor: dict[str, int]) -> Graph:
    """The arrows that do not follow from others."""
    below: Graph = {}
    for room in sorted(graph, key=lambda room: floor[room]):
        below[room] = graph[room].union(*(below[other] for other in graph[room]))
    return {
        room: {other for other in others if not any(other in below[third] for third in others)}
        for room, others in graph.items()
    }


def routed(arrows: Graph, floor: dict[str, int]) -> list[list[tuple[str, int]]]:
    """Each arrow as its places from floor to floor: the room that imports, empty places, the room
    imported.
    """
    return [
        [
            (room, floor[room]),
            *((f"{room} {other}", k) for k in range(floor[room] - 1, floor[other], -1)),
            (other, floor[other]),
        ]
        for room, others in sorted(arrows.items())
        for other in sorted(others)
    ]


def places(
    ways: list[list[tuple[str, int]]], floor: dict[str, int], widths: dict[str, float]
) -> dict[tuple[str, int], float]:
    """The horizontal place of each room and of each arrow on each floor, so that arrows are short
    and cross little.

    By turns from the bottom up and from the top down, a floor is sorted by the mean place of its
    neighbours on the other floors, and moved towards it as far as the boxes leave room (Sugiyama,
    Tagawa and Toda 1981).
    """
    stays = sorted({*floor.items(), *(stay for way in ways for stay in way)})
    neighbours: dict[tuple[str, int], list[tuple[str, int]]] = {stay: [] for stay in stays}
    for way in ways:
        for upper, lower in pairwise(way):
            neighbours[upper].append(lower)
            neighbours[lower].append(upper)
    levels = [[stay for stay in stays if stay[1] == k] for k in range(max(floor.values()) + 1)]
    x = {stay: float(k) for level in levels for k, stay in enumerate(level)}
    for turn in range(ROUNDS):
        for level in levels if turn % 2 else levels[::-1]:
            side = 1 if turn % 2 == 0 else -1
            seen = {
                stay: [
                    x[n]
                    for n in neighbours[stay]
                    if (n[1] - stay[1]) * side > 0 or turn > ROUNDS // 2
                ]
                for stay in level
            }
            wish = {stay: float(np.mean(seen[stay])) if seen[stay] else x[stay] for stay in level}
            level.sort(key=lambda stay: wish[stay])
            half = np.array([widths.get(stay[0], 0.35) / 2 for stay in level])
            offset = np.concatenate([[0.0], np.cumsum(half[1:] + half[:-1])])
            # Least squares with the order kept: the wishes without the widths, made to rise.
            x |= dict(
                zip(
                    level,
                    offset + _rising(np.array([wish[stay] for stay in level]) - offset),
                    strict=True,
                )
            )
    return x


def _rising(values: np.ndarray) -> np.ndarray:
    """The sequence that never falls nearest to the values: neighbours that fall are put at their
    mean.
    """
    blocks: list[list[float]] = []
    for value in values:
        blocks.append([value, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, n) = blocks[-2]
            (b, m) = blocks.pop()
            blocks[-1] = [(a * n + b * m) / (n + m), n + m]
    return np.concatenate([np.full(int(n), mean) for mean, n in blocks])


def draw_house() -> Figure:
    """The picture."""
    graph = rooms()
    floor = floors(graph)
    ways = routed(needed(graph, floor), floor)
    names = {
        room: ", ".join([room, *(other for other, home in TOGETHER.items() if home == room)])
        for room in graph
    }
    widths = {room: 0.15 * len(name) + 0.75 for room, name in names.items()}
    x = places(ways, floor, widths)
    left = min(x.values()) - 0.8
    right = max(x.values()) + 0.8
    fig, ax = plt.subplots(figsize=(9, 10), facecolor="white", layout="constrained")
    ax.set(xlim=(left, right), ylim=(-0.6, max(floor.values()) + 0.6))
    ax.axis("off")
    for way in ways:
        _draw_arrow(ax, [(x[stay], stay[1]) for stay in way])
    for room, level in floor.items():
        wing = (PACKAGE / room).is_dir()
        width = widths[room] - 0.3
        ax.add_patch(
            FancyBboxPatch(
                (x[room, level] - width / 2, level - 0.2),
                width,
                0.4,
                linewidth=1.2,
                boxstyle="round,pad=0,rounding_size=0.1",
                edgecolor=COLOURS[1 if wing else 0],
                facecolor="#fff4e0" if wing else "#e8f1fa",
            )
        )
        ax.text(
            x[room, level],
            level,
            names[room],
            ha="center",
            va="center",
            fontsize=9,
            fontweight="bold" if wing else "normal",
        )
    return fig


def _draw_arrow(ax: plt.Axes, points: list[tuple[float, float]]) -> None:
    """A curve from floor to floor, upright where it passes one, with its head at the last."""
    corners = [(points[0][0], points[0][1] - 0.2)]
    codes = [Curve.MOVETO]
    for k, ((x0, y0), (x1, y1)) in enumerate(pairwise(points)):
        end = y1 + (0.2 if k == len(points) - 2 else 0.0)
        begin = y0 - (0.2 if k == 0 else 0.0)
        middle = (begin + end) / 2
        corners += [(x0, middle), (x1, middle), (x1, end)]
        codes += [Curve.CURVE4] * 3
    ax.add_patch(
        FancyArrowPatch(
            path=Curve(corners, codes),
            arrowstyle="-|>",
            mutation_scale=9,
            color="0.45",
            linewidth=0.9,
            zorder=0.5,
        )
    )


def table_text() -> str:
    """The folders, as a table in MyST Markdown: what each is, by its docstring, and what it
    imports.
    """
    rows = ["| folder | what it is | imports |", "|---|---|---|"]
    for room, others in rooms(together={}).items():
        if (PACKAGE / room).is_dir():
            folders = ", ".join(
                f"`{other}`" for other in sorted(others) if (PACKAGE / other).is_dir()
            )
            modules = ", ".join(
                f"`{other}`" for other in sorted(others) if not (PACKAGE / other).is_dir()
            )
            what = first_line(import_module(f"trinolab.{room}"))
            known = "; ".join(filter(None, [folders, modules]))
            rows.append(f"| {{doc}}`{room} </book/api/{room}>` | {what} | {known} |")
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
