"""The slave arm under 1,000 poses at 30 Hz: an ordinary hand, the wrist's singular pose, beyond
reach, a jump.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.slave import control
from trinolab.slave.arm import forward, load_robot
from trinolab.slave.control import Command, Inverse

POSES, TICKS = 250, 17  # of each part; ticks in a thirtieth of a second


def report(arguments) -> None:
    robot = load_robot()
    inverse = Inverse(robot)
    print(
        f"{4 * POSES} commanded poses, 30 a second, {TICKS} ticks each; error against the limited reference, and how"
    )
    print(
        "far that is behind the command; largest position beyond a limit, rad; speed, acceleration by their limits"
    )
    print(
        f"{'part':10s} {'mean mm':>8s} {'most mm':>8s} {'mean deg':>9s} {'most deg':>9s} {'behind mm':>10s} "
        f"{'deg':>6s} {'beyond':>9s} {'speed':>7s} {'accel':>7s}"
    )
    for name, command in parts(robot).items():
        rows, q, speed = follow(robot, inverse, [command(k / 30) for k in range(POSES)])
        beyond = max((robot.limits.low - q).max(), (q - robot.limits.high).max())
        change = np.abs(np.diff(speed, axis=0, prepend=np.zeros((1, 6)))) / inverse.tick_s
        print(
            f"{name:10s} {rows[:, 0].mean():8.4f} {rows[:, 0].max():8.3f} {rows[:, 1].mean():9.4f} "
            f"{rows[:, 1].max():9.3f} {rows[:, 2].mean():10.2f} {rows[:, 3].mean():6.2f} {beyond:9.2e} "
            f"{(np.abs(speed) / robot.limits.speed).max():7.4f} {(change / robot.limits.acceleration).max():7.4f}"
        )


def parts(robot):
    """From the name of a part to the commanded T_base_tool at a time."""
    home = forward(robot, robot.home)

    def at(way, turn=(0.0, 0.0, 0.0)):
        return RigidTransform.from_components(
            home.translation + np.array(way), Rotation.from_rotvec(turn) * home.rotation
        )

    def ordinary(t):
        return at(
            np.array([80, 60, 50]) * np.sin(2 * np.pi * np.array([0.4, 0.3, 0.5]) * t),
            np.array([0.3, 0.25, 0.4]) * np.sin(2 * np.pi * np.array([0.4, 0.35, 0.3]) * t),
        )

    def singular(t):
        q = np.array(robot.home)
        # through 0, where the axes of wrist 1 and 3 are parallel
        q[4] += 1.5 * (1 - np.cos(2 * np.pi * t / 8))
        wobble = [3, 5 * np.sin(3 * t), 2], Rotation.from_rotvec([0.02 * np.sin(7 * t), 0.02, 0])
        return forward(robot, q) * RigidTransform.from_components(*wobble)

    def beyond(t):
        return at([-700 * np.clip(min(t / 3, 8 - t), 0, 1), 0, 0])

    def jump(t):
        return at(np.array([100, 80, 78]), [0, 0, np.pi / 3]) if t > 2 else home

    return {"ordinary": ordinary, "singular": singular, "beyond": beyond, "jump": jump}


def follow(robot, inverse, targets):
    """For each tick the error, mm and deg, and how far the reference is behind, mm and deg;
    positions, and speeds.
    """
    command, start = Command(robot.home, np.zeros(6)), inverse.tool(robot.home)
    ref, rows, q, speed = control.at_rest(start), [], [], []
    for target in targets:
        for _ in range(TICKS):
            after = control.step(ref, target, inverse.tick_s)
            command = inverse.step(command, ref.pose, after.pose)
            tool = inverse.tool(command.q)
            rows.append((*apart(tool, after.pose), *apart(after.pose, target)))
            q, speed = [*q, command.q], [*speed, command.speed]
            ref = control.leashed(after, tool)
    return np.array(rows), np.array(q), np.array(speed)


def apart(one, other):
    return (
        np.linalg.norm(one.translation - other.translation),
        np.rad2deg((one.rotation * other.rotation.inv()).magnitude()),
    )
