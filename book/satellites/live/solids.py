"""The arm as the page draws it: its simple shapes once, and in each frame where its bodies are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from trinolab.checks import Array
from trinolab.slave.arm import Robot
from workbench.teleop.session import Session
from workbench.teleop.view import geom_colour, visible_geoms

if TYPE_CHECKING:
    import mujoco

MM = 1000.0  # of a metre
PLANE_MM = 1.0  # half as thick is a plane drawn
ENDLESS_MM = 2000.0  # and half as wide, where it has no end


def shapes(robot: Robot) -> list[dict[str, Any]]:
    """The arm's visible shapes, and those of what stands about it.

    Each has its ``kind``, ``box``, ``cylinder``, ``capsule`` (both along z) or ``ellipsoid``, half
    its ``size`` (3,), mm (radius, radius, half the length), its ``colour``, the ``body`` that
    carries it, a number of `body_poses` or -1 for what stands still, and its pose ``T`` on that
    body, the first three rows of the matrix, mm. Of any other shape its bounding box is drawn.
    """
    import mujoco

    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    carriers = _carriers(model)
    found = []
    for geom in visible_geoms(model):
        root = int(model.body_weldid[model.geom_bodyid[geom]])
        kind, size, middle = _shape(model, geom)
        R_root = data.xmat[root].reshape(3, 3)
        R_geom = data.geom_xmat[geom].reshape(3, 3)
        centre = data.geom_xpos[geom] + R_geom @ middle - data.xpos[root]
        T = np.column_stack([R_root.T @ R_geom, MM * R_root.T @ centre])
        found.append(
            {
                "kind": kind,
                "size": np.round(MM * size, 2).tolist(),
                "colour": [round(share, 3) for share in geom_colour(model, geom)],
                "body": carriers.index(root) if root in carriers else -1,
                "T": np.round(T, 5).ravel().tolist(),
            }
        )
    return found


def body_poses(session: Session) -> list[float]:
    """Where the arm's moving bodies are, for each x, y, z, mm, and a quaternion w, x, y, z, base
    frame.
    """
    data = session.slave.data
    carriers = _carriers(session.robot.model)
    places = np.round(MM * data.xpos[carriers], 1)
    turns = np.round(data.xquat[carriers], 4)
    return np.hstack([places, turns]).ravel().tolist()


def arm_points(session: Session) -> list[list[float]]:
    """Where the arm's bodies are, from its base to its tool, mm, base frame."""
    model, data = session.robot.model, session.slave.data
    body = int(model.site("tool").bodyid.item())
    points = [MM * data.site("tool").xpos]
    while body:
        points.append(MM * data.xpos[body])
        body = int(model.body_parentid[body])
    return [[round(float(x), 1) for x in point] for point in reversed(points)]


def _carriers(model: mujoco.MjModel) -> list[int]:
    """The bodies that move; what is fixed to one of them goes along."""
    return sorted({int(body) for body in model.body_weldid} - {0})


def _shape(model: mujoco.MjModel, geom: int) -> tuple[str, Array, Array]:
    """How a geom is drawn: its kind, half its size (3,), and its middle in its own frame, m."""
    import mujoco

    kind = mujoco.mjtGeom(model.geom_type[geom])
    a, b, c = map(float, model.geom_size[geom])
    here = np.zeros(3)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return "box", np.array([a, b, c]), here
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
        name = "cylinder" if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else "capsule"
        return name, np.array([a, a, b]), here
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return "ellipsoid", np.array([a, b or a, c or a]), here
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        endless = ENDLESS_MM / MM
        return "box", np.array([a or endless, b or endless, PLANE_MM / MM]), here
    return "box", np.array(model.geom_aabb[geom, 3:]), np.array(model.geom_aabb[geom, :3])
