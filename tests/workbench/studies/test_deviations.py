"""First order against the exact functions of `metrics`, and a registration against what it must and
must not remove.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_table1
from trinolab.metrics import pose_errors
from trinolab.pose import rigid_fit
from workbench.studies.deviations import (
    Source,
    deviations,
    drawn,
    exact,
    first_order,
    means,
    registered,
    rms,
    together,
)

TRUTHS = load_table1().set_poses


def poses_off_by(table):
    """Measured poses whose deviations from Table 1's set poses are `table` (20, 6)."""
    turns = Rotation.from_rotvec(table[:, 3:], degrees=True)
    return RigidTransform.from_components(
        TRUTHS.translation + table[:, :3], turns * TRUTHS.rotation
    )


def small(seed, scale=1e-3):
    return scale * np.random.default_rng(seed).standard_normal((20, 6))


def test_errors_to_first_order_are_the_exact_ones_where_they_are_small():
    table = small(1)
    linear, true = first_order(table, TRUTHS), exact([poses_off_by(table)], TRUTHS)
    for a, b in zip(linear, true, strict=True):
        # second order of 1e-3 deg, 6 times as much at the lock
        np.testing.assert_allclose(a, b[0], rtol=0, atol=3e-6)


def test_means_are_those_of_metrics():
    poses = poses_off_by(small(2, 0.5))
    e = pose_errors(poses, TRUTHS)
    expected = [e.E_t_mm, e.E_alpha_deg, e.E_beta_deg, e.E_gamma_deg, e.geodesic_mean_deg]
    np.testing.assert_allclose(means(exact([poses], TRUTHS)), expected, rtol=1e-12)


def test_rms_by_hand():
    table = np.zeros((2, 20, 6))
    table[0, :, 0], table[0, :, 1] = 3.0, 4.0
    table[1, :, 5] = 2.0  # about z: alpha alone
    np.testing.assert_allclose(
        rms(first_order(table, TRUTHS)), [5 / np.sqrt(2), np.sqrt(2), 0, 0, np.sqrt(2)], atol=1e-12
    )


def test_draws_have_the_covariance_of_the_roots():
    rng = np.random.default_rng(3)
    a, b = (
        Source(name, 1.0, "", rng.standard_normal((20, 6)), rng.standard_normal((20, 6, q)))
        for name, q in (("a", 2), ("b", 3))
    )
    both = together([a, b], "both")
    tables = drawn(both, 40_000, np.random.default_rng(0))
    np.testing.assert_allclose(tables.mean(axis=0), a.fixed + b.fixed, atol=0.1)
    for j, k in ((3, 3), (3, 9)):  # of the fourth pose, and of it with the tenth
        found = np.cov(tables[:, j], tables[:, k], rowvar=False)[:6, 6:]
        expected = a.roots[j] @ a.roots[k].T + b.roots[j] @ b.roots[k].T
        np.testing.assert_allclose(found, expected, atol=0.3)


def test_registration_is_a_rigid_fit_of_the_positions():
    rows, tables = [0, 6, 12, 19], np.array([small(4), small(5)])
    measured = poses_off_by(tables[1])
    T = rigid_fit(measured.translation[rows], TRUTHS.translation[rows])
    np.testing.assert_allclose(
        registered(tables, TRUTHS, rows)[1], deviations(T * measured, TRUTHS), atol=1e-7
    )


@pytest.mark.parametrize("rows", [(0,), (0, 1), (4, 4, 4)])
def test_registration_refuses_too_few_places(rows):
    with pytest.raises(ValueError, match="rows: expected three or more"):
        registered(small(7), TRUTHS, rows)
