"""Poses and a truth that do not belong together: refused, or said."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.files.joining import DELAY, best_offset, join
from trinolab.files.poses import truth_table

N = 60  # frames of the truth: two seconds


def path(count=N):
    """A hand's way, 10 mm a frame and more, that never comes near a place again."""
    k = np.arange(count)
    places = np.column_stack([12.0 * k, 40 * np.sin(k / 5), 600 + 30 * np.cos(k / 7)])
    return RigidTransform.from_translation(places)


def truth():
    return truth_table(path()).assign(t_s=np.arange(N) / 30)


def estimated(first, count, frames=None, sigma=0.02, off_mm=0.3):
    """Estimates of a part of the truth, without times; numbered by `frames`."""
    moved = RigidTransform.from_translation([off_mm, 0.0, 0.0]) * path()[first : first + count]
    numbers = range(first, first + count) if frames is None else frames
    return truth_table(moved).assign(frame=numbers, sigma_mm=sigma)


def timed(table, late_s=0.0):
    return table.assign(t_s=table["frame"] / 30 + late_s)


def joined(found, true=None):
    return join(found, truth() if true is None else true, "p.csv", "t.csv")


def test_what_belongs_together_is_joined_without_a_word(caplog):
    both = joined(timed(estimated(0, N)))
    assert both["frame"].tolist() == list(range(N))
    assert (both["x_mm"] - both["x_mm_true"]).to_numpy() == pytest.approx(0.3)
    assert caplog.messages == []


@pytest.mark.parametrize("first", [0, 40])
@pytest.mark.parametrize("has_times", [False, True])  # that agree, which is no excuse
def test_poses_with_the_numbers_of_others_are_refused(first, has_times):
    found = estimated(20, 5, range(first, first + 5))
    message = (
        rf"^p\.csv, t\.csv: the poses fit the truth 20 frames {'earlier' if first else 'later'} far "
        r"better \(median 0\.3 mm instead of \d+\); their frames do not belong together$"
    )
    with pytest.raises(ValueError, match=message):
        joined(timed(found) if has_times else found)


@pytest.mark.parametrize("delay", [1, DELAY])
def test_a_delay_is_said_and_evaluated(delay, caplog):
    both = joined(estimated(0, N - delay, range(delay, N)))
    assert len(both) == N - delay
    assert f"the poses fit the truth {delay} frames earlier far better" in caplog.messages[0]
    assert "they are delayed, or numbered otherwise than t.csv" in caplog.messages[0]


def test_poses_that_another_frame_fits_a_little_better_are_no_wrong_join():
    """A slow hand, 1 mm a frame; poses 2.5 mm off, (2, 1.5), of which two frames later 1.5 are
    left: within 2 mm, but more than a quarter.
    """
    places = np.column_stack([np.arange(N), np.zeros(N), np.full(N, 600.0)])
    true = truth_table(RigidTransform.from_translation(places))
    poses = truth_table(RigidTransform.from_translation(places + [2.0, 1.5, 0.0]))
    assert best_offset(poses, true) is None


@pytest.mark.parametrize(
    "found",
    [
        # a hundred along the way, but fifteen beside it
        estimated(0, N, off_mm=100.0).assign(y_mm=lambda table: table["y_mm"] + 15),
        estimated(20, 2, range(2)),  # two poses may fit somewhere by chance
        estimated(20, 5, range(5)).assign(status="lost"),
        estimated(20, 5, range(5)).assign(status="predicted"),
    ],
)
def test_bad_poses_are_no_wrong_join(found):
    assert best_offset(found, truth()) is None


def test_frames_may_have_any_number():
    far = 2**52
    found = estimated(20, 9, range(far, far + 9))
    shifted = truth().assign(frame=truth()["frame"] + far)
    assert best_offset(found, shifted).frames == 20


def test_times_that_disagree_are_refused():
    said = (
        r"^p\.csv, t\.csv: frame 20 is at 0 s in the one and at 0\.666666667 s in the other; "
        "their frames do not belong together$"
    )
    with pytest.raises(ValueError, match=said):
        joined(estimated(20, 5).assign(t_s=np.arange(5) / 30))
    joined(timed(estimated(0, N), late_s=0.4 / 30))  # less than half a frame
    with pytest.raises(ValueError, match=r"frame 0 is at 0\.02 s"):
        joined(timed(estimated(0, N), late_s=0.6 / 30))


@pytest.mark.parametrize(
    "true",
    [truth().drop(columns="t_s"), truth().assign(t_s=np.nan), truth().assign(t_s=7.0)],
    ids=["none", "empty", "all alike"],
)
def test_without_times_nothing_is_said_of_them(true, caplog):
    assert len(joined(timed(estimated(0, N), late_s=1.0), true)) == N
    assert caplog.messages == []


def test_frames_without_a_partner_are_counted_where_somebody_is_there(caplog):
    found, true = pd.concat([estimated(0, 50), estimated(0, 3, range(70, 73))]), truth()
    joined(found)
    assert caplog.messages == [
        "p.csv: 3 of 53 frames have no truth in t.csv",
        "t.csv: 10 of 60 instants have no row in p.csv, and count as lost",
    ]
    caplog.clear()
    true.loc[:9, "status"] = "lost"
    assert len(joined(estimated(0, N), true)) == N - 10
    assert caplog.messages == []


def test_swapped_files_are_noticed(caplog):
    joined(truth(), estimated(0, N))
    assert caplog.messages == [
        "t.csv has uncertainties, p.csv has none: is the truth given before the poses?"
    ]
