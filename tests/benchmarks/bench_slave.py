"""Milliseconds of a tick of the slave arm, on one core: ``python
tests/benchmarks/bench_slave.py``.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import time

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.slave import control, mapping
from trinolab.slave.arm import Slave, load_robot
from trinolab.slave.control import Command, Inverse
from trinolab.slave.mapping import Sample, State

LIMIT_MS = 1.0
HANDLE = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_rotvec([0, np.pi / 2, 0]))


def moved(t):
    way = np.array([60 * np.sin(2 * t), 30 * np.sin(3 * t), 30 * np.sin(2.5 * t)])
    return RigidTransform.from_components(
        HANDLE.translation + way, Rotation.from_rotvec([0.2 * np.sin(2 * t), 0, 0])
    )


def main(ticks: int = 3000) -> int:
    robot = load_robot()
    inverse, slave = Inverse(robot), Slave(robot)
    state, command, ref = (
        State(0.0, inverse.tool(robot.home)),
        Command(robot.home, np.zeros(6)),
        None,
    )
    times = {"mapping": [], "reference and kinematics": [], "both": [], "servos (simulation)": []}
    for k in range(1, ticks + 1):
        t = k * inverse.tick_s
        begin = time.perf_counter()
        state = mapping.step(state, Sample(t, moved(t), "measured", True))
        mapped = time.perf_counter()
        ref = ref or control.at_rest(state.target)
        after = control.step(ref, state.target, inverse.tick_s)
        last, command = command, inverse.step(command, ref.pose, after.pose)
        ref = control.leashed(after, inverse.tool(command.q))
        solved = time.perf_counter()
        slave.advance(last.q, command.q, inverse.tick_s)
        spans = mapped - begin, solved - mapped, solved - begin, time.perf_counter() - solved
        for name, span in zip(times, spans, strict=True):
            times[name].append(1e3 * span)
    print(f"{'ms a tick':26}{'median':>8}{'99 %':>8}")
    for name, values in times.items():
        print(f"{name:26}{np.median(values):8.3f}{np.percentile(values, 99):8.3f}")
    kept = np.median(times["both"]) <= LIMIT_MS
    print(f"limit of both, median, {LIMIT_MS:g} ms: {'kept' if kept else 'BROKEN'}")
    return int(not kept)


if __name__ == "__main__":
    raise SystemExit(main())
