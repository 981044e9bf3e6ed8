"""The Cramer-Rao bound of a pose: the least scatter that an unbiased estimator can have on the
pixels of the bench.

The expected image is the simulated bench's without noise; its derivatives are central differences
over the six parameters of the pose. The noise of the pixels is independent, its variance
``shot_variance * grey + read_noise ** 2`` and 1/12 for the rounding to 8 bit. The information is
the sum of J^T W J over the cameras (Kay 1993, Fundamentals of Statistical Signal Processing:
Estimation Theory, sect. 3.9; what the variance tells by changing with the grey is left out, so the
true bound is lower by less than a thousandth). Chapter 10.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from scipy.integrate import quad
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab.bench.optics import Bench, blurred
from trinolab.bench.rays import CAP, EMPTY, body_region, cast
from trinolab.bench.scene import radiance
from trinolab.camera import Camera
from trinolab.checks import Array, as_array, as_number, as_transform
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle

# of a central difference, in the image: flat from 0.05 to 0.3, `make verify ARGS="--only bound"`
STEP_PX = 0.2
SAMPLES = 32, 16  # a side of a pixel's samples at an edge of a marker, and of the body, at least
FAR = 2.0  # factor of the step at the handle's far end: edges there are straight, samples coarser
# a pixel further than this from an edge does not see it move: seven standard deviations of the blur
REACH_PX = 5
PIXELS = ("markers", "around", "handle")
RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")
# without and with the outline near the markers, see `bound.information`
SHIPPED_PIXELS = ("markers", "around")
COLUMNS = ("mean_mm", "mean_deg", "rms_mm", "rms_deg")


class Bound(NamedTuple):
    """The least covariance of a pose's estimate.

    Attributes
    ----------
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame; NaN where the pixels do not
        determine the pose.
    """

    covariance: Array

    @property
    def rms_mm(self) -> float:
        """Root mean square of the distance between estimated and true origin, mm."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def rms_deg(self) -> float:
        """Root mean square of the geodesic angle, deg."""
        return float(np.rad2deg(np.sqrt(np.trace(self.covariance[3:, 3:]))))

    @property
    def mean_mm(self) -> float:
        """Mean distance of a Gaussian error of this covariance, to hold beside E_t, mm."""
        return mean_length(self.covariance[:3, :3])

    @property
    def mean_deg(self) -> float:
        """Mean geodesic angle of a Gaussian error of this covariance, deg."""
        return float(np.rad2deg(mean_length(self.covariance[3:, 3:])))


def bound_of(information: Array) -> Bound:
    """The bound of an information matrix, shape (6, 6): its inverse, or NaN where it has none."""
    scale = np.sqrt(np.maximum(information.diagonal(), np.finfo(float).tiny))
    unit = information / np.outer(scale, scale)  # mm beside rad costs no digits
    if np.linalg.eigvalsh(unit).min() < 1e-10:
        return Bound(np.full((6, 6), np.nan))
    return Bound(np.linalg.inv(unit) / np.outer(scale, scale))


def information(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    bench: Bench | None = None,
    pixels: str = "markers",
    known_greys: bool = True,
    step_px: float = STEP_PX,
) -> Array:
    """Fisher information of one camera's frame on the pose.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    T_world_handle : RigidTransform
    bench : Bench, optional
        Its edges are sampled finer for this, see `SAMPLES`.
    pixels : {"markers", "around", "handle"}
        Which ones count: those within `REACH_PX` of a marker, without what the blur takes from the
        body's outline; the same with the outline where it passes; all within reach of the handle,
        whose background is known then.
    known_greys : bool
        Without it the nominal greys of the markers and of the body are unknown, each camera having
        its own.
    step_px : float
        How far a central difference moves what is seen, px.

    Returns
    -------
    ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame: T moves to ``exp(w) R, t + d``.
        Zero where nothing of the chosen pixels is seen.

    Raises
    ------
    ValueError
        If the pose is no rigid motion, `pixels` none of the three, or the step not positive.
    """
    T = as_transform(T_world_handle, "T_world_handle")
    step = as_number(step_px, "step_px", 0.0, open_low=True)
    bench = _finer(bench or Bench(), pixels)
    near, chosen = chosen_pixels(camera, handle, T, pixels)
    if not chosen.any():
        return np.zeros((6, 6))
    grey = expected(camera, handle, T, bench)[chosen]
    step_mm = step * float(np.linalg.norm(T.translation - camera.centre) / camera.focal.max())
    J = derivatives(
        camera, handle, T, bench, chosen, small_steps(step_mm, np.abs(handle.marker_centres).max())
    )
    if pixels == "handle":  # its far end turns further
        far = small_steps(FAR * step_mm, max(abs(handle.top_mm), abs(handle.bottom_mm)))[3:]
        J[:, 3:] = np.where(
            near[chosen][:, None], J[:, 3:], derivatives(camera, handle, T, bench, chosen, far)
        )
    if not known_greys:
        J = np.column_stack([J, grey_derivatives(camera, handle, T, bench, chosen)])
    return marginal(
        J.T @ (J / (bench.shot_variance * grey + bench.read_noise**2 + 1 / 12)[:, None])
    )


def mean_length(covariance: Array) -> float:
    """Mean length of a Gaussian vector of mean zero and a covariance, shape (n, n).

    With q the squared length, E sqrt(q) is an integral over q's Laplace transform, the product of
    (1 + 2 s^2 l)^(-1/2) over the covariance's eigenvalues l. NaN if the covariance is not finite.
    """
    C = as_array(covariance, "covariance", np.shape(covariance)[:1] * 2, finite=False)
    if np.isnan(C).any() or (largest := np.linalg.eigvalsh(C)[-1]) <= 0:
        return float("nan") if np.isnan(C).any() else 0.0
    shares = np.maximum(np.linalg.eigvalsh(C), 0) / largest
    value, _ = quad(lambda s: (1 - np.prod(1 + 2 * s * s * shares) ** -0.5) / (s * s), 0, np.inf)
    return float(value * np.sqrt(largest / np.pi))


def _finer(bench: Bench, pixels: str) -> Bench:
    """The bench with edges sampled as finely as a derivative needs; the body's not at all where it
    does not count.
    """
    marker, body = (
        max(pair)
        for pair in zip(SAMPLES, (bench.marker_supersampling, bench.supersampling), strict=True)
    )
    return replace(
        bench, marker_supersampling=marker, supersampling=1 if pixels == "markers" else body
    )


def expected(camera: Camera, handle: Handle, T: RigidTransform, bench: Bench) -> Array:
    return blurred(radiance(camera, handle, T, bench), bench)


def chosen_pixels(
    camera: Camera, handle: Handle, T: RigidTransform, pixels: str
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels near a marker, and those that count, bool (height, width)."""
    if pixels not in PIXELS:
        raise ValueError(f"pixels: expected one of {', '.join(PIXELS)}, got {pixels!r}")
    region = body_region(camera, handle, T)
    labels = np.full(region.shape, EMPTY, np.int16)
    v, u = np.nonzero(region)
    labels[v, u] = cast(camera, handle, T, np.column_stack([u, v])).labels
    parts = (labels >= 0, (labels == EMPTY) | (labels == CAP), labels != EMPTY)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH_PX + 1, 2 * REACH_PX + 1))
    near, outline, handle_too = (
        cv2.dilate(part.astype(np.uint8), disc).astype(bool) for part in parts
    )
    return near, {"markers": near & ~outline, "around": near, "handle": handle_too}[pixels]


def small_steps(step_mm: float, lever_mm: float) -> Array:
    """Steps of the six parameters that move the handle's origin, or what is so far from it, by a
    distance, (6, 6).
    """
    return np.diag(np.repeat([step_mm, step_mm / lever_mm], 3))


def derivatives(
    camera: Camera,
    handle: Handle,
    T: RigidTransform,
    bench: Bench,
    chosen: np.ndarray,
    steps: Array,
) -> Array:
    """Derivatives of the chosen pixels' grey by the parameters that steps (n, 6) change one by one,
    shape (m, n).
    """
    columns = []
    for step in steps:
        ahead, behind = (
            expected(camera, handle, moved(T, s), bench)[chosen] for s in (step, -step)
        )
        columns.append((ahead - behind) / (2 * step.sum()))
    return np.column_stack(columns)


def moved(T: RigidTransform, step: Array) -> RigidTransform:
    return RigidTransform.from_components(
        T.translation + step[:3], Rotation.from_rotvec(step[3:]) * T.rotation
    )


def grey_derivatives(
    camera: Camera, handle: Handle, T: RigidTransform, bench: Bench, chosen: np.ndarray
) -> Array:
    """Derivatives of the chosen pixels' grey by the two nominal greys, of which it is a linear
    function, (m, 2).
    """
    black = replace(bench, marker_grey=0.0, body_grey=0.0)
    dark, marker, body = (
        expected(camera, handle, T, change)[chosen]
        for change in (black, replace(black, marker_grey=100.0), replace(black, body_grey=100.0))
    )
    return np.column_stack([marker - dark, body - dark]) / 100.0


def marginal(F: Array) -> Array:
    """Information on the first six parameters where the others are unknown (Schur complement),
    shape (6, 6).
    """
    return F[:6, :6] - F[:6, 6:] @ np.linalg.pinv(F[6:, 6:]) @ F[6:, :6]


def table1_bounds(rig: str, pixels: str = "markers", known_greys: bool = True) -> list[Bound]:
    """The bound at each of Table 1's poses, for a shipped rig; the other parameters are those of
    `bound.information`.

    Raises ValueError for an unknown name.
    """
    # CCD1 and CCD2 are the same in every rig, and so is what they know
    cameras = [("paper_pair", 0), ("paper_pair", 1), (rig, 2)][: len(load_rig(rig).cameras)]
    return [
        bound_of(
            sum(
                (kept_information(*camera, row, pixels, known_greys) for camera in cameras),
                np.zeros((6, 6)),
            )
        )
        for row in tqdm(range(len(load_table1().set_poses)), leave=False, unit="pose", disable=None)
    ]


@cache
def kept_information(rig: str, camera: int, row: int, pixels: str, known_greys: bool) -> Array:
    return information(
        load_rig(rig).cameras[camera],
        load_handle("paper"),
        load_table1().set_poses[row],
        None,
        pixels,
        known_greys,
    )
