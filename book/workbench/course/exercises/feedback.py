"""Exercises of chapter 12: force feedback."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker


def _variant(push, late, wall_m, wall_stiffness, wrong):
    """As `position_force` with one thing wrong."""
    dt, mass, damping, coupling, coupling_damping = 2e-4, 0.2, 2.0, 200.0, 2.0
    sent = [[0.0] * 5] * late
    x_m = v_m = x_s = v_s = last_F_e = 0.0
    places = []
    for F_h in push:
        places.append([x_m, x_s])
        depth = x_s - wall_m
        F_e = wall_stiffness * (depth if wrong == "two-sided" else max(depth, 0.0))
        sent.append([x_m, v_m, x_s, v_s, last_F_e if wrong == "a step late" else F_e])
        last_F_e = F_e
        old_x_m, old_v_m, old_x_s, old_v_s, old_F_e = sent[-1 - late]
        if wrong == "prompt slave":
            old_x_m, old_v_m = x_m, v_m
        F_s = coupling * (old_x_m - x_s) + coupling_damping * (old_v_m - v_s)
        spring = coupling * (x_m - old_x_s) + coupling_damping * (v_m - old_v_s)
        F_m = {
            "prompt force": F_e,
            "spring": spring,
            "both": spring + old_F_e,
            "sign": -old_F_e,
        }.get(wrong, old_F_e)
        before = v_m, v_s
        v_m = v_m + dt * (F_h - F_m - damping * v_m) / mass
        v_s = v_s + dt * (F_s - (0 if wrong == "no wall" else F_e) - damping * v_s) / mass
        by_m, by_s = before if wrong == "old speed" else (v_m, v_s)
        x_m = x_m + dt * by_m
        x_s = x_s + dt * by_s
    return np.array(places)


def _wrong(what):
    def position_force(push, late, wall_m, wall_stiffness):
        return _variant(push, late, wall_m, wall_stiffness, what)

    return position_force


MASSES = "12, Two masses and a channel"
EXERCISES_HERE = "12, Exercises"


position_force_exercise = FunctionExerciseMaker("12.3", "Send the force", "ex-force-four", points=4)


@position_force_exercise.solution
def position_force(push, late, wall_m, wall_stiffness):
    """Places of master and slave when positions go one way and the wall's force comes back.

    The chapter's numbers: mass 0.2 kg and damping 2 N s/m of either side, a coupling of 200 N/m
    and 2 N s/m that pulls the slave, steps of 2e-4 s. Both begin at rest at 0. In each step first
    the forces, of where both are now; then the speeds, then the places by the new speeds.

    Parameters
    ----------
    push
        (n,), force of the hand on the master in each step, N.
    late
        The delay T each way, in whole steps. What would have been sent before the beginning is 0.
    wall_m
        Where the slave meets the wall, m.
    wall_stiffness
        Of the wall, N/m. It only pushes, and only where the slave is in it.

    Returns
    -------
    array
        (n, 2), where master and slave are at the beginning of each step, m.
    """
    mass, damping = 0.2, 2.0
    coupling, coupling_damping = 200.0, 2.0
    dt = 2e-4
    sent = [[0.0, 0.0, 0.0]] * late  # x_m, v_m, F_e
    x_m = v_m = x_s = v_s = 0.0
    places = []
    for F_h in push:
        places.append([x_m, x_s])
        F_e = wall_stiffness * max(x_s - wall_m, 0.0)
        sent.append([x_m, v_m, F_e])
        old_x_m, old_v_m, old_F_e = sent[-1 - late]
        F_m = old_F_e
        F_s = coupling * (old_x_m - x_s) + coupling_damping * (old_v_m - v_s)
        v_m = v_m + dt * (F_h - F_m - damping * v_m) / mass
        x_m = x_m + dt * v_m
        v_s = v_s + dt * (F_s - F_e - damping * v_s) / mass
        x_s = x_s + dt * v_s
    return np.array(places)


@position_force_exercise.cases
def _force_cases(rng):
    steady = np.full(500, 2.0)
    there_and_back = np.repeat([2.0, -3.0, 1.0], 200)
    return [
        (steady, 0, 0.002, 1000.0),
        (steady, 60, 0.002, 1000.0),
        (there_and_back, 25, 0.001, 1000.0),
        (there_and_back, 100, 0.003, 400.0),
        (steady, 40, 1.0, 1000.0),
        (2 + rng.normal(0, 0.5, 500), 30, 0.004, 2000.0),
    ]


position_force_exercise.known_mistake(
    "The master gets the wall's force of now. It has to be that of T ago.",
    MASSES,
    _wrong("prompt force"),
)


position_force_exercise.known_mistake(
    "This is position-position: the master still gets the spring's force in place of the wall's.",
    MASSES,
    _wrong("spring"),
)


position_force_exercise.known_mistake(
    "The master gets the spring's force and the wall's. The wall's comes in its place.",
    EXERCISES_HERE,
    _wrong("both"),
)


position_force_exercise.known_mistake(
    "The sign of the master's force is wrong: what comes back works against the hand.",
    MASSES,
    _wrong("sign"),
)


position_force_exercise.known_mistake(
    "The wall pulls as well. It pushes only, and only where the slave is in it: "
    "max(x_s - wall, 0).",
    MASSES,
    _wrong("two-sided"),
)


position_force_exercise.known_mistake(
    "The slave knows where the master is now. That is late as well.",
    MASSES,
    _wrong("prompt slave"),
)


position_force_exercise.known_mistake(
    "The wall does not push the slave.",
    MASSES,
    _wrong("no wall"),
)


position_force_exercise.known_mistake(
    "The force that is sent is that of the step before. Find it at the beginning of "
    "the step, from where the slave is, and send it then.",
    EXERCISES_HERE,
    _wrong("a step late"),
)


position_force_exercise.known_mistake(
    "The places move by the speeds before the step. The new speeds come first, as in `move`.",
    MASSES,
    _wrong("old speed"),
)


EXERCISES = (position_force_exercise.made(),)
