"""Views that are left out of a calibration before anything is fitted."""

import numpy as np
import pytest

from trinolab.calibration.outliers import UNSEEN, too_few

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
