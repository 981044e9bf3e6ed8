"""Trials of the slave arm: the force of a block in its way."""

import numpy as np
import pytest

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.studies import master_slave


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
