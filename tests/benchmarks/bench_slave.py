"""Milliseconds of a tick of the slave arm: ``python tests/benchmarks/bench_slave.py``."""

import clock
import numpy as np

from trinolab.bench.motion import human_motion
from trinolab.slave import control, mapping
from trinolab.slave.arm import Slave, load_robot
from trinolab.slave.control import Command, Inverse
from trinolab.slave.mapping import Sample, State

LIMIT_MS, TICKS = 1.0, 3000


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
    ticks = inverse.tick_s * np.arange(1, TICKS + 1)
    for t, T in zip(ticks, human_motion(np.random.default_rng(0), ticks), strict=True):
        state, mapping_ms = clock.timed(mapping.step, state, Sample(t, T, "measured", True))
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
