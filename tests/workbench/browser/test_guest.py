"""What runs in the browser beside a chapter, tried here: OpenCV's own answers are the reference."""

import json
import re
import sys

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


class Page:
    """The other side of the door, in Python: it keeps what is handed out."""

    def __init__(self):
        self.outputs = []
        self.answer = ({}, [])

    def __call__(self, frame):
        header, arrays = door._unpack(frame)
        if header["asks"] == "output":
            self.outputs.append(header["output"])
            return door._pack({}, [])
        self.asked = header, arrays
        return door._pack(*self.answer)


@pytest.fixture
def page(monkeypatch, tmp_path):
    page = Page()
    monkeypatch.setattr(door, "_call", page)
    monkeypatch.setattr(session, "CELLS", tmp_path)
    monkeypatch.setattr(session, "namespace", {"__name__": "__main__"})
    return page


def test_arrays_cross_the_door_with_their_type_and_shape(page):
    page.answer = {"value": 3}, [np.arange(6, dtype=np.int16).reshape(2, 3)]
    answer, (array,) = door.ask({"asks": "anything"}, [GREY[:, ::2], np.array(2.5)])
    assert answer["value"] == 3
    assert array.dtype == np.int16
    assert array.tolist() == [[0, 1, 2], [3, 4, 5]]
    _, (cut, number) = page.asked
    assert np.array_equal(cut, GREY[:, ::2])
    assert number.shape == ()


def test_what_the_other_side_cannot_do_is_an_error_of_opencvs(page):
    page.answer = {"error": "no such thing"}, []
    with pytest.raises(opencv.error, match="blur: no such thing"):
        opencv.blur(GREY, (3, 3))


def test_a_function_that_is_missing_names_itself_when_it_is_called(page):
    with pytest.raises(NotImplementedError, match=r"cv2\.findChessboardCorners"):
        opencv.findChessboardCorners(GREY, (3, 3))


@pytest.mark.parametrize("number", range(6))
def test_compare_is_opencvs(number):
    assert np.array_equal(opencv.compare(GREY, OTHER, number), cv2.compare(GREY, OTHER, number))
    assert np.array_equal(opencv.compare(GREY, 120, number), cv2.compare(GREY, 120, number))


@pytest.mark.parametrize("name", ["min", "max", "subtract", "absdiff"])
def test_lines_of_numpy_are_opencvs(name):
    assert np.array_equal(getattr(opencv, name)(GREY, OTHER), getattr(cv2, name)(GREY, OTHER))


@pytest.mark.parametrize("border", [0, 1, 2, 4])
def test_borders_are_opencvs(border):
    sides = 2, 3, 1, 4
    assert np.array_equal(
        opencv.copyMakeBorder(GREY, *sides, border, value=7),
        cv2.copyMakeBorder(GREY, *sides, border, value=7),
    )


def test_the_mean_in_a_mask_is_opencvs():
    mask = (OTHER > 90).view(np.uint8)
    assert opencv.mean(GREY, mask)[0] == pytest.approx(cv2.mean(GREY, mask)[0], rel=1e-12)
    assert opencv.mean(GREY, np.zeros_like(GREY))[0] == cv2.mean(GREY, np.zeros_like(GREY))[0]


def test_bounding_rectangles_are_opencvs():
    mask = np.zeros((20, 30), np.uint8)
    assert opencv.boundingRect(mask) == cv2.boundingRect(mask)
    mask[4:9, 11:23] = 255
    assert opencv.boundingRect(mask) == cv2.boundingRect(mask)
    points = np.array([[3, 9], [12, -4], [7, 2]], np.int32)
    assert opencv.boundingRect(points) == cv2.boundingRect(points)


def test_every_function_that_the_packages_call_is_there_or_known_to_be_missing():
    sources = [path.read_text(encoding="utf-8") for path in our_files()]
    called = {name for one in sources for name in re.findall(r"\bcv2\.([a-z]\w*)\(", one)}
    assert called - set(vars(opencv)) == MISSING


def test_running_means_are_opencvs():
    mean, reference = OTHER.astype(np.float32), OTHER.astype(np.float32)
    opencv.accumulateWeighted(GREY, mean, 0.3)
    cv2.accumulateWeighted(GREY, reference, 0.3)
    assert np.allclose(
        mean, reference, atol=1e-4
    )  # grey levels; single precision of numbers to 255


def test_triangulated_points_are_opencvs_up_to_their_scale():
    K = np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
    left, right = K @ np.eye(3, 4), K @ np.hstack([np.eye(3), [[-80.0], [0], [0]]])
    points = np.column_stack([rng.uniform(-90, 90, (7, 2)), rng.uniform(500, 600, 7), np.ones(7)]).T
    uv = [(P @ points)[:2] / (P @ points)[2] for P in (left, right)]
    ours, theirs = (one.triangulatePoints(left, right, *uv) for one in (opencv, cv2))
    assert np.allclose(ours[:3] / ours[3], theirs[:3] / theirs[3], atol=1e-6)  # mm


@pytest.mark.parametrize("shape", [(9, 13), (9, 13, 3), (9, 13, 4)])
def test_images_come_back_from_their_file_as_opencv_reads_them(shape):
    image = rng.integers(0, 256, shape, dtype=np.uint8)
    written = opencv.imencode(".png", image)[1]
    assert np.array_equal(opencv.imdecode(written, opencv.IMREAD_UNCHANGED), image)
    assert np.array_equal(cv2.imdecode(written, cv2.IMREAD_UNCHANGED), image)
    theirs = cv2.imencode(".png", image)[1]
    assert np.array_equal(opencv.imdecode(theirs, opencv.IMREAD_UNCHANGED), image)


def test_what_is_no_image_is_none():
    assert opencv.imdecode(np.frombuffer(b"no image at all", np.uint8), -1) is None


def test_a_cell_keeps_its_variables_and_shows_its_last_expression(page):
    session.run("side = 3\nside * 2", "one")
    session.run("side + 1", "two")
    session.run("side + 1;", "three")
    shown = [output["data"]["text/plain"] for output in page.outputs]
    assert shown == ["6", "4"]


def test_a_figure_is_shown_once_whether_it_is_the_last_expression_or_not(page):
    drawn = "import matplotlib.pyplot as plt\nfigure, ax = plt.subplots()\nax.plot([1, 2]);"
    session.run(drawn, "one")
    session.run(f"{drawn}\nfigure", "two")
    assert [list(output["data"]) for output in page.outputs] == [["image/png"]] * 2
    assert plt.get_fignums() == []


def test_a_table_is_shown_as_html(page):
    session.run("import pandas as pd\npd.DataFrame({'a': [1]})", "one")
    assert "<table" in page.outputs[0]["data"]["text/html"]


def test_an_error_names_the_line_of_the_cell(page):
    session.run("first = 1\nfirst / 0", "broken")
    (output,) = page.outputs
    assert output["type"] == "error"
    assert "broken.py" in output["text"]
    assert "line 2" in output["text"]
    assert "ZeroDivisionError" in output["text"]
    assert output["cannot"] is None


@pytest.mark.parametrize(
    ("source", "word"),
    [
        ("raise ModuleNotFoundError(name='mujoco')", "MuJoCo"),
        ("raise NotImplementedError('x')", "x"),
    ],
)
def test_what_cannot_run_in_a_browser_says_so(page, source, word):
    session.run(source, "one")
    assert word in page.outputs[0]["cannot"]


def test_glued_numbers_are_handed_out_as_numbers(page):
    session.glue("count", np.int64(3), display=False)
    session.glue("share", np.float64(0.25), display=False)
    session.glue("verdict", "inside", display=False)
    assert [output["value"] for output in page.outputs] == [3, 0.25, "inside"]


def test_a_request_comes_by_a_file(page, monkeypatch, tmp_path):
    request = tmp_path / "request.json"
    request.write_text(json.dumps({"source": "1 + 1", "name": "one"}))
    monkeypatch.setattr(session, "REQUEST", request)
    session.answer()
    assert page.outputs[0]["data"] == {"text/plain": "2"}


def test_the_substitutes_leave_this_process_as_it_was():
    assert sys.modules["cv2"] is cv2
