"""Trials of the slave arm: the force of a block in its way."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from workbench.studies import master_slave


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


def test_the_speed_is_the_rms_over_the_ticks_at_the_tool_s_scale():
    """Steps of 3 and 4 mm in 10 and 20 ms: 300 and 200 mm/s."""
    hand = RigidTransform.from_translation([[0.0, 0, 0], [3.0, 0, 0], [3.0, 4.0, 0]])
    trial = master_slave.Trial(np.array([0.0, 0.01, 0.03]), {"hand": hand}, ())
    rms = np.sqrt((300.0**2 + 200.0**2) / 2)
    assert master_slave.speed_mm_s(trial) == pytest.approx(rms)
    assert master_slave.speed_mm_s(trial, 4.0) == pytest.approx(rms / 4)
