"""How much of Table 1 the images can make: by hand, by another likelihood, and on drawn tables."""

import numpy as np
import pytest
from scipy import optimize, stats
from scipy.linalg import block_diag

from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.triangulation import triangulate
from workbench.studies import isotropy
from workbench.studies.pattern import rigid_field

TABLE = load_table1()
POSITIONS = TABLE.set_poses.translation
ERRORS = TABLE.measured.translation - POSITIONS
RIG = load_rig("paper_pair")
OF_POINTS = isotropy.of_points(RIG, POSITIONS)
OF_ROD = isotropy.of_rods(RIG, load_handle("paper"), TABLE.set_poses)


def test_mauchly_by_hand():
    """Equal variances and no correlation: W is 1, and p as well; a long axis: W by hand."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    assert isotropy.mauchly(axes) == pytest.approx(1.0)
    W = 1 * 1 * 9 / (11 / 3) ** 3
    expected = stats.chi2.sf(-(5 - 23 / 18) * np.log(W), 5)
    assert isotropy.mauchly(axes * [1, 1, 3]) == pytest.approx(expected)


def test_a_pixel_is_long_in_depth():
    """Two cameras with the angle v between their axes: depth is about 2 / tan(v) times as uncertain
    as the side that both see alike.
    """
    sd = np.sqrt(OF_POINTS.mean(axis=0).diagonal())
    assert sd == pytest.approx([0.26, 0.17, 1.56], abs=0.02)
    noise = np.random.default_rng(0).standard_normal((400, 2, 20, 2))
    exact = np.stack([camera.project(POSITIONS) for camera in RIG.cameras])
    moved = np.array([triangulate(RIG, exact + 0.05 * e) - POSITIONS for e in noise])
    drawn = np.sqrt((moved**2).mean(axis=(0, 1))) / 0.05
    # Eq. 20-22 are no least squares: their side is a little worse
    assert drawn[2] == pytest.approx(sd[2], rel=0.05)


@pytest.mark.parametrize(
    ("covariances", "at_most", "refused"), [(OF_POINTS, 0.35, 63), (OF_ROD, 0.28, 58)]
)
def test_the_bound_by_another_likelihood(covariances, at_most, refused):
    """Both sizes free, minimised numerically, the registration as a diffuse prior."""
    bound = isotropy.of_images(ERRORS, POSITIONS, covariances)
    F = rigid_field(POSITIONS).reshape(60, 6)
    A = block_diag(*covariances)
    e = ERRORS.ravel()

    def minus_log(sigma2, tau2):
        V = sigma2 * np.eye(60) + tau2 * A
        inverse = np.linalg.inv(V)
        K = F.T @ inverse @ F
        P = inverse - inverse @ F @ np.linalg.solve(K, F.T @ inverse)
        return (np.linalg.slogdet(V)[1] + np.linalg.slogdet(K)[1] + e @ P @ e) / 2

    def least(of_log, low, high):
        return optimize.minimize_scalar(of_log, bounds=(low, high), method="bounded").fun

    iso = least(lambda s: minus_log(np.exp(s), 0.0), -6, 0)
    image = least(lambda t: minus_log(1e-12, np.exp(t)), -9, 2)
    assert bound.refused == pytest.approx(2 * (image - iso), abs=0.1)
    assert bound.refused == pytest.approx(refused, abs=3)
    assert bound.at_most == pytest.approx(at_most, abs=0.03)
    assert bound.likeliest < bound.at_most / 2


def test_the_bound_holds_the_truth_as_often_as_it_says():
    found = isotropy.power(POSITIONS, OF_POINTS, 0.5, 2000, np.random.default_rng(1))
    held = np.mean([one.at_most >= 0.5 for one in found])
    assert held == pytest.approx(0.95, abs=0.03)
    of_images = isotropy.power(POSITIONS, OF_POINTS, 1.0, 500, np.random.default_rng(2))
    assert np.mean([one.refused > 0 for one in of_images]) < 0.01
