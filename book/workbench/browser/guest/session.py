"""A notebook's session in the reader's browser: a cell is run, and what it shows is handed out.

The page writes what is to run into ``/tmp/request.json`` and calls `answer`. What a cell prints
goes the way of standard output; figures, tables, glued numbers and errors go through the door.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import rlcompleter
import symtable
import sys
import traceback
import types
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from . import door, substitutes

REQUEST = Path("/tmp/request.json")
CELLS = Path("/tmp/cells")
namespace: dict[str, Any] = {}
_lost: dict[str, str] = {}  # what cells that cannot run here would have assigned, and why not


def start(book: str = "/book") -> None:
    """Make ready what every cell finds: the packages, the substitutes, an empty namespace."""
    for folder in (book, f"{book}/book"):
        if folder not in sys.path:
            sys.path.insert(0, folder)
    os.makedirs(CELLS, exist_ok=True)
    os.chdir(f"{book}/notebooks" if os.path.isdir(f"{book}/notebooks") else book)
    os.environ["TRINOLAB_UNATTENDED"] = "1"  # what would need a kernel's widgets shows a figure
    warnings.simplefilter("ignore", DeprecationWarning)  # the libraries here are newer
    warnings.filterwarnings("ignore", message="tqdm:disabling monitor")  # it asks for a thread
    substitutes.install(show, glue)
    _find_recordings(Path(book) / "recordings")
    main = types.ModuleType("__main__")
    main.__dict__["__builtins__"] = __builtins__
    sys.modules["__main__"] = main
    global namespace
    namespace = main.__dict__


def _find_recordings(folder: Path) -> None:
    """Take the standard recordings from a folder of the site instead of rendering them here; see
    `frames`.

    What a recording was made from is the same but for the motion, whose last bits are those of the
    machine that computed it.
    """
    from trinolab.bench import rendering

    from . import frames

    rendered = rendering.cached_folder

    def cached_folder(name: str, manifest: dict[str, Any], make: Any) -> Path:
        shipped = folder / name / "made_from.json"
        if shipped.is_file():
            made_from = json.loads(shipped.read_text())
            if {**made_from, "instants": ""} == {**manifest, "instants": ""}:
                return shipped.parent
        return rendered(name, manifest, make)

    rendering.cached_folder = cached_folder
    frames.read_from(folder)


def answer() -> None:
    """Run the request that the page has written."""
    request = json.loads(REQUEST.read_text())
    run(request["source"], request["name"])


def run(source: str, name: str = "cell") -> None:
    """Run a cell: its last expression is shown, then the figures that it has drawn."""
    try:
        value = _value_of(source, name)
        if value is not None:
            show(value)
        _show_figures()
    except BaseException as error:
        cannot = _what_cannot_run(error)
        if cannot is not None:
            _forget(source, cannot)
        _report(error, cannot)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        close_figures()


def offer(begun: str) -> None:
    """Hand out the names of the session that what is typed can become, such as "np.lin"."""
    completer = rlcompleter.Completer(namespace)
    names = completer.attr_matches(begun) if "." in begun else completer.global_matches(begun)
    _hand_out({"type": "names", "names": [name.rstrip("(): ") for name in names]})


def show(*values: Any) -> None:
    """Show values as a notebook does: as a picture or HTML where they have it, else as text."""
    for value in values:
        sys.stdout.flush()
        data = _forms_of(value)
        if data:
            _hand_out({"type": "display", "data": data})


def glue(name: str, value: Any, display: bool = True) -> None:
    """Hand out a number that the text quotes."""
    item = value.item() if hasattr(value, "item") and np.size(value) == 1 else value
    known = isinstance(item, bool | int | float | str)
    _hand_out({"type": "glue", "name": name, "value": item if known else repr(item)})
    if display:
        show(value)


def _value_of(source: str, name: str) -> Any:
    """Run a cell's statements, and return the value of its last expression, if it is one."""
    path = CELLS / f"{name}.py"  # a file of its own, where inspect finds the source
    path.write_text(source)
    tree = ast.parse(source, str(path))
    last = None
    end = tree.body[-1] if tree.body else None
    if isinstance(end, ast.Expr) and not source.rstrip().endswith(";"):
        tree.body.pop()
        last = ast.Expression(end.value)
    exec(compile(tree, str(path), "exec"), namespace)
    return None if last is None else eval(compile(last, str(path), "eval"), namespace)


def _forms_of(value: Any) -> dict[str, str]:
    """The forms of a value that a page can show, by their type."""
    forms: dict[str, str] = {}
    if bundle := getattr(value, "_repr_mimebundle_", None):
        return dict(bundle())
    for name, form in (
        ("_repr_html_", "text/html"),
        ("_repr_markdown_", "text/markdown"),
        ("_repr_latex_", "text/latex"),
    ):
        if (text := getattr(value, name, lambda: None)()) is not None:
            forms[form] = text
    if (png := getattr(value, "_repr_png_", lambda: None)()) is not None:
        forms["image/png"] = base64.b64encode(png).decode()
    if "matplotlib.figure" in sys.modules and isinstance(
        value, sys.modules["matplotlib.figure"].Figure
    ):
        return {"image/png": _png(value)}
    if not forms or "text/html" not in forms:
        forms["text/plain"] = repr(value)
    return forms


def _png(figure: Any) -> str:
    file = io.BytesIO()
    figure.savefig(file, format="png", bbox_inches="tight", dpi=100)
    figure._shown = True
    return base64.b64encode(file.getvalue()).decode()


def _show_figures() -> None:
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None:
        return
    for number in pyplot.get_fignums():
        figure = pyplot.figure(number)
        if not getattr(figure, "_shown", False):
            _hand_out({"type": "display", "data": {"image/png": _png(figure)}})


def close_figures() -> None:
    """Forget every figure."""
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


def _forget(source: str, why: str) -> None:
    """Take back what a cell has assigned before it failed, and remember why it is missing."""
    for symbol in symtable.symtable(source, "cell", "exec").get_symbols():
        if symbol.is_assigned():
            namespace.pop(symbol.get_name(), None)
            _lost[symbol.get_name()] = why


def _report(error: BaseException, cannot: str | None) -> None:
    """Hand out an error with the lines of the cells that led to it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/guest/session.py" not in frame.filename]
    lines = ["Traceback (most recent call last):\n", *traceback.format_list(own)]
    text = "".join([*lines, *traceback.format_exception_only(error)])
    _hand_out({"type": "error", "text": text, "cannot": cannot})


def _what_cannot_run(error: BaseException) -> str | None:
    """Why a cell cannot run in a browser at all, if that is what its error means."""
    if isinstance(error, NotImplementedError):
        return str(error)
    if isinstance(error, NameError):
        return _lost.get(error.name or "")
    if isinstance(error, ModuleNotFoundError) and error.name:
        name = error.name.partition(".")[0]
        if name in substitutes.MISSING:
            return f"{name} is not in the browser: {substitutes.MISSING[name]}"
    return None


def _hand_out(output: dict[str, Any]) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    door.ask({"asks": "output", "output": output})
