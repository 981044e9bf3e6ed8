"""What each command says to ``--help``, and how much of a file all of them take, for the page of the
commands.

    .venv/bin/python -m workbench.pages.commandhelp

writes ``_build/generated/commands/NAME.md`` for each command, the list of them ``list.md``, and
``limits.md``; ``book/commands.md`` includes them.
"""

from __future__ import annotations

import io
import os
import re
from contextlib import redirect_stdout, suppress
from pathlib import Path
from unittest.mock import patch

from satellites.bags.reader import FILE_RATIO, METADATA_BYTES
from trinolab.files import limits

from ..cli import main

GENERATED = Path(__file__).resolve().parents[3] / "_build" / "generated" / "commands"
COLUMNS = "84"  # the help is as wide as a box of code on the page


def help_text(*command: str) -> str:
    """What a command says to ``--help``; without a command what the program says."""
    output = io.StringIO()
    with patch.dict(os.environ, COLUMNS=COLUMNS), redirect_stdout(output), suppress(SystemExit):
        main([*command, "--help"])
    return output.getvalue()


def commands() -> dict[str, str]:
    """What each command does, in the order in which the program lists them."""
    lines = help_text().partition("COMMAND\n")[2].partition("\n\n")[0]
    # a command's name is indented by four, what it does by more
    entries = (entry.split() for entry in re.split(r"^ {4}(?=\S)", lines, flags=re.MULTILINE)[1:])
    return {name: " ".join(words) for name, *words in entries}


def command_table() -> str:
    """The commands, each with a link to its section, as a table of Markdown."""
    rows = [f"| {{ref}}`{name} <command-{name}>` | {does} |" for name, does in commands().items()]
    return "\n".join(["| command | what it does |", "|---|---|", *rows]) + "\n"


def limits_table() -> str:
    """The budget of what is read, as a table of Markdown."""
    rows = (
        ("a file", "is a regular file, and no pipe or device"),
        ("a rig", f"{limits.CAMERAS} cameras, each with an image as below"),
        ("a handle", f"{limits.MARKERS} markers"),
        (
            "TOML",
            f"{_mib(limits.TOML_BYTES)}, {limits.ENTRIES:,} commas and lines, {limits.BRACKETS:,} "
            f"tables and lists, {limits.DOTS} dots in a name, {limits.ALL_DOTS:,} dots in all names",
        ),
        ("the covariance of a rig", _mib(limits.COVARIANCE_BYTES)),
        (
            "an image, a frame of a video",
            f"{limits.PIXELS / 1e6:.0f} million pixels",
        ),
        ("an image file", _mib(limits.IMAGE_BYTES)),
        (
            "a table (CSV), rows that are kept",
            f"{_mib(limits.TABLE_BYTES)}, {limits.COLUMNS:,} columns, {limits.LINES:,} lines, "
            f"{limits.CELLS:,} cells, of which {limits.WORDS:,} may be words",
        ),
        ("JSON, a notebook, an arm", _mib(limits.TREE_BYTES)),
        ("a bag's `metadata.yaml`", _mib(METADATA_BYTES)),
        ("a bag's messages of one time, decompressed", _mib(limits.BAG_BYTES)),
        (
            "a bag's file that is compressed as a whole",
            f"{FILE_RATIO} times its length, or {_mib(limits.BAG_BYTES)}",
        ),
    )
    lines = ["| what is read | has at most |", "|---|---|", *(f"| {a} | {b} |" for a, b in rows)]
    return "\n".join(lines) + "\n"


def _mib(count: int) -> str:
    return f"{count / limits.MIB:g} MiB"


def write_help(folder: Path = GENERATED) -> None:
    """Write the help of each command, their list, and the limits into a folder that is made if need
    be.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "list.md").write_text(command_table(), encoding="utf-8")
    for name in commands():
        page = f"```text\n{help_text(name)}```\n"
        (folder / f"{name}.md").write_text(page, encoding="utf-8")
    (folder / "limits.md").write_text(limits_table(), encoding="utf-8")


if __name__ == "__main__":
    write_help()
