"""What a recording shows of the set-up: light, edges, motion and time, gathered instant by instant.

The blur of an edge is measured by how steep it is. A step of the height C that a Gaussian of the
standard deviation s has blurred is C / (sqrt(2 pi) s) steep at most; one that moves by L px while the
shutter is open, C erf(L / (2 sqrt(2) s)) / L. So edges across the motion give s, those along it L, and
the speed of the image the exposure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import erf

from ..camera import Rig
from ..checks import Array
from ..files.recording import Frames
from ..following.posetracker import Tracked
from ..handle import Handle
from ..identity import labelled_pixels
from ..markers import MarkerParameters, find_markers

WHITE = 250  # grey from which on a pixel may be cut off
LOOSE = MarkerParameters(diameter_px=(2.0, 200.0), min_contrast=10.0)
MOST_UNTRACKED = 20  # instants in which spots are looked for without a pose
SMALL_PX = 160  # width of the images in which the light is watched
RAYS = 16
STEP_PX = 0.25
REACH_PX = 5.0  # beyond a marker's edge, to where it has ended
# Variance that pixels, and the interpolation between them, add to an edge: px^2.
PIXELS_PX2 = 0.25
MOST_EXPOSURE_S = 0.1
MOST_SLANTED = 0.6  # minor by major axis of a marker whose edges are looked at


class Spot(NamedTuple):
    """A marker in an image.

    Attributes
    ----------
    instant, camera, label : int
        Which instant of those looked at, which camera, and which marker, -1 if nobody knows.
    uv : ndarray, shape (2,)
    major_px, minor_px, contrast : float
        As `markers.Markers` has them.
    grey, ground : float
        Of its middle, and of what surrounds it.
    white : float
        Share of its middle's pixels that may be cut off.
    steep : ndarray, shape (16,)
        Of its edge, in directions from 0 to 360 deg from u to v: by the edge's height, 1/px.
    """

    instant: int
    camera: int
    label: int
    uv: Array
    major_px: float
    minor_px: float
    contrast: float
    grey: float
    ground: float
    white: float
    steep: Array


class Seen:
    """What has been seen so far.

    Parameters
    ----------
    names : sequence of str
        Of the cameras.
    handle : Handle or None
        Without it no marker is looked for.
    count : int
        How many instants there will be: those without a pose are looked at here and there.
    """

    def __init__(self, names: Sequence[str], handle: Handle | None, count: int = 1) -> None:
        self.names = tuple(names)
        self.handle = handle
        self.loose_every = max(count // MOST_UNTRACKED, 1)
        self.times_s: list[float] = []
        self.poses: list[RigidTransform | None] = []
        self.cameras_used: list[int] = []
        self.residuals_px: list[float] = []
        self.uv: list[Array] = []
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
            if spot.camera == camera
            and not (upright and spot.minor_px < MOST_SLANTED * spot.major_px)
        ]

    def gains(self) -> Array:
        """The light of each instant by the usual one, shape (instants, cameras): the median over
        the pixels, so that what moves does not count.
        """
        found = np.ones((len(self._small), len(self.names)))
        for camera in range(len(self.names)):
            stack = np.stack([images[camera] for images in self._small])
            usual = np.median(stack, axis=0)
            lit = usual > 8
            if lit.any():
                found[:, camera] = np.median(stack[:, lit] / usual[lit], axis=1)
        return found

    def blurs_px(self, camera: int) -> Array:
        """Standard deviation of the blur of each spot's sharpest edges, px: those across its
        motion, if it moves.
        """
        steep = [np.quantile(spot.steep, 0.75) for spot in self.of_camera(camera, upright=True)]
        found = 1 / (np.sqrt(2 * np.pi) * np.maximum(steep, 1e-3))
        return np.sqrt(np.maximum(found**2 - PIXELS_PX2, 0.01))

    def exposure(self, rig: Rig) -> Exposure | None:
        """How long the shutter is open, by the edges along the motion; None if too little moves."""
        if self.handle is None:
            return None
        velocity = self._velocities(rig)
        blur = [self.blurs_px(camera) for camera in range(len(self.names))]
        typical = [float(np.median(one)) if len(one) else np.nan for one in blur]
        speed, along, sigma = [], [], []
        for spot in self.tracked_spots:
            v = velocity.get((spot.instant, spot.camera))
            if v is None or spot.minor_px < MOST_SLANTED * spot.major_px:
                continue
            size = float(np.linalg.norm(v))
            if size * MOST_EXPOSURE_S < 2 * typical[spot.camera]:
                continue
            speed.append(size)
            along.append(_along(spot.steep, v))
            sigma.append(np.hypot(typical[spot.camera], np.sqrt(PIXELS_PX2)))
        if len(speed) < 20:
            return None
        return _fit_exposure(np.array(speed), np.array(along), np.array(sigma))

    def _velocities(self, rig: Rig) -> Mapping[tuple[int, int], Array]:
        """How fast the handle's markers move in each image, px/s, by instant and camera; those that
        face the camera in the middle.
        """
        assert self.handle is not None
        centres = self.handle.marker_centres
        found = {}
        for k in range(1, len(self.poses) - 1):
            before, after = self.poses[k - 1], self.poses[k + 1]
            step = self.times_s[k + 1] - self.times_s[k - 1]
            if before is None or after is None or not 0 < step < 0.3:
                continue
            for c, camera in enumerate(rig.cameras):
                moved = camera.project(after.apply(centres)) - camera.project(before.apply(centres))
                if np.isfinite(moved).any():
                    found[k, c] = np.nanmedian(moved, axis=0) / step
        return found

    def _add_light(self, images: Sequence[np.ndarray]) -> None:
        small, whites, noises, ranges = [], [], [], []
        for c, image in enumerate(images):
            shrink = min(1.0, SMALL_PX / image.shape[1])
            little = cv2.resize(
                image.astype(np.float32), None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA
            )
            small.append(little)
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
        measurement = tracked.measurement
        k = len(self.poses)
        self.poses.append(measurement.pose.T_world_handle)
        self.cameras_used.append(measurement.pose.cameras)
        self.residuals_px.append(measurement.pose.residual_px)
        pixels = tuple(found.uv for found in measurement.found)
        self.uv.append(labelled_pixels(measurement.labels, pixels, len(self.handle.marker_centres)))
        for c, (image, found, labels) in enumerate(
            zip(images, measurement.found, measurement.labels, strict=True)
        ):
            for n in np.flatnonzero(np.asarray(labels) >= 0):
                spot = spot_at(image, found.uv[n], found.axes_px[n], self.handle.markers)
                self.tracked_spots.append(spot._replace(instant=k, camera=c, label=int(labels[n])))

    def _add_loose(self, images: Sequence[np.ndarray]) -> None:
        """What looks like a marker: as many as a camera may see, those of the most contrast."""
        assert self.handle is not None
        count = len(self.handle.marker_centres)
        for c, image in enumerate(images):
            found = find_markers(image, count, self.handle.markers, LOOSE)
            best = np.argsort(-found.contrast)[: max(count // 3, 1)]
            for n in best:
                spot = spot_at(image, found.uv[n], found.axes_px[n], self.handle.markers)
                self.loose_spots.append(spot._replace(instant=len(self.poses) - 1, camera=c))


class Exposure(NamedTuple):
    """How long the shutter is open, s, and the range that half the spots agree on; how many spots
    tell it, and how fast they moved at most, px/s.
    """

    time_s: float
    low_s: float
    high_s: float
    spots: int
    fastest_px_s: float


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
    return Spot(
        *(-1, -1, -1, np.array(uv, float), major, minor, abs(grey - ground), grey, ground),
        white=float((middle >= WHITE).mean()),
        steep=_steepness(bright, np.array(uv, float) - [u, v] + reach, major),
    )


def _steepness(patch: np.ndarray, centre: Array, major_px: float) -> Array:
    """The largest fall of grey along rays from a bright spot's centre, by the fall from its middle
    to its surroundings, 1/px.
    """
    radii = np.arange(0.0, major_px / 2 + REACH_PX, STEP_PX)
    angles = 2 * np.pi * np.arange(RAYS) / RAYS
    u = centre[0] + np.cos(angles)[:, None] * radii
    v = centre[1] + np.sin(angles)[:, None] * radii
    grey = cv2.remap(
        patch,
        u.astype(np.float32),
        v.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    # a pixel's distance: what one pixel's noise does along less of it is no edge
    step = round(1 / STEP_PX)
    fall = (grey[:, :-step] - grey[:, step:]).max(axis=1)
    height = grey[:, : max(step, 1)].mean(axis=1) - grey.min(axis=1)
    return fall / np.maximum(height, 1.0)


def _along(steep: Array, velocity: Array) -> float:
    """The steepness of an edge along a motion, of both ends of it, 1/px."""
    angle = np.arctan2(velocity[1], velocity[0]) / (2 * np.pi) * RAYS
    front = round(angle) % RAYS
    return float((steep[front] + steep[(front + RAYS // 2) % RAYS]) / 2)


def _fit_exposure(speed: Array, along: Array, sigma: Array) -> Exposure:
    """The exposure whose steepness is nearest to the edges', in the mean of sizes."""
    times = np.concatenate([[1e-4], np.arange(0.0005, MOST_EXPOSURE_S, 0.0005)])
    expected = steepness(times[:, None] * speed, sigma)
    misfit = np.abs(expected - along)
    best = times[int(misfit.mean(axis=1).argmin())]
    single = times[misfit.argmin(axis=0)]
    low, high = np.quantile(single, [0.25, 0.75])
    return Exposure(float(best), float(low), float(high), len(speed), float(speed.max()))


def steepness(length_px: Array, sigma_px: Array | float) -> Array:
    """Of an edge of the height 1 that moved by a length while a Gaussian blurs it, 1/px."""
    length = np.maximum(length_px, 1e-6)
    return np.asarray(erf(length / (2 * np.sqrt(2) * sigma_px)) / length)


def _noise(change: Array) -> float:
    """Standard deviation of a pixel, grey levels, from the difference of two frames; what moved
    does not count.
    """
    limit = 4 * max(1.4826 * float(np.median(np.abs(change - np.median(change)))), 1.0)
    still = change[np.abs(change - np.median(change)) < limit]
    return float(still.std() / np.sqrt(2))
