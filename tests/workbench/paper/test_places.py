"""Where an equation is, against the files themselves."""

from pathlib import Path

import pytest

from workbench.paper.places import equation, list_lines, place_lines

ROOT = Path(__file__).resolve().parents[3]


def test_each_equation_has_a_line():
    lines = list_lines()
    assert [int(line.split()[0]) for line in lines] == list(range(1, 28))
    assert "triangulation.triangulate" in lines[19]


@pytest.mark.parametrize("number", range(1, 28))
def test_the_line_that_is_named_begins_the_function(number):
    lines = place_lines(equation(number))
    functions = [line for line in lines if line.startswith("function")]
    assert functions
    for line in functions:
        _, name, place = line.split()
        path, _, first = place.rpartition(":")
        begin = (ROOT / path).read_text().splitlines()[int(first) - 1 :][:4]
        assert any(f" {name.rpartition('.')[2]}" in f" {text.strip()}" for text in begin)
    assert any(line.startswith("test ") for line in lines)
    assert lines[-1].startswith("chapter   notebooks/")
    assert (ROOT / lines[-1].split()[1]).exists()
