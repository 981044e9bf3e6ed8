"""Trials of the slave arm: the tool after a recorded track, and the force of a block in its way."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.studies import master_slave


@pytest.fixture(autouse=True, scope="module")
def _tracked_once():
    """The recording is tracked once for all trials."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(master_slave, "_tracked", cache(master_slave._tracked))
        yield


@pytest.mark.heavy
def test_after_a_recorded_track_the_tool_is_where_the_true_motion_leads():
    assert master_slave.slave_at_rest() < 1.0


def test_a_tracker_that_is_off_is_noticed(monkeypatch):
    """The test above can fail: the last pose, 2 mm beside the true one."""
    tracked = master_slave._tracked

    def beside(folder):
        *before, last = tracked(folder)
        pose = type(last.T_world_handle).from_translation([2.0, 0, 0]) * last.T_world_handle
        return [
            *before,
            *[last._replace(t_s=last.t_s + k / 30, T_world_handle=pose) for k in range(20)],
        ]

    monkeypatch.setattr(master_slave, "_tracked", beside)
    assert master_slave.slave_at_rest() > 1.5


def test_the_block_pushes_back_where_it_is_touched():
    session, felt = master_slave.pushed()
    across, along = np.linalg.norm(felt.force[[0, 2]]), -felt.force[1]
    assert 20 < along < 200
    assert across < 0.3 * along
    assert (
        felt.tool.translation[1]
        < master_slave.BLOCK_Y_MM - master_slave.TOOL_RADIUS_MM + master_slave.DEEP_MM
    )
    block = session.robot.model.geom("block")
    assert block.pos[1] == 0  # in its body
    assert 1000 * (session.robot.model.body("block").pos[1] - block.size[1]) == pytest.approx(
        master_slave.BLOCK_Y_MM
    )
    assert 1000 * session.robot.model.geom("tool").size[0] == pytest.approx(
        master_slave.TOOL_RADIUS_MM
    )
