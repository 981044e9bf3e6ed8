"""The pages of the book, as the table of contents names them."""

from __future__ import annotations

from pathlib import Path

import yaml


def pages(root: Path) -> list[str]:
    """The pages that ``_toc.yml`` names, in its order, without their endings."""
    toc = yaml.safe_load((root / "_toc.yml").read_text(encoding="utf-8"))
    chapters = [chapter for part in toc["parts"] for chapter in part["chapters"]]
    sections = [one for chapter in chapters for one in [chapter, *chapter.get("sections", [])]]
    return [toc["root"], *(one["file"] for one in sections)]
