"""Offsets in time of unsynchronised cameras: a known motion, seen at known moments."""

from dataclasses import replace

import numpy as np
import pytest
from boards import motion
from scenes import bent
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import motion_at
from trinolab.camera import Camera, Rig, fundamental_matrix
from trinolab.datasets import load_handle, load_rig
from trinolab.following import sync
from trinolab.handle import facing_pixels

RAISED, CODED = load_rig("raised_40deg"), load_handle("coded")
OFFSETS = (0.0, 0.007, -0.020)
TIMES = np.arange(150) / 30


def seen(
    offsets=OFFSETS, seed=0, times=TIMES, noise_px=0.1, speed_mm_s=200.0, turn_deg_s=20.0, rig=None
):
    """Pixels of the markers of a moving handle, (cameras, n, markers, 2); a tenth of them is
    missing.
    """
    rng, found = np.random.default_rng(seed), []
    for camera, offset in zip((rig or RAISED).cameras, offsets, strict=True):
        poses = motion_at(
            np.random.default_rng(seed),
            times + offset + 1,
            speed_mm_s=speed_mm_s,
            turn_deg_s=turn_deg_s,
        )
        uv = np.stack([facing_pixels(CODED, camera, T, 70.0) for T in poses])
        uv += noise_px * rng.standard_normal(uv.shape)
        uv[rng.random(uv.shape[:2]) < 0.1] = np.nan
        found.append(uv)
    return np.stack(found)


def test_known_offsets_are_found():
    uv = seen()
    uv[1, 60:75] = np.nan  # nothing for half a second
    found = sync.estimate_offsets(TIMES, uv, RAISED)
    assert found.reasons == (None,) * 3
    assert (found.offset_s[0], found.sigma_s[0]) == (0, 0)
    # s; 0.1 px over about 500 px/s and the root of a thousand residuals is 6 us
    np.testing.assert_allclose(found.offset_s, OFFSETS, rtol=0, atol=5e-5)
    assert (np.abs(found.offset_s - OFFSETS)[1:] < 4 * found.sigma_s[1:]).all()
    assert (found.sigma_s[1:] < 2e-5).all()
    assert list(sync.significant(found)) == [False, True, True]
    # wrong identities count for little
    rng = np.random.default_rng(3)
    wrong = rng.random(uv.shape[1:3]) < 0.03
    uv[1, wrong] += rng.normal(0, 40, (wrong.sum(), 2))
    np.testing.assert_allclose(
        sync.estimate_offsets(TIMES, uv, RAISED).offset_s, OFFSETS, rtol=0, atol=5e-4
    )


def test_cameras_in_step_have_no_offset():
    found = sync.estimate_offsets(TIMES, seen((0, 0, 0)), RAISED)
    assert np.abs(found.offset_s).max() < 5e-5
    assert not sync.significant(found).any()


def test_two_cameras_uneven_times_and_a_lens():
    rng = np.random.default_rng(1)
    times = np.sort(np.delete(TIMES + rng.uniform(-0.01, 0.01, len(TIMES)), [20, 21, 70]))
    rig = bent(load_rig("paper_pair"), -0.2, 0.1, 1e-3, -1e-3, 0.0)
    found = sync.estimate_offsets(times, seen((0, 0.07), times=times, rig=rig), rig)
    assert found.offset_s[1] == pytest.approx(0.07, abs=1e-4)


def test_a_calibration_that_is_off_pretends_no_offset():
    uv, rng = seen((0, 0, 0)), np.random.default_rng(2)
    cameras = [
        replace(c, T_cam_world=motion([0, 0, 0], np.deg2rad(rng.normal(0, 0.1, 3))) * c.T_cam_world)
        for c in RAISED.cameras  # off by about 5 px
    ]
    found = sync.estimate_offsets(TIMES, uv, Rig(tuple(cameras)))
    assert not sync.significant(found).any()
    assert np.nanmax(np.abs(found.offset_s)) < 5e-4


# --- where the data show none


@pytest.mark.parametrize("noise_px", [0.0, 0.1])
def test_a_resting_handle_shows_no_offset(noise_px):
    uv = seen(noise_px=noise_px, speed_mm_s=0.0, turn_deg_s=0.0)
    found = sync.estimate_offsets(TIMES, uv, RAISED)
    assert np.isnan([found.offset_s[1:], found.sigma_s[1:]]).all()
    assert found.reasons == (None, sync.RESTING, sync.RESTING)
    assert not sync.significant(found).any()


def test_a_camera_whose_offset_does_not_show_has_a_reason_and_the_others_theirs():
    uv = seen()
    uv[1] = np.nan
    found = sync.estimate_offsets(TIMES, uv, RAISED)
    assert found.reasons == (None, sync.UNSEEN, None)
    assert np.isnan(found.offset_s[1])
    assert found.offset_s[2] == pytest.approx(-0.020, abs=5e-5)
    beyond = sync.estimate_offsets(TIMES, seen((0, 0.3, 0.0)), RAISED)
    assert beyond.reasons == (None, sync.BEYOND, None)
    assert beyond.offset_s[2] == pytest.approx(0, abs=5e-5)


def test_motion_along_the_epipolar_lines_shows_nothing():
    rig, rng = parallel(), np.random.default_rng(0)
    x = 100 * np.sin(3 * TIMES)
    uv = np.zeros((2, len(x), 3, 2))
    for m, y in enumerate((-20.0, 0.0, 30.0)):
        points = np.column_stack([x, np.full_like(x, y), np.full_like(x, 800.0)])
        uv[:, :, m] = [camera.project(points) for camera in rig.cameras]
    found = sync.estimate_offsets(TIMES, uv + 0.1 * rng.standard_normal(uv.shape), rig)
    assert found.reasons == (None, sync.RESTING)


def test_what_does_not_fit_is_refused():
    for times, shape, says in (
        (TIMES[::-1], (3, 150, 4, 2), "times_s: expected increasing"),
        (TIMES, (2, 150, 4, 2), "uv: expected shape"),
        (TIMES, (3, 149, 4, 2), "uv: expected shape"),
        (np.full(150, np.nan), (3, 150, 4, 2), "times_s: expected finite"),
    ):
        with pytest.raises(ValueError, match=says):
            sync.estimate_offsets(times, np.zeros(shape), RAISED)


# --- the parts


def parallel():
    """Two cameras beside each other: a match has the same v."""
    K = [[1000.0, 0, 320], [0, 1000.0, 240], [0, 0, 1]]
    first = Camera("a", (640, 480), K, np.zeros(5), RigidTransform.identity())
    return Rig((first, replace(first, name="b", T_cam_world=motion([-100, 0, 0]))))


def test_sampson_distance_by_hand():
    F = fundamental_matrix(*parallel().cameras)
    r, gradient = sync.sampson(
        np.array([[100.0, 50], [300, 80]]), np.array([[70.0, 53], [10, 78]]), F
    )
    # both pixels move to their mean v: two moves of (v_b - v_a) / 2
    assert np.abs(r) == pytest.approx([3 / np.sqrt(2), 2 / np.sqrt(2)])
    assert r[0] * r[1] < 0
    assert gradient * np.sign(r[0]) == pytest.approx(np.array([[0, np.sqrt(0.5)]] * 2))


def test_tracks_end_at_long_gaps_and_short_ones_are_left_out():
    uv = np.full((30, 2, 2), np.nan)
    # gaps of 0.1 s, which is bridged, and of 0.2 s before three samples
    uv[:10, 0] = uv[12:20, 0] = uv[25:28, 0] = 1.0
    uv[5:9, 1] = 1.0  # four samples are enough
    tracks = sync.tracks_of(TIMES[:30], uv, gap_s=0.11)
    long, four = tracks
    assert long[:3] == (0, 0.0, TIMES[19])
    assert four[:3] == (1, TIMES[5], TIMES[8])
    assert len(sync.tracks_of(TIMES[:30], uv, gap_s=0.05)) == 3


def test_pairs_are_joined_by_least_squares():
    none = sync.Delta(np.nan, np.nan, sync.UNSEEN)
    agreed = {
        (0, 1): sync.Delta(-0.001, 1e-4, None),
        (0, 2): sync.Delta(-0.003, 1e-4, None),
        (1, 2): sync.Delta(-0.002, 1e-4, None),
    }
    found = sync.join(agreed, 3)
    assert found.offset_s == pytest.approx([0, 0.001, 0.003])
    # inverse of [[2, -1], [-1, 2]] / s^2
    assert found.sigma_s == pytest.approx([0, *[1e-4 * np.sqrt(2 / 3)] * 2])
    apart = sync.join({**agreed, (1, 2): sync.Delta(-0.0026, 1e-4, None)}, 3)
    # 0.6 ms too much, 0.2 ms for each pair: three residuals of two sigma, chi-square 12 for one
    # degree of freedom
    assert apart.offset_s == pytest.approx([0, 0.0008, 0.0032])
    assert apart.sigma_s == pytest.approx(found.sigma_s * np.sqrt(12))
    # through another camera, or not at all
    through = sync.join({**agreed, (0, 2): none}, 3)
    assert through.offset_s == pytest.approx([0, 0.001, 0.003])
    assert through.sigma_s == pytest.approx([0, 1e-4, 1e-4 * np.sqrt(2)])
    alone = sync.join({**agreed, (0, 1): none, (0, 2): none._replace(reason=sync.RESTING)}, 3)
    assert np.isnan(alone.offset_s[1:]).all()
    assert alone.reasons == (None, sync.UNSEEN, sync.RESTING)


def test_significant_needs_both():
    found = sync.Offsets(
        np.array([0, 0.002, 0.002, -0.0009, np.nan]),
        np.array([0, 3e-4, 5e-4, 1e-6, np.nan]),
        (None,) * 5,
    )
    assert list(sync.significant(found)) == [False, True, False, False, False]
    assert list(sync.significant(found, 3.0, 5e-4)) == [False, True, True, True, False]
    with pytest.raises(ValueError, match="least_s: expected a number"):
        sync.significant(found, least_s=-1.0)
