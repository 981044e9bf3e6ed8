"""The pose that fits the markers' pixels in all views at once, with its covariance: beyond the
paper (Sect. 5.3).

Without centroids, pairs of cameras or triangulated points, Gauss-Newton steps estimate greys, the
cameras' blurs and the pose together, from a pose that is right to about a pixel. A marker that a
single camera sees counts as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..datasets import load_handle, load_rig, load_table1
from ..handle import Handle
from ..rigid import placed, rotation_matrix, rotation_of
from ..sensitivity import Response, slopes_at
from ..uncertainty.assessment import LinearFit
from ..uncertainty.centroids import pulled_alike
from ..work import Work
from .appearance import Views
from .imagemodel import (
    LEAST_GAIN,
    Linear,
    MotionBlur,
    Reduced,
    State,
    advanced,
    first_state,
    has_contrast,
    inverse,
    limited,
    linearise,
    longer_than_wide,
    marker_is_shown,
    misfit,
    noise_of,
    reduce,
    shows_gloss,
    with_gloss,
)
from .movingmodel import linearise_moving
from .patches import Patches, moving_patches, patches
from .rows import BLUR, EXPOSURE, POSE

# by so much the image model misplaces a marker of the simulated bench, shading and all
FLOOR_PX = 0.003
MOST_STEPS = 8  # Gauss-Newton steps; two do where two cameras share markers
# a step that moves all markers by less is the last one: the next would move them by a hundredth
CONVERGED_PX = 0.1
# The same of a handle that moves: smeared markers are seen less exactly, and not in each direction.
CONVERGED_MOVING_PX = 0.3
# A step is the last one if it is short, or the next one would be: each is shorter by the same share.
CONVERGED_SIGMAS = 1.0
NEXT_SIGMAS = 0.4
LARGEST_STEP = np.repeat([5.0, 0.3], 3)  # mm, rad; the image model holds within a few pixels
BLUR_FLOOR = 0.001  # and this share of the way that it moves while the shutter is open


class Round(NamedTuple):
    """A round of steps in the same windows: most cells of all windows, and most steps."""

    cells: int
    steps: int


# work of a step for a cell, in units of `work.Work`
MOVING_CELL = 1e-3
STILL_CELL = 0.7e-3
# of a handle that moves: from a start that is some pixels off, and to the end
COARSE = Round(5_000, 3)
FINE = Round(18_000, 5)
# A handle that moves has to gain more by gloss than one that is still, since its smear is described less
# exactly: on the bench it is up to 4.5 but for 2 of 207 instants, on a film of varnish, smeared by up to
# 7 px, 7.6 to 54 (22 instants). Where it is smeared by 30 px it is 14 without any gloss, and gloss would
# cost a tenth.
LEAST_GAIN_MOVING = 6.0
SMEARED_PX = 20.0


class Fit(NamedTuple):
    """A pose that fits all views.

    Attributes
    ----------
    T_world_handle : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame.
    views : Views
    misfit : ndarray, shape (k,)
        Reduced chi-square of each view: about 1 where it shows what the pose predicts.
    shown : ndarray of bool, shape (k,)
        Whether there is a marker like the others at all.
    residual_px : float
        Rms distance of the markers shown from where the pose predicts them.
    linear : LinearFit
        To first order, for `uncertainty.assess`.
    smear_px : float
        Length of the markers' smear in the camera in which it is longest: from the motion of a
        moving handle, and for one at rest where motion blur was measured; else NaN.
    """

    T_world_handle: RigidTransform
    covariance: Array
    views: Views
    misfit: Array
    shown: np.ndarray
    residual_px: float
    linear: LinearFit
    smear_px: float = np.nan


class _Step(NamedTuple):
    """A Gauss-Newton step of pose and blurs.

    Attributes
    ----------
    windows : Patches
    before, after : State
    step : ndarray
        Of all unknowns.
    sigmas : float
        Length of the pose's step in its own standard deviations.
    model : Linear
        After the step, to first order.
    normal : Reduced
        The windows' normal equations.
    contrast : ndarray of bool, shape (k,)
        Whether a window shows anything like a marker.
    weight : ndarray, shape (k,)
        Of each window.
    information : ndarray
        On all unknowns, by these weights.
    converged : bool
        Whether the next step would hardly move the pose.
    """

    windows: Patches
    before: State
    after: State
    step: Array
    sigmas: float
    model: Linear
    normal: Reduced
    contrast: np.ndarray
    weight: Array
    information: Array
    converged: bool = True


def fit_patches(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    start: RigidTransform,
    max_slant_deg: float = 72.0,
    motion_blur: tuple[Array, Array] | None = None,
    smear_above: float = np.inf,
    is_far: bool = False,
    work: Work | None = None,
) -> Fit | None:
    """Improve a pose by the pixels about all markers that it shows.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        Grey levels 0 to 255, one image per camera.
    rig : Rig
    handle : Handle
    start : RigidTransform
        T_world_handle, right to about a pixel in every image.
    max_slant_deg : float
        Markers turned further away are left out.
    motion_blur : (ndarray, ndarray), shapes (6,) and (6, 6), optional
        The motion expected while the shutter is open (mm, rad; world frame), and its covariance;
        without it the handle is at rest.
    smear_above : float
        Median misfit above which `Fit.smear_px` is measured for a handle at rest.
    is_far : bool
        Whether the start of a handle that moves may be several pixels off: coarse cells come first.
    work : Work, optional
        The work that the steps may take; unlimited without it.

    Returns
    -------
    Fit or None
        None if too little is in view to fix a pose, no view shows a marker, the steps lead away, or
        there is no work left for one.
    """
    work = work or Work()
    if motion_blur is not None:
        rounds = (COARSE, FINE) if is_far else (FINE,)
        return _moving_fit(images, rig, handle, start, max_slant_deg, motion_blur, rounds, work)
    windows = patches(images, rig, handle, start, max_slant_deg)
    last = _fitted(first_state(start, rig), windows, rig, handle, MOST_STEPS, work)
    return None if last is None else _fit_of(last, rig, handle, smear_above)


@cache
def prepare() -> None:
    """Load the compiled loops, or compile them where that was never done: by a fit of a shipped rig
    to dark images, once in a process.
    """
    rig, handle = load_rig("paper_pair"), load_handle("coded")
    dark = [np.zeros(camera.size[::-1], np.uint8) for camera in rig.cameras]
    T_world_handle = load_table1().set_poses[0]
    fit_patches(dark, rig, handle, T_world_handle)
    fit_patches(dark, rig, handle, T_world_handle, motion_blur=(np.ones(6), np.eye(6)))


def _moving_fit(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    start: RigidTransform,
    max_slant_deg: float,
    motion_blur: tuple[Array, Array],
    rounds: Sequence[Round],
    work: Work,
) -> Fit | None:
    """The fit of a handle that moves while the shutter is open, in rounds: the windows of each lie
    where the one before has the markers.
    """
    expected, covariance = motion_blur
    blur = MotionBlur(expected, expected, inverse(covariance))
    state = first_state(start, rig, blur)
    *coarser, finest = rounds
    for most in coarser:
        windows = _moving_windows(images, state, max_slant_deg, rig, handle, most)
        step = _stepped(state, windows, rig, handle, most.steps, work)
        if step is None:
            return None
        # greys are those of other windows
        state = step.after._replace(greys=None)
    windows = _moving_windows(images, state, max_slant_deg, rig, handle, finest)
    step = _fitted(state, windows, rig, handle, finest.steps, work)
    return None if step is None else _fit_of(step, rig, handle)


def _moving_windows(
    images: Sequence[np.ndarray],
    state: State,
    max_slant_deg: float,
    rig: Rig,
    handle: Handle,
    most: Round,
) -> Patches:
    """The windows of a round, which lie where the state has the markers."""
    assert state.motion_blur is not None
    T = state.T_world_handle
    motion = state.motion_blur.motion
    return moving_patches(images, rig, handle, T, max_slant_deg, motion, most.cells)


def _fitted(
    state: State, windows: Patches, rig: Rig, handle: Handle, most_steps: int, work: Work
) -> _Step | None:
    """As `_stepped`, once more with gloss where the windows show it and enough work remains."""
    last = _stepped(state, windows, rig, handle, most_steps, work)
    if last is None:
        return None
    least_gain = LEAST_GAIN
    if state.motion_blur is not None:
        smear_px = _longest_way_px(windows, state.motion_blur.motion)
        # the residuals of a long step or a long smear look like gloss
        if not last.converged or smear_px > SMEARED_PX:
            return last
        least_gain = LEAST_GAIN_MOVING
    has_work = work.remaining >= 2 * _units(state, windows)
    if not has_work or not shows_gloss(last.model, handle, least_gain):
        return last
    return _stepped(with_gloss(last.after), windows, rig, handle, most_steps, work)


def _units(state: State, windows: Patches) -> float:
    """The work of a step."""
    return windows.drawn.xy[0].size * (STILL_CELL if state.motion_blur is None else MOVING_CELL)


def _stepped(
    state: State, windows: Patches, rig: Rig, handle: Handle, most_steps: int, work: Work
) -> _Step | None:
    """The last of at most so many steps, while the pose moves and work remains; None if there is
    none, too little is in view, or the steps lead away.
    """
    if len(np.unique(windows.views.marker)) < 3:
        return None
    last = None
    converged = False
    for _ in range(most_steps):
        if converged or not work.takes(_units(state, windows)):
            break
        before = last
        last = _step_from(state if before is None else before.after, windows, rig, handle)
        # a step that is too long, or not a number, leads away
        if not np.abs(last.step[:6] / LARGEST_STEP).max() < 1:
            return None
        converged = before is not None and _has_converged(last, before, handle)
    return last and last._replace(converged=converged)


def _has_converged(last: _Step, before: _Step, handle: Handle) -> bool:
    """Whether the step after the `last` one, which followed `before`, would hardly move the pose."""
    windows = last.windows
    arms = handle.marker_centres[windows.views.marker]
    ways_mm = np.linalg.norm(last.step[:3] + np.cross(last.step[3:6], arms), axis=1)
    moved_px = float((ways_mm * windows.px_per_mm).max())
    if last.before.motion_blur is None:
        return moved_px < CONVERGED_PX
    is_short = last.sigmas < CONVERGED_SIGMAS or last.sigmas**2 < NEXT_SIGMAS * before.sigmas
    return moved_px < CONVERGED_MOVING_PX and is_short


def _fit_of(last: _Step, rig: Rig, handle: Handle, smear_above: float = np.inf) -> Fit | None:
    """The pose of the last step with its covariance, and which views show a marker; None if none does."""
    last = _weighed_again(last, rig)
    after = last.after
    T = after.T_world_handle
    windows = last.windows
    visible = marker_is_shown(last.model, handle)
    # the contrast is older than the step
    used = visible & (last.weight > 0)
    if not used.any():
        return None
    spread = float(np.median(misfit(last.model)[visible]))
    # where the steps ran out, the pose is still off by as many sigmas as the last one was long
    truncation = 0.0 if last.converged else last.sigmas
    covariance = in_world((1 + truncation**2) * spread * inverse(last.information)[:6, :6], T)
    motions = _motions(windows, rig, T)
    information = _information_px(last.normal, motions)
    sensitivity = _response(last, motions, rig, T)
    pulls = _pulls(last, information, rig, handle, T)
    covariance = covariance + sensitivity.covariance_by(pulls)
    rows = used.repeat(2)
    explained = _explained(last, motions, information, rig)
    linear = LinearFit(
        T,
        covariance,
        sensitivity.part(used),
        _shifts(last, motions, information, rig)[used],
        _noise(last, information, spread, pulls)[np.ix_(rows, rows)],
        explained[used].reshape(int(rows.sum()), explained.shape[2]),
    )
    residuals_px = _remaining_shift_mm(last, rig) * windows.px_per_mm
    smear_px = np.nan
    if after.motion_blur is not None:
        smear_px = _longest_way_px(windows, after.motion_blur.motion)
    elif spread >= smear_above:
        smear_px = _smear_px(last, rig)
    fit = fit_from(linear, windows.views, last.model, visible, residuals_px)
    return fit._replace(smear_px=smear_px)


def _pulls(
    last: _Step, information: Array, rig: Rig, handle: Handle, T_world_handle: RigidTransform
) -> Array:
    """Covariance of all windows' places by greys that are not as predicted, see
    `centroids.pulled_alike`. The information (k, 2, 2) is that of `_information_px`.
    """
    more = np.maximum(misfit(last.model) - 1, 0.0)
    more_px2 = more[:, None, None] * np.linalg.inv(information)
    return pulled_alike(*last.windows.views, more_px2, T_world_handle, rig, handle)


def _longest_way_px(windows: Patches, motion: Array) -> float:
    """The longest distance that a motion (6,) moves a window while the shutter is open, px."""
    return float(np.linalg.norm(windows.ways_px(motion), axis=1).max())


def _smear_px(last: _Step, rig: Rig) -> float:
    """Length of the motion blur in the camera where it is longest, px, whatever motion causes it.

    To second order a smear of length w along a direction adds w^2/12 to the blur's variance there:
    a round blur of w^2/24, and w^2/24 by which it is longer than wide. The latter, upright and along
    the diagonals, is two more unknowns per camera in the last step; the former is in the blur that
    each fit determines.
    """
    windows, model, weight = last.windows, last.model, last.weight
    camera = windows.views.camera
    # in rows that a still handle leaves free
    model.rows[:, EXPOSURE : EXPOSURE + 2] = longer_than_wide(model.predicted, windows.at)
    normal = reduce(model, np.r_[POSE : POSE + 6, EXPOSURE, EXPOSURE + 1, BLUR])
    information = 1e-12 * np.eye(6 + 3 * len(rig.cameras))
    gradient = np.zeros(len(information))
    for c in range(len(rig.cameras)):
        mine = camera == c
        own = np.r_[:6, 6 + 3 * c : 9 + 3 * c]  # the pose, and what is this camera's
        information[np.ix_(own, own)] += np.tensordot(weight[mine], normal.information[mine], 1)
        gradient[own] += weight[mine] @ normal.gradient[mine]
    upright, diagonal, _ = (inverse(information) @ gradient)[6:].reshape(-1, 3).T
    return float(np.sqrt(24 * np.hypot(upright, diagonal)).max())


def _response(last: _Step, motions: Array, rig: Rig, T: RigidTransform) -> Response:
    """Derivative of the pose by shifts of its windows: a shift is the motion of the handle that
    moves the window alike, see `_motions`.
    """
    windows = last.windows
    spread = inverse(last.information)[:6]
    by_motion = last.weight[:, None, None] * (last.normal.information[:, :, :3] @ motions)
    by_common = spread[:, : by_motion.shape[1] - 1]
    by_blur = spread[:, -len(rig.cameras) :][:, windows.views.camera]
    gain = np.einsum("am,kmd->akd", by_common, by_motion[:, :-1])
    gain = gain + by_blur[..., None] * by_motion[:, -1]
    return Response(
        np.einsum("ab,bkd->akd", both_in_world(T), gain),
        windows.views.camera,
        T.apply(windows.points),
        windows.views.marker,
    )


def _shifts(last: _Step, motions: Array, information: Array, rig: Rig) -> Array:
    """Shifts of the windows that their remaining gradients imply after the last step, (k, 2), px."""
    own = _own(last.step, last.windows.views.camera, rig)
    gradient = motions.mT @ _remaining_gradient(last.normal, own)[..., None]
    return np.asarray(np.linalg.solve(information, gradient)[..., 0])


def _noise(last: _Step, information: Array, spread: float, pulls: Array) -> Array:
    """Covariance of the windows' places, (2 k, 2 k), px^2: by their noise, and by what columns of
    them have in common.
    """
    k = len(information)
    weight = np.maximum(last.weight, 1e-12) / spread
    each = np.arange(k)
    blocks = np.zeros((k, 2, k, 2))
    blocks[each, :, each] = np.linalg.inv(weight[:, None, None] * information)
    return np.asarray(blocks.reshape(2 * k, -1) + pulls)


def _explained(last: _Step, motions: Array, information: Array, rig: Rig) -> Array:
    """The shifts that windows answer to a motion of the handle, to its motion blur, and to their
    camera's blur: (k, 2, m).

    A window knows more than its shift: its answer is that of its own least squares.
    """
    camera = last.windows.views.camera
    sensitivity = np.linalg.solve(information, motions.mT @ last.normal.information[:, :3])
    mine = (camera[:, None] == np.arange(len(rig.cameras)))[:, None]
    return np.concatenate([sensitivity[:, :, :-1], sensitivity[:, :, -1:] * mine], axis=2)


def _information_px(normal: Reduced, motions: Array) -> Array:
    """Information of each window by shifts along u and along v, (k, 2, 2), px^-2, of `_motions`."""
    return motions.mT @ normal.information[:, :3, :3] @ motions + 1e-12 * np.eye(2)


def _motions(windows: Patches, rig: Rig, T: RigidTransform) -> Array:
    """The shortest motions of the handle, in its frame, that shift windows by a pixel along u and
    along v, (k, 3, 2), mm/px.
    """
    by_points = slopes_at(rig, windows.views.camera, T.apply(windows.points))[1]
    return np.linalg.pinv(by_points @ T.as_matrix()[:3, :3])


def _step_from(state: State, windows: Patches, rig: Rig, handle: Handle) -> _Step:
    """One step of pose, blurs, noise and greys."""
    T = state.T_world_handle
    model_of = linearise if state.motion_blur is None else linearise_moving
    model = model_of(state, windows, rig, handle)
    normal = reduce(model, model.unknowns)
    # windows that show no marker would only fit their noise
    contrast = has_contrast(model, handle)
    weight = _weights(windows, model, normal, state) * contrast
    information, gradient = _normal_equations(normal, weight, windows, state, rig)
    spread = inverse(information)
    step = spread @ gradient
    sigmas = float(np.sqrt(np.maximum(step[:6] @ inverse(spread[:6, :6]) @ step[:6], 0.0)))
    model = advanced(model, normal, _own(step, windows.views.camera, rig))
    motion_blur = state.motion_blur
    if motion_blur is not None:
        motion = motion_blur.motion + both_in_world(T) @ np.nan_to_num(step[6:12])
        motion_blur = motion_blur._replace(motion=motion)
    T = moved(T, np.nan_to_num(step[:6]))
    noise = noise_of(model, windows.at.pixels, contrast)
    blur = limited(state.blur_px2, step[-len(rig.cameras) :])
    after = State(T, model.greys, blur, noise, motion_blur)
    return _Step(windows, state, after, step, sigmas, model, normal, contrast, weight, information)


def _weighed_again(last: _Step, rig: Rig) -> _Step:
    """The step with weights by its misfits, which may be smaller than those before it."""
    weight = _weights(last.windows, last.model, last.normal, last.before) * last.contrast
    information, _ = _normal_equations(last.normal, weight, last.windows, last.before, rig)
    return last._replace(weight=weight, information=information)


def _weights(windows: Patches, model: Linear, normal: Reduced, state: State) -> Array:
    """Weight of each window, shape (k,): less where it does not fit, has its pixels in common with
    others, or claims to know its place to below the floor.
    """
    way_mm = 0.0 if state.motion_blur is None else np.linalg.norm(state.motion_blur.motion[:3])
    floor_px = FLOOR_PX + BLUR_FLOOR * way_mm * windows.px_per_mm
    per_px2 = np.trace(normal.information[:, :3, :3], axis1=1, axis2=2)
    per_px2 = per_px2 / (2 * windows.px_per_mm**2)
    return windows.alone / np.maximum(misfit(model), 1.0) / (1 + floor_px**2 * per_px2)


def _normal_equations(
    normal: Reduced, weight: Array, windows: Patches, state: State, rig: Rig
) -> tuple[Array, Array]:
    """Information and gradient of pose and blurs over all windows, with what was expected of the
    motion blur.
    """
    information, gradient = _assembled(normal, weight, windows.views.camera, rig)
    information += 1e-12 * np.eye(len(gradient))
    if state.motion_blur is not None:
        _expect(information, gradient, state.motion_blur, state.T_world_handle)
    return information, gradient


def _expect(
    information: Array, gradient: Array, motion_blur: MotionBlur, T_world_handle: RigidTransform
) -> None:
    """Add what was expected of the motion blur to the normal equations, whose unknowns 6 to 11 it
    is (handle frame).
    """
    turn = both_in_world(T_world_handle)
    information[6:12, 6:12] += turn.T @ motion_blur.information @ turn
    gradient[6:12] += turn.T @ motion_blur.information @ (motion_blur.expected - motion_blur.motion)


def fit_from(
    linear: LinearFit, views: Views, at: Linear, shown: np.ndarray, residuals_px: Array
) -> Fit:
    """A fit with the rms of the residuals (k,) over the views that show a marker."""
    residual = float(np.sqrt(np.mean(residuals_px[shown] ** 2)))
    T, covariance = linear.T_world_handle, linear.covariance
    return Fit(T, covariance, views, misfit(at), shown, residual, linear)


def moved(T_world_handle: RigidTransform, step: Array) -> RigidTransform:
    """A pose after a small motion (nu mm, omega rad) in the handle's own frame."""
    R = rotation_of(T_world_handle)
    return placed(T_world_handle.translation + R @ step[:3], R @ rotation_matrix(step[3:]))


def _own(step: Array, camera: np.ndarray, rig: Rig) -> Array:
    """A step of all unknowns as one for each window: pose, any motion blur, its camera's blur;
    shape (k, 7 or 13).
    """
    common, blurs = np.split(step, [-len(rig.cameras)])
    return np.column_stack([np.broadcast_to(common, (len(camera), len(common))), blurs[camera]])


def _remaining_gradient(normal: Reduced, step: Array) -> Array:
    """Gradient by position that each window has left after a step (k, m) of its unknowns, shape (k,
    3).
    """
    return normal.gradient[:, :3] - (normal.information[:, :3] @ step[..., None])[..., 0]


def _remaining_shift_mm(last: _Step, rig: Rig) -> Array:
    """Distance by which each marker's window alone would still move the handle after the last step,
    (k,).
    """
    along = np.linalg.pinv(last.normal.information[:, :3, :3], rcond=1e-2, hermitian=True)
    gradient = _remaining_gradient(last.normal, _own(last.step, last.windows.views.camera, rig))
    return np.asarray(np.linalg.norm((along @ gradient[..., None])[..., 0], axis=1))


def _assembled(normal: Reduced, weight: Array, camera: np.ndarray, rig: Rig) -> tuple[Array, Array]:
    """Normal equations of the pose (6), any motion blur (6) and the cameras' blurs from those of
    the windows.
    """
    own = (camera == np.arange(len(rig.cameras))[:, None]) * weight  # (cameras, k)
    common = normal.gradient.shape[1] - 1
    total = np.zeros((common + len(own), common + len(own)))
    total[:common, :common] = np.tensordot(weight, normal.information[:, :-1, :-1], 1)
    total[common:, :common] = own @ normal.information[:, -1, :-1]
    total[:common, common:] = total[common:, :common].T
    total[common:, common:] = np.diag(own @ normal.information[:, -1, -1])
    return total, np.concatenate([weight @ normal.gradient[:, :-1], own @ normal.gradient[:, -1]])


def in_world(covariance: Array, T_world_handle: RigidTransform) -> Array:
    """A covariance of a small motion in the handle's frame as one of position and rotation vector
    in the world's.
    """
    turn = both_in_world(T_world_handle)
    return turn @ covariance @ turn.T


def both_in_world(T_world_handle: RigidTransform) -> Array:
    """The matrix (6, 6) from position and rotation vector in the handle's frame to the world's."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = rotation_of(T_world_handle)
    return turn
