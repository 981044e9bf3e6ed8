"""What errors of rig and layout do to pixels and poses: slopes against differences, propagation
against draws.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Rig, RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.systematic import NOTHING, pixel_slopes, response, systematic_covariance

BENT = np.array([-0.2, 0.1, 0.001, -0.002, 0.05])
RIG = Rig(tuple(replace(camera, distortions=BENT) for camera in load_rig("raised_40deg").cameras))
CODED = load_handle("coded")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
# a step of each parameter, about a tenth of a pixel
STEPS = np.array([0.1] * 4 + [1e-2] * 2 + [1e-3] * 2 + [1e-1] + [3e-5] * 3 + [0.02] * 3)


@pytest.mark.parametrize("c", range(3))
def test_pixels_move_with_the_rig_as_the_slopes_say(c):
    points = POSE.apply(CODED.marker_centres)
    by_parameters, by_points = pixel_slopes(RIG.cameras[c], points)
    for k, step in enumerate(STEPS):
        delta = np.zeros(45)
        delta[15 * c + k] = step
        ahead, behind = (displaced(RIG, s * delta).cameras[c].project(points) for s in (1, -1))
        np.testing.assert_allclose(
            by_parameters[..., k], (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-8
        )
    for k in range(3):
        shift = 0.01 * np.eye(3)[k]
        ahead, behind = (RIG.cameras[c].project(points + s * shift) for s in (1, -1))
        np.testing.assert_allclose(by_points[..., k], (ahead - behind) / 0.02, rtol=1e-6, atol=1e-8)


def test_nothing_is_known_of_most_rigs():
    found = response(np.ones((6, 1, 2)), np.array([0]), np.array([0]), CODED, POSE)
    assert systematic_covariance(found, RIG, CODED) is NOTHING


def test_what_cameras_and_views_have_in_common_adds_up():
    """Two views of one camera move together with it, two of one marker with the marker."""
    gain = np.zeros((6, 2, 2))
    gain[0, :, 0] = 1.0  # x by u, both views alike
    sigma = np.zeros(45)
    sigma[[2, 17]] = 0.3  # cx of two cameras, independent
    rig = replace(RIG, covariance=RigCovariance(RIG.names, np.diag(sigma**2)))

    def spread(cameras, markers, rig=rig, handle=CODED):
        found = response(gain, np.array(cameras), np.array(markers), handle, POSE)
        return np.sqrt(systematic_covariance(found, rig, handle)[0, 0])

    assert spread([0, 0], [0, 1]) == pytest.approx(0.6)
    assert spread([0, 1], [0, 1]) == pytest.approx(0.3 * np.sqrt(2))
    assert spread([2, 2], [0, 1]) == 0.0
    placed = replace(CODED, placement_sigma_mm=0.05)
    moves = 0.05 * np.linalg.norm(
        pixel_slopes(RIG.cameras[0], POSE.apply(CODED.marker_centres))[1][0, 0]
    )
    assert spread([0, 0], [0, 0], RIG, placed) == pytest.approx(2 * moves)
    assert spread([0, 0], [0, 1], RIG, placed) == pytest.approx(np.sqrt(2) * moves, rel=0.02)
    assert spread([0, 0], [-1, -1], RIG, placed) == 0.0
