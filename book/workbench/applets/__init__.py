"""The applets of the chapters: pictures that the reader moves, without a kernel, on the page and in
JupyterLab alike.

An applet is a file of plain JavaScript in this folder, NAME.js, and `shared.js` has what all of them
share. A chapter shows it by a cell, ``show_applet("kalman", sigma_px=sigma_px, ...)``, with those of
its parameters that the script asks for. What an applet needs of the book beside them, `data`
computes with the package, so that no number is typed a second time.
"""

from __future__ import annotations

import inspect
import json
import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any

from ..sweep.notebook import UNATTENDED

__all__ = ["applet_html", "show_applet", "wanted_parameters"]

FOLDER = Path(__file__).parent


def show_applet(name: str, **parameters: Any) -> Any:
    """Show an applet in a notebook: the output is a piece of HTML with its script in it.

    Parameters
    ----------
    name : str
        Of the applet, such as "kalman".
    **parameters
        Of the chapter, those that the applet begins with.

    Returns
    -------
    IPython.display.HTML or None
        None where nobody can move it: in a sweep, and in a chapter that the book's build runs. The
        page gets its applet when it is written (``workbench.pages.applets``).

    Raises
    ------
    ValueError
        For an applet that there is none of, or parameters that are not those it asks for.
    """
    wanted = wanted_parameters(name)
    if set(parameters) != wanted:
        raise ValueError(
            f"parameters of the applet {name!r}: expected {sorted(wanted)}, got {sorted(parameters)}"
        )
    if UNATTENDED in os.environ:
        return None
    from IPython.display import HTML

    return HTML(applet_html(name, parameters))


def wanted_parameters(name: str) -> set[str]:
    """The chapter's parameters that an applet's script, or what computes its data, asks for.
    ValueError if there is none of that name.
    """
    in_script = re.findall(r"\bparameters\.(\w+)", _script(name))
    return {*in_script, *_wanted_data(name)}


def applet_html(name: str, parameters: dict[str, Any], shared: bool = True) -> str:
    """An applet as HTML: its place, what it needs to know, its style and its scripts.

    Parameters
    ----------
    name : str
    parameters : dict
        Of the chapter, those that it begins with, perhaps more.
    shared : bool
        Whether to bring along what all applets share; a page needs that once.
    """
    arguments = {one: parameters[one] for one in _wanted_data(name)}
    data = _maker(name)
    known = {"parameters": parameters, "data": data(**arguments) if data else None}
    style = f"<style>\n{_text('applets.css')}</style>\n" if shared else ""
    scripts = [_text("shared.js")] if shared else []
    scripts.append(_script(name))
    return (
        f'{style}<div class="applet" data-applet="{name}">'
        "<p>An interactive picture appears here if JavaScript is switched on.</p>"
        f'<script type="application/json">{_embedded(json.dumps(known))}</script></div>\n'
        + "".join(f"<script>\n{_embedded(script)}</script>\n" for script in scripts)
    )


def _maker(name: str) -> Any:
    """What computes an applet's data, or None. It is imported by its name, since a chapter's results
    do not depend on what an applet shows.
    """
    return import_module(".data", __package__).DATA.get(name)


def _wanted_data(name: str) -> list[str]:
    data = _maker(name)
    return list(inspect.signature(data).parameters) if data else []


def _script(name: str) -> str:
    if not (FOLDER / f"{name}.js").is_file():
        raise ValueError(f"name: there is no applet {name!r}")
    return _text(f"{name}.js")


def _text(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _embedded(script: str) -> str:
    """A script that does not end before its end: ``</`` stands in it only in strings."""
    return script.replace("</", r"<\/")
