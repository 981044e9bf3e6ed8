"""The instruments of `make verify`: on errors that are made by hand or drawn from a known law."""

from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks import bench_measure
from scipy.spatial.transform import RigidTransform, Rotation
from verification import accuracy, calibrations, draws, identity, nees

from trinolab import measurement
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.measurement import Measurement
from trinolab.parameters import Parameters
from trinolab.pose import LOST, Pose
from workbench.studies.bound import Bound

PAPER, CODED = load_handle("paper"), load_handle("coded")
TRUTHS = load_table1().set_poses
ROOT = np.random.default_rng(3).standard_normal((6, 6)) * np.array([1e-2] * 3 + [1e-3] * 3)[:, None]
HONEST = ROOT @ ROOT.T


def off(T, error):
    """A pose that is off by an error of position and rotation vector, world frame."""
    return RigidTransform.from_components(
        T.translation + error[:3], Rotation.from_rotvec(error[3:]) * T.rotation
    )


def drawn(seeds, covariance=HONEST, turn=lambda k: RigidTransform.identity()):
    rng = np.random.default_rng(0)
    found = []
    for row in range(20):
        for seed in range(seeds):
            T = off(TRUTHS[row], ROOT @ rng.standard_normal(6)) * turn(seed)
            found.append(draws.Draw(row, seed, Pose("measured", T, covariance, 0.1, 6, 2)))
    return found


def mean_nees(found, handle=CODED):
    return np.mean([nees.nees(draw.pose, draw.truth, handle) for draw in found], axis=0)


@pytest.mark.heavy
def test_honest_covariance_is_inside_the_band_and_a_wrong_one_outside():
    assert nees.band(1000) == pytest.approx((5.787, 6.217), abs=2e-3)  # 6 +- 1.96 sqrt(12 / 1000)
    low, high = nees.band(400)
    six, position, rotation = mean_nees(drawn(20))
    assert low < six < high
    assert position == pytest.approx(3, abs=0.25)  # 2 sqrt(6 / 400)
    assert rotation == pytest.approx(3, abs=0.25)
    assert mean_nees(drawn(20, HONEST / 1.2))[0] > high
    assert mean_nees(drawn(20, 1.2 * HONEST))[0] < low


def test_equivalent_poses_are_as_good():
    turned = mean_nees(drawn(2, turn=lambda k: PAPER.symmetries[5 * k + 2]), PAPER)
    assert turned == pytest.approx(mean_nees(drawn(2)), rel=1e-6)
    estimates, truths = draws.held(
        [*drawn(1, turn=lambda k: PAPER.symmetries[7]), draws.Draw(0, 1, LOST)], PAPER
    )
    assert len(estimates) == 20
    assert (estimates.rotation * truths.rotation.inv()).magnitude().max() < 0.02


@pytest.mark.heavy
def test_errors_drawn_from_the_bound_have_the_ratio_one():
    bounds = [Bound(HONEST if row < 10 else 4 * HONEST) for row in range(20)]
    rng = np.random.default_rng(1)
    found = [
        draws.Draw(
            row,
            0,
            Pose(
                "measured",
                off(TRUTHS[row], (1 + (row >= 10)) * ROOT @ rng.standard_normal(6)),
                HONEST,
                0.1,
                6,
                2,
            ),
        )
        for row in range(20)
        for _ in range(100)
    ]
    assert np.ravel(accuracy.ratios(found, bounds)) == pytest.approx(np.ones(4), abs=0.06)
    assert np.ravel(
        accuracy.ratios(found, [Bound(b.covariance / 9) for b in bounds])
    ) == pytest.approx(3 * np.ones(4), abs=0.18)


def test_frames_of_a_seed_are_those_of_the_replication():
    rig = load_rig("paper_pair")
    drawn = {(row, seed): images for row, seed, images in draws.frames(rig, PAPER, 2, slice(0, 2))}
    rng = np.random.default_rng(1)
    rendered = [render_rig(rig, PAPER, TRUTHS[row], Bench(), rng) for row in (0, 1)]
    for row in (0, 1):
        assert np.array_equal(drawn[row, 1], rendered[row])
    assert not np.array_equal(drawn[0, 0], drawn[0, 1])


def test_every_estimator_measures_the_same_draws():
    found = draws.table1_draws(
        load_rig("paper_pair"),
        PAPER,
        1,
        slice(7, 8),
        True,
        {"a": Parameters(), "b": Parameters(max_slant_deg=80.0)},
    )
    assert [(d.row, d.seed, d.pose.status) for d in found["a"]] == [(7, 0, "measured")]
    assert found["b"][0].pose.residual_px >= found["a"][0].pose.residual_px


def test_benchmark_clocks_stages_that_exist():
    with bench_measure.clocked(measurement, bench_measure.STAGES) as spent:
        measured = measurement.measure(
            [np.zeros((1024, 1280), np.uint8)] * 2, "paper_pair", "paper"
        )
    assert measured.pose is LOST
    assert spent["markers"] > 0
    assert spent["pose"] == 0
    assert list(spent) == list(bench_measure.STAGES.values())


# --- calibrations


def test_sigmas_count_errors_of_rig_and_layout():
    """A sample of what `make verify` counts; what is new in each instant is a tenth of the error."""
    known = calibrations.setup("raised_40deg", "coded", "poor")
    scores = calibrations.from_pixels(known, draws=6, poses=1)
    for name in calibrations.ESTIMATORS:
        found = calibrations.summary(scores[name, True])
        # rms of six errors with two or three degrees of freedom: 1 +- 0.2
        assert 0.5 < found.mm < 1.6, name
        assert 0.5 < found.deg < 1.6, name
        assert found.measured > 0.7
        assert found.badly == 0


def test_a_score_counts_in_sigmas_and_finds_what_is_badly_wrong():
    known = calibrations.setup("paper_pair", "coded", "good")
    T = TRUTHS[4]
    small = np.diag([1e-4, 1e-4, 2e-4, 1e-6, 1e-6, 2e-6])  # 0.02 mm, 0.115 deg
    systematic = np.diag([3e-2, 3e-2, 3e-2, 0, 0, 0])

    def score(away, covariance=small, systematic=0 * small):
        pose = Pose("measured", off(T, np.array(away)), covariance, 0.1, 6, 2, systematic)
        return calibrations.score(pose, T, known)

    assert score([0, 0.02, 0, 0, 0, 0]).mm == pytest.approx(1.0)
    assert score([0, 0, 0, 0.004, 0, 0]).deg == pytest.approx(2.0)
    assert score([0, 1.9, 0, 0, 0, 0])[2] is False  # 95 sigmas, and less than 2 mm
    assert score([0, 2.1, 0, 0, 0, 0])[2] is True
    assert score([0, 2.1, 0, 0, 0, 0], systematic=9 * systematic)[2] is False
    assert score([0, 0, 0, 0.1, 0, 0])[2] is True  # 5.7 deg
    assert calibrations.score(LOST, T, known) is None


# --- identities


def test_one_exchanged_label_is_wrong():
    rig, T = load_rig("paper_pair"), TRUTHS[4]
    uv = [camera.project(T.apply(CODED.marker_centres)) for camera in rig.cameras]
    facing = [
        np.flatnonzero(identity.true_labels(c, CODED, T, pixels) == np.arange(12))
        for c, pixels in zip(rig.cameras, uv, strict=True)
    ]
    found = tuple(
        SimpleNamespace(uv=pixels[shown]) for pixels, shown in zip(uv, facing, strict=True)
    )
    pose = Pose("measured", T, HONEST, 0.1, 6, 2)
    assert identity.rightly_labelled(Measurement(pose, found, tuple(facing)), T, rig, CODED)
    wrong = [facing[0], facing[1][[1, 0, *range(2, len(facing[1]))]]]
    assert not identity.rightly_labelled(Measurement(pose, found, tuple(wrong)), T, rig, CODED)
    unused = [facing[0], np.full_like(facing[1], -1)]
    assert identity.rightly_labelled(Measurement(pose, found, tuple(unused)), T, rig, CODED)
    assert not identity.rightly_labelled(Measurement(LOST, found, tuple(unused)), T, rig, CODED)
