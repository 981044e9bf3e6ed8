"""The links to Binder and Colab on the page *Without installing*, which need the project's public
address: ``codeRepository`` of ``codemeta.json``, and no other file.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from urllib.parse import quote

from trinolab.files.outputs import write_whole

ROOT = Path(__file__).resolve().parents[3]
LAB = "HEAD?urlpath=lab/tree/notebooks"


def write_page(folder: Path) -> None:
    """Write ``links.md``, which the page includes."""
    folder.mkdir(parents=True, exist_ok=True)
    about = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    write_whole(folder / "links.md", links(about.get("codeRepository")) + "\n")


def links(address: str | None) -> str:
    """The links, or why there are none.

    Parameters
    ----------
    address : str or None
        Of the public repository; Colab opens those on GitHub alone.
    """
    if address is None:
        return (
            "**This copy does not know its public address.** Whoever publishes the project writes it into "
            "`codemeta.json`, as `codeRepository`, and builds the book again: the links are here then."
        )
    github = re.fullmatch(r"https://github\.com/([\w.-]+/[\w.-]+?)(?:\.git)?/?", address)
    if github is None:
        return f"- [Binder](https://mybinder.org/v2/git/{quote(address, safe='')}/{LAB})"
    name = github[1]
    colab = f"https://colab.research.google.com/github/{name}/blob/HEAD/binder/colab.ipynb"
    return f"- [Binder](https://mybinder.org/v2/gh/{name}/{LAB})\n- [Colab]({colab})"
