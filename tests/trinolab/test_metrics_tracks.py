"""The quality of a track, on tracks made by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle
from trinolab.metrics import far_off, flips, waits


def track(n):
    turns = Rotation.from_euler(
        "ZYX", [[10.0 * k, 20.0, -30.0 * k] for k in range(n)], degrees=True
    )
    return RigidTransform.from_components([[10.0 * k, 0.0, 600.0] for k in range(n)], turns)


def turns_deg(angles):
    """Turns about the handle's axis."""
    return RigidTransform.from_rotation(
        Rotation.from_rotvec(np.outer(angles, [0, 1, 0]), degrees=True)
    )


def test_flips_by_hand():
    T, S = track(6), load_handle("paper").symmetries
    for choice, count in (
        ([0] * 6, 0),
        ([4] * 6, 0),
        ([0, 0, 3, 3, 3, 3], 1),
        ([0, 1, 0, 1, 0, 1], 5),
    ):
        assert (
            flips(RigidTransform.concatenate([T[k] * S[s] for k, s in enumerate(choice)]), T, S)
            == count
        )
    assert flips(T[[0]], T[[0]], S) == 0


def test_a_small_turn_is_no_flip_and_a_large_one_of_a_coded_handle_none_either():
    T = track(4)
    turned = T * turns_deg([0, 29.0, -29.0, 0])
    # the nearest equivalent is 60 deg away
    assert flips(turned, T, load_handle("paper").symmetries) == 0
    assert flips(turned, T, load_handle("coded").symmetries) == 0
    assert far_off(turned, T, load_handle("coded").symmetries) == 2


def test_far_off_has_two_limits():
    T, S = track(4), load_handle("coded").symmetries
    moved = RigidTransform.from_translation([[0, 0, 1.99], [0, 2.01, 0], [0, 0, 0], [0, 0, 0]]) * T
    turned = moved * turns_deg([0, 0, 4.99, 5.01])
    assert far_off(turned, T, S) == 2
    assert far_off(turned, T, S, far_mm=3.0) == 1
    with pytest.raises(ValueError, match="far_deg: expected a number"):
        far_off(turned, T, S, far_deg=-1.0)


@pytest.mark.parametrize(
    ("row", "ended", "unended"),
    [
        ("", (), None),
        ("0000", (), None),
        ("1111", (), None),
        ("0011", (), None),
        ("1001", (2,), None),
        ("0101100010", (1, 3), 1),
        ("1000", (), 3),
    ],
)
def test_waits_by_hand(row, ended, unended):
    assert waits([c == "1" for c in row]) == (ended, unended)


def test_waits_count_what_counts():
    assert waits([True, False, False, True, False], [True, False, True, True, False]) == ((1,), 0)
    with pytest.raises(ValueError, match=r"measured, counted: expected shape \(n,\) of both"):
        waits([True, False], [True])
    with pytest.raises(ValueError, match="measured, counted"):
        waits(np.ones((2, 2)))
