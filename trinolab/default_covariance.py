"""The covariance of a rig, and the tolerances of a handle, whose files do not say how well they are known.

Other programs write rig files without uncertainties, and no calibration is exact. A rig that states
nothing is taken for a calibration of usual quality. Single parameters may be far off, a principal
point by a pixel, if the direction compensates for it. A calibration is accurate in the images of
the place where it was made. Parameters with wide standard deviations are therefore conditioned on
the images of four points there: each camera's image of them may be shifted as a whole by
`IMAGE_PX`, and each point by a further `CORNER_SHARE` of that.

The size of these errors is itself hardly known, which the covariance expresses by its degrees of
freedom (`camera.RigCovariance.freedom`); the residuals decide. With half a degree of freedom, three
in four calibrations are worse than `IMAGE_PX`, one in two is worse than 2.4 times that, 0.6 px, and
one in four is worse than 2.4 px.

**Where the numbers are from.** Simulated calibrations with 14 views of a board and corners accurate
to 0.05 px err by 0.3 to 0.5 px in the images of the work volume, nearly all of it a motion of the
first camera's frame; with corners accurate to 0.3 px they err by 2 to 3 px. OpenCV's stereo
photographs, calibrated from halves of them, give 2 px per image, of which 0.06 px is not a motion
of that frame. Rigs that others calibrated fit their own points to 0.3 to 0.5 px. Good calibrations
therefore err by a quarter of a pixel, average ones by half a pixel to one pixel, and bad ones by 2
px and more. The part that is not a motion of that frame is a twentieth of it or less. A quarter per
point, which lets a camera roll by as much as it tilts, is on the safe side. In good calibrations
the cameras' places err by 0.02 mm across the line of sight and, where it hardly matters, by 0.1 mm
along it. `tests/workbench/studies/test_usual_evidence.py` computes these numbers again. For a
printed handle: PLA shrinks by 0.1 to 0.3 % (toolsfast.app/3d-printing/fdm-tolerance-guide).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from .camera import Camera, Rig, RigCovariance, pixels_with_slopes
from .checks import Array, frozen
from .handle import Handle
from .rigid import cross_matrices

IMAGE_PX = 0.25  # by which the image of the work volume is shifted each way, or more
FREEDOM = 0.5  # how well that is known
MIDDLE_HALF = frozen(
    np.array([0.25, 0.75])
)  # of the calibrations; chances that their size is smaller
PLACEMENT_MM = 0.05  # of each coordinate of each marker
# By which a handle is larger than its file says, or smaller, as prints are; all markers have it in
# common, and a pair of cameras takes it for a distance.
SCALE_SHARE = 0.002
CORNER_SHARE = 0.25  # of that, by which each of the four points is off besides
# Wide standard deviations: of fx and fy (a share of them), cx and cy (px), the direction (rad) and
# the place (mm). The lens's distortions are kept.
FOCAL_SHARE, CENTRE_PX, TURN_RAD, SHIFT_MM = 1e-3, 1.0, np.deg2rad(0.05), 0.05
# The four points lie around the middle of the work, a tenth of its distance to either side.
_CORNERS, _ASIDE = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]), 0.1
# Where the optical axes do not meet, the work is taken to be this many baselines away.
_BASELINES_AWAY, _PULL = 5.0, 1e-3


def known_covariance(rig: Rig) -> RigCovariance:
    """The covariance that a rig states, else its `default_covariance`."""
    return default_covariance(rig) if rig.covariance is None else rig.covariance


def known_placement_mm(handle: Handle) -> float:
    """The standard deviation of marker placement that a handle states, else `PLACEMENT_MM`."""
    stated = handle.placement_sigma_mm
    return PLACEMENT_MM if stated is None else stated


def known_scale_share(handle: Handle) -> float:
    """The relative uncertainty of a handle's size: `SCALE_SHARE`, or zero where its file states how
    well the markers are placed.
    """
    return SCALE_SHARE if handle.placement_sigma_mm is None else 0.0


def assumed(rig: Rig, handle: Handle, rig_file: object, handle_file: object) -> list[str]:
    """A line for each assumption about a rig and a handle whose files state nothing."""
    lines = []
    if rig.covariance is None:
        low, high = _image_px(rig) * np.sqrt(FREEDOM / chdtri(FREEDOM, MIDDLE_HALF))
        lines.append(
            f"{rig_file}: does not say how well the cameras are known; a usual calibration is assumed, "
            f"{low:.2g} to {high:.2g} px per image: what the images contradict tells how much"
        )
    if handle.placement_sigma_mm is None:
        lines.append(
            f"{handle_file}: does not say how well the markers are placed; placement_sigma_mm = "
            f"{PLACEMENT_MM:g} is assumed, and a size that is right to {100 * SCALE_SHARE:g} %"
        )
    return lines


@lru_cache(maxsize=64)
def default_covariance(rig: Rig) -> RigCovariance:
    """The covariance of a rig whose file does not state one."""
    return usual_covariance(rig, _image_px(rig))


def _image_px(rig: Rig) -> float:
    return IMAGE_PX if rig.reprojection_px is None else rig.reprojection_px


def usual_covariance(rig: Rig, image_px: float = IMAGE_PX) -> RigCovariance:
    """The covariance of a calibration of usual quality.

    Parameters
    ----------
    rig : Rig
    image_px : float
        Standard deviation of the shift of each camera's image of the work volume, in each
        direction.
    """
    middle = _middle(rig)
    blocks = [_of_camera(camera, middle, image_px) for camera in rig.cameras]
    return RigCovariance(rig.names, block_diag(*blocks), FREEDOM)


def _of_camera(camera: Camera, middle: Array, image_px: float) -> Array:
    """The wide covariance of a camera's parameters, conditioned on the images of four points at the
    distance of the work.
    """
    n = len(camera.parameters)
    wide = np.zeros((n, n))
    wide[:4, :4] = np.diag(np.r_[FOCAL_SHARE * camera.focal, CENTRE_PX, CENTRE_PX] ** 2)
    # a turn about the camera's centre takes the world's origin along
    by_turn = np.concatenate([np.eye(3), -cross_matrices(camera.T_cam_world.translation)])
    wide[-6:, -6:] = TURN_RAD**2 * by_turn @ by_turn.T
    wide[-3:, -3:] += SHIFT_MM**2 * np.eye(3)
    right_and_down = camera.T_world_cam.rotation.as_matrix()[:, :2]
    beside = _ASIDE * np.linalg.norm(middle - camera.centre) * right_and_down
    points = middle + _CORNERS @ beside.T
    slopes = pixels_with_slopes(camera, points)[1]
    J = slopes[np.isfinite(slopes).all(axis=(1, 2))].reshape(-1, n)
    together = np.tile(np.eye(2), (len(J) // 2, 1))
    noise = image_px**2 * (together @ together.T + CORNER_SHARE**2 * np.eye(len(J)))
    gain = np.linalg.solve(J @ wide @ J.T + noise, J @ wide).T
    left = wide - gain @ J @ wide
    return (left + left.T) / 2


def _middle(rig: Rig) -> Array:
    """The point nearest to all optical axes, world frame, (3,), mm; of axes that hardly meet some
    baselines ahead.
    """
    axes = np.stack([camera.axis for camera in rig.cameras])
    centres = np.stack([camera.centre for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    baseline = max(np.linalg.norm(centres[i] - centres[j]) for i, j in rig.pairs)
    ahead = centres.mean(axis=0) + _BASELINES_AWAY * baseline * axes.mean(axis=0)
    right = (across @ centres[..., None]).sum(axis=0)[:, 0] + _PULL * ahead
    return np.linalg.solve(across.sum(axis=0) + _PULL * np.eye(3), right)
