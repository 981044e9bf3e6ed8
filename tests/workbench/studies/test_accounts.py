"""The two accounts of Table 1: constants recovered from rotations that have them, a two-sided fit
by another algorithm, intervals by tables and by SciPy.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_table1
from trinolab.metrics import euler_deg, pose_from_euler_deg
from workbench.studies.accounts import (
    clamped_anew,
    clamping,
    columns,
    f_test,
    fit_constants,
    misaligned,
    sigma_interval,
)
from workbench.studies.deviations import drawn, exact, first_order

TABLE = load_table1()
TRUTHS = TABLE.set_poses
ERRORS = exact([TABLE.measured], TRUTHS)
TURNS = ERRORS.turns_deg[0]
BOTH = columns(TRUTHS, ["reference", "mount"])


def alternating(measured, true):
    """R' = C1 R C2 by chordal means, one side after the other."""
    C1 = C2 = Rotation.identity()
    for _ in range(300):
        C1 = (measured * (true * C2).inv()).mean()
        C2 = (true.inv() * C1.inv() * measured).mean()
    return C1, C2


def test_constants_of_exact_rotations_are_recovered():
    C1 = Rotation.from_rotvec([0.05, -0.02, 0.08], degrees=True)
    C2 = Rotation.from_rotvec([-0.03, 0.06, 0.01], degrees=True)
    turned = RigidTransform.from_components(TRUTHS.translation, C1 * TRUTHS.rotation * C2)
    fit = fit_constants(exact([turned], TRUTHS).turns_deg[0], BOTH)
    expected = [0.05, -0.02, 0.08, -0.03, 0.06, 0.01]
    np.testing.assert_allclose(fit.values_deg, expected, atol=2e-4)  # second order
    assert fit.sigma_deg < 1e-4
    assert fit.free == 54


def test_two_sided_fit_of_table_1_against_alternating_means():
    C1, C2 = alternating(TABLE.measured.rotation, TRUTHS.rotation)
    rest = (C1 * TRUTHS.rotation * C2).inv() * TABLE.measured.rotation
    fit = fit_constants(TURNS, BOTH)
    np.testing.assert_allclose(fit.values_deg[:3], C1.as_rotvec(degrees=True), atol=0.02)
    np.testing.assert_allclose(fit.values_deg[3:], C2.as_rotvec(degrees=True), atol=0.02)
    left = np.rad2deg(rest.magnitude()).mean()
    assert np.linalg.norm(fit.rest_deg, axis=1).mean() == pytest.approx(left, abs=0.005)
    assert left == pytest.approx(0.573, abs=0.002)


def test_alpha_is_a_turn_of_the_reference_and_gamma_one_of_the_mount():
    angles = columns(TRUTHS, ["angles"])
    np.testing.assert_allclose(angles[:, :, 0], columns(TRUTHS, ["reference"])[:, :, 2], atol=1e-12)
    np.testing.assert_allclose(angles[:, :, 2], columns(TRUTHS, ["mount"])[:, :, 0], atol=1e-12)
    beta = np.concatenate([BOTH, angles[:, :, 1:2]], axis=2).reshape(60, 7)
    assert np.linalg.matrix_rank(beta) == 7
    # exactly, not only to first order
    off = pose_from_euler_deg(TRUTHS.translation, euler_deg(TRUTHS) + [30.0, 0.0, -20.0])
    z, x = (Rotation.from_euler(*turn, degrees=True) for turn in (("z", 30), ("x", -20)))
    assert (off.rotation * (z * TRUTHS.rotation * x).inv()).magnitude().max() < 1e-12


def test_constants_that_are_the_same_are_refused():
    with pytest.raises(ValueError, match="told apart"):
        fit_constants(TURNS, columns(TRUTHS, ["reference", "angles"]))
    with pytest.raises(ValueError, match="kinds: expected"):
        columns(TRUTHS, ["camera"])


def test_f_of_one_constant_is_the_square_of_its_t():
    whole = fit_constants(TURNS, np.concatenate([BOTH, columns(TRUTHS, ["angles"])[:, :, 1:2]], 2))
    F, p = f_test(fit_constants(TURNS, BOTH), whole)
    t = whole.values_deg[-1] / np.sqrt(whole.covariance[-1, -1])
    assert pytest.approx(t**2, rel=1e-9) == F
    assert p == pytest.approx(2 * stats.t.sf(abs(t), 53), rel=1e-9)


def test_f_of_several_constants_is_that_of_the_squares_that_are_left():
    three = columns(TRUTHS, ["angles"])
    seven = np.concatenate([BOTH, three[:, :, 1:2]], axis=2)
    rest = [np.linalg.lstsq(A.reshape(60, -1), TURNS.reshape(60))[1].item() for A in (three, seven)]
    F, p = f_test(fit_constants(TURNS, three), fit_constants(TURNS, seven))
    assert pytest.approx((rest[0] - rest[1]) / 4 / (rest[1] / 53)) == F
    assert p == pytest.approx(stats.f.sf(F, 4, 53))


def test_interval_of_a_standard_deviation_by_the_table():
    # chi square with 9 degrees of freedom: 2.700 and 19.023
    found = sigma_interval(9.0, 9)
    np.testing.assert_allclose(found, [1.0, np.sqrt(9 / 19.0228), np.sqrt(9 / 2.70039)], rtol=1e-5)


def test_numbers_of_the_clamp():
    found = clamping(ERRORS, TRUTHS)
    for k, interval in enumerate(found.index_deg):
        scipy = stats.ttest_1samp(ERRORS.angles_deg[0, :, k], 0.0).confidence_interval(0.95)
        np.testing.assert_allclose(interval[1:], [scipy.low, scipy.high], rtol=1e-9)
    variances = ERRORS.angles_deg[0].var(axis=0, ddof=1)
    assert found.repeat_deg.value == pytest.approx(np.sqrt(variances.mean()))
    assert found.place_mm.value == pytest.approx(0.19065, abs=1e-4)


def test_the_clamps_tables_are_like_table_1():
    tables = drawn(clamped_anew(ERRORS, TRUTHS), 6000, np.random.default_rng(0))
    positions, angles, _ = first_order(tables, TRUTHS)
    np.testing.assert_allclose(angles.mean(axis=(0, 1)), [0.71, 0.52, 0.64], atol=0.005)
    # scatter, and what is not known of the mean
    sigma = clamping(ERRORS, TRUTHS).repeat_deg.value * np.sqrt(1 + 1 / 20)
    np.testing.assert_allclose(angles.std(axis=(0, 1)), sigma, rtol=0.02)
    np.testing.assert_allclose(positions.std(axis=(0, 1)), 0.1907, rtol=0.02)


def test_misaligned_tables_have_the_fitted_constants():
    fit = fit_constants(TURNS, BOTH)
    tables = drawn(misaligned(ERRORS, TRUTHS), 6000, np.random.default_rng(0))
    again = np.linalg.lstsq(BOTH.reshape(60, 6), tables[..., 3:].reshape(6000, 60).T)[0]
    np.testing.assert_allclose(again.mean(axis=1), fit.values_deg, atol=0.01)
    # drawn twice: what is not known of the fit, and the scatter of a table
    np.testing.assert_allclose(np.cov(again), 2 * fit.covariance, rtol=0.15, atol=1e-3)
