"""The data sheet's files, its control chart, and the work that is kept: on tests that take no
time.
"""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import DEFAULT, Mock

import numpy as np
import pandas as pd
import pytest
from healthy import make_healthy
from sheetrows import pointer_rows, rows_of, setup, static_rows

from satellites.accept import command, history, pointer, renew, rest, sheet, static, work
from satellites.accept.command import accept, as_lines
from satellites.accept.numbers import CLOCK, OWN, Answer, Number, far_count, share
from satellites.accept.sheet import Sheet, contents, digits, read_sheet
from trinolab.datasets import data_path, load_sweep
from trinolab.files.journal import locked
from trinolab.files.poses import read_poses
from trinolab.methods import BEST
from workbench.studies.broken import FAULTS
from workbench.studies.instant_times import by_film
from workbench.studies.second_renderer import side_by_side
from workbench.studies.stress import by_fault

ROOT = Path(__file__).resolve().parents[4]
RIG, HANDLE = data_path("rigs", "raised_40deg.toml"), data_path("handles", "coded.toml")


@pytest.fixture(scope="module")
def made():
    """A sheet of three tests on poses that are known, one that was not run, and its files."""
    one = setup()
    rng = np.random.default_rng(0)
    size = np.repeat([0.002, 4e-4], 3)
    at_rest = [rows_of([T] * 24, rng.normal(size=(24, 6)) * size) for T in rest.places(one)]
    answers = {
        "A1": rest.judge(one, at_rest),
        "A2": static.judge(one, static_rows(one, rng.normal(size=(64, 6)) * size)),
        "A4": pointer.judge(one, pointer_rows(one)),
    }
    titles = {name: work.TESTS[name].TITLE for name in ("A1", "A2", "A4", "A7")}
    about = {"rig": "raised_40deg", "handle": "coded", "summary": "three <cameras> & more"}
    whole = Sheet(about, answers, titles, {"A7": "needs the package mujoco"})
    whole.charts += history.charts(rows(whole), "raised_40deg", "coded", 64, 0)
    return whole, contents(whole)


def rows(whole, commit="abc1234"):
    """Rows of a chart."""
    table = history.rows_of(whole.numbers, "raised_40deg", "coded", 64, 0)
    return table.assign(commit=commit)


class Read(HTMLParser):
    """The tags of a page with their attributes, and its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text, self.open = [], "", []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


# --- the page


def test_page_is_whole_and_loads_nothing(made):
    page = Read(made[1][sheet.PAGE])
    assert page.open == []
    for sentence in (sheet.CRIME, sheet.AFTER, "Not run: needs the package mujoco."):
        assert sentence in page.text
    assert "three <cameras> & more" in page.text  # escaped, not a tag
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe"}
    sources = [attrs["src"] for tag, attrs in page.tags if tag == "img"]
    assert len(sources) >= 8
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert all(link[0] == "#" and link[1:] in ids for link in links)
    assert "url(" not in made[1][sheet.PAGE]
    assert min(len(attrs["alt"]) for tag, attrs in page.tags if tag == "img") > 60
    for number in made[0].numbers:
        assert sheet.value_text(number) in page.text
        assert number.what in page.text


def test_three_digits_and_how_sure_a_count_is():
    values = 0.0031234, 12.3456, 100.0, 512.4, 0.0, np.nan
    assert list(map(digits, values)) == ["0.00312", "12.3", "100", "512", "0", ""]
    assert share("A2", "poses", 10, 10, 0).low == pytest.approx(72.2, abs=0.1)
    assert far_count("A2", 0, 512, 0).note == "a share of at most 0.58 %, 95 % sure"


# --- table and JSON


def test_table_has_a_row_a_number(made):
    from io import StringIO

    table = pd.read_csv(StringIO(made[1][sheet.TABLE]))
    assert len(table) == len(made[0].numbers)
    assert list(table) == list(Number.__dataclass_fields__)
    assert (table["n"] > 0).all()
    assert (table["seed"].dropna() == 0).all()
    given = table["interval"].notna()
    assert given.mean() > 0.7
    ends = table[given & table["high"].notna()]
    assert (ends["low"] <= ends["value"] * (1 + 1e-5) + 1e-9).all()
    assert (ends["value"] <= ends["high"] * (1 + 1e-5) + 1e-9).all()
    # the largest of n says how much lies below it, a count how large the share may be
    assert all(number.interval or number.note for number in made[0].numbers)


def test_json_is_read_back(made, tmp_path):
    text = made[1][sheet.NUMBERS]
    json.loads(text, parse_constant=Mock(side_effect=AssertionError))  # NaN is no JSON
    path = tmp_path / "sheet.json"
    path.write_text(text, encoding="utf-8")
    about, numbers = read_sheet(path)
    assert about["rig"] == "raised_40deg"
    wanted = [number.value for number in made[0].numbers]
    np.testing.assert_allclose([number.value for number in numbers], wanted, rtol=1e-5)
    assert {number.source for number in numbers} == {OWN, CLOCK}
    assert len(sheet.readable(numbers)) == len(numbers)


@pytest.mark.parametrize(
    "text", [None, "[]", '{"format": 2}', '{"format": 1, "numbers": [{"a": 1}]}']
)
def test_what_is_no_sheet_is_refused(tmp_path, text):
    path = tmp_path / "sheet.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        read_sheet(path)


# --- the other renderer


def test_page_shows_the_other_renderer_and_the_limits(made):
    text = Read(made[1][sheet.PAGE]).text
    shown = side_by_side(load_sweep("second_renderer"))
    assert digits(shown["mm"].iloc[0]) in text
    for fault in FAULTS:
        assert text.count(fault) >= 2  # with two cameras, and with three
    faults = by_fault(load_sweep("stress"), "paper_pair", BEST).set_index("fault")
    assert digits(faults["mm"]["JPEG 60"]) in text
    face = text.split("What these numbers are.")[0]
    for name, *values in by_film(load_sweep("instant_films")).reset_index().values.tolist():
        assert str(name) in face
        assert all(digits(value) in face for value in values if isinstance(value, float))


def test_readme_shows_the_shipped_sheet():
    """Each row: a name, value with unit, interval, n; the unit and n tell which number it is."""
    _, numbers = read_sheet(data_path("accept", "raised_40deg.json"))
    texts = {
        (sheet.value_text(one), sheet.interval_text(one), str(one.n)): one.what for one in numbers
    }
    part = (ROOT / "README.md").read_text().split("## How accurate")[1].split("\n## ")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in part.splitlines()
        if line.startswith("| ")
    ][1:]
    assert len(rows) == 5
    for name, *values in rows:
        assert tuple(values) in texts, name


# --- the control chart


def test_chart_grows_by_a_sheet(made, tmp_path):
    path = tmp_path / "chart.csv"
    first = history.extend(path, rows(made[0], "aaaaaaa"))
    assert len(first) == len(history.CHARTED)
    both = history.extend(path, rows(made[0], "bbbbbbb"))
    assert both["commit"].tolist() == ["aaaaaaa"] * 4 + ["bbbbbbb"] * 4
    again = history.extend(path, rows(made[0], "aaaaaaa").assign(value=7.0))
    assert again["commit"].tolist() == ["bbbbbbb"] * 4 + ["aaaaaaa"] * 4
    assert (again["value"][4:] == 7).all()
    assert len(history.charts(again, "raised_40deg", "coded", 64, 0)) == 4
    # what was measured otherwise is another process
    for k, other in enumerate(("paper_pair", "paper", 32, 1)):
        process = ["raised_40deg", "coded", 64, 0]
        process[k] = other
        assert history.charts(again, *process) == []


# --- the command


@pytest.fixture
def quick(monkeypatch):
    """The command with one test, which takes no time."""
    rng = np.random.default_rng(0)
    found = static_rows(setup(poses=8), np.full((8, 6), 1e-4))
    at_rest = rows_of([rest.places(setup())[0]] * 12, 1e-4 * rng.normal(size=(12, 6)))
    tests = {
        "A1": SimpleNamespace(**vars(rest) | {"parts": lambda s: 1, "run": lambda s, k: at_rest}),
        "A2": SimpleNamespace(
            **vars(static) | {"parts": lambda s: 2, "run": lambda s, k: found[k]}
        ),
    }
    monkeypatch.setattr(work, "TESTS", tests)
    monkeypatch.setattr(command, "TESTS", tests)
    monkeypatch.setattr(command, "RENDERED", ("A1", "A2"))
    monkeypatch.setattr(command.arm, "why_not", lambda: "needs the package mujoco")
    monkeypatch.setattr(command, "WORKERS", 1)


def test_command_writes_the_sheet(quick, tmp_path):
    chart = tmp_path / "chart.csv"
    done = accept(RIG, HANDLE, tmp_path / "out", poses=8, chart=chart, workers=1)
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["index.html", "measured.jsonl", "numbers.csv", "sheet.json"]
    about, numbers = read_sheet(tmp_path / "out" / "sheet.json")
    assert about["poses"] == 8
    assert "trinolab accept --rig raised_40deg.toml --handle coded.toml" in about["command"]
    assert {number.test for number in numbers} == {"A1", "A2"}
    assert len(history.read_history(chart)) == 4
    lines = as_lines(done)
    assert any(line.startswith("A2  position error, rms: 0.000173 mm") for line in lines)
    assert lines[-1] == "A7  not run: needs the package mujoco"
    work.TESTS["A2"].parts = Mock(side_effect=ValueError("rig: no room"))
    done = accept(RIG, HANDLE, tmp_path / "other", poses=8, workers=1)
    assert done.sheet.left_out["A2"] == "rig: no room"
    assert "Not run: rig: no room." in (tmp_path / "other" / "index.html").read_text()


def test_an_interruption_says_how_many_parts_are_kept(quick, tmp_path):
    """The second part of A2 is interrupted; A1 has one part, and A2's first is kept."""
    real = work.TESTS["A2"].run
    work.TESTS["A2"].run = Mock(wraps=real, side_effect=[DEFAULT, KeyboardInterrupt])
    with pytest.raises(KeyboardInterrupt, match=r"^2 of 3 runs are kept in .*; the same command"):
        accept(RIG, HANDLE, tmp_path / "out", poses=8, workers=1)
    assert not (tmp_path / "out" / "index.html").exists()
    kept = command.sheet_folder(tmp_path / "out", []) / command.KEPT
    with locked(kept), pytest.raises(ValueError, match="another process works on it"):
        accept(RIG, HANDLE, tmp_path / "out", poses=8, workers=1)


# --- recordings


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A folder with a recording of a moving handle in small images."""
    root = tmp_path_factory.mktemp("recorded")
    make_healthy(root, 10)
    return root


def test_a_recording_in_the_renderer_s_place(recording, tmp_path, monkeypatch):
    """The tests that need no truth; poses are written once, and taken from there by a second
    call.
    """
    monkeypatch.setattr(command.arm, "why_not", lambda: "needs the package mujoco")
    files = recording / "rec" / "rig.toml", recording / "rec" / "handle.toml"
    out = tmp_path / "out"
    done = accept(*files, out, [recording / "rec"], workers=1)
    table = read_poses(out / "poses_0_rec.csv")
    (number,) = [n for n in done.sheet.numbers if n.what == "measured, of all instants"]
    assert number.value == pytest.approx(100 * (table["status"] == "measured").mean())
    assert (number.source, number.seed, number.n) == ("recording rec", None, 10)
    assert set(done.sheet.left_out) == {"A0", "A1", "A2", "A3", "A4", "A5", "A7"}
    assert "in no recording does the handle rest" in done.sheet.left_out["A1"]
    monkeypatch.setattr(command, "track_folder", None)
    again = accept(*files, out, [recording / "rec"], workers=1)
    assert again.sheet.numbers == done.sheet.numbers
    assert "recording rec" in Read((out / "index.html").read_text()).text


# --- one test measured again


def test_a_renewed_test_has_its_new_numbers_and_says_when(made, tmp_path):
    content = json.loads(made[1][sheet.NUMBERS])
    number = share("A2", "poses measured", 7, 8, 0)
    again = renew.renewed(content, "A2", Answer([number], notes=["Seven."]), "today, by hand")
    path = tmp_path / "sheet.json"
    path.write_text(json.dumps(again), encoding="utf-8")
    _, numbers = read_sheet(path)
    others = [one for one in made[0].numbers if one.test != "A2"]
    assert [one.what for one in numbers if one.test == "A2"] == ["poses measured"]
    assert [one.what for one in numbers if one.test != "A2"] == [one.what for one in others]
    assert [one.test for one in numbers] == sorted(one.test for one in numbers)
    assert again["notes"]["A2"] == ["Seven.", "This test was measured again today, by hand."]
    assert again["notes"]["A1"] == content["notes"]["A1"]
    assert content["notes"]["A2"] != again["notes"]["A2"]
