"""Views that are left out of a calibration: before anything is fitted, and by what they contradict."""

import numpy as np
import pytest
from boards import SIZE, corners, make_rig, positions

from trinolab.calibration.outliers import UNSEEN, calibrate_robustly, too_few
from trinolab.calibration.target import Board

# two rows of three corners, and one more beside them, mm
TARGET = np.array([[u, v, 0.0] for v in (0, 20) for u in (0, 30, 60)] + [[90.0, 0.0, 0.0]])
PIXELS = TARGET[:, :2] + [100.0, 50.0]  # seen from the front, a pixel a millimetre


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        ([], UNSEEN),
        ([0, 1, 3, 4, 5], "too few points: 5 of 7, expected 6 or more"),
        ([0, 1, 2, 3, 4, 5], ""),
        (range(7), ""),
    ],
)
def test_six_points_are_enough_and_five_are_not(seen, reason):
    uv = np.full((1, 1, len(TARGET), 2), np.nan)
    for k in seen:
        uv[0, 0, k] = PIXELS[k]
    assert too_few(TARGET, uv).tolist() == [[reason]]


def test_points_on_one_line_are_no_view():
    along = np.column_stack([np.arange(6) * 20.0, np.zeros(6), np.zeros(6)])
    (why,) = too_few(along, along[None, None, :, :2])
    assert why == "the 6 points found lie on one line"


def test_a_camera_that_contradicts_two_others_is_the_one_left_out():
    board = Board(7, 6, 15.0)
    uv = corners(make_rig(cameras=3), positions(8), board, 0.05)
    uv[0, 2] = uv[0, 5]
    uv[1, 3, 10] += 6.0
    found, why = calibrate_robustly(board.points, uv, [SIZE] * 3, ("a", "b", "c"))
    assert sorted(zip(*map(list, np.nonzero(why != "")), strict=True)) == [(0, 2), (1, 3)]
    assert why[0, 2] == "the target lies elsewhere than for b, c, against all other views"
    assert "far above the others" in why[1, 3]
    assert found.sigma_px == pytest.approx(0.05, rel=0.1)
