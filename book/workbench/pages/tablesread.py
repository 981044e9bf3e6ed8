"""Which shipped tables a notebook reads, and which command makes each again."""

from __future__ import annotations

import ast
from pathlib import Path

from ..studies.__main__ import MAKES

ROOT = Path(__file__).resolve().parents[3]
# the functions that read a table by its name -> the folder that it is in, below `data`
LOADERS = {"load_sweep": "sweeps", "gallery.load": "sweeps/gallery"}


def tables_read(code: str) -> list[str]:
    """The shipped files that the code of a notebook names, as paths below the folder ``data``: those
    of its calls of `data_path`, and the tables whose names it has as texts, if it calls their loader.
    """
    nodes = list(ast.walk(ast.parse(code)))
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    texts = [node.value for node in nodes if isinstance(node, ast.Constant)]
    named = [
        "/".join(str(part.value) for part in call.args if isinstance(part, ast.Constant))
        for call in calls
        if _called(call) == "data_path"
    ]
    for loader in LOADERS.keys() & {_called(call) for call in calls}:
        named += [f"{LOADERS[loader]}/{text}.csv" for text in texts]
    return sorted({name for name in named if (ROOT / "data" / name).is_file()})


def _called(call: ast.Call) -> str:
    return ast.unparse(call.func).removeprefix("datasets.")


def command_for(table: str) -> str:
    """The command that makes a file of the folder ``data`` again; empty for what was typed.

    Parameters
    ----------
    table : str
        Its path below that folder.
    """
    place = Path(table)
    if place.parent.as_posix() == "accept":
        return "make sheet"
    if place.parent.as_posix() == "sweeps/gallery":
        return f"python -m workbench.studies gallery {place.stem}"
    for study, tables in MAKES.items():
        if place.suffix == ".csv" and place.stem in tables:
            option = f" --factor {place.stem}" if study == "factors" else ""
            return f"python -m workbench.studies {study}{option}"
    return ""
