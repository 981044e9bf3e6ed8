"""The bilateral channel: two-port, critical delay, waves and passivity controller, against numbers
by hand and against each other.
"""

from dataclasses import replace

import numpy as np
import pytest

from trinolab.slave import bilateral
from trinolab.slave.bilateral import (
    SCHEMES,
    Teleoperator,
    critical_delay,
    felt_impedance,
    hybrid_matrix,
    simulate,
    simulated_critical_delay,
)

PAIR = Teleoperator(0.2, 0.2, 2.0, 200.0, 2.0)
UNEQUAL = Teleoperator(0.2, 1.0, 2.0, 200.0, 4.0, 0.02)
LATE = replace(PAIR, delay_s=0.05)
PUSH = np.where(np.arange(20_000) * bilateral.STEP_S < 1.0, 1.0, 0.0)  # N, for a second


def test_the_critical_delay_by_hand():
    """m = b = K = 1, D = 0: at omega = 1 Z + C = 1 and C = -j, so L = -1, and 2 T = pi."""
    assert critical_delay(Teleoperator(1, 1, 1, 1, 0)) == pytest.approx(np.pi / 2, rel=1e-9)


def test_equal_sides_cross_where_the_formula_says():
    """omega^2 = (2 m K - b^2 - 2 b D) / m^2, and none where that is negative."""
    omega = np.sqrt((2 * 0.2 * 200 - 2**2 - 2 * 2 * 2) / 0.2**2)
    s = 1j * omega
    coupling = 2 + 200 / s
    ratio = coupling / (0.2 * s + 2 + coupling)
    assert abs(ratio) == pytest.approx(1, rel=1e-12)
    # either sign of the root: the smaller delay
    assert critical_delay(PAIR) == pytest.approx(np.angle(ratio) % np.pi / omega, rel=1e-9)
    assert critical_delay(replace(PAIR, stiffness=10.0)) == np.inf


@pytest.mark.slow
def test_simulation_and_theory_agree():
    # bisection 0.2 %; steps of 0.2 ms
    assert simulated_critical_delay(UNEQUAL) == pytest.approx(critical_delay(UNEQUAL), rel=0.01)


def test_the_two_port_solves_the_equations_of_motion():
    """Against the four equations, solved together."""
    p, omega = UNEQUAL, np.array([3.0, 40.0])
    for w, H in zip(omega, hybrid_matrix(p, omega), strict=True):
        s = 1j * w
        C, late = p.coupling_damping + p.stiffness / s, np.exp(-s * p.delay_s)
        Z_m, Z_s = p.master_kg * s + p.damping, p.slave_kg * s + p.damping
        V_m, F_e = 0.3 + 0.1j, -0.2 + 0.7j
        V_s = (C * late * V_m - F_e) / (Z_s + C)
        F_h = Z_m * V_m + C * (V_m - late * V_s)
        np.testing.assert_allclose(H @ [V_m, F_e], [F_h, -V_s], rtol=1e-12)


def test_a_hand_feels_springs_in_series():
    """At rest, what is touched and the coupling: 200 and 300 N/m make 120 N/m."""
    omega = np.array([1e-3])
    Z = felt_impedance(hybrid_matrix(PAIR, omega), 300 / (1j * omega))
    assert (1j * omega * Z).real[0] == pytest.approx(120, rel=1e-4)


@pytest.mark.parametrize("scheme", SCHEMES[:2])
def test_a_push_against_a_wall_without_a_delay_ends_at_the_springs(scheme):
    """The passivity controller weakens forces, and may leave the two sides unequal."""
    push = np.full(30_000, 2.0)
    found = simulate(PAIR, scheme, push, wall_m=0.05, wall_stiffness=400.0)
    assert found.slave_m[-1] == pytest.approx(0.05 + 2 / 400, abs=2e-5)
    # a wave comes back one step later at best, which adds a hundredth
    assert found.master_m[-1] - found.slave_m[-1] == pytest.approx(2 / 200, rel=0.015)


def test_late_springs_grow_and_the_others_come_to_rest():
    wild = simulate(LATE, "position-position", PUSH, 0.05, 1000.0)
    assert np.abs(wild.master_m).max() > 10
    assert wild.energy_j.min() < -1  # it gives more than it got
    for scheme in SCHEMES[1:]:
        found = simulate(LATE, scheme, PUSH, 0.05, 1000.0)
        assert np.abs(found.master_m).max() < 0.2, scheme
        assert np.ptp(found.master_m[-2000:]) < 1e-4, scheme
        assert found.energy_j.min() > -1e-9, scheme  # rounding


def test_waves_make_a_hand_heavier_by_their_impedance_times_the_delay():
    """m_master + m_slave + D T, from the mean acceleration under a steady push."""
    free = replace(LATE, damping=1e-9)
    found = simulate(free, "waves", np.ones(50_000))
    speed = np.diff(found.master_m) / bilateral.STEP_S
    gained = (speed[-1] - speed[25_000]) / (bilateral.STEP_S * (len(speed) - 25_001))
    assert 1 / gained == pytest.approx(0.4 + 2 * 0.05, rel=0.01)


@pytest.mark.parametrize(
    ("call", "arguments", "named"),
    [
        (simulate, (PAIR, "telepathy", PUSH), "scheme: expected one of position-position"),
        (simulate, (replace(PAIR, coupling_damping=0.0), "waves", PUSH), "coupling_damping"),
        (Teleoperator, (0.0, 1, 1, 1, 0), "master_kg"),
        (Teleoperator, (1, 1, 1, 1, 0, -1.0), "delay_s"),
    ],
)
def test_a_wrong_argument_is_named(call, arguments, named):
    with pytest.raises(ValueError, match=named):
        call(*arguments)
