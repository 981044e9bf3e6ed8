"""The page of the commands: each command has its section there, with what it says to ``--help``."""

import re
from pathlib import Path

import pytest

from workbench.cli import main
from workbench.pages import commandhelp

PAGE = (Path(__file__).resolve().parents[3] / "book" / "commands.md").read_text(encoding="utf-8")


def test_each_command_has_its_section_in_the_order_of_its_use():
    assert re.findall(r"^### (\w+)$", PAGE, re.MULTILINE)[:3] == ["render", "track", "evaluate"]
    sections = re.findall(r"^\(command-(\w+)\)=\n### \1$", PAGE, re.MULTILINE)
    assert sorted(sections) == sorted(commandhelp.names())
    assert len(sections) > 10


@pytest.mark.parametrize("name", commandhelp.names())
def test_help_is_what_the_command_says(name, tmp_path, capsys, monkeypatch):
    commandhelp.write_help(tmp_path)
    monkeypatch.setenv("COLUMNS", commandhelp.COLUMNS)
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert (tmp_path / f"{name}.md").read_text() == f"```text\n{capsys.readouterr().out}```\n"
    assert f"_build/generated/commands/{name}.md" in PAGE


def test_no_line_is_wider_than_the_page_s_code():
    lines = [
        line for name in commandhelp.names() for line in commandhelp.help_text(name).split("\n")
    ]
    assert max(map(len, lines)) <= 88
