"""The page of the commands: each command has its section there, with what it says to ``--help``."""

import re
from pathlib import Path

import pytest

from trinolab.files import limits
from workbench.cli import main
from workbench.pages import commandhelp

PAGE = (Path(__file__).resolve().parents[3] / "book" / "commands.md").read_text(encoding="utf-8")


def test_each_command_has_its_section():
    sections = re.findall(r"^\(command-(\w+)\)=\n### \1$", PAGE, re.MULTILINE)
    assert sorted(sections) == sorted(commandhelp.commands())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The parts of the page that are written by the build."""
    folder = tmp_path_factory.mktemp("commands")
    commandhelp.write_help(folder)
    return {path.stem: path.read_text(encoding="utf-8") for path in folder.iterdir()}


@pytest.mark.parametrize("name", commandhelp.commands())
def test_help_is_what_the_command_says(name, written, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", commandhelp.COLUMNS)
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert written[name] == f"```text\n{capsys.readouterr().out}```\n"
    assert f"_build/generated/commands/{name}.md" in PAGE


def test_the_page_has_each_limit_of_what_is_read(written):
    """A limit that somebody adds, or changes, stands on the page."""
    table = written["limits"]
    assert "_build/generated/commands/limits.md" in PAGE
    for name, value in vars(limits).items():
        if not name.isupper() or name == "MIB" or not isinstance(value, int | float):
            continue
        forms = (f"{value:,}", f"{value / limits.MIB:g} MiB", f"{value / 1e6:.0f} million")
        assert any(form in table for form in forms), name
