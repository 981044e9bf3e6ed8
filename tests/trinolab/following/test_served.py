"""Cameras that serve no pose are named, with the instant from which on they do not."""

import re

import numpy as np
import pytest

from trinolab.datasets import load_rig
from trinolab.following.served import idle_lines

RIG = load_rig("raised_40deg")
N = 60


@pytest.mark.parametrize(
    ("served", "expected"),
    [
        (np.ones(N), None),
        (np.arange(N) % 10 > 0, None),  # a frame is repeated now and then
        (np.arange(N) >= 25, None),  # it comes late
        (np.arange(N) < N - 9, None),
        (np.arange(N) % 30 > 10, None),  # hidden for a while
        (np.arange(N) < N - 10, "50 of 60 measured instants, 0 of the 10 from frame 80 on;"),
        (np.arange(N) < 30, "30 of 60 measured instants, 0 of the 30 from frame 60 on;"),
        (np.isin(np.arange(N), [*range(30), 47, 59]), "32 of 60 .*, 2 of the 30 from frame 60 on;"),
        (np.zeros(N), "0 of 60 measured instants;"),
        (np.arange(N) == 30, "1 of 60 measured instants;"),
    ],
)
def test_a_camera_without_poses_is_named(served, expected):
    serves = np.ones((N, 3), bool)
    serves[:, 1] = served
    lines = idle_lines(30 + np.arange(N), serves, RIG)
    assert len(lines) == (expected is not None)
    assert expected is None or re.match(f"ccd2: serves {expected}", lines[0])


def test_without_a_measured_instant_nothing_is_said():
    assert idle_lines([], [], RIG) == []
