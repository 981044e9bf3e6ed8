"""Exercises and their graders: every solution passes, every stub fails, every mistake is known."""

import io
import json
import re
import shutil
import threading
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from chapters import is_study
from scipy.spatial.transform import RigidTransform, Rotation
from wayward import asks, changes, ends, hangs, waits, warns

from workbench.cli import main
from workbench.course import check, submissions
from workbench.course.child import BEING_CHECKED, executed, outcome, plain_value
from workbench.course.exercise import KINDS, FunctionExercise, ValueExercise
from workbench.course.exercises import CHAPTERS, exercise, of_chapter
from workbench.course.grading import call_of, judge_outcomes, judge_values
from workbench.course.plain import MOST_NUMBERS, described, equal, plain
from workbench.course.running import Found, how, run_file, run_given
from workbench.course.stubs import head_of
from workbench.course.submissions import cells_of
from workbench.provenance import code_hash

ALL = [one for chapter in CHAPTERS for one in of_chapter(chapter)]
NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"
# how the titles in the chapters name the kinds
NAMED = (
    "Pencil",
    "Write it yourself",
    "Change and predict",
    "Project",
    "Repair",
    "Real recording",
    "Open design",
)


def text_of(chapter):
    """The markdown of a chapter: of its lesson, then of its studies."""
    paths = sorted(NOTEBOOKS.glob(f"{chapter}*.ipynb"), key=lambda path: is_study(path.stem))
    cells = [cell for path in paths for cell in json.loads(path.read_text("utf-8"))["cells"]]
    return "\n\n".join("".join(it["source"]) for it in cells if it["cell_type"] == "markdown")


def judged(asked, answer):
    """The verdict on an answer, in this process: the code is ours."""
    if isinstance(asked, ValueExercise):
        return judge_values(asked, plain_value(answer))
    return judge_outcomes(asked, [outcome(answer, case) for case in call_of(asked).cases])


def stub(*_):
    raise NotImplementedError


def test_every_solution_passes():
    assert [one.number for one in ALL if not judged(one, one.answer).right] == []


def test_every_stub_fails_and_is_told_so():
    for one in ALL:
        answer = stub if isinstance(one, FunctionExercise) else dict.fromkeys(one.asked, ...)
        verdict = judged(one, answer)
        assert not verdict.right, one.number
        assert "still to be" in verdict.says, verdict


def test_every_mistake_is_recognised():
    """Each one by its own words: no two of an exercise give the same."""
    for one in ALL:
        assert len(one.mistakes) >= 3, one.number
        for mistake in one.mistakes:
            answer = mistake.gives
            if isinstance(one, ValueExercise):
                assert set(answer) <= set(one.asked), one.number
                answer = one.answer | answer
            verdict = judged(one, answer)
            assert not verdict.right, (one.number, mistake.says)
            says = f"{mistake.says} Read chapter {mistake.read}."
            assert verdict.says == says.replace("?.", "?"), one.number


def test_no_answer_is_told_apart_by_a_hair():
    """A wrong value lies well beyond the tolerance of the right one, and of another wrong one."""
    for one in ALL:
        if not isinstance(one, ValueExercise):
            continue
        for name, asked in one.asked.items():
            if isinstance(asked.value, str):
                assert asked.value in asked.choices, one.number
                continue
            wrong = [it.gives[name] for it in one.mistakes if name in it.gives]
            assert all(abs(value - asked.value) > 2 * asked.within for value in wrong), one.number


def test_exercises_are_whole():
    assert len({one.number for one in ALL}) == len(ALL) >= 48
    for chapter in CHAPTERS:
        exercises = of_chapter(chapter)
        assert [one.number for one in exercises] == [
            f"{chapter}.{k}" for k in range(1, len(exercises) + 1)
        ]
        for one in exercises:
            assert one.kind in KINDS
            assert one.points > 0
            for text in (mistake.says for mistake in one.mistakes):
                assert text.endswith((".", "?")), text


def test_the_chapters_tell_the_same_exercises():
    """Number, kind, title and label; each with two hints and its solution, in this order."""
    for chapter in CHAPTERS:
        found = re.findall(
            r"^```\{exercise\} (\d+\.\d) ([\w ]+): (.+)\n:label: (\S+)\n:nonumber:\n",
            text_of(chapter),
            re.MULTILINE,
        )
        told = [
            (
                f"{float(number):04.1f}",
                KINDS[NAMED.index(kind)],
                title[0].upper() + title[1:],
                label,
            )
            for number, kind, title, label in found
        ]
        ours = of_chapter(chapter)
        assert told == [(one.number, one.kind, one.title, one.label) for one in ours]
        assert {one.kind for one in ours} >= set(KINDS[:4]), chapter
        blocks = re.findall(
            r"^```\{(?:exercise|hint|solution)\} (.+)$", text_of(chapter), re.MULTILINE
        )
        assert len(blocks) == 4 * len(ours)
        for k, one in enumerate(ours):
            shown = one.number.lstrip("0")
            hints = [f"{which} hint to {shown}" for which in ("First", "Second")]
            assert blocks[4 * k + 1 : 4 * k + 4] == [*hints, one.label], one.number


def plainly(heading):
    """A heading without the signs of its formulas, as a shell can show it."""
    return heading.replace("$", "").replace("\\", "")


def test_a_mistake_leads_to_a_heading():
    headings = {}
    for chapter in CHAPTERS:
        found = re.findall(r"^#+ (.+)$", text_of(chapter), re.MULTILINE)
        headings[chapter] = {plainly(heading) for heading in found}
    for one in ALL:
        for mistake in one.mistakes:
            number, _, heading = mistake.read.partition(", ")
            assert plainly(heading) in headings[number.zfill(2)], (one.number, mistake.read)


def test_a_statement_names_what_is_asked_for():
    """The names of the values and their choices, the function's name and its arguments."""
    for one in ALL:
        chapter = text_of(one.number[:2])
        start = chapter.index(f"\n:label: {one.label}\n")
        statement = " ".join(chapter[start : chapter.index("\n```\n", start)].split())
        assert f'check("{one.number}", ' in statement, one.number
        if isinstance(one, FunctionExercise):
            code = one.solution.__code__
            arguments = ", ".join(code.co_varnames[: code.co_argcount])
            assert f"`{one.name}({arguments})`" in statement, one.number
            continue
        for name, asked in one.asked.items():
            assert f'"{name}": ...' in statement, (one.number, name)
            for choice in asked.choices:
                assert f'"{choice}"' in statement, (one.number, name, choice)


def test_the_function_of_a_notebook_is_checked_in_a_process_of_its_own():
    asked = exercise("04.2")
    assert check("04.2", asked.solution).right

    def wrong(observations, mean, variance, growth, noise):
        print("look")
        return [mean for _ in observations]

    assert str(check("04.2", wrong)).startswith("04.2 not yet: filter_number(")
    assert "to be a function, not a number" in str(check("04.2", 3.0))
    with pytest.raises(ValueError, match=r"there is no exercise '04\.99'"):
        check("04.99", wrong)
    assert check("4.2", 3.0).number == "04.2"
    lock = threading.Lock()
    verdict = check("04.2", lambda *_: lock)
    assert "cannot be tried in a process of its own" in str(verdict)


def test_what_is_handed_in_by_other_names_is_said():
    asked = exercise("04.1")
    assert "Gain is not asked for; the names are gain, mean, variance" in str(
        judged(asked, asked.answer | {"Gain": 1})
    )
    assert str(judged(asked, 0.4)).endswith('expected {"gain": ..., "mean": ..., "variance": ...}.')
    assert str(judged(asked, asked.answer | {"gain": 0.1})).endswith(
        "gain is not 0.1. Right so far: mean, variance."
    )
    assert str(judged(asked, ...)).endswith("answer_04_1 is still to be filled in.")
    assert "to be a number, not the text '0.4'" in str(
        judged(asked, asked.answer | {"gain": "0.4"})
    )


def test_a_small_difference_in_a_large_array_is_told():
    asked = exercise("04.3")

    def nearly(*arguments):
        X, P = asked.solution(*arguments)
        P = P.copy()
        P[2, 2] += 1e-5
        return X, P

    says = str(judged(asked, nearly))
    assert "returns 2 things; number 2 is an array of the shape (6, 6), of which 1 of 36" in says
    assert "at [2, 2] it is off by 1e-05" in says


def test_whatever_a_function_does_is_seen_and_the_next_one_is_tried():
    from workbench.course.child import Call

    functions = (ends, hangs, waits, asks, changes, warns, len)
    given = {function.__name__: function for function in functions}
    calls = [Call(name, [([1, 2],), ([3],)]) for name in given]
    found = run_given(given, calls, cpu_s=0.5, wait_s=3.0).outcomes
    assert found["ends"] == [{"stuck": "ends Python (exit code 3)"}]
    assert found["hangs"][0]["stuck"].startswith("does not end: it was stopped")
    assert found["waits"][0]["stuck"].startswith("does not end: it was stopped")
    assert found["asks"][0]["raised"].startswith("EOFError")
    assert [one["changed"] for one in found["changes"]] == [[0], [0]]
    assert not any(one["printed"] for one in found["warns"])
    assert found["len"][0]["returned"]["numbers"] == [2.0]


def test_what_is_returned_is_compared_by_what_it_is():
    assert equal(plain([1, 2]), plain(np.array([1.0, 2.0])), 1e-9)
    assert equal(plain((np.eye(2), None)), plain([[[1, 0], [0, 1]], None]), 1e-9)
    assert equal(plain([np.nan, 1]), plain([np.nan, 1 + 1e-12]), 1e-9)
    assert equal(plain([]), plain(np.zeros((0, 2))), 1e-9)
    assert equal(plain([1e-12, 0.0]), plain([0.0, 0.0]), 1e-9)
    assert equal(plain([1, 2]), plain([[1], [2]]), 1e-9)
    assert equal(plain(3), plain([[3.0]]), 1e-9)
    assert not equal(plain([1, 2]), plain([[1, 2], [1, 2]]), 1e-9)
    assert not equal(plain([[1, 2], [3, 4]]), plain([1, 2, 3, 4]), 1e-9)
    assert not equal(plain(None), plain(0.0), 1e-9)
    assert plain(object()) == "a value of the type object"


def test_motions_are_compared_as_their_matrices():
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3])
    T = RigidTransform.from_components([1.0, 2.0, 3.0], turn)
    assert equal(plain(turn), plain(turn.as_matrix()), 1e-9)
    assert equal(plain(T), plain(T.as_matrix()), 1e-9)
    assert not equal(plain(T), plain(T.inv()), 1e-9)


def test_too_many_numbers_are_counted_and_not_sent():
    assert plain(np.zeros(MOST_NUMBERS))["shape"] == [MOST_NUMBERS]
    assert plain(np.zeros(MOST_NUMBERS + 1)) == "an array of 100001 numbers"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "None"),
        (True, "a number"),
        ([[1, 2], [3, 4]], "an array of the shape (2, 2)"),
        ((1.0, None), "2 things: a number, None"),
        ({1}, "a value of the type set"),
        ("left", "the text 'left'"),
    ],
)
def test_what_is_returned_is_named_by_its_kind(value, words):
    assert described(plain(value)) == words


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("time", "does not end: it was stopped after 9 s"),
        (-14, "does not end: it was stopped after 7 s"),
        (-24, "does not end: it was stopped after 5 s of computing"),
        ("memory", "was ended by the system: it may have asked for too much memory"),
        (-9, "was ended by the system: it may have asked for too much memory"),
        ("processes", "was ended: it has started more than 16 processes"),
        (3, "ends Python (exit code 3)"),
    ],
)
def test_how_a_process_ended_is_said_in_words(code, words):
    assert how(code, cpu_s=5.0, wait_s=7.0, enough_s=9.0) == words


def test_what_is_not_there_is_said_with_the_reason():
    asked = exercise("04.2")
    reasons = {
        "filter_number is not there.": Found(),
        "filter_number is not there, because cell 2 hangs.": Found(stuck="cell 2 hangs"),
        "filter_number is not there; cell 1 raises NameError: x.": Found(
            raised={"cell 1": "NameError: x"}
        ),
    }
    for says, found in reasons.items():
        verdict = submissions.verdict_of(asked, found)
        assert (verdict.says, verdict.points, verdict.of) == (says, 0, asked.points)


def test_a_chapter_that_is_none_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match=r"there is no chapter '13'; they are 01, 02, .*, 12$"):
        exercise("13.1")


def test_an_exercise_without_a_docstring_cannot_be_handed_out():
    def add(a, b):
        """The sum."""
        return a + b

    def bare(a, b):
        return a + b

    assert head_of(add).splitlines() == ["def add(a, b):", '    """The sum."""']
    with pytest.raises(ValueError, match="bare: expected a docstring, which students get"):
        head_of(bare)


def test_cells_run_one_after_the_other_without_their_magic(tmp_path, monkeypatch):
    """As in the process in which a student's file runs; a cell that raises is passed over."""
    monkeypatch.setenv(BEING_CHECKED, "")
    file = tmp_path / "04_kalman.ipynb"
    file.write_text(
        notebook(
            "%matplotlib inline\na = 1\n!ls",
            ["print('heard by nobody')\n", "b = a + 1\n"],
            "raise SystemExit",
            "c = a + b",
        )
    )
    answers = io.StringIO()
    namespace = executed(cells_of(file), answers)
    assert (namespace["b"], namespace["c"]) == (2, 3)
    lines = [json.loads(line) for line in answers.getvalue().splitlines()]
    assert lines == [
        ["at", "cell 1"],
        ["at", "cell 2"],
        ["at", "cell 3"],
        ["raised", "cell 3", "SystemExit"],
        ["at", "cell 4"],
    ]


def test_a_line_of_python_that_begins_as_magic_does_is_none(tmp_path, monkeypatch):
    monkeypatch.setenv(BEING_CHECKED, "")
    file = tmp_path / "04_kalman.ipynb"
    file.write_text(notebook("share = (7\n% 4)", 'text = """\n%d of all\n!"""'))
    namespace = executed(cells_of(file), io.StringIO())
    assert namespace["share"] == 3
    assert namespace["text"] == "\n%d of all\n!"


def notebook(*sources):
    cells = [{"cell_type": "code", "source": source} for source in sources]
    return json.dumps({"cells": cells, "nbformat": 4, "nbformat_minor": 5, "metadata": {}})


def test_a_file_that_never_ends_is_stopped_and_one_that_raises_is_named():
    raises = [("04.py", "answer = 1\n1 / 0\n")]
    found = run_file(raises, [], ["answer"])
    assert found.raised == {"04.py": "ZeroDivisionError: division by zero"}
    assert found.values == {"answer": plain(1)}
    found = run_file([("04.py", "while True:\n    pass\n")], [], ["answer"], cells_s=1.0)
    assert found.stuck == "04.py does not end: it was stopped after 1 s of computing"


RIGHT = "answer_04_1 = {'gain': 0.444, 'mean': 6.889, 'variance': 0.444}"


def test_a_notebook_is_checked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "04_kalman.ipynb"
    file.write_text(notebook("%matplotlib inline\n1 / 0", RIGHT, "def filter_number(*a): return 3"))
    assert main(["check", "04"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "04.1 right: gain, mean, variance are right."
    assert lines[1].startswith("04.2 not yet: filter_number(")
    assert lines[-1].startswith("2 of ")
    file.write_text(notebook("1 / 0"))
    assert main(["check", "04"]) == 1
    first = capsys.readouterr().out.splitlines()[0]
    assert first == (
        "04.1 not yet: answer_04_1 is not there; cell 1 raises ZeroDivisionError: division by zero."
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["04"], "expected one file 04*.ipynb or 04*.py, found none"),
        (["99"], "expected one of"),
        (["04", "nowhere.ipynb"], "nowhere.ipynb: there is no such file"),
        (["04", "broken.ipynb"], "broken.ipynb: is no notebook that can be read"),
        ([], "expected a chapter"),
        (["--all", "nowhere"], "nowhere: expected a folder"),
    ],
)
def test_a_mistake_of_the_caller_is_one_line(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.ipynb").write_text("{")
    assert main(["check", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


def test_a_folder_without_a_file_of_a_student_is_refused(tmp_path, capsys):
    (tmp_path / "class" / "ada").mkdir(parents=True)
    (tmp_path / "class" / "ada" / "notes.txt").touch()
    assert main(["check", "--all", str(tmp_path / "class")]) == 2
    assert "class: no folder in it has a file like 04_kalman.ipynb" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "is_one"),
    [
        ('{"student": "a", "chapter": "04", "hash": "x", "verdicts": []}', True),
        ('{"student": "a", "chapter": "04", "hash": "x"}', False),
        ('{"student": "a", "chap', False),
        ("4", False),
    ],
)
def test_a_kept_line_that_is_damaged_is_none(line, is_one):
    assert submissions.is_line(0, line) is is_one


def test_a_class_is_checked_once(tmp_path, monkeypatch):
    for name, source in (("ada", RIGHT), ("bob", "answer_04_1 = {'gain': 0.5}")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "04_kalman.ipynb").write_text(notebook(source))
    assert main(["check", "--all", str(tmp_path)]) == 0
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert rows[0].startswith("student,04.1,04.2,")
    assert rows[1].startswith("ada,2,0,")
    assert rows[2].startswith("bob,0,0,")
    asked = []
    checked = submissions._checked

    def counted(chapter, path, beside):
        asked.append(path.parent.name)
        return checked(chapter, path, beside)

    monkeypatch.setattr(submissions, "_checked", counted)
    shutil.copytree(tmp_path / "ada", tmp_path / "eve")
    assert main(["check", "--all", str(tmp_path)]) == 0
    assert asked == ["eve"]
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert [row.split(",")[:2] for row in rows[1:]] == [["ada", "2"], ["bob", "0"], ["eve", "2"]]


def test_a_class_is_checked_anew_when_a_chapter_s_exercises_have_changed(tmp_path, monkeypatch):
    (tmp_path / "ada").mkdir()
    (tmp_path / "ada" / "04_kalman.ipynb").write_text(notebook(RIGHT))
    asked = []
    monkeypatch.setattr(submissions, "_checked", lambda chapter, *_: asked.append(chapter) or [])
    submissions.check_class(tmp_path, tmp_path / "points.csv")
    submissions.check_class(tmp_path, tmp_path / "points.csv")
    assert asked == ["04"]
    monkeypatch.setattr(submissions, "code_hash", _with_another_kalman)
    submissions.check_class(tmp_path, tmp_path / "points.csv")
    assert asked == ["04", "04"]


def _with_another_kalman(module):
    """What `code_hash` would give if somebody had changed the exercises of chapter 4."""
    return "another" if module.endswith(".exercises.kalman") else code_hash(module)


def test_no_two_mistakes_of_an_exercise_say_the_same():
    for one in ALL:
        for a, b in combinations(one.mistakes, 2):
            assert a.says != b.says, one.number
