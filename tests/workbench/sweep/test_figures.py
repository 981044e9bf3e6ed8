"""Figures of a sweep: what is drawn for which table."""

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

from workbench.studies.protocol import load_claims
from workbench.sweep import sweep
from workbench.sweep.figures import as_png, plot_sweep
from workbench.sweep.grid import Interval
from workbench.sweep.quantities import PAPER, count_of, paper_value, unit_of


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


def test_what_has_no_room_is_said_and_an_error_that_the_paper_states_has_a_place():
    def many(a, b=0.0, c=0.0):
        return {f"r{k:02d}": 1 + a * k + b + c for k in range(1, 15)} | {"E_t_mm": 1 + 0.01 * a}

    figure = plot_sweep(sweep(many, a=[0.0, 1.0]))
    assert len(labels(figure)) == 12
    assert labels(figure)[-1] == ("a", "E_t_mm / mm")
    assert figure.get_suptitle() == "3 more results are in the table"
    figure = plot_sweep(sweep(many, a=[0.0, 1.0], b=[0.0, 1.0], c=[0.0, 1.0]))
    assert len([ax for ax in figure.axes if ax.get_title()]) == 3 * 2
    assert figure.get_suptitle() == "12 more results are in the table"


def test_other_columns_are_refused():
    found = sweep(measured, a=[0.1, 0.2])
    with pytest.raises(
        ValueError, match="size: no such column; there are a, flat, gain, E_t_mm, drawn"
    ):
        plot_sweep(found, ["size"])
    with pytest.raises(
        ValueError, match="status: no result that is a number; there are flat, gain, E_t_mm, drawn"
    ):
        plot_sweep(found, ["status"])


def test_words_of_a_sample_are_named_at_the_axis():
    found = sweep(measured, a=Interval(0.0, 0.5), name=["long", "longer"], sample=8)
    figure = plot_sweep(found, ["E_t_mm"])
    numbers, words = figure.axes
    np.testing.assert_array_equal(numbers.lines[0].get_xydata(), found[["a", "E_t_mm"]])
    assert [tick.get_text() for tick in words.get_xticklabels()] == list(
        dict.fromkeys(found["name"])
    )
    x, y = words.lines[0].get_xydata().T
    order = list(dict.fromkeys(found["name"]))
    np.testing.assert_array_equal(x, [order.index(name) for name in found["name"]])
    np.testing.assert_array_equal(y, found["E_t_mm"])
    assert [ax.get_xlabel() for ax in (numbers, words)] == ["a", "name"]


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
        ([0.1, 0.3, 0.5, 0.7, 1.0], "linear"),
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


def test_the_papers_values_are_those_of_its_claims():
    claims = load_claims()
    stated = {float(claim.paper) for claim in claims if claim.paper not in ("", "yes")}
    assert set(PAPER.values()) <= stated
    assert paper_value("E_alpha_deg_paper") == paper_value("layout_E_alpha_deg") == 0.67
    columns = ["E_t_mm_paper", "n_paper", "n_patches"]
    assert count_of("geodesic_deg_patches", columns).measured == "n_patches"
    assert count_of("images_paper", columns) is None


def matched(a):
    """What chapter 6 counts, in part the same twice, and an error that changes least."""
    missing = float(4 * a)
    return {
        "missing_matches": missing,
        "missing_unordered": missing,
        "due_matches": 258.0,
        "E_t_mm": 0.4 - 0.01 * a,
    }


def test_counts_say_so_and_what_they_are_of_and_what_is_the_same_is_drawn_once():
    figure = plot_sweep(sweep(matched, a=[0.0, 1.0, 2.0]))
    assert labels(figure) == [("a", "missing_matches, number"), ("a", "E_t_mm / mm")]
    assert figure.axes[0].get_title() == "the same: missing_unordered\nn = 258"
    assert plot_sweep(sweep(matched, a=[0.0, 1.0]), ["missing_unordered"]).axes[0].get_title() == ""


def test_a_map_says_the_papers_value_and_frames_means_over_fewer_poses():
    def chapter_of_two(a, b):
        return {"E_t_mm": a + b, "fitted_instants": 20 - 3 * int(a > 1 and b > 0), "instants": 20}

    ax = plot_sweep(sweep(chapter_of_two, a=[0.0, 1.0, 2.0], b=[0.0, 1.0]), ["E_t_mm"]).axes[0]
    assert ax.get_title() == "paper 0.31; n = 20, framed: fewer, at least 17"
    (frame,) = ax.patches
    assert frame.contains_point(ax.transData.transform((2, 1 - 0.46)), radius=1)
    assert (round(frame.get_x() + 0.46), round(frame.get_y() + 0.46)) == (2, 1)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("E_t_mm_paper", "mm"),
        ("speed_mm_s", "mm/s"),
        ("lamp_s", "s"),
        ("printed_rest_end", "%"),
        ("missed_calm_windows", ""),
        ("image_window_false", ""),
        ("gain", ""),
        ("update_rate", "1/frame"),
    ],
)
def test_a_unit_follows_from_the_words_of_a_name(name, unit):
    assert unit_of(name) == unit
