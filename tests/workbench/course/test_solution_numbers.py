"""Numbers of ours that a solution has typed: each is computed anew and stands there to the digit."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from scipy.special import j1
from solutions import says, solution

from trinolab import datasets, identity, measurement, metrics, pose, triangulation, workspace
from trinolab.bench import optics, scene
from trinolab.bench.board import Board, board_positions
from trinolab.calibration import adjust
from trinolab.estimators import centroids
from trinolab.estimators.appearance import Views
from trinolab.following import posetracker
from trinolab.handle import facing_pixels
from trinolab.parameters import Parameters
from trinolab.workspace import cones
from workbench import intervals
from workbench.course.exercises.feedback import position_force
from workbench.course.exercises.pose import midpoint
from workbench.studies import (
    ground_truth,
    replication,
    simulated_calibration,
)


def test_volumes_and_shared_markers():
    volumes = [
        workspace.intersect(cones.paper_cones(1.0, *np.deg2rad([b, b, 20]))).volume
        for b in (45, 75)
    ]
    says("02.4", f"from {volumes[0]:.3f} to {volumes[1]:.3f} $B^3$")

    rod, poses = datasets.load_handle("paper"), datasets.load_table1().set_poses
    litres, enough, alone = [], [], []
    for elevation_deg in range(10, 100, 10):
        rig = datasets.paper_rig(elevation_deg)
        seen = workspace.view_volume(rig)
        figures = f"{seen.volume / 1e6:,.1f}"
        if seen.volume > 1e9:
            figures = f"{seen.volume / 1e6:,.0f}"
        litres.append("no end" if seen.status == "unbounded" else figures)
        shared, third_alone = [], []
        for T in poses:
            first, second, third = (
                np.isfinite(facing_pixels(rod, camera, T, 70.0)[:, 0])
                & camera.sees(T.apply(rod.marker_centres))
                for camera in rig.cameras
            )
            shared.append(max((first & third).sum(), (second & third).sum()))
            third_alone.append((third & ~first & ~second).sum())
        enough.append(f"{sum(number >= 4 for number in shared)}")
        alone.append(f"{np.mean(third_alone) + 1e-9:.1f}")  # a half is rounded up
        if elevation_deg == 40:
            says("02.5", f"40° in our standard rig, shares {min(shared)} to {max(shared)}.")
    says("02.5", f"| volume / l | {' | '.join(litres)} |")
    says("02.5", f"| poses of 20 | {' | '.join(enough)} |")
    says("02.5", f"| markers that only CCD3 sees, mean | {' | '.join(alone)} |")


@pytest.mark.heavy
def test_centroids_that_are_moved():
    """Exercise 5.5's rms distances, and the poses, in row 10 with five seeds and in four other rows."""
    rig, handle = datasets.load_rig("paper_pair"), datasets.load_handle("paper")
    epsilon = 0.3
    inwards = j1(2 * epsilon) / (2 * j1(epsilon))

    def before_and_after(row, seed):
        truth = datasets.load_table1().set_poses[row - 1]
        frames = scene.render_rig(rig, handle, truth, optics.Bench(), np.random.default_rng(seed))
        seen = measurement.measure(frames, rig, handle, truth, Parameters(estimator="paper"))
        uv = identity.labelled_pixels(seen.labels, [spots.uv for spots in seen.found], 12)
        T = seen.pose.T_world_handle
        centres = T.apply(handle.marker_centres)
        off, nearer = [], []
        for camera, found in zip(rig.cameras, uv, strict=True):
            e = np.cross(T.rotation.apply([0, 1, 0]), camera.centre - centres)
            e /= np.linalg.norm(e, axis=1, keepdims=True)
            normals = T.rotation.apply(np.array(handle.marker_normals))
            sine = (normals * e).sum(axis=1, keepdims=True)
            inner = camera.project(centres - 5 * sine * (1 - inwards) * e)
            moved = found + camera.project(centres) - inner
            true = camera.project(truth.apply(handle.marker_centres))
            off.append(np.linalg.norm([found - true, moved - true], axis=2))
            nearer.append(moved)
        fits = [
            pose.rigid_fit(handle.marker_centres, triangulation.triangulate(rig, pixels))
            for pixels in (uv, np.stack(nearer))
        ]
        mm = [np.linalg.norm(F.translation - truth.translation) for F in (*fits, T)]
        deg = [np.rad2deg((F.rotation * truth.rotation.inv()).magnitude()) for F in fits]
        return np.sqrt(np.nanmean(np.square(off), axis=(0, 2))), mm, deg

    of_row_10 = [before_and_after(10, seed) for seed in range(5)]
    seeds = np.array([px for px, _, _ in of_row_10])
    says("05.5", f"falls from {seeds[0, 0]:.2f} to {seeds[0, 1]:.2f} px (seeds 0 to 4: ")
    ends = " to ".join(f"{end:.2f}" for end in (seeds[:, 0].min(), seeds[:, 0].max()))
    says("05.5", f"{ends}, and {seeds[:, 1].min():.2f} to {seeds[:, 1].max():.2f} px;")
    of_rows = [before_and_after(row, 0) for row in (1, 5, 9, 13)]
    rows = np.array([px for px, _, _ in of_rows])
    least, most = rows.min(axis=0), rows.max(axis=0)
    says(
        "05.5",
        f"from {least[0]:.2f} to {most[0]:.2f} px down to {least[1]:.2f} to {most[1]:.2f} px",
    )

    _, mm, deg = of_row_10[0]
    says(
        "05.5",
        f"errors of {mm[0]:.2f} mm and {deg[0]:.2f}° before, {mm[1]:.2f} mm and {deg[1]:.2f}° after",
    )
    says("05.5", f"The error of `measure` itself is {mm[2]:.3f} mm in row 10")
    positions = np.array([mm for _, mm, _ in of_rows])
    assert np.all(positions[:, 1] > positions[:, 0])
    before, after, _ = np.sqrt((positions**2).mean(axis=0))
    says("05.5", f"becomes worse (rms {before:.2f} and {after:.2f} mm)")


RIG = datasets.load_rig("paper_pair")


def calibrations(seed, count, square_mm=15.0, bend_mm=0.0):
    """Calibrations from 14 positions of a board, drawn as chapter 7 draws them."""
    board = Board(square_mm=square_mm)
    bent = np.array(board.points)
    x = bent[:, 0] - bent[:, 0].mean()
    bent[:, 2] = bend_mm * (1 - (x / x.max()) ** 2)
    sizes = [camera.size for camera in RIG.cameras]
    found = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        poses = board_positions(RIG, board, 14, rng)
        exact = np.stack([[c.project(T.apply(bent)) for T in poses] for c in RIG.cameras])
        uv = exact + 0.05 * rng.standard_normal(exact.shape)
        found.append(adjust.calibrate(board.points, uv, sizes, RIG.names, distortion_terms=0))
    return found


def cost_mm(found):
    truths = datasets.load_table1().set_poses
    handle = datasets.load_handle("paper")
    return simulated_calibration.calibration_errors(found.rig, RIG, handle, truths).E_t_mm


def chi_square(found):
    T, true = found.cameras[1].T_world_cam, RIG.cameras[1].T_world_cam
    turn = (T.rotation * true.rotation.inv()).as_rotvec()
    off = np.concatenate([T.translation - true.translation, turn])
    return off @ np.linalg.solve(found.relative_covariance(1), off)


def with_interval(values, digits):
    low, high, _ = intervals.of_student(values)
    return f"{np.mean(values):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


PLACES = datasets.load_table1().set_poses


def test_the_midpoint_and_the_point_of_a_pair():
    """Exercise 8.5's rms errors: other draws of as many points come as near as their scatter."""
    rng = np.random.default_rng(0)
    left, right = RIG.cameras
    true = np.repeat(PLACES.translation, 100, axis=0)
    uv = [camera.project(true) + rng.normal(0, 0.1, (2000, 2)) for camera in (left, right)]
    of_pair = triangulation.triangulate_pair(left, right, *uv)
    middles = np.array(
        [
            midpoint(left.centre, ray_left, right.centre, ray_right)
            for ray_left, ray_right in zip(left.rays(uv[0]), right.rays(uv[1]), strict=True)
        ]
    )
    apart = np.linalg.norm(of_pair - middles, axis=1).mean()
    (typed,) = re.findall(r"differs by ([\d.]+) mm on average", solution("08.5"))
    assert apart == pytest.approx(float(typed), abs=0.001)
    typed = re.findall(
        r"([\d.]+), ([\d.]+), ([\d.]+) mm for (?:`point_of_pair`|the midpoint)", solution("08.5")
    )
    for row, points in zip(typed, (of_pair, middles), strict=True):
        rms = np.sqrt(((points - true) ** 2).mean(axis=0))
        # an rms of 2,000 errors scatters by 1.6 %; three times that, and half a digit
        assert np.all(np.abs(rms - np.array(row, float)) < 0.05 * rms + 0.0005)


@pytest.mark.heavy
def test_weights_for_noise_and_for_images():
    """Exercise 8.7: ten seeds of 200 fits, eight of five rendered poses."""
    rig, rod = datasets.load_rig("raised_40deg"), datasets.load_handle("paper")

    def angle_deg(points, truth):
        T = pose.rigid_fit(rod.marker_centres, points)
        return min(np.rad2deg((T.inv() * (truth * S)).rotation.magnitude()) for S in rod.symmetries)

    noise = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        angles = []
        for T in PLACES:
            exact = np.stack([facing_pixels(rod, camera, T, 70.0) for camera in rig.cameras])
            for _ in range(10):
                uv = exact + rng.normal(0, 0.1, exact.shape)
                weighted, _ = triangulation.triangulate_weighted(rig, uv, 0.1)
                ways = triangulation.triangulate(rig, uv), weighted
                angles.append([angle_deg(points, T) for points in ways])
        plain, weighted = np.mean(angles, axis=0)
        noise.append(weighted / plain)
    low, high, _ = intervals.of_student(noise)
    says(
        "08.7",
        f"has {np.mean(noise):.2f} times the error of the plain one (95 %: {low:.2f} to {high:.2f}",
    )

    ratios = []
    for seed in range(8):
        chosen = PLACES[::4]
        angles = []
        for seen, T in zip(
            replication.replicate(chosen, rig, rod, seed, optics.Bench()), chosen, strict=True
        ):
            uv = identity.labelled_pixels(seen.labels, [spots.uv for spots in seen.found], 12)
            weighted, _ = triangulation.triangulate_weighted(rig, uv, 0.1)
            ways = triangulation.triangulate(rig, uv), weighted
            angles.append([angle_deg(points, T) for points in ways])
        plain, weighted = np.mean(angles, axis=0)
        ratios.append(weighted / plain)
    low, high, _ = intervals.of_student(ratios)
    says(
        "08.7",
        f"it has {np.mean(ratios):.2f} times the error of the plain mean ({low:.2f} to {high:.2f}",
    )


def test_the_place_of_a_third_camera():
    """Exercise 10.5's table, by the package's centroids."""
    handle = datasets.load_handle("paper")
    slant = Parameters().max_slant_deg
    rows = {"all cameras": [], "CCD1 hidden": [], "poses with three shared markers": []}
    for elevation_deg in range(0, 120, 15):
        rig = datasets.paper_rig(float(elevation_deg))
        sigmas, shared = [], 0
        for T in PLACES:
            uv = np.stack([facing_pixels(handle, one, T, slant) for one in rig.cameras])
            shared += np.isfinite(uv[1:, :, 0]).all(axis=0).sum() >= 3
            sigmas.append([])
            for hidden in ((), (0,)):
                left = uv.copy()
                left[list(hidden)] = np.nan
                views = Views(*np.nonzero(np.isfinite(left[..., 0])))
                _, J = centroids.predict_centroids(rig, handle, T, views)
                information = np.einsum("vki,vkj->ij", J, J) / 0.012**2
                covariance = np.linalg.inv(information)[:3, :3]
                sigmas[-1].append(1e3 * np.sqrt(np.trace(covariance)))
        for row, worst in zip(("all cameras", "CCD1 hidden"), np.max(sigmas, axis=0), strict=True):
            rows[row].append(f"{worst:.1f}" if worst < 100 else f"{worst:.0f}")
        rows["poses with three shared markers"].append(str(shared))
    for row, figures in rows.items():
        says("10.5", f"| {row} | {' | '.join(figures)} |")


def test_the_motion_the_wrong_way_round():
    """Exercise 7.1: R_rl and T_rl of Eq. 25 put into Eq. 20 as they are."""
    left, right = RIG.cameras
    back = right.T_world_cam  # from right to left, where Eq. 20 wants left to right
    mixed_up = replace(right, T_cam_world=back * left.T_world_cam.inv())
    uv = [camera.project(PLACES.translation) for camera in (left, right)]
    rays = [camera.rays(pixels) for camera, pixels in zip((left, right), uv, strict=True)]
    R, T = mixed_up.T_cam_world.rotation.as_matrix(), mixed_up.T_cam_world.translation
    xy_left = rays[0] / rays[0][:, 2:]
    x_right = right.T_cam_world.rotation.apply(rays[1])
    x_right = x_right[:, 0] / x_right[:, 2]
    a, _, c = (xy_left @ R.T).T
    z = (x_right * T[2] - T[0]) / (a - x_right * c)  # the first form, and no depth is refused
    missed = np.linalg.norm(z[:, None] * xy_left - PLACES.translation, axis=1).mean()
    says("07.1", f"a mix-up costs {missed:.0f} mm on average")


def test_scatters_by_the_formulas_of_chapter_5():
    def scatter(R, sigma):
        return sigma * (R + 2) ** 2 / (2 * np.sqrt(np.pi) * R**2 * 120)

    says("05.1", f"= {scatter(3.9, 3.1):.4f}$ px")
    read_noises = [scatter(7.8, np.sqrt(0.05 * 150 + read**2)) for read in (1.5, 6.0)]
    says("05.4", f"from {read_noises[0]:.4f} to {read_noises[1]:.4f} px.")


@pytest.mark.heavy
def test_a_smaller_board():
    small, usual = calibrations(1703, 30, 7.5), calibrations(1703, 30)
    (small_mm, low, high), (usual_mm, low_usual, high_usual) = (
        (np.mean(costs), *intervals.of_student(costs)[:2])
        for costs in ([cost_mm(one) for one in found] for found in (small, usual))
    )
    says(
        "07.4",
        f"by a factor of {small_mm / usual_mm:.1f}: "
        f"{small_mm:.3f} mm (95 %: {low:.3f} to {high:.3f}) instead of "
        f"{usual_mm:.3f} mm ({low_usual:.3f} to {high_usual:.3f}; n = 30 each, seed 1703)",
    )
    focal_px = [np.mean([one.intrinsic_sigma[:, :2] for one in found]) for found in (usual, small)]
    says("07.4", f"double, from {focal_px[0]:.2f} to {focal_px[1]:.2f} px on average over both")
    depth_mm = [
        np.mean([np.sqrt(one.relative_covariance(1)[2, 2]) for one in found])
        for found in (small, usual)
    ]
    says("07.4", f"a standard deviation {depth_mm[0] / depth_mm[1]:.1f} times as large, ")
    says("07.4", f"as large, {depth_mm[0]:.3f} instead of {depth_mm[1]:.3f} mm.")
    chi = [with_interval([chi_square(one) for one in found], 1) for found in (small, usual)]
    says("07.4", f"stays near 6: {chi[0]} instead of {chi[1]}")
    says("07.2", f"From {usual_mm:.3f} mm at 14 to 0.031 mm is a factor of {usual_mm / 0.031:.1f}")


@pytest.mark.heavy
def test_a_bent_board():
    noises = []
    for bend_mm, chi_digits, digits in ((0, 1, 2), (0.02, 0, 2), (0.05, 0, 2), (0.2, 0, 1)):
        found = calibrations(1703, 6, bend_mm=bend_mm)
        noise = np.mean([one.sigma_px for one in found])
        noises.append(noise)
        chi = np.mean([chi_square(one) for one in found])
        cost = with_interval([cost_mm(one) for one in found], digits)
        says("07.5", f"| {bend_mm} | {noise:.3f} | {chi:.{chi_digits}f} | {cost} |")
    says("07.5", f"the residual has grown by {100 * (noises[1] / noises[0] - 1):.0f} %")
    others = [
        np.mean([cost_mm(one) for one in calibrations(seed, 6, bend_mm=0.2)]) for seed in (0, 1)
    ]
    says("07.5", f"a height of 0.2 mm gives {others[0]:.1f} and {others[1]:.1f} mm")


def test_a_force_that_is_returned():
    """Exercise 12.3: what is felt of the wall without a delay."""
    spring = position_force(np.ones(40_000), 0, 0.0, 1000.0)[-1, 0]
    says("12.3", f"at rest the same {1 / spring:.0f} N/m of the wall")


@pytest.mark.heavy
def test_the_film_with_fewer_frames():
    off_mm, others = {}, {}
    for step in (1, 4, 6, 10):
        clip = ground_truth.read_recording("hard", range(0, 60, step))
        kept, others[step] = [], []
        for now, seen in posetracker.track_instants(clip.instants, clip.rig, clip.handle):
            found = seen.measurement.pose
            if found.status == "measured":
                kept.append((found.T_world_handle, now.T_world_handle))
            else:
                others[step].append((now.frame, found.status))
        errors = metrics.pose_errors(*map(RigidTransform.concatenate, zip(*kept, strict=True)))
        off_mm[step] = len(kept), f"{errors.E_t_mm:.3f} mm"
    for step, count in ((1, 60), (4, 15), (6, 10)):
        number, mean = off_mm[step]
        predicted = f"{len(others[step])} predicted" if others[step] else ""
        cell = f"| {step} | {count} | {number} | {predicted} | {mean} |"
        says("01.5", cell.replace("|  |", "| |"))
    says("01.5", f"at step 10, with {off_mm[10][0]} of 6 measured, it is {off_mm[10][1]}")
    assert others[4] == [(52, "predicted"), (56, "predicted")]
    assert others[6] == [(54, "predicted")]
    says("01.5", "frames 52 and 56 at step 4 and frame 54 at step 6 are only predicted")
