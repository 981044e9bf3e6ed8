"""The applets on the pages: a Sphinx extension that puts an applet where a chapter's cell shows it.

A notebook shows an applet by a cell, ``show_applet("kalman", ...)`` (`workbench.applets`). On the page
the applet takes the cell's place, with the chapter's parameters as its defaults.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes

from ..applets import applet_html
from ..sweep.notebook import read_parameters

CALL = re.compile(r'^show_applet\(\s*"(\w+)"', flags=re.MULTILINE)
BEFORE_THE_CARD = (
    400  # Sphinx calls what has no number of its own, as `workbench.pages.howmade`, at 500
)


def put_applets(app: Any, document: nodes.document) -> None:
    """Put each applet of a chapter in the place of the cell that shows it."""
    shared = True
    for container in list(document.findall(nodes.container)):
        if container.get("nb_element") != "cell_code":
            continue
        source = next(container.findall(nodes.literal_block), None)
        call = source and CALL.search(source.astext())
        if call:
            parameters = read_parameters(Path(app.env.doc2path(app.env.docname)))
            html = applet_html(call[1], parameters, shared)
            container.replace_self(nodes.raw("", html, format="html"))
            shared = False


def setup(app: Any) -> dict[str, bool]:
    """Connect with Sphinx."""
    app.connect("doctree-read", put_applets, priority=BEFORE_THE_CARD)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
