"""Delays of cameras and their spread, against simulated rigs whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.distance import pdist
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import calibrate
from trinolab.calibration.synchrony import synchronised
from trinolab.calibration.target import Target
from trinolab.datasets import load_rig

POINTS = np.array(Target("chessboard", 5, 4, 30.0).points)
RIG = load_rig("raised_40deg")
LENSES = [replace(camera, T_cam_world=RigidTransform.identity()) for camera in RIG.cameras]
STEP_S = 0.2
NOISE_PX = 0.3


def path(rng, count, size=1.0):
    """Where the target is at a time: hands turn round within half a second."""
    knots = 0.5 * np.arange(-1, int(count * STEP_S / 0.5) + 4)
    places = CubicSpline(knots, size * rng.normal(0, (30, 25, 35), (len(knots), 3)))
    turns = CubicSpline(knots, size * rng.normal(0, 0.2, (len(knots), 3)))
    far = rng.uniform(-1, 1, (2, 4, 3)) * np.reshape([[50, 40, 60], [0.4, 0.4, 0.4]], (2, 1, 3))
    slowly = CubicSpline(np.linspace(knots[0], knots[-1], 4), far, axis=1)

    def at(time):
        place, turn = slowly(time)
        R = Rotation.from_rotvec(turn + turns(time)) * Rotation.from_euler("x", 20, degrees=True)
        middle = places(time) + place + [0, 0, 560]
        return RigidTransform.from_components(middle - R.apply(POINTS.mean(axis=0)), R)

    return at


def filmed(seed, delays_s, sigma_s, count=30, size=1.0, stops=False):
    """Pixels (cameras, views, n, 2) and times of a target that moves before the rig; with `stops` it
    rests while a view is taken.
    """
    rng = np.random.default_rng(seed)
    where = path(rng, count, size)
    times = STEP_S * np.arange(count)
    late = np.array(delays_s)[:, None] + rng.normal(0, sigma_s, (len(RIG.cameras), count))
    uv = np.empty((len(RIG.cameras), count, len(POINTS), 2))
    for c, v in np.ndindex(late.shape):
        T = where(times[v] + (0 if stops else late[c, v]))
        uv[c, v] = RIG.cameras[c].project(T.apply(POINTS))
    return uv + rng.normal(0, NOISE_PX, uv.shape), times


def plain(uv):
    return calibrate(POINTS, uv, [c.size for c in LENSES], RIG.names, lenses=LENSES)


def apart_mm(cameras):
    """The distances of the cameras from each other."""
    return pdist([camera.centre for camera in cameras])


@pytest.mark.slow
def test_delays_and_their_spread_are_found_and_allowed_for():
    """Baselines of 2 simulated rigs: with 12 ms and 6 ms an eighth of the error of cameras that are
    taken for simultaneous.
    """
    delays_s, sigma_s = (0.0, 0.012, -0.012), 0.006
    off, true = [], apart_mm(RIG.cameras)
    for seed in range(2):
        uv, times = filmed(seed, delays_s, sigma_s)
        found = plain(uv)
        timed, when = synchronised(POINTS, uv, found, times, held=True)
        np.testing.assert_allclose(when.delays, delays_s, rtol=0, atol=0.006)  # s
        assert sigma_s / 2 < when.sigma < 1.5 * sigma_s
        assert timed.sigma_px == pytest.approx(NOISE_PX, rel=0.25)
        off.append([apart_mm(of.cameras) - true for of in (found, timed)])
    simultaneous, allowed_for = np.sqrt(np.mean(np.square(off), axis=(0, 2)))
    assert allowed_for < 0.25 * simultaneous


@pytest.mark.slow
@pytest.mark.parametrize(
    "late",
    [
        {"delays_s": (0, 0, 0), "sigma_s": 0.0},
        {"delays_s": (0, 0.02, -0.02), "sigma_s": 0.01, "stops": True},
        {"delays_s": (0, 0, 0), "sigma_s": 0.0, "count": 4},
    ],
    ids=["triggered", "at rest in each view", "too few views"],
)
def test_nothing_changes_where_nothing_speaks_for_delays(late):
    for seed in range(2):
        uv, times = filmed(seed, **late)
        assert synchronised(POINTS, uv, plain(uv), times, held=True) is None


def test_a_target_that_never_moves_says_nothing():
    found = plain(filmed(0, (0, 0, 0), 0.0)[0])
    uv = np.full(found.residuals_px.shape, 100.0)
    still = replace(found, T_world_target=(found.T_world_target[0],) * len(found.T_world_target))
    times = STEP_S * np.arange(uv.shape[1])
    assert synchronised(POINTS, uv, still, times, held=True) is None
