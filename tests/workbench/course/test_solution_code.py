"""The code in the solutions of exercises on recordings, and of projects, prints the values that are asked
for. A recording that is not here is skipped with the reason.
"""

import contextlib
import io
import logging
import re
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from chapters import LESSONS
from executed import as_it_stands
from solutions import ALL, TEXTS, agrees, code_in

from trinolab import matching, triangulation
from trinolab.calibration.target import find_corners
from trinolab.camera import Rig
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.fetch import why_not
from workbench.course.child import BEING_CHECKED, executed
from workbench.course.exercises import exercise
from workbench.course.exercises.markers import spot_centroid
from workbench.course.submissions import cells_of
from workbench.studies import real_recordings

RECORDINGS = [one for one in ALL if one.kind == "recording"]
READS = re.compile(r"real_recordings\.load_(\w+)\(fetch=True\)")
# what the chapters have imported and defined by then
KNOWN = {
    "Rig": Rig,
    "combinations": combinations,
    "cv2": cv2,
    "find_corners": find_corners,
    "matching": matching,
    "np": np,
    "real_recordings": real_recordings,
    "replace": replace,
    "spot_centroid": spot_centroid,
    "triangulation": triangulation,
}


def needs(name):
    """A mark for a test: skipped where a recording is not here."""
    reason = f"no {name}: {why_not(load_real_sets()[name])}"
    return pytest.mark.skipif(real_set(name) is None, reason=reason)


def recording_of(asked):
    """The recording that the statement says how to read, and no other."""
    (name,) = READS.findall(TEXTS[asked.number].statement)
    return name


def printed_by(number, known):
    """The numbers that a solution's code prints, and what it makes."""
    code = code_in(TEXTS[number].solution)
    if number == "07.7":  # goes on from the exercise before
        code = f"{code_in(TEXTS['07.6'].solution)}\n{code}"
    made = dict(known)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(code, made)
    numbers = [float(one) for one in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", out.getvalue())]
    if number == "03.8":
        numbers.append(0.95**11)  # the first weight follows without a program
    if number == "07.7":
        numbers.append(numbers[-3] - numbers[-5])  # focal lengths without distortion, and with all
    return numbers, made


def has_values(number, numbers, leaving=()):
    """The values that are asked for are among these numbers, but for their signs."""
    for name, one in exercise(number).asked.items():
        if not isinstance(one.value, str) and name not in leaving:
            near = min(np.abs(numbers), key=lambda number, one=one: abs(number - one.value))
            agrees(number, **{name: near})


def test_twelve_statements_say_what_to_do_without_the_recording():
    assert len(RECORDINGS) == 12
    for asked in RECORDINGS:
        assert recording_of(asked) in load_real_sets()
        first = TEXTS[asked.number].statement.split("\n\n")[0]
        assert "missing" in first or "exercise" in first, asked.number


@pytest.mark.parametrize("name", ["opencv_stereo", "trajectories"])
def test_what_is_not_here_is_said_in_a_line(name, monkeypatch, tmp_path, caplog):
    """Those two are fetched by nobody: who has not got them is told what to do."""
    monkeypatch.setenv("TRINOLAB_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with caplog.at_level(logging.INFO), pytest.raises(ValueError, match=name) as caught:
        getattr(real_recordings, f"load_{name}")(fetch=True)
    assert "\n" not in str(caught.value)
    assert "set TRINOLAB_DATA to a folder that has" in str(caught.value)


@pytest.mark.parametrize(
    "asked",
    [pytest.param(one, id=one.number, marks=needs(recording_of(one))) for one in RECORDINGS],
)
def test_the_solution_s_code_prints_the_values(asked):
    numbers, _ = printed_by(asked.number, KNOWN)
    has_values(asked.number, numbers)


# projects whose code goes on from the chapter's cells, and the values that it does not print
PROJECTS = {
    "01.5": (),
    "03.6": ("tiles_missed",),
    "04.5": ("inside",),
    "06.7": (),
    "07.5": (),
    "08.7": ("noise_ratio",),
}


def lesson(number):
    (path,) = (path for path in LESSONS if path.stem.startswith(number[:2]))
    return path


@pytest.mark.heavy
@pytest.mark.parametrize("number", PROJECTS)
def test_a_project_s_code_prints_the_values(number, monkeypatch):
    monkeypatch.setenv(BEING_CHECKED, "1")
    said = io.StringIO()
    made = executed(cells_of(lesson(number)), said)
    assert '"raised"' not in said.getvalue()
    numbers, _ = printed_by(number, made)
    has_values(number, numbers, PROJECTS[number])


@pytest.mark.heavy
def test_a_chapter_glues_the_values():
    glued = as_it_stands(lesson("06.6")).results
    agrees("06.6", wrong=glued["wrong_blind"], missing=glued["missing_blind"])


@needs("caliscope")
def test_the_pair_that_shares_most_corners():
    together = np.triu(printed_by("02.6", KNOWN)[1]["together"], 1)
    i, j = np.unravel_index(together.argmax(), together.shape)
    agrees("02.6", pair=f"{i} and {j}")


@needs("trajectories")
def test_one_more_step_like_the_last():
    """By differences of differences: the n-th is what a polynomial of the order n - 1 leaves."""
    places = real_recordings.load_trajectories().poses.translation

    def off(order, k):
        left = places
        for _ in range(order):
            left = left[k:] - left[:-k]
        return np.linalg.norm(left[(3 - order) * k :], axis=1)

    rules = {"place": 1, "speed": 2, "acceleration": 3}
    agrees("04.7", **{f"{name}_mm": np.median(off(order, 3)) for name, order in rules.items()})
    medians = {name: np.median(off(order, 20)) for name, order in rules.items()}
    squares = {name: np.mean(off(order, 20) ** 2) for name, order in rules.items()}
    best = {"best_median": min(medians, key=medians.get), "best_rms": min(squares, key=squares.get)}
    agrees("04.7", **best)
