"""The study of an instant's time: its films, and what a row says."""

import numpy as np
import pandas as pd
import pytest

from trinolab.datasets import load_rig
from workbench.studies.instant_times import (
    Film,
    fast,
    film_rows,
    followed,
)

# --- the films


def test_velocities_of_the_fast_hand_are_its_poses_differences():
    step = 1e-5
    times = np.array([0.1, 0.37, 0.9])
    rig = load_rig("raised_40deg")
    before, now, after = (fast(rig, times + t, 2) for t in (-step, 0.0, step))
    for a, shot, b in zip(before, now, after, strict=True):
        way = b.T_world_handle.translation - a.T_world_handle.translation
        turn = b.T_world_handle.rotation * a.T_world_handle.rotation.inv()
        np.testing.assert_allclose(shot.velocity, way / (2 * step), atol=1e-3)  # mm/s
        np.testing.assert_allclose(
            shot.turn_rate, turn.as_rotvec() / (2 * step), atol=1e-4
        )  # rad/s


# --- a row


@pytest.mark.parametrize(("method", "most_mm"), [("patches", 0.1), ("paper's chain", 1.0)])
def test_both_ways_to_follow_measure_the_task(method, most_mm):
    table = followed(Film("task", 10.0, 0, 2), method)
    assert (table["mm"].iloc[-1:] < most_mm).all()
    assert (table[["ms", "blobs_ms"]] > 0).all(axis=None)
    np.testing.assert_allclose(table["ratio"], table["ms"] / table["blobs_ms"].median())


# --- the table


def instants(count=60, draws=2, **columns):
    """Rows of a film in which nothing is special."""
    rng = np.random.default_rng(3)
    frame, draw = (axis.ravel() for axis in np.mgrid[:count, :draws])
    shape = {"motion": "calm", "exposure_ms": 10.0, "seed": 0, "frame": frame, "draw": draw}
    errors = {"mm": rng.uniform(1, 3, len(frame)), "deg": 0.5, "nees": rng.chisquare(6, len(frame))}
    ms = rng.uniform(10, 20, len(frame))
    times = {"ms": ms, "ratio": ms / 40, "blobs_ms": 40.0, "possible": True}
    return pd.DataFrame({**shape, **times, **errors, **columns})


def test_a_film_has_times_errors_share_and_nees_with_intervals():
    table = instants()
    table.loc[table["frame"] < 10, ["mm", "deg", "nees"]] = np.nan  # not measured
    table.loc[table["frame"] < 5, "possible"] = False
    film, both = film_rows(table).to_dict("records")
    assert (film["n"], film["draws"], film["wrong"]) == (120, 2, (table["mm"] > 2).sum())
    for name, share in {"median": 0.5, "99": 0.99, "999": 0.999, "worst": 1.0}.items():
        assert film[f"ms_{name}"] == pytest.approx(np.quantile(table["ms"], share), abs=1e-4)
        assert film[f"ratio_{name}"] == pytest.approx(film[f"ms_{name}"] / 40, abs=1e-4)
    assert film["measured"] == pytest.approx(100 * 50 / 55, abs=1e-4)
    assert film["mean_mm"] == pytest.approx(table["mm"].mean(), abs=1e-4)
    assert film["rms_mm"] == pytest.approx(np.sqrt((table["mm"] ** 2).mean()), abs=1e-4)
    assert film["rms_deg"] == film["mean_deg"] == 0.5
    assert film["nees"] == pytest.approx(table["nees"].mean(), abs=1e-4)
    for name in ("ratio_median", "ratio_99", "measured", "mean_mm", "rms_mm", "nees"):
        assert film[f"{name}_low"] < film[name] < film[f"{name}_high"] + 1e-5
    assert both["n"] == 120
