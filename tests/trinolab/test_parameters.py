"""Every threshold of identification and following is a parameter, and each one decides
something.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
from markerviews import CODED, PAPER, RIG, TRIO, good_poses, views, without
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scenario import Job, Shot, take
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig, RigCovariance
from trinolab.following import posefilter, posetracker
from trinolab.following.look import Guess, Setup, displacement, expect, follow
from trinolab.following.parameters import FollowParameters
from trinolab.identity import equivalents, identify
from trinolab.identity.ends import keep_by_body
from trinolab.identity.parameters import IdentityParameters
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from trinolab.pose import Pose
from trinolab.rigid import shifted

# Looks the same in two ways, end for end: the body decides.
ROD = replace(PAPER, columns_deg=(60.0, 130.0, 180.0, 230.0, 300.0), rows_mm=((10.0, -10.0),) * 5)
LYING = RigidTransform.from_components(
    [15.0, -10.0, 560.0], Rotation.from_euler("ZYX", [70, 20, 10], degrees=True)
)
STANDING = RigidTransform.from_components(
    [-20.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 10.0], degrees=True)
)
VELOCITY = np.array([350.0, -120.0, 60.0, 0.3, 0.2, -0.4])  # mm/s, rad/s

# Each field of the identification: another value, where it makes a difference, and what else is
# given then.
IDENTITY = {
    "gate_px": (0.3, "three", {}),
    "sigma_px": (0.01, "three", {}),
    "min_markers": (14, "three", {}),
    "max_residual_px": (0.01, "three", {}),
    "tried_per_marker": (1, "outliers first", {}),
    "max_apart_deg": (30.0, "three", {}),
    "max_pairs": (3, "three", {}),
    "max_single": (3, "one", {}),
    "side_sigmas": (0.01, "three", {}),
    "away_cosine": (-0.9, "three", {}),
    "seeds_kept": (1, "three", {}),
    "depth_range": (0.0, "face to face", {}),
    "depth_step": (0.02, "face to face", {}),
    "fit_gates": ((0.2,), "three", {}),
    "enough_evidence": (-1e6, "outliers", {}),
    "steep_deg": (60.0, "three", {}),
    "certain_deg": (5.0, "four markers", {}),
    "edge_px": (400.0, "four markers", {}),
    "chance": (1e-300, "one", {}),
    "missing_share": (50.0, "four markers", {}),
    "size_sigma": (0.01, "three", {}),
    "roundness_sigma": (0.01, "three", {}),
    "decisive_variances": (1e-9, "four markers", {}),
    "same_pose_deg": (180.0, "four markers", {}),
    "end_step_mm": (1e3, "body", {}),
    "end_reach_mm": (1.0, "body", {"end_run": 6}),
    "end_run": (1000, "body", {}),
    "end_contrast": (255.0, "body", {}),
    "end_lead": (1.0, "body", {}),
}
FOLLOW = {
    "exposure_s": (0.1, "blurred", {}),
    "expected_slant_deg": (40.0, "still", {}),
    "rate_noise_mm_s": (0.0, "blurred", {}),
    "rate_noise_rad_s": (0.0, "blurred", {}),
    "blurred_px": (1e3, "blurred, as if still", {}),
    "blurred_length": (0.1, "still", {}),
    "still_misfit": (1e-3, "one", {"blurred_px": 0.0}),
    "max_fit_residual_px": (1e-3, "one", {}),
    "max_sigma_mm": (1e-4, "still", {}),
    "max_sigma_deg": (1e-4, "still", {}),
    "agreed_mm": (0.0, "still", {}),
    "agreed_deg": (0.0, "still", {}),
    "min_found": (1000, "blurred", {}),
    "min_shown_share": (1.0, "one", {}),
    "search_px": (3.0, "shift", {}),
    "search_step_px": (5, "shift", {}),
    "min_response": (1e3, "shift", {}),
    "shift_sigma_px": (1.0, "shift", {}),
    "shift_agreement_px": (0.0, "shift", {}),
    "gate_all_sigmas": (0.0, "all", {"gate_all_mm": 0.0}),
    "gate_all_mm": (0.0, "all", {"gate_all_sigmas": 0.0}),
    "gate_all_deg": (0.0, "all", {"gate_all_sigmas": 0.0}),
    "gate_some_sigmas": (0.0, "some", {"gate_some_mm": 0.0}),
    "gate_some_mm": (0.0, "some", {"gate_some_sigmas": 0.0}),
    "gate_some_deg": (0.0, "some", {"gate_some_sigmas": 0.0}),
    "gate_alike_deg": (0.0, "all", {}),
}


def test_the_tables_name_every_field():
    assert set(IDENTITY) == {field.name for field in fields(IdentityParameters)}
    own = {field.name for field in fields(FollowParameters)} - {
        field.name for field in fields(Parameters)
    }
    # how much work an instant may take decides in `posetracker.step`: see test_posetracker
    assert set(FOLLOW) == own - {"motion", "most_work"}


@pytest.fixture(scope="module")
def found():
    """Found markers and their axes: by three cameras, by one, with outliers, four in one plane,
    from two sides.
    """
    T, rng = next(good_poses(CODED, 1, 4, TRIO))
    uv, axes, _ = views(T, CODED, rng, TRIO)
    stray = [rng.uniform(0, 1024, (40, 2)) for _ in uv]
    size = np.full((40, 2), 12.0)
    scenes = {
        "three": (TRIO, uv, axes),
        "one": (TRIO, without(uv, 1, 2), without(axes, 1, 2)),
        "outliers": (TRIO, stacked(uv, stray), stacked(axes, [size] * 3)),
        "outliers first": (
            TRIO,
            stacked([part[:14] for part in stray], uv),
            stacked([size[:14]] * 3, axes),
        ),
    }
    T, rng = next(good_poses(CODED, 1, 6))
    uv, axes, _ = views(T, CODED, rng, RIG, limit_deg=70.0)
    scenes["four markers"] = (
        RIG,
        without([part[:4] for part in uv], 1),
        without([part[:4] for part in axes], 1),
    )
    behind = RigidTransform.from_components(
        [0.0, 0.0, 1140.0], Rotation.from_euler("y", 180, degrees=True)
    )
    turned = replace(RIG.cameras[1], T_cam_world=behind.inv())
    two_sides = Rig((RIG.cameras[0], turned), RigCovariance.exact(RIG.names))
    T = RigidTransform.from_components(
        [5.0, 8.0, 570.0], Rotation.from_euler("ZYX", [80, 20, 8], degrees=True)
    )
    scenes["face to face"] = two_sides, *views(T, CODED, rng, two_sides, limit_deg=70.0)[:2]
    return scenes


def stacked(first, second):
    return tuple(map(np.vstack, zip(first, second, strict=True)))


@pytest.fixture(scope="module")
def lying():
    return render_rig(RIG, ROD, LYING, Bench(), np.random.default_rng(0))


@pytest.mark.parametrize("name", IDENTITY)
def test_each_number_of_the_identification_decides_something(name, found, lying):
    value, scene, given = IDENTITY[name]

    def outcome(p):
        if scene == "body":
            return keep_by_body(lying, RIG, ROD, equivalents(LYING, ROD), p).tolist()
        rig, uv, axes = found[scene]
        return [
            (one.cost, one.cameras, [row.tolist() for row in one.labels])
            for one in identify(rig, CODED, uv, p, axes)
        ]

    p = IdentityParameters(**given)
    assert outcome(replace(p, **{name: value})) != outcome(p)


def test_they_are_reached_through_the_parameters_of_a_measurement(lying):
    p = Parameters(estimator="paper")
    assert measure(lying, RIG, ROD, parameters=p).pose.status == "measured"
    for change, status in (({"min_markers": 99}, "lost"), ({"end_contrast": 255.0}, "ambiguous")):
        changed = replace(p, identity=replace(IdentityParameters(), **change))
        assert measure(lying, RIG, ROD, parameters=changed).pose.status == status


@pytest.fixture(scope="module")
def images():
    rng = np.random.default_rng(1)
    still = render_rig(TRIO, CODED, STANDING, Bench(), rng)
    shot = Shot(STANDING, None, (1.0,) * 3, VELOCITY[:3], VELOCITY[3:], False)
    blurred = [take(Job(TRIO, CODED, [shot], np.zeros(1), 0), 0, c) for c in range(3)]
    return {"still": still, "one": [still[0], 0 * still[1], 0 * still[2]], "blurred": blurred}


def moving(velocity, sigma=1.0):
    """The standing handle in motion; `sigma` is how badly its rates are known, 1 as at the start of
    a track.
    """
    p = FollowParameters().motion
    motion = posefilter.begin(0.0, STANDING, np.diag(np.repeat([0.1, 0.01], 3) ** 2), p)
    covariance = motion.covariance.copy()
    covariance[6:, 6:] *= sigma**2
    return motion._replace(rates=np.concatenate([velocity, np.zeros(6)]), covariance=covariance)


def followed(images, scene, p):
    """What is decided of a scene, as plain numbers."""
    setup = Setup(TRIO, CODED, p)
    if scene in ("all", "some"):
        aside = shifted(STANDING, np.array([0.3, 0.0, 0.0, 0.0, 0.01, 0.0]))
        pose = Pose("measured", aside, np.eye(6), 0.1, 8, 3 if scene == "all" else 2)
        return posetracker.believable(pose, moving(np.zeros(6)), Setup(TRIO, PAPER, p))
    if scene == "shift":
        motion = moving(np.zeros(6))
        off = motion._replace(pose=shifted(STANDING, np.array([4.0, -3.0, 0.0, 0.0, 0.0, 0.0])))
        found = displacement(images["still"], expect(setup, off), off.pose.translation, setup)
        return None if found is None else [part.tolist() for part in found]
    motion = moving(VELOCITY, 0.1) if scene.startswith("blurred") else moving(np.zeros(6))
    guess = Guess(motion, expect(setup, motion), blurred=scene == "blurred")
    pose = follow(images[scene.split(",")[0]], guess, setup).pose
    return (
        pose.status,
        None if pose.T_world_handle is None else pose.T_world_handle.as_matrix().tolist(),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", FOLLOW)
def test_each_number_of_the_follower_decides_something(name, images):
    value, scene, given = FOLLOW[name]
    p = FollowParameters(**given)
    assert followed(images, scene, replace(p, **{name: value})) != followed(images, scene, p)


@pytest.mark.parametrize("kind", [IdentityParameters, FollowParameters])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e9, "1", None])
def test_what_is_no_number_in_range_is_refused_by_name(kind, bad):
    for name in IDENTITY if kind is IdentityParameters else FOLLOW:
        if (name, bad) != ("enough_evidence", -1e9):
            with pytest.raises(ValueError, match=name):
                kind(**{name: bad})


def test_angles_and_gates_fit_together():
    with pytest.raises(ValueError, match="certain_deg"):
        IdentityParameters(certain_deg=75.0)
    with pytest.raises(ValueError, match="fit_gates"):
        IdentityParameters(fit_gates=())
    with pytest.raises(ValueError, match="fit_gates"):
        IdentityParameters(fit_gates=(4.0, 0.0))
    with pytest.raises(TypeError, match="gate_pxx"):
        IdentityParameters(gate_pxx=1.0)
