"""One instant measured: from its frames to the handle's pose (Eq. 16-24)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Rig, as_rig
from .checks import as_image, frozen
from .datasets import handle_of, rig_of
from .default_covariance import known_covariance
from .estimators import estimate
from .estimators.identified import Identified
from .handle import Handle
from .identity import Hypothesis, choose, identify, labelled_pixels, relabel
from .identity.ends import keep_by_body
from .identity.reconcile import reconciled
from .markers import Markers, find_markers
from .matching import rig_candidates
from .methods import DEFAULT, PAPER
from .parameters import Parameters
from .pose import LOST, Pose
from .window import Window
from .work import Work


@dataclass(frozen=True, eq=False)
class Measurement:
    """A pose and what it was made of, for pictures and tests.

    Attributes
    ----------
    pose : Pose
    markers : tuple of Markers
        One per camera.
    labels : tuple of ndarray of int
        For each marker its index on the handle, or -1.
    """

    pose: Pose
    markers: tuple[Markers, ...]
    labels: tuple[np.ndarray, ...]


def measure(
    frames: Sequence[ArrayLike],
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    prior: RigidTransform | None = None,
    parameters: Parameters | None = None,
    windows: Sequence[Window | None] | None = None,
) -> Measurement:
    """Measure the handle's pose from the frames of one instant (Eq. 16-24).

    The estimator is ``best``, which fits the pose to the pixels, unless the parameters name another
    one: ``Parameters(estimator="paper")`` is the chain as printed.

    Parameters
    ----------
    frames : sequence of array_like, shape (height, width)
        One grey image per camera, in the rig's order; grey levels 0 to 255 of any number type. Colour
        and 16-bit images are for `recording.read_instants` to convert: an array does not say which
        channel is red, or what is white.
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones, as ``raised_40deg`` and
        ``coded``.
    prior : RigidTransform, optional
        T_world_handle expected at this instant, mm; chooses among poses that look alike.
    parameters : Parameters, optional
    windows : sequence of Window or None, optional
        W_ROI of each camera, inside its image, to which the search for markers is limited; None
        skips a camera. Without `windows` the whole images are searched.

    Returns
    -------
    Measurement
        With a pose ``measured``, ``ambiguous`` or ``lost``.

    Raises
    ------
    ValueError
        If the frames do not fit the rig in number or size, or are no grey images with levels from 0
        to 255, as images of 0 to 1; for a word that names no rig or no handle, or a file that
        cannot be read.
    """
    p = (parameters or Parameters()).with_default(DEFAULT)
    rig, handle = rig_of(rig), handle_of(handle)
    images = as_images(frames, rig)
    regions = whole_images(rig) if windows is None else windows
    markers_by_camera, hypotheses = identified(images, regions, rig, handle, p)
    pixels = tuple(markers.uv for markers in markers_by_camera)
    if not hypotheses:
        return Measurement(LOST, markers_by_camera, tuple(np.full(len(uv), -1) for uv in pixels))
    T, labels, unambiguous = chosen(hypotheses, images, rig, handle, prior, p)
    uv = labelled_pixels(labels, pixels, len(handle.marker_centres))
    near = rig
    # the paper's method takes a rig that is stated to be exact as it is
    if p.estimator != PAPER or not known_covariance(rig).is_exact:
        near, T = reconciled(rig, handle, uv, T, p.sigma_px, p.identity)
    # Eq. 19-24, or another estimator
    pose = estimate(Identified(images, uv, T, near), rig, handle, p)
    if not unambiguous and pose is not LOST:
        pose = replace(pose, status="ambiguous")
    return Measurement(pose, markers_by_camera, labels)


def whole_images(rig: Rig) -> list[Window]:
    """The window of each camera's whole image."""
    return [Window(0, 0, *camera.size) for camera in rig.cameras]


def identified(
    images: list[np.ndarray],
    windows: Sequence[Window | None],
    rig: Rig,
    handle: Handle,
    p: Parameters,
    work: Work | None = None,
) -> tuple[tuple[Markers, ...], list[Hypothesis]]:
    """The markers in windows of images, and the poses that explain them (Eq. 16-18)."""
    # Eq. 16
    markers = tuple(
        markers_in(image, window, handle, p) for image, window in zip(images, windows, strict=True)
    )
    pixels = [one.uv for one in markers]
    # Eq. 17, 18; whoever reads pixels names the markers without them
    matches = None
    if p.estimator == PAPER and not p.check:
        matches = [pairs.index for pairs in rig_candidates(rig, images, pixels, p.matching)]
    axes_px = [one.axes_px for one in markers]
    return markers, identify(rig, handle, pixels, p.identity, axes_px, matches, work)


def chosen(
    hypotheses: list[Hypothesis],
    images: list[np.ndarray],
    rig: Rig,
    handle: Handle,
    prior: RigidTransform | None,
    p: Parameters,
) -> tuple[RigidTransform, tuple[np.ndarray, ...], bool]:
    """One of the hypotheses and their equivalents: its pose, T_world_handle, its labels, and whether
    it is sure that no other one holds.
    """
    options = [
        (hypothesis, symmetry, hypothesis.T_world_handle * symmetry)
        for hypothesis in hypotheses
        for symmetry in handle.symmetries
    ]
    if len(options) > 1:
        has_body = keep_by_body(images, rig, handle, [T for *_, T in options], p.identity)
        options = [option for option, keep in zip(options, has_body, strict=True) if keep]
    index, unambiguous = choose([T for *_, T in options], prior)
    hypothesis, symmetry, T = options[index]
    labels = tuple(relabel(label, handle, symmetry) for label in hypothesis.labels)
    return T, labels, unambiguous


def markers_in(image: np.ndarray, region: Window | None, handle: Handle, p: Parameters) -> Markers:
    """The markers inside a window, in pixels of the whole image."""
    if region is None:
        return find_markers(np.zeros((1, 1)), len(handle.marker_centres), handle.markers, p.markers)
    markers = find_markers(
        region.crop(image), len(handle.marker_centres), handle.markers, p.markers
    )
    return replace(markers, uv=frozen(markers.uv + [region.u, region.v]))


def as_images(frames: Sequence[ArrayLike], rig: Rig) -> list[np.ndarray]:
    """The frames of one instant, checked: grey images of the rig's sizes."""
    as_rig(rig)
    if not isinstance(frames, (Sequence, np.ndarray)) or isinstance(frames, str):
        raise ValueError(f"frames: expected an image per camera, got {type(frames).__name__}")
    if len(frames) != len(rig.cameras):
        raise ValueError(
            f"frames: expected one for each of {len(rig.cameras)} cameras, got {len(frames)}"
        )
    images = [
        as_image(frame, f"frames: {camera.name}", camera.size, highest=255)
        for frame, camera in zip(frames, rig.cameras, strict=True)
    ]
    _check_scale(images)
    return images


def _check_scale(images: Sequence[np.ndarray]) -> None:
    """Refuse images of 0 to 1, in which every marker is darker than the noise. A black image is
    none: that a camera sees nothing is the world's doing.
    """
    if any(image.dtype.kind != "f" for image in images):
        return
    brightest = max(image.max() for image in images)
    if 0 < brightest <= 1:
        raise ValueError(
            f"frames: expected grey levels from 0 to 255, got floats from 0 to {brightest:g}; "
            "images of 0 to 1 are to be multiplied by 255"
        )
