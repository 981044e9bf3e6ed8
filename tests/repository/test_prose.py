"""The linter of prose sees what the style sheet advises against, and reads no code."""

import nbformat
import prose
import pytest


@pytest.mark.parametrize(
    "fault",
    [
        "0.2 px a frame",
        "takes an image a camera, and",
        "a NumPy call in\nplace of a loop",
        "0.3 mm in the mean.",
        "the rig is off by a pixel",
        "poses 4 mm off",
        "holds the factor against the script",
        "cannot be told from noise",
        "written for who wants the whole",
        "Whoever measures",
        "which allows to see",
        "belongs into the file",
        "modules are called like steps",
        "drawn anew",
    ],
)
def test_each_fault_is_seen(fault):
    (found,) = prose.faults(f"# A title\n\nThis is it: {fault}.")
    assert found[0] == 3


@pytest.mark.parametrize(
    "sound",
    [
        "30 frames a second, and 0.2 px per frame; an image a camera takes is stored",
        "a change in the mean error; the window stays in place",
        "The lamp is off. People who measure are told what they see. `in place of` $x$",
        "```python\nin_place = 'in place of'  # anew\n```\n[a page](anew.md)",
    ],
)
def test_no_false_alarm(sound):
    assert prose.faults(sound) == []


def test_markdown_cells_of_a_notebook_are_read(tmp_path):
    cells = [nbformat.v4.new_code_cell("# anew"), nbformat.v4.new_markdown_cell("drawn anew")]
    path = tmp_path / "one.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    ((place, text),) = prose.texts(path).items()
    assert place.endswith("cell 1")
    assert prose.faults(text) == [(1, "anew", "again")]


def test_the_pages_that_are_covered_follow_the_style_sheet():
    assert prose.main() == 0
