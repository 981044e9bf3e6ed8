"""The four factors: what each changes and what it leaves."""

import numpy as np
import pytest

from trinolab.datasets import load_handle, load_rig
from workbench.studies import factors
from workbench.studies.factors import DISTANCES_MM, FACTORS, at_distance, table1_setup


@pytest.fixture(scope="module")
def setup():
    return table1_setup(load_rig("paper_pair"), load_handle("paper"))


# --- what changes


def test_distortion_is_unknown_to_the_measurement(setup):
    changed = FACTORS["distortion"].change(setup, -0.1)
    assert [list(c.distortions) for c in changed.true_rig.cameras] == [[-0.1, 0, 0, 0, 0]] * 2
    assert changed.rig is setup.rig
    point = [[60.0, 0.0, 600.0]]  # x/z = 0.1 in CCD1
    straight, bent = (
        rig.cameras[0].project(point)[0, 0] for rig in (changed.rig, changed.true_rig)
    )
    assert bent - straight == pytest.approx(-0.1 * 0.1**3 * 2956.2067, rel=1e-9)


@pytest.mark.parametrize("distance_mm", DISTANCES_MM)
def test_distance_moves_along_the_line_of_sight_and_keeps_the_markers_in_view(setup, distance_mm):
    changed, home = at_distance(setup, distance_mm), at_distance(setup, factors.MEAN_DISTANCE_MM)
    assert len(changed.poses) == len(home.poses) == len(changed.velocity) >= 18
    middle = (setup.rig.cameras[0].centre + setup.rig.cameras[1].centre) / 2
    sight, before = changed.poses.translation - middle, home.poses.translation - middle
    np.testing.assert_allclose(sight, before * distance_mm / 570.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        changed.poses.rotation.as_matrix(), home.poses.rotation.as_matrix(), atol=1e-15
    )
    for T in changed.poses:
        assert all(
            camera.sees(T.apply(setup.handle.marker_centres)).all() for camera in setup.rig.cameras
        )


def test_speed_and_turn_rate_are_what_they_say_in_many_directions(setup):
    fast, turning = FACTORS["speed"].change(setup, 200.0), FACTORS["turn"].change(setup, 90.0)
    np.testing.assert_allclose(np.linalg.norm(fast.velocity, axis=1), 200.0)
    np.testing.assert_allclose(np.linalg.norm(turning.turn_rate, axis=1), np.pi / 2)
    assert not fast.turn_rate.any()
    assert not turning.velocity.any()
    for vectors in (fast.velocity, turning.turn_rate):
        assert np.linalg.matrix_rank(vectors) == 3
        assert np.linalg.norm(vectors.mean(axis=0)) < 0.5 * np.linalg.norm(vectors[0])


# --- the shipped tables
