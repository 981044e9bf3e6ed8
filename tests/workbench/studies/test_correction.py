"""What a correction by a share says of itself, by hand and in the linear model of a pair."""

import numpy as np
import pytest

from trinolab.datasets import load_handle, load_rig, load_table1
from workbench.studies.correction import by_sigma
from workbench.studies.silent_size import Seen, seen, sizes

RIG = load_rig("paper_pair")
INSTANTS = [seen(RIG, load_handle("paper"), T) for T in load_table1().set_poses[::5]]


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_who_corrects_wholly_or_not_at_all_is_right(share):
    _, bad = sizes(RIG)
    found = by_sigma(INSTANTS, bad, share, np.random.default_rng(0), draws=2000)
    # 8,000 draws, mostly of one number
    assert found == pytest.approx((1, 1), abs=0.04)


def test_a_share_by_hand():
    """One number of each part is seen twice, and one of the two is off: the pose by the noise is the
    mean, off by half of that; the corrected one takes the other. Without noise their mean is off by
    (1 - w) / 2 of it, and by w (1 - w) they are apart.
    """
    six = np.eye(6)
    one = Seen(np.vstack([six, six]), np.vstack([six, 0 * six]))
    w = 0.8
    found = by_sigma([one], six, w, np.random.default_rng(0), draws=20_000, noise_px=1e-6)
    own, apart = ((1 - w) / 2) ** 2, w * (1 - w) / 4
    # the squares x of what three numbers are off by: own x / (3 own + apart x)
    x = (np.random.default_rng(1).standard_normal((3, 200_000)) ** 2).sum(axis=0)
    expected = np.sqrt(np.mean(own * x / (3 * own + apart * x)))
    assert found == pytest.approx((expected, expected), rel=0.01)


def test_a_part_that_is_not_made_makes_sigma_modest():
    _, bad = sizes(RIG)
    draws = [
        by_sigma(INSTANTS, bad, share, np.random.default_rng(0)).mm for share in (1.0, 0.96, 0.9)
    ]
    assert draws[0] > draws[1] > draws[2]
