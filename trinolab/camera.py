"""Cameras and rigs: projection, rays, epipolar geometry.

Camera frame: x right, y down, z forward; the world frame is that of the rig file. Pixels ``uv``:
(0, 0) is the centre of the top-left pixel. Lens distortion is OpenCV's model of five coefficients (k1,
k2, p1, p2, k3), or its rational one of eight (k4, k5, k6 as well).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array, as_array, as_number, as_points, as_transform, as_unit, frozen, whole_rows
from .lens import as_intrinsics, as_size, distort, project_with_slopes, undistort
from .rigid import cross_matrices

NEAREST_MM = 1e-6  # depth from which on a point is in front of a camera
DISTORTIONS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
PARALLEL = 1e-6  # sine of the angle below which a camera looks along its `up`
NO_ROTATION = 1e-3  # of R R^T: what three digits of a printed matrix leave
_ROUNDING = 1e-6  # of a covariance whose variances are 1: what rounded digits may leave


def parameters_of(distortions: int) -> tuple[tuple[str, str], ...]:
    """The parameters of a camera with so many distortions, in the order of `RigCovariance`, with their
    units.
    """
    return (
        *((name, "px") for name in ("fx", "fy", "cx", "cy")),
        *((name, "1") for name in DISTORTIONS[:distortions]),
        *((f"rotation_{axis}", "rad") for axis in "xyz"),
        *((f"translation_{axis}", "mm") for axis in "xyz"),
    )


CAMERA_PARAMETERS = parameters_of(5)  # of most cameras


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated pinhole camera with lens distortion.

    Attributes
    ----------
    name : str
    size : (int, int)
        Width and height in pixels.
    matrix : ndarray, shape (3, 3)
        Intrinsic matrix in pixels; no skew.
    distortions : ndarray, shape (5,) or (8,)
        k1, k2, p1, p2, k3 and perhaps k4, k5, k6. Four numbers are taken for five of which the last is
        zero.
    T_cam_world : RigidTransform
        World to camera, mm.

    Raises
    ------
    ValueError
        For a name that is no line of text, a size that is not two positive whole numbers, a matrix
        of another form than [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with focal lengths from 1e-6 to
        1e9 px and cx, cy within 1e9, other than 4, 5 or 8 distortions up to 1e6, or anything but one
        finite transform.
    """

    name: str
    size: tuple[int, int]
    matrix: Array
    distortions: Array
    T_cam_world: RigidTransform

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or not self.name.isprintable():
            raise ValueError(f"name: expected a camera's name, got {self.name!r}")
        object.__setattr__(self, "size", as_size(self.size))
        object.__setattr__(self, "matrix", as_intrinsics(self.matrix))
        lens = as_array(self.distortions, "distortions", (None,))
        if len(lens) not in (4, 5, 8):
            raise ValueError(f"distortions: expected 4, 5 or 8, got {len(lens)}")
        object.__setattr__(self, "distortions", lens if len(lens) > 4 else lengthened(lens, 5))
        as_number(np.abs(self.distortions).max(), "distortions: the largest", high=1e6)
        as_transform(self.T_cam_world, "T_cam_world")

    @classmethod
    def look_at(
        cls,
        name: str,
        size: tuple[int, int],
        focal_px: float,
        centre: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, -1.0, 0.0),
        distortions: ArrayLike | None = None,
    ) -> Camera:
        """A camera that stands at one point and looks at another, its principal point in the middle
        of the image.

        Parameters
        ----------
        name : str
        size : (int, int)
            Width and height in pixels.
        focal_px : float
            Focal length, px: the width in pixels times the lens's focal length over the width of
            the sensor.
        centre, target : array_like, shape (3,)
            The camera's position, and a point on its optical axis; world frame, mm.
        up : array_like, shape (3,)
            The direction of the world that points upwards in the image. The default is that of a
            world whose y axis points down, as in the shipped rigs; with z upwards it is (0, 0, 1).
        distortions : array_like of 4, 5 or 8 numbers, optional
            k1, k2, p1, p2, k3, k4, k5, k6; without them none.

        Raises
        ------
        ValueError
            If centre and target are one point, if it looks along `up`, and as `Camera`.
        """
        width, height = as_size(size)
        f = as_number(focal_px, "focal_px", low=0.0, open_low=True)
        start = as_array(centre, "centre", (3,))
        z = as_unit(as_array(target, "target", (3,)) - start, "target - centre")
        upwards = as_unit(up, "up")
        right = np.cross(z, upwards)
        if np.linalg.norm(right) < PARALLEL:
            raise ValueError(
                "up: expected a direction across that from centre to target, got one along it"
            )
        x = as_unit(right, "up")
        rotation = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
        matrix = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]
        T_world_cam = RigidTransform.from_components(start, rotation)
        lens = np.zeros(5) if distortions is None else distortions
        return cls(name, size, matrix, lens, T_world_cam.inv())  # type: ignore[arg-type]

    @classmethod
    def from_opencv(
        cls,
        name: str,
        size: tuple[int, int],
        K: ArrayLike,
        R: ArrayLike,
        t: ArrayLike,
        distortions: ArrayLike | None = None,
    ) -> Camera:
        """A camera from what OpenCV's calibration, or its solvePnP, gives.

        Parameters
        ----------
        name : str
        size : (int, int)
            Width and height in pixels.
        K : array_like, shape (3, 3)
            Intrinsic matrix, px; no skew.
        R : array_like, shape (3, 3), or of 3 numbers
            World to camera: a rotation matrix, or a Rodrigues vector, rad.
        t : array_like of 3 numbers
            World to camera, **mm**: a point X of the world is at R X + t before the camera.
        distortions : array_like of 4, 5 or more numbers, optional
            k1, k2, p1, p2, k3, k4, k5, k6 in OpenCV's order; without them none. Further ones
            (thin-prism, tilted models) must be zero.

        Raises
        ------
        ValueError
            For an R that is no rotation, distortions that are not supported, and as `Camera`.
        """
        shift = as_array(np.ravel(t), "t", (3,))
        lens = as_array(
            np.ravel(() if distortions is None else distortions), "distortions", (None,)
        )
        T_cam_world = RigidTransform.from_components(shift, _opencv_rotation(R))
        return cls(name, size, K, as_distortions(lens), T_cam_world)  # type: ignore[arg-type]

    @cached_property
    def T_world_cam(self) -> RigidTransform:
        """Camera to world; its translation is the camera's centre in mm."""
        return self.T_cam_world.inv()

    @cached_property
    def centre(self) -> Array:
        """Centre of projection in the world frame, shape (3,), mm."""
        return frozen(self.T_world_cam.translation)

    @cached_property
    def axis(self) -> Array:
        """Direction of the optical axis in the world frame, shape (3,), length 1."""
        return frozen(self.T_world_cam.rotation.as_matrix()[:, 2])

    @property
    def parameters(self) -> tuple[tuple[str, str], ...]:
        """Its parameters, in the order of `RigCovariance`, with their units."""
        return parameters_of(len(self.distortions))

    @property
    def focal(self) -> Array:
        """fx and fy, shape (2,), px."""
        return self.matrix[[0, 1], [0, 1]]

    @property
    def principal_point(self) -> Array:
        """cx and cy, shape (2,), px."""
        return self.matrix[:2, 2]

    def project(self, points: ArrayLike) -> Array:
        """Project world points to pixels.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            World frame, mm.

        Returns
        -------
        ndarray, shape (n, 2)
            Pixels; NaN where a point is missing, not in front of the camera, or so far aside that
            the distortion model folds back. Points outside the image are returned all the same, see
            `sees`.
        """
        return image_of(self, as_points(points, "points", 3))

    def to_pixels(self, xy: ArrayLike) -> Array:
        """Normalised ideal coordinates (x/z, y/z), shape (n, 2), to pixels of the distorted image,
        shape (n, 2).

        NaN for missing points and where `project` gives none.
        """
        return distorted_pixels(self, as_points(xy, "xy", 2))

    def normalise(self, uv: ArrayLike) -> Array:
        """Pixels of the distorted image, shape (n, 2), to normalised ideal coordinates (x/z, y/z),
        shape (n, 2).

        NaN for missing points and where no ideal point maps to the pixel.
        """
        return ideal_coordinates(self, as_points(uv, "uv", 2))

    def ideal_pixels(self, uv: ArrayLike) -> Array:
        """Pixels with the lens distortion removed, shape (n, 2); epipolar lines are straight only
        among these.

        NaN where `normalise` gives none.
        """
        return ideal_pixels_of(self, as_points(uv, "uv", 2))

    def rays(self, uv: ArrayLike) -> Array:
        """Directions of the viewing rays through pixels, world frame, shape (n, 3), length 1; they
        start at `centre`.

        NaN where `normalise` gives none.
        """
        xy = self.normalise(uv)
        local = np.column_stack([xy, np.ones(len(xy))])
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        return self.T_world_cam.rotation.apply(local)

    def sees(self, points: ArrayLike, margin_px: float = 0.0) -> np.ndarray:
        """Whether world points, shape (n, 3), fall into the image at least `margin_px` from its
        edge; bool (n,).

        False where `project` gives no pixel.
        """
        as_number(margin_px, "margin_px")
        uv = self.project(points)
        high = np.array(self.size) - 0.5 - margin_px
        return np.asarray(((uv >= margin_px - 0.5) & (uv <= high)).all(axis=1))


def as_distortions(given: Array) -> Array:
    """A camera's distortions from as many coefficients as OpenCV gives, five where k4, k5, k6 are zero;
    ValueError where ones beyond these are not.
    """
    if len(given) not in (0, 4, 5, 8, 12, 14):
        raise ValueError(f"distortions: expected 0, 4, 5, 8, 12 or 14, got {len(given)}")
    if given[8:].any():
        raise ValueError(
            f"distortions: expected {', '.join(DISTORTIONS)}, got others that are not zero; calibrate "
            "without the thin-prism and the tilted model"
        )
    return lengthened(given[:8] if given[5:].any() else given[:5], 5)


def lengthened(distortions: Array, count: int) -> Array:
    """Distortions with zeros behind them, so that they are at least so many."""
    return frozen(np.pad(distortions, (0, max(count - len(distortions), 0))))


def of_one_model(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """The cameras, all of them with as many distortions as the one that has most."""
    most = max(len(camera.distortions) for camera in cameras)
    return tuple(
        camera
        if len(camera.distortions) == most
        else replace(camera, distortions=lengthened(camera.distortions, most))
        for camera in cameras
    )


def _opencv_rotation(R: ArrayLike) -> Rotation:
    """A rotation from a matrix, which must be one, or from a Rodrigues vector, rad."""
    if np.size(R) == 3:
        return Rotation.from_rotvec(np.array(as_array(np.ravel(R), "R", (3,))))
    matrix = as_array(R, "R", (3, 3))
    off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if off > NO_ROTATION or np.linalg.det(matrix) < 0:
        raise ValueError(
            f"R: expected a rotation matrix or a Rodrigues vector, got a matrix whose R R^T is off "
            f"by {off:.2g} and whose determinant is {np.linalg.det(matrix):.4g}"
        )
    return Rotation.from_matrix(matrix)


# What the camera's methods call after their checks, and the package where the arrays are its own.


def image_of(camera: Camera, points: Array) -> Array:
    """`Camera.project` of points (n, 3) that need no check."""
    local = camera.T_cam_world.apply(points)
    z = np.where(local[:, 2:] > NEAREST_MM, local[:, 2:], np.nan)
    return distorted_pixels(camera, whole_rows(local[:, :2] / z))


def distorted_pixels(camera: Camera, xy: Array) -> Array:
    """`Camera.to_pixels` of coordinates (n, 2) that need no check."""
    return whole_rows(distort(xy, camera.distortions)[0] * camera.focal + camera.principal_point)


def ideal_coordinates(camera: Camera, uv: Array) -> Array:
    """`Camera.normalise` of pixels (n, 2) that need no check."""
    u, v = uv.T
    # column by column: NumPy is slow along an axis of two
    xy = np.column_stack(
        [
            (u - camera.principal_point[0]) / camera.focal[0],
            (v - camera.principal_point[1]) / camera.focal[1],
        ]
    )
    return undistort(xy, camera.distortions)


def ideal_pixels_of(camera: Camera, uv: Array) -> Array:
    """`Camera.ideal_pixels` of pixels (n, 2) that need no check."""
    return whole_rows(ideal_coordinates(camera, uv) * camera.focal + camera.principal_point)


@dataclass(frozen=True, eq=False)
class RigCovariance:
    """The uncertainty of a rig: the covariance of all parameters of its cameras.

    Attributes
    ----------
    names : tuple of str
        Of the cameras, in the order of the rig.
    matrix : ndarray, shape (15 c, 15 c), or (18 c, 18 c) of the rational model
        For each camera fx, fy, cx, cy (px), its distortions, a small rotation d (3, rad; the
        camera's R_cam_world becomes exp(d) R_cam_world) and the translation of T_cam_world (3,
        mm), see `displaced`. Rows of exactly known parameters are zero, such as those of the first
        camera's pose where it defines the world frame.
    freedom : float
        Uncertainty of the matrix's own size: the degrees of freedom of the variances (GUM, annex
        G.3), infinity where they are certain. A factor common to all of them then has a scaled
        inverse chi-square distribution.

    Raises
    ------
    ValueError
        If the matrix has another shape, is not finite, not symmetric, or has a negative eigenvalue;
        for a freedom that is not positive.
    """

    names: tuple[str, ...]
    matrix: Array
    freedom: float = np.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        few, many = (len(self.names) * len(parameters_of(m)) for m in (5, 8))
        n = many if np.shape(self.matrix)[:1] == (many,) else few
        object.__setattr__(self, "matrix", _as_covariance(self.matrix, n))
        if not self.freedom > 0:
            raise ValueError(f"freedom: expected a positive number, got {self.freedom!r}")

    @classmethod
    def exact(cls, names: Sequence[str]) -> RigCovariance:
        """The covariance of cameras that are known exactly, as those of simulated images are:
        zeros.
        """
        n = len(CAMERA_PARAMETERS) * len(names)
        return cls(tuple(names), np.zeros((n, n)))

    @property
    def parameters(self) -> tuple[tuple[str, str], ...]:
        """A camera's parameters, in the order of the matrix, with their units."""
        return parameters_of(len(self.matrix) // len(self.names) - len(parameters_of(0)))

    @cached_property
    def is_exact(self) -> bool:
        """Whether nothing is uncertain."""
        return not self.matrix.any()


def _as_covariance(value: ArrayLike, n: int) -> Array:
    """A covariance matrix (n, n), checked with all variances brought to 1: its units differ."""
    matrix = as_array(value, "matrix", (n, n))
    if (np.diag(matrix) < 0).any():
        raise ValueError("matrix: expected a covariance, got a negative variance")
    sigma = np.sqrt(np.diag(matrix))
    known = sigma == 0
    unit = matrix / np.outer(np.where(known, 1.0, sigma), np.where(known, 1.0, sigma))
    if np.abs(unit - unit.T).max(initial=0.0) > _ROUNDING:
        raise ValueError("matrix: expected a covariance, got a matrix that is not symmetric")
    if np.any(matrix[known]):
        raise ValueError("matrix: expected a covariance, got one of a number without a variance")
    smallest = np.linalg.eigvalsh(unit).min(initial=0.0)
    if smallest < -_ROUNDING:
        raise ValueError(
            f"matrix: expected a covariance, got a negative eigenvalue ({smallest:.2g} "
            "with all variances brought to 1)"
        )
    return matrix


@dataclass(frozen=True, eq=False)
class Rig:
    """Two or more cameras in one world frame; their order is the camera axis of every array.

    Attributes
    ----------
    cameras : tuple of Camera
        All of them have eight distortions if one has.
    covariance : RigCovariance or None
        Uncertainty of the cameras. None, where it is unknown, stands for a calibration of usual
        quality (`default_covariance`), and `RigCovariance.exact` for exactly known cameras.
    reprojection_px : float or None
        Reprojection error of the calibration's own points, if the rig's file states it: a measure
        of its quality where there is no covariance.

    Raises
    ------
    ValueError
        For fewer than two cameras, two of one name, a covariance of other cameras, or a
        reprojection error that is not positive.
    """

    cameras: tuple[Camera, ...]
    covariance: RigCovariance | None = None
    reprojection_px: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.cameras, str) or not isinstance(self.cameras, Iterable):
            raise ValueError(f"cameras: expected two or more, got {self.cameras!r:.60}")
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if wrong := [camera for camera in self.cameras if not isinstance(camera, Camera)]:
            raise ValueError(f"cameras: expected values of Camera, got {wrong[0]!r:.60}")
        if len(self.cameras) < 2:
            raise ValueError(f"cameras: expected two or more, got {len(self.cameras)}")
        if len(set(self.names)) < len(self.cameras):
            raise ValueError(f"cameras: expected different names, got {', '.join(self.names)}")
        object.__setattr__(self, "cameras", of_one_model(self.cameras))
        if self.covariance is not None and self.covariance.names != self.names:
            raise ValueError(
                f"covariance: expected one of the cameras {', '.join(self.names)}, "
                f"got {', '.join(self.covariance.names)}"
            )
        if self.covariance is not None and self.covariance.parameters != self.parameters:
            if not self.covariance.is_exact:
                raise ValueError(
                    f"covariance: expected one of {len(self.parameters)} parameters per camera, "
                    f"got {len(self.covariance.parameters)}"
                )
            n = len(self.parameters) * len(self.cameras)
            object.__setattr__(self, "covariance", RigCovariance(self.names, np.zeros((n, n))))
        if self.reprojection_px is not None:
            as_number(self.reprojection_px, "reprojection_px", low=0.0, open_low=True)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self.cameras)

    @property
    def parameters(self) -> tuple[tuple[str, str], ...]:
        """The parameters of each camera, in the order of `RigCovariance`, with their units."""
        return self.cameras[0].parameters

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Index pairs (left, right) of the binocular systems: (0, 1), (0, 2), (1, 2) for three
        cameras.
        """
        n = len(self.cameras)
        return tuple((i, j) for i in range(n) for j in range(i + 1, n))

    def part(self, chosen: Sequence[int]) -> Rig:
        """Some of the cameras, by their indices, known as well as they are."""
        cameras = tuple(self.cameras[k] for k in chosen)
        if self.covariance is None:
            return replace(self, cameras=cameras)
        n = len(self.parameters)
        rows = (n * np.array(chosen)[:, None] + np.arange(n)).ravel()
        known = replace(
            self.covariance,
            names=tuple(camera.name for camera in cameras),
            matrix=self.covariance.matrix[np.ix_(rows, rows)],
        )
        return replace(self, cameras=cameras, covariance=known)


def as_rig(value: object, name: str = "rig") -> Rig:
    """Check that something is a rig; ValueError explains how to load one by its name."""
    if not isinstance(value, Rig):
        raise ValueError(f"{name}: expected a Rig, as trinolab.load_rig gives, got {value!r:.60}")
    return value


def displaced(rig: Rig, delta: ArrayLike) -> Rig:
    """The rig whose parameters differ by a vector in the order of `RigCovariance`.

    Parameters
    ----------
    rig : Rig
    delta : array_like, shape (15 c,) or (18 c,)
        px, rad and mm; a draw from the rig's covariance gives a rig as it may be.

    Raises
    ------
    ValueError
        For a vector of another length, or cameras that `Camera` refuses.
    """
    n = len(rig.parameters)
    rows = as_array(delta, "delta", (n * len(rig.cameras),)).reshape(-1, n)
    cameras = [_displaced(*one) for one in zip(rig.cameras, rows, strict=True)]
    return replace(rig, cameras=tuple(cameras))


def _displaced(camera: Camera, delta: Array) -> Camera:
    lens, distortions, turn, shift = np.split(delta, [4, -6, -3])
    matrix = camera.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += lens
    T = camera.T_cam_world
    rotation = Rotation.from_rotvec(np.array(turn)) * T.rotation  # SciPy wants it writable
    return replace(
        camera,
        matrix=matrix,
        distortions=camera.distortions + distortions,
        T_cam_world=RigidTransform.from_components(T.translation + shift, rotation),
    )


def difference(rig: Rig, start: Rig) -> Array:
    """Differences of a rig's cameras from those of another rig, shape (cameras, 15) or (cameras, 18): the
    vector that `displaced` takes.
    """
    rows = []
    for camera, reference in zip(rig.cameras, start.cameras, strict=True):
        turn = camera.T_cam_world.rotation * reference.T_cam_world.rotation.inv()
        rows.append(
            np.concatenate(
                [
                    camera.focal - reference.focal,
                    camera.principal_point - reference.principal_point,
                    camera.distortions - reference.distortions,
                    turn.as_rotvec(),
                    camera.T_cam_world.translation - reference.T_cam_world.translation,
                ]
            )
        )
    return np.stack(rows)


def pixels_with_slopes(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """The images of points, and how they move with a camera's parameters and with the points.

    Parameters
    ----------
    camera : Camera
    points : ndarray, shape (n, 3)
        World frame, mm.

    Returns
    -------
    uv : ndarray, shape (n, 2)
        px.
    by_parameters : ndarray, shape (n, 2, 15) or (n, 2, 18)
        In the order of `RigCovariance`.
    by_points : ndarray, shape (n, 2, 3)
        World frame, px/mm. NaN in all where `Camera.project` gives no pixel.
    """
    T = camera.T_cam_world.as_matrix()
    arms = points @ T[:3, :3].T
    lens = np.concatenate([camera.focal, camera.principal_point, camera.distortions])
    uv, by_lens, by_local = project_with_slopes(lens, arms + T[:3, 3])
    by_turn = -by_local @ cross_matrices(arms)
    by_parameters = np.concatenate([by_lens, by_turn, by_local], axis=2)
    return uv, by_parameters, by_local @ T[:3, :3]


@lru_cache(maxsize=256)
def T_between(target: Camera, source: Camera) -> RigidTransform:
    """The motion T_target_source between two cameras' frames: R_rl, T_rl of Sect. 5.3, either way
    round (Eq. 19).
    """
    return target.T_cam_world * source.T_world_cam


@lru_cache(maxsize=256)
def fundamental_matrix(left: Camera, right: Camera) -> Array:
    """The matrix F with ``right_uv1 @ F @ left_uv1 = 0`` for ideal pixels (Hartley and Zisserman
    2004, ch. 9).

    Returns
    -------
    ndarray, shape (3, 3)
        Scaled to unit Frobenius norm.

    Raises
    ------
    ValueError
        If both cameras stand in one place.
    """
    T_right_left = T_between(right, left)
    t = T_right_left.translation
    if np.linalg.norm(t) < 1e-9:
        raise ValueError(
            f"cameras {left.name} and {right.name}: expected two places, got one (no baseline)"
        )
    essential = np.cross(t, T_right_left.rotation.as_matrix(), axisb=0, axisc=0)
    F = np.linalg.inv(right.matrix).T @ essential @ np.linalg.inv(left.matrix)
    return frozen(F / np.linalg.norm(F))


def epipolar_lines(left: Camera, right: Camera, uv: ArrayLike) -> Array:
    """Epipolar lines in the right image of pixels in the left one.

    Parameters
    ----------
    uv : array_like, shape (n, 2)
        Pixels of the left image as taken (distorted).

    Returns
    -------
    ndarray, shape (n, 3)
        a, b, c with a^2 + b^2 = 1, so that a u + b v + c is a distance in ideal pixels; NaN for
        missing pixels, and for the image of the right camera's centre, which has no line. Raises
        ValueError if both cameras stand in one place.
    """
    return lines_of(left, right, left.ideal_pixels(uv))


def lines_of(left: Camera, right: Camera, ideal: Array) -> Array:
    """`epipolar_lines` of ideal pixels (n, 2) that need no check."""
    F = fundamental_matrix(left, right)
    points = np.column_stack([ideal, np.ones(len(ideal))])
    lines = points @ F.T
    length = np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    rounding = 1e-12 * np.linalg.norm(F[:2]) * np.abs(points).max(axis=1, keepdims=True)
    return lines / np.where(length > rounding, length, np.nan)


def T_world_oxyz(rig: Rig, first: int = 0, second: int = 1) -> RigidTransform:
    """Sect. 3's frame OXYZ: origin at the first camera, X along the baseline, Z between the axes, Y
    = Z x X (Eq. 1-4).

    Raises
    ------
    ValueError
        If both cameras stand in one place, or their mean axis lies along the baseline.
    """
    if not all(
        isinstance(k, (int, np.integer)) and 0 <= k < len(rig.cameras) for k in (first, second)
    ):
        raise ValueError(
            f"first, second: expected 0 to {len(rig.cameras) - 1}, got {first!r} and {second!r}"
        )
    a, b = rig.cameras[first], rig.cameras[second]
    x = as_unit(b.centre - a.centre, f"baseline of {a.name} and {b.name}")
    mean = a.axis + b.axis
    z = as_unit(mean - (mean @ x) * x, f"mean axis of {a.name} and {b.name} across the baseline")
    return RigidTransform.from_components(
        a.centre, Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    )
