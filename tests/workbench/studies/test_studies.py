"""The studies' command: what it asks each study for, where it writes, and what it refuses.

Studies whose command has more to it have their tests beside the study's own.
"""

from pathlib import Path

import pandas as pd
import pytest

from workbench.studies import __main__ as command
from workbench.studies.__main__ import MAKES, STUDIES, main
from workbench.studies.carrier import script

KEPT = {"workers": 5, "kept": Path("k")}
FOUND = pd.DataFrame({"x": [1, 2], "name": ["a", "b"]})


@pytest.fixture
def asked(monkeypatch):
    """Makes a study's function one that gives `FOUND` at once; what it was asked for."""
    arguments = []

    def stand_in(study, answer=FOUND):
        def found(**named):
            arguments.append(named)
            return answer

        module = command._module(study)
        monkeypatch.setattr(module, STUDIES[study].make, found)
        return arguments

    return stand_in


@pytest.mark.parametrize(
    ("study", "options", "named"),
    [
        ("budget", "--draws 7", {"draws": 7}),
        ("second_renderer", "--workers 1", {"workers": 1, "kept": Path("_build/second")}),
        ("drawn_rigs", "--kept k --draws 3 --workers 5", {"draws": 3, **KEPT}),
    ],
)
def test_tables_are_written_each_under_its_name(tmp_path, asked, study, options, named):
    several = [FOUND.assign(x=number) for number in range(len(MAKES[study]))]
    arguments = asked(study, several if len(several) > 1 else several[0])
    assert main([study, "--out", str(tmp_path), *options.split()]) == 0
    assert arguments == [named]
    written = [pd.read_csv(tmp_path / f"{name}.csv")["x"].iloc[0] for name in MAKES[study]]
    assert written == list(range(len(several)))


@pytest.mark.parametrize(
    ("study", "options", "named"),
    [
        ("fitts", [], {}),
        ("factors", ["--factor", "turn", "--seeds", "3"], {"draws": 3, "names": ["turn"]}),
        ("gallery", ["blur"], {"names": ["blur"]}),
    ],
)
def test_the_tables_of_a_script_are_carried(tmp_path, monkeypatch, study, options, named):
    made = []
    monkeypatch.setattr(
        command, "make_tables", lambda *given, **by_name: made.append((given, by_name))
    )
    assert main([study, "--out", str(tmp_path), "--kept", "k", "--workers", "5", *options]) == 0
    (((tables, out), by_name),) = made
    assert (tables, out) == (script(study).TABLES, tmp_path)
    assert by_name == {**KEPT, **named}


@pytest.mark.parametrize("study", [name for name in STUDIES if name != "tuning"])
def test_a_folder_that_is_missing_is_refused_before_the_study_begins(tmp_path, capsys, study):
    """Each of these would take minutes."""
    assert main([study, "--out", str(tmp_path / "none")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"python -m workbench.studies {study}: ")
    assert line.endswith("no such folder to write into")


def test_a_count_below_one_is_refused(tmp_path, capsys):
    for line in ("budget --draws -2", "factors --seeds -2", "gallery --workers -2"):
        assert main([*line.split(), "--out", str(tmp_path)]) == 2
        option = line.split()[1]
        assert f"{option}: expected a number of 1 or more, got -2" in capsys.readouterr().err


def test_a_study_that_was_stopped_says_so_in_a_line(tmp_path, monkeypatch, capsys):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "make_tables", stopped)
    assert main(["fitts", "--out", str(tmp_path)]) == 130
    assert capsys.readouterr().err.endswith("fitts: stopped, nothing was written\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("line", "said"),
    [("", "NAME"), ("colour", "'colour'"), ("sensitivity --draws two", "--draws: invalid int")],
)
def test_a_command_that_is_none_is_refused(line, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(line.split())
    assert said in capsys.readouterr().err
