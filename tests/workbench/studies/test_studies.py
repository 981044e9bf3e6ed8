"""The studies' command: what it asks each study for, where it writes, and what it refuses.

Studies whose command has more to it have their tests beside the study's own.
"""

from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest

from workbench.studies.__main__ import MAKES, main

FOUND = pd.DataFrame({"x": [1, 2], "name": ["a", "b"]})


@pytest.fixture
def asked(monkeypatch):
    """Makes a study's function one that gives `FOUND` at once; what it was asked for."""
    arguments = []

    def stand_in(study, function, answer=FOUND):
        def found(*given, **named):
            arguments.append((given, named))
            return answer

        monkeypatch.setattr(import_module(f"workbench.studies.{study}"), function, found)
        return arguments

    return stand_in


@pytest.mark.parametrize(
    ("study", "options", "function", "named"),
    [
        ("bound", [], "sweep_bounds", {}),
        ("elevation", [], "sweep_elevation", {}),
        ("fitts", [], "make_table", {}),
        ("webcams", [], "make_table", {}),
        ("second_renderer", ["--kept", "k"], "make_table", {"kept": Path("k")}),
        ("second_renderer", [], "make_table", {"kept": Path("_build/second")}),
        (
            "drawn_rigs",
            ["--kept", "k", "--draws", "3", "--workers", "5"],
            "make_table",
            {"draws": 3, "workers": 5, "kept": Path("k")},
        ),
        (
            "sensitivity",
            ["--kept", "k", "--draws", "3"],
            "make_table",
            {"kept": Path("k"), "draws": 3},
        ),
        ("sensitivity", [], "make_table", {"kept": Path("_build/sensitivity"), "draws": 2}),
        (
            "match_rivals",
            ["--kept", "k", "--draws", "3"],
            "make_table",
            {"kept": Path("k"), "draws": 3},
        ),
        (
            "calibration_error",
            ["--kept", "k", "--draws", "3", "--workers", "5"],
            "make_table",
            {"draws": 3, "workers": 5, "kept": Path("k")},
        ),
    ],
)
def test_a_study_of_one_table_writes_it_under_its_own_name(
    tmp_path, asked, study, options, function, named
):
    arguments = asked(study, function)
    assert main([study, "--out", str(tmp_path), *options]) == 0
    assert arguments == [((), named)]
    assert [path.name for path in tmp_path.iterdir()] == [f"{study}.csv"]
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / f"{study}.csv"), FOUND)


@pytest.mark.parametrize(
    ("study", "options", "named"),
    [
        ("budget", ["--draws", "7"], {"draws": 7}),
        (
            "stress",
            ["--kept", "k", "--instants", "20", "--workers", "5"],
            {"instants": 20, "workers": 5, "kept": Path("k")},
        ),
        (
            "instant_times",
            ["--kept", "k", "--instants", "80", "--workers", "5"],
            {"instants": 80, "workers": 5, "kept": Path("k")},
        ),
    ],
)
def test_several_tables_are_written_each_under_its_name(tmp_path, asked, study, options, named):
    tables = [FOUND.assign(x=number) for number in range(len(MAKES[study]))]
    arguments = asked(study, "make_tables", tables)
    assert main([study, "--out", str(tmp_path), *options]) == 0
    assert arguments == [((), named)]
    written = [pd.read_csv(tmp_path / f"{name}.csv")["x"].iloc[0] for name in MAKES[study]]
    assert written == list(range(len(tables)))


def test_the_trials_are_told_both_tables_and_which_of_them_to_make(tmp_path, asked):
    arguments = asked("claims", "make_tables", None)
    assert main(["claims", "clip", "slave", "--out", str(tmp_path), "--kept", "k"]) == 0
    results, draws = (tmp_path / f"claims_{what}.csv" for what in ("results", "draws"))
    assert arguments == [((results, draws, Path("k"), ["clip", "slave"]), {})]


def test_the_hashes_are_printed_and_nothing_is_made(tmp_path, asked):
    made, printed = asked("claims", "make_tables", None), asked("claims", "print_hashes", None)
    assert main(["claims", "--hashes", "--out", str(tmp_path)]) == 0
    assert made is printed
    assert printed == [((), {})]
    assert not list(tmp_path.iterdir())


def test_the_tuning_is_printed(asked):
    arguments = asked("tuning", "print_most_likely", None)
    assert main(["tuning"]) == 0
    assert arguments == [((), {})]


def test_all_factors_are_swept_without_a_name(tmp_path, asked):
    arguments = asked("factors", "sweep_factor")
    assert main(["factors", "--out", str(tmp_path), "--seeds", "3"]) == 0
    assert arguments == [((name, 3), {}) for name in MAKES["factors"]]
    assert {path.stem for path in tmp_path.iterdir()} == set(MAKES["factors"])


@pytest.mark.parametrize("study", [name for name in MAKES if name != "claims"])
def test_a_folder_that_is_missing_is_refused_before_the_study_begins(tmp_path, capsys, study):
    """Each of these would take minutes."""
    assert main([study, "--out", str(tmp_path / "none")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"python -m workbench.studies {study}: ")
    assert line.endswith("no such folder to write into")


def test_a_study_that_was_stopped_says_so_in_a_line(tmp_path, monkeypatch, capsys):
    def stopped(**_):
        raise KeyboardInterrupt

    monkeypatch.setattr("workbench.studies.fitts.make_table", stopped)
    assert main(["fitts", "--out", str(tmp_path)]) == 130
    assert capsys.readouterr().err.endswith("fitts: stopped, nothing was written\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        ([], "the following arguments are required: NAME"),
        (["colour"], "invalid choice: 'colour'"),
        (["sensitivity", "--draws", "two"], "--draws: invalid int value: 'two'"),
    ],
)
def test_a_command_that_is_none_is_refused(argv, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(argv)
    assert said in capsys.readouterr().err
