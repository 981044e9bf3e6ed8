"""Figures of a sweep: what is drawn for which table."""

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.sweep import sweep
from workbench.sweep.figures import as_png, plot_sweep
from workbench.sweep.quantities import unit_of


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def measured(a, b=1.0, c=0, seed=0, name="x"):
    if a > 0.9 and b > 0.9:
        raise ValueError("too much")
    return {"flat": 1.0, "gain": a * b + c + seed, "E_t_mm": len(name) + a, "drawn": 1.0 * seed}


def labels(figure):
    return [(ax.get_xlabel(), ax.get_ylabel()) for ax in figure.axes if ax.get_xlabel()]


def test_one_parameter_gives_curves_with_the_range_over_the_seeds(tmp_path):
    found = sweep(measured, a=[0.0, 0.5, 1.0], b=0.5, seed=[0, 2])
    figure = plot_sweep(found)
    # a result that stays the same, or that only the seed changes, is left out
    assert labels(figure) == [("a", "E_t_mm / mm"), ("a", "gain")]
    gain = figure.axes[1]
    np.testing.assert_allclose(gain.lines[0].get_xydata(), [[0.0, 1.0], [0.5, 1.25], [1.0, 1.5]])
    band = gain.collections[0].get_paths()[0].vertices
    np.testing.assert_allclose([band[:, 1].min(), band[:, 1].max()], [0.0, 2.5])
    assert gain.get_xscale() == "linear"
    (tmp_path / "f.png").write_bytes(as_png(figure))
    assert matplotlib.image.imread(tmp_path / "f.png").shape[:2] == (320, 800)
    assert plt.get_fignums() == []


def test_two_parameters_give_heat_maps_and_failures_are_gaps():
    found = sweep(measured, a=[0.0, 0.5, 1.0], b=[0.5, 1.0])
    figure = plot_sweep(found, ["gain"])
    np.testing.assert_allclose(
        figure.axes[0].images[0].get_array().filled(np.nan), [[0, 0.25, 0.5], [0, 0.5, np.nan]]
    )
    ax = figure.axes[0]
    assert sorted(text.get_text() for text in ax.texts) == ["0", "0", "0.25", "0.5", "0.5"]
    assert labels(figure) == [("a", "b")]
    assert figure.get_suptitle() == "1 of 6 runs failed"
    more = plot_sweep(sweep(measured, a=[0.0, 0.5], b=[0.5, 0.8], c=range(3)), ["gain"])
    maps = [ax for ax in more.axes if ax.get_title()]
    assert [ax.get_title() for ax in maps] == ["c 0", "c 1", "c 2"]
    assert {ax.images[0].get_clim() for ax in maps} == {(0.0, 2.4)}
    np.testing.assert_allclose(maps[2].images[0].get_array(), [[2, 2.25], [2, 2.4]])


@pytest.mark.parametrize(
    ("column", "said"), [("size", "no such column"), ("status", "no result that is a number")]
)
def test_other_columns_are_refused(column, said):
    with pytest.raises(ValueError, match=f"{column}: {said}; there are .*flat, gain"):
        plot_sweep(sweep(measured, a=[0.1, 0.2]), [column])


def test_what_changed_most_for_its_size_comes_first_and_the_parameter_itself_last():
    def some(a, seed=0):
        noisy = 10.0 * seed
        return {"copy": a, "little": 100 + a, "much": 1 + a, "by_chance": noisy + 0.1 * a}

    figure = plot_sweep(sweep(some, a=[0.0, 1.0, 2.0], seed=[0, 1]))
    assert [name for _, name in labels(figure)] == ["much", "little", "by_chance", "copy"]


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        ([0.25, 0.5, 1.0, 2.0, 4.0], "log"),
        ([1, 2, 5, 10, 20, 50], "log"),
        ([0.0, 1.0, 10.0], "linear"),
    ],
)
def test_which_values_get_a_logarithmic_axis(values, scale):
    assert plot_sweep(sweep(measured, a=values, b=0.1)).axes[0].get_xscale() == scale


def chapter(a):
    """An error whose mean falls because poses are dropped."""
    return {"E_t_mm": 0.5 - 0.1 * a, "fitted_instants": 20 - 3 * int(a), "instants": 20}


def test_an_error_has_its_unit_the_papers_value_and_the_number_of_its_poses():
    ax = plot_sweep(sweep(chapter, a=[0.0, 1.0, 2.0]), ["E_t_mm"]).axes[0]
    assert ax.get_ylabel() == "E_t_mm / mm"
    assert ax.lines[1].get_ydata()[0] == 0.31
    hollow = ax.lines[2]
    assert hollow.get_markerfacecolor() == "white"
    np.testing.assert_allclose(hollow.get_xydata(), [[1.0, 0.4], [2.0, 0.3]])
    assert [text.get_text() for text in ax.texts] == ["paper 0.31", "17 of 20", "14 of 20"]
    assert ax.get_title() == "n = 20, hollow: fewer"
    whole = plot_sweep(sweep(chapter, a=[0.0, 0.1]), ["E_t_mm"]).axes[0]
    assert (whole.get_title(), len(whole.lines[2].get_xdata())) == ("n = 20", 0)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("E_t_mm_paper", "mm"),
        ("speed_mm_s", "mm/s"),
        ("printed_rest_end", "%"),
        ("gain", ""),
        ("update_rate", "1/frame"),
    ],
)
def test_a_unit_follows_from_the_words_of_a_name(name, unit):
    assert unit_of(name) == unit
