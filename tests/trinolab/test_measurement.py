"""One instant: names, files or values, one default estimator, and what is refused."""

import numpy as np
import pytest

import trinolab
from trinolab import methods
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import data_path, load_handle, load_rig, load_table1, rig_file
from trinolab.following.parameters import FollowParameters
from trinolab.measurement import measure
from trinolab.parameters import Parameters

RIG, CODED = load_rig("raised_40deg"), load_handle("coded")
TRUTH = load_table1().set_poses[4]


@pytest.fixture(scope="module")
def frames():
    return render_rig(RIG, CODED, TRUTH, Bench(), np.random.default_rng(0))


def matrix(measurement):
    return measurement.pose.T_world_handle.as_matrix().tolist()


@pytest.mark.slow
def test_names_files_and_values_are_the_same_rig_and_handle(frames):
    found = [
        measure(frames, *asked)
        for asked in (
            ("raised_40deg", "coded"),
            (rig_file("raised_40deg"), str(data_path("handles", "coded.toml"))),
            (RIG, CODED),
        )
    ]
    assert matrix(found[0]) == matrix(found[1]) == matrix(found[2])
    assert found[0].pose.status == "measured"


@pytest.mark.slow
def test_the_best_estimator_is_the_default_and_the_paper_s_is_named(frames):
    by_default = measure(frames, RIG, CODED)
    assert matrix(by_default) == matrix(
        measure(frames, RIG, CODED, parameters=Parameters(estimator="best"))
    )
    # what changes a threshold says nothing of the estimator
    other = measure(frames, RIG, CODED, parameters=Parameters(max_slant_deg=69.0))
    assert other.pose.sigma_mm < 0.01  # mm; the paper's says 0.05
    paper = measure(frames, RIG, CODED, parameters=Parameters(estimator="paper"))
    away = by_default.pose.T_world_handle.translation - TRUTH.translation
    assert np.linalg.norm(away) < 0.02  # mm
    assert by_default.pose.sigma_mm < 0.01 < 0.03 < paper.pose.sigma_mm  # mm


def test_the_parameters_know_best_and_leave_the_choice_open():
    assert Parameters(estimator="best") == Parameters(estimator=methods.BEST)
    assert Parameters().estimator is None
    assert Parameters().with_default("best").estimator == methods.BEST
    assert Parameters(estimator="reprojection").with_default("best").estimator == "reprojection"
    with pytest.raises(ValueError, match=r"estimator: expected one of paper, .*, best, got 'bets'"):
        Parameters(estimator="bets")


@pytest.mark.parametrize(
    ("gone", "instead"),
    [
        ("outline", "patches"),
        ("weighted", "reprojection"),
        ("paper_checked", r"paper with check=True \(--check\)"),
    ],
)
def test_an_estimator_that_is_gone_names_its_successor(gone, instead):
    with pytest.raises(ValueError, match=rf"^estimator: '{gone}' is gone, take {instead}$"):
        Parameters(estimator=gone)


def test_a_check_is_of_the_papers_poses_alone():
    assert FollowParameters(estimator="paper").checked == FollowParameters().checked
    assert FollowParameters().checked.check
    assert not FollowParameters(estimator="best").checked.check
    for parameters in (
        {"estimator": "best", "check": True},
        {"estimator": "patches", "check": True},
    ):
        with pytest.raises(
            ValueError, match=r"^check: only the estimator paper has it, got 'patches'$"
        ):
            Parameters(**parameters)
    with pytest.raises(ValueError, match=r"^check: only the estimator paper has it"):
        Parameters(check=True).with_default("best")
    with pytest.raises(ValueError, match=r"^check: expected True or False, got 'yes'$"):
        Parameters(check="yes")


@pytest.mark.parametrize(
    ("rig", "handle", "said"),
    [
        ("raised_40", CODED, r"^raised_40: no such file, and no shipped rig \(paper_pair, "),
        (RIG, "code", r"^code: no such file, and no shipped handle \(coded, paper\)$"),
        ("no/rig.toml", CODED, r"no/rig.toml"),
        (None, CODED, r"^rig: expected a file or the name of a shipped one .*, got None$"),
        (RIG, 3, r"^handle: expected a file or the name of a shipped one .*, got 3$"),
        (RIG, "", r"^handle: expected a file or the name of a shipped one"),
    ],
)
def test_what_is_no_rig_and_no_handle_is_refused_in_one_line(rig, handle, said):
    with pytest.raises(ValueError, match=said) as refused:
        measure([], rig, handle)
    assert "\n" not in str(refused.value)


def test_the_chain_wants_values_and_says_where_they_come_from(frames):
    with pytest.raises(
        ValueError, match=r"rig: expected a Rig, as trinolab.load_rig gives, got 'p"
    ):
        trinolab.triangulate("paper_pair", np.zeros((2, 1, 2)))
    with pytest.raises(ValueError, match="rig: expected a Rig"):
        trinolab.tracker.start(frames, "raised_40deg", 0.0)


def test_images_of_0_to_1_are_refused_and_dark_ones_are_not(frames):
    said = "frames: expected grey levels from 0 to 255, got floats from 0 to 0.886275; .*by 255"
    with pytest.raises(ValueError, match=said):
        measure([frame / 255.0 for frame in frames], RIG, CODED)
    black = [np.zeros(frame.shape) for frame in frames]
    assert measure(black, RIG, CODED).pose.status == "lost"
    # grey levels, most of them none: one camera alone is dark
    dim = [black[0] + 0.5, black[1], frames[2].astype(float)]
    assert measure(dim, RIG, CODED).pose.cameras <= 1


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: measure(None, RIG, CODED), "frames: expected an image per camera, got None"),
        (lambda: measure("abc", RIG, CODED), "frames: expected an image per camera, got str"),
        (lambda: trinolab.Rig("paper_pair"), "cameras: expected two or more, got 'paper_pair'"),
        (lambda: trinolab.Rig(3), "cameras: expected two or more, got 3"),
        (lambda: trinolab.Rig([1, 2]), "cameras: expected values of Camera, got 1"),
        (lambda: trinolab.track(3, "p.csv"), "folder: expected a recording folder, got int"),
        (
            lambda: trinolab.render("paper_pairs", "coded", "calm", "out"),
            "paper_pairs: no such file, and no shipped rig",
        ),
        (
            lambda: trinolab.track(".", "p.csv", rig=3),
            "rig: expected a file or the name of a ship",
        ),
    ],
)
def test_what_a_caller_does_wrong_is_a_value_error(call, said):
    with pytest.raises(ValueError, match=said):
        call()


def test_a_number_that_is_missing_is_refused(frames):
    spoiled = [frame.astype(float) for frame in frames]
    spoiled[1][3, 4] = np.nan
    with pytest.raises(ValueError, match="frames: ccd2: expected finite grey values"):
        measure(spoiled, RIG, CODED)
