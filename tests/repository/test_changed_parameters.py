"""A changed parameter shows: in the chapter's verdict, its figure and its closing errors."""

import re
from functools import cache
from pathlib import Path

import pytest
from solutions import says

from workbench.course.exercises import exercise
from workbench.sweep.notebook import read_notebook, run_notebook

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


@cache
def run(chapter, **parameters):
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MPLBACKEND", raising=False)  # figures are shown, as in a build
        return run_notebook(NOTEBOOKS / f"{chapter}.ipynb", parameters)


def picture(found, cell):
    """The figure of a cell, as a PNG file in base64."""
    (image,) = (
        output.data["image/png"]
        for one in found.notebook.cells
        if one.id == cell
        for output in one.outputs
        if "image/png" in output.get("data", {})
    )
    return image


def printed(found, cell):
    """What a cell prints."""
    (one,) = (one for one in found.notebook.cells if one.id == cell)
    return "".join(output.text for output in one.outputs if output.output_type == "stream")


@pytest.mark.parametrize(
    ("chapter", "cell", "names"),
    [
        ("03_background", "background-30", {"step_verdict"}),
        ("03_background", "background-40", {"printed_poses", "cured_poses"}),
        ("06_matching", "matching-28", {"threshold_verdict", "without_mm", "high_mm"}),
        ("06_matching", "matching-36", {"E_t_mm", "layout_E_t_mm"}),
    ],
)
def test_a_sentence_quotes_its_verdict(chapter, cell, names):
    notebook = read_notebook(NOTEBOOKS / f"{chapter}.ipynb")
    (text,) = (one.source for one in notebook.cells if one.id == cell)
    assert names <= set(re.findall(r"\{glue:text\}`(\w+)", text))


@pytest.mark.heavy
def test_alpha_moves_verdict_figure_and_closing_errors():
    small = {"spacing": 8, "cameras": 1, "row_step": 7}
    slow, ours, quick = (
        run("03_background", update_rate=alpha, **small) for alpha in (0.002, 0.01, 0.2)
    )
    # a slow background does not follow the lamp, a quick one learns the hand
    assert (
        slow.results["printed_after"]
        > ours.results["printed_after"]
        > quick.results["printed_after"]
    )
    assert slow.results["step_verdict"] == ours.results["step_verdict"] == "every camera passes"
    assert quick.results["step_verdict"] == "NOT every camera passes"
    # the handle of the last experiment rests for half a second
    assert ours.results["printed_poses"] == ours.results["poses"] > 0
    assert quick.results["printed_poses"] == 0
    for cell in ("background-09", "background-37-slider"):
        assert len({picture(one, cell) for one in (slow, ours, quick)}) == 3
    # the table of errors, which has a column for the printed background and one for the cured
    assert len({printed(one, "background-39") for one in (slow, ours, quick)}) == 3


@pytest.mark.heavy
def test_a_small_q_loses_rectangles_and_poses():
    ours, small = (run("04_kalman", jerk_intensity=q).results for q in (9.5e8, 9.5e6))
    assert small["held_filter"] == ours["kept_small"] < ours["kept_ours"] == ours["held_filter"]
    assert small["windows_measured"] < ours["windows_measured"]
    assert small["track_ours_refused"] > ours["track_ours_refused"]


@pytest.mark.heavy
def test_the_ncc_threshold_moves_verdict_figure_and_closing_errors():
    none, ours, higher, high = (
        run("06_matching", ncc_threshold=threshold, row_step=20)
        for threshold in (-1.0, 0.5, 0.65, 0.9)
    )
    found = [one.results for one in (none, ours, higher, high)]
    assert [one["left_wrong"] for one in found] == sorted(
        {one["left_wrong"] for one in found}, reverse=True
    )
    assert [one["lost_right"] for one in found] == sorted({one["lost_right"] for one in found})
    assert len({picture(one, "matching-27") for one in (none, ours, higher, high)}) == 4
    # of no threshold against 0.9, whatever is the chapter's own
    assert len({one["threshold_verdict"] for one in found}) == 1
    wrong = [one["wrong_matches"] for one in found]
    assert wrong[0] > wrong[1] > wrong[3]
    assert found[0]["E_t_mm"] > found[1]["E_t_mm"] > found[3]["E_t_mm"]


@pytest.mark.heavy
def test_a_wider_gate_sees_other_markers():
    """Exercise 4.4: with c = 4 the mean NIS is not a quarter, since the window is another one."""
    ours = run("04_kalman").results
    wider = run(
        "04_kalman",
        jerk_intensity=4 * 9.5e8,
        sigma_px=2 * 1.5,
        velocity_sigma=2 * 1200.0,
        acceleration_sigma=2 * 6000.0,
    ).results
    asked = exercise("04.4").asked["ccd1"]
    assert abs(wider["nis_ccd1"] - asked.value) <= asked.within
    assert abs(ours["nis_ccd1"] / 4 - asked.value) > asked.within
    says("04.4", f"to {wider['nis_ccd1']:.2f} (n = ")


@pytest.mark.heavy
def test_the_other_rod_has_other_points_and_one_pose():
    """Exercise 1.4: the points from pairs, and the statuses with dark cameras."""
    ours, other = (run("01_structure", handle_name=name) for name in ("paper", "coded"))
    points = [
        int(re.match(r"(\d+) points from pairs", printed(found, "structure-32"))[1])
        for found in (ours, other)
    ]
    says("01.4", f"There are {points[1]} points from pairs instead of {points[0]}.")
    asked = {name: one.value for name, one in exercise("01.4").asked.items()}
    assert asked["points"] == points[1]
    (table,) = (
        output.data["text/plain"]
        for one in other.notebook.cells
        if one.id == "structure-37"
        for output in one.outputs
        if "text/plain" in output.get("data", {})
    )
    statuses = re.findall(r"measured|ambiguous|predicted|lost", table)
    assert set(statuses[:-1]) == {asked["one_dark"]} == {asked["told_nothing"]}
    assert statuses[-1] == asked["all_but_first"]


@pytest.mark.heavy
def test_more_parallel_cameras_share_more_markers():
    """Exercise 2.4: the poses of 20 in which two of the textbook's cameras share four markers."""
    ours, parallel = (run("02_workspace", beta_deg=beta).results for beta in (45.0, 75.0))
    says("02.4", f"all {parallel['enough']:.0f} poses have four, instead of {ours['enough']:.0f}.")
    assert exercise("02.4").asked["poses"].value == parallel["enough"]
