"""A master and a slave that feel each other, one degree of freedom (beyond the paper).

There are two masses, a hand on one and an object in front of the other, and a channel with a delay
between them. The loop is closed in three ways: position-position, wave variables, and
position-position under a passivity controller. Speeds and forces count towards the slave's
surroundings; SI units.

Hannaford (1989), IEEE Trans. Robotics and Automation 5(4), 426-434, describes the two-port;
Anderson and Spong (1989), IEEE Trans. Automatic Control 34(5), 494-501, and Niemeyer and Slotine
(1991), IEEE J. Oceanic Engineering 16(1), 152-162, the waves; Hannaford and Ryu (2002), IEEE Trans.
Robotics and Automation 18(1), 1-10, the passivity controller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from ..checks import Array, as_array, as_number, check_numbers, frozen

SCHEMES = ("position-position", "waves", "passivity control")
STEP_S = 2e-4  # of the simulation
GRID = 4000  # frequencies among which crossings are looked for
SWINGS = 40  # of a simulation that is to tell growth from decay
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Teleoperator:
    """Two masses and the channel between them.

    Attributes
    ----------
    master_kg, slave_kg : float
        Of the master with the hand that holds it, and of the slave.
    damping : float
        b, N s/m, of either; positive.
    stiffness, coupling_damping : float
        K, N/m, and D, N s/m, of the spring and the damper that pull each side to where the other
        is.
    delay_s : float
        T, of the channel, each way.
    """

    master_kg: float
    slave_kg: float
    damping: float
    stiffness: float
    coupling_damping: float
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "master_kg", "slave_kg", "damping", "stiffness", low=0.0, open_low=True)
        check_numbers(self, "coupling_damping", "delay_s", low=0.0)


class Run(NamedTuple):
    """A simulated run: times, s; positions of master and slave, m; the forces of the channel on
    either, N, towards the surroundings on the slave and away from them on the master; the energy,
    J, that both have put into the channel. Shape (n,) each.
    """

    t_s: Array
    master_m: Array
    slave_m: Array
    master_n: Array
    slave_n: Array
    energy_j: Array


def hybrid_matrix(teleoperator: Teleoperator, omega: ArrayLike) -> Complex:
    """The two-port of position-position, shape (n, 2, 2): (F_h, -V_s) = H (V_m, F_e).

    Parameters
    ----------
    teleoperator : Teleoperator
    omega : array_like, shape (n,)
        rad/s, positive.
    """
    p = teleoperator
    s = 1j * as_array(omega, "omega", (None,))
    coupling = p.coupling_damping + p.stiffness / s
    late = np.exp(-s * p.delay_s)
    master = p.master_kg * s + p.damping + coupling
    slave = p.slave_kg * s + p.damping + coupling
    rows = [
        [master - (late * coupling) ** 2 / slave, late * coupling / slave],
        [-late * coupling / slave, 1 / slave],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def felt_impedance(H: Complex, touched: ArrayLike) -> Complex:
    """F_h / V_m, N s/m, shape (n,): what a hand feels of an impedance `touched` (n,) through two-ports
    (n, 2, 2).
    """
    Z = np.asarray(touched)
    return np.asarray(H[:, 0, 0] - H[:, 0, 1] * H[:, 1, 0] * Z / (1 + H[:, 1, 1] * Z))


def critical_delay(teleoperator: Teleoperator) -> float:
    """The delay each way, s, from which on position-position is unstable while nobody holds it;
    infinite if it never is.

    The characteristic equation is L(s) exp(-2 s T) = 1 with L = C^2 / ((Z_m + C) (Z_s + C)). A root
    can cross the imaginary axis only where ``|L|`` = 1, and there arg L = 2 omega T.
    """
    p = teleoperator

    def loop(omega: float) -> complex:
        s = 1j * omega
        coupling = p.coupling_damping + p.stiffness / s
        master = p.master_kg * s + p.damping + coupling
        slave = p.slave_kg * s + p.damping + coupling
        return complex(coupling**2 / (master * slave))

    def size(omega: float) -> float:
        return abs(loop(omega)) - 1

    fastest = np.sqrt(p.stiffness / min(p.master_kg, p.slave_kg))
    grid = fastest * np.geomspace(1e-3, 1e2, GRID)
    values = np.array([size(omega) for omega in grid])
    delays = [np.inf]
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        omega = brentq(size, grid[k], grid[k + 1], xtol=1e-12 * grid[k])
        delays.append(float(np.angle(loop(omega)) % (2 * np.pi) / (2 * omega)))
    return min(delays)


def simulate(
    teleoperator: Teleoperator,
    scheme: str,
    push_n: ArrayLike,
    wall_m: float = np.inf,
    wall_stiffness: float = 0.0,
    step_s: float = STEP_S,
    start_m_s: float = 0.0,
) -> Run:
    """Move both masses from rest at 0, a step for each of the hand's forces.

    Parameters
    ----------
    teleoperator : Teleoperator
        Its delay is rounded to whole steps. The impedance of the waves is D.
    scheme : {"position-position", "waves", "passivity control"}
    push_n : array_like, shape (n,)
        The hand's force, N.
    wall_m, wall_stiffness : float
        The object: a spring that pushes back from this position on, m and N/m.
    step_s : float
        s.
    start_m_s : float
        Speed of the master at the start, m/s.

    Raises
    ------
    ValueError
        For an unknown scheme, or waves without an impedance.
    """
    p = teleoperator
    if scheme not in SCHEMES:
        raise ValueError(f"scheme: expected one of {', '.join(SCHEMES)}, got {scheme!r}")
    if scheme == "waves":
        as_number(p.coupling_damping, "coupling_damping", 0.0, open_low=True)
    push = as_array(push_n, "push_n", (None,))
    dt = as_number(step_s, "step_s", 0.0, open_low=True)
    wall = as_number(wall_stiffness, "wall_stiffness", 0.0)
    channel = (_Waves if scheme == "waves" else _Springs)(
        p, round(p.delay_s / dt), len(push), dt, scheme == "passivity control"
    )
    x_m = x_s = v_s = energy = 0.0
    v_m = as_number(start_m_s, "start_m_s")
    rows = np.empty((len(push), 5))
    for k, hand in enumerate(push.tolist()):
        f_m, f_s, v_d = channel.forces(k, x_m, v_m, x_s, v_s)
        energy += dt * (f_m * v_m - f_s * v_d)
        rows[k] = x_m, x_s, f_m, f_s, energy
        touch = wall * max(x_s - wall_m, 0.0)
        v_m += dt * (hand - f_m - p.damping * v_m) / p.master_kg
        v_s += dt * (f_s - touch - p.damping * v_s) / p.slave_kg
        x_m += dt * v_m
        x_s += dt * v_s
    return Run(frozen(dt * np.arange(len(push))), *(frozen(row) for row in rows.T))


class _Springs:
    """Each side is pulled to where the other was a delay ago. Guarded, neither takes more energy
    out than the other had put in by then.
    """

    def __init__(self, p: Teleoperator, late: int, count: int, dt: float, guarded: bool) -> None:
        self._p, self._late, self._dt, self._guarded = p, late, dt, guarded
        # a row per step: places and speeds of master and slave, energies put in by either
        self._sent = np.zeros((count + late, 6)).tolist()
        self._in = [0.0, 0.0]
        self._out = [0.0, 0.0]

    def forces(
        self, k: int, x_m: float, v_m: float, x_s: float, v_s: float
    ) -> tuple[float, float, float]:
        p = self._p
        self._sent[k + self._late] = [x_m, v_m, x_s, v_s, *self._in]
        old_m, speed_m, old_s, speed_s, in_m, in_s = self._sent[k]
        f_m = p.stiffness * (x_m - old_s) + p.coupling_damping * (v_m - speed_s)
        f_s = p.stiffness * (old_m - x_s) + p.coupling_damping * (speed_m - v_s)
        if self._guarded:
            f_m = self._guard(0, f_m, v_m, in_s)
            f_s = -self._guard(1, -f_s, v_s, in_m)
        return f_m, f_s, v_s

    def _guard(self, side: int, force: float, speed: float, allowed: float) -> float:
        """The force, weakened so that the energy taken out at a side stays below what is allowed."""
        gained = force * speed * self._dt
        if gained >= 0:
            self._in[side] += gained
            return force
        excess = self._out[side] - gained - allowed
        if excess > 0:
            force += excess / (speed * self._dt)
            gained = force * speed * self._dt
        self._out[side] -= gained
        return force


class _Waves:
    """Either side sends a wave, u or w, and gets the other's a delay later."""

    def __init__(self, p: Teleoperator, late: int, count: int, dt: float, _: bool) -> None:
        self._p, self._late, self._dt = p, late, dt
        self._u = [0.0] * (count + late)
        self._w = [0.0] * (count + late + 1)
        self._stretch = 0.0

    def forces(
        self, k: int, x_m: float, v_m: float, x_s: float, v_s: float
    ) -> tuple[float, float, float]:
        K = self._p.stiffness
        D = self._p.coupling_damping  # of the slave's spring, and the waves' impedance
        root = (2 * D) ** 0.5
        w = self._w[k]
        f_m = D * v_m - root * w
        self._u[k + self._late] = root * v_m - w
        u = self._u[k]
        v_d = (root * u - K * self._stretch + D * v_s) / (2 * D)
        f_s = K * self._stretch + D * (v_d - v_s)
        self._w[k + self._late + 1] = u - (2 / D) ** 0.5 * f_s  # read by the next step at best
        self._stretch += self._dt * (v_d - v_s)
        return f_m, f_s, v_d


def grows(teleoperator: Teleoperator, step_s: float = STEP_S) -> bool:
    """Whether position-position, pushed once and let go, swings more and more, by simulation."""
    p = teleoperator
    omega = np.sqrt(p.stiffness * (1 / p.master_kg + 1 / p.slave_kg))
    count = round(SWINGS * 2 * np.pi / omega / step_s)
    run = simulate(p, "position-position", np.zeros(count), step_s=step_s, start_m_s=1.0)
    speed = np.diff(run.master_m) ** 2 + np.diff(run.slave_m) ** 2
    middle, last = np.array_split(speed, 3)[1:]
    return bool(last.mean() > middle.mean())


def simulated_critical_delay(
    teleoperator: Teleoperator, tolerance: float = 2e-3, step_s: float = STEP_S
) -> float:
    """The same as `critical_delay` by bisection, from nothing but growth or decay; infinite if even
    a second is stable.
    """
    low, high = 0.0, 1.0

    def unstable(delay: float) -> bool:
        parts = {**vars(teleoperator), "delay_s": delay}
        return grows(Teleoperator(**parts), step_s)

    if not unstable(high):
        return float("inf")
    while high - low > tolerance * high:
        middle = (low + high) / 2
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return (low + high) / 2
