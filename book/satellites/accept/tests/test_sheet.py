"""The data sheet's files, its control chart, and the work that is kept: on tests that take no
time.
"""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from healthy import make_healthy, run
from sheetrows import pointer_rows, rows_of, setup, static_rows

from satellites.accept import command, history, pointer, renew, rest, sheet, static, work
from satellites.accept.command import accept, as_lines
from satellites.accept.numbers import CLOCK, LARGEST, OWN, Answer, Number, far_count, share
from satellites.accept.sheet import Sheet, contents, digits, read_sheet
from satellites.accept.work import Source
from trinolab.datasets import data_path, load_sweep
from trinolab.files.inputs import read_json
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
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe"}
    sources = [attrs["src"] for tag, attrs in page.tags if tag == "img"]
    assert len(sources) >= 8
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert all(link[0] == "#" and link[1:] in ids for link in links)
    assert "url(" not in made[1][sheet.PAGE]


def test_every_picture_says_what_it_shows(made):
    page = Read(made[1][sheet.PAGE])
    texts = [attrs["alt"] for tag, attrs in page.tags if tag == "img"]
    assert min(map(len, texts)) > 60


def test_page_fits_a_telephone_and_both_themes(made):
    page = made[1][sheet.PAGE]
    assert 'name="viewport"' in page
    assert "prefers-color-scheme: dark" in page
    assert "max-width: 100%" in page


def test_page_says_what_its_numbers_are(made):
    text = Read(made[1][sheet.PAGE]).text
    for sentence in (sheet.CRIME, sheet.AFTER, "Not run: needs the package mujoco."):
        assert sentence in text
    for standard in ("E2919", "F2554", "ISO 9283", "Wiles"):
        assert standard in text
    assert "conformity with none of them is claimed" in text
    assert "three <cameras> & more" in text  # escaped, not a tag


def test_page_has_every_number(made):
    text = Read(made[1][sheet.PAGE]).text
    for number in made[0].numbers:
        assert sheet.value_text(number) in text
        assert number.what in text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0031234, "0.00312"), (12.3456, "12.3"), (100.0, "100"), (512.4, "512"), (0.0, "0")],
)
def test_three_digits(value, text):
    assert digits(value) == text
    assert digits(np.nan) == ""


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


def test_every_number_has_an_interval_or_is_none_to_have_one(made):
    """The largest of n says how much lies below it, a count how large the share may be."""
    for number in made[0].numbers:
        assert number.interval or number.note, number


def test_json_is_read_back(made, tmp_path):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    text = made[1][sheet.NUMBERS]
    json.loads(text, parse_constant=refuse)
    path = tmp_path / "sheet.json"
    path.write_text(text, encoding="utf-8")
    about, numbers = read_sheet(path)
    assert about["rig"] == "raised_40deg"
    wanted = [number.value for number in made[0].numbers]
    np.testing.assert_allclose([number.value for number in numbers], wanted, rtol=1e-5)
    assert {number.source for number in numbers} == {OWN, CLOCK}
    assert len(sheet.readable(numbers)) == len(numbers)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"format": 2}', '{"format": 1, "numbers": [{"a": 1}]}']
)
def test_what_is_no_sheet_is_refused(tmp_path, text):
    path = tmp_path / "sheet.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        read_sheet(path)


def test_a_sheet_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"sheet\.json: cannot be read \(No such file"):
        read_sheet(tmp_path / "sheet.json")


def test_a_test_without_numbers_has_its_notes_and_no_table():
    note = "Nothing came to rest."
    number = share("A2", "poses measured", 8, 8, 0)
    assert sheet.numbers_table([]) == ""
    titles = {"A1": "Rest", "A2": "Static"}
    answers = {"A1": Answer(notes=[note]), "A2": Answer([number])}
    about = {"rig": "r", "handle": "h", "summary": ""}
    text = Read(contents(Sheet(about, answers, titles))[sheet.PAGE]).text
    of_rest, behind = text.split(note)
    assert "poses measured" in behind
    assert "poses measured" not in of_rest.split("A1")[-1]


# --- the other renderer


def test_page_shows_the_other_renderer_and_the_limits(made):
    text = Read(made[1][sheet.PAGE]).text
    shown = side_by_side(load_sweep("second_renderer"))
    assert digits(shown["mm"].iloc[0]) in text
    for fault in FAULTS:
        assert text.count(fault) >= 2  # with two cameras, and with three
    (row,) = (
        by_fault(load_sweep("stress"), "paper_pair", BEST)
        .query("fault == 'JPEG 60'")
        .to_dict("records")
    )
    assert digits(row["mm"]) in text


def test_a_sheet_begins_with_what_a_user_gets_and_the_latency_and_its_worst():
    _, numbers = read_sheet(data_path("accept", "raised_40deg.json"))
    first = [(called, quantity) for _, called, quantity, _ in sheet.glance(numbers)][:6]
    age = "age of a pose when it is there"
    own = "With a calibration of your own"
    assert first == [
        *((own, f"{kind}: expanded, U = 2 u, rms") for kind in ("depth", "across", "rotation")),
        *(("Latency", f"{age}, {statistic}") for statistic in ("median", "99 %", LARGEST)),
    ]


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


def test_page_begins_with_the_times_of_instants_beside_errors_nees_and_share(made):
    text = Read(made[1][sheet.PAGE]).text
    face = text.split("What these numbers are.")[0]
    films = by_film(load_sweep("instant_films"))
    for name in films:
        assert name in face
    for row in films.itertuples(index=False):
        assert row[0] in face
        assert all(digits(value) in face for value in row if isinstance(value, float))


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
    for other in (
        ("paper_pair", "coded", 64, 0),
        ("raised_40deg", "paper", 64, 0),
        ("raised_40deg", "coded", 32, 0),
        ("raised_40deg", "coded", 64, 1),
    ):
        assert history.charts(again, *other) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "'date' is missing"), (None, "'value' holds something that is no number")],
)
def test_what_is_no_chart_is_refused(made, tmp_path, text, message):
    path = tmp_path / "chart.csv"
    if text is None:
        text = rows(made[0]).assign(value="much").to_csv(index=False)
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        history.extend(path, rows(made[0]))
    assert path.read_text() == text


# --- the work that is kept


def test_parts_belong_to_files_size_and_seed():
    source = Source(str(RIG), str(HANDLE), 8, 0)
    other = str(data_path("handles", "paper.toml"))
    made_from = [
        source.made_from,
        source._replace(poses=9).made_from,
        source._replace(seed=1).made_from,
        source._replace(handle=other).made_from,
    ]
    assert len(set(map(str, made_from))) == 4


# --- the command


@pytest.fixture
def quick(monkeypatch):
    """The command with one test, which takes no time."""
    rng = np.random.default_rng(0)
    found = static_rows(setup(poses=8), np.full((8, 6), 1e-4))

    def judge(setup, rows):
        return static.judge(setup, rows)

    fake = SimpleNamespace(
        NAME="A2", TITLE=static.TITLE, parts=lambda s: 2, run=lambda s, k: found[k], judge=judge
    )
    at_rest = rows_of([rest.places(setup())[0]] * 12, 1e-4 * rng.normal(size=(12, 6)))
    still = SimpleNamespace(
        NAME="A1",
        TITLE=rest.TITLE,
        parts=lambda s: 1,
        run=lambda s, k: at_rest,
        judge=rest.judge,
    )
    monkeypatch.setattr(work, "TESTS", {"A1": still, "A2": fake})
    monkeypatch.setattr(command, "TESTS", {"A1": still, "A2": fake})
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


def test_a_test_without_room_is_left_out(quick, tmp_path, monkeypatch):
    def none(setup):
        raise ValueError("rig: no room")

    monkeypatch.setattr(work.TESTS["A2"], "parts", none)
    done = accept(RIG, HANDLE, tmp_path / "out", poses=8, workers=1)
    assert done.sheet.left_out["A2"] == "rig: no room"
    assert "Not run: rig: no room." in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--poses 7", "poses: expected"),
        ("--seed -1", "seed: expected"),
        ("--rig none.toml", "none.toml"),
        ("--recording nowhere", "nowhere: no such folder"),
        ("--chart none/chart.csv", "no such folder"),
    ],
)
def test_wrong_input_is_one_line(options, message, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = f"accept --rig {RIG} --handle {HANDLE} --out out {options}"
    assert run(line) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert message in err
    assert not (tmp_path / "out" / "index.html").exists()


def test_a_file_in_the_folder_s_place_is_refused_and_left_as_it_is(tmp_path):
    out = tmp_path / "out"
    out.write_text("mine")
    with pytest.raises(ValueError, match="out: cannot be written"):
        accept(RIG, HANDLE, out, poses=8)
    assert out.read_text() == "mine"


def test_an_interruption_says_how_many_parts_are_kept(quick, tmp_path, monkeypatch):
    """The second part of A2 is interrupted; A1 has one part, and A2's first is kept."""
    found = work.TESTS["A2"].run

    def run(setup, k):
        if k:
            raise KeyboardInterrupt
        return found(setup, k)

    monkeypatch.setattr(work.TESTS["A2"], "run", run)
    with pytest.raises(KeyboardInterrupt, match=r"^2 of 3 runs are kept in .*; the same command"):
        accept(RIG, HANDLE, tmp_path / "out", poses=8, workers=1)
    assert not (tmp_path / "out" / "index.html").exists()


def test_two_commands_with_one_folder(quick, tmp_path):
    kept = command.sheet_folder(tmp_path / "out", []) / command.KEPT
    with locked(kept), pytest.raises(ValueError, match="another process works on it"):
        accept(RIG, HANDLE, tmp_path / "out", poses=8, workers=1)


# --- counts


def test_counts_say_how_sure_they_are():
    assert share("A2", "poses", 10, 10, 0).low == pytest.approx(72.2, abs=0.1)
    none = far_count("A2", 0, 512, 0)
    assert none.value == 0
    assert none.note == "a share of at most 0.58 %, 95 % sure"
    assert Answer().numbers == []


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


def test_a_folder_that_is_no_recording_is_refused(recording, tmp_path):
    with pytest.raises(ValueError, match="nowhere"):
        accept(
            recording / "rig.toml",
            recording / "handle.toml",
            tmp_path / "out",
            [recording / "rec", tmp_path / "nowhere"],
        )
    assert not (tmp_path / "out").exists()


def test_an_acceptance_is_said_with_the_time_that_it_took(monkeypatch, capsys):
    monkeypatch.setattr(command, "accept", lambda *given: SimpleNamespace(cpu_s=12.6))
    monkeypatch.setattr(command, "as_lines", lambda done: ["passed", "3 of 3"])
    assert run("accept --rig paper_pair --handle paper --out sheet.html") == 0
    assert capsys.readouterr().out.splitlines() == [
        "passed",
        "3 of 3",
        "13 s of processor time; written to sheet.html",
    ]


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


def test_a_test_is_measured_again_from_its_parts_which_are_kept(monkeypatch, tmp_path):
    done = []
    fake = SimpleNamespace(
        parts=lambda setup: 2,
        run=lambda setup, k: done.append(k) or [k],
        judge=lambda setup, rows: Answer(notes=[str(rows)]),
    )
    monkeypatch.setitem(work.TESTS, "A5", fake)
    source = Source(str(RIG), str(HANDLE), 8, 0)
    for _ in range(2):
        answer = renew.measured_again(source, "A5", tmp_path / "new" / "kept.jsonl", 1)
        assert answer.notes == ["[[0], [1]]"]
    assert done == [0, 1]


def test_the_command_renews_the_shipped_sheet(monkeypatch, tmp_path):
    content = read_json(data_path("accept", "raised_40deg.json"))
    copy = tmp_path / "raised_40deg.json"
    copy.write_text(json.dumps(content), encoding="utf-8")
    asked = []
    number = share("A6", "measured, of all instants", 3, 4, 0)

    def again(source, name, kept, workers):
        asked.append((source.poses, source.seed, name, workers))
        return Answer([number])

    monkeypatch.setattr(renew, "measured_again", again)
    monkeypatch.setattr(
        renew, "data_path", lambda *parts: copy if parts[0] == "accept" else data_path(*parts)
    )
    monkeypatch.setattr("sys.argv", ["renew", "A6", "--workers", "1"])
    renew.main()
    assert asked == [(content["about"]["poses"], content["about"]["seed"], "A6", 1)]
    written = read_json(copy)
    assert [row["value"] for row in written["numbers"] if row["test"] == "A6"] == [75.0]
    assert "with the code of commit" in written["notes"]["A6"][-1]
