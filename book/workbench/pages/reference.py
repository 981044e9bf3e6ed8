"""The API reference: a page for each folder of the package, made from the docstrings; and a Sphinx
extension for it.

    .venv/bin/python -m workbench.pages.reference

writes the pages into ``_build/generated/api``; those in ``book/api`` include them. Sphinx's autodoc
renders a docstring where a page names its function, and viewcode puts the sources beside them. A
function's equations come from the ledger and from the first line of its docstring, its chapters
from the code of the notebooks.
"""

from __future__ import annotations

import ast
import inspect
import pkgutil
import re
from collections.abc import Iterator
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import nbformat

import satellites
import trinolab
import workbench

from ..imports import PACKAGES
from ..paper import ledger

ROOT = Path(__file__).resolve().parents[3]
GENERATED = ROOT / "_build" / "generated" / "api"

# The modules at the top, in the order of the data: three pages, because one would be a wall.
TOP = {
    "geometry": (
        "Cameras, handle, errors",
        [
            "camera",
            "lens",
            "handle",
            "rigid",
            "window",
            "default_covariance",
            "sensitivity",
            "metrics",
            "evaluation",
            "datasets",
            "checks",
            "memory",
            "work",
            "workers",
        ],
    ),
    "images": (
        "From frames to matches",
        [
            "background",
            "pixel_loops",
            "kalman",
            "image_track",
            "blobs",
            "markers",
            "marker_loops",
            "matching",
        ],
    ),
    "pose": (
        "From points to the pose",
        ["triangulation", "pose", "parameters", "methods", "measurement", "tracker"],
    ),
}
NOT_SHOWN = ("__main__", "browser", "data", "pages")
BY_MODULE = ("studies",)  # experiments: their modules are listed, not their functions


def first_line(thing: Any) -> str:
    """What a docstring says before its first empty line, for a cell of a table."""
    return (inspect.getdoc(thing) or "").partition("\n\n")[0].replace("\n", " ").replace("|", r"\|")


class Entry(NamedTuple):
    """A public function or class: its full name, the thing, and the numbers of its equations and
    chapters.
    """

    name: str
    thing: Any
    equations: list[int]
    chapters: list[int]

    @property
    def summary(self) -> str:
        """The first line of the docstring without its equations, which stand in another cell."""
        return re.sub(r" \(Eq\. [\d, -]+\)", "", first_line(self.thing))


def folders(package: ModuleType) -> list[str]:
    """The folders of a package, in the order of their names."""
    return [
        module.name
        for module in pkgutil.iter_modules(package.__path__)
        if module.ispkg and module.name not in NOT_SHOWN
    ]


def modules_of(package: ModuleType, folder: str) -> list[ModuleType]:
    """A folder's modules, those of its folders too; itself first."""
    first = import_module(f"{package.__name__}.{folder}")
    names = [found.name for found in pkgutil.walk_packages(first.__path__, f"{first.__name__}.")]
    return [first, *(import_module(name) for name in names if not name.endswith("__main__"))]


def pages() -> dict[str, tuple[str, list[ModuleType]]]:
    """For each page its title and the modules that it shows.

    Raises
    ------
    ValueError
        If a module at the top is on none of the pages.
    """
    placed = [name for _, names in TOP.values() for name in names]
    at_top = [
        module.name
        for module in pkgutil.iter_modules(trinolab.__path__)
        if not module.ispkg and module.name not in NOT_SHOWN
    ]
    if missing := sorted(set(at_top) ^ set(placed)):
        raise ValueError(
            f"TOP: expected each module at the top of the package once, got a difference in {missing}"
        )
    top = {
        page: (title, [import_module(f"trinolab.{name}") for name in names])
        for page, (title, names) in TOP.items()
    }
    wings = {
        folder: (folder, modules_of(package, folder))
        for package in (trinolab, workbench, satellites)
        for folder in folders(package)
    }
    beside = [
        import_module(f"workbench.{module.name}")
        for module in pkgutil.iter_modules(workbench.__path__)
        if not module.ispkg
    ]
    return {**top, **wings, "workbench": ("workbench", [workbench, *beside])}


def entries_of(module: ModuleType) -> list[Entry]:
    """The public functions and classes that a module defines, in the order of its lines."""
    own = [
        (name, thing)
        for name, thing in vars(module).items()
        if callable(thing)
        and not name.startswith("_")
        and (getattr(thing, "__module__", ""), getattr(thing, "__qualname__", ""))
        == (module.__name__, name)
    ]
    return [
        _entry(f"{module.__name__}.{name}", thing) for name, thing in own if inspect.getdoc(thing)
    ]


def _entry(name: str, thing: Any) -> Entry:
    named = ledger.equations_named(inspect.getdoc(thing) or "")
    entries = [entry for entry in _equations() if name in entry.functions or entry.no in named]
    derived = {int(entry.chapter[:2]) for entry in entries}
    return Entry(
        name,
        thing,
        [int(entry.no) for entry in entries],
        sorted(derived | _uses().get(name, set())),
    )


@cache
def _equations() -> list[ledger.Entry]:
    """The equations of the ledger."""
    return [entry for entry in ledger.load_ledger() if entry.no.isdigit()]


@cache
def _uses() -> dict[str, set[int]]:
    """Full name of a function or class -> the numbers of the chapters whose code uses it."""
    found: dict[str, set[int]] = {}
    for path in ROOT.glob("notebooks/[0-9]*.ipynb"):
        cells = nbformat.read(path, as_version=4).cells
        tree = ast.parse(
            "\n".join(
                re.sub(r"^\s*[%!].*", "", cell.source, flags=re.MULTILINE)
                for cell in cells
                if cell.cell_type == "code"
            )
        )
        for name in names_used(tree):
            found.setdefault(name, set()).add(int(path.stem[:2]))
    return found


def names_used(tree: ast.AST) -> Iterator[str]:
    """The full names of what a source takes from the package: functions by their modules, or
    imported by themselves.
    """
    known = {package: package for package in PACKAGES}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
            known |= {
                alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names
            }
    for node in ast.walk(tree):
        name = ast.unparse(node) if isinstance(node, ast.Attribute | ast.Name) else ""
        first, *rest = name.split(".")
        if first in known:
            yield _home(".".join([known[first], *rest]))


def _home(name: str) -> str:
    """The full name of a thing where it is defined: another folder's `__init__` or the face may
    have handed it on.
    """
    module, _, attribute = name.rpartition(".")
    try:
        thing = getattr(import_module(module), attribute)
        return f"{thing.__module__}.{thing.__qualname__}"
    except (
        ImportError,
        AttributeError,
        ValueError,
    ):  # a value, a method's result, a name of another package
        return name


@cache
def _notebook(chapter: int) -> str:
    """The document of a chapter."""
    return f"/notebooks/{next(ROOT.glob(f'notebooks/{chapter:02d}_*.ipynb')).stem}"


def page_text(title: str, modules: list[ModuleType], by_module: bool = False) -> str:
    """A page, as MyST Markdown: what its modules are, a table of what is in them, then one after
    the other.
    """
    lines = [f"# {title}", ""]
    if hasattr(modules[0], "__path__"):
        lines += [*_rst(f".. automodule:: {modules[0].__name__}"), ""]
    if by_module:
        rows = [f"| `{module.__name__}` | {first_line(module)} |" for module in modules[1:]]
        return "\n".join([*lines, "| module | what it is |", "|---|---|", *rows, ""])
    parts = [(module, entries) for module in modules if (entries := entries_of(module))]
    lines += ["| name | what it is | Eq. | chapters |", "|---|---|---|---|"]
    for module, entries in parts:
        lines.append(f"| **[{_short(module)}](#{_anchor(module)})** | *{first_line(module)}* | | |")
        lines += map(_row, entries)
    for module, entries in parts:
        lines += ["", f"({_anchor(module)})=", f"## {_short(module)}", ""]
        if module is not modules[0] or not hasattr(module, "__path__"):
            lines += _rst(f".. automodule:: {module.__name__}")
        for entry in entries:
            lines += ["", *_rst(_directive(entry))]
    return "\n".join([*lines, ""])


def _row(entry: Entry) -> str:
    short = entry.name.rpartition(".")[2]
    equations = ", ".join(
        f"{{ref}}`{text} <equation-{first}>`" for first, text in spans(entry.equations)
    )
    chapters = ", ".join(f"{{doc}}`{no} <{_notebook(no)}>`" for no in entry.chapters)
    return f"| {{py:obj}}`{short} <{entry.name}>` | {entry.summary} | {equations} | {chapters} |"


def _directive(entry: Entry) -> str:
    """The docstring, and behind it a line of links."""
    equations = [f":ref:`Eq. {text} <equation-{first}>`" for first, text in spans(entry.equations)]
    chapters = [f":doc:`chapter {no} <{_notebook(no)}>`" for no in entry.chapters]
    options = "\n   :members:\n" if inspect.isclass(entry.thing) else ""
    kind = "autoclass" if inspect.isclass(entry.thing) else "autofunction"
    links = (
        f"\n\n   In the book: {', '.join([*equations, *chapters])}."
        if equations or chapters
        else ""
    )
    return f".. {kind}:: {entry.name}{options}{links}"


def spans(numbers: list[int]) -> list[tuple[int, str]]:
    """Rising numbers as spans, each with its first one: (5, "5-6") and (16, "16") of 5, 6, 16."""
    starts = [no for no in numbers if no - 1 not in numbers]
    ends = [no for no in numbers if no + 1 not in numbers]
    return [(a, str(a) if a == b else f"{a}-{b}") for a, b in zip(starts, ends, strict=True)]


def _rst(text: str) -> list[str]:
    return ["```{eval-rst}", *text.split("\n"), "```"]


def _short(module: ModuleType) -> str:
    return module.__name__.partition(".")[2] or module.__name__


def _anchor(module: ModuleType) -> str:
    return f"api-{_short(module).replace('.', '-').replace('_', '-')}"


def face_text() -> str:
    """The table of what `trinolab` itself has."""
    rows = ["| name | what it is |", "|---|---|"]
    for name, where in trinolab.FACE.items():
        rows.append(
            f"| {{py:obj}}`trinolab.{name} <{where.replace(':', '.')}>` | {first_line(getattr(trinolab, name))} |"
        )
    return "\n".join([*rows, ""])


def contents_text() -> str:
    """The table of the pages, for their first one."""
    rows = ["| page | what is in it |", "|---|---|"]
    for page, (title, modules) in pages().items():
        what = (
            ", ".join(f"`{_short(module)}`" for module in modules)
            if page in TOP
            else first_line(modules[0])
        )
        rows.append(f"| {{doc}}`{title} </book/api/{page}>` | {what} |")
    return "\n".join([*rows, ""])


def write_pages(folder: Path = GENERATED) -> None:
    """Write a page for each of `pages`, ``face.md`` and ``contents.md`` into a folder that is made
    if need be.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "face.md").write_text(face_text(), encoding="utf-8")
    (folder / "contents.md").write_text(contents_text(), encoding="utf-8")
    for page, (title, modules) in pages().items():
        (folder / f"{page}.md").write_text(
            page_text(title, modules, page in BY_MODULE), encoding="utf-8"
        )


# --- the extension

# Without a word of theirs Sphinx reads the pages one after the other, and warns.
SILENT = ("sphinx-mathjax-offline", "sphinx_multitoc_numbering", "sphinx_jupyterbook_latex")


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    from sphinx.addnodes import pending_xref

    def name_in_full(app: Any, document: Any) -> None:
        for node in document.findall(pending_xref):
            if node.get("refdomain") == "py":
                node["reftarget"] = full_name(node["reftarget"], node.get("py:module"))
                node.attributes.pop("refspecific", None)  # or Sphinx takes any name that ends so

    def linkable(app: Any, document: Any) -> None:
        """A label can be linked as a heading can: ``assumptions.md#a16``, which JupyterLab opens as
        well.
        """
        slugs = app.env.metadata[app.env.docname].setdefault("myst_slugs", {})
        for name, explicit in document.nametypes.items():
            if explicit and document.nameids.get(name):
                slugs.setdefault(name, (0, document.nameids[name], name))

    app.connect("builder-inited", _in_parallel)
    app.connect("env-updated", _without_unused_sources)
    app.connect("doctree-read", name_in_full)
    app.connect("doctree-read", linkable)
    app.connect("missing-reference", _plain)
    app.connect("autodoc-skip-member", _skipped)
    app.connect("html-page-context", _mended)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _in_parallel(app: Any) -> None:
    """Say in the place of three extensions that pages may be read in parallel: one copies files at
    the end, one numbers sections when all pages are read, and one does something for LaTeX alone.
    """
    for name in SILENT:
        app.extensions[name].parallel_read_safe = True


def _without_unused_sources(app: Any, env: Any) -> None:
    """Forget the modules that no page leads to, of which viewcode would make a page of source: read
    one after the other, the next page makes it forget them.
    """
    sources = getattr(env, "_viewcode_modules", {})
    for module in [name for name, entry in sources.items() if entry and not entry[2]]:
        del sources[module]


def full_name(name: str, module: str | None) -> str:
    """What a name in a docstring means: what it means in the module's code, or the one thing of
    ours that ends so.
    """
    if name in known_names():
        return name
    first, *rest = name.split(".")
    thing = vars(import_module(module)).get(first) if module else None
    home = (
        thing.__name__ if inspect.ismodule(thing) else f"{getattr(thing, '__module__', '')}.{first}"
    )
    at_home = ".".join([home, *rest])
    ends = [known for known in known_names() if known.endswith(f".{name}")] if rest else []
    return at_home if at_home in known_names() else ends[0] if len(ends) == 1 else name


@cache
def known_names() -> frozenset[str]:
    """The full names of all that the pages show, of modules and methods as well."""
    modules_shown = [
        module
        for page, (_, modules) in pages().items()
        if page not in BY_MODULE
        for module in modules
    ]
    entries = [entry for module in modules_shown for entry in entries_of(module)]
    kinds = FunctionType | property | cached_property
    methods = [
        f"{entry.name}.{name}"
        for entry in entries
        if inspect.isclass(entry.thing)
        for name, thing in vars(entry.thing).items()
        if isinstance(thing, kinds)
    ]
    return frozenset(
        [
            *(module.__name__ for module in modules_shown),
            *(entry.name for entry in entries),
            *methods,
        ]
    )


def _plain(app: Any, env: Any, node: Any, contnode: Any) -> Any:
    """The bare text of a name that is none of ours, like that of a parameter. Of ours every name
    must be there.
    """
    mine = node.get("refdomain") != "py" or node.get("reftarget", "").startswith(
        ("trinolab.", "workbench.", "satellites.")
    )
    return None if mine else contnode


def _skipped(app: Any, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Leave out the fields of named tuples, which have no words of their own: the class describes
    them.
    """
    return (
        True
        if (getattr(thing, "__doc__", None) or "").startswith("Alias for field number")
        else None
    )


def _mended(app: Any, page: str, template: str, context: Any, tree: Any) -> None:
    """Mend three kinds of lists that Sphinx writes in a way that is none to a screen reader: the lines
    of a long signature, which are definitions without terms, a list of modules within a list, which
    belongs into an entry, and the bibliography, whose entries have a role that is no longer one.
    """
    body = context.get("body", "").replace('role="doc-biblioentry"', 'role="listitem"')
    if page == "_modules/index":
        body = body.replace("</li>\n<ul>", "\n<ul>")
        body = body.replace("</ul>", "</ul></li>", body.count("</ul>") - 1)
    context["body"] = re.sub(r"<dl>\n((?:<dd>.*</dd>\n)+)</dl>\n", _as_lines, body)


def _as_lines(found: re.Match[str]) -> str:
    lines = found[1].replace("<dd>", '<span class="sig-line">').replace("</dd>", "</span>")
    return f'<span class="sig-lines">{lines}</span>'


if __name__ == "__main__":
    write_pages()
