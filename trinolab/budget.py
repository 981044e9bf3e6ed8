"""The error budget of Table 1: each source alone, all together, and the mixes that give the printed means (Sect. 6.5).

    python -m trinolab.budget --out data/sweeps [--draws 5]

makes ``budget.csv``, ``mixes.csv`` and ``patterns.csv`` again.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

from . import error_sources as sources
from .board import Board
from .boardtrial import simulated_calibration
from .checks import Array
from .covariance import covariance_root
from .datasets import load_calibration, load_handle, load_rig, load_table1, nearest_rotation
from .deviations import MEANS, Source, drawn, exact, first_order, means, registered, rms, together
from .error_sources import Trial, make_trial
from .factors import write_sweep
from .identity import labelled_pixels
from .mixing import Mix, mixes, scaled
from .outputs import check_target
from .pattern import compare, statistics
from .pose import rigid_fit
from .scene import Bench, render_rig
from .tracker import measure

POSITIONS = 14  # of the board in Sect. 6.2
PRINTED = (0.31, 0.67, 0.56, 0.65)  # Sect. 6.5: E_t, mm, and E_alpha, E_beta, E_gamma, deg
REGISTRATIONS: Mapping[str, Sequence[int]] = {"none": (), "4 poses": (0, 6, 12, 19), "20 poses": range(20)}
TABLES = 1000  # that are drawn of a source
PATTERN_TABLES = 9999


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
    """Sources of error: in the images; others of known size; of unknown size in the cameras, and in the reference."""

    images: list[Source]
    others: list[Source]
    cameras: list[Source]
    reference: list[Source]


def rendered(trial: Trial, draws: int) -> Images:
    """Render and measure a trial's poses with and without noise; the truth tells which of the look-alikes it is.

    Raises
    ------
    ValueError
        If a pose is lost.
    """
    benches = [*[Bench()] * draws, replace(Bench(), shot_variance=0.0, read_noise=0.0)]
    tables = [_measured(trial, bench, seed) for seed, bench in enumerate(tqdm(benches, unit="table", disable=None))]
    *noisy, quiet = [uv for _, uv in tables]
    sigma = np.sqrt(np.nanmean((np.array(noisy) - quiet) ** 2))
    return Images(quiet, float(sigma), [poses for poses, _ in tables[:-1]])


def parts(trial: Trial, images: Images, covariance: Array) -> Parts:
    """The sources of error of a trial by the paper's pair; `covariance` is that of a calibration."""
    return Parts(
        [sources.pixel_noise(trial, images.sigma_px), sources.centroid_bias(trial, images.uv)],
        [sources.calibration(trial, covariance), sources.printed_matrix(trial), sources.one_focal_length(trial),
         sources.platform(trial, 0.02), sources.printed_digits(trial)],
        [sources.lens_distortion(trial, -0.05), sources.turned_camera(trial, 0.02),
         sources.marker_places(trial, 0.05)],
        [sources.askew(trial, 0.5), sources.set_angles(trial, 0.5), sources.set_scatter(trial, 0.5),
         sources.platform(trial, 0.2)._replace(name="set positions")])


def exact_tables(trial: Trial, images: Images, covariance: Array, draws: int) -> list[RigidTransform]:
    """Poses with all at once that is wrong with images and cameras, not linearised."""
    rng, root, printed = _rng(), covariance_root(covariance, "covariance", len(covariance)), load_calibration().R_rl
    skewness = printed - nearest_rotation(printed).as_matrix()
    tables = []
    for _ in range(draws):
        rig = sources.shifted_rig(sources.with_one_focal(trial.rig), root @ rng.standard_normal(len(root)))
        uv = images.uv + images.sigma_px * rng.standard_normal(images.uv.shape)
        tables.append(sources.by_matrix(trial, uv, rig, skewness))
    return tables


def line(source: Source, trial: Trial, rows: Sequence[int] = ()) -> dict[str, float | str]:
    """A line of the budget: means and rms over tables that are drawn, after a registration by the poses `rows`."""
    tables = registered(drawn(source, TABLES, _rng()), trial.truths, rows)
    errors = first_order(tables, trial.truths)
    return {"source": source.name, "size": source.size, "unit": source.unit, **_columns(means(errors), rms(errors))}


def budget(trial: Trial, images: Images, of: Parts, at_once: Sequence[RigidTransform]) -> pd.DataFrame:
    """Each source alone, the sums, what was measured on rendered frames, and Table 1, before and after registration.

    Columns: registration, source, size, unit, `MEANS`, and the rms of the same. A root of a sum of squares has no mean.
    """
    known = [*of.images, *of.others]
    lines = []
    for registration, rows in REGISTRATIONS.items():
        some = [line(source, trial, rows) for source in (*known, *of.cameras, *of.reference)]
        some += [_quadrature("images: root of sum of squares", some[:2]),
                 line(together(of.images, "images: drawn together"), trial, rows),
                 _measured_line("images: rendered and measured", images.estimates, trial, rows),
                 _quadrature("all: root of sum of squares", some[:len(known)]),
                 line(together(known, "all: drawn together"), trial, rows),
                 _measured_line("all: not linearised", at_once, trial, rows),
                 _measured_line("Table 1", [load_table1().measured], trial, rows)]
        lines += [{"registration": registration, **entry} for entry in some]
    return pd.DataFrame(lines)


def found_mixes(trial: Trial, of: Parts) -> list[Mix]:
    """One or two sources, beside the printed digits, in the sizes that come closest to the printed means.

    Positions are registered by all poses: those of Table 1 have no common shift.
    """
    free = [*of.images, of.others[0], *of.cameras, *of.reference]
    return mixes(free, of.others[-1], trial.truths, PRINTED, REGISTRATIONS["20 poses"])


def mixes_table(found: Sequence[Mix]) -> pd.DataFrame:
    """A row a mix. Columns: misfit, sources, sizes, and the first four of `MEANS`."""
    return pd.DataFrame([{"misfit": m.misfit, "sources": _names(m.sources), "sizes": " + ".join(
        f"{s.size:.3g} {s.unit}" for s in m.sources), **dict(zip(MEANS[:4], m.means, strict=True))} for m in found])


def patterns_table(trial: Trial, of: Parts, found: Sequence[Mix]) -> pd.DataFrame:
    """The statistics of `pattern` for Table 1 and for several models, each registered by all poses.

    The last two are the best mix without errors of the reference, and the reference's alone: zeros and positions as
    the mixes have them, and a scatter of the set angles like that of Table 1's errors.
    """
    table, rows = load_table1(), REGISTRATIONS["20 poses"]
    printed = exact([table.measured], table.set_poses)
    zeros, scatter, positions = of.reference[1:]
    pair = next(m for m in found if {s.name for s in m.sources} == {zeros.name, positions.name})
    seen = next(m for m in found if not {s.name for s in m.sources} & {s.name for s in of.reference})
    spread = printed.angles_deg.std(axis=1, ddof=1).mean()
    models = {"pixel noise": of.images[:1], "images": of.images, "whole budget": [*of.images, *of.others[:-1]],
              _names(seen.sources): seen.sources,
              "errors of the reference": [*pair.sources, scaled(scatter, spread / scatter.size)]}
    lines = []
    for name, some in models.items():
        tables = registered(drawn(together([*some, of.others[-1]], name), PATTERN_TABLES, _rng()), trial.truths, rows)
        lines.append(compare(first_order(tables, trial.truths), trial.truths, statistics(printed, trial.truths)[0]))
        lines[-1].insert(0, "model", name)
    return pd.concat(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the tables, each whole or not at all."""
    parser = argparse.ArgumentParser(prog="python -m trinolab.budget", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", default="data/sweeps", help="folder of the tables (%(default)s)")
    parser.add_argument("--draws", type=int, default=5, help="tables of rendered frames (%(default)s)")
    arguments = parser.parse_args(argv)
    paths = [Path(arguments.out) / f"{name}.csv" for name in ("budget", "mixes", "patterns")]
    for path in paths:
        check_target(path)
    trial = make_trial(load_rig("paper_pair"), load_handle("paper"), load_table1().set_poses)
    covariance = simulated_calibration(trial.rig, Board(), POSITIONS, _rng()).covariance
    images = rendered(trial, arguments.draws)
    of = parts(trial, images, covariance)
    at_once = exact_tables(trial, images, covariance, 4 * arguments.draws)
    found = found_mixes(trial, of)
    tables = budget(trial, images, of, at_once), mixes_table(found), patterns_table(trial, of, found)
    for path, table in zip(paths, tables, strict=True):
        write_sweep(table, path)
    return 0


def _measured(trial: Trial, bench: Bench, seed: int) -> tuple[RigidTransform, Array]:
    """The poses of rendered frames, and the centroids of the markers of the trial."""
    rng = np.random.default_rng(seed)
    found = [measure(render_rig(trial.rig, trial.handle, T, bench, rng), trial.rig, trial.handle, T, trial.parameters)
             for T in trial.truths]
    poses = [m.pose.T_world_handle for m in found if m.pose.T_world_handle is not None]
    if len(poses) < len(found):
        raise ValueError(f"trial: expected poses that can be measured, got {len(found) - len(poses)} lost")
    pixels = [labelled_pixels(m.labels, tuple(c.uv for c in m.found), trial.uv.shape[2]) for m in found]
    return RigidTransform.concatenate(poses), np.array(pixels) + 0 * trial.uv


def _measured_line(name: str, tables: Sequence[RigidTransform], trial: Trial,
                   rows: Sequence[int]) -> dict[str, float | str]:
    errors = exact([_laid(poses, trial.truths, rows) for poses in tables], trial.truths)
    return {"source": name, "size": len(tables), "unit": "tables", **_columns(means(errors), rms(errors))}


def _quadrature(name: str, lines: Sequence[Mapping[str, float | str]]) -> dict[str, float | str]:
    total = np.sqrt(np.sum([[float(line[f"rms_{column}"]) ** 2 for column in MEANS] for line in lines], axis=0))
    return {"source": name, "size": len(lines), "unit": "sources", **_columns(np.full(5, np.nan), total)}


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


if __name__ == "__main__":
    raise SystemExit(main())
