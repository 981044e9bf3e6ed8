"""The largest stable stiffness of a computer's wall: by hand, by Nyquist, in simulated time, and by
eigenvalues.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trinolab.slave.wall import (
    Loop,
    delayed_response,
    grows,
    nyquist_limit,
    passive_limit,
    sampled_response,
    simulate,
    simulated_limit,
)

# mass kg, damping N s/m, period s, delay s, wall damping N s/m
HAPTIC = Loop(0.2, 2.0, 1 / 1000)
CAMERA = Loop(0.2, 2.0, 1 / 30, 0.05)
LIGHT = Loop(0.05, 20.0, 1 / 30)  # it stops within a period
CASES = {
    "30 Hz camera, 50 ms": CAMERA,
    "the same, damped wall": replace(CAMERA, wall_damping=1.0),
    "30 Hz camera, heavy": Loop(2.0, 1.0, 1 / 30, 0.05),
    "30 Hz camera, light and damped": replace(LIGHT, delay_s=0.01),
    "60 Hz camera, whole periods": Loop(0.2, 2.0, 1 / 60, 0.05, 0.5),
    "1 kHz haptic loop": HAPTIC,
    "the same, damped wall, part of a period": Loop(0.1, 1.0, 1 / 1000, 0.00025, 0.5),
}


def largest_eigenvalue(loop, stiffness):
    """Modulus of the largest eigenvalue of the closed loop from period to period: another oracle.

    The state is depth, speed, the depth before, and the forces of the last d + 1 periods.
    """
    T, m, b = loop.period_s, loop.mass_kg, loop.damping
    whole, rest = int(loop.delay_s // T), loop.delay_s % T

    def step(h):
        e = np.exp(-b / m * h)
        return np.array([[1, m / b * (1 - e)], [0, e]]), -np.array(
            [(h - m / b * (1 - e)) / b, (1 - e) / b]
        )

    (first, early), (second, late) = step(rest), step(T - rest)
    n = 4 + whole
    force = np.zeros((whole + 2, n))  # rows: f now, f one period ago, ...
    force[0, [0, 2]] = stiffness + loop.wall_damping / T, -loop.wall_damping / T
    force[1:, 3:] = np.eye(whole + 1)
    matrix = np.zeros((n, n))
    matrix[:2, :2] = second @ first
    matrix[:2] += np.outer(second @ early, force[whole + 1]) + np.outer(late, force[whole])
    matrix[2, 0] = 1
    matrix[3:] = force[:-1]
    return np.abs(np.linalg.eigvals(matrix)).max()


@st.composite
def loops(draw, most=10.0, wall=0.0):
    """Loops of 10 Hz to 10 kHz, whose master slows down by itself in 1/most to 1,000 periods; delay
    up to 6 periods.
    """
    T, mass = 10 ** draw(st.floats(-4, -1)), 10 ** draw(st.floats(-2, 1))
    damping = mass / T * 10 ** draw(st.floats(-3, np.log10(most)))
    delay = T * draw(st.one_of(st.just(0.0), st.floats(0, 6)))
    return Loop(mass, damping, T, delay, wall and damping * draw(st.floats(0, wall)))


@pytest.mark.parametrize("name", CASES)
def test_nyquist_and_simulation_agree(name):
    loop = CASES[name]
    simulated = simulated_limit(loop)
    # required: 5 %; the worst is 0.1 %
    assert simulated == pytest.approx(nyquist_limit(loop).stiffness, rel=2e-3)
    if loop.damping * loop.period_s < loop.mass_kg:  # the hold is like a delay; the worst is 3 %
        assert simulated == pytest.approx(nyquist_limit(loop, sampled=False).stiffness, rel=0.05)


@given(loops(wall=3.0))
@settings(max_examples=30, deadline=None)
def test_any_loop_is_stable_up_to_its_limit_and_not_above(loop):
    limit = nyquist_limit(loop).stiffness
    if limit == 0:  # the wall's damping alone is too much
        assert largest_eigenvalue(loop, 1e-6 * loop.damping / loop.lag_s) > 1
        return
    for share in (0.01, 0.3, 0.7, 0.999):
        assert largest_eigenvalue(loop, share * limit) < 1
    assert largest_eigenvalue(loop, 1.001 * limit) > 1


@given(loops(most=1e4), st.floats(1.01, 5))
@settings(max_examples=20, deadline=None)
def test_more_delay_never_allows_more_stiffness(loop, factor):
    """Nor less than the damping over the lag, with the hold as a delay."""
    more = replace(loop, delay_s=factor * loop.delay_s + 0.1 * loop.period_s)
    limit = nyquist_limit(loop, sampled=False).stiffness
    assert loop.damping / loop.lag_s * (1 - 1e-9) <= limit
    assert nyquist_limit(more, sampled=False).stiffness < limit


def test_a_little_delay_can_help_a_master_that_stops_within_a_period():
    later = replace(LIGHT, delay_s=0.01)
    assert nyquist_limit(later).stiffness > 1.1 * nyquist_limit(LIGHT).stiffness
    assert simulated_limit(later) > 1.1 * simulated_limit(LIGHT)


@pytest.mark.parametrize(
    ("loop", "sampled", "stiffness", "rel"),
    [
        # omega lag = pi/4 and omega = b/m: the lag turns by 45 deg, the master by 135, so that
        # K = omega |b + j m omega|
        (Loop(2.0, 6.0, 0.0, np.pi / 12), False, 18 * np.sqrt(2), 1e-9),
        # b / lag for a master that only has mass, pi/2 of that for one that has none
        (Loop(1e5, 1.0, 0.0, 0.1), False, 10.0, 1e-4),
        (Loop(1e-5, 1.0, 0.0, 0.1), False, 5 * np.pi, 1e-3),
        # 2 b / T if held and not delayed
        (Loop(1e-5, 1.0, 0.1), True, 20.0, 1e-3),
        (Loop(1e3, 1.0, 0.1), True, 20.0, 1e-3),
        # a period of delay, no mass: z^2 - z + K T / b = 0 has roots on the unit circle at K T / b = 1
        (Loop(1e-6, 3.0, 0.1, 0.1), True, 30.0, 1e-4),
        # neither delay nor hold
        (Loop(0.2, 2.0, 0.0, wall_damping=3.0), False, np.inf, 0.0),
        # too much damping in the wall
        (replace(CAMERA, wall_damping=8.0), True, 0.0, 0.0),
        (replace(CAMERA, wall_damping=8.0), False, 0.0, 0.0),
    ],
)
def test_limits_by_hand(loop, sampled, stiffness, rel):
    found = nyquist_limit(loop, sampled)
    assert found.stiffness == pytest.approx(stiffness, rel=rel)
    assert rel != 1e-9 or found.omega == pytest.approx(3.0, rel=1e-9)
    assert stiffness > 0 or simulated_limit(loop) == 0


def test_passive_bound_by_hand():
    for wall_damping, stiffness in ((0.0, 4000.0), (0.5, 3000.0), (2.5, 0.0)):
        loop = replace(HAPTIC, wall_damping=wall_damping)
        assert passive_limit(loop) == pytest.approx(stiffness)
        assert passive_limit(loop) <= nyquist_limit(loop).stiffness * (1 + 1e-9)
    assert passive_limit(replace(HAPTIC, period_s=0.0)) == np.inf


def test_simulation_agrees_with_a_fine_integration():
    """Steps of 10 us with the forces as they come, for a two-sided and a one-sided wall."""
    loop, stiffness, h = Loop(0.3, 1.5, 0.02, 0.013, 12.0), 200.0, 1e-5
    for one_sided in (True, False):
        x = v = last = now = force = 0.0
        queue, depths, forces = [], [], []
        for k in range(50_000):
            if k % 2000 == 0:
                now = stiffness * x + loop.wall_damping * (x - last) / loop.period_s
                queue.append((k + 1300, max(now, 0.0) * (x > 0) if one_sided else now))
                last = x
            if queue and queue[0][0] == k:
                force = queue.pop(0)[1]
            if k % 250 == 0:
                depths.append(x)
                forces.append(force)
            middle = v + h / 2 * (1.0 - force - loop.damping * v) / loop.mass_kg
            x, v = x + h * middle, v + h * (1.0 - force - loop.damping * middle) / loop.mass_kg
        contact = simulate(loop, stiffness, 0.5, one_sided=one_sided)
        np.testing.assert_allclose(contact.t_s, 0.0025 * np.arange(200), atol=1e-12)
        np.testing.assert_allclose(contact.depth_m, depths, atol=1e-8)  # m
        # of an instant at which the force changes either is right
        same = np.abs(contact.force_n - forces) < 1e-5
        assert same.mean() > 0.99


def test_a_one_sided_wall_never_pulls_and_bounces_above_the_limit():
    limit = nyquist_limit(CAMERA).stiffness
    soft, hard = simulate(CAMERA, 0.7 * limit, 30.0), simulate(CAMERA, 2 * limit, 30.0)
    assert min(soft.force_n.min(), hard.force_n.min()) == 0.0
    assert soft.depth_m[-500:] == pytest.approx(1 / (0.7 * limit), abs=1e-6)  # m: 1 N by K
    assert hard.depth_m[-500:].min() < 0 < hard.depth_m[-500:].max()
    assert simulate(CAMERA, 1.0, 0.0).t_s.shape == (0,)
    shares = [0.0, 0.01, 0.5, 0.99, 1.01, 2.0, 1e3]
    assert [grows(CAMERA, share * limit) for share in shares] == [False] * 4 + [True] * 3


def test_refuses_a_loop():
    for name, value in (
        ("mass_kg", 0.0),
        ("damping", 0.0),
        ("period_s", -0.1),
        ("delay_s", -0.01),
        ("delay_s", 101.0),
        ("wall_damping", -1.0),
    ):
        with pytest.raises(ValueError, match=f"^{name}: expected a number"):
            replace(Loop(0.2, 2.0, 0.1), **{name: value})


def test_refuses():
    unheld = replace(HAPTIC, period_s=0.0)
    for name, call, arguments in (
        ("period_s", nyquist_limit, (unheld,)),
        ("period_s", simulated_limit, (unheld,)),
        ("period_s", simulate, (unheld, 1.0, 1.0)),
        ("delay_s", passive_limit, (CAMERA,)),
        ("tolerance", simulated_limit, (CAMERA, 0.0)),
        ("stiffness", simulate, (CAMERA, -1.0, 1.0)),
        ("stiffness", grows, (CAMERA, np.inf)),
        ("duration_s", simulate, (CAMERA, 1.0, -1.0)),
        ("push_n", simulate, (CAMERA, 1.0, 1.0, np.nan)),
        ("omega", delayed_response, (CAMERA, [[1.0]])),
        ("omega", sampled_response, (CAMERA, [np.nan])),
    ):
        with pytest.raises(ValueError, match=f"^{name}: expected"):
            call(*arguments)
