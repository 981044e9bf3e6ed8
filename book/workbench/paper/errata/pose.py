"""Errata of Sect. 5.3 and 6.2: from two images to points and a pose, as printed (Eq. 20-25)."""

from __future__ import annotations

from functools import cache

import numpy as np

from trinolab.camera import Rig, T_between
from trinolab.checks import Array
from trinolab.datasets import load_calibration, load_handle, load_rig, load_table1
from trinolab.pose import rigid_fit
from trinolab.rigid import nearest_rotation
from trinolab.triangulation import (
    mean_point,
    points_of_pairs,
    triangulate_pair,
    triangulation_covariance,
)

from ..ledger import Effect

SIGMA_PX = 0.05  # noise of a centroid
EXACT_MM = 1e-6


def printed_points(xy_left: Array, xy_right: Array, R: Array, T: Array, form: int = 0) -> Array:
    """Eq. 20 as printed, for normalised coordinates (f = 1) and any matrix R: points in the left
    frame, shape (n, 3).

    Parameters
    ----------
    xy_left, xy_right : ndarray, shape (n, 2)
        X/f, Y/f.
    R, T : ndarray, shapes (3, 3) and (3,)
        X_r = R X_l + T is what the formula needs, mm.
    form : {0, 1}
        The form of z: by X_r or by Y_r.
    """
    ray = np.column_stack([xy_left, np.ones(len(xy_left))])
    seen = xy_right[:, form]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (T[form] - seen * T[2]) / (seen * (ray @ R[2]) - ray @ R[form])
    return ray * z[:, None]


def direction_of_motion() -> Effect:
    """How far Table 1's positions are missed if R_rl, T_rl of Eq. 25 go straight into Eq. 20
    (Eq. 20).
    """
    left, right = load_rig("paper_pair").cameras
    T = T_between(left, right)  # right to left, as Eq. 25 defines it
    return _on_table1(
        "20", "with R_rl and T_rl of Eq. 25 as they are", T.rotation.as_matrix(), T.translation
    )


def second_form() -> Effect:
    """What noise makes of the second form of z where the baseline runs along X: CCD1 and CCD2
    (Eq. 20).
    """
    return _form("paper_pair", 1, 1, "CCD1 and CCD2, z by the second form")


def first_form() -> Effect:
    """What noise makes of the first form of z where the baseline runs along Y: CCD1 and a raised
    CCD3 (Eq. 20).
    """
    return _form("raised_40deg", 2, 0, "CCD1 and a CCD3 raised by 40 deg, z by the first form")


def one_focal_length() -> Effect:
    """How far Table 1's positions move if each camera has one focal length, the mean of its two
    (Eq. 20).
    """
    left, right = load_rig("paper_pair").cameras
    T = T_between(right, left)
    single = [left.focal / left.focal.mean(), right.focal / right.focal.mean()]
    return _on_table1(
        "20",
        "with the mean of f_x and f_y for the one f of a camera",
        T.rotation.as_matrix(),
        T.translation,
        single,
    )


def change_of_frame() -> Effect:
    """How far points of CCD2's frame miss their place in CCD1's, by what Eq. 20 calls R_rl, T_rl
    (Eq. 21).
    """
    left, right = load_rig("paper_pair").cameras
    points = load_table1().set_poses.translation
    in_ccd2 = right.T_cam_world.apply(points)
    return Effect(
        "21",
        "mean distance from Table 1's positions, carried from CCD2's frame by R_rl and T_rl of Eq. 20",
        "mm",
        _mean_distance(T_between(right, left).apply(in_ccd2), points),
        _mean_distance(T_between(left, right).apply(in_ccd2), points),
        at_most=EXACT_MM,
    )


def plain_mean(draws: int = 20) -> Effect:
    """Rms error of the plain mean over three pairs, against the mean weighted by each pair's
    covariance (Eq. 22).
    """
    rig = load_rig("paper_trinocular")
    points = _markers_of_table1()
    exact = np.stack([camera.project(points) for camera in rig.cameras])
    rng = np.random.default_rng(0)
    drawn = np.stack(
        [points_of_pairs(rig, exact + rng.normal(0, SIGMA_PX, exact.shape)) for _ in range(draws)]
    )
    weights = np.linalg.inv(_covariances_of_pairs(rig, exact))
    weighted = np.linalg.solve(
        weights.sum(axis=0), np.einsum("pnij,dpnj->dni", weights, drawn)[..., None]
    )[..., 0]
    plain = np.stack([mean_point(by_pair) for by_pair in drawn])
    meaning = (
        f"rms error of a marker that CCD1, CCD2 and a CCD3 above see with {SIGMA_PX} px of noise, by the plain "
        "and by a weighted mean; the limit is 1.1 times the Cramer-Rao bound"
    )
    return Effect(
        "22",
        meaning,
        "mm",
        _rms(plain - points),
        _rms(weighted - points),
        at_most=1.1 * _cramer_rao(rig, points),
    )


def four_markers() -> Effect:
    """Determinant of F, solved from four markers of two neighbouring columns (Eq. 24)."""
    printed, fit = _two_poses(4, 0.0)
    return Effect(
        "24",
        "determinant of F, from two columns of two markers without noise",
        "",
        float(np.linalg.det(printed)),
        float(np.linalg.det(fit)),
        1 - 1e-9,
        1 + 1e-9,
    )


def any_matrix() -> Effect:
    """How far the axes of F are from perpendicular, solved from six markers with noise (Eq. 24)."""
    printed, fit = _two_poses(6, 0.05)
    return Effect(
        "24",
        "how far two axes of F are from perpendicular, from three columns with 0.05 mm of noise",
        "deg",
        _skewness_deg(printed[:3, :3]),
        _skewness_deg(fit[:3, :3]),
        at_most=1e-6,
    )


def printed_rotation_error() -> tuple[float, float]:
    """How far the printed R_rl is from the nearest rotation: Frobenius norm, and the largest entry
    (Sect. 6.2).

    Rounding a rotation to four decimals moves it by at most 1.5e-4 in the Frobenius norm, so that
    the nearest rotation would be no farther than that.
    """
    return _from_rotation(load_calibration().R_rl)


def no_rotation() -> Effect:
    """Distance of R_rl from the nearest rotation, before and after it is put there (Sect. 6.2)."""
    R_rl = load_calibration().R_rl
    printed, corrected = (_from_rotation(R)[0] for R in (R_rl, nearest_rotation(R_rl).as_matrix()))
    return Effect(
        "Sect. 6.2",
        "Frobenius distance of R_rl from the nearest rotation; the limit is for rounding",
        "",
        printed,
        corrected,
        at_most=1.5e-4,
    )


def use_of_no_rotation() -> Effect:
    """How far Table 1's positions move if the printed R_rl is used, its transpose as its inverse
    (Sect. 6.2).
    """
    _, _, R_rl, T_rl = load_calibration()
    return _on_table1(
        "Sect. 6.2", "with R_rl as printed, turned round for Eq. 20", R_rl.T, -R_rl.T @ T_rl
    )


def _from_rotation(matrix: Array) -> tuple[float, float]:
    """Distance of a matrix from the nearest rotation: Frobenius norm, and the largest entry."""
    difference = matrix - nearest_rotation(matrix).as_matrix()
    return float(np.linalg.norm(difference)), float(np.abs(difference).max())


def _on_table1(no: str, how: str, R: Array, T: Array, scales: list[Array] | None = None) -> Effect:
    """Mean distance of Table 1's positions from what Eq. 20 makes of their images by R, T and
    scaled coordinates.
    """
    left, right = load_rig("paper_pair").cameras
    points = load_table1().set_poses.translation
    uv = left.project(points), right.project(points)
    factors = scales or [np.ones(2), np.ones(2)]
    printed = printed_points(
        left.normalise(uv[0]) * factors[0], right.normalise(uv[1]) * factors[1], R, T
    )
    return Effect(
        no,
        f"mean distance from Table 1's positions, {how}",
        "mm",
        _mean_distance(printed, points),
        _mean_distance(triangulate_pair(left, right, *uv), points),
        at_most=EXACT_MM,
    )


def _form(rig: str, right_index: int, form: int, how: str) -> Effect:
    """Median error of one form of z under noise, against both forms together."""
    cameras = load_rig(rig).cameras
    points = _markers_of_table1()
    left, right = cameras[0], cameras[right_index]
    rng = np.random.default_rng(0)
    uv = [
        camera.project(points) + rng.normal(0, SIGMA_PX, (len(points), 2))
        for camera in (left, right)
    ]
    T = T_between(right, left)
    printed = printed_points(
        left.normalise(uv[0]), right.normalise(uv[1]), T.rotation.as_matrix(), T.translation, form
    )
    errors = [
        np.linalg.norm(points_of_form - points, axis=1)
        for points_of_form in (left.T_world_cam.apply(printed), triangulate_pair(left, right, *uv))
    ]
    return Effect(
        "20",
        f"median error of a marker with {SIGMA_PX} px of noise, {how}",
        "mm",
        float(np.median(errors[0])),
        float(np.median(errors[1])),
        at_most=0.1,
    )


def _two_poses(markers: int, sigma_mm: float) -> tuple[Array, Array]:
    """F of Eq. 24 (4, 4), solved as printed (the least squares solution of least norm), and by the
    rigid fit.
    """
    model = load_handle("paper").marker_centres[:markers]
    rng = np.random.default_rng(0)
    points = load_table1().set_poses[0].apply(model) + rng.normal(0, sigma_mm, model.shape)
    M, M_model = (np.vstack([x.T, np.ones(markers)]) for x in (points, model))
    fit = rigid_fit(model, points)
    assert fit is not None  # two columns are not on one line
    return M @ np.linalg.pinv(M_model, rcond=1e-9), fit.as_matrix()


def _skewness_deg(axes: Array) -> float:
    unit = axes / np.linalg.norm(axes, axis=0)
    return float(np.rad2deg(np.arcsin(np.abs(unit.T @ unit - np.eye(3)).max())))


def _covariances_of_pairs(rig: Rig, uv: Array) -> Array:
    return np.stack(
        [
            triangulation_covariance(Rig((rig.cameras[i], rig.cameras[j])), uv[[i, j]], SIGMA_PX)
            for i, j in rig.pairs
        ]
    )


def _cramer_rao(rig: Rig, points: Array, step_mm: float = 1e-3) -> float:
    """The least rms error of a point that any unbiased estimate from all images can have, mm."""
    information = np.zeros((len(points), 3, 3))
    for camera in rig.cameras:
        J = np.stack(
            [
                camera.project(points + step) - camera.project(points - step)
                for step in step_mm * np.eye(3)
            ],
            axis=2,
        ) / (2 * step_mm)
        information += J.transpose(0, 2, 1) @ J / SIGMA_PX**2
    return float(np.sqrt(np.trace(np.linalg.inv(information), axis1=1, axis2=2).mean()))


@cache
def _markers_of_table1() -> Array:
    """Centres of all markers in Table 1's poses, hidden ones too, shape (240, 3), mm."""
    centres = load_handle("paper").marker_centres
    return np.concatenate([T.apply(centres) for T in load_table1().set_poses])


def _mean_distance(found: Array, points: Array) -> float:
    return float(np.linalg.norm(found - points, axis=1).mean())


def _rms(errors: Array) -> float:
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))
