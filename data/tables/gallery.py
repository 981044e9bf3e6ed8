"""The sweep gallery, a table each; see `workbench.studies.gallery`."""

from __future__ import annotations

from workbench.studies.carrier import Table
from workbench.studies.gallery import GALLERY, Exhibit, settings


def table(name: str, exhibit: Exhibit) -> Table:
    """A run per row; a test makes the one in the middle again, if no chapter is to be run for it."""
    rows = settings(name)
    return Table(
        name,
        exhibit.what,
        [{key: list(dict.fromkeys(row[key] for row in rows)) for key in rows[0]}],
        by=tuple(rows[0]),
        columns=(*rows[0], *exhibit.results) if exhibit.results else (),
        again=rows[len(rows) // 2] if callable(exhibit.what) else {},
    )


TABLES = [table(name, exhibit) for name, exhibit in GALLERY.items()]
