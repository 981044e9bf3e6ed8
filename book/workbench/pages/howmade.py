"""How each figure, table and number of a chapter was made, as a folded card below its cell; and what
the pages were built with, at the foot of each. A Sphinx extension.

Nothing here is typed by hand: the notebook as it was executed has the cells and their times, the
build's ``made_from.json`` the hashes, the code of the notebook its seeds and the tables that it reads.
"""

from __future__ import annotations

import json
import platform
import re
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import nbformat
from docutils import nodes
from myst_nb.ext.glue.roles import PasteTextRole

from ..provenance import commit
from .tablesread import command_for, tables_read

__all__ = [
    "HASHED",
    "Cell",
    "Chapter",
    "GluedNumber",
    "card",
    "commit_said",
    "foot",
    "is_code",
    "place_of",
    "put_cards",
    "put_foot",
    "read_chapter",
    "setup",
]

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "_build"
SHOWN = 12  # digits of a hash
# what a card calls the things that a result was made from
HASHED = {
    "the notebook": "code of the notebook",
    "the package": "code of the package that it imports",
    "its data": "data of the package",
    "the environment": "environment",
}


class Cell(NamedTuple):
    """What a card says of a cell: its number in the notebook, from 1 on, its name there, what it
    reads, and when and how long it was run.
    """

    number: int
    name: str
    tables: list[str]
    start: datetime | None
    seconds: float | None


class Chapter(NamedTuple):
    """A notebook as it was executed: its cells that are code, the cell of each glued number, its
    seeds, the hashes of what it was made from, and the seconds of all of it.
    """

    path: str
    cells: dict[int, Cell]
    glued: dict[str, int]
    seeds: list[str]
    count: int
    hashes: dict[str, str]
    seconds: float | None


def read_chapter(path: str, build: Path = BUILD) -> Chapter | None:
    """What the build has stored of a notebook, or None if it is none that was executed.

    Parameters
    ----------
    path : str
        Of the notebook in the repository, "notebooks/04_kalman.ipynb".
    build : Path
        The folder ``_build``.
    """
    name = Path(path).stem
    executed = build / "executed" / f"{name}.ipynb"
    if not executed.exists():
        return None
    notebook = nbformat.read(executed, as_version=4)
    read = tables_read([cell.source if is_code(cell) else "" for cell in notebook.cells])
    cells = {
        index: Cell(index + 1, cell.get("id", ""), read[index], *_times(cell))
        for index, cell in enumerate(notebook.cells)
        if is_code(cell)
    }
    seeds = [seed for cell in notebook.cells if is_code(cell) for seed in _seeds(cell)]
    return Chapter(
        path,
        cells,
        _glued(notebook),
        seeds,
        len(notebook.cells),
        _stored(build / "made_from.json").get(name, {}),
        _stored(build / "seconds.json").get(name),
    )


def is_code(cell: Any) -> bool:
    """Whether a notebook's cell is code."""
    return cell.cell_type == "code"


def _times(cell: Any) -> tuple[datetime | None, float | None]:
    """When a cell was begun, and how long it took, s."""
    times = cell.metadata.get("execution", {})
    try:
        start, end = (
            datetime.fromisoformat(times[f"iopub.{what}"])
            for what in ("execute_input", "status.idle")
        )
    except KeyError:
        return None, None
    return start, (end - start).total_seconds()


def _glued(notebook: Any) -> dict[str, int]:
    """The cell of each number that a notebook has glued."""
    return {
        output.metadata["scrapbook"]["name"]: index
        for index, cell in enumerate(notebook.cells)
        for output in cell.get("outputs", [])
        if "scrapbook" in output.get("metadata", {})
    }


def _seeds(cell: Any) -> list[str]:
    """The lines of the cell of parameters that set a seed, without their comments."""
    if "parameters" not in cell.metadata.get("tags", []):
        return []
    return re.findall(r"^(seeds? = .*?)\s*(?:#.*)?$", cell.source, flags=re.MULTILINE)


def _stored(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


# --- on the page


def put_cards(app: Any, document: nodes.document) -> None:
    """Put a card below each cell of a chapter that shows something or that a number comes from."""
    chapter = read_chapter(
        Path(app.env.doc2path(app.env.docname)).relative_to(app.srcdir).as_posix()
    )
    if chapter is None:
        return
    quoted = list(document.findall(lambda node: "glued" in getattr(node, "attributes", {})))
    sources = {chapter.glued[node["glued"]] for node in quoted if node["glued"] in chapter.glued}
    commit_text = commit_said()
    for container in list(document.findall(nodes.container)):
        cell = chapter.cells.get(container.get("cell_index", -1))
        if container.get("nb_element") != "cell_code" or cell is None:
            continue
        shows = any(part.get("nb_element") == "cell_code_output" for part in container.children)
        if shows or container["cell_index"] in sources:
            section = _section(container)
            made = card(chapter, cell, section, commit_text)
            place = container.parent.index(container) + 1
            container.parent[place:place] = made
    for node in quoted:
        _link(node, chapter)


def _section(node: nodes.Node) -> nodes.section | None:
    """The section that a node is in."""
    while node is not None and not isinstance(node, nodes.section):
        node = node.parent
    return node


def card(
    chapter: Chapter, cell: Cell, section: nodes.section | None, said: str
) -> list[nodes.Node]:
    """The card of a cell: a line that opens, and what it then says."""
    about = nodes.field_list(classes=["made"])
    where: list[nodes.Node | str] = [f"{cell.number} of the {chapter.count} of "]
    where += [nodes.literal(text=chapter.path)]
    if cell.name:
        where += [", called ", nodes.literal(text=cell.name)]
    if section is not None:
        title = section.next_node(nodes.title)
        heading = nodes.reference("", "", refid=section["ids"][0])
        heading += [child.deepcopy() for child in title.children]
        where += [", in “", heading, "”"]
    about += _field("Cell", where)
    again = f"python book/build.py --chapter {chapter.path}"
    about += _field("Made again by", [nodes.literal(text=again), _when_page(chapter)])
    for table in cell.tables:
        command = command_for(table)
        made = [", which ", nodes.literal(text=command), " makes again"] if command else []
        about += _field("Reads", [nodes.literal(text=f"data/{table}"), *made])
    about += _field("Seed", [", ".join(chapter.seeds) or "none drawn"])
    about += _field("Commit", [said])
    hashes = [
        f"{what} {chapter.hashes[name][:SHOWN]}"
        for name, what in HASHED.items()
        if name in chapter.hashes
    ]
    about += _field("Hashes", ["; ".join(hashes) or "none stored"])
    about += _field("Run", [_run(chapter, cell)])
    heads = (
        f'<details class="made"><summary aria-label="How this was made: cell {cell.number}">'
        "How this was made</summary>"
        f'<div id="{place_of(cell.number)}">'
    )
    return [
        nodes.raw("", heads, format="html"),
        about,
        nodes.raw("", "</div></details>", format="html"),
    ]


def _when_page(chapter: Chapter) -> str:
    return f", which leaves it in _build/executed/{Path(chapter.path).name}"


def _run(chapter: Chapter, cell: Cell) -> str:
    """When and how long a cell was run."""
    whole = "" if chapter.seconds is None else f"the whole notebook took {chapter.seconds:.0f} s"
    if cell.seconds is None or cell.start is None:
        return whole or "not recorded"
    took = f"{cell.seconds:.0f}" if cell.seconds > 9.5 else f"{cell.seconds:.2g}"
    run = f"{took} s on {cell.start.astimezone(UTC):%Y-%m-%d}"
    return f"{run}; {whole}" if whole else run


def _field(name: str, body: list[nodes.Node | str]) -> nodes.field:
    text = nodes.paragraph()
    text += [nodes.Text(part) if isinstance(part, str) else part for part in body]
    return nodes.field("", nodes.field_name(text=name), nodes.field_body("", text))


def place_of(number: int) -> str:
    """The name of a card's place in its page; it lies in the fold, which a link to it opens."""
    return f"made-{number}"


class GluedNumber(PasteTextRole):
    """The role ``{glue:text}`` of MyST-NB, whose number remembers its name."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        found, messages = super().run()
        for node in found:
            node["glued"] = self.text.partition(":")[0]
        return found, messages


def _link(node: nodes.inline, chapter: Chapter) -> None:
    """Let a number lead to its card, but in a link or a heading, which are links themselves."""
    index = chapter.glued.get(node["glued"])
    parent = node.parent
    while parent is not None and not isinstance(parent, nodes.reference | nodes.title):
        parent = parent.parent
    if index is None or parent is not None:
        return
    link = nodes.reference("", "", refid=place_of(index + 1), classes=["glued"])
    link["reftitle"] = f"How this number was made: cell {index + 1}"
    node.replace_self(link)
    link += node


# --- at the foot


def commit_said() -> str:
    """The commit of the checkout in words: its short hash, whether files differ from it, or that
    this is no clone.
    """
    name = commit()
    if not name:
        return "unknown, since this was built outside of a clone"
    return f"{name[:SHOWN]}{' and changes' if name.endswith('+') else ''}"


def foot() -> str:
    """What the pages were built with, and when, as HTML."""
    versions = {
        "trinolab": version("trinolab"),
        "Python": platform.python_version(),
        "NumPy": version("numpy"),
        "OpenCV": version("opencv-contrib-python-headless"),
        "SciPy": version("scipy"),
    }
    built = ", ".join(f"{name} {number}" for name, number in versions.items())
    return (
        f'<p class="built">Built on {datetime.now(UTC):%Y-%m-%d} with {escape(built)}. '
        f"Commit: {escape(commit_said())}.</p>"
    )


def put_foot(app: Any, config: Any) -> None:
    """Put the foot behind that of the theme."""
    options = config.html_theme_options
    options["extra_footer"] = options.get("extra_footer", "") + foot()


def setup(app: Any) -> dict[str, bool]:
    """Connect with Sphinx."""
    app.setup_extension("myst_nb")
    app.add_role_to_domain("glue", "text", GluedNumber(), override=True)
    app.connect("config-inited", put_foot)
    app.connect("doctree-read", put_cards)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
