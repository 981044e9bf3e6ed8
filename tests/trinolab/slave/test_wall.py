"""The largest stable stiffness of a computer's wall: by hand, by Nyquist, in simulated time, and by
eigenvalues.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
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
from workbench.plotting.slave import plot_session
from workbench.plotting.wall import plot_limits, plot_nyquist

# mass kg, damping N s/m, rate Hz, delay s, wall damping N s/m; whether the hold may be taken as a
# delay
CASES = {
    "30 Hz camera, 50 ms": (0.2, 2.0, 30, 0.05, 0.0, True),
    "30 Hz camera, 50 ms, damped wall": (0.2, 2.0, 30, 0.05, 1.0, True),
    "30 Hz camera, 100 ms": (0.2, 2.0, 30, 0.1, 0.0, True),
    "30 Hz camera, no delay": (0.2, 2.0, 30, 0.0, 0.0, True),
    "30 Hz camera, heavy": (2.0, 1.0, 30, 0.05, 0.0, True),
    "30 Hz camera, light and damped": (0.05, 20.0, 30, 0.01, 0.0, False),
    "30 Hz camera, light and damped, no delay": (0.05, 20.0, 30, 0.0, 0.0, False),
    "60 Hz camera, whole periods": (0.2, 2.0, 60, 0.05, 0.5, True),
    "120 Hz camera, 20 ms": (0.1, 1.0, 120, 0.02, 0.0, True),
    "1 kHz haptic loop": (0.2, 2.0, 1000, 0.0, 0.0, True),
    "1 kHz haptic loop, damped wall": (0.1, 1.0, 1000, 0.00025, 0.5, True),
    "1 kHz haptic loop, 50 ms": (0.2, 2.0, 1000, 0.05, 0.0, True),
    "1 kHz haptic loop, little damping": (0.1, 0.05, 1000, 0.001, 0.0, True),
}


def loop_of(case):
    mass, damping, rate, delay, wall_damping, _ = case
    return Loop(mass, damping, 1 / rate, delay, wall_damping)


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


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_nyquist_and_simulation_agree(case):
    loop = loop_of(case)
    simulated = simulated_limit(loop)
    # required: 5 %; the worst is 0.1 %
    assert simulated == pytest.approx(nyquist_limit(loop).stiffness, rel=2e-3)
    if case[-1]:
        # the worst is 3 %
        assert simulated == pytest.approx(nyquist_limit(loop, sampled=False).stiffness, rel=0.05)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_eigenvalues_leave_the_unit_circle_at_the_limit(case):
    loop = loop_of(case)
    limit = nyquist_limit(loop).stiffness
    assert largest_eigenvalue(loop, 0.999 * limit) < 1 < largest_eigenvalue(loop, 1.001 * limit)


@given(loops(wall=3.0))
@settings(max_examples=60, deadline=None)
def test_any_loop_is_stable_up_to_its_limit_and_not_above(loop):
    limit = nyquist_limit(loop).stiffness
    if limit == 0:  # the wall's damping alone is too much
        assert largest_eigenvalue(loop, 1e-6 * loop.damping / loop.lag_s) > 1
        return
    for share in (0.01, 0.3, 0.7, 0.99):
        assert largest_eigenvalue(loop, share * limit) < 1
    assert largest_eigenvalue(loop, 1.01 * limit) > 1


@given(loops())
@settings(max_examples=15, deadline=None)
def test_any_simulation_agrees(loop):
    assert simulated_limit(loop) == pytest.approx(nyquist_limit(loop).stiffness, rel=0.05)


def test_without_delay_and_hold_every_stiffness_is_stable():
    assert nyquist_limit(Loop(0.2, 2.0, 0.0), sampled=False).stiffness == np.inf
    assert nyquist_limit(Loop(0.2, 2.0, 0.0, wall_damping=3.0), sampled=False).stiffness == np.inf
    assert passive_limit(Loop(0.2, 2.0, 0.0)) == np.inf


def test_limit_by_hand():
    """omega lag = pi/4 and omega = b/m: the lag turns by 45 deg, the master by 135, so K = omega |b
    + j m omega|.
    """
    found = nyquist_limit(Loop(2.0, 6.0, 0.0, np.pi / 12), sampled=False)
    assert found.omega == pytest.approx(3.0, rel=1e-9)
    assert found.stiffness == pytest.approx(3 * 6 * np.sqrt(2), rel=1e-9)


def test_limits_of_light_and_heavy_masters():
    """b / lag for a master that only has mass, pi/2 of that for one that has none; 2 b / T if held
    and not delayed.
    """
    assert nyquist_limit(Loop(1e5, 1.0, 0.0, 0.1), sampled=False).stiffness == pytest.approx(
        10.0, rel=1e-4
    )
    assert nyquist_limit(Loop(1e-5, 1.0, 0.0, 0.1), sampled=False).stiffness == pytest.approx(
        5 * np.pi, rel=1e-3
    )
    for mass in (1e-5, 1e3):
        assert nyquist_limit(Loop(mass, 1.0, 0.1)).stiffness == pytest.approx(20.0, rel=1e-3)


def test_massless_master_with_one_period_of_delay_by_hand():
    """x moves by T f / b a period: z^2 - z + K T / b = 0 has its roots on the unit circle at K T /
    b = 1.
    """
    assert nyquist_limit(Loop(1e-6, 3.0, 0.1, 0.1)).stiffness == pytest.approx(30.0, rel=1e-4)
    assert simulated_limit(Loop(1e-6, 3.0, 0.1, 0.1)) == pytest.approx(30.0, rel=2e-3)


@pytest.mark.parametrize("late", [0.0, 0.1, 0.2, 0.25, 0.3, 0.6, 0.9])
def test_massless_master_with_part_of_a_period_of_delay_by_hand(late):
    """z^2 - (1 - k (1 - late)) z + k late = 0 with k = K T / b leaves at z = -1, or as a pair."""
    expected = min(2 / (1 - 2 * late) if late < 0.5 else np.inf, 1 / late if late else np.inf)
    loop = Loop(1e-6, 3.0, 0.1, 0.1 * late)
    assert nyquist_limit(loop).stiffness == pytest.approx(30 * expected, rel=1e-3)
    assert simulated_limit(loop) == pytest.approx(30 * expected, rel=0.01)  # 0.25 is a double root


def test_responses_of_slow_oscillations_agree():
    loop = Loop(0.2, 2.0, 0.001, 0.0123)
    omega = [0.1, 1.0, 10.0, 30.0]
    np.testing.assert_allclose(
        sampled_response(loop, omega), delayed_response(loop, omega), rtol=2e-4
    )


def test_sampled_response_by_hand():
    """Without damping to speak of and without delay G = T^2 (z + 1) / (2 m (z - 1)^2)."""
    z = np.exp(1j * np.array([0.5, 2.0]))
    found = sampled_response(Loop(0.5, 1e-9, 0.1), [5.0, 20.0])
    np.testing.assert_allclose(found, 0.01 * (z + 1) / (z - 1) ** 2, rtol=1e-7)


def test_too_much_damping_in_the_wall_is_unstable():
    loop = Loop(0.2, 2.0, 1 / 30, 0.05, 8.0)
    assert (
        nyquist_limit(loop).stiffness
        == nyquist_limit(loop, sampled=False).stiffness
        == simulated_limit(loop)
        == 0
    )


def test_passive_bound_by_hand():
    assert passive_limit(Loop(0.2, 2.0, 0.001)) == pytest.approx(4000.0)
    assert passive_limit(Loop(0.2, 2.0, 0.001, wall_damping=0.5)) == pytest.approx(3000.0)
    assert passive_limit(Loop(0.2, 2.0, 0.001, wall_damping=2.5)) == 0.0


@given(loops(wall=1.0))
def test_a_passive_wall_is_stable(loop):
    prompt = replace(loop, delay_s=0.0)
    assert passive_limit(prompt) <= nyquist_limit(prompt).stiffness * (1 + 1e-9)


@given(loops(most=1e4), st.floats(1.01, 5))
@settings(deadline=None)
def test_more_delay_never_allows_more_stiffness(loop, factor):
    """With the hold as a delay; as it is, only where the master does not stop by itself within a
    period.
    """
    more = replace(loop, delay_s=factor * loop.delay_s + 0.1 * loop.period_s)
    assert (
        nyquist_limit(more, sampled=False).stiffness < nyquist_limit(loop, sampled=False).stiffness
    )
    if loop.damping * loop.period_s < loop.mass_kg:
        assert nyquist_limit(more).stiffness < nyquist_limit(loop).stiffness


def test_a_little_delay_can_help_a_master_that_stops_within_a_period():
    loop = loop_of(CASES["30 Hz camera, light and damped, no delay"])
    later = replace(loop, delay_s=0.01)
    assert nyquist_limit(later).stiffness > 1.1 * nyquist_limit(loop).stiffness
    assert simulated_limit(later) > 1.1 * simulated_limit(loop)


@pytest.mark.heavy
@given(loops(), st.floats(1.01, 10))
@settings(deadline=None)
def test_more_damping_or_a_quicker_loop_never_allows_less(loop, factor):
    for sampled in (True, False):
        limit = nyquist_limit(loop, sampled).stiffness * (1 - 1e-9)
        assert (
            nyquist_limit(replace(loop, damping=factor * loop.damping), sampled).stiffness >= limit
        )
        quicker = replace(loop, period_s=loop.period_s / factor)
        assert nyquist_limit(quicker, sampled).stiffness >= limit


@given(loops())
@settings(deadline=None)
def test_a_wall_below_damping_over_lag_is_stable(loop):
    for sampled in (True, False):
        assert nyquist_limit(loop, sampled).stiffness >= loop.damping / loop.lag_s * (1 - 1e-9)


@given(loops(), st.floats(0.1, 10), st.floats(0.1, 10))
@settings(max_examples=30, deadline=None)
def test_units_do_not_matter(loop, force, time):
    """With other units of force and time the same loop has the same limit."""
    other = Loop(
        force * loop.mass_kg * time**2,
        force * loop.damping * time,
        loop.period_s * time,
        loop.delay_s * time,
    )
    for sampled in (True, False):
        assert nyquist_limit(other, sampled).stiffness == pytest.approx(
            force * nyquist_limit(loop, sampled).stiffness
        )


def test_a_hand_comes_to_rest_in_a_soft_wall():
    contact = simulate(Loop(0.2, 2.0, 1 / 30, 0.05, 0.5), 20.0, 15.0, push_n=2.0)
    assert contact.t_s.shape == contact.depth_m.shape == contact.force_n.shape == (8 * 450,)
    assert contact.depth_m[-1] == pytest.approx(0.1, abs=1e-6)  # m: 2 N / (20 N/m)
    assert contact.force_n[-1] == pytest.approx(2.0, abs=1e-5)


def test_the_first_periods_by_hand():
    """No force for a period and a half of delay, then that of the first depth below the surface."""
    loop = Loop(0.5, 1.0, 0.1, 0.15)
    contact = simulate(loop, 10.0, 0.5, push_n=1.0)
    depth = contact.t_s - 0.5 * (1 - np.exp(-2 * contact.t_s))  # m, of a free master
    free = contact.t_s <= 0.25 + 1e-9
    np.testing.assert_allclose(contact.depth_m[free], depth[free], atol=1e-12)
    assert (contact.force_n[contact.t_s < 0.25 - 1e-9] == 0).all()
    assert contact.force_n[np.searchsorted(contact.t_s, 0.3)] == pytest.approx(10 * depth[8])


def test_simulation_agrees_with_a_fine_integration():
    """Steps of 10 us with the forces as they come, for a two-sided and a one-sided wall."""
    loop, stiffness, h = Loop(0.3, 1.5, 0.02, 0.013, 12.0), 200.0, 1e-5
    for one_sided in (True, False):
        x = v = last = now = force = 0.0
        queue, depths = [], []
        for k in range(50_000):
            if k % 2000 == 0:
                now = stiffness * x + loop.wall_damping * (x - last) / loop.period_s
                queue.append((k + 1300, max(now, 0.0) * (x > 0) if one_sided else now))
                last = x
            if queue and queue[0][0] == k:
                force = queue.pop(0)[1]
            if k % 250 == 0:
                depths.append(x)
            middle = v + h / 2 * (1.0 - force - loop.damping * v) / loop.mass_kg
            x, v = x + h * middle, v + h * (1.0 - force - loop.damping * middle) / loop.mass_kg
        contact = simulate(loop, stiffness, 0.5, one_sided=one_sided)
        np.testing.assert_allclose(contact.depth_m, depths, atol=1e-8)  # m


def test_a_one_sided_wall_never_pulls_and_bounces_above_the_limit():
    loop = Loop(0.2, 2.0, 1 / 30, 0.05)
    limit = nyquist_limit(loop).stiffness
    soft, hard = simulate(loop, 0.7 * limit, 30.0), simulate(loop, 2 * limit, 30.0)
    assert min(soft.force_n.min(), hard.force_n.min()) == 0.0
    assert np.ptp(soft.depth_m[-500:]) < 1e-6  # m
    assert hard.depth_m[-500:].min() < 0 < hard.depth_m[-500:].max()


def test_growth_is_told_from_decay():
    loop = Loop(0.2, 2.0, 1 / 30, 0.05)
    limit = nyquist_limit(loop).stiffness
    assert [grows(loop, share * limit) for share in (0.0, 0.01, 0.5, 0.99, 1.01, 2.0, 1e3)] == [
        False
    ] * 4 + [True] * 3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass_kg", 0.0),
        ("mass_kg", np.nan),
        ("damping", 0.0),
        ("damping", "2"),
        ("period_s", -0.1),
        ("delay_s", -0.01),
        ("delay_s", 101.0),
        ("delay_s", np.inf),
        ("wall_damping", -1.0),
        ("wall_damping", None),
    ],
)
def test_refuses_a_loop(name, value):
    good = {"mass_kg": 0.2, "damping": 2.0, "period_s": 0.1, "delay_s": 0.05, "wall_damping": 0.0}
    with pytest.raises(ValueError, match=f"^{name}: expected a number") as caught:
        Loop(**{**good, name: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("period_s", lambda loop: nyquist_limit(replace(loop, period_s=0.0))),
        ("period_s", lambda loop: sampled_response(replace(loop, period_s=0.0), [1.0])),
        ("period_s", lambda loop: simulated_limit(replace(loop, period_s=0.0))),
        ("period_s", lambda loop: simulate(replace(loop, period_s=0.0), 1.0, 1.0)),
        ("period_s", lambda loop: grows(replace(loop, period_s=0.0), 1.0)),
        ("delay_s", passive_limit),
        ("tolerance", lambda loop: simulated_limit(loop, 0.0)),
        ("stiffness", lambda loop: simulate(loop, -1.0, 1.0)),
        ("stiffness", lambda loop: grows(loop, np.inf)),
        ("duration_s", lambda loop: simulate(loop, 1.0, -1.0)),
        ("push_n", lambda loop: simulate(loop, 1.0, 1.0, push_n=np.nan)),
        ("omega", lambda loop: delayed_response(loop, [[1.0]])),
        ("omega", lambda loop: sampled_response(loop, [np.nan])),
    ],
)
def test_refuses(name, call):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        call(Loop(0.2, 2.0, 0.1, 0.05))


def test_no_simulated_time_gives_an_empty_contact():
    assert simulate(Loop(0.2, 2.0, 0.1), 1.0, 0.0).t_s.shape == (0,)


def test_figures_show_their_curves_with_units():
    omega = np.geomspace(1, 90, 50)
    loop = Loop(0.2, 2.0, 1 / 30, 0.05)
    figure = plot_nyquist({"a": (sampled_response(loop, omega), delayed_response(loop, omega))})
    lines = figure.axes[0].get_lines()
    np.testing.assert_allclose(lines[1].get_ydata(), sampled_response(loop, omega).imag)
    assert [line.get_linestyle() for line in lines[1:3]] == ["-", "--"]
    contact = simulate(loop, 20.0, 1.0)
    figure = plot_session(contact.t_s, {"depth / m": {"": contact.depth_m}})
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("$t$ / s", "depth / m")
    figure = plot_limits([0.0, 0.1], {"30 Hz": [100.0, 10.0]}, {"simulated": [np.nan, 10.0]})
    np.testing.assert_allclose(figure.axes[0].get_lines()[0].get_xdata(), [0.0, 100.0])
    assert figure.get_facecolor() == (1.0, 1.0, 1.0, 1.0)
    plt.close("all")
