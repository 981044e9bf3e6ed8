"""What each command says to ``--help``, for the page of the commands.

    .venv/bin/python -m workbench.pages.commandhelp

writes ``_build/generated/commands/NAME.md`` for each command; ``book/commands.md`` includes them.
"""

from __future__ import annotations

import io
import os
from contextlib import redirect_stdout, suppress
from pathlib import Path
from unittest.mock import patch

from ..cli import main

__all__ = ["COLUMNS", "help_text", "names", "write_help"]

GENERATED = Path(__file__).resolve().parents[3] / "_build" / "generated" / "commands"
COLUMNS = "84"  # the help is as wide as a box of code on the page


def help_text(*command: str) -> str:
    """What a command says to ``--help``; without a command what the program says."""
    output = io.StringIO()
    with patch.dict(os.environ, COLUMNS=COLUMNS), redirect_stdout(output), suppress(SystemExit):
        main([*command, "--help"])
    return output.getvalue()


def names() -> list[str]:
    """The commands, in the order in which the program lists them."""
    lines = help_text().partition("COMMAND\n")[2].partition("\n\n")[0].splitlines()
    # a command's name is indented by four, what it does by more
    return [line.split()[0] for line in lines if line[:4].isspace() and not line[4].isspace()]


def write_help(folder: Path = GENERATED) -> None:
    """Write the help of each command into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names():
        page = f"```text\n{help_text(name)}```\n"
        (folder / f"{name}.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    write_help()
