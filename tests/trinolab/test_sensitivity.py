"""What errors of rig and layout do to pixels and poses: slopes against differences, propagation
against draws, and limits of a chi-square by tables.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import sensitivity
from trinolab.camera import RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.default_covariance import PLACEMENT_MM, SCALE_SHARE, usual_covariance
from trinolab.files.poses import contradictions, pose_table
from trinolab.handle import facing_pixels
from trinolab.matching import epipolar_distances
from trinolab.pose import Pose, fit_pose, fit_response
from trinolab.rigid import motion_between

BENT = np.array([-0.2, 0.1, 0.001, -0.002, 0.05])
RAISED = load_rig("raised_40deg")
RIG = replace(RAISED, cameras=tuple(replace(c, distortions=BENT) for c in RAISED.cameras))
PAIR, CODED = load_rig("paper_pair"), load_handle("coded")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
# a step of each parameter, about a tenth of a pixel
STEPS = np.array([0.1] * 4 + [1e-2] * 2 + [1e-3] * 2 + [1e-1] + [3e-5] * 3 + [0.02] * 3)


@pytest.mark.parametrize("rational", [False, True])
def test_pixels_move_with_the_rig_as_the_slopes_say(rational):
    c, points = 1, POSE.apply(CODED.marker_centres)
    lens = [*BENT, 0.3, 0.1, 0.02] if rational else BENT
    rig = replace(RIG, cameras=tuple(replace(one, distortions=lens) for one in RIG.cameras))
    steps = np.insert(STEPS, 9, [1e-2, 1e-2, 1e-1]) if rational else STEPS
    by_parameters, by_points = sensitivity.pixel_slopes(rig.cameras[c], points)
    for k, step in enumerate(steps):
        delta = step * np.eye(3 * len(steps))[len(steps) * c + k]
        ahead, behind = (displaced(rig, s * delta).cameras[c].project(points) for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(by_parameters[..., k], slope, rtol=1e-5, atol=1e-8)
    for k, shift in enumerate(0.01 * np.eye(3)):
        ahead, behind = (rig.cameras[c].project(points + s * shift) for s in (1, -1))
        np.testing.assert_allclose(by_points[..., k], (ahead - behind) / 0.02, rtol=1e-6, atol=1e-8)


def test_nothing_is_systematic_where_all_is_exact_and_what_is_usual_where_nothing_is_said():
    found = sensitivity.response(np.ones((6, 1, 2)), np.array([0]), np.array([0]), CODED, POSE)
    assert sensitivity.systematic_covariance(found, RIG, CODED) is sensitivity.NOTHING
    usual = replace(RIG, covariance=usual_covariance(RIG))
    silent = sensitivity.systematic_covariance(found, replace(RIG, covariance=None), CODED)
    np.testing.assert_array_equal(silent, sensitivity.systematic_covariance(found, usual, CODED))
    assert silent.any()


def test_a_handle_that_says_nothing_may_be_larger_as_a_whole():
    """Against the pixels of a handle that is larger by a thousandth, about the middle of its markers."""
    exact = replace(RIG, covariance=RigCovariance.exact(RIG.names))
    camera, marker = np.repeat([0, 1, 2], 4), np.tile([0, 1, 2, 3], 3)
    found = sensitivity.response(np.ones((6, 12, 2)), camera, marker, CODED, POSE)
    placed, unplaced = (
        sensitivity.known_errors(found, exact, replace(CODED, placement_sigma_mm=sigma_mm))
        for sigma_mm in (PLACEMENT_MM, None)
    )
    middle = found.points.mean(axis=0)
    px = []
    for share in (1e-3, -1e-3):
        points = middle + (1 + share) * (found.points - middle)
        px.append([RIG.cameras[c].project(X[None])[0] for c, X in zip(camera, points, strict=True)])
    by_share = np.ravel((np.array(px[0]) - px[1]) / 2e-3)
    np.testing.assert_allclose(
        unplaced - placed, SCALE_SHARE**2 * np.outer(by_share, by_share), rtol=1e-4, atol=1e-9
    )


def test_what_cameras_and_views_have_in_common_adds_up():
    """Two views of one camera move together with it, two of one marker with the marker."""
    gain = np.zeros((6, 2, 2))
    gain[0, :, 0] = 1.0  # x by u, both views alike
    sigma = np.zeros(45)
    sigma[[2, 17]] = 0.3  # cx of two cameras, independent
    rig = replace(RIG, covariance=RigCovariance(RIG.names, np.diag(sigma**2)))

    def spread(cameras, markers, rig=rig, handle=CODED):
        found = sensitivity.response(gain, np.array(cameras), np.array(markers), handle, POSE)
        return np.sqrt(sensitivity.systematic_covariance(found, rig, handle)[0, 0])

    assert spread([0, 0], [0, 1]) == pytest.approx(0.6)
    assert spread([0, 1], [0, 1]) == pytest.approx(0.3 * np.sqrt(2))
    assert spread([2, 2], [0, 1]) == 0.0
    placed = replace(CODED, placement_sigma_mm=0.05)
    moves = 0.05 * np.linalg.norm(
        sensitivity.pixel_slopes(RIG.cameras[0], POSE.apply(CODED.marker_centres))[1][0, 0]
    )
    assert spread([0, 0], [0, 0], RIG, placed) == pytest.approx(2 * moves)
    # of a size of three degrees of freedom: t is 1.197 where the normal distribution is 1
    unsure = replace(rig, covariance=replace(rig.covariance, freedom=3.0))
    assert spread([0, 0], [0, 1], unsure) == pytest.approx(0.6 * 1.197, rel=1e-3)
    # both together: independent of each other
    assert spread([0, 0], [0, 0], rig, placed) == pytest.approx(np.hypot(0.6, 2 * moves))
    assert spread([0, 0], [0, 1], RIG, placed) == pytest.approx(np.sqrt(2) * moves, rel=0.02)
    assert spread([0, 0], [-1, -1], RIG, placed) == 0.0


def test_the_papers_pose_answers_to_pixels_as_its_response_says():
    uv = np.stack([facing_pixels(CODED, camera, POSE, 60.0) for camera in RIG.cameras])
    uv += 0.1 * np.random.default_rng(0).standard_normal(uv.shape)
    found = fit_response(uv, RIG, CODED)
    start = fit_pose(uv, RIG, CODED).T_world_handle
    for k in range(0, len(found.camera), 5):
        for d in range(2):
            step = np.zeros_like(uv)
            step[found.camera[k], found.marker[k], d] = 0.05
            there, back = (fit_pose(uv + s * step, RIG, CODED).T_world_handle for s in (1, -1))
            slope = (motion_between(there, start) - motion_between(back, start)) / 0.1
            size = np.repeat([np.linalg.norm(slope[:3]), np.linalg.norm(slope[3:])], 3)
            assert (np.abs(found.gain[:, k, d] - slope) < 0.01 * size).all()


def test_no_response_without_a_pose():
    with pytest.raises(ValueError, match="uv: expected pixels that fix a pose"):
        fit_response(np.full((3, 12, 2), np.nan), RIG, CODED)


def test_images_are_apart_by_what_displaced_rigs_make_of_the_epipolar_distance():
    sigma = np.zeros((2, 15))
    sigma[:, 2:4] = 0.2
    sigma[:, 9:12] = 1e-4
    rig = replace(PAIR, covariance=RigCovariance(PAIR.names, np.diag(sigma.ravel() ** 2)))
    uv = [camera.project([POSE.translation]) for camera in PAIR.cameras]
    moved = [displaced(PAIR, step) for step in np.diag(sigma.ravel())]
    each = [epipolar_distances(*one.cameras, *uv)[0, 0] for one in moved]
    found = sensitivity.offsets_of(rig, uv).apart_px(0, 1)
    # both images have a part in the distance, which is counted in one
    assert found == pytest.approx(np.linalg.norm(each), rel=0.02)


def test_files_say_where_cameras_contradict_each_other():
    good = Pose("measured", POSE, np.eye(6), 0.1, 6, 2)
    wrong = replace(good, systematic=np.eye(6))
    (line,) = contradictions(pose_table([good] * 6 + [wrong] * 4), "a/rig.toml")
    assert line.startswith("a/rig.toml: the cameras contradict each other in 4 of 10 poses")
    assert "rig.covariance.toml" in line
    assert contradictions(pose_table([good] * 10 + [wrong]), "rig.toml") == []


def test_chi_square_and_students_factor_by_the_tables():
    assert not sensitivity.contradict(
        16.8, 6
    )  # 16.81: one in a hundred (Abramowitz and Stegun, table 26.8)
    assert sensitivity.contradict(16.82, 6)
    assert not sensitivity.contradict(1e9, 0)
    # t of one degree of freedom is 1.837 where the normal distribution is 1, of three 1.197
    assert sensitivity.students_factor(1) == pytest.approx(1.837**2, rel=1e-3)
    assert sensitivity.students_factor(3) == pytest.approx(1.197**2, rel=1e-3)
    assert sensitivity.students_factor(np.inf) == 1.0
