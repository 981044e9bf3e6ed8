"""The normal equations without the poses against the whole of them, and damped steps on costs whose
minimum is known.
"""

import numpy as np
import pytest

from trinolab.calibration.normal import Normal, damped, descended, eliminated, solved

Q, POSES = 5, 4


def equations(seed=0):
    """Normal equations of random slopes: as `Normal`, and as one dense system."""
    rng = np.random.default_rng(seed)
    common = rng.normal(size=(POSES, 9, Q))
    by_pose = rng.normal(size=(POSES, 9, 6))
    missing = rng.normal(size=(POSES, 9))
    J = np.zeros((9 * POSES, Q + 6 * POSES))
    for k in range(POSES):
        J[9 * k : 9 * (k + 1), :Q] = common[k]
        J[9 * k : 9 * (k + 1), Q + 6 * k : Q + 6 * (k + 1)] = by_pose[k]
    normal = Normal(
        sum(block.T @ block for block in common),
        sum(block.T @ r for block, r in zip(common, missing, strict=True)),
        np.stack([pose.T @ block for pose, block in zip(by_pose, common, strict=True)]),
        np.stack([pose.T @ pose for pose in by_pose]),
        np.stack([pose.T @ r for pose, r in zip(by_pose, missing, strict=True)]),
    )
    return normal, J.T @ J, J.T @ missing.ravel()


def test_it_is_the_solution_of_the_whole_system():
    normal, N, n = equations()
    reduced = eliminated(normal)
    expected = np.linalg.solve(N, n)
    common = np.linalg.solve(reduced.S, reduced.s)
    # worst of 20 seeds: 2e-14
    np.testing.assert_allclose(common, expected[:Q], rtol=0, atol=1e-12)
    poses = reduced.pose_steps(common)
    np.testing.assert_allclose(poses.ravel(), expected[Q:], rtol=0, atol=1e-12)
    # and the covariance of the common unknowns that of all
    np.testing.assert_allclose(np.linalg.inv(reduced.S), np.linalg.inv(N)[:Q, :Q], atol=1e-12)
    np.testing.assert_allclose(reduced.poses_covariance @ normal.D, [np.eye(6)] * POSES, atol=1e-12)


def test_a_free_pose_has_no_covariance():
    normal, _, _ = equations()
    normal.D[2] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        eliminated(normal)


def test_damping_by_hand():
    matrices = np.array([[[1.0, 2.0], [2.0, 5.0]], [[4.0, 1.0], [1.0, 3.0]]])
    longer = damped(matrices, 0.5)
    np.testing.assert_array_equal(longer, [[[1.5, 2], [2, 7.5]], [[6, 1], [1, 4.5]]])
    assert matrices[0, 0, 0] == 1.0


def test_a_damped_step_is_the_solution_of_the_whole_system_with_a_longer_diagonal():
    normal, N, n = equations()
    expected = np.linalg.solve(N + 0.3 * np.diag(np.diag(N)), n)
    common, poses = solved(normal, 0.3)
    np.testing.assert_allclose(common, expected[:Q], rtol=0, atol=1e-12)
    np.testing.assert_allclose(poses.ravel(), expected[Q:], rtol=0, atol=1e-12)


def test_without_the_held_unknowns_it_is_the_system_without_their_rows_and_columns():
    normal, N, n = equations()
    held = 2
    expected = np.linalg.solve(N[held:, held:], n[held:])
    reduced = eliminated(normal.without(held))
    common = np.linalg.solve(reduced.S, reduced.s)
    np.testing.assert_allclose(common, expected[: Q - held], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        reduced.pose_steps(common).ravel(), expected[Q - held :], rtol=0, atol=1e-12
    )


# --- descent


def rosenbrock(x):
    """Residuals and slopes of Rosenbrock's valley, whose minimum is 0 at (1, 1)."""
    r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
    return r, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def step(x, linear, damping):
    r, J = linear
    return x - np.linalg.solve(damped(J.T @ J, damping), J.T @ r)


def test_a_bent_valley_is_followed_to_its_end():
    def linearised(x):
        r, J = rosenbrock(x)
        return (r, J), float(r @ r) / 2

    found = descended(np.array([-1.2, 1.0]), linearised, step, 1e-12)
    np.testing.assert_allclose(found.state, [1, 1], rtol=0, atol=1e-9)
    assert found.at_rest
    assert found.cost < 1e-20


def test_steps_out_of_range_are_not_taken():
    """The cost of log(x)^2 / 2 + 1 / 2 is NaN below 0, where the first full steps from 5 lead."""
    tried = []

    def linearised(x):
        tried.append(x[0])
        r = np.array([np.log(x[0]) if x[0] > 0 else np.nan, 1.0])
        return (r, np.array([[1 / x[0]], [0.0]])), float(r @ r) / 2

    found = descended(np.array([5.0]), linearised, step, 1e-12)
    assert min(tried) < 0
    # near the minimum the cost is 1/2 + (x - 1)^2 / 2: to 1e-12 of it
    assert found.state[0] == pytest.approx(1.0, abs=1e-6)
    assert found.at_rest


def test_a_start_without_a_cost_is_no_rest():
    found = descended(np.zeros(1), lambda x: (None, np.nan), step, 1e-12)
    assert not found.at_rest
    assert np.isnan(found.cost)


def test_steps_come_to_an_end_where_the_cost_falls_for_ever():
    found = descended(0.0, lambda x: (None, float(np.exp(-x))), lambda x, _, d: x + 1e-3, 1e-12)
    assert not found.at_rest
    assert found.state == pytest.approx(0.3)
