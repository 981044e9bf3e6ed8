"""The two accounts of Table 1: constants recovered from rotations that have them, intervals by
tables and by SciPy.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_table1
from trinolab.metrics import euler_deg, pose_from_euler_deg
from workbench.studies.accounts import (
    clamping,
    columns,
    f_test,
    fit_constants,
    sigma_interval,
)
from workbench.studies.deviations import exact

TABLE = load_table1()
TRUTHS = TABLE.set_poses
ERRORS = exact([TABLE.measured], TRUTHS)
TURNS = ERRORS.turns_deg[0]
BOTH = columns(TRUTHS, ["reference", "mount"])


def test_constants_of_exact_rotations_are_recovered():
    C1 = Rotation.from_rotvec([0.05, -0.02, 0.08], degrees=True)
    C2 = Rotation.from_rotvec([-0.03, 0.06, 0.01], degrees=True)
    turned = RigidTransform.from_components(TRUTHS.translation, C1 * TRUTHS.rotation * C2)
    fit = fit_constants(exact([turned], TRUTHS).turns_deg[0], BOTH)
    expected = [0.05, -0.02, 0.08, -0.03, 0.06, 0.01]
    np.testing.assert_allclose(fit.values_deg, expected, atol=2e-4)  # second order
    assert fit.sigma_deg < 1e-4
    assert fit.free == 54


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
