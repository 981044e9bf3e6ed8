"""What happens in the standard recordings, and when: the scripts against what a person would look
for.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import true_visibility
from trinolab.bench.scenario import (
    ABSENT_S,
    AWAY_S,
    BACK_S,
    COVERED,
    EMPTY_S,
    HIDDEN,
    LIGHT_STEP_S,
    calm,
    following,
    hard,
)
from trinolab.datasets import load_handle, load_rig

RIG, PAIR, CODED = load_rig("raised_40deg"), load_rig("paper_pair"), load_handle("coded")
TIMES = np.arange(300) / 30


def poses(shots):
    return RigidTransform.concatenate(
        [shot.T_world_handle for shot in shots if shot.T_world_handle is not None]
    )


def seen(shot, arm):
    return [
        int(true_visibility(camera, CODED, shot.T_world_handle, arm).sum())
        for camera in RIG.cameras
    ]


def test_calm_begins_with_an_empty_second_and_nothing_else_happens():
    shots = calm(RIG, TIMES, 0)
    assert [shot.T_world_handle is None for shot in shots] == [t < 1.0 for t in TIMES]
    assert [shot.arm is None for shot in shots] == [t < EMPTY_S for t in TIMES]
    assert {shot.gains for shot in shots} == {(1.0, 1.0, 1.0)}
    assert not any(shot.shadows or shot.velocity.any() or shot.turn_rate.any() for shot in shots)


@pytest.mark.parametrize("script", [calm, hard])
def test_a_script_does_not_depend_on_how_long_it_is_played(script):
    short, long = script(RIG, TIMES[:60], 3), script(RIG, TIMES, 3)[:60]
    # mm
    np.testing.assert_allclose(poses(short).as_matrix(), poses(long).as_matrix(), rtol=0, atol=1e-9)
    assert [shot.gains for shot in short] == [shot.gains for shot in long]
    other = poses(script(RIG, TIMES[:60], 4)).translation
    assert np.abs(other - poses(short).translation).max() > 10


def test_the_light_steps_by_a_half_and_drifts():
    light = np.array([shot.gains[0] for shot in hard(RIG, TIMES, 0)])
    ratio = light[1:] / light[:-1]
    assert TIMES[1:][ratio.argmax()] == pytest.approx(LIGHT_STEP_S)
    assert ratio.max() == pytest.approx(1.5, rel=0.01)  # the drift in 1/30 s
    after = light[TIMES >= LIGHT_STEP_S]
    assert 0.1 < np.ptp(after) / after.mean() < 0.2
    assert np.abs(np.delete(ratio, ratio.argmax()) - 1).max() < 0.003


@pytest.mark.parametrize("rig", [RIG, PAIR])
def test_one_camera_is_covered_for_a_second(rig):
    dark = np.array([shot.gains for shot in hard(rig, TIMES, 0)]) == 0
    assert dark.sum(axis=0).tolist() == [30 * (k == COVERED[2]) for k in range(len(rig.cameras))]
    assert np.ptp(TIMES[dark.any(axis=1)]) == pytest.approx(29 / 30)


@pytest.mark.parametrize(("begin", "end", "hidden"), HIDDEN)
def test_a_second_hand_hides_one_camera_and_has_come_from_outside_the_images(begin, end, hidden):
    first, middle = hard(RIG, [begin, (begin + end) / 2], 0)
    assert seen(middle, middle.arm)[hidden] == 0
    assert max(seen(middle, middle.arm)) >= 4
    assert seen(first, first.arm) == seen(first, following(RIG, [first.T_world_handle])[0].arm)
    assert first.arm.hides_from is not None


def test_the_handle_leaves_all_images_and_comes_back_and_then_it_is_away():
    shots = hard(RIG, TIMES, 0)
    for k in np.flatnonzero((TIMES >= AWAY_S) & (TIMES <= BACK_S)):
        centres = shots[k].T_world_handle.apply(CODED.marker_centres)
        assert not any(camera.sees(centres).any() for camera in RIG.cameras)
    away = ((ABSENT_S[0] <= TIMES) & (ABSENT_S[1] > TIMES)).tolist()
    assert [shot.T_world_handle is None for shot in shots] == away
    assert [shot.arm is None for shot in shots] == away
    places = poses(shots[: away.index(True)]).translation
    # mm/s: a swift hand, no jump
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() * 30 < 1300


def test_the_speeds_that_smear_are_those_of_the_motion():
    shots = hard(RIG, np.array([2.5 - 1e-3, 2.5, 2.5 + 1e-3]), 1)
    before, _, after = poses(shots)
    velocity = (after.translation - before.translation) / 2e-3
    turn_rate = (after.rotation * before.rotation.inv()).as_rotvec() / 2e-3
    np.testing.assert_allclose(shots[1].velocity, velocity, rtol=0.03, atol=3)
    np.testing.assert_allclose(shots[1].turn_rate, turn_rate, rtol=0.03, atol=0.005)


def test_a_hand_follows_given_poses():
    T = RigidTransform.from_translation([0.0, 0, 570])
    shots = following(PAIR, [None, T])
    assert [shot.T_world_handle for shot in shots] == [None, T]
    assert [shot.arm is None for shot in shots] == [True, False]
    assert shots[1].gains == (1.0, 1.0)
