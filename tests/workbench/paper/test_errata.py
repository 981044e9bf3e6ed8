"""The misprints are really there: each printed form fails a check that the corrected one passes."""

import itertools

import numpy as np
import pytest

from trinolab.workspace.cones import Cone, inside
from workbench.paper.errata import ERRATA, effects
from workbench.paper.errata.markers import printed_bisection
from workbench.paper.errata.workspace import printed_cones
from workbench.paper.ledger import Effect

# What each effect must be by the printed and by the corrected form, and a tolerance, from numbers
# that the package has no part in: by hand, or found by two other programs. None where only the
# check can be given.
KNOWN = {
    "turn_of_ccd1": (90.0, 0.0, 1e-9),  # deg: 45 on either side of Z
    "turn_of_ccd2": (90.0, 0.0, 1e-9),
    "turn_of_ccd3": (90.0, 0.0, 1e-9),
    # mm: z0 = 99.19 tan 84.7 tan 84.9 / (tan 84.7 + tan 84.9) = 545, less B/2; tan 84.7 moves by
    # 1.9 % for 0.1 deg
    "shift_of_ccd3": (495.0, 0.0, 6.0),
    "workspace_volume": (0.0, 0.07148, 2e-5),  # B^3
    # deg: atan of hypot(1280/2956, 1024/2940), and of half of it
    "whole_sides": (29.05, 15.52, 0.02),
    "black_pixels": (0.0, 1.0, 0.0),
    "resting_handle": (
        110 / 30,
        np.inf,
        1e-9,
    ),  # s: 45 * 0.99^k falls to 15 between k = 109 and 110
    "late_observation": (500 / 30, 0.0, 1e-9),  # px
    "noisy_prediction": (None, 2.0, 0.25),
    # px: sqrt(2^2 + q dt^5 / 20), and with (500 dt)^2 and (3000 dt^2 / 2)^2 added under the root
    "lost_transpose": (2.0508, 16.8749, 1e-3),
    "sum_observed": (3.0, 6.0, 0.0),
    "one_for_a_matrix": (1.0, np.inf, 0.0),
    "late_covariance": (None, np.inf, 0.0),
    "certain_start": (None, 0.999, 0.005),
    "largest_rectangle": (1.0, None, 0.0),
    "endless_bisection": (np.inf, None, 0.0),
    "wrong_way": (4.0, 8.0, 0.0),
    "residual_for_a_distance": (None, 1.0, 1e-6),
    # of noise: one column of 21; twenty numbers scatter by a third
    "broken_bounds": (np.sqrt(21), 1.0, 1.0),
    "window_that_starts_at_its_point": (None, 1.0, 1e-6),
    "direction_of_motion": (48.0, 0.0, 0.5),  # mm
    "second_form": (12.7, 0.054, 0.5),
    "first_form": (0.51, 0.020, 0.08),
    "one_focal_length": (0.19, 0.0, 0.005),
    "change_of_frame": (34.95, 0.0, 0.05),
    "plain_mean": (None, None, 0.0),
    "four_markers": (0.0, 1.0, 1e-9),
    "any_matrix": (None, 0.0, 1e-9),
    "no_rotation": (7.0e-4, 0.0, 0.05e-4),
    "use_of_no_rotation": (0.64, 0.0, 0.005),
    # deg: of the differences, 14.2 in all, row 19's 1.0 becomes 359.0, 126.2 + 54 being -179.8
    "plain_difference": ((14.2 - 1.0 + 359.0) / 20, 0.71, 1e-9),
    "mean_of_alpha": (0.67, 0.71, 1e-9),
}
FUNCTIONS = [(no, compute) for no, functions in ERRATA.items() for compute in functions]


@pytest.fixture(scope="module")
def computed():
    """Every effect by its function's name, each computed once."""
    found = [effect for group in effects().values() for effect in group]
    return {compute.__name__: one for (_, compute), one in zip(FUNCTIONS, found, strict=True)}


@pytest.mark.parametrize(("no", "name"), [(no, compute.__name__) for no, compute in FUNCTIONS])
def test_the_printed_form_fails_and_the_corrected_one_passes(computed, no, name):
    effect = computed[name]
    assert effect.no == no
    assert not effect.holds(effect.printed)
    assert effect.holds(effect.corrected)


@pytest.mark.parametrize("name", KNOWN)
def test_the_effect_is_the_known_one(computed, name):
    *known, tolerance = KNOWN[name]
    for value, wanted in zip(
        (computed[name].printed, computed[name].corrected), known, strict=True
    ):
        if wanted is not None:
            assert value == pytest.approx(wanted, abs=tolerance)


def test_every_effect_is_known():
    assert set(KNOWN) == {compute.__name__ for _, compute in FUNCTIONS}


@pytest.mark.parametrize("value", [0.4, 0.5, 1.0, 2.0, 2.1, np.nan, np.inf])
def test_the_check_of_an_effect(value):
    assert Effect("1", "a quantity", "mm", 0.0, 1.0, 0.5, 2.0).holds(value) is (0.5 <= value <= 2.0)


def printed(a, t, w, b1, b2, B):
    """Eq. 1 to 3, typed from the paper."""
    cot = 1 / np.tan(w)
    return (
        [
            a * np.sin(b1) * np.cos(t) - a * np.cos(b1) * cot,
            a * np.sin(t),
            a * np.cos(b1) * np.cos(t) + a * np.sin(b1) * cot,
        ],
        [
            a * np.sin(b2) * np.cos(t) + a * np.cos(b2) * cot + B,
            a * np.sin(t),
            -a * np.cos(b2) * np.cos(t) + a * np.sin(b2) * cot,
        ],
        [-a * cot + B / 2, a * np.sin(t) + B / np.sqrt(2), a * np.cos(t) + B / 2],
    )


@pytest.mark.parametrize(("b1", "b2", "w"), [(45, 45, 20), (84.7, 84.9, 15.5), (30, 70, 40)])
def test_the_printed_formulas_lie_on_the_printed_cones(b1, b2, w):
    b1, b2, w, B = np.deg2rad(b1), np.deg2rad(b2), np.deg2rad(w), 99.19
    a, t = np.linspace(0.1, 50, 60), np.linspace(0, 7, 60)
    for cone, formula in zip(printed_cones(B, b1, b2, w), printed(a, t, w, b1, b2, B), strict=True):
        x = np.transpose(formula) - cone.apex
        angle = np.arctan2(np.linalg.norm(np.cross(x, cone.axis), axis=1), x @ cone.axis)
        np.testing.assert_allclose(angle, w, atol=1e-12)


@pytest.mark.parametrize("degrees", [10, 44])
def test_no_point_counts_as_inside_the_printed_workspace(degrees):
    # Independent of the cutting planes: points in a wide box and far around it.
    rng = np.random.default_rng(0)
    points = rng.normal(0, 1, (30_000, 3)) * rng.lognormal(0, 1.5, (30_000, 1))
    cones = printed_cones(1.0, np.pi / 4, np.pi / 4, np.deg2rad(degrees))
    nappes = [[Cone(c.apex, sign * c.axis, c.half_angle) for sign in (1, -1)] for c in cones]
    for three in itertools.product(*nappes):
        assert not inside(list(three), points).any()


def test_the_printed_bisection_ends_where_it_can():
    image = np.zeros((20, 40))
    image[5:9, 5:9], image[5:9, 25:29] = 100.0, 200.0
    assert printed_bisection(image, 1) == (1, 1)  # 100 is not above T_0 = 100
    assert printed_bisection(image, 2) == (2, 2)  # then 50
    assert printed_bisection(image, 3) == (np.inf, 2)  # too few: down for ever
