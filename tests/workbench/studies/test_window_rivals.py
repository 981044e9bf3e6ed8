"""Rules for the next window on targets whose way is known, counted by hand."""

import numpy as np

from trinolab.kalman import KalmanParameters
from trinolab.window import Window
from workbench.studies import window_rivals
from workbench.studies.window_rivals import Guess, Seen

SIZE = (200, 100)
SETTINGS = KalmanParameters(1e6, 1.0, 600.0, 6000.0)


def seen(name, us, size=SIZE):
    """A rectangle of 10 x 6 px that begins at these columns, None where it is hidden."""
    boxes = [None if u is None else Window(u, 40, 10, 6) for u in us]
    return Seen((name, 0), np.arange(len(us)) / 30, boxes, size)


def misses(target, rule, gap=1):
    return [
        window_rivals.miss(guess) for guess in window_rivals.guesses([target], rule, SETTINGS, gap)
    ]


def test_last_place_misses_by_a_step_and_last_step_by_its_change():
    target = seen("calm", [0, 10, 20, 25])
    assert misses(target, "last place") == [10, 5]
    assert misses(target, "last step") == [0, 5]
    # over a gap of two the step of the frames before it is made twice
    assert misses(target, "last step", gap=2) == [5]


def test_the_filter_follows_even_steps_and_its_margin_grows_in_a_gap():
    target = seen("calm", list(range(0, 120, 8)))
    assert max(misses(target, "filter")[5:]) <= 1  # px, of rounding
    margins = [
        window_rivals.guesses([target], "filter", SETTINGS, gap)[-1].gate_px for gap in (1, 2, 3)
    ]
    assert margins[0] > 3  # the gate of 99.9 % is 3.7 standard deviations
    assert margins[0] < margins[1] < margins[2]


def test_a_window_is_cut_at_the_image_and_holds_what_is_inside():
    guess = Guess(("calm", 0, 0), Window(-5, 0, 10, 10), np.nan, Window(0, 0, 5, 12), SIZE)
    assert window_rivals.miss(guess) == 2
    assert window_rivals.window_share(guess, 1.0) == (6 * 11 / 20_000, False)
    assert window_rivals.window_share(guess, 2.0) == (7 * 12 / 20_000, True)


def test_a_margin_follows_the_last_ten_misses_of_its_camera():
    """Steps of 10 px whose fourth is 34 px long: last step misses by 24 px there and at the next one;
    once and a half that is 36 px, for ten frames.
    """
    us = [0, 10, 20, 30, *range(64, 250, 10)]
    found = window_rivals.guesses([seen("calm", us, (400, 100))], "last step", SETTINGS)
    assert [window_rivals.miss(guess) for guess in found[:5]] == [0, 0, 24, 24, 0]
    margins = window_rivals.margins_by_last_misses(found)
    assert margins == [8.0] * 3 + [36.0] * 11 + [8.0] * (len(found) - 14)
    other = [guess._replace(block=("calm", 1, 0)) for guess in found]
    assert window_rivals.margins_by_last_misses([*found, *other]) == margins * 2
