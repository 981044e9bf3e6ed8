"""One instant: names, files or values, one default estimator, and what is refused."""

import numpy as np
import pytest
from instants import POSE, frames

import trinolab
from trinolab import methods
from trinolab.datasets import load_handle, load_rig
from trinolab.following.parameters import FollowParameters
from trinolab.measurement import measure
from trinolab.parameters import Parameters

RIG, CODED = load_rig("raised_40deg"), load_handle("coded")


def images():
    return list(frames("raised_40deg", "coded"))


@pytest.mark.slow
def test_the_best_estimator_is_the_default_and_the_paper_s_is_named():
    by_default = measure(images(), "raised_40deg", "coded").pose
    paper = measure(images(), RIG, CODED, parameters=Parameters(estimator="paper")).pose
    away = by_default.T_world_handle.translation - POSE.translation
    assert np.linalg.norm(away) < 0.02  # mm
    assert by_default.sigma_mm < 0.01 < 0.03 < paper.sigma_mm  # mm


def test_the_parameters_know_best_and_leave_the_choice_open():
    assert Parameters(estimator="best") == Parameters(estimator=methods.BEST)
    assert Parameters().estimator is None
    assert Parameters().with_default("best").estimator == methods.BEST
    assert Parameters(estimator="reprojection").with_default("best").estimator == "reprojection"
    assert FollowParameters(estimator="paper").checked == FollowParameters().checked
    assert FollowParameters().checked.check
    assert not FollowParameters(estimator="best").checked.check
    with pytest.raises(ValueError, match=r"^check: only the estimator paper has it"):
        Parameters(check=True).with_default("best")


NO_PARAMETERS = [
    ({"estimator": "bets"}, r"estimator: expected one of paper, .*, best, got 'bets'"),
    ({"estimator": "outline"}, "^estimator: 'outline' is gone, take patches$"),
    ({"estimator": "paper_checked"}, r"is gone, take paper with check=True \(--check\)$"),
    ({"estimator": "best", "check": True}, "^check: only the .* paper has it, got 'patches'$"),
    ({"check": "yes"}, "^check: expected True or False, got 'yes'$"),
    ({"sigma_px": 0.0}, "sigma_px"),
    ({"max_slant_deg": 90.1}, "max_slant_deg"),
    ({"max_slant_deg": -0.1}, "max_slant_deg"),
    ({"memory_s": -0.1}, "memory_s"),
]


@pytest.mark.parametrize(("given", "said"), NO_PARAMETERS)
def test_parameters_that_cannot_be_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        Parameters(**given)


def test_dark_images_are_none_of_0_to_1():
    black = [np.zeros(frame.shape) for frame in images()]
    assert measure(black, RIG, CODED).pose.status == "lost"
    # grey levels, most of them none: one camera alone is dark
    dim = [black[0] + 0.5, black[1], images()[2].astype(float)]
    assert measure(dim, RIG, CODED).pose.cameras <= 1


def spoiled(change):
    """The images, the second one changed."""
    first, second, third = images()
    return [first, change(second), third]


def with_nan(image):
    return np.where(image > 200, np.nan, image)


NO_FRAMES = [
    (lambda: images()[:1], "frames: expected one for each of 3 cameras, got 1"),
    (lambda: spoiled(lambda f: f[:-1]), "ccd2: expected 1280 x 1024 pixels, got 1280 x 1023"),
    (lambda: spoiled(lambda f: f.T), "ccd2: expected 1280 x 1024 pixels, got 1024 x 1280"),
    (lambda: spoiled(lambda f: np.dstack([f] * 3)), "frames: ccd2: expected a grey image"),
    (lambda: spoiled(lambda f: f.astype(np.uint16) * 257), "ccd2: .* from 0 to 255, got"),
    (lambda: spoiled(with_nan), "frames: ccd2: expected finite grey values"),
    (lambda: [f / 255 for f in images()], "got floats from 0 to 0.886275; .*by 255"),
    (lambda: None, "frames: expected an image per camera, got None"),
]


@pytest.mark.parametrize(("given", "said"), NO_FRAMES)
def test_frames_that_are_none_of_the_rig_are_named(given, said):
    for call in (lambda f: measure(f, RIG, CODED), lambda f: trinolab.tracker.start(f, RIG, 0.0)):
        with pytest.raises(ValueError, match=said):
            call(given())
