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


@pytest.mark.parametrize(("held", "damping"), [(0, 0.0), (2, 0.0), (0, 0.3)])
def test_it_is_the_solution_of_the_whole_system(held, damping):
    """Without the rows and columns of what is held, and with a diagonal that is longer by a share."""
    normal, N, n = equations()
    N, n = N[held:, held:], n[held:]
    expected = np.linalg.solve(N + damping * np.diag(np.diag(N)), n)
    # worst of 20 seeds: 2e-14
    common, poses = solved(normal.without(held), damping)
    np.testing.assert_allclose(common, expected[: Q - held], rtol=0, atol=1e-12)
    np.testing.assert_allclose(poses.ravel(), expected[Q - held :], rtol=0, atol=1e-12)
    # and the covariance of the common unknowns that of all
    reduced = eliminated(normal.without(held))
    covariance = np.linalg.inv(N)[: Q - held, : Q - held]
    np.testing.assert_allclose(np.linalg.inv(reduced.S), covariance, atol=1e-12)
    np.testing.assert_allclose(reduced.poses_covariance @ normal.D, [np.eye(6)] * POSES, atol=1e-12)


def test_a_free_pose_has_no_covariance():
    normal, _, _ = equations()
    normal.D[2] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        eliminated(normal)


# --- descent


def step(x, linear, damping):
    r, J = linear
    return x - np.linalg.solve(damped(J.T @ J, damping), J.T @ r)


def test_a_bent_valley_is_followed_to_its_end():
    """Rosenbrock's, whose minimum is 0 at (1, 1)."""

    def linearised(x):
        r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        return (r, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])), float(r @ r) / 2

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


def test_where_there_is_no_minimum_there_is_no_rest():
    """A start without a cost, and a cost that falls for ever."""
    found = descended(np.zeros(1), lambda x: (None, np.nan), step, 1e-12)
    assert not found.at_rest
    assert np.isnan(found.cost)
    found = descended(0.0, lambda x: (None, float(np.exp(-x))), lambda x, _, d: x + 1e-3, 1e-12)
    assert not found.at_rest
    assert found.state == pytest.approx(0.3)
