"""Sliders over a parameter and over a finished sweep, moved by hand; and what is shown where nobody can move them."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.sweep import sweep
from workbench.sweep.grid import Interval
from workbench.sweep.notebook import UNATTENDED
from workbench.sweep.sliders import explore, slide


@pytest.fixture(autouse=True)
def _alone(monkeypatch):
    monkeypatch.delenv(UNATTENDED, raising=False)
    monkeypatch.setattr(plt, "show", lambda: None)
    yield
    plt.close("all")


def product(a, b, c=1):
    return {"ab": a * b, "c_by_a": c * a}


def last_curve():
    ax = plt.figure(plt.get_fignums()[-1]).axes[0]
    return ax.get_ylabel(), ax.lines[0].get_xydata().tolist(), ax.get_ylim()


def test_a_slider_chooses_what_is_drawn():
    box = explore(sweep(product, a=[1.0, 2.0], b=[1.0, 3.0], c=[1, 5]))
    which, b, c, _ = box.children
    assert [child.description for child in (which, b, c)] == ["result", "b", "c"]
    assert which.value == "c_by_a"  # what changed most
    which.value = "ab"
    assert last_curve()[:2] == ("ab", [[1.0, 1.0], [2.0, 2.0]])
    before = last_curve()[2]
    b.value = 1
    assert last_curve()[:2] == ("ab", [[1.0, 3.0], [2.0, 6.0]])
    assert last_curve()[2] == before  # the axis stays
    which.value, c.value = "c_by_a", 1
    assert last_curve()[:2] == ("c_by_a", [[1.0, 5.0], [2.0, 10.0]])


def test_where_sliders_are_of_no_use_there_is_a_figure(monkeypatch):
    assert isinstance(explore(sweep(product, a=[1.0, 2.0], b=1.0)), Figure)
    assert isinstance(explore(sweep(product, a=Interval(0, 1), b=Interval(0, 1), sample=9)), Figure)
    found = sweep(product, a=np.linspace(0, 1, 3), b=[1.0, 2.0])
    assert not isinstance(explore(found), Figure)
    monkeypatch.setenv(UNATTENDED, "1")
    assert isinstance(explore(found), Figure)
    with pytest.raises(ValueError, match="size: no such column"):
        explore(found, ["size"])


def line(slope):
    figure, ax = plt.subplots()
    ax.plot([0, 1], [0, slope])
    return figure


def test_a_slider_redraws_a_figure_where_somebody_can_move_it(monkeypatch):
    slider, _ = slide(line, "slope", [1, 3], start=2.0).children
    assert [label for label, _ in slider.options] == ["1", "2", "3"]
    assert last_curve()[1] == [[0, 0], [1, 2]]
    slider.value = 3
    assert last_curve()[1] == [[0, 0], [1, 3]]
    plt.close("all")
    monkeypatch.setenv(UNATTENDED, "1")
    figure = slide(line, "slope", [1, 3], start=2.0)
    assert figure.axes[0].lines[0].get_ydata().tolist() == [0, 2]
    assert plt.get_fignums() == []
