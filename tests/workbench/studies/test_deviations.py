"""First order against the exact functions of `metrics`, and a registration against what it must and
must not remove.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_table1
from trinolab.pose import rigid_fit
from workbench.studies.deviations import (
    Source,
    deviations,
    drawn,
    exact,
    first_order,
    registered,
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
