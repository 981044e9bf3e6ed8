"""Milliseconds of a tick of the slave arm: ``python tests/benchmarks/bench_slave.py``."""

import clock
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.slave import control, mapping
from trinolab.slave.arm import Slave, load_robot
from trinolab.slave.control import Command, Inverse
from trinolab.slave.mapping import Sample, State

LIMIT_MS, TICKS = 1.0, 3000
HANDLE = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_rotvec([0, np.pi / 2, 0]))


def moved(t):
    way = np.array([60 * np.sin(2 * t), 30 * np.sin(3 * t), 30 * np.sin(2.5 * t)])
    return RigidTransform.from_components(
        HANDLE.translation + way, Rotation.from_rotvec([0.2 * np.sin(2 * t), 0, 0])
    )


def main() -> int:
    robot = load_robot()
    inverse, slave = Inverse(robot), Slave(robot)
    state, command = State(0.0, inverse.tool(robot.home)), Command(robot.home, np.zeros(6))
    ref = control.at_rest(state.target)

    def solved():
        after = control.step(ref, state.target, inverse.tick_s)
        then = inverse.step(command, ref.pose, after.pose)
        return then, control.leashed(after, inverse.tool(then.q))

    times = []
    for k in range(1, TICKS + 1):
        t = k * inverse.tick_s
        state, mapping_ms = clock.timed(mapping.step, state, Sample(t, moved(t), "measured", True))
        last = command
        (command, ref), solving_ms = clock.timed(solved)
        _, servo_ms = clock.timed(slave.advance, last.q, command.q, inverse.tick_s)
        times.append((mapping_ms, solving_ms, mapping_ms + solving_ms, servo_ms))
    mapping_, solving, both, servos = np.transpose(times)
    clock.line("mapping", mapping_)
    clock.line("reference and kinematics", solving)
    clock.line("both", both, limit=LIMIT_MS)
    clock.line("servos (simulation)", servos)
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
