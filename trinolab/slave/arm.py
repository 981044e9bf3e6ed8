"""The simulated slave arm: a six-axis arm from a MuJoCo model, its servos, and the force at its
tool. Extra `slave`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..checks import Array, as_array, as_number, as_whole, frozen
from ..datasets import data_path
from ..files import limits
from ..rigid import placed

if TYPE_CHECKING:
    import mujoco

SPEED_RAD_S = np.pi  # 180 deg/s, the UR5's
ACCELERATION_RAD_S2 = 10.0  # not published: an assumption
TOOL = "tool"  # the site whose pose is commanded


class Limits(NamedTuple):
    """Limits of every command: lowest and highest position, rad, speed, rad/s, acceleration,
    rad/s^2; each (n,).
    """

    low: Array
    high: Array
    speed: Array
    acceleration: Array


class Robot(NamedTuple):
    """An arm.

    Attributes
    ----------
    model : mujoco.MjModel
        Lengths m. Its site `TOOL` is what is commanded, its keyframe ``home``, if there is one,
        where it starts.
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


def load_robot(
    robot: str | Path = "ur5",
    speed_rad_s: ArrayLike = SPEED_RAD_S,
    acceleration_rad_s2: ArrayLike = ACCELERATION_RAD_S2,
) -> Robot:
    """Read an arm: a shipped one by its name, or an MJCF file.

    Parameters
    ----------
    robot : str or path
        ``ur5``, or a file. Its joints are hinges with a range. Each has a position servo of the
        same name and a speed servo with ``_speed`` behind that name.
    speed_rad_s, acceleration_rad_s2 : array_like, scalar or shape (n,)
        Limits that such a file cannot state.

    Raises
    ------
    ValueError
        Names the file and what is wrong: unreadable, another kind of joint, a joint without a range
        or servo, limits the wrong way round, no site ``tool``, a home beyond the limits; or the
        extra is missing.
    """
    is_name = isinstance(robot, str) and not robot.endswith(".xml") and "/" not in robot
    model = _read(_shipped(str(robot)) if is_name else Path(robot))
    joints = tuple(model.joint(k).name for k in range(model.njnt))
    _check(model, joints, str(robot))
    n = len(joints)
    limits = Limits(
        frozen(np.array(model.jnt_range[:, 0])),
        frozen(np.array(model.jnt_range[:, 1])),
        _positive(speed_rad_s, "speed_rad_s", n),
        _positive(acceleration_rad_s2, "acceleration_rad_s2", n),
    )
    has_home = any(model.key(k).name == "home" for k in range(model.nkey))
    home = np.array(model.key("home").qpos) if has_home else np.zeros(n)
    if not ((limits.low <= home) & (home <= limits.high)).all():
        raise ValueError(f"{robot}: its home is beyond the limits of a joint")
    return Robot(model, joints, limits, frozen(home))


def forward(robot: Robot, q: ArrayLike, site: str = TOOL) -> RigidTransform:
    """T_base_site at joint positions `q` (n,), rad; mm. Raises ValueError if there is no such
    site.
    """
    import mujoco

    data = mujoco.MjData(robot.model)
    data.qpos[:] = as_array(q, "q", (len(robot.joints),))
    mujoco.mj_kinematics(robot.model, data)
    return site_pose(data, site)


def site_pose(data: Any, site: str = TOOL) -> RigidTransform:
    """T_base_site, mm, of a `mujoco.MjData` whose kinematics are computed. ValueError if there is
    no such site.
    """
    try:
        site_data = data.site(site)
    except KeyError:
        raise ValueError(f"site: the robot has no site {site!r}") from None
    return placed(1000 * site_data.xpos, site_data.xmat.reshape(3, 3))


def joint_values(robot: Robot, values: Mapping[str, Any], name: str = "joints") -> Array:
    """Joint positions by name as an array (n,), rad, those that are not named as at home.

    Raises ValueError for a name that is not there, or a value that is no number within the limits.
    """
    if unknown := [joint for joint in values if joint not in robot.joints]:
        raise ValueError(
            f"{name}: unknown joint {unknown[0]!r}; there are {', '.join(robot.joints)}"
        )
    q = [
        as_number(values.get(joint, home), f"{name}: {joint}", low, high)
        for joint, home, low, high in zip(
            robot.joints, robot.home, robot.limits.low, robot.limits.high, strict=True
        )
    ]
    return frozen(np.array(q))


def _read(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        raise ValueError(
            "the slave arm needs the packages mujoco and mink (extra 'slave')"
        ) from None
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    limits.check_bytes(path, path.stat().st_size, limits.TREE_BYTES)
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(
            f"{path}: cannot be read as a robot ({' '.join(str(error).split())})"
        ) from None


def _check(model: Any, joints: tuple[str, ...], where: str) -> None:
    if not joints or model.nq != model.njnt or (model.jnt_type != 3).any():  # mjJNT_HINGE
        raise ValueError(f"{where}: expected hinges as its only joints")
    servos = {model.actuator(k).name for k in range(model.nu)}
    for k, joint in enumerate(joints):
        low, high = model.jnt_range[k]
        if not (model.jnt_limited[k] and low < high):
            raise ValueError(
                f"{where}: joint {joint!r} has no range, or its limits are the wrong way round"
            )
        if missing := {joint, f"{joint}_speed"} - servos:
            raise ValueError(f"{where}: joint {joint!r} has no servo called {min(missing)!r}")
    if TOOL not in {model.site(k).name for k in range(model.nsite)}:
        raise ValueError(f"{where}: it has no site {TOOL!r}")


def _shipped(name: str) -> Path:
    """The file of a shipped arm. Raises ValueError, which lists them, if there is none of that name."""
    names = sorted(path.stem for path in data_path("robots").glob("*.xml"))
    if name not in names:
        raise ValueError(f"{name}: no such file, and no shipped arm ({', '.join(names)})")
    return data_path("robots", f"{name}.xml")


def _positive(value: ArrayLike, name: str, n: int) -> Array:
    array = (
        np.broadcast_to(np.asarray(value, float), (n,))
        if np.ndim(value) == 0
        else as_array(value, name, (n,))
    )
    for entry in array:
        as_number(entry, name, 0.0, open_low=True)
    return frozen(np.array(array))


class Reading(NamedTuple):
    """Measurements at the arm.

    Attributes
    ----------
    t_s : float
        Time of the simulation, s.
    q, speed : ndarray, shape (n,)
        Of the joints, rad and rad/s.
    tool : RigidTransform
        T_base_tool, mm.
    force : ndarray, shape (3,)
        On the tool, by what it touches, N, base frame.
    """

    t_s: float
    q: Array
    speed: Array
    tool: RigidTransform
    force: Array


class Slave:
    """The arm in MuJoCo, at rest at joint positions `q` (its home without them).

    Its servos run at every step of the simulation (1 kHz in the shipped model); commands between
    two ticks are interpolated.

    Parameters
    ----------
    robot : Robot
    q : array_like, shape (n,), optional
        rad.

    Raises
    ------
    ValueError
        For a start beyond the limits, or one in which the tool is inside something.
    """

    def __init__(self, robot: Robot, q: ArrayLike | None = None) -> None:
        import mujoco

        self.robot = robot
        self._mujoco = mujoco
        self._data = mujoco.MjData(robot.model)
        start = robot.home if q is None else as_array(q, "q", (len(robot.joints),))
        if ((start < robot.limits.low) | (start > robot.limits.high)).any():
            raise ValueError("q: the start is beyond the limits of a joint")
        self._data.qpos[:] = start
        self._position, self._speed = (
            [robot.model.actuator(f"{joint}{end}").id for joint in robot.joints]
            for end in ("", "_speed")
        )
        self._data.ctrl[self._position] = start
        mujoco.mj_forward(robot.model, self._data)
        if (self._data.contact.dist < 0).any():
            raise ValueError("q: at the start the tool is inside something")

    @property
    def data(self) -> Any:
        """The `mujoco.MjData`, for pictures of the scene."""
        return self._data

    def advance(self, q_before: Array, q_after: Array, dt: float) -> Reading:
        """Go on by `dt` s, while the commanded positions go from one to the other with one speed.

        Raises ValueError if the simulation diverges.
        """
        steps = as_whole(round(dt / self.robot.model.opt.timestep), "dt", low=1)
        self._data.ctrl[self._speed] = (q_after - q_before) / dt
        for k in range(steps):  # a servo compares where the joint is with where it should be now
            self._data.ctrl[self._position] = q_before + (q_after - q_before) * (k / steps)
            self._mujoco.mj_step(self.robot.model, self._data)
        if self._diverges():
            raise ValueError(f"the simulation diverges at {self._data.time:.3f} s")
        return self.read()

    def read(self) -> Reading:
        """The present measurements."""
        d = self._data
        return Reading(
            float(d.time),
            frozen(np.array(d.qpos)),
            frozen(np.array(d.qvel)),
            site_pose(d),
            frozen(self._force()),
        )

    def _force(self) -> Array:
        """The sum of the contact forces on the tool's body."""
        model = self.robot.model
        data = self._data
        total = np.zeros(3)
        body = model.site(TOOL).bodyid.item()
        wrench = np.zeros(6)
        for k in range(
            data.ncon
        ):  # to go through `data.contact` itself takes 0.2 ms, also if empty
            contact = data.contact[k]
            bodies = [model.geom_bodyid[geom] for geom in contact.geom]
            if body in bodies:
                self._mujoco.mj_contactForce(model, data, k, wrench)
                on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
                total += on_second if bodies[1] == body else -on_second
        return total

    def _diverges(self) -> bool:
        bad = (
            self._mujoco.mjtWarning.mjWARN_BADQACC,
            self._mujoco.mjtWarning.mjWARN_BADQVEL,
            self._mujoco.mjtWarning.mjWARN_BADQPOS,
        )
        return not np.isfinite(self._data.qpos).all() or any(
            self._data.warning[one].number for one in bad
        )
