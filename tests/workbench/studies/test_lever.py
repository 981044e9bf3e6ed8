"""The lever of Table 1's angle errors: its columns against motions that really turn about a clamp,
its tests against other software's numbers, its power against the noncentral F distribution.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_table1
from workbench.studies.deviations import exact
from workbench.studies.lever import lever_field, part_tests, power
from workbench.studies.pattern import rigid_field

TABLE = load_table1()
TRUTHS = TABLE.set_poses
ERRORS = exact([TABLE.measured], TRUTHS)
TURNS, OFF = ERRORS.turns_deg[0], ERRORS.position_mm[0]
FIELD = rigid_field(TRUTHS.translation)


def flat(field):
    return np.asarray(field).reshape(60, -1)


def test_a_handle_that_turns_about_a_clamp_moves_its_origin_by_the_lever():
    """Each pose is turned about the clamp's place in the world, without any small-angle formula."""
    clamp = np.array([3.0, -40.0, 7.0])
    small = 1e-3 * np.random.default_rng(0).standard_normal((20, 3))  # deg
    moved = []
    for T, turn in zip(TRUTHS, small, strict=True):
        place = T.apply(clamp)
        rotation = Rotation.from_rotvec(turn, degrees=True)
        about = RigidTransform.from_components(place - rotation.apply(place), rotation)
        np.testing.assert_allclose((about * T).apply(clamp), place, atol=1e-9)  # the clamp stays
        moved.append((about * T).translation - T.translation)
    predicted = lever_field(small, TRUTHS.rotation) @ clamp
    # second order of 1e-3 deg at 40 mm
    np.testing.assert_allclose(predicted, moved, atol=1e-7)


def fit_of_table1(some):
    parts = {"registration": flat(FIELD), "lever": flat(some)}
    return part_tests(parts, OFF.reshape(60))["lever"]


def test_table_1_has_no_lever():
    found = fit_of_table1(lever_field(TURNS, TRUTHS.rotation))
    # another program's: 0 +- 3 to 4 mm, F 0.01, p 0.999
    np.testing.assert_allclose(found.values, [0.3, 0.4, 0.4], atol=0.05)
    np.testing.assert_allclose(found.sigmas, [4.0, 3.3, 3.3], atol=0.05)
    assert pytest.approx(0.0088, abs=1e-4) == found.F
    assert found.p == pytest.approx(0.9989, abs=1e-4)


def test_intervals_of_shares_hold_what_they_say():
    """Of 200 samples with a known share; an F below chance's median only makes them longer."""
    rng = np.random.default_rng(3)
    A = rng.standard_normal((60, 3))
    signal = A @ [0.5, 0.3, 0.0]
    held = 0
    for _ in range(200):
        y = signal + rng.standard_normal(60)
        true = float(signal @ signal / (y @ y))
        found = part_tests({"a": A}, y)["a"]
        held += found.low <= true <= found.high
    assert 0.90 <= held / 200 <= 0.99


@pytest.mark.parametrize("distance_mm", [1e-6, 8.0, 20.0])
def test_power_is_that_of_the_noncentral_f(distance_mm):
    columns_mm = lever_field(TURNS, TRUTHS.rotation)
    others, own = flat(FIELD), flat(columns_mm[:, :, 1:2])
    basis, _ = np.linalg.qr(others)
    signal = distance_mm * own[:, 0]
    signal = signal - basis @ (basis.T @ signal)
    size = float(signal @ signal) / 0.19**2
    expected = stats.ncf.sf(stats.f.isf(0.05, 1, 53), 1, 53, size)
    rng = np.random.default_rng(4)
    share = power(columns_mm[:, :, 1:2], FIELD, [distance_mm], 0.19, 0.05, 2000, rng)
    assert share == pytest.approx(expected, abs=0.02)  # four standard deviations of 2,000 draws


def test_columns_that_cannot_be_told_apart_are_refused():
    with pytest.raises(ValueError, match="parts: expected columns that can be told apart"):
        part_tests({"a": np.ones((5, 1)), "b": np.ones((5, 1))}, np.arange(5.0))
