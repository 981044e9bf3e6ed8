"""What runs in the browser beside a chapter, tried here: OpenCV's own answers are the reference."""

import json
import re

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.browser.guest import door, opencv, session
from workbench.imports import our_files

# what OpenCV.js lacks: a cell that comes to it says so
MISSING = {
    "cornerSubPix",
    "findChessboardCorners",
    "findChessboardCornersSBWithMeta",
    "getFontScaleFromHeight",
    "imread",
}
rng = np.random.default_rng(3)
GREY = rng.integers(0, 256, (31, 44), dtype=np.uint8)
OTHER = rng.integers(0, 256, (31, 44), dtype=np.uint8)


def test_arrays_cross_the_door_with_their_type_and_shape(door_page):
    door_page.answer = {"value": 3}, [np.arange(6, dtype=np.int16).reshape(2, 3)]
    answer, (array,) = door.ask({"asks": "anything"}, [GREY[:, ::2], np.array(2.5)])
    assert answer["value"] == 3
    assert array.dtype == np.int16
    assert array.tolist() == [[0, 1, 2], [3, 4, 5]]
    _, (cut, number) = door_page.asked
    assert np.array_equal(cut, GREY[:, ::2])
    assert number.shape == ()


def test_what_the_other_side_cannot_do_is_an_error_of_opencvs(door_page):
    door_page.answer = {"error": "no such thing"}, []
    with pytest.raises(opencv.error, match="blur: no such thing"):
        opencv.blur(GREY, (3, 3))


def test_a_function_that_is_missing_names_itself_when_it_is_called(door_page):
    with pytest.raises(NotImplementedError, match=r"cv2\.findChessboardCorners"):
        opencv.findChessboardCorners(GREY, (3, 3))


def test_every_function_that_the_packages_call_is_there_or_known_to_be_missing():
    sources = [path.read_text(encoding="utf-8") for path in our_files()]
    called = {name for one in sources for name in re.findall(r"\bcv2\.([a-z]\w*)\(", one)}
    assert called - set(vars(opencv)) == MISSING


def running_mean(module):
    mean = OTHER.astype(np.float32)
    module.accumulateWeighted(GREY, mean, 0.3)
    return mean


def triangulated(module):
    K = np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
    left, right = K @ np.eye(3, 4), K @ np.hstack([np.eye(3), [[-80.0], [0], [0]]])
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-90, 90, (7, 2)), rng.uniform(500, 600, 7), np.ones(7)]).T
    uv = [(P @ points)[:2] / (P @ points)[2] for P in (left, right)]
    found = module.triangulatePoints(left, right, *uv)
    return found[:3] / found[3]


MASK = (OTHER > 90).view(np.uint8)
FEW = np.zeros((20, 30), np.uint8)
FEW[4:9, 11:23] = 255
POINTS = np.array([[3, 9], [12, -4], [7, 2]], np.int32)
# by a function of the module, and how near OpenCV's own answer is
SAME = {
    **{f"compare {k}": (lambda cv, k=k: cv.compare(GREY, OTHER, k), 0) for k in range(6)},
    **{f"compare {k}, a number": (lambda cv, k=k: cv.compare(GREY, 120, k), 0) for k in range(6)},
    "min": (lambda cv: cv.min(GREY, OTHER), 0),
    "max": (lambda cv: cv.max(GREY, OTHER), 0),
    "subtract": (lambda cv: cv.subtract(GREY, OTHER), 0),
    "absdiff": (lambda cv: cv.absdiff(GREY, OTHER), 0),
    **{
        f"border {k}": (lambda cv, k=k: cv.copyMakeBorder(GREY, 2, 3, 1, 4, k, value=7), 0)
        for k in (0, 1, 2, 4)
    },
    "mean": (lambda cv: cv.mean(GREY, MASK)[0], 1e-9),
    "mean of nothing": (lambda cv: cv.mean(GREY, np.zeros_like(GREY))[0], 0),
    "rectangle of a mask": (lambda cv: cv.boundingRect(FEW), 0),
    "rectangle of nothing": (lambda cv: cv.boundingRect(np.zeros_like(FEW)), 0),
    "rectangle of points": (lambda cv: cv.boundingRect(POINTS), 0),
    "running mean": (running_mean, 1e-4),  # grey levels; single precision of numbers to 255
    "triangulation": (triangulated, 1e-6),  # mm
}


@pytest.mark.parametrize("name", SAME)
def test_answers_are_opencvs(name):
    ask, atol = SAME[name]
    np.testing.assert_allclose(ask(opencv), ask(cv2), rtol=0, atol=atol)


@pytest.mark.parametrize("shape", [(9, 13), (9, 13, 3), (9, 13, 4)])
def test_images_come_back_from_their_file_as_opencv_reads_them(shape):
    image = rng.integers(0, 256, shape, dtype=np.uint8)
    for writer, reader in ((opencv, opencv), (opencv, cv2), (cv2, opencv)):
        written = writer.imencode(".png", image)[1]
        assert np.array_equal(reader.imdecode(written, cv2.IMREAD_UNCHANGED), image)
    assert opencv.imdecode(np.frombuffer(b"no image at all", np.uint8), -1) is None


def test_a_cell_keeps_its_variables_and_shows_its_last_expression(door_page, monkeypatch, tmp_path):
    session.run("side = 3\nside * 2", "one")
    session.run("side + 1;", "two")
    request = tmp_path / "request.json"
    request.write_text(json.dumps({"source": "side + 1", "name": "three"}))
    monkeypatch.setattr(session, "REQUEST", request)
    session.answer()
    assert [output["data"]["text/plain"] for output in door_page.outputs] == ["6", "4"]
    session.run("import pandas as pd\npd.DataFrame({'a': [1]})", "four")
    assert "<table" in door_page.outputs[-1]["data"]["text/html"]
    for value in (np.int64(3), np.float64(0.25), "inside"):
        session.glue("name", value, display=False)
    assert [output["value"] for output in door_page.outputs[-3:]] == [3, 0.25, "inside"]


def test_a_figure_is_shown_once_whether_it_is_the_last_expression_or_not(door_page):
    drawn = "import matplotlib.pyplot as plt\nfigure, ax = plt.subplots()\nax.plot([1, 2]);"
    session.run(drawn, "one")
    session.run(f"{drawn}\nfigure", "two")
    assert [list(output["data"]) for output in door_page.outputs] == [["image/png"]] * 2
    assert plt.get_fignums() == []


def test_an_error_names_the_line_of_the_cell(door_page):
    session.run("first = 1\nfirst / 0", "broken")
    (output,) = door_page.outputs
    assert (output["type"], output["cannot"]) == ("error", None)
    for word in ("broken.py", "line 2", "ZeroDivisionError"):
        assert word in output["text"]
    for source, word in (
        ("ModuleNotFoundError(name='mujoco')", "MuJoCo"),
        ("NotImplementedError('x')", "x"),
    ):
        session.run(f"half = 1\nraise {source}", "more")
        assert word in door_page.outputs[-1]["cannot"]
        # the cell leaves nothing behind, and what needs it cannot run either
        session.run("half", "after")
        assert word in door_page.outputs[-1]["cannot"]
