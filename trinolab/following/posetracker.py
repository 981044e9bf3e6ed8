"""The handle followed through a sequence by a filter on its pose: look where it is expected, else
everywhere.

The paper's windows follow what moves in each image (`tracker.step`); here they are the projections
of one predicted pose, so that a camera that is covered for a while, or sees a hand move, knows
where to look all the same. What is no marker in its place is no marker: while the handle is followed
no background is needed. A search of the whole images needs one where more bright spots are seen than
the handle has markers: what the empty bench shows is none of them (Eq. 5, 6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .. import background
from ..camera import Rig
from ..checks import Array, as_number, as_transform
from ..files.recording import Frames
from ..handle import Handle
from ..identity import Hypothesis, choose, equivalents, relabel
from ..markers import Markers, most_markers
from ..measurement import Measurement, as_images, chosen, identified, whole_images
from ..pose import LOST, Pose
from ..rigid import apart
from ..sensitivity import NOTHING
from ..window import Window
from ..work import Work
from . import posefilter
from .look import (
    Followed,
    Guess,
    RigState,
    Setup,
    as_markers,
    displacement,
    expect,
    follow,
    may_be_blurred,
    prepare,
)
from .parameters import FollowParameters
from .posefilter import Motion, PoseFilterParameters

# share of an instant's work without which a guess is not begun: few steps lead nowhere
LEAST_SHARE = 1 / 3
# share that a search leaves for the fit of what it finds
SEARCH_LEAVES = 1 / 2
# of a pose of a search, mm and rad
SEARCH_COVARIANCE = np.diag(np.repeat([1.0, 0.1], 3) ** 2)


class TrackState(NamedTuple):
    """The state of a track after an instant.

    Attributes
    ----------
    t_s : float
        Time of the instant, s.
    motion : Motion or None
        None if nothing is followed.
    last_measured : Motion or None
        The same when the handle was last measured, or given.
    unambiguous : bool
        Whether it is known which of the equivalent poses is the true one.
    rig : RigState or None
        The rig after the measurements so far; None before the first one.
    systematic : ndarray, shape (6, 6)
        Of the last measured pose, see `pose.Pose`.
    blurred : bool
        Whether the last measured markers were smeared by the handle's motion.
    cursor : int
        Where the search of the whole images goes on that was cut short, see `identity.search.search`.
    backgrounds : tuple of ndarray, one per camera, shape (height, width), or None
        Of the empty bench; None until it shows more spots than are looked at.
    """

    t_s: float
    motion: Motion | None
    last_measured: Motion | None
    unambiguous: bool
    rig: RigState | None = None
    systematic: Array = NOTHING
    blurred: bool = False
    cursor: int = 0
    backgrounds: tuple[np.ndarray, ...] | None = None


class Tracked(NamedTuple):
    """One instant of a track.

    Attributes
    ----------
    measurement : Measurement
    windows : tuple of Window or None
        The searched windows; None where a camera was skipped.
    labels : tuple of ndarray of int, one per camera, or None
        Labels of the markers found near their expected places, even if they agree on no pose; None
        where the whole images were searched.
    """

    measurement: Measurement
    windows: tuple[Window | None, ...]
    labels: tuple[np.ndarray, ...] | None = None


class Searched(NamedTuple):
    """The result of a search of the whole images of an instant.

    Attributes
    ----------
    markers : tuple of Markers
        One per camera.
    hypotheses : list of Hypothesis
        See `identity.identify`.
    is_complete : bool
        Whether the work was enough for the search: one that was cut short may have missed a rival.
    backgrounds : tuple of ndarray or None
        For the next search, see `TrackState`.
    """

    markers: tuple[Markers, ...]
    hypotheses: list[Hypothesis]
    is_complete: bool
    backgrounds: tuple[np.ndarray, ...] | None


def start(t_s: float, pose: RigidTransform | None = None) -> TrackState:
    """The state before the first instant.

    Parameters
    ----------
    t_s : float
        s; the first instant comes later.
    pose : RigidTransform, optional
        T_world_handle at that time where it is known: it tells poses that look alike apart.

    Raises
    ------
    ValueError
        If the time is no finite number, or the pose not one finite motion.
    """
    t = as_number(t_s, "t_s")
    if pose is None:
        return TrackState(t, None, None, False)
    given = posefilter.begin(
        t, as_transform(pose, "pose"), np.diag([25.0] * 3 + [0.01] * 3), PoseFilterParameters()
    )
    return TrackState(t, given, given, True)


def track_instants(
    instants: Iterable[Frames],
    rig: Rig,
    handle: Handle,
    parameters: FollowParameters | None = None,
    known: Mapping[int, RigidTransform] | None = None,
    state: TrackState | None = None,
    keep: Callable[[int, TrackState], TrackState] | None = None,
) -> Iterator[tuple[Frames, Tracked]]:
    """Take the steps of a whole sequence: each instant with its detections.

    Parameters
    ----------
    instants : iterable of Frames
    rig : Rig
    handle : Handle
    parameters : FollowParameters, optional
        As for `step`.
    known : mapping of int to RigidTransform, optional
        T_world_handle at some frames. They count as long as it is ambiguous which of the equivalent
        poses holds.
    state : TrackState, optional
        After an instant before the first one; nothing is known without it.
    keep : callable, optional
        Called after each instant with its frame and the state; returns the state to continue with.
    """
    given = known or {}
    prepare()  # not at the expense of the first instant
    for now in instants:
        if now.frame in given and (state is None or not state.unambiguous):
            # the time has to increase
            state = start(np.nextafter(now.t_s, -np.inf) - 1e-6, given[now.frame])
        elif state is None:
            state = start(now.t_s - 1.0)
        state, tracked = step(state, now.images, now.t_s, rig, handle, parameters)
        yield now, tracked
        if keep is not None:
            state = keep(now.frame, state)


def step(
    state: TrackState,
    frames: Sequence[ArrayLike],
    t_s: float,
    rig: Rig,
    handle: Handle,
    parameters: FollowParameters | None = None,
) -> tuple[TrackState, Tracked]:
    """One instant of a sequence.

    Parameters
    ----------
    state : TrackState
        After the instant before.
    frames : sequence of array_like, shape (height, width)
        As for `measurement.measure`.
    t_s : float
        Time of the frames, s; any step after the last one.
    rig : Rig
    handle : Handle
    parameters : FollowParameters, optional
        Poses of the estimator ``paper`` are checked against the pixels.

    Returns
    -------
    state : TrackState
    tracked : Tracked
        With a pose ``measured``; ``ambiguous`` where the handle looks alike from several sides and
        has been lost since it was known which; ``predicted`` for `memory_s` after the last
        measurement; else `LOST`.

    Raises
    ------
    ValueError
        If the frames are none of the rig, see `measurement.measure`, or the time does not increase.
    """
    p = (parameters or FollowParameters()).checked
    setup = Setup(rig, handle, p)
    t = as_number(t_s, "t_s", low=state.t_s, open_low=True)
    images = as_images(frames, rig)
    work = Work(p.most_work, state.cursor)

    @cache
    def search() -> Searched:
        return _searched(images, state, setup, work)

    if state.motion is None or state.last_measured is None:
        return _begun(images, t, state, setup, search, work)
    predicted = posefilter.predict(state.motion, t, p.motion)
    first = _guess(predicted, state.blurred, setup)
    as_predicted = follow(images, first, setup, state.rig, work)
    best = _better(None, as_predicted, setup)
    guesses = _further_guesses(images, first, state, setup, search)
    all_tried = False
    while work.remaining >= LEAST_SHARE * p.most_work and not _enough_cameras(best, rig):
        guess = next(guesses, None)
        if guess is None:
            all_tried = not work.was_cut
            break
        followed = follow(images, guess, setup, state.rig, work)
        best = _better(best, followed, setup)
    # a motion that has just begun may continue nearly anywhere: few cameras say little then
    may_be_chance = posefilter.is_new(state.motion, p.motion) and not all_tried
    if best is not None and (_enough_cameras(best, rig) or not may_be_chance):
        return _measured(best, state, handle, p)
    if t - state.last_measured.t_s > p.memory_s + 1e-9:  # times are rounded
        return _begun(images, t, state, setup, search, work)
    # The windows of the prediction belong to the pose that is reported.
    state = state._replace(t_s=t, motion=predicted, cursor=work.cursor)
    return state, _predicted_only(as_predicted, state, handle)


def _better(best: Followed | None, followed: Followed, setup: Setup) -> Followed | None:
    """The measurement at a guess, if more cameras show it than the best one so far, and it may be
    the continuation of the motion; else the best one so far.
    """
    cameras = 0 if best is None else best.pose.cameras
    if followed.pose.cameras <= cameras:
        return best
    continues = believable(followed.pose, followed.guess.motion, setup)
    return followed if continues else best


def _enough_cameras(best: Followed | None, rig: Rig) -> bool:
    """Whether half of the cameras show the pose: a single one of three may be frozen, and the others
    say something else.
    """
    return best is not None and 2 * best.pose.cameras >= len(rig.cameras)


def _guess(motion: Motion, blurred: bool, setup: Setup) -> Guess:
    """The guess that the handle moves so, and shows motion blur if that is what it did before and it
    is fast enough.
    """
    expected = expect(setup, motion)
    return Guess(motion, expected, blurred and may_be_blurred(expected, setup.parameters))


def _further_guesses(
    images: list[np.ndarray],
    predicted: Guess,
    state: TrackState,
    setup: Setup,
    search: Callable[[], Searched],
) -> Iterator[Guess]:
    """Further guesses, if the handle is not as predicted: shifted to where the images have it, and
    as a search of the whole images finds it.
    """
    rig, handle, p = setup
    motion = predicted.motion
    last = state.last_measured
    assert last is not None
    centre = motion.pose.translation
    shift = displacement(images, predicted.expected, centre, setup)
    if shift is not None:
        moved = posefilter.restarted(motion, centre + shift[0], shift[1], last, p.motion)
        yield _guess(moved, state.blurred, setup)
    _, hypotheses, is_complete, _ = search()
    if not hypotheses:
        return
    T, labels, unambiguous = chosen(hypotheses, images, rig, handle, motion.pose, p)
    cameras = sum(bool((row >= 0).any()) for row in labels)
    pose = Pose("measured", T, SEARCH_COVARIANCE, np.nan, 0, cameras)
    if unambiguous and is_complete and believable(pose, motion, setup):
        updated = posefilter.update(motion, T, SEARCH_COVARIANCE, p.motion)
        yield _guess(updated, state.blurred, setup)


def _searched(images: list[np.ndarray], state: TrackState, setup: Setup, work: Work) -> Searched:
    """Search the whole images, or what moves in them where there are backgrounds, with the work that
    is not kept for the fit of what is found.
    """
    rig, handle, p = setup
    backgrounds = state.backgrounds
    shown = images
    if backgrounds is not None:
        shown, backgrounds = _moving(images, backgrounds, setup)
    kept = SEARCH_LEAVES * p.most_work
    work.remaining -= kept
    markers, hypotheses = identified(shown, whole_images(rig), rig, handle, p, work)
    is_complete = not work.was_cut
    work.remaining += kept
    # before the handle was ever measured: later, this would be an image of it, too
    if backgrounds is None and not hypotheses and state.rig is None:
        most = most_markers(len(handle.marker_centres), p.markers)
        if any(len(one.uv) == most for one in markers):
            background.prepare()
            backgrounds = tuple(image.astype(np.float32) for image in images)
    return Searched(markers, hypotheses, is_complete, backgrounds)


def _moving(
    images: list[np.ndarray], backgrounds: tuple[np.ndarray, ...], setup: Setup
) -> tuple[list[np.ndarray], tuple[np.ndarray, ...]]:
    """What moves in the images by Eq. 5, if anything does, else the images; and the backgrounds that
    Eq. 6 renews.
    """
    _, handle, p = setup
    renewed, detections = zip(
        *(
            background.stepped(image, old, p.background)
            for image, old in zip(images, backgrounds, strict=True)
        ),
        strict=True,
    )
    if all(detection.window is None for detection in detections):
        return images, renewed  # a handle that rests may be there, too
    ground = 0 if handle.markers == "bright" else 255
    shown = [
        np.where(detection.mask, image, image.dtype.type(ground))
        for image, detection in zip(images, detections, strict=True)
    ]
    return shown, renewed


def _tracked(followed: Followed, pose: Pose, labels: tuple[np.ndarray, ...]) -> Tracked:
    """The instant of a measurement at a guess, with the pose that is reported."""
    markers = tuple(map(as_markers, followed.observations))
    windows = tuple(one.window for one in followed.observations)
    return Tracked(Measurement(pose, markers, labels), windows, followed.labels)


def _predicted_only(followed: Followed, state: TrackState, handle: Handle) -> Tracked:
    """An instant without a measurement: the predicted pose, with what is seen where it has the
    handle.
    """
    motion = followed.guess.motion
    spread = motion.pose_covariance
    pose = Pose("predicted", motion.pose, spread, np.nan, 0, 0, state.systematic)
    nothing = tuple(np.full(len(labels), -1) for labels in followed.labels)
    return _reported(_tracked(followed, pose, nothing), state.unambiguous, handle)


def _measured(
    followed: Followed, before: TrackState, handle: Handle, p: FollowParameters
) -> tuple[TrackState, Tracked]:
    """The state after a pose that continues the motion."""
    motion = followed.guess.motion
    pose = followed.pose
    assert pose.T_world_handle is not None
    after = posefilter.update(motion, pose.T_world_handle, pose.covariance_random, p.motion)
    tracked = _reported(_tracked(followed, pose, followed.labels), before.unambiguous, handle)
    state = before._replace(
        t_s=motion.t_s,
        motion=after,
        last_measured=after,
        rig=followed.rig,
        systematic=pose.systematic,
        blurred=followed.smear_px > p.blurred_px,
        cursor=0,
    )
    return state, tracked


def _begun(
    images: list[np.ndarray],
    t: float,
    before: TrackState,
    setup: Setup,
    search: Callable[[], Searched],
    work: Work,
) -> tuple[TrackState, Tracked]:
    """The state after an instant of which nothing is known but the rig: the handle is followed from
    where a search of the whole images has it.
    """
    rig, handle, p = setup
    markers, hypotheses, is_complete, backgrounds = search()
    nothing = tuple(np.full(len(one.uv), -1) for one in markers)
    lost = TrackState(t, None, None, False, before.rig, cursor=work.cursor, backgrounds=backgrounds)
    whole = tuple(whole_images(rig))
    nowhere = Tracked(Measurement(LOST, markers, nothing), whole)
    if not hypotheses:
        return lost, nowhere
    T, _, unambiguous = chosen(hypotheses, images, rig, handle, None, p)
    motion = posefilter.begin(t, T, SEARCH_COVARIANCE, p.motion)
    followed = follow(images, _guess(motion, False, setup), setup, before.rig, work)
    if followed.pose is LOST:
        return lost, nowhere
    # a search that was cut short may have missed a rival, but none that as many cameras would show
    unambiguous &= is_complete or _enough_cameras(followed, rig)
    searched = before._replace(unambiguous=unambiguous, backgrounds=backgrounds)
    state, tracked = _measured(followed, searched, handle, p)
    tracked = tracked._replace(windows=whole)
    if unambiguous or len(handle.symmetries) > 1:
        return state, tracked
    # a pose that is not sure is searched for in the same way again
    return lost._replace(cursor=0), tracked


def believable(pose: Pose, motion: Motion, setup: Setup) -> bool:
    """Whether a measured pose may be the continuation of a motion; the less, the fewer cameras say
    so.
    """
    if pose.status != "measured" or pose.T_world_handle is None:
        return False
    rig, handle, p = setup
    if pose.cameras == len(rig.cameras):
        sigmas = p.gate_all_sigmas
        step_mm = p.gate_all_mm
        step_deg = p.gate_all_deg
    else:
        sigmas = p.gate_some_sigmas
        step_mm = p.gate_some_mm
        step_deg = p.gate_some_deg
    spread = motion.pose_covariance
    most_mm = sigmas * np.sqrt(np.trace(spread[:3, :3])) + step_mm
    most_rad = sigmas * np.sqrt(np.trace(spread[3:, 3:])) + np.deg2rad(step_deg)
    if len(handle.symmetries) > 1:
        most_rad = min(most_rad, np.deg2rad(p.gate_alike_deg))
    return not apart(pose.T_world_handle, motion.pose, most_mm, most_rad)


def _reported(tracked: Tracked, unambiguous: bool, handle: Handle) -> Tracked:
    """The instant as it is if only one of the equivalent poses can hold, else with the one that
    `measure` would name.
    """
    m = tracked.measurement
    pose = m.pose
    if unambiguous or pose is LOST or pose.T_world_handle is None:
        return tracked
    alike = equivalents(pose.T_world_handle, handle)
    k = choose(alike, None)[0]
    status = "ambiguous" if pose.status == "measured" else pose.status
    symmetry = handle.symmetries[k]
    labels = tuple(relabel(row, handle, symmetry) for row in m.labels)
    near = tracked.labels and tuple(relabel(row, handle, symmetry) for row in tracked.labels)
    pose = replace(pose, status=status, T_world_handle=alike[k])
    return tracked._replace(measurement=replace(m, pose=pose, labels=labels), labels=near)
