"""The error budget of Table 1: each source alone, all together, and the mixes that give the printed
means (Sect. 6.5).

A mix says how large some sources would have to be. The pattern compares a table's errors with a
model's by statistics without a scale: sizes agree by chance, since a model has a free one; these
numbers stay what they are when all errors of a table grow. Chapter 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from ..bench.optics import Bench
from ..calibration.target import Board
from ..checks import Array, as_array
from ..datasets import load_calibration, load_handle, load_rig, load_table1
from ..identity import labelled_pixels
from ..kalman import covariance_root
from ..metrics import euler_deg
from ..pose import rigid_fit
from ..rigid import nearest_rotation
from . import error_sources as sources
from .deviations import (
    MEANS,
    Errors,
    Source,
    drawn,
    exact,
    first_order,
    means,
    registered,
    rms,
    together,
)
from .error_sources import Trial, make_trial
from .replication import replicate
from .simulated_calibration import simulated_calibration

NEAR_LOCK_DEG = 75.0
STATISTICS = {
    "growth_alpha": "scatter of alpha near the gimbal lock by that elsewhere",
    "growth_gamma": "scatter of gamma near the gimbal lock by that elsewhere",
    "offset_alpha": "mean of alpha's errors by its standard error",
    "offset_beta": "mean of beta's errors by its standard error",
    "offset_gamma": "mean of gamma's errors by its standard error",
    "depth": "scatter of z by that of x and y",
}
MIX_TABLES = 100  # that are drawn of each source
_FACTORS = (1e-3, 1e3)  # limits of a size, of what the source is taken for
POSITIONS = 14  # of the board in Sect. 6.2
PRINTED = (0.31, 0.67, 0.56, 0.65)  # Sect. 6.5: E_t, mm, and E_alpha, E_beta, E_gamma, deg
REGISTRATIONS: Mapping[str, Sequence[int]] = {
    "none": (),
    "4 poses": (0, 6, 12, 19),
    "20 poses": range(20),
}
TABLES = 1000  # that are drawn of a source
PATTERN_TABLES = 9999


def statistics(errors: Errors, truths: RigidTransform) -> Array:
    """The numbers of `STATISTICS` for tables of errors, shape (..., 6).

    Scatter is the rms about the mean over all n poses; the t of an offset is taken without its
    sign.
    """
    n = len(truths)
    near = np.abs(euler_deg(truths)[:, 1]) > NEAR_LOCK_DEG
    mean = errors.angles_deg.mean(axis=-2, keepdims=True)
    square = (errors.angles_deg - mean) ** 2
    growth = np.sqrt(square[..., near, :].mean(axis=-2) / square[..., ~near, :].mean(axis=-2))
    t = np.abs(mean[..., 0, :]) / np.sqrt(square.sum(axis=-2) / (n - 1) / n)
    spread = errors.position_mm.var(axis=-2)
    depth = np.sqrt(2 * spread[..., 2] / (spread[..., 0] + spread[..., 1]))
    return np.concatenate([growth[..., [0, 2]], t, depth[..., None]], axis=-1)


def compare(errors: Errors, truths: RigidTransform, observed: Array) -> pd.DataFrame:
    """Hold observed statistics against those of the tables that a model draws.

    Parameters
    ----------
    errors : Errors, shape (count, n, 3)
        Of the model's tables.
    truths : RigidTransform of length n
    observed : ndarray, shape (6,)

    Returns
    -------
    pandas.DataFrame
        A row a statistic: the observed one; the model's median and its range from 2.5 to 97.5 %; p,
        two-sided: twice the share of tables, the observed one among them, that lie as far out on
        the observed one's side.
    """
    model = statistics(errors, truths)
    side = np.minimum((model <= observed).sum(axis=0), (model >= observed).sum(axis=0))
    low, middle, high = np.quantile(model, [0.025, 0.5, 0.975], axis=0)
    return pd.DataFrame(
        {
            "statistic": list(STATISTICS),
            "observed": observed,
            "model_median": middle,
            "model_low": low,
            "model_high": high,
            "p": np.minimum(2 * (1 + side) / (1 + len(model)), 1.0),
        }
    )


class Mix(NamedTuple):
    """Sizes of some sources that come closest to the targets.

    Attributes
    ----------
    sources : tuple of Source
        With the sizes found.
    means : ndarray, shape (4,)
        E_t, mm, and E_alpha, E_beta, E_gamma, deg, that they give.
    misfit : float
        The largest ratio of one of these to its target, or of the target to it.
    """

    sources: tuple[Source, ...]
    means: Array
    misfit: float


def mix(
    free: Sequence[Source],
    given: Source,
    truths: RigidTransform,
    targets: ArrayLike,
    rows: Sequence[int] = (),
    seed: int = 0,
) -> Mix:
    """Find how large `free` sources have to be, beside a `given` one, for means as in `targets`.

    The sum of the squared logarithms of the ratios is made least; tables are drawn once, and only
    scaled after.

    Parameters
    ----------
    free : sequence of Source
    given : Source
    truths : RigidTransform of length n
    targets : array_like, shape (4,)
        E_t, mm, and E_alpha, E_beta, E_gamma, deg.
    rows : sequence of int
        Poses by which the positions are registered, see `registered`; none without it.
    seed : int

    Raises
    ------
    ValueError
        If a target is not positive.
    """
    wanted = as_array(targets, "targets", (4,))
    rng = np.random.default_rng(seed)
    if not (wanted > 0).all():
        raise ValueError(f"targets: expected positive numbers, got {wanted.tolist()}")
    base, *parts = (
        registered(drawn(source, MIX_TABLES, rng), truths, rows) for source in (given, *free)
    )

    def found(log_factors: Array) -> Array:
        tables = base + sum(
            factor * part for factor, part in zip(np.exp(log_factors), parts, strict=True)
        )
        return np.maximum(means(first_order(tables, truths))[:4], 1e-9)

    fits = [
        least_squares(
            lambda x: np.log(found(x) / wanted),
            np.full(len(free), np.log(factor)),
            bounds=np.log(_FACTORS),
        )
        for factor in (0.3, 3.0)
    ]
    factors = np.exp(min(fits, key=lambda fit: fit.cost).x)
    values = found(np.log(factors))
    sized = tuple(scaled(source, factor) for source, factor in zip(free, factors, strict=True))
    return Mix(sized, values, float(np.exp(np.abs(np.log(values / wanted)).max())))


def mixes(
    free: Sequence[Source],
    given: Source,
    truths: RigidTransform,
    targets: ArrayLike,
    rows: Sequence[int] = (),
) -> list[Mix]:
    """`mix` for each of the free sources and for every two that fit better than either alone, the
    best first.
    """
    alone = [mix([source], given, truths, targets, rows) for source in free]
    pairs = [
        (
            mix([free[i], free[j]], given, truths, targets, rows),
            min(alone[i].misfit, alone[j].misfit),
        )
        for i, j in combinations(range(len(free)), 2)
    ]
    better = [pair for pair, single in pairs if pair.misfit < 0.99 * single]
    return sorted([*alone, *better], key=lambda found: found.misfit)


def scaled(source: Source, factor: float) -> Source:
    """The same source with another size."""
    return source._replace(
        size=factor * source.size, fixed=factor * source.fixed, roots=factor * source.roots
    )


class Images(NamedTuple):
    """What rendered frames of a trial's poses give.

    Attributes
    ----------
    uv : ndarray, shape (n, cameras, markers, 2)
        Centroids without noise.
    sigma_px : float
        Rms of what noise does to a centroid's coordinate.
    estimates : list of RigidTransform
        The poses measured, for each draw of the noise.
    """

    uv: Array
    sigma_px: float
    estimates: list[RigidTransform]


class Parts(NamedTuple):
    """Sources of error: in the images; others of known size; of unknown size in the cameras, and in
    the reference.
    """

    images: list[Source]
    others: list[Source]
    cameras: list[Source]
    reference: list[Source]


def rendered(trial: Trial, draws: int) -> Images:
    """Render and measure a trial's poses with and without noise; the truth tells which of the
    look-alikes it is.

    Raises
    ------
    ValueError
        If a pose is lost.
    """
    benches = [*[Bench()] * draws, replace(Bench(), shot_variance=0.0, read_noise=0.0)]
    tables = [
        _measured(trial, bench, seed)
        for seed, bench in enumerate(tqdm(benches, unit="table", disable=None))
    ]
    *noisy, quiet = [uv for _, uv in tables]
    sigma = np.sqrt(np.nanmean((np.array(noisy) - quiet) ** 2))
    return Images(quiet, float(sigma), [poses for poses, _ in tables[:-1]])


def parts(trial: Trial, images: Images, covariance: Array) -> Parts:
    """The sources of error of a trial by the paper's pair; `covariance` is that of a
    calibration.
    """
    return Parts(
        [sources.pixel_noise(trial, images.sigma_px), sources.centroid_bias(trial, images.uv)],
        [
            sources.calibration(trial, covariance),
            sources.printed_matrix(trial),
            sources.one_focal_length(trial),
            sources.platform(trial, 0.02),
            sources.printed_digits(trial),
        ],
        [
            sources.lens_distortion(trial, -0.05),
            sources.turned_camera(trial, 0.02),
            sources.marker_places(trial, 0.05),
        ],
        [
            sources.askew(trial, 0.5),
            sources.set_angles(trial, 0.5),
            sources.set_scatter(trial, 0.5),
            sources.platform(trial, 0.2)._replace(name="set positions"),
        ],
    )


def exact_tables(
    trial: Trial, images: Images, covariance: Array, draws: int
) -> list[RigidTransform]:
    """Poses with all at once that is wrong with images and cameras, not linearised."""
    rng = _rng()
    root = covariance_root(covariance, "covariance", len(covariance))
    printed = load_calibration().R_rl
    skewness = printed - nearest_rotation(printed).as_matrix()
    tables = []
    for _ in range(draws):
        rig = sources.shifted_rig(
            sources.with_one_focal(trial.rig), root @ rng.standard_normal(len(root))
        )
        uv = images.uv + images.sigma_px * rng.standard_normal(images.uv.shape)
        tables.append(sources.by_matrix(trial, uv, rig, skewness))
    return tables


def line(source: Source, trial: Trial, rows: Sequence[int] = ()) -> dict[str, float | str]:
    """A line of the budget: means and rms over tables that are drawn, after a registration by the
    poses `rows`.
    """
    tables = registered(drawn(source, TABLES, _rng()), trial.truths, rows)
    errors = first_order(tables, trial.truths)
    return {
        "source": source.name,
        "size": source.size,
        "unit": source.unit,
        **_columns(means(errors), rms(errors)),
    }


def budget(
    trial: Trial, images: Images, of: Parts, at_once: Sequence[RigidTransform]
) -> pd.DataFrame:
    """Each source alone, the sums, what was measured on rendered frames, and Table 1, before and
    after registration.

    Columns: registration, source, size, unit, `MEANS`, and the rms of the same. A root of a sum of
    squares has no mean.
    """
    known = [*of.images, *of.others]
    lines = []
    for registration, rows in REGISTRATIONS.items():
        some = [line(source, trial, rows) for source in (*known, *of.cameras, *of.reference)]
        some += [
            _quadrature("images: root of sum of squares", some[:2]),
            line(together(of.images, "images: drawn together"), trial, rows),
            _measured_line("images: rendered and measured", images.estimates, trial, rows),
            _quadrature("all: root of sum of squares", some[: len(known)]),
            line(together(known, "all: drawn together"), trial, rows),
            _measured_line("all: not linearised", at_once, trial, rows),
            _measured_line("Table 1", [load_table1().measured], trial, rows),
        ]
        lines += [{"registration": registration, **entry} for entry in some]
    return pd.DataFrame(lines)


def found_mixes(trial: Trial, of: Parts) -> list[Mix]:
    """One or two sources, beside the printed digits, in the sizes that come closest to the printed
    means.

    Positions are registered by all poses: those of Table 1 have no common shift.
    """
    free = [*of.images, of.others[0], *of.cameras, *of.reference]
    return mixes(free, of.others[-1], trial.truths, PRINTED, REGISTRATIONS["20 poses"])


def mixes_table(found: Sequence[Mix]) -> pd.DataFrame:
    """A row a mix. Columns: misfit, sources, sizes, and the first four of `MEANS`."""
    return pd.DataFrame(
        [
            {
                "misfit": m.misfit,
                "sources": _names(m.sources),
                "sizes": " + ".join(f"{s.size:.3g} {s.unit}" for s in m.sources),
                **dict(zip(MEANS[:4], m.means, strict=True)),
            }
            for m in found
        ]
    )


def patterns_table(trial: Trial, of: Parts, found: Sequence[Mix]) -> pd.DataFrame:
    """The statistics of `statistics` for Table 1 and for several models, each registered by all
    poses.

    The last two are the best mix without errors of the reference, and the reference's alone: zeros
    and positions as the mixes have them, and a scatter of the set angles like that of Table 1's
    errors.
    """
    table = load_table1()
    rows = REGISTRATIONS["20 poses"]
    printed = exact([table.measured], table.set_poses)
    zeros, scatter, positions = of.reference[1:]
    pair = next(m for m in found if {s.name for s in m.sources} == {zeros.name, positions.name})
    seen = next(
        m for m in found if not {s.name for s in m.sources} & {s.name for s in of.reference}
    )
    spread = printed.angles_deg.std(axis=1, ddof=1).mean()
    models = {
        "pixel noise": of.images[:1],
        "images": of.images,
        "whole budget": [*of.images, *of.others[:-1]],
        _names(seen.sources): seen.sources,
        "errors of the reference": [*pair.sources, scaled(scatter, spread / scatter.size)],
    }
    lines = []
    for name, some in models.items():
        tables = registered(
            drawn(together([*some, of.others[-1]], name), PATTERN_TABLES, _rng()),
            trial.truths,
            rows,
        )
        lines.append(
            compare(
                first_order(tables, trial.truths),
                trial.truths,
                statistics(printed, trial.truths)[0],
            )
        )
        lines[-1].insert(0, "model", name)
    return pd.concat(lines)


def make_tables(draws: int) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The tables ``budget``, ``mixes`` and ``patterns``, with so many tables of rendered frames."""
    trial = make_trial(load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses)
    covariance = simulated_calibration(trial.rig, Board(), POSITIONS, _rng()).covariance
    images = rendered(trial, draws)
    of = parts(trial, images, covariance)
    at_once = exact_tables(trial, images, covariance, 4 * draws)
    found = found_mixes(trial, of)
    return budget(trial, images, of, at_once), mixes_table(found), patterns_table(trial, of, found)


def _measured(trial: Trial, bench: Bench, seed: int) -> tuple[RigidTransform, Array]:
    """The poses of rendered frames, and the centroids of the markers of the trial."""
    found = replicate(
        trial.truths, trial.rig, trial.handle, seed, bench, trial.parameters, with_prior=True
    )
    poses = [m.pose.T_world_handle for m in found if m.pose.T_world_handle is not None]
    if len(poses) < len(found):
        raise ValueError(
            f"trial: expected poses that can be measured, got {len(found) - len(poses)} lost"
        )
    pixels = [
        labelled_pixels(m.labels, tuple(c.uv for c in m.found), trial.uv.shape[2]) for m in found
    ]
    return RigidTransform.concatenate(poses), np.array(pixels) + 0 * trial.uv


def _measured_line(
    name: str, tables: Sequence[RigidTransform], trial: Trial, rows: Sequence[int]
) -> dict[str, float | str]:
    errors = exact([_laid(poses, trial.truths, rows) for poses in tables], trial.truths)
    return {
        "source": name,
        "size": len(tables),
        "unit": "tables",
        **_columns(means(errors), rms(errors)),
    }


def _quadrature(name: str, lines: Sequence[Mapping[str, float | str]]) -> dict[str, float | str]:
    total = np.sqrt(
        np.sum([[float(line[f"rms_{column}"]) ** 2 for column in MEANS] for line in lines], axis=0)
    )
    return {
        "source": name,
        "size": len(lines),
        "unit": "sources",
        **_columns(np.full(5, np.nan), total),
    }


def _columns(mean: Array, root_mean_square: Array) -> dict[str, float]:
    names = (*MEANS, *(f"rms_{name}" for name in MEANS))
    return dict(zip(names, (*mean, *root_mean_square), strict=True))


def _laid(poses: RigidTransform, truths: RigidTransform, rows: Sequence[int]) -> RigidTransform:
    """Measured poses in the true ones' frame, by a rigid fit of the positions at `rows`."""
    if len(rows) == 0:
        return poses
    T = rigid_fit(poses.translation[list(rows)], truths.translation[list(rows)])
    assert T is not None  # `registered` has refused positions on a line
    return T * poses


def _names(some: Sequence[Source]) -> str:
    return " + ".join(source.name for source in some)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)
