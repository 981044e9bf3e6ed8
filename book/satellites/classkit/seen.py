"""What a recording shows of the set-up: light, edges, motion and time, gathered instant by instant.

The blur of an edge is measured by how steep it is: a step of the height C that a Gaussian of the
standard deviation s has blurred is C / (sqrt(2 pi) s) steep at most. A marker that moves by L px while
the shutter is open is less steep along its motion than across it, see `steepness`; with the speed of
the image that gives the exposure, up to one that moves a marker by its own size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import ndtr

from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.files.recording import Frames
from trinolab.handle import Handle, slants
from trinolab.identity import labelled_pixels
from trinolab.markers import MarkerParameters, find_markers

from .criteria import FOCUS

if TYPE_CHECKING:
    from trinolab.following.posetracker import Tracked

WHITE = 250  # grey from which on a pixel may be cut off
LOOSE = MarkerParameters(diameter_px=(2.0, 200.0), min_contrast=10.0)
MOST_UNTRACKED = 20  # instants in which spots are looked for without a pose
SMALL_PX = 96  # width of the images in which the light is watched
LIT, LIT_SHARE = 20.0, 0.05  # grey of a pixel that shows the light, and how many are needed
RAYS = 16
STEP_PX = 0.25
EDGE_PX = 1.0  # beyond a marker's contour, to where its edge is steepest
REACH_PX = 5.0  # beyond a marker's edge, to where it has ended
# The fourth and sixth harmonic of an outline about its centre, by the zeroth: of drawn discs of 8 px
# and more at most 0.04, of a board's squares of 10 px and more at least 0.07, however slanted.
ANGULAR = 0.06
LOOSE_MORE = 4  # times the markers, of spots among which those that are no squares are taken
# Variance that pixels, and the interpolation between them, add to an edge: px^2.
PIXELS_PX2 = 0.25
MOST_EXPOSURE_S = 0.1
# Cosine of the slant of a marker whose edges are looked at, and of one whose edges along the motion
# and across it are compared.
SIDEWAYS, ROUND = 0.6, 0.85
FEWEST_TOLD = 20  # markers that move, for an exposure
SHOWN_SIGMAS = 1.5  # an edge must move by that many of its blur's, or its motion does not show


class Spot(NamedTuple):
    """A marker in an image.

    Attributes
    ----------
    instant, camera, label : int
        Which instant of those looked at, which camera, and which marker, -1 if nobody knows.
    uv : ndarray, shape (2,)
    size_px, facing : float
        Diameter of the marker, and the cosine of its slant: as the pose has them; without a pose the
        major axis of the ellipse, and the minor axis by that.
    contrast : float
    grey, ground : float
        Of its middle, and of what surrounds it.
    white : float
        Share of its middle's pixels that may be cut off.
    steep : ndarray, shape (16,)
        Of its edge, in directions from 0 to 360 deg from u to v: by the edge's height, 1/px.
    angular : float
        How far its outline is from an ellipse, see `ANGULAR`.
    """

    instant: int
    camera: int
    label: int
    uv: Array
    size_px: float
    facing: float
    contrast: float
    grey: float
    ground: float
    white: float
    steep: Array
    angular: float


class Seen:
    """What has been seen so far.

    Parameters
    ----------
    names : sequence of str
        Of the cameras.
    rig : Rig or None
    handle : Handle or None
        Without it no marker is looked for.
    count : int
        How many instants there will be: those without a pose are looked at here and there.
    """

    def __init__(
        self, names: Sequence[str], rig: Rig | None, handle: Handle | None, count: int = 1
    ) -> None:
        self.names = tuple(names)
        self.rig = rig
        self.handle = handle
        self.loose_every = max(count // MOST_UNTRACKED, 1)
        self.times_s: list[float] = []
        self.poses: list[RigidTransform | None] = []
        self.cameras_used: list[int] = []
        self.residuals_px: list[float] = []
        self.uv: list[Array] = []
        self.took_part: list[list[int]] = []
        self.tracked_spots: list[Spot] = []
        self.loose_spots: list[Spot] = []
        self.repeated = np.zeros(len(names), int)
        self.ranges: list[list[float]] = []
        self.whites: list[list[float]] = []
        self.noises: list[list[float]] = []
        self._small: list[list[Array]] = []
        self._last: list[np.ndarray] | None = None

    def add(self, now: Frames, tracked: Tracked | None) -> None:
        """One more instant, with what was found in it if it was looked for."""
        self.times_s.append(now.t_s)
        self._add_light(now.images)
        if self.handle is None:
            return
        pose = None if tracked is None else tracked.measurement.pose
        if pose is not None and tracked is not None and pose.status in ("measured", "ambiguous"):
            self._add_tracked(now.images, tracked)
            return
        self.poses.append(None)
        self.cameras_used.append(0)
        self.residuals_px.append(np.nan)
        self.uv.append(np.full((len(self.names), len(self.handle.marker_centres), 2), np.nan))
        if (len(self.poses) - 1) % self.loose_every == 0:
            self._add_loose(now.images)

    @property
    def spots(self) -> list[Spot]:
        """The markers of the instants that have a pose; where there is none, what looks like
        markers.
        """
        if self.tracked_spots or not self.loose_spots:
            return self.tracked_spots
        clear = np.quantile([spot.contrast for spot in self.loose_spots], 0.9) / 2
        return [spot for spot in self.loose_spots if spot.contrast >= clear]

    def of_camera(self, camera: int, upright: bool = False) -> list[Spot]:
        """A camera's spots, if wanted only those that are little slanted."""
        return [
            spot
            for spot in self.spots
            if spot.camera == camera and not (upright and spot.facing < SIDEWAYS)
        ]

    def gains(self) -> Array:
        """The light of each instant by the usual one, shape (instants, cameras): the median over
        the pixels, so that what moves does not count. NaN where all is dark.
        """
        gains = np.full((len(self._small), len(self.names)), np.nan)
        for camera in range(len(self.names)):
            stack = np.stack([images[camera] for images in self._small])
            usual = np.median(stack, axis=0)
            lit = usual > LIT
            if lit.mean() > LIT_SHARE:
                gains[:, camera] = np.median(stack[:, lit] / usual[lit], axis=1)
        return gains

    def blurs_px(self, camera: int) -> Array:
        """Standard deviation of the blur of each spot's sharpest edges, px: those across its
        motion, if it moves.
        """
        return np.array([_blur_px(spot) for spot in self.of_camera(camera, upright=True)])

    def exposure(self) -> Exposure | None:
        """How long the shutter is open, by the edges along the motion; None if nothing moves."""
        velocity = self._velocities()
        told: list[tuple[float, ...]] = []
        for spot in self.tracked_spots:
            v = velocity.get((spot.instant, spot.camera))
            if v is not None and spot.facing > ROUND:
                edges = _steepness_by(spot.steep, v)
                told.append((spot.camera, float(np.linalg.norm(v)), *edges, spot.size_px))
        if len(told) < FEWEST_TOLD:
            return None
        camera, speed, along, across, size = np.array(told).T
        sigma = np.empty(len(told))
        for c in np.unique(camera):
            sigma[camera == c] = 1 / (np.sqrt(2 * np.pi) * np.median(across[camera == c]))
        quick = speed >= np.median(speed)
        fit = _fit_exposure(speed[quick], along[quick], sigma[quick], size[quick])
        return fit if fit.shortest_s < MOST_EXPOSURE_S else None

    def _velocities(self) -> Mapping[tuple[int, int], Array]:
        """How fast the handle's markers move in each image, px/s, by instant and camera; those that
        face the camera in the middle.
        """
        velocities = dict[tuple[int, int], Array]()
        if self.rig is None or self.handle is None:
            return velocities
        centres = self.handle.marker_centres
        for k in range(1, len(self.poses) - 1):
            before, after = self.poses[k - 1], self.poses[k + 1]
            step = self.times_s[k + 1] - self.times_s[k - 1]
            if before is None or after is None or not 0 < step < 0.3:
                continue
            for c, camera in enumerate(self.rig.cameras):
                moved = camera.project(after.apply(centres)) - camera.project(before.apply(centres))
                if np.isfinite(moved).any():
                    velocities[k, c] = np.nanmedian(moved, axis=0) / step
        return velocities

    def _add_light(self, images: Sequence[np.ndarray]) -> None:
        small: list[Array] = []
        whites, noises, ranges = [], [], []
        for c, image in enumerate(images):
            shrink = min(1.0, SMALL_PX / image.shape[1])
            little = cv2.resize(
                image.astype(np.float32), None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA
            )
            small.append(np.asarray(little, float))
            ranges.append(float(np.subtract(*np.quantile(little, [0.99, 0.01]))))
            whites.append(float((image >= WHITE).mean()))
            if self._last is not None:
                change = image[::3, ::3].astype(float) - self._last[c][::3, ::3]
                self.repeated[c] += not change.any() and np.array_equal(image, self._last[c])
                noises.append(_noise(change))
        self._small.append(small)
        self.whites.append(whites)
        self.ranges.append(ranges)
        if noises:
            self.noises.append(noises)
        self._last = list(images)

    def _add_tracked(self, images: Sequence[np.ndarray], tracked: Tracked) -> None:
        assert self.handle is not None
        assert self.rig is not None
        measurement = tracked.measurement
        T = measurement.pose.T_world_handle
        assert T is not None
        k = len(self.poses)
        self.poses.append(measurement.pose.T_world_handle)
        self.cameras_used.append(measurement.pose.cameras)
        self.residuals_px.append(measurement.pose.residual_px)
        pixels = tuple(markers.uv for markers in measurement.markers)
        # also those of a camera that contradicts the others: it may be late
        near = measurement.labels if tracked.labels is None else tracked.labels
        self.uv.append(labelled_pixels(near, pixels, len(self.handle.marker_centres)))
        self.took_part.append([int((np.asarray(one) >= 0).sum()) for one in measurement.labels])
        for c, (image, markers, labels) in enumerate(
            zip(images, measurement.markers, measurement.labels, strict=True)
        ):
            camera = self.rig.cameras[c]
            facing = np.cos(slants(self.handle, T, camera.centre))
            depth = camera.T_cam_world.apply(T.apply(self.handle.marker_centres))[:, 2]
            size = self.handle.marker_diameter_mm * camera.focal.mean() / depth
            for n in np.flatnonzero(np.asarray(labels) >= 0):
                m = int(labels[n])
                spot = spot_at(image, markers.uv[n], markers.axes_px[n], self.handle.markers)
                self.tracked_spots.append(
                    spot._replace(instant=k, camera=c, label=m, size_px=size[m], facing=facing[m])
                )

    def _add_loose(self, images: Sequence[np.ndarray]) -> None:
        """What looks like a marker, and not like a board's square: as many as a camera may see, those
        of the most contrast.
        """
        assert self.handle is not None
        count = len(self.handle.marker_centres)
        kind = self.handle.markers
        for c, image in enumerate(images):
            markers = find_markers(image, LOOSE_MORE * count, kind, LOOSE)
            spots = (
                spot_at(image, uv, axes_px, kind)
                for uv, axes_px in zip(markers.uv, markers.axes_px, strict=True)
            )
            likely = list(islice((spot for spot in spots if not _is_square(spot)), count))
            likely.sort(key=lambda spot: -spot.contrast)
            for spot in likely[: max(count // 3, 1)]:
                self.loose_spots.append(spot._replace(instant=len(self.poses) - 1, camera=c))


def _is_square(spot: Spot) -> bool:
    """Whether a spot is angular and sharp; markers that are out of focus run into each other."""
    return spot.angular >= ANGULAR and _blur_px(spot) <= FOCUS.good


def _blur_px(spot: Spot) -> float:
    """Standard deviation of the blur of a spot's sharpest edges, px."""
    blur = 1 / (np.sqrt(2 * np.pi) * max(np.quantile(spot.steep, 0.75), 1e-3))
    return float(np.sqrt(max(blur**2 - PIXELS_PX2, 0.01)))


class Exposure(NamedTuple):
    """How long the shutter is open, s, and the shortest time that this motion can show."""

    time_s: float
    shortest_s: float


def spot_at(image: np.ndarray, uv: Array, axes_px: Array, kind: str) -> Spot:
    """A marker that was found, measured in its image; of which instant and camera nobody says."""
    major, minor = float(axes_px[0]), float(axes_px[1])
    reach = int(np.ceil(major / 2 + REACH_PX)) + 1
    u, v = (round(float(x)) for x in uv)
    rows = np.clip(np.arange(v - reach, v + reach + 1), 0, image.shape[0] - 1)
    columns = np.clip(np.arange(u - reach, u + reach + 1), 0, image.shape[1] - 1)
    patch = image[np.ix_(rows, columns)].astype(np.float32)
    radius = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
    middle = patch[radius <= max(0.25 * minor, 0.8)]
    around = patch[(radius > major / 2 + 1.5) & (radius <= major / 2 + REACH_PX)]
    grey, ground = float(np.median(middle)), float(np.median(around))
    bright = patch if kind == "bright" else 255.0 - patch
    centre = np.array(uv, float) - [u, v] + reach
    radii = np.arange(0.0, major / 2 + REACH_PX, STEP_PX)
    rays = _rays(bright, centre, radii)
    return Spot(
        *(-1, -1, -1, np.array(uv, float), major, minor / major, abs(grey - ground), grey, ground),
        white=float((middle >= WHITE).mean()),
        steep=_steepness(rays, radii, major),
        angular=_angularity(rays, radii),
    )


def _rays(patch: np.ndarray, centre: Array, radii: Array) -> np.ndarray:
    """The greys at some radii along rays from a spot's centre, shape (16, radii)."""
    angles = 2 * np.pi * np.arange(RAYS) / RAYS
    u = centre[0] + np.cos(angles)[:, None] * radii
    v = centre[1] + np.sin(angles)[:, None] * radii
    return cv2.remap(
        patch,
        u.astype(np.float32),
        v.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )


def _steepness(grey: np.ndarray, radii: Array, major_px: float) -> Array:
    """The largest fall of grey along rays from a bright spot's centre, by the fall from its middle
    to its surroundings, 1/px.
    """
    # a pixel's distance: what one pixel's noise does along less of it is no edge
    step = round(1 / STEP_PX)
    near = radii[:-step] < major_px / 2 + EDGE_PX  # farther out are the edges of others
    fall = (grey[:, :-step] - grey[:, step:])[:, near].max(axis=1)
    height = grey[:, : max(step, 1)].mean(axis=1) - grey.min(axis=1)
    return fall / np.maximum(height, 1.0)


def _angularity(grey: np.ndarray, radii: Array) -> float:
    """The share of an outline that no ellipse has, where the greys along rays from a bright spot's
    centre have fallen halfway.

    The radius r of an ellipse makes 1/r^2 a constant with a second harmonic; that of a square has
    a fourth one, if it is slanted a sixth one as well.
    """
    half = (grey[:, :4].mean() + np.median(grey.min(axis=1))) / 2
    below = grey[:, 1:] < half
    out = np.where(below.any(axis=1), below.argmax(axis=1), len(radii) - 2)
    before, after = np.take_along_axis(grey, out[:, None] + [0, 1], axis=1).T
    part = np.clip((before - half) / np.maximum(before - after, 1e-6), 0.0, 1.0)
    harmonics = np.abs(np.fft.rfft((radii[out] + STEP_PX * part + 1e-6) ** -2))
    return float(np.hypot(harmonics[4], harmonics[6]) * np.sqrt(2) / harmonics[0])


def _steepness_by(steep: Array, velocity: Array) -> tuple[float, float]:
    """The steepness of the edges along a motion and across it, each of both ends, 1/px."""
    quarter = RAYS // 4
    front = round(np.arctan2(velocity[1], velocity[0]) / (2 * np.pi) * RAYS) % RAYS
    ends = steep[(front + quarter * np.arange(4)) % RAYS]
    return float(ends[::2].mean()), float(ends[1::2].mean())


def _fit_exposure(speed: Array, along: Array, sigma: Array, size: Array) -> Exposure:
    """The exposure whose steepness is nearest to the edges', in the mean of sizes."""
    times = np.arange(0.0005, MOST_EXPOSURE_S, 0.0005)
    # by how much motion makes them less steep, so that what pixels do to both drops out
    resting = steepness(np.full_like(speed, 1e-3), sigma, size)
    expected = steepness(times[:, None] * speed, sigma, size) / resting
    misfit = np.abs(expected - along * np.sqrt(2 * np.pi) * sigma).mean(axis=1)
    shortest = float(np.median(SHOWN_SIGMAS * sigma / np.maximum(speed, 1e-9)))
    return Exposure(float(times[int(misfit.argmin())]), shortest)


def steepness(length_px: Array, sigma_px: Array, size_px: Array) -> Array:
    """Of the edge of a bar that moved by a length while a Gaussian blurred it, by the grey of its
    middle, 1/px.

    The bar of the width D convolved with the motion L and the Gaussian s has at x the slope (Phi((x +
    (D + L) / 2) / s) - Phi((x + (D - L) / 2) / s) - Phi((x - (D - L) / 2) / s) + Phi((x - (D + L) / 2) /
    s)) / L; it is taken at the edge, D / 2. A motion beyond D does not change it any more.
    """
    half, reach = size_px / 2, np.maximum(length_px, 1e-6) / 2
    ends = (half + reach, half - reach, reach - half, -half - reach)
    signs = (1, -1, -1, 1)
    slope = sum(k * ndtr((half + x) / sigma_px) for k, x in zip(signs, ends, strict=True))
    height = sum(k * _ramp(x, sigma_px) for k, x in zip(signs, ends, strict=True))
    return np.asarray(-slope / np.maximum(height, 1e-9))


def _ramp(x: Array, sigma: Array) -> Array:
    """The integral of Phi(x / sigma)."""
    density = np.exp(-0.5 * (x / sigma) ** 2) / np.sqrt(2 * np.pi)
    return x * ndtr(x / sigma) + sigma * density


def _noise(change: Array) -> float:
    """Standard deviation of a pixel, grey levels, from the difference of two frames; what moved
    does not count.
    """
    limit = 4 * max(1.4826 * float(np.median(np.abs(change - np.median(change)))), 1.0)
    still = change[np.abs(change - np.median(change)) < limit]
    return float(still.std() / np.sqrt(2))
