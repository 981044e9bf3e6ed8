"""Delays of cameras and their spread, against simulated rigs whose truth is known and against dense
algebra with numerical slopes.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration import synchrony
from trinolab.calibration.adjust import calibrate, lenses_of, matrices
from trinolab.calibration.model import State
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
    uv = np.array(
        [
            [
                camera.project(where(time + (0 if stops else after)).apply(POINTS))
                for time, after in zip(times, of, strict=True)
            ]
            for camera, of in zip(RIG.cameras, late, strict=True)
        ]
    )
    return uv + rng.normal(0, NOISE_PX, uv.shape), times


def plain(uv):
    return calibrate(POINTS, uv, [c.size for c in LENSES], RIG.names, lenses=LENSES)


def off_mm(found):
    """How far the distances of the cameras are from the truth."""
    return [
        np.linalg.norm(found.cameras[a].centre - found.cameras[b].centre)
        - np.linalg.norm(RIG.cameras[a].centre - RIG.cameras[b].centre)
        for a, b in itertools.combinations(range(len(RIG.cameras)), 2)
    ]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.slow
def test_delays_and_their_spread_are_found_and_allowed_for():
    """Baselines of 4 simulated rigs: with 12 ms and 6 ms an eighth of the error of cameras that are
    taken for simultaneous. The simplest rival, the half of the views with a slow target, is no better
    than all of them.
    """
    delays_s, sigma_s = (0.0, 0.012, -0.012), 0.006
    off = {"all": [], "slow": [], "timed": []}
    for seed in range(4):
        uv, times = filmed(seed, delays_s, sigma_s)
        found = plain(uv)
        timed, when = synchronised(POINTS, uv, found, times, held=True)
        np.testing.assert_allclose(when.delays, delays_s, rtol=0, atol=0.006)  # s
        assert sigma_s / 2 < when.sigma < 1.5 * sigma_s
        assert timed.sigma_px == pytest.approx(NOISE_PX, rel=0.25)
        places = np.array([T.apply(POINTS.mean(axis=0)) for T in found.T_world_target])
        speeds = np.linalg.norm(np.gradient(places, axis=0), axis=1)
        off["all"] += off_mm(found)
        off["slow"] += off_mm(plain(uv[:, speeds <= np.median(speeds)]))
        off["timed"] += off_mm(timed)
    assert rms(off["timed"]) < 0.25 * rms(off["all"])
    assert rms(off["timed"]) < 0.25 * rms(off["slow"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "what"),
    [
        ({"delays_s": (0, 0, 0), "sigma_s": 0.0}, "triggered"),
        ({"delays_s": (0, 0.02, -0.02), "sigma_s": 0.01, "stops": True}, "at rest in each view"),
        ({"delays_s": (0, 0, 0), "sigma_s": 0.0, "count": 4}, "too few views"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_nothing_changes_where_nothing_speaks_for_delays(late, what):
    for seed in range(3):
        uv, times = filmed(seed, **late)
        assert synchronised(POINTS, uv, plain(uv), times, held=True) is None, what


def test_a_target_that_never_moves_says_nothing():
    found = plain(filmed(0, (0, 0, 0), 0.0)[0])
    uv = np.full(found.residuals_px.shape, 100.0)
    still = replace(found, T_world_target=(found.T_world_target[0],) * len(found.T_world_target))
    times = STEP_S * np.arange(uv.shape[1])
    assert synchronised(POINTS, uv, still, times, held=True) is None


@pytest.mark.heavy
def test_the_fit_is_that_of_dense_algebra():
    """Whole covariance matrices, their Cholesky factors and numerical slopes of all unknowns, by another
    minimiser, give the same cameras, delays and restricted likelihood.
    """
    uv, times = filmed(1, (0, 0.01, -0.01), 0.004, count=6)
    uv[2, 3, :7] = np.nan
    found = plain(uv)
    start = State(
        lenses_of(found.cameras, 5),
        matrices(c.T_world_cam for c in found.cameras),
        matrices(found.T_world_target),
    )
    s = 0.02  # s a pixel of noise
    motion = synchrony._motion(start, POINTS, uv, times)
    problem = synchrony._Problem(POINTS, uv, start.lenses.size, motion)
    fit = problem.fit(start, np.zeros(2), s)

    seen = np.isfinite(uv[..., 0])
    middle = POINTS.mean(axis=0)

    def pixels(T_world_cam, T_world_target):
        return np.array(
            [
                [
                    replace(lens, T_cam_world=T.inv()).project(pose.apply(POINTS))
                    for pose in T_world_target
                ]
                for lens, T in zip(LENSES, T_world_cam, strict=True)
            ]
        )

    def moved(T, step):
        """Shifted, and turned about its middle."""
        R = Rotation.from_rotvec(step[3:]) * T.rotation
        place = T.apply(middle) + step[:3]
        return RigidTransform.from_components(place - R.apply(middle), R)

    cameras0 = [c.T_world_cam for c in found.cameras]
    poses0 = list(found.T_world_target)
    by_step = np.stack(
        [
            (
                pixels(cameras0, [moved(T, h) for T in poses0])
                - pixels(cameras0, [moved(T, -h) for T in poses0])
            )
            / 2e-4
            for h in 1e-4 * np.eye(6)
        ],
        axis=-1,
    )
    places = np.array([T.apply(middle) for T in poses0])
    last = len(times) - 1
    velocity, factors, log_det = np.zeros(uv.shape), {}, 0.0
    for v in range(len(times)):
        a, b = max(v - 1, 0), min(v + 1, last)
        turn = (poses0[b].rotation * poses0[a].rotation.inv()).as_rotvec()
        speed = np.concatenate([places[b] - places[a], turn]) / (times[b] - times[a])
        velocity[:, v] = by_step[:, v] @ speed
        sides = [k for k in (v - 1, v) if 0 <= k < last]
        shift = rms([np.linalg.norm(places[k + 1] - places[k]) / STEP_S for k in sides])
        turns = [(poses0[k + 1].rotation * poses0[k].rotation.inv()).magnitude() for k in sides]
        size = np.repeat([shift, rms(turns) / STEP_S], 3) / np.sqrt(3)
        for c in range(3):
            B = (by_step[c, v][seen[c, v]] * size).reshape(-1, 6)
            C = np.eye(len(B)) + s**2 * B @ B.T
            factors[c, v] = np.linalg.cholesky(C)
            log_det += np.linalg.slogdet(C)[1]

    def whitened(x):
        steps = x[:-2].reshape(-1, 6)
        T_world_cam = [
            cameras0[0],
            *(
                RigidTransform.from_components(
                    T.translation + step[:3], Rotation.from_rotvec(step[3:]) * T.rotation
                )
                for T, step in zip(cameras0[1:], steps, strict=False)
            ),
        ]
        poses = [moved(T, step) for T, step in zip(poses0, steps[2:], strict=True)]
        late = np.concatenate([[0.0], 1e-3 * x[-2:]])
        missing = pixels(T_world_cam, poses) + velocity * late[:, None, None, None] - uv
        return np.concatenate(
            [
                np.linalg.solve(factor, missing[c, v][seen[c, v]].ravel())
                for (c, v), factor in factors.items()
            ]
        )

    # steps of two cameras and of the poses, then the delays in ms
    x0 = np.zeros(6 * (2 + len(times)) + 2)
    dense = least_squares(whitened, x0, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-12)
    # its slopes are numerical: it stops 1e-7 s away
    np.testing.assert_allclose(fit.delays, 1e-3 * dense.x[-2:], rtol=0, atol=1e-6)
    assert fit.cost == pytest.approx(dense.cost, rel=1e-8)
    shifts = dense.x[:12].reshape(-1, 6)[:, :3]
    ours = fit.state.T_world_cam[1:, :3, 3] - [T.translation for T in cameras0[1:]]
    np.testing.assert_allclose(ours, shifts, rtol=0, atol=1e-3)  # mm

    J = dense.jac.copy()
    J[:, -2:] *= 1e3  # from ms to s
    freedoms = 2 * int(seen.sum()) - J.shape[1]
    expected = freedoms * np.log(dense.cost) + log_det + np.linalg.slogdet(J.T @ J)[1]
    assert problem.restricted(fit, s) == pytest.approx(expected, abs=1e-3)
    assert problem.spread(s) == pytest.approx(log_det, rel=1e-6)
