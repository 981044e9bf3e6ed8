"""How each figure, table and number of a chapter was made: one folded card at the page's foot, to
which a link beside each of them leads; and what the pages were built with, below it. A Sphinx extension.

Nothing here is typed by hand: the notebook as it was executed has the cells and their times, the
build's ``made_from.json`` the hashes, the code of the notebook its seeds and the tables that it names.
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

from ..provenance import commit, source_of
from .tablesread import command_for, tables_read

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "_build"
SHOWN = 12  # digits of a hash
# what the card calls the things that a result was made from
HASHED = {
    "the notebook": "code of the notebook",
    "the package": "code of the package that it imports",
    "its data": "data of the package",
    "the environment": "environment",
}


class Cell(NamedTuple):
    """What the card says of a cell: its number in the notebook, from 1 on, its name there, and when
    and how long it was run.
    """

    number: int
    name: str
    start: datetime | None
    seconds: float | None


class Chapter(NamedTuple):
    """A notebook as it was executed: its cells that are code, the cell of each glued number, its
    seeds, the tables that it reads, the hashes of what it was made from, and the seconds of all of
    it.
    """

    path: str
    cells: dict[int, Cell]
    glued: dict[str, int]
    seeds: list[str]
    tables: list[str]
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
    cells = {
        index: Cell(index + 1, cell.get("id", ""), *_times(cell))
        for index, cell in enumerate(notebook.cells)
        if is_code(cell)
    }
    seeds = [seed for cell in notebook.cells if is_code(cell) for seed in _seeds(cell)]
    return Chapter(
        path,
        cells,
        _glued(notebook),
        seeds,
        tables_read(source_of(notebook)),
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


def put_card(app: Any, document: nodes.document) -> None:
    """Put a card at the foot of a chapter, and links to it: one below each cell on the page that
    shows something or that a number comes from, and one at each number.
    """
    chapter = read_chapter(
        Path(app.env.doc2path(app.env.docname)).relative_to(app.srcdir).as_posix()
    )
    if chapter is None:
        return
    quoted = list(document.findall(lambda node: "glued" in getattr(node, "attributes", {})))
    sources = {chapter.glued[node["glued"]] for node in quoted if node["glued"] in chapter.glued}
    made = []
    for container in list(document.findall(nodes.container)):
        cell = chapter.cells.get(container.get("cell_index", -1))
        if container.get("nb_element") != "cell_code" or cell is None:
            continue
        shows = any(part.get("nb_element") == "cell_code_output" for part in container.children)
        if shows or container["cell_index"] in sources:
            made.append((cell, _section(container)))
            place = container.parent.index(container) + 1
            container.parent.insert(place, link_to(cell))
    for node in quoted:  # of a cell that the page leaves out the row leads back to its first number
        cell = chapter.cells.get(chapter.glued.get(node["glued"], -1))
        if cell is not None and cell.number not in {one.number for one, _ in made}:
            made.append((cell, _section(node)))
            node["ids"].append(f"from-{place_of(cell.number)}")
    if not made:
        return
    made.sort(key=lambda row: row[0].number)
    for node in quoted:
        _link(node, chapter)
    page = next(document.findall(nodes.section), document)
    page += card(chapter, made, commit_said())


def _section(node: nodes.Node) -> nodes.section | None:
    """The section that a node is in."""
    while node is not None and not isinstance(node, nodes.section):
        node = node.parent
    return node


def link_to(cell: Cell) -> nodes.raw:
    """The line below a cell that leads to what the card says of it."""
    place = place_of(cell.number)
    link = f'<a href="#{place}" aria-label="how made: cell {cell.number}">how made</a>'
    return nodes.raw("", f'<p class="made" id="from-{place}">{link}</p>', format="html")


def card(
    chapter: Chapter, made: list[tuple[Cell, nodes.section | None]], said: str
) -> list[nodes.Node]:
    """The card of a page: a line that opens, what holds for all of its cells, and a row for each."""
    about = nodes.field_list()
    about += _field("Notebook", [nodes.literal(text=chapter.path)])
    again = f"python book/build.py --chapter {chapter.path}"
    leaves = f", which leaves it in _build/executed/{Path(chapter.path).name}"
    about += _field("Made again by", [nodes.literal(text=again), leaves])
    about += _field("Seed", [", ".join(chapter.seeds) or "none drawn"])
    about += _field("Reads", _reads(chapter) or ["no shipped table"])
    about += _field("Commit", [said])
    hashes = [
        f"{what} {chapter.hashes[name][:SHOWN]}"
        for name, what in HASHED.items()
        if name in chapter.hashes
    ]
    about += _field("Hashes", ["; ".join(hashes) or "none stored"])
    about += _field("Run", [_run(chapter)])
    head = (
        '<details class="made"><summary>How the figures, tables and numbers of this page were made'
        "</summary>"
    )
    return [
        nodes.raw("", head, format="html"),
        about,
        _rows(chapter, made),
        nodes.raw("", "</details>", format="html"),
    ]


def _rows(chapter: Chapter, made: list[tuple[Cell, nodes.section | None]]) -> nodes.table:
    """The table of a card: of each cell its number, its section, and how long it was run."""
    columns = (f"Cell of {chapter.count}", "In", "Time, s")
    group = nodes.tgroup("", cols=len(columns))
    group += [nodes.colspec(colwidth=25) for _ in columns]
    body = nodes.tbody()
    for cell, section in made:
        place = place_of(cell.number)
        back = nodes.reference("", str(cell.number), refid=f"from-{place}")
        name: list[nodes.Node | str] = [" ", nodes.literal(text=cell.name)] if cell.name else []
        row = nodes.row()
        row += _entry([_target(place), back, *name])
        row += _entry([] if section is None else [_heading(section)])
        row += _entry(["" if cell.seconds is None else f"{cell.seconds:.2f}"])
        body += row
    head = nodes.row()
    head += [_entry([column]) for column in columns]
    group += [nodes.thead("", head), body]
    return nodes.table("", group, classes=["made"])


def _target(place: str) -> nodes.raw:
    return nodes.raw("", f'<span id="{place}"></span>', format="html")


def _heading(section: nodes.section) -> nodes.reference:
    """A link to a section that has its heading's words."""
    heading = nodes.reference("", "", refid=section["ids"][0])
    heading += [child.deepcopy() for child in section.next_node(nodes.title).children]
    return heading


def _reads(chapter: Chapter) -> list[nodes.Node | str]:
    """The tables that a notebook reads, each with the command that makes it again."""
    parts: list[nodes.Node | str] = []
    for table in chapter.tables:
        command = command_for(table)
        parts += ["; "] if parts else []
        parts += [nodes.literal(text=f"data/{table}")]
        parts += [", made again by ", nodes.literal(text=command)] if command else []
    return parts


def _run(chapter: Chapter) -> str:
    """When and how long a notebook was run."""
    starts = [cell.start for cell in chapter.cells.values() if cell.start is not None]
    day = [f"{min(starts).astimezone(UTC):%Y-%m-%d}"] if starts else []
    took = [] if chapter.seconds is None else [f"{chapter.seconds:.0f} s for the whole notebook"]
    return ", ".join([*day, *took]) or "not recorded"


def _field(name: str, body: list[nodes.Node | str]) -> nodes.field:
    return nodes.field("", nodes.field_name(text=name), nodes.field_body("", _paragraph(body)))


def _entry(body: list[nodes.Node | str]) -> nodes.entry:
    return nodes.entry("", _paragraph(body))


def _paragraph(body: list[nodes.Node | str]) -> nodes.paragraph:
    text = nodes.paragraph()
    text += [nodes.Text(part) if isinstance(part, str) else part for part in body]
    return text


def place_of(number: int) -> str:
    """The name of a cell's row in the card; it lies in the fold, which a link to it opens."""
    return f"made-{number}"


class GluedNumber(PasteTextRole):
    """The role ``{glue:text}`` of MyST-NB, whose number remembers its name."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        found, messages = super().run()
        for node in found:
            node["glued"] = self.text.partition(":")[0]
        return found, messages


def _link(node: nodes.inline, chapter: Chapter) -> None:
    """Let a number lead to its row of the card, but in a link or a heading, which are links themselves."""
    index = chapter.glued.get(node["glued"])
    parent = node.parent
    while parent is not None and not isinstance(parent, nodes.reference | nodes.title):
        parent = parent.parent
    if index is None or parent is not None:
        return
    link = nodes.reference("", "", refid=place_of(index + 1), classes=["glued"])
    link["reftitle"] = f"How this number was made: cell {index + 1}"
    node.replace_self(link)  # which takes over the node's ids
    node["ids"] = []
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
    app.connect("doctree-read", put_card)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
