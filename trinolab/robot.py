"""A six-axis arm from a MuJoCo model: its joints and their limits, and where its tool is. Extra `slave`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array, as_array, as_number, frozen
from .datasets import data_path
from .rigid import placed

if TYPE_CHECKING:  # the simulator belongs to an extra
    import mujoco

SPEED_RAD_S = np.pi  # 180 deg/s, the UR5's
ACCELERATION_RAD_S2 = 10.0  # not published: an assumption
TOOL = "tool"  # the site whose pose is commanded


class Limits(NamedTuple):
    """What no command exceeds: lowest and highest position, rad, speed, rad/s, acceleration, rad/s^2; each (n,)."""

    low: Array
    high: Array
    speed: Array
    acceleration: Array


class Robot(NamedTuple):
    """An arm.

    Attributes
    ----------
    model : mujoco.MjModel
        Lengths m. Its site `TOOL` is what is commanded, its keyframe ``home``, if there is one, where it starts.
    joints : tuple of str
        Hinges, in the order of every array of joint positions.
    limits : Limits
    home : ndarray, shape (n,)
        rad.
    """

    model: mujoco.MjModel
    joints: tuple[str, ...]
    limits: Limits
    home: Array


def load_robot(robot: str | Path = "ur5", speed_rad_s: ArrayLike = SPEED_RAD_S,
               acceleration_rad_s2: ArrayLike = ACCELERATION_RAD_S2) -> Robot:
    """Read an arm: a shipped one by its name, or an MJCF file.

    Parameters
    ----------
    robot : str or path
        ``ur5``, or a file. Its joints are hinges with a range, each with a servo of its name for the position, and one
        with ``_speed`` behind it for the speed.
    speed_rad_s, acceleration_rad_s2 : array_like, scalar or shape (n,)
        Limits that such a file cannot state.

    Raises
    ------
    ValueError
        Names the file and what is wrong: unreadable, another kind of joint, a joint without a range or servo, limits
        the wrong way round, no site ``tool``, a home beyond the limits; or the extra is missing.
    """
    model = _read(data_path("robots", f"{robot}.xml") if _is_name(robot) else Path(robot))
    joints = tuple(model.joint(k).name for k in range(model.njnt))
    _check(model, joints, str(robot))
    n = len(joints)
    limits = Limits(frozen(np.array(model.jnt_range[:, 0])), frozen(np.array(model.jnt_range[:, 1])),
                    _positive(speed_rad_s, "speed_rad_s", n), _positive(acceleration_rad_s2, "acceleration_rad_s2", n))
    home = np.array(model.key("home").qpos) if _has_home(model) else np.zeros(n)
    if not ((limits.low <= home) & (home <= limits.high)).all():
        raise ValueError(f"{robot}: its home is beyond the limits of a joint")
    return Robot(model, joints, limits, frozen(home))


def forward(robot: Robot, q: ArrayLike, site: str = TOOL) -> RigidTransform:
    """T_base_site at joint positions `q` (n,), rad; mm. Raises ValueError for another shape, NaN, or no such site."""
    import mujoco

    data = mujoco.MjData(robot.model)
    data.qpos[:] = as_array(q, "q", (len(robot.joints),))
    mujoco.mj_kinematics(robot.model, data)
    return site_pose(data, site)


def site_pose(data: Any, site: str = TOOL) -> RigidTransform:
    """T_base_site, mm, of a `mujoco.MjData` whose kinematics are computed. ValueError if there is no such site."""
    try:
        found = data.site(site)
    except KeyError:
        raise ValueError(f"site: the robot has no site {site!r}") from None
    return placed(1000 * found.xpos, Rotation.from_matrix(found.xmat.reshape(3, 3), assume_valid=True))


def joint_values(robot: Robot, values: Mapping[str, Any], name: str = "joints") -> Array:
    """Joint positions by name as an array (n,), rad, those that are not named as at home.

    Raises ValueError for a name that is not there, or a value that is no number within the limits.
    """
    if unknown := [joint for joint in values if joint not in robot.joints]:
        raise ValueError(f"{name}: unknown joint {unknown[0]!r}; there are {', '.join(robot.joints)}")
    q = [as_number(values.get(joint, home), f"{name}: {joint}", low, high)
         for joint, home, low, high in zip(robot.joints, robot.home, robot.limits.low, robot.limits.high, strict=True)]
    return frozen(np.array(q))


def _read(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        raise ValueError("the slave arm needs the packages mujoco and mink (extra 'slave')") from None
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(f"{path}: cannot be read as a robot ({' '.join(str(error).split())})") from None


def _check(model: Any, joints: tuple[str, ...], where: str) -> None:
    if not joints or model.nq != model.njnt or (model.jnt_type != 3).any():  # mjJNT_HINGE
        raise ValueError(f"{where}: expected hinges as its only joints")
    servos = {model.actuator(k).name for k in range(model.nu)}
    for k, joint in enumerate(joints):
        low, high = model.jnt_range[k]
        if not (model.jnt_limited[k] and low < high):
            raise ValueError(f"{where}: joint {joint!r} has no range, or its limits are the wrong way round")
        if missing := {joint, f"{joint}_speed"} - servos:
            raise ValueError(f"{where}: joint {joint!r} has no servo called {min(missing)!r}")
    if TOOL not in {model.site(k).name for k in range(model.nsite)}:
        raise ValueError(f"{where}: it has no site {TOOL!r}")


def _has_home(model: Any) -> bool:
    return any(model.key(k).name == "home" for k in range(model.nkey))


def _is_name(robot: str | Path) -> bool:
    return isinstance(robot, str) and not robot.endswith(".xml") and "/" not in robot


def _positive(value: ArrayLike, name: str, n: int) -> Array:
    array = np.broadcast_to(np.asarray(value, float), (n,)) if np.ndim(value) == 0 else as_array(value, name, (n,))
    for entry in array:
        as_number(entry, name, 0.0, open_low=True)
    return frozen(np.array(array))
