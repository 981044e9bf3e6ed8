"""Exercises of chapter 12: force feedback."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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
DELAY = "12, The delay: position-position swings up"
WALL = "12, A wall in a computer"
SIDE_BY_SIDE = "12, Nyquist and simulation, side by side"
EXERCISES_HERE = "12, Exercises"

EXERCISES = (
    ValueExercise(
        "12.1",
        "pencil",
        "Which frequency?",
        "ex-force-frequency",
        2,
        (
            Mistake(
                "The coupling's damper D is missing: b + D belongs to Z + C, and D to C.",
                DELAY,
                {"stiffness": 10.0, "omega": 1900**0.5},
            ),
            Mistake(
                "This is a frequency in Hz. rad/s are asked for.",
                EXERCISES_HERE,
                {"omega": 1700**0.5 / (2 * np.pi)},
            ),
            Mistake(
                "This is the frequency without any damper.",
                DELAY,
                {"omega": 2000**0.5},
            ),
            Mistake(
                "This is the frequency of one mass at the spring. The pair swings against each other, "
                "and dampers slow it.",
                DELAY,
                {"omega": 1000**0.5},
            ),
            Mistake(
                "A root crosses only where |L| = 1. If there is no such frequency, none of the roots "
                "that are stable at T = 0 ever crosses.",
                DELAY,
                {"without": "unstable at any delay"},
            ),
        ),
        {
            "omega": Asked(1700**0.5, "rad/s", 0.05),
            "stiffness": Asked(30.0, "N/m", 0.1),
            "without": Asked(
                "stable at any delay",
                choices=(
                    "stable at any delay",
                    "unstable at any delay",
                    "stable without a delay only",
                ),
            ),
        },
    ),
    ValueExercise(
        "12.2",
        "pencil",
        "A hard wall",
        "ex-force-hard",
        2,
        (
            Mistake(
                "The hold is missing: a held force is half a period older on average, "
                "theta = tau + T/2.",
                WALL,
                {"damping": 40.0},
            ),
            Mistake(
                "You have added a whole period. A held force is between none and one period older, "
                "half a period on average.",
                WALL,
                {"damping": 800 * (0.05 + 1 / 30)},
            ),
            Mistake(
                "The delay is missing: this is the damping for a force that comes at once.",
                WALL,
                {"damping": 800 / 60},
            ),
            Mistake(
                "This is the age in seconds. Milliseconds are asked for.",
                EXERCISES_HERE,
                {"age_ms": 0.0025},
            ),
            Mistake(
                "Stiffness and damping are exchanged: the age is the damping divided by the stiffness.",
                WALL,
                {"age_ms": 4e5},
            ),
        ),
        {
            "damping": Asked(800 / 15, "N s/m", 0.5),
            "age_ms": Asked(2.5, "ms", 0.02),
        },
    ),
    FunctionExercise(
        "12.3",
        "write",
        "Four channels",
        "ex-force-four",
        4,
        (
            Mistake(
                "The master gets the wall's force of now. It has to be that of T ago.",
                MASSES,
                _wrong("prompt force"),
            ),
            Mistake(
                "This is position-position: the master still gets the spring's force in place of the "
                "wall's.",
                MASSES,
                _wrong("spring"),
            ),
            Mistake(
                "The master gets the spring's force and the wall's. The wall's comes in its place.",
                EXERCISES_HERE,
                _wrong("both"),
            ),
            Mistake(
                "The sign of the master's force is wrong: what comes back works against the hand.",
                MASSES,
                _wrong("sign"),
            ),
            Mistake(
                "The wall pulls as well. It pushes only, and only where the slave is in it: "
                "max(x_s - wall, 0).",
                MASSES,
                _wrong("two-sided"),
            ),
            Mistake(
                "The slave knows where the master is now. That is late as well.",
                MASSES,
                _wrong("prompt slave"),
            ),
            Mistake(
                "The wall does not push the slave.",
                MASSES,
                _wrong("no wall"),
            ),
            Mistake(
                "The force that is sent is that of the step before. Find it at the beginning of the "
                "step, from where the slave is, and send it then.",
                EXERCISES_HERE,
                _wrong("a step late"),
            ),
            Mistake(
                "The places move by the speeds before the step. The new speeds come first, as in "
                "`move`.",
                MASSES,
                _wrong("old speed"),
            ),
        ),
        position_force,
        _force_cases,
        within=1e-7,
    ),
    ValueExercise(
        "12.4",
        "predict",
        "Heavier hands",
        "ex-force-mass",
        3,
        (
            Mistake(
                "u tan u = b theta / m: a larger mass has a smaller u, and u / sin u rises with u. So "
                "the limit falls.",
                WALL,
                {"prediction": "rises"},
            ),
            Mistake(
                "It falls, but not to zero: u / sin u is never below 1.",
                WALL,
                {"infinite": 0.0},
            ),
            Mistake(
                "This is the upper end, for a master without mass. A heavy one is at the lower end.",
                WALL,
                {"infinite": 15 * np.pi},
            ),
            Mistake(
                "These are the numbers for 0.2 kg. Change the parameter and run the chapter again.",
                SIDE_BY_SIDE,
                {"at_2_kg": 33.07, "critical_ms": 30.51},
            ),
            Mistake(
                "This row has ten times the mass of the others, so 20 kg after your change.",
                SIDE_BY_SIDE,
                {"at_2_kg": 30.035},
            ),
            Mistake(
                "The critical delay is in seconds. Milliseconds are asked for.",
                EXERCISES_HERE,
                {"critical_ms": 0.030005},
            ),
        ),
        {
            "prediction": Asked("falls", choices=("falls", "stays", "rises")),
            "infinite": Asked(30.0, "N/m", 0.05),
            "at_2_kg": Asked(30.349, "N/m", 0.06),
            "critical_ms": Asked(30.005, "ms", 0.15),
        },
    ),
    ValueExercise(
        "12.5",
        "project",
        "A little delay that helps",
        "ex-force-quarter",
        5,
        (
            Mistake(
                "Only the pair of roots is looked at. Its limit 1/rho is largest without a delay, but "
                "there a real root reaches z = -1 long before.",
                WALL,
                {"best_share": 0.0},
            ),
            Mistake(
                "At KT/b = 1 the depth is gone after one period: the root is 0. It leaves the circle "
                "at -1.",
                WALL,
                {"prompt": 1.0},
            ),
            Mistake(
                "Only the real root is looked at. Its limit grows up to half a period, but beyond a "
                "quarter a pair of roots leaves the circle before.",
                WALL,
                {"best_share": 0.5},
            ),
            Mistake(
                "That is the gain of a master without mass. The table's light one has a little mass: "
                "divide its two limits.",
                SIDE_BY_SIDE,
                {"light_gain": 2.0},
            ),
            Mistake(
                "The gain is upside down: the late loop's limit divided by that of the prompt one.",
                SIDE_BY_SIDE,
                {"light_gain": 0.7647},
            ),
        ),
        {
            "prompt": Asked(2.0, within=0.02),
            "best_share": Asked(0.25, within=0.005),
            "best": Asked(4.0, within=0.04),
            # by Nyquist 1.3077; the simulation bisects to a thousandth
            "light_gain": Asked(1.308, within=0.006),
        },
    ),
)
