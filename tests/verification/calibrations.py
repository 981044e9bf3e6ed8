"""Calibrations and layouts as they may be: is a pose's whole uncertainty honest, and is none called
measured that is badly wrong.

The rig and the handle that measure are the shipped ones, with a covariance; what is measured is
drawn from it. From pixels there are many instants: centroids as
`estimators.centroids.predict_centroids` has them, moved as the marker is, and noise. All estimators
get rendered images, too.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig, RigCovariance, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.estimators.fitted import MOST_WRONG
from trinolab.estimators.reprojection import fit_pixels, response_of_pixels
from trinolab.handle import Handle
from trinolab.identity import choose, identify, labelled_pixels, relabel
from trinolab.identity.reconcile import reconciled
from trinolab.measurement import measure
from trinolab.metrics import nearest_equivalent
from trinolab.parameters import Parameters
from trinolab.pose import LOST, Pose, fit_pose
from trinolab.rigid import motion_between
from trinolab.sensitivity import motion_slopes, pixel_slopes
from trinolab.uncertainty import Assessment, LinearFit, assess
from workbench.studies.replication import EVERY

# principal points (px) and directions (deg) of all cameras, places of the markers (mm)
KINDS = {"good": (0.1, 0.005, 0.0), "poor": (0.3, 0.02, 0.0), "layout": (0.0, 0.0, 0.05)}
RIGS = ("paper_pair", "raised_40deg")
NOISE_PX = 0.05  # of pixels that are drawn
# Of a calibration; with 50 calibrations, two rigs, three kinds and two handles 10,200 instants of pixels.
POSES_OF_PIXELS, POSES_OF_IMAGES = 17, 1
HONEST = 0.8, 1.3  # rms of true error by reported standard deviation
BADLY_MM, BADLY_DEG, SIGMAS = 2.0, 5.0, 5.0  # off by more than all of these
P = Parameters()


class Setup(NamedTuple):
    """What measures: a rig and a handle, and how well they are known."""

    rig: Rig
    handle: Handle


class Truth(NamedTuple):
    """What is measured: cameras, and by how much the markers are beside their places, (n, 3), handle
    frame, mm.
    """

    rig: Rig
    beside: np.ndarray


class Seen(NamedTuple):
    """An instant as pixels, (cameras, markers, 2) each: centroids, and images of the centres."""

    T_world_handle: RigidTransform
    centroids: np.ndarray
    centres: np.ndarray


class Score(NamedTuple):
    """Error by sigma, of position and rotation, and whether the pose is badly wrong."""

    mm: float
    deg: float
    badly: bool


# by estimator, and whether the files say how well rig and layout are known; None: not measured
Scores = dict[tuple[str, bool], list[Score | None]]


def setup(rig_name: str, handle_name: str, kind: str) -> Setup:
    """A shipped rig and handle of which it is known how well they are known."""
    px, deg, mm = KINDS[kind]
    rig = load_rig(rig_name)
    sigma = np.zeros((len(rig.cameras), 15))
    sigma[:, 2:4] = px
    sigma[:, 9:12] = np.deg2rad(deg)
    covariance = RigCovariance(rig.names, np.diag(sigma.ravel() ** 2))
    handle = replace(load_handle(handle_name), placement_sigma_mm=mm)
    return Setup(replace(rig, covariance=covariance), handle)


def silent(known: Setup) -> Setup:
    """The same as files have it that do not say how well rig and layout are known."""
    return Setup(Rig(known.rig.cameras), replace(known.handle, placement_sigma_mm=None))


def drawn(known: Setup, rng: np.random.Generator) -> Truth:
    """What there may be where this is known."""
    rig = known.rig
    sigma = np.sqrt(np.diag(rig.covariance.matrix))
    rig = displaced(rig, sigma * rng.standard_normal(len(sigma)))
    shape = known.handle.marker_centres.shape
    return Truth(rig, known.handle.placement_sigma_mm * rng.standard_normal(shape))


def seen(known: Setup, truth: Truth, noise_px: float, rng: np.random.Generator) -> Seen:
    """A random pose at which two cameras see four markers, in pixels."""
    handle = known.handle
    while True:
        T = random_pose(rng)
        visible = np.stack([true_visibility(c, handle, T) for c in known.rig.cameras])
        if (visible.sum(axis=1) >= 4).sum() >= 2:
            break
    views = Views(*np.nonzero(visible))
    beside = truth.beside @ T.rotation.as_matrix().T
    at = T.apply(handle.marker_centres)
    centroids = np.full((*visible.shape, 2), np.nan)
    centres = np.full((*visible.shape, 2), np.nan)
    noise = noise_px * rng.standard_normal(centroids.shape)
    uv = predict_centroids(truth.rig, handle, T, views)[0]
    for k, (c, m) in enumerate(zip(*views, strict=True)):
        moved = pixel_slopes(truth.rig.cameras[c], at[[m]])[1][0] @ beside[m]
        centroids[c, m] = uv[k] + moved + noise[c, m]
        centres[c, m] = truth.rig.cameras[c].project(at[[m]] + beside[m])[0] + noise[c, m]
    return Seen(T, centroids, centres)


def paper_pose(known: Setup, near: Rig, one: Seen, T: RigidTransform) -> Pose:
    """The paper's estimate from the pixels of the centres, with the rig as it is given."""
    return fit_pose(one.centres, *known, P.max_slant_deg, NOISE_PX, T)


def reprojection_pose(known: Setup, near: Rig, one: Seen, T: RigidTransform) -> Pose:
    """The pose of least reprojection error from the centroids, fitted with the rig that is near."""
    here = Setup(near, known.handle)
    views = Views(*np.nonzero(np.isfinite(one.centroids[..., 0])))
    spread = np.tile(NOISE_PX**2 * np.eye(2), (len(views.camera), 1, 1))
    uv = one.centroids[views]
    T, covariance = fit_pixels(uv, spread, *here, views, T)
    found = response_of_pixels(uv, spread, *here, views, T)
    left = uv - predict_centroids(*here, T, views)[0]
    explained = motion_slopes(near, found.camera, found.points, T.translation)
    noise = NOISE_PX**2 * np.eye(2 * len(uv))
    fit = LinearFit(T, covariance, found, left, noise, explained.reshape(-1, 6))
    return _reported(assess(fit, *known, near))


def _reported(found: Assessment) -> Pose:
    if found.wrong > MOST_WRONG:
        return LOST
    covariances = found.covariance_random, found.systematic
    return Pose("measured", found.T_world_handle, covariances[0], np.nan, 0, 0, covariances[1])


ESTIMATORS: dict[str, Callable[[Setup, Rig, Seen, RigidTransform], Pose]] = {
    "paper": paper_pose,
    "reprojection": reprojection_pose,
}


def identified(
    known: Setup, one: Seen, rng: np.random.Generator
) -> tuple[Rig, Seen, RigidTransform] | None:
    """What `measurement.measure` does with found pixels before it asks an estimator: the rig as the
    pixels leave it, the pixels by marker, the pose.
    """
    p = P.identity
    order = [rng.permutation(np.flatnonzero(np.isfinite(uv[:, 0]))) for uv in one.centroids]
    found = tuple(uv[rows] for uv, rows in zip(one.centroids, order, strict=True))
    hypotheses = identify(*known, found, p)
    if not hypotheses:
        return None
    options = [
        (hypothesis, S, hypothesis.T_world_handle * S)
        for hypothesis in hypotheses
        for S in known.handle.symmetries
    ]
    k, _ = choose([T for *_, T in options], one.T_world_handle)
    hypothesis, S, T = options[k]
    labels = tuple(relabel(row, known.handle, S) for row in hypothesis.labels)
    n = len(known.handle.marker_centres)
    centroids = labelled_pixels(labels, found, n)
    there = tuple(uv[rows] for uv, rows in zip(one.centres, order, strict=True))
    centres = labelled_pixels(labels, there, n)
    rig, T = reconciled(known.rig, known.handle, centroids, T, P.sigma_px, p)
    return rig, Seen(one.T_world_handle, centroids, centres), T


def from_pixels(known: Setup, draws: int, poses: int, seed: int = 0) -> Scores:
    """So many calibrations and layouts, so many poses each, by the estimators that need no image."""
    rng = np.random.default_rng(seed)
    scores: Scores = {(name, told): [] for told in (True, False) for name in ESTIMATORS}
    setups = {True: known, False: silent(known)}
    for _ in range(draws):
        truth = drawn(known, rng)
        for _ in range(poses):
            one = seen(known, truth, NOISE_PX, rng)
            for told, with_it in setups.items():
                there = identified(with_it, one, rng)
                for name, estimate in ESTIMATORS.items():
                    pose = LOST if there is None else estimate(with_it, *there)
                    scores[name, told].append(score(pose, one.T_world_handle, known))
    return scores


def from_images(
    known: Setup, draws: int, poses: int, estimators: Sequence[str] = tuple(EVERY), seed: int = 0
) -> Scores:
    """The same by all estimators from rendered images.

    A wrapped marker cannot be above its place. It is beside it in two directions by as much as the
    file says for three.
    """
    rng = np.random.default_rng(seed)
    scores: Scores = {(name, told): [] for told in (True, False) for name in estimators}
    setups = {True: known, False: silent(known)}
    for _ in tqdm(range(draws), leave=False, unit="calibration"):
        rig = drawn(known, rng).rig
        handle = _beside(known.handle, rng)
        for _ in range(poses):
            T = seen(known, Truth(rig, 0 * handle.marker_centres), 0.0, rng).T_world_handle
            images = render_rig(rig, handle, T, Bench(), rng)
            for (name, told), own in scores.items():
                pose = measure(images, *setups[told], T, EVERY[name]).pose
                own.append(score(pose, T, known))
    return scores


def _beside(handle: Handle, rng: np.random.Generator) -> Handle:
    """A handle with each marker beside its place, around and along the axis."""
    sigma = np.sqrt(1.5) * handle.placement_sigma_mm
    angles = np.repeat(handle.columns_deg, [len(rows) for rows in handle.rows_mm])
    along = np.concatenate([np.array(rows) for rows in handle.rows_mm])
    angles = angles + np.rad2deg(sigma * rng.standard_normal(len(angles)) / handle.radius_mm)
    along = along + sigma * rng.standard_normal(len(along))
    columns = tuple(float(a) for a in angles)
    return replace(handle, columns_deg=columns, rows_mm=tuple((float(s),) for s in along))


def score(pose: Pose, truth: RigidTransform, known: Setup) -> Score | None:
    """How far off a measured pose is, in its own standard deviations."""
    if pose.status != "measured" or pose.T_world_handle is None:
        return None
    T = nearest_equivalent(pose.T_world_handle, truth, known.handle.symmetries)[0]
    away = motion_between(T, truth)
    mm = float(np.linalg.norm(away[:3]))
    deg = float(np.rad2deg(np.linalg.norm(away[3:])))
    badly = (mm > BADLY_MM and mm > SIGMAS * pose.sigma_mm) or (
        deg > BADLY_DEG and deg > SIGMAS * pose.sigma_deg
    )
    return Score(mm / pose.sigma_mm, deg / pose.sigma_deg, badly)


class Summary(NamedTuple):
    """Of scores: how many, the share measured, rms of error by sigma, and how many badly wrong."""

    count: int
    measured: float
    mm: float
    deg: float
    badly: int

    @property
    def honest(self) -> bool:
        return HONEST[0] <= self.mm <= HONEST[1] and HONEST[0] <= self.deg <= HONEST[1]


def summary(scores: list[Score | None]) -> Summary:
    """The scores in short."""
    held = [one for one in scores if one is not None]
    rms = np.sqrt(np.mean(np.square([one[:2] for one in held]), axis=0))
    badly = sum(one.badly for one in held)
    return Summary(len(scores), len(held) / len(scores), float(rms[0]), float(rms[1]), badly)


def report(arguments) -> None:
    draws = arguments.calibrations
    print(
        f"{draws} calibrations and layouts drawn for each row, random poses, seed 0. rms of true error by the"
    )
    print(
        f"whole sigma is honest from {HONEST[0]} to {HONEST[1]}, else *. Badly wrong: measured, and off by"
    )
    print(
        f"more than {SIGMAS:g} sigmas and {BADLY_MM:g} mm or {BADLY_DEG:g} deg. Last: the same with files that do"
    )
    print("not say how well rig and layout are known, share measured and badly wrong")
    totals = np.zeros(4, int)
    for label, told, untold in _rows(draws):
        s, u = summary(told), summary(untold)
        totals += [s.count, s.badly, u.count, u.badly]
        print(
            f"{label} n {s.count:4d}  measured {100 * s.measured:5.1f} %  position {s.mm:.2f}  rotation {s.deg:.2f}"
            f"{'  ' if s.honest else ' *'}  badly wrong {s.badly}   |  {100 * u.measured:5.1f} %  {u.badly}",
            flush=True,
        )
    count, badly, silent_count, silent_badly = totals
    print(
        f"badly wrong in all: {badly} of {count}; with files that say nothing {silent_badly} of {silent_count}"
    )


def _rows(draws: int) -> Iterator[tuple[str, list[Score | None], list[Score | None]]]:
    """A label, and the scores with and without what is known."""
    for rig, kind, handle in product(RIGS, KINDS, ("coded", "paper")):
        known = setup(rig, handle, kind)
        pixels = from_pixels(known, draws, POSES_OF_PIXELS)
        images = from_images(known, draws, POSES_OF_IMAGES)
        for source, scores in (("pixels", pixels), ("images", images)):
            for name in dict.fromkeys(name for name, _ in scores):
                label = f"{rig:12s} {kind:6s} {handle:5s} {name:13s} {source}"
                yield label, scores[name, True], scores[name, False]
