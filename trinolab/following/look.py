"""The handle looked for where it is expected: markers at their predicted places, and the pose from
them (Sect. 4.2).

Where too few are found, a coarse search over shifts of the predicted markers says where the handle
went.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from ..blobs import RING_PX
from ..camera import Camera, Rig
from ..checks import Array, frozen
from ..datasets import load_handle, load_rig, load_table1
from ..default_covariance import known_covariance
from ..estimators import estimate
from ..estimators.fitted import measured_pose
from ..estimators.identified import Identified
from ..estimators.pixels import Fit, fit_patches
from ..estimators.pixels import prepare as prepare_fit
from ..handle import Handle
from ..identity import labelled_pixels
from ..identity.hypotheses import FAR, Observed, Poses, explain, ideal_pixels, predict
from ..identity.layout import layout_of, views_of
from ..identity.reconcile import reconciled
from ..markers import Markers, markers_at
from ..methods import BEST
from ..pose import LOST, Pose, fit_pose
from ..rigid import apart, motion_between, placed, rotation_of, shifted
from ..sensitivity import NOTHING, offsets_at, pixel_slopes
from ..uncertainty.assessment import Assessment, RigInformation, assessed
from ..window import Window
from ..work import Work
from .parameters import FollowParameters
from .posefilter import Motion, begin, is_new, update

# work of a guess without the steps of its fits, in units of `work.Work`
GUESS_UNITS = 25.0
# of a pose that smeared markers agree on, mm and rad: seen by two cameras they tell little of the turn
AGREED_COVARIANCE = np.diag(np.repeat([0.5, 0.1], 3) ** 2)


class Setup(NamedTuple):
    """The constants of a track: rig, handle and parameters."""

    rig: Rig
    handle: Handle
    parameters: FollowParameters


class Expected(NamedTuple):
    """The markers in a camera as a motion predicts them.

    Attributes
    ----------
    uv : ndarray, shape (markers, 2)
        NaN for those turned away.
    size_px : float
        Diameter of a marker's image.
    blur_px : float
        Motion blur: how far a marker moves while the shutter is open.
    """

    uv: Array
    size_px: float
    blur_px: float


class Guess(NamedTuple):
    """A motion of the handle that is tried, and how it is looked for there.

    Attributes
    ----------
    motion : Motion
    expected : list of Expected
        The markers that the motion predicts, one per camera.
    blurred : bool
        Whether the handle is fitted as one that moves while the shutter is open.
    """

    motion: Motion
    expected: list[Expected]
    blurred: bool = False


class Observation(NamedTuple):
    """The markers that one camera shows where they are expected.

    Attributes
    ----------
    window : Window or None
        The window that contains the markers; None if the handle is expected outside the image.
    markers : ndarray, shape (markers, 6)
        As `markers.markers_at` gives it, in pixels of the whole image.
    """

    window: Window | None
    markers: Array


class RigState(NamedTuple):
    """The rig of a recording, as estimated from its instants so far.

    Attributes
    ----------
    near : Rig
        The rig with which the next fit begins: the given one, displaced by its likely errors.
    earlier : RigInformation or None
        The information of the instants on its displacement.
    """

    near: Rig
    earlier: RigInformation | None = None


class Followed(NamedTuple):
    """The measurement where a guess has the handle.

    Attributes
    ----------
    guess : Guess
    pose : Pose
        ``measured``; `LOST` if too little fits.
    labels : tuple of ndarray of int, one per camera, shape (markers,)
        The marker's index where it was found and agrees, else -1.
    observations : tuple of Observation
        The markers that the cameras show there.
    rig : RigState
        The rig after this instant.
    smear_px : float
        Length of the markers' smear by the handle's motion; NaN where it was not estimated.
    """

    guess: Guess
    pose: Pose
    labels: tuple[np.ndarray, ...]
    observations: tuple[Observation, ...]
    rig: RigState
    smear_px: float


@cache
def prepare() -> None:
    """Load the compiled loops, or compile them where that was never done: by looking for the handle
    of a shipped rig in dark images, once in a process.
    """
    setup = Setup(load_rig("paper_pair"), load_handle("coded"), FollowParameters())
    dark = [np.zeros(camera.size[::-1], np.uint8) for camera in setup.rig.cameras]
    motion = begin(0.0, load_table1().set_poses[0], np.eye(6), setup.parameters.motion)
    follow(dark, Guess(motion, expect(setup, motion)), setup)
    prepare_fit()


def expect(setup: Setup, motion: Motion) -> list[Expected]:
    """Predicted markers of a motion, one `Expected` per camera."""
    rig, handle, p = setup
    views = views_of(rig)
    layout = layout_of(handle, p.identity)
    ahead = shifted(motion.pose, p.exposure_s * motion.rates[:6])
    both = np.stack([motion.pose.as_matrix(), ahead.as_matrix()])
    predicted = predict(Poses(both[:, :3, :3], both[:, :3, 3]), views, layout)
    blur = np.linalg.norm(predicted.uv[1] - predicted.uv[0], axis=1).max(axis=1)
    facing = predicted.facing[0] > np.cos(np.deg2rad(p.expected_slant_deg))
    uv = np.where(facing[..., None], views.as_taken(predicted.uv[:1])[0].transpose(0, 2, 1), np.nan)
    depths = np.maximum(predicted.points[0, :, 2].mean(axis=1), 1.0)
    sizes = handle.marker_diameter_mm * views.focal.max(axis=1) / depths
    return [Expected(*one) for one in zip(uv, sizes.tolist(), blur.tolist(), strict=True)]


def may_be_blurred(expected: Sequence[Expected], p: FollowParameters) -> bool:
    """Whether markers are expected to move while the shutter is open by what an image shows."""
    return max(one.blur_px for one in expected) > p.blurred_px


def look(
    images: Sequence[np.ndarray], expected: Sequence[Expected], setup: Setup
) -> tuple[Observation, ...]:
    """Measure the markers where they are expected; half a marker's diameter off is near enough.

    A moving marker reaches further by half of its way during the exposure.
    """
    return tuple(
        _look(image, camera, setup, one.uv, 0.75 * one.size_px + RING_PX + one.blur_px / 2)
        for image, camera, one in zip(images, setup.rig.cameras, expected, strict=True)
    )


def _look(
    image: np.ndarray, camera: Camera, setup: Setup, uv: Array, reach_px: float
) -> Observation:
    around = Window.around(np.clip(uv, -1e6, 1e6))
    window = around and around.grown(2 * reach_px).clipped(camera.size)
    if window is None:
        return Observation(None, np.full((len(uv), 6), np.nan))
    corner = np.array([window.u, window.v, 0, 0, 0, 0])
    _, handle, p = setup
    markers = markers_at(window.crop(image), uv - corner[:2], reach_px, handle.markers, p.markers)
    return Observation(window, markers + corner)


def follow(
    images: Sequence[np.ndarray],
    guess: Guess,
    setup: Setup,
    before: RigState | None = None,
    work: Work | None = None,
) -> Followed:
    """Look for the markers where a guess has them, and measure the pose from those that are there.

    If the estimator gives no pose, or another one than the markers agree on, the image model is
    fitted, for which a single camera is enough. With `guess.blurred`, or if a fit without motion
    blur shows some, it is the image model of a handle that moves while the shutter is open, because
    centroids are less accurate when limb and neighbours are blurred together.

    `before` is the rig as estimated from the instants before. Fits take no more of `work` than
    remains.
    """
    work = work or Work()
    work.remaining -= GUESS_UNITS
    rig, handle, p = setup
    state = before or RigState(rig)
    near_setup = setup._replace(rig=state.near)
    observations = look(images, guess.expected, near_setup)
    pixels = tuple(one.markers[:, :2] for one in observations)
    T, labels = _agreed(pixels, near_setup, guess.motion.pose)
    followed = Followed(guess, LOST, labels, observations, state, np.nan)
    markers_found = sum(np.isfinite(one.markers[:, 0]).sum() for one in observations)
    if T is None and markers_found < p.min_found:
        return followed  # it is elsewhere
    instant = None
    moves = guess.blurred or (_may_move(guess, p) and _stretched(guess.expected, observations, p))
    if T is not None:
        uv = labelled_pixels(labels, pixels, len(handle.marker_centres))
        # smeared centroids say nothing of the rig, and later instants know more of it than one
        exact = known_covariance(rig).is_exact
        if not moves and (exact or before is None):
            near, T = reconciled(rig, handle, uv, T, p.sigma_px, p.identity)
            followed = followed._replace(rig=RigState(near))
        instant = Identified(images, uv, T, followed.rig.near, _expected_blur(guess.motion, p))
    if not moves:
        followed = _fitted_still(followed, images, instant, setup, work)
        moves = followed.smear_px > p.blurred_px
    return _fitted_moving(followed, images, instant, setup, work) if moves else followed


def _may_move(guess: Guess, p: FollowParameters) -> bool:
    """Whether motion blur may be what an image shows."""
    return may_be_blurred(guess.expected, p) or is_new(guess.motion, p.motion)


def _fitted_still(
    followed: Followed,
    images: Sequence[np.ndarray],
    instant: Identified | None,
    setup: Setup,
    work: Work,
) -> Followed:
    """The measurement with the pose of a handle that is still, if it is; `instant` has the pose
    that the markers agree on.
    """
    pose = LOST if instant is None else _agreeing_pose(instant, setup)
    if pose is not LOST:
        return followed._replace(pose=pose)
    _, handle, p = setup
    guess = followed.guess
    may_move = _may_move(guess, p)
    smear_above = p.still_misfit if may_move else np.inf

    def fit_at(near: Rig, start: RigidTransform) -> Fit | None:
        return fit_patches(
            images, near, handle, start, p.max_slant_deg, smear_above=smear_above, work=work
        )

    start = guess.motion.pose if instant is None else instant.T_world_handle
    fit = fit_at(followed.rig.near, start)
    if may_move and not _still(fit, p):
        # where hardly a marker fits its smear is not known, and may be long
        smear_px = np.inf if fit is None or fit.shown.sum() < 4 else fit.smear_px
        return followed._replace(smear_px=smear_px)
    return _assessed(followed, fit, fit_at, setup)


def _fitted_moving(
    followed: Followed,
    images: Sequence[np.ndarray],
    instant: Identified | None,
    setup: Setup,
    work: Work,
) -> Followed:
    """The measurement with the pose of a handle that moves while the shutter is open. The fit
    begins at the pose that the markers agree on, which updates the velocity as well; else where the
    images have the handle, or as predicted.
    """
    _, handle, p = setup
    near = followed.rig.near
    motion = followed.guess.motion
    if instant is not None:
        motion = update(motion, instant.T_world_handle, AGREED_COVARIANCE, p.motion)
        start = motion.pose
    else:
        start = _displaced_start(images, followed.guess, setup._replace(rig=near))
    blur = _expected_blur(motion, p)
    if not motion.rates.any():
        blur = _smear_motion(images, followed, start.translation, setup._replace(rig=near)), blur[1]

    def fit_at(near: Rig, start: RigidTransform, is_far: bool = False) -> Fit | None:
        return fit_patches(
            images, near, handle, start, p.max_slant_deg, motion_blur=blur, is_far=is_far, work=work
        )

    fit = fit_at(near, start, is_far=instant is None)
    smear_px = np.nan if fit is None else fit.smear_px
    followed = followed._replace(smear_px=smear_px)
    return _assessed(followed, fit, fit_at, setup)


def _assessed(
    followed: Followed,
    fit: Fit | None,
    fit_at: Callable[[Rig, RigidTransform], Fit | None],
    setup: Setup,
) -> Followed:
    """The measurement with the pose of a fit, and with the rig as the fit leaves it."""
    if fit is None:
        return followed
    state = followed.rig
    rig, handle, p = setup
    fit, assessment, near = assessed(fit, fit_at, rig, handle, state.near, state.earlier)
    pose = _precise_pose(fit, assessment, rig, p)
    if pose is not LOST and assessment.information is not None:
        earlier = assessment.information
        if state.earlier is not None:
            earlier = state.earlier.then(earlier)
        state = RigState(near, earlier)
    return followed._replace(pose=pose, rig=state)


def _displaced_start(images: Sequence[np.ndarray], guess: Guess, setup: Setup) -> RigidTransform:
    """The predicted pose, shifted to where the images have the handle as far as they tell: two
    cameras side by side say little of the depth.
    """
    pose = guess.motion.pose
    shown = displacement(images, guess.expected, pose.translation, setup)
    if shown is None:
        return pose
    shift, covariance = shown
    predicted = guess.motion.pose_covariance[:3, :3]
    gain = predicted @ np.linalg.inv(predicted + covariance)
    return RigidTransform.from_components(pose.translation + gain @ shift, pose.rotation)


def _agreeing_pose(instant: Identified, setup: Setup) -> Pose:
    """The pose by the estimator; `LOST` if it is another one than the markers agree on, or if the
    estimator is the image model itself, which needs no markers.
    """
    p = setup.parameters
    if p.estimator == BEST:
        return LOST
    pose = _estimated(instant, setup)
    T = pose.T_world_handle
    if T is None or apart(T, instant.T_world_handle, p.agreed_mm, np.deg2rad(p.agreed_deg)):
        return LOST
    return pose


def _expected_blur(motion: Motion, p: FollowParameters) -> tuple[Array, Array]:
    """The motion expected while the shutter is open, (6,), and its covariance, (6, 6), process
    noise added to it.
    """
    noise = np.diag(np.repeat([p.rate_noise_mm_s, p.rate_noise_rad_s], 3) ** 2)
    return p.exposure_s * motion.rates[:6], p.exposure_s**2 * (
        motion.covariance[6:12, 6:12] + noise
    )


def _smear_motion(
    images: Sequence[np.ndarray],
    followed: Followed,
    centre: Array,
    setup: Setup,
) -> Array:
    """The motion while the shutter is open, (6,), without its turn, that the lengths and directions
    of the smeared markers show; its sign is arbitrary.

    A fit cannot begin at rest: a smear of length w changes an image by w^2, whose slope is zero there.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
    followed : Followed
    centre : ndarray, shape (3,)
        Of the handle, world frame, mm.
    setup : Setup
    """
    ways = []
    slopes = []
    for c, (image, seen) in enumerate(zip(images, followed.observations, strict=True)):
        way = _smear(image, followed.guess.expected[c].size_px, seen, setup)
        if way is not None:
            ways.append(way)
            slopes.append(_by_position(setup.rig.cameras[c], centre))
    if not ways:
        return np.zeros(6)
    J = np.concatenate(slopes)
    best = np.zeros(3)
    least = np.inf
    # where either sign of a camera's way will do, the smaller motion is taken
    for signs in product((1.0, -1.0), repeat=len(ways) - 1):
        wanted = np.concatenate([sign * way for sign, way in zip((1.0, *signs), ways, strict=True)])
        motion = np.linalg.lstsq(J, wanted, rcond=1e-2)[0]
        cost = float(np.linalg.norm(J @ motion - wanted) + 1e-3 * np.linalg.norm(motion))
        if cost < least:
            best, least = motion, cost
    return np.concatenate([best, np.zeros(3)])


def _smear(image: np.ndarray, size_px: float, seen: Observation, setup: Setup) -> Array | None:
    """The way (2,), px, that the markers of an image are smeared along, from their second moments:
    a way w adds w^2/12 to those of a disc, d^2/16. It is at least what an image shows; None where there
    is no marker.
    """
    moments = []
    for u, v, major, _, _, threshold in seen.markers[np.isfinite(seen.markers[:, 0])]:
        around = Window.around(np.array([[u, v]]))
        window = around and around.grown(0.6 * major).clipped(image.shape[::-1])
        if window is not None:
            inside = (window.crop(image) > threshold) == (setup.handle.markers == "bright")
            m = cv2.moments(inside.astype(np.uint8), binaryImage=True)
            moments.append(np.array([m["mu20"] - m["mu02"], 2 * m["mu11"]]) / max(m["m00"], 1.0))
    if not moments:
        return None
    twice = np.mean(moments, axis=0)
    longer = np.nanmedian(seen.markers[:, 2]) ** 2 - size_px**2
    angle = np.arctan2(twice[1], twice[0]) / 2
    way = max(np.sqrt(0.75 * max(longer, 0.0)), setup.parameters.blurred_px)
    return way * np.array([np.cos(angle), np.sin(angle)])


def _stretched(
    expected: Sequence[Expected], observations: Sequence[Observation], p: FollowParameters
) -> bool:
    """Whether in some camera most markers are longer than any disc of their size would be."""
    return any(
        np.nanmedian(seen.markers[:, 2]) > p.blurred_length * one.size_px
        for one, seen in zip(expected, observations, strict=True)
        if np.isfinite(seen.markers[:, 2]).any()
    )


def _still(fit: Fit | None, p: FollowParameters) -> bool:
    """Whether the image model of a handle that is still leaves nothing but noise, or at least no
    motion blur: JPEG, or a marker that is not quite as the model has it, leave more than noise.
    """
    if fit is None or fit.shown.sum() < 4:
        return False
    noise = np.median(fit.misfit[fit.shown]) < p.still_misfit
    return bool(noise or fit.smear_px < p.blurred_px)


def _precise_pose(fit: Fit, assessment: Assessment, rig: Rig, p: FollowParameters) -> Pose:
    """The pose of a fit, if the windows agree on it and fix it; `LOST` otherwise. Cameras that lack
    most of the expected markers do not count.
    """
    cameras = fit.views.camera
    share = np.array(
        [
            fit.shown[cameras == c].mean() if (cameras == c).any() else 0.0
            for c in range(len(rig.cameras))
        ]
    )
    shown = fit.shown & (share > p.min_shown_share)[cameras]
    pose = measured_pose(fit._replace(shown=shown), assessment)
    return pose if _is_precise(pose, p) and pose.residual_px < p.max_fit_residual_px else LOST


def _is_precise(pose: Pose, p: FollowParameters) -> bool:
    """Whether this instant fixes the pose; what rig and layout do to it is the same before and
    after.
    """
    own = replace(pose, systematic=NOTHING)
    return bool(own.sigma_mm < p.max_sigma_mm and own.sigma_deg < p.max_sigma_deg)


def as_markers(observation: Observation) -> Markers:
    """The markers that a camera shows, one row per marker of the handle; NaN where there is none."""
    table = observation.markers
    return Markers(
        frozen(table[:, :2]), frozen(table[:, 2:4]), frozen(table[:, 4]), frozen(table[:, 5]), ()
    )


def _agreed(
    pixels: Sequence[Array], setup: Setup, start: RigidTransform
) -> tuple[RigidTransform | None, tuple[np.ndarray, ...]]:
    """The pose that most of the markers agree with, and those that do."""
    from . import pose_loop  # only here: a browser has no Numba

    rig, handle, p = setup
    uv = ideal_pixels(rig, pixels)
    offsets = offsets_at(rig, start.translation)
    views = views_of(rig)
    layout = layout_of(handle, p.identity)
    observed = Observed(views, layout, uv, offsets=offsets)
    # A wide gate first, as wide as the search for an unknown pose begins with, then a narrow one.
    gates_px = np.array([4.0, 1.5]) * p.identity.gate_px
    R, t = pose_loop.approach(
        rotation_of(start).copy(),
        start.translation,
        (views.rotations, views.translations, views.focal, views.principal),
        (layout.centres, layout.normals, layout.tangents, layout.slants, layout.shift),
        np.array([np.cos(np.deg2rad(p.identity.steep_deg)), layout.limb, gates_px[0]]),
        uv,
        uv[:, 0] < FAR,
    )
    poses = Poses(R[None], t[None])
    explained = explain(poses, observed, gates_px[1], p.identity)
    labels = np.where(explained.labels == np.arange(uv.shape[2]), explained.labels, -1)
    count = int((labels >= 0).sum())
    freedom = max(2 * count - 6 - int(explained.spared[0]), 1)
    residual = np.sqrt(np.where(labels >= 0, explained.squares, 0.0).sum() / freedom)
    if (
        count < 4
        or not residual <= p.identity.max_residual_px
        or not np.isfinite(poses.rotations).all()
    ):
        return None, tuple(labels[0])
    return placed(poses.translations[0], poses.rotations[0]), tuple(labels[0])


def _estimated(instant: Identified, setup: Setup) -> Pose:
    """The pose by the estimator, `LOST` if it is not sure; the paper's without the image model that
    checks an instant.

    The covariance of the paper's takes in the way to the pose that all pixels agree on.
    """
    rig, handle, p = setup
    if not p.check:
        pose = estimate(instant, rig, handle, p)
        return pose if _is_precise(pose, p) else LOST
    pose = fit_pose(instant.uv, rig, handle, p.max_slant_deg, p.sigma_px, instant.T_world_handle)
    if pose.T_world_handle is None or not _is_precise(pose, p):
        return LOST
    away = motion_between(pose.T_world_handle, instant.T_world_handle)
    return replace(pose, covariance_random=pose.covariance_random + np.outer(away, away))


def displacement(
    images: Sequence[np.ndarray],
    expected: Sequence[Expected],
    centre: Array,
    setup: Setup,
) -> tuple[Array, Array] | None:
    """The shift of the whole handle from where it was expected, if the cameras agree.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
    expected : sequence of Expected, one per camera
    centre : ndarray, shape (3,)
        Where the handle is expected, world frame, mm.
    setup : Setup

    Returns
    -------
    (ndarray, ndarray), shapes (3,) and (3, 3), or None
        The shift and its covariance, world frame, mm; None where fewer than two cameras agree.
    """
    rig, handle, p = setup
    shifts = [
        _shift(image, one, handle.markers, p) for image, one in zip(images, expected, strict=True)
    ]
    seen = [c for c, shift in enumerate(shifts) if shift is not None]
    while len(seen) >= 2:
        J = np.concatenate([_by_position(rig.cameras[c], centre) for c in seen])
        wanted = np.concatenate([shifts[c] for c in seen])
        motion = np.linalg.lstsq(J, wanted, rcond=None)[0]
        residuals_px = np.linalg.norm((J @ motion - wanted).reshape(-1, 2), axis=1)
        if residuals_px.max() <= p.shift_agreement_px:
            return motion, p.shift_sigma_px**2 * np.linalg.pinv(J.T @ J)
        seen.pop(int(residuals_px.argmax()))
    return None


def _by_position(camera: Camera, point: Array) -> Array:
    """Derivative of the pixel of a point by its position, (2, 3), px/mm; zeros where it has none."""
    return np.nan_to_num(pixel_slopes(camera, point[None])[1][0])


def _shift(
    image: np.ndarray, expected: Expected, markers: str, p: FollowParameters
) -> Array | None:
    """The shift (2,), px, that puts most of the expected markers on spots; None if nothing stands
    out.
    """
    uv = expected.uv[np.isfinite(expected.uv).all(axis=1)]
    step = p.search_step_px
    around = Window.around(np.clip(uv, -1e6, 1e6)) if len(uv) >= 2 else None
    window = around and around.grown(p.search_px + 2 * expected.size_px).clipped(
        (image.shape[1], image.shape[0])
    )
    if window is None or min(window.width, window.height) < 2 * step:
        return None
    small = cv2.resize(
        window.crop(image).astype(np.float32),
        None,
        fx=1 / step,
        fy=1 / step,
        interpolation=cv2.INTER_AREA,
    )
    spots = _spots(small if markers == "bright" else -small, expected.size_px / step)
    if spots.max(initial=0.0) < p.min_response:
        return None
    reach = int(p.search_px // step)
    padded = np.pad(spots, reach + 1)
    at = np.rint((uv - [window.u, window.v]) / step - 0.5).astype(int) + reach + 1
    inside = ((at >= reach) & (at < np.array(padded.shape[::-1]) - reach)).all(axis=1)
    if inside.sum() < 2:
        return None
    score = np.add.reduce(
        [
            padded[v - reach : v + reach + 1, u - reach : u + reach + 1]
            for u, v in at[inside].tolist()
        ]
    )
    v, u = np.unravel_index(score.argmax(), score.shape)
    return step * (np.array([u, v], dtype=float) - reach)


def _spots(image: np.ndarray, size: float) -> np.ndarray:
    """Contrast of spots of a size with their surroundings, at most as much as half the spots have."""
    near = cv2.GaussianBlur(image, (0, 0), max(size / 4, 0.6))
    wide = cv2.GaussianBlur(image, (0, 0), max(size, 1.5))
    out = np.maximum(near - wide, 0.0)
    return np.minimum(out, 0.5 * out.max(initial=0.0))
