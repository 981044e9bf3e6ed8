"""The pointing task, its log, the models of an operator, and the shipped table."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.slave import control, mapping
from trinolab.slave.mapping import MappingParameters, Sample, State
from workbench.studies.fitts import DELAYS_S, fit, lag_models
from workbench.sweep.notebook import run_notebook
from workbench.teleop import operators
from workbench.teleop.operators import Machine, Person, machine_lag_s, point
from workbench.teleop.pointing import (
    COLUMNS,
    conditions,
    difficulty,
    performance,
    read_log,
    write_log,
)

PAGE = Path(__file__).resolve().parents[3] / "book" / "operator.ipynb"
SURE = Person(observation_noise=0.0, motor_noise=0.0, acuity_mm=0.0, miss=0.0)


def log_of(**columns):
    """A log with these columns; the others have usual values."""
    usual = dict.fromkeys(COLUMNS, 0.0) | {"operator": "someone", "moves": 1, "scale": 1.0}
    usual |= {"distance_mm": 100.0, "width_mm": 10.0, "end_s": 1.0}
    return pd.DataFrame({**usual, **columns}, columns=list(COLUMNS))


# The task


def test_throughput_by_hand():
    """Ends at -2, 0 and 2 mm: a standard deviation of 2, an effective width of 8.266 mm. One end has
    none; over several conditions it is the mean.
    """
    np.testing.assert_allclose(difficulty(np.array([10.0, 70.0, 150.0]), 10.0), [1.0, 3.0, 4.0])
    assert math.isnan(performance(log_of(error_mm=[1.0])).throughput_bit_s)
    log = log_of(error_mm=[-2.0, 0.0, 2.0], end_s=[1.0, 2.0, 3.0])
    found = performance(log)
    assert found.throughput_bit_s == pytest.approx(math.log2(100 / 8.266 + 1) / 2.0)
    assert (found.movement_s, found.error_share, found.n) == (2.0, 0.0, 3)

    near = log_of(error_mm=[-2.0, 0.0, 2.0])
    far = log_of(error_mm=[-9.0, 0.0, 9.0], distance_mm=300.0)
    both = performance(pd.concat([near, far]))
    alone = [performance(one).throughput_bit_s for one in (near, far)]
    assert both.throughput_bit_s == pytest.approx(np.mean(alone))
    assert both.error_share == pytest.approx(2 / 6)


def test_a_log_comes_back_from_its_file(tmp_path):
    log, same = (
        point(conditions(repeats=1), "move-and-wait", 2.0, 0.1, np.random.default_rng(0))
        for _ in range(2)
    )
    pd.testing.assert_frame_equal(log, same)
    write_log(log, tmp_path / "log.csv")
    again = read_log(tmp_path / "log.csv")
    pd.testing.assert_frame_equal(again, log, check_dtype=False, atol=1e-6)  # six decimals
    assert tuple(again.columns) == COLUMNS


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"error_mm": "far"}, "error_mm: expected finite numbers"),
        ({"width_mm": 0.0}, "width_mm: expected numbers above 0"),
        ({"end_s": -1.0}, "end_s: expected no time before start_s"),
        ({"delay_s": np.nan}, "delay_s: expected finite numbers"),
    ],
)
def test_a_wrong_log_is_refused_with_its_name(change, what, tmp_path):
    path = tmp_path / "log.csv"
    log_of(task=[0, 1]).assign(**change).to_csv(path, index=False)
    with pytest.raises(ValueError, match=f"log.csv: {what}"):
        read_log(path)
    log_of(task=[0]).drop(columns="moves").to_csv(path, index=False)
    with pytest.raises(ValueError, match="column 'moves' is missing"):
        read_log(path)


# The machine


def test_the_machine_is_that_of_a_session():
    """Beside `mapping.step` and `control.step` on the same hand, in three dimensions."""
    dt, scale = operators.TICK_S, 2.5
    p = MappingParameters(scale=scale)
    machine = Machine(1, p)
    at = RigidTransform.from_translation([300.0, 0.0, 300.0])
    state, reference = State(-1e-9, at), control.at_rest(at)
    worst = 0.0
    for k in range(120):
        if k % operators.FRAME_TICKS == 0:
            hand = 60 * np.sin(2 * k * dt) ** 2
            T = RigidTransform.from_translation([hand, 0.0, 0.0])
            # the session starts its filter with the first pose, this one with rest
            state = mapping.step(state, Sample(k * dt, T, "measured", True), p)
            if k:
                machine.see(np.array([hand]), operators.FRAME_TICKS * dt)
        reference = control.step(reference, state.target, dt)
        machine.move(dt)
        worst = max(worst, abs(reference.pose.translation[0] - 300.0 - machine.tool[0]))
    assert machine.tool[0] > 50  # it has moved
    assert worst < 1e-6  # mm; measured 1e-13


# The operators


def delayed_integrator(delay_s, gain, t_s):
    """Solution of x'(t) = -gain x(t - delay) with x = 1 until 0, by the method of steps: a finite
    sum of powers.
    """
    terms = range(int(t_s / delay_s) + 2)
    ages = [max(t_s - (k - 1) * delay_s, 0.0) if k else 1.0 for k in terms]
    return sum((-gain * age) ** k / math.factorial(k) for k, age in zip(terms, ages, strict=True))


def test_the_continuous_operator_is_a_delayed_integrator():
    """Without noise: the movement times are those of the crossover model, solved exactly with the
    lags of limb, filter and arm as one more delay.
    """
    trials = np.array([[80.0, 10.0], [160.0, 10.0], [160.0, 5.0]])
    for delay_s in (0.0, 0.3):
        log = point(trials, "continuous", 1.0, delay_s, np.random.default_rng(0), SURE, 0.0)
        own_s = SURE.delay_s + SURE.neuromuscular_s
        loop_s = own_s + delay_s + machine_lag_s(MappingParameters(), control.ReferenceParameters())
        begin_s = loop_s - delay_s  # the target is seen at once, the tool late
        for (distance, width), end_s in zip(trials, log["end_s"], strict=True):
            times = np.arange(0.0, 8.0, 0.01)
            left = [delayed_integrator(loop_s, SURE.crossover / loop_s, t) for t in times]
            inside = begin_s + times[np.argmax(np.array(left) <= width / 2 / distance)]
            # 4 % at worst: a lag is no delay, and the filter is slower at the end
            assert end_s == pytest.approx(inside + delay_s + SURE.delay_s, rel=0.06)
        assert (log["error_mm"] <= 0).all()  # no overshoot


def test_each_wait_costs_the_delay_once():
    """Ferrell 1965: a delay is added once for each move, and nothing else changes."""
    trials = conditions(repeats=3)
    logs = [
        point(trials, "move-and-wait", 1.0, delay, np.random.default_rng(3), pose_noise_mm=0.0)
        for delay in (0.0, 0.5)
    ]
    before, after = logs
    np.testing.assert_array_equal(after["moves"], before["moves"])
    assert before["moves"].max() > 1
    assert (before.groupby(["distance_mm", "width_mm"]).size() == 3).all()
    longer = after["end_s"] - before["end_s"]
    np.testing.assert_allclose(longer, 0.5 * before["moves"], atol=1e-9)


def test_mistakes_are_named():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="strategy: expected one of continuous, move-and-wait"):
        point(conditions(repeats=1), "hasty", 1.0, 0.0, rng)
    with pytest.raises(ValueError, match="delay_s"):
        point(conditions(repeats=1), "continuous", 1.0, -0.1, rng)
    with pytest.raises(ValueError, match="move_s"):
        Person(move_s=0.0)


# The study


@pytest.mark.parametrize(("product_form", "other"), [(True, False), (False, True)])
def test_the_models_of_lag_find_what_they_are_given(product_form, other):
    """Movement times made by one of the two models: it explains all, the other one less."""
    pairs = [(d, w, lag) for d in (40, 80, 160) for w in (5, 10, 20) for lag in DELAYS_S]
    means = pd.DataFrame(pairs, columns=["distance_mm", "width_mm", "delay_s"])
    bits = difficulty(means["distance_mm"].to_numpy(), means["width_mm"].to_numpy())
    factor = bits if product_form else 1.0
    means["time"] = 0.2 + 0.1 * bits + 1.5 * means["delay_s"] * factor
    found, r2 = fit(means, product_form)
    np.testing.assert_allclose(found, [0.2, 0.1, 1.5], atol=1e-9)
    assert r2 == pytest.approx(1.0)
    assert fit(means, other)[1] < 0.999


def test_more_delay_takes_longer_and_the_interval_says_so():
    found = lag_models("continuous", seeds=3, repeats=3)
    assert found.c.low < found.c_bit < found.c.high
    assert found.c.low > 0


@pytest.mark.heavy
def test_the_page_runs_with_other_parameters():
    changed = {"scale": 2.0, "delay_s": 0.3, "seeds": 3, "repeats": 2}
    results = run_notebook(PAGE, changed).results
    assert results["scale"] == 2.0
    assert results["more_continuous"] > results["more_waiting"] > 0
