"""Hints with a title, as a Sphinx extension.

Docutils' own ``hint`` has none: what stands beside the directive's name would run into its text.
"""

from __future__ import annotations

from docutils import nodes
from docutils.parsers.rst.directives.admonitions import BaseAdmonition
from sphinx.application import Sphinx


class TitledHint(BaseAdmonition):
    """``{hint} First hint to 4.2``: a note of the class ``hint`` with this title."""

    required_arguments = 1
    node_class = nodes.admonition

    def run(self) -> list[nodes.Node]:
        """Return the note."""
        self.options["class"] = ["hint", *self.options.get("class", [])]
        return super().run()


def setup(app: Sphinx) -> dict[str, bool]:
    """Put the directive in the place of docutils' own."""
    app.add_directive("hint", TitledHint, override=True)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
