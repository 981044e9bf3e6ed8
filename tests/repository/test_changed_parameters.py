"""A changed parameter shows: in the chapter's verdict, its figure and its closing errors."""

import re
from pathlib import Path

import pytest
from solutions import says

from workbench.course.exercises import exercise
from workbench.sweep.notebook import read_notebook, run_notebook

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
QUOTED = {
    "background-30": {"step_verdict"},
    "background-40": {"printed_poses", "cured_poses"},
    "matching-28": {"threshold_verdict", "without_mm", "high_mm"},
    "matching-36": {"fitted_instants", "measured_instants"},
}


def run(chapter, **parameters):
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MPLBACKEND", raising=False)  # figures are shown, as in a build
        return run_notebook(NOTEBOOKS / f"{chapter}.ipynb", parameters)


def runs(chapter, name, values, **small):
    """A chapter at some values of a parameter, and what it glues."""
    found = [run(chapter, **{name: value}, **small) for value in values]
    return found, [one.results for one in found]


def shown(found, cell, kind="text/plain"):
    """What a cell shows: a figure as a PNG file in base64, a table, or what it prints."""
    (one,) = (one for one in found.notebook.cells if one.id == cell)
    if kind == "printed":
        return "".join(output.text for output in one.outputs if output.output_type == "stream")
    (data,) = (output.data[kind] for output in one.outputs if kind in output.get("data", {}))
    return data


def differ(found, cell, kind):
    return len({shown(one, cell, kind) for one in found}) == len(found)


@pytest.mark.parametrize("chapter", ["03_background", "06_matching"])
def test_a_sentence_quotes_its_verdict(chapter):
    notebook = read_notebook(NOTEBOOKS / f"{chapter}.ipynb")
    texts = {one.id: one.source for one in notebook.cells if one.id in QUOTED}
    assert len(texts) == 2
    for cell, text in texts.items():
        assert QUOTED[cell] <= set(re.findall(r"\{glue:text\}`(\w+)", text))


@pytest.mark.heavy
def test_alpha_moves_verdict_figure_and_closing_errors():
    small = {"spacing": 8, "cameras": 1, "row_step": 7}
    found, results = runs("03_background", "update_rate", (0.002, 0.01, 0.2), **small)
    slow, ours, quick = results
    # a slow background does not follow the lamp, a quick one learns the hand
    assert slow["printed_after"] > ours["printed_after"] > quick["printed_after"]
    assert slow["step_verdict"] == ours["step_verdict"] == "every camera passes"
    assert quick["step_verdict"] == "NOT every camera passes"
    # the handle of the last experiment rests for half a second
    assert ours["printed_poses"] == ours["poses"] > 0 == quick["printed_poses"]
    assert differ(found, "background-09", "image/png")
    assert differ(found, "background-37-slider", "image/png")
    # the table of errors, which has a column for the printed background and one for the cured
    assert differ(found, "bfdd998f", "printed")


@pytest.mark.heavy
def test_a_small_q_loses_rectangles_and_poses():
    _, (ours, small) = runs("04_kalman", "jerk_intensity", (9.5e8, 9.5e6))
    # windows that lose the target see other rectangles after it
    assert small["held_filter"] <= ours["kept_small"] < ours["held_filter"]
    assert small["windows_measured"] < ours["windows_measured"]
    assert small["track_ours_refused"] > ours["track_ours_refused"]


@pytest.mark.heavy
def test_the_ncc_threshold_moves_verdict_figure_and_closing_errors():
    found, results = runs("06_matching", "ncc_threshold", (-1.0, 0.5, 0.65, 0.9), row_step=20)
    for name, falls in (("left_wrong", True), ("lost_correct", False)):
        values = [one[name] for one in results]
        assert values == sorted(set(values), reverse=falls)
    assert differ(found, "df66bd19", "image/png")
    # of no threshold against 0.9, whatever is the chapter's own
    assert len({one["threshold_verdict"] for one in results}) == 1
    for name in ("wrong_matches", "E_t_mm"):
        none, ours, _, high = (one[name] for one in results)
        assert none > ours > high


@pytest.mark.heavy
def test_a_wider_gate_sees_other_markers():
    """Exercise 4.4: with c = 4 the mean NIS is not a quarter, since the window is another one."""
    ours, wider = (
        run(
            "04_kalman",
            jerk_intensity=c * 9.5e8,
            sigma_px=c**0.5 * 1.5,
            velocity_sigma=c**0.5 * 1200.0,
            acceleration_sigma=c**0.5 * 6000.0,
        ).results["nis_ccd1"]
        for c in (1, 4)
    )
    asked = exercise("04.4").asked["ccd1"]
    assert abs(wider - asked.value) <= asked.within < abs(ours / 4 - asked.value)
    says("04.4", f"to {wider:.2f} (n = ")


@pytest.mark.heavy
def test_the_other_rod_has_other_points_and_one_pose():
    """Exercise 1.4: the points from pairs, and the statuses with dark cameras."""
    found, _ = runs("01_structure", "handle_name", ("paper", "coded"))
    ours, other = (
        int(re.match(r"(\d+) points from pairs", shown(one, "structure-32", "printed"))[1])
        for one in found
    )
    says("01.4", f"There are {other} points from pairs instead of {ours}.")
    asked = {name: one.value for name, one in exercise("01.4").asked.items()}
    assert asked["points"] == other
    table = shown(found[1], "structure-37")
    statuses = re.findall(r"measured|ambiguous|predicted|lost", table)
    assert set(statuses[:-1]) == {asked["one_dark"]} == {asked["told_nothing"]}
    assert statuses[-1] == asked["all_but_first"]


@pytest.mark.heavy
def test_more_parallel_cameras_share_more_markers():
    """Exercise 2.4: the poses of 20 in which two of the textbook's cameras share four markers."""
    _, (ours, parallel) = runs("02_workspace", "beta_deg", (45.0, 75.0))
    says("02.4", f"all {parallel['enough']:.0f} poses have four, instead of {ours['enough']:.0f}.")
    assert exercise("02.4").asked["poses"].value == parallel["enough"]
