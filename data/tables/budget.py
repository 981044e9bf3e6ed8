"""The error budget of Table 1: each source alone, all together, the mixes that give the printed
means, and what the table's pattern leaves of them (Sect. 6.5).

What is certainly there is kept apart from what the authors' program may have done: whether it took
R_rl as printed, and one f for both axes, nobody knows. A mix says how large some sources would have
to be. Chapter 9.
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

from trinolab.bench.optics import Bench
from trinolab.calibration.target import Board
from trinolab.checks import Array
from trinolab.datasets import load_calibration, load_handle, load_rig, load_table1
from trinolab.identity import labelled_pixels
from trinolab.kalman import covariance_root
from trinolab.pose import rigid_fit
from trinolab.rigid import nearest_rotation
from workbench.studies import error_sources as sources
from workbench.studies.accounts import clamped_anew, misaligned
from workbench.studies.deviations import (
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
from workbench.studies.error_sources import Trial, make_trial
from workbench.studies.pattern import (
    STATISTICS,
    filled_up,
    largest_size,
    pattern_table,
    rigid_field,
    scaled,
    statistics,
    without_field,
)
from workbench.studies.replication import replicate
from workbench.studies.simulated_calibration import simulated_calibration

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
SMOOTH_TABLES = 4000
SMALL_MM = 2.0  # markers that the text allows as well as those of 3 mm, see assumption A11
SMALL_MODEL = f"clamped anew + images, {SMALL_MM:g} mm markers"
PATTERN_TABLES = 19_999
SEED = 0


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
    """
    wanted = np.asarray(targets, float)
    rng = np.random.default_rng(seed)
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
    """`mix` for each of the free sources, and for every two and three that fit better than any part
    of them, the best first.
    """
    mixes_by_sources: dict[tuple[int, ...], Mix] = {}
    for count in (1, 2, 3):
        for chosen in combinations(range(len(free)), count):
            mixes_by_sources[chosen] = mix([free[k] for k in chosen], given, truths, targets, rows)
    best_mixes = [
        one
        for chosen, one in mixes_by_sources.items()
        if all(
            one.misfit < 0.99 * mixes_by_sources[part].misfit
            for part in combinations(chosen, len(chosen) - 1)
            if part
        )
    ]
    return sorted(best_mixes, key=lambda one: one.misfit)


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
    """Sources of error by what is known of them.

    Attributes
    ----------
    images, bench : list of Source
        What is certainly there: noise and bias of the centroids; calibration, platform, digits.
    software : list of Source
        What the authors' program does if it does what is printed.
    cameras, reference : list of Source
        Of unknown size, each taken for a unit: in the cameras, and in what was set.
    """

    images: list[Source]
    bench: list[Source]
    software: list[Source]
    cameras: list[Source]
    reference: list[Source]

    @property
    def certain(self) -> list[Source]:
        return [*self.images, *self.bench]

    @property
    def digits(self) -> Source:
        return self.bench[-1]


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
        image_sources(trial, images),
        [
            sources.calibration(trial, covariance),
            sources.platform(trial, 0.02),
            sources.printed_digits(trial),
        ],
        [sources.printed_matrix(trial), sources.one_focal_length(trial)],
        [
            sources.lens_distortion(trial, -0.05),
            sources.turned_camera(trial, 0.02),
            sources.marker_places(trial, 0.05),
        ],
        [
            sources.askew(trial, 0.5),
            sources.turned_reference(trial, 0.5),
            sources.set_angles(trial, 0.5),
            sources.set_scatter(trial, 0.5),
            sources.platform(trial, 0.2)._replace(name="set positions"),
        ],
    )


def exact_tables(
    trial: Trial, images: Images, covariance: Array, draws: int, as_printed: bool
) -> list[RigidTransform]:
    """Poses with what is certainly wrong with images and cameras at once, not linearised.

    With `as_printed` the program takes R_rl as printed, and one f for both axes, as well.
    """
    rng = _rng()
    root = covariance_root(covariance, "covariance", len(covariance))
    printed = load_calibration().R_rl
    skewness = printed - nearest_rotation(printed).as_matrix() if as_printed else np.zeros((3, 3))
    believed = sources.with_one_focal(trial.rig) if as_printed else trial.rig
    tables = []
    for _ in range(draws):
        rig = sources.shifted_rig(believed, root @ rng.standard_normal(len(root)))
        uv = images.uv + images.sigma_px * rng.standard_normal(images.uv.shape)
        tables.append(sources.by_matrix(trial, uv, rig, skewness))
    return tables


def line(source: Source, trial: Trial, rows: Sequence[int] = ()) -> dict[str, float | str]:
    """A line of the budget: means and rms over tables that are drawn, after a registration by the
    poses `rows`.
    """
    tables = registered(drawn(source, TABLES, _rng()), trial.truths, rows)
    errors = first_order(tables, trial.truths)
    return _line(source.name, source.size, source.unit, means(errors), rms(errors), TABLES)


def budget(
    trial: Trial,
    images: Images,
    of: Parts,
    at_once: Mapping[str, Sequence[RigidTransform]],
) -> pd.DataFrame:
    """Each source alone, the sums, what was measured on rendered frames, and Table 1, before and
    after registration.

    Parameters
    ----------
    trial, images, of
    at_once : mapping
        Tables that are not linearised (`exact_tables`), for "certain" and "as printed".

    Returns
    -------
    pandas.DataFrame
        Columns: registration, source, size, unit, `MEANS`, the rms of the same, kind, n (tables
        drawn or measured) and seed. A root of a sum of squares has no mean.
    """
    printed = [*of.certain, *of.software]
    kinds = of._asdict()
    lines = []
    for registration, rows in REGISTRATIONS.items():
        alone = {
            s.name: line(s, trial, rows) | {"kind": k} for k, some in kinds.items() for s in some
        }
        sums = [
            _quadrature("images: root of sum of squares", [alone[s.name] for s in of.images]),
            line(together(of.images, "images: drawn together"), trial, rows),
            _measured_line("images: rendered and measured", images.estimates, trial, rows),
            _quadrature("certain: root of sum of squares", [alone[s.name] for s in of.certain]),
            line(together(of.certain, "certain: drawn together"), trial, rows),
            _measured_line("certain: not linearised", at_once["certain"], trial, rows),
            _quadrature("as printed: root of sum of squares", [alone[s.name] for s in printed]),
            line(together(printed, "as printed: drawn together"), trial, rows),
            _measured_line("as printed: not linearised", at_once["as printed"], trial, rows),
            _measured_line("Table 1", [load_table1().measured], trial, rows),
        ]
        some = [*alone.values(), *({**one, "kind": "sum"} for one in sums)]
        lines += [{"registration": registration, **entry} for entry in some]
    table = pd.DataFrame(lines)
    last = table[["kind", "n"]]
    return table.drop(columns=["kind", "n"]).assign(kind=last["kind"], n=last["n"], seed=SEED)


def found_mixes(trial: Trial, of: Parts) -> list[Mix]:
    """One, two or three sources, beside the printed digits, in the sizes that come closest to the
    printed means.

    Positions are registered by all poses: those of Table 1 have no common shift.
    """
    free = [*of.images, of.bench[0], *of.cameras, *of.reference]
    return mixes(free, of.digits, trial.truths, PRINTED, REGISTRATIONS["20 poses"])


def mixes_table(found: Sequence[Mix]) -> pd.DataFrame:
    """A row a mix. Columns: misfit, sources, sizes, the first four of `MEANS`, n and seed."""
    return pd.DataFrame(
        [
            {
                "misfit": m.misfit,
                "sources": _names(m.sources),
                "sizes": " + ".join(f"{s.size:.3g} {s.unit}" for s in m.sources),
                **dict(zip(MEANS[:4], m.means, strict=True)),
                "n": MIX_TABLES,
                "seed": SEED,
            }
            for m in found
        ]
    )


def crossed_mixes(trial: Trial, of: Parts) -> list[Mix]:
    """Each cause that moves positions with each that turns poses, sized like `found_mixes`.

    The first are a distorting lens, a turned camera, and set positions; the second the centroids'
    bias, misalignments on both sides, zeros of the set angles, and their scatter.
    """
    lens, turned = of.cameras[:2]
    mount, reference, zeros, scatter, positions = of.reference
    turning = [[of.images[1]], [reference, mount], [zeros], [scatter]]
    return [
        mix([moves, *turns], of.digits, trial.truths, PRINTED, REGISTRATIONS["20 poses"])
        for moves in (lens, turned, positions)
        for turns in turning
    ]


def models(
    trial: Trial, of: Parts, images_of_small: Sequence[Source]
) -> list[tuple[Source, Sequence[str]]]:
    """What the pattern of Table 1 is held against, each with the statistics it was fitted to.

    What is certainly there; that with the program as printed; that with one f and so much of
    independent position errors as Table 1 has; the twelve `crossed_mixes`; the two accounts that
    are fitted to the table itself, and the clamp with what images do of markers of 3 mm, as assumed,
    and of smaller ones.
    """
    printed = _table1_errors()
    certain = together([*of.images, *of.bench[:-1]], "certain")
    one_f = together([certain, of.software[1]], "certain, one f, filled up")
    with_digits = [
        certain,
        together([certain, *of.software], "certain, as printed"),
        filled_up(one_f, of.reference[-1], trial.truths, _scatter_mm(printed, trial)),
        *(together(m.sources, _names(m.sources)) for m in crossed_mixes(trial, of)),
    ]
    clamp = clamped_anew(printed, trial.truths)
    offsets = [name for name in STATISTICS if name.startswith("offset")]
    return [
        *((together([model, of.digits], model.name), ()) for model in with_digits),
        (misaligned(printed, trial.truths), ()),
        (together([clamp, *of.images], "clamped anew + images"), ()),
        (together([clamp, *images_of_small], SMALL_MODEL), ()),
        (clamp, offsets),
    ]


def patterns_table(trial: Trial, of: Parts, images_of_small: Sequence[Source]) -> pd.DataFrame:
    """`pattern.pattern_table` of `models`."""
    observed = statistics(_table1_errors(), trial.truths)[0]
    every = models(trial, of, images_of_small)
    return pattern_table(every, trial.truths, observed, PATTERN_TABLES, SEED)


def small_markers(trial: Trial, draws: int) -> list[Source]:
    """What images do if the markers are smaller, rendered and measured: the paper gives no size."""
    handle = replace(trial.handle, marker_diameter_mm=SMALL_MM)
    small = make_trial(trial.rig, handle, trial.truths, trial.parameters)
    return image_sources(small, rendered(small, draws))


def image_sources(trial: Trial, images: Images) -> list[Source]:
    """Noise and bias of a trial's centroids."""
    return [sources.pixel_noise(trial, images.sigma_px), sources.centroid_bias(trial, images.uv)]


def smooth_table(trial: Trial, of: Parts) -> pd.DataFrame:
    """How large a cause of position errors may be before the spatial test refuses it at 5 %.

    Columns: source, taken (its size in the budget), unit, largest (the size that is just not
    refused), share (of Table 1's mean square that it makes then), n and seed.
    """
    observed = _table1_errors().position_mm[0]
    causes = [*of.software, *of.cameras[:2]]
    rows = []
    for cause in causes:
        largest, share = largest_size(
            cause, of.reference[-1], trial.truths, observed, tables=SMOOTH_TABLES, seed=SEED
        )
        rows.append(
            {
                "source": cause.name,
                "taken": cause.size,
                "unit": cause.unit,
                "largest": largest,
                "share": share,
                "n": SMOOTH_TABLES,
                "seed": SEED,
            }
        )
    return pd.DataFrame(rows)


def make_tables(draws: int) -> tuple[pd.DataFrame, ...]:
    """The tables ``budget``, ``mixes``, ``patterns`` and ``smooth``, with so many tables of rendered
    frames.
    """
    trial = make_trial(load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses)
    covariance = simulated_calibration(trial.rig, Board(), POSITIONS, _rng()).covariance
    images = rendered(trial, draws)
    of = parts(trial, images, covariance)
    at_once = {
        name: exact_tables(trial, images, covariance, 4 * draws, name == "as printed")
        for name in ("certain", "as printed")
    }
    mixes_found = found_mixes(trial, of)
    return (
        budget(trial, images, of, at_once),
        mixes_table(mixes_found),
        patterns_table(trial, of, small_markers(trial, draws)),
        smooth_table(trial, of),
    )


def _table1_errors() -> Errors:
    table = load_table1()
    return exact([table.measured], table.set_poses)


def _scatter_mm(errors: Errors, trial: Trial) -> float:
    """Rms of one table's position errors without a rigid motion of all, mm."""
    rest = without_field(errors.position_mm[0], rigid_field(trial.truths.translation))
    return float(np.sqrt((rest**2).sum() / len(rest)))


def _measured(trial: Trial, bench: Bench, seed: int) -> tuple[RigidTransform, Array]:
    """The poses of rendered frames, and the centroids of the markers of the trial."""
    measurements = replicate(
        trial.truths, trial.rig, trial.handle, seed, bench, trial.parameters, with_prior=True
    )
    poses = [m.pose.T_world_handle for m in measurements if m.pose.T_world_handle is not None]
    if len(poses) < len(measurements):
        raise ValueError(
            f"trial: expected poses that can be measured, got {len(measurements) - len(poses)} lost"
        )
    pixels = [
        labelled_pixels(m.labels, tuple(c.uv for c in m.markers), trial.uv.shape[2])
        for m in measurements
    ]
    return RigidTransform.concatenate(poses), np.array(pixels) + 0 * trial.uv


def _measured_line(
    name: str, tables: Sequence[RigidTransform], trial: Trial, rows: Sequence[int]
) -> dict[str, float | str]:
    errors = exact([_laid(poses, trial.truths, rows) for poses in tables], trial.truths)
    return _line(name, len(tables), "tables", means(errors), rms(errors), len(tables))


def _quadrature(name: str, lines: Sequence[Mapping[str, float | str]]) -> dict[str, float | str]:
    total = np.sqrt(
        np.sum([[float(line[f"rms_{column}"]) ** 2 for column in MEANS] for line in lines], axis=0)
    )
    return _line(name, len(lines), "sources", np.full(5, np.nan), total, TABLES)


def _line(
    source: str, size: float, unit: str, mean: Array, root_mean_square: Array, n: int
) -> dict[str, float | str]:
    names = (*MEANS, *(f"rms_{name}" for name in MEANS))
    errors = dict(zip(names, (*mean, *root_mean_square), strict=True))
    return {"source": source, "size": size, "unit": unit, **errors, "n": n}


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
    return np.random.default_rng(SEED)
