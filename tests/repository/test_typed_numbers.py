"""Measured numbers that pages without code have typed: each is computed here, or read from the table
that is shipped, and stands in the text to the digit.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from executed import as_it_stands
from pages import page_says
from verification import refined

from trinolab import background, datasets, metrics, triangulation, workspace
from trinolab.background import BackgroundParameters
from trinolab.bench.optics import Bench
from trinolab.handle import facing_pixels
from trinolab.rigid import nearest_rotation
from trinolab.slave import wall
from trinolab.workspace import cones
from workbench import intervals
from workbench.studies import centroid_bias, ground_truth, stress

ROOT = Path(__file__).resolve().parents[2]
RIG, ROD = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
POSES = datasets.load_table1().set_poses
WORDS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]


def page_says_assumed(*sentences):
    page_says("book/assumptions.md", *sentences)


# Assumptions


def test_what_is_assumed_of_the_cameras():
    first, second = RIG.cameras
    focal = datasets.load_calibration().A_l[0, 0]
    page_says_assumed(f"Then {focal:.0f} px, a printed focal length, are {4.4e-3 * focal:.1f} mm")

    baseline = second.centre - first.centre
    axes = [one.T_world_cam.rotation.apply([0.0, 0, 1]) for one in RIG.cameras]
    along, *_ = np.linalg.lstsq(np.stack([axes[0], -axes[1]], axis=1), baseline)
    depths = POSES.translation[:, 2]
    page_says_assumed(
        f"In mm the baseline is {np.linalg.norm(baseline):.1f} mm",
        f"pass each other at {10 * round(along.mean() / 10)} mm from the cameras",
        f"Table 1's positions are ({depths.min():.0f} to {depths.max():.0f} mm)",
    )

    printed = datasets.load_calibration().R_rl
    nearest = nearest_rotation(printed).as_matrix()
    off = np.abs(printed - nearest).max()
    page_says_assumed(f"entries err by up to {off:.4f}, {WORDS[round(off / 5e-5)]} times")
    uv = [one.project(POSES.translation) for one in RIG.cameras]
    rays = [one.rays(pixels) for one, pixels in zip(RIG.cameras, uv, strict=True)]
    # Eq. 20's first form, the printed matrix's transpose for its inverse
    into_right = rays[0] / rays[0][:, 2:] @ printed
    shift = -printed.T @ datasets.load_calibration().T_rl
    x_right = (second.ideal_pixels(uv[1])[:, 0] - second.matrix[0, 2]) / second.focal[0]
    depth = (x_right * shift[2] - shift[0]) / (into_right[:, 0] - x_right * into_right[:, 2])
    moved = depth[:, None] * rays[0] / rays[0][:, 2:] - POSES.translation
    page_says_assumed(f"points move by {np.linalg.norm(moved, axis=1).mean():.2f} mm on average")
    assert np.abs(moved[:, 2]).mean() > 0.95 * np.linalg.norm(moved, axis=1).mean()

    apart = [100 * (one.focal[0] / one.focal[1] - 1) for one in RIG.cameras]
    page_says_assumed(f"which differ by {apart[0]:.2f} and {apart[1]:.2f} %")
    moved = []
    for chosen in (0, 1):  # one of the two for both axes
        square = []
        for one in RIG.cameras:
            matrix = one.matrix.copy()
            matrix[[0, 1], [0, 1]] = one.focal[chosen]
            square.append(replace(one, matrix=matrix))
        points = triangulation.triangulate_pair(*square, *uv)
        moved.append(np.linalg.norm(points - POSES.translation, axis=1).mean())
    page_says_assumed(f"moves the points by {moved[0]:.2f} to {moved[1]:.2f} mm on average")


def test_what_is_assumed_of_the_handle():
    camera = RIG.cameras[0]
    sight = POSES.translation / np.linalg.norm(POSES.translation, axis=1)[:, None]
    x, y, z = (
        np.rad2deg(np.arccos((POSES.rotation.apply(axis) * sight).sum(axis=1)))
        for axis in np.eye(3)
    )
    page_says_assumed(
        f"y lies {y.min():.0f} to {y.max():.0f} deg from the line of sight in all twenty poses",
        f"x covers {x.min():.0f} to {x.max():.0f} deg, z {z.min():.0f} to {z.max():.0f} deg",
    )

    def leaving(apart_mm):
        rows = tuple((apart_mm / 2, -apart_mm / 2) for _ in range(6))
        rod = replace(ROD, rows_mm=rows)
        facing = np.isfinite(facing_pixels(rod, camera, POSES[0], 70.0)[:, 0])
        return (facing & ~camera.sees(POSES[0].apply(rod.marker_centres))).any()

    assert (leaving(20.0), leaving(30.0)) == (False, True)
    page_says_assumed("With 30 mm the markers of Table 1's first pose leave CCD1's image")
    page_says_assumed(f"are {3 * camera.focal[0] / 570:.1f} px wide at 570 mm")


def test_what_is_assumed_of_steep_markers():
    *_, beside_px = centroid_bias.turned_marker(70.0, RIG, ROD, Bench())
    assert abs(beside_px) > 1
    page_says_assumed("Beyond 70 deg a wrapped marker's centroid lies more than 1 px beside")


def test_what_a_bent_board_and_a_late_pose_are_assumed_to_cost():
    draws = pd.read_csv(datasets.data_path("claims_draws.csv"))
    costs = draws.groupby("check").a.mean()
    times = costs["calibration_cost_bent_20um"] / costs["calibration_cost_flat"]
    assert round(times) == 3
    page_says_assumed("a bend of 0.02 mm that the calibration ignores triples what")
    ages = [1e3 * (0.005 + 1 / 30 + measurement) for measurement in (0.0105, 0.015)]
    page_says_assumed(
        f"A pose is {ages[0]:.0f} ms old", f"with two cameras, {ages[1]:.0f} ms in all"
    )


# The lab sheet, and the criteria that `preflight` prints


def gallery(name, column="E_t_mm_patches"):
    """Mean over the seeds at each value of a sweep of the gallery."""
    table = pd.read_csv(datasets.data_path("sweeps", "gallery", f"{name}.csv"))
    return table.groupby(table.columns[0])[column].mean()


USUAL_MM = gallery("marker_size")[3.0]  # of the image model on the standard scene


def test_where_the_limits_of_a_set_up_come_from():
    why = {
        name: one["why"]
        for name, one in tomllib.loads((ROOT / "data/criteria.toml").read_text()).items()
    }

    def both_say(name, in_file, on_page):
        assert in_file in why[name], in_file
        page_says("book/lab_sheet.md", on_page)

    faults = stress.by_fault(datasets.load_sweep("stress"), "raised_40deg", "patches")
    faults = faults.set_index("fault")
    share = faults.measured / faults.n if faults.measured.max() > 1 else faults.measured

    times = faults.mm["half contrast"] / faults.mm["none"]
    both_say(
        "contrast", f"65 levels cost a factor of {times:.1f}", f"by a factor of {times:.1f} (ch"
    )

    noise = gallery("noise") / USUAL_MM
    three, five = (WORDS[round(noise[level])] for level in (8.0, 16.0))
    # the markers' contrast is 130, and shot noise adds to the read noise
    for level, ratio in ((8.0, 16), (16.0, 8)):
        assert 130 / np.hypot(level, np.sqrt(0.05 * 90)) == pytest.approx(ratio, rel=0.05)
    both_say(
        "noise",
        f"at 16 the error is {three} times the usual one, at 8 {five} times",
        f"{three} and {five} times the usual error",
    )

    blur = gallery("blur") / USUAL_MM
    assert round(blur[1.5]) == 2
    eight = WORDS[round(blur[3.0])]
    both_say(
        "focus",
        f"1.5 px double the error, 3 px make it {eight} times as large",
        f"twice and {eight} times the error",
    )

    speed = pd.read_csv(datasets.data_path("sweeps", "speed.csv")).set_index("speed_mm_s")
    # 10 ms of exposure: a third of a marker of 3 mm at 100 mm/s
    assert round(1 / (speed.E_t_mm[100] / speed.E_t_mm[0] - 1)) == 7
    assert round(1 / (1 - speed.n[200] / 20)) == 5
    assert round(3 * (1 - speed.n[400] / 20)) == 2
    both_say(
        "smear",
        "a third of a marker costs a seventh more, two thirds lose every fifth pose of the paper's "
        "method, four thirds two of three",
        "two thirds of a marker, the paper's method loses every fifth pose",
    )

    gone = 1 - share["saturated highlights"]
    assert round(1 / gone) == 16
    assert "stripes of highlights lose every sixteenth pose" in why["white"]

    assert share["frames 5 ms apart"] == pytest.approx(1 / 2, abs=0.04)
    assert "5 ms at a hand's pace leave half of the poses" in why["apart"]

    baseline = gallery("baseline")
    more = baseline / baseline[100]
    for mm, deg in ((100, 10.0), (50, 5.0), (25, 2.6)):
        assert np.rad2deg(2 * np.arctan(mm / 2 / 565)) == pytest.approx(deg, abs=0.2)
    both_say(
        "angle",
        f"at 5 deg the error is {more[50]:.1f} times, at 2.6 deg {more[25]:.0f} times as large",
        f"1, {more[50]:.1f} and {more[25]:.0f} times the error at 10°, 5° and 2.6°",
    )

    good, loose = (
        faults.mm[f"calibration {size}"] for size in ("0.1 px, 0.005 deg", "0.3 px, 0.02 deg")
    )
    assert f"cost {good:.1f} mm; 0.3 px and 0.02 deg {loose:.1f} mm (" in why["agree"]
    lost = "cameras that are 5 ms apart lose half of the poses"
    both_say("part", lost, lost)

    sheet = pd.read_json(datasets.data_path("accept", "raised_40deg.json"), typ="series")
    (possible,) = (
        one["value"]
        for one in sheet["numbers"]
        if one["what"] == "measured, of the possible instants"
    )
    both_say("found", f"has {possible:.0f} % of the instants", f"{possible:.0f} % where it is")


def test_how_to_mount_the_cameras():
    baseline = gallery("baseline") / gallery("baseline")[100]
    assert round(baseline[25]) == 3
    assert baseline[200] == pytest.approx(2 / 3, abs=0.03)
    page_says("book/lab_sheet.md", "three times the error of 99 mm, and 200 mm two thirds of it")
    distance = gallery("distance")
    assert round(distance[1100] / distance[570]) == 6
    page_says(
        "book/lab_sheet.md", "At twice the distance the error of `best` is about six times as large"
    )
    elevation = gallery("elevation") / gallery("elevation").min()
    assert [deg for deg, times in elevation.items() if times < 1.15] == [40, 50, 60, 70, 80, 90]
    page_says("book/lab_sheet.md", "The third camera helps most at 40° or more")


def test_whether_cameras_are_good_enough():
    sizes = gallery("marker_size")
    px = {mm: mm * RIG.cameras[0].focal[0] / 570 for mm in (1.0, 3.0)}
    text = (
        f"the best estimator measures simulated poses with a mean error of {sizes[1.0]:.3f} mm at "
        f"{px[1.0]:.0f} px and {sizes[3.0]:.3f} mm at {px[3.0]:.0f} px"
    )
    page_says("book/commands.md", text)


@pytest.mark.heavy
def test_what_refining_brings():
    rig, handle = datasets.load_rig("paper_pair"), datasets.load_handle("coded")
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = refined.off_by(rig, handle, rng)
        bundle = refined.refined(rig, handle, truth, refined.INSTANTS, rng)
        # in the order in which `make verify` draws
        after = refined.errors_of_new_instants(bundle.rig, bundle.handle, truth, rng)
        before = refined.errors_of_new_instants(rig, handle, truth, rng)
        errors.append((before[0], after[0]))
    before, after = np.transpose(errors)
    low, high, _ = intervals.of_mean(after)
    page_says(
        "book/commands.md",
        f"two cameras and {refined.INSTANTS} instants, `refine` reduced the error of other poses "
        f"from {before.mean():.2f} mm to {after.mean():.3f} mm ({low:.3f} to {high:.3f}, 95 %)",
    )


def test_the_step_that_stands_for_the_assumed_rate():
    rates = gallery("update_rate", "false_percent_printed").index.to_numpy()
    nearest = rates[np.abs(rates - BackgroundParameters().update_rate).argmin()]
    page_says(
        "book/report.md",
        f"no step at the assumed 0.01; the nearest, {nearest:g}, replaces it",
    )


def test_rules_of_thumb_of_the_gallery():
    cured = gallery("update_rate", "false_percent_cured")
    cured = cured + gallery("update_rate", "missed_percent_cured")
    as_good = cured[cured < 1.1 * cured.min()].index
    assert list(as_good) == list(cured[as_good[0] : as_good[-1]].index)
    page_says("book/gallery.ipynb", f"any $\\alpha$ from {as_good[0]:g} to {as_good[-1]:g}, a")

    wrong = gallery("ncc_threshold", "wrong_matches")
    assert wrong[:0.65].nunique() == 1
    page_says("book/gallery.ipynb", "Up to 0.65 the threshold removes no wrong pair")

    sigma = np.sqrt(0.05 * 45 + 1.5**2)  # of the standard scene's background
    page_says("book/gallery.ipynb", f"a standard deviation of {sigma:.1f} grey levels")
    assert round(15 / sigma) == 7


# Chapter 9


def test_what_chapter_9_has_typed():
    chapter, study = "notebooks/09_table1.ipynb", "notebooks/09b_causes.ipynb"
    table1 = datasets.load_table1()
    errors = metrics.euler_deg(table1.measured) - metrics.euler_deg(table1.set_poses)
    errors = (errors + 180) % 360 - 180
    places = table1.measured.translation - table1.set_poses.translation
    assert {f"{one:.1f}" for one in places.std(axis=0, ddof=1)} == {"0.2"}
    page_says(chapter, "no offset, and 0.2 mm of scatter in each direction")
    assert {f"{one:.1f}" for one in np.abs(errors - errors.mean(axis=0)).mean(axis=0)} == {"0.2"}
    page_says(chapter, "Subtract the offset of each angle, and a mean error of 0.2° remains")

    edges = []
    for one in RIG.cameras:
        x = (0 - one.matrix[0, 2]) / one.focal[0]
        edges.append(one.focal[0] * 0.2 * abs(x) ** 3)
    page_says(study, f"{edges[0]:.0f} to {edges[1]:.0f} px at the left edge of the images")
    smear = 100 * 0.01 * RIG.cameras[0].focal[0] / 570  # 10 ms at 100 mm/s
    page_says(study, f"a smear of {smear:.0f} px, because the blur is symmetric")


# Teaching


def test_what_the_teacher_s_guide_quotes():
    guide = "book/teaching/chapters.md"
    rig = datasets.load_rig("paper_trinocular")
    promised = workspace.intersect(cones.cones_of_rig(rig)).volume
    seen = workspace.view_volume(rig).volume
    page_says(guide, f"{promised / seen:.1f} times, the volume that cones promise")

    table1 = datasets.load_table1()
    errors = metrics.euler_deg(table1.measured) - metrics.euler_deg(table1.set_poses)
    wrapped = (errors + 180) % 360 - 180
    page_says(guide, f"{(wrapped > 0).sum()} of {wrapped.size} errors are positive")

    close = (datasets.load_sweep("mixes").misfit < 1.1).sum()
    page_says(guide, f"{close} mixes fit")
    patterns = datasets.load_sweep("patterns")
    assert (patterns.model.nunique(), patterns.statistic.nunique()) == (19, 7)
    page_says(guide, "Nineteen models, seven questions")

    loop = wall.Loop(0.2, 2.0, 1 / 30, 0.05)
    limits = [
        wall.nyquist_limit(replace(loop, period_s=period)).stiffness for period in (1 / 30, 1e-3)
    ]
    page_says(guide, f"30 Hz to 1 kHz at 50 ms: {limits[0]:.0f} to {limits[1]:.0f} N/m")


@pytest.mark.heavy
def test_the_slider_of_the_lesson():
    """The plans' prediction: the printed background at two rates, in CCD3 of `hard`."""
    hard = ground_truth.read_recording("hard", every=4)
    truths = ground_truth.moving(hard, 2, 2)
    shares = {}
    for alpha in (0.01, 0.1):
        p = BackgroundParameters(alpha, 15.0, 0.0, 31, compensate_light=False)
        B, false, missed = hard.empty[2].astype(float), [], []
        for frame, truth in zip(hard.images_of(2), truths, strict=True):
            moving = np.abs(frame - B) > p.difference_threshold
            B = background.update(B, frame, alpha)
            false.append(100 * moving[truth.outside].mean())
            missed.append(100 - 100 * moving[truth.inside].mean())
        shares[alpha] = np.mean(false), np.mean(missed), np.mean(false[45:])
    (slow, slow_missed, slow_after), (quick, quick_missed, quick_after) = shares.values()
    assert f"{slow:.1f}" == f"{quick:.1f}"
    page_says(
        "book/teaching/plans.md",
        f"{slow:.1f} % are false at either rate",
        f"missed goes from {slow_missed:.1f} to {quick_missed:.1f} %",
        f"false falls from {slow_after:.0f} to {quick_after:.0f} %",
    )


@pytest.mark.heavy
def test_what_the_guide_quotes_from_chapters_9_11_and_12():
    causes, slave, force = (
        as_it_stands(ROOT / "notebooks" / f"{name}.ipynb").results
        for name in ("09b_causes", "11b_delay", "12_force_feedback")
    )
    clampings = f"the {causes['all_clampings']:.0f} clampings measured"
    page_says("book/teaching/projects.md", clampings)
    guide = "book/teaching/chapters.md"
    page_says(guide, f"In motion nearly all of {slave['total_mm']:.0f} mm is delay")
    assert slave["noise_mm"] < 0.01 * slave["total_mm"]
    page_says(guide, f"be felt as {force['noise_mN']:.1f} mN")
