"""Rules that pair spots, while the calibration is exact or wrong; see `workbench.studies.match_rivals`.

A draw is a pair of recordings, `calm` and `hard`, with motions of their own; a few instants of each are
rendered, and every rule and every calibration pairs the same spots. The poses are compared in those
instants in which every rule of pairs gives one, for the layout in those of them in which it names enough.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from trinolab import matching
from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import take
from trinolab.camera import Rig, RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.markers import find_markers
from trinolab.matching import MatchParameters
from trinolab.measurement import measure
from trinolab.metrics import pose_errors
from trinolab.parameters import Parameters
from workbench.intervals import Interval, of_ratio, of_share, ratio
from workbench.studies.broken import covariance_of_such, miscalibrated
from workbench.studies.carrier import Row, Table, columns_of_mean
from workbench.studies.ground_truth import instant_of
from workbench.studies.match_rivals import (
    RULES,
    TOLERANCE,
    Shot,
    Spots,
    by_layout,
    by_third_view,
    counts,
    pose_by_pairs,
    shot_of,
)

RIG = "raised_40deg"
HANDLE = "coded"
# standard deviations of the principal points' coordinates, and an epipolar gate for each
LEVELS_PX = {0.0: 2.0, 0.5: 2.0, 2.0: 8.0}
# two seconds each: the second one of `calm`, in which a hand is there, and all of `hard`
FRAMES = {"calm": range(30, 60, 8), "hard": range(2, 60, 8)}
SEED = 6  # of the calibrations
FOUR = "four constraints"
THIRD = "third view"
LAYOUT = "layout"  # the rig file passes for exact
LAYOUT_STATED = "layout, error stated"  # it says how far off it may be


def one_draw(draw: int) -> list[Row]:
    """The counts of the recordings with the seed draw + 1, over all their instants and cameras."""
    seed = draw + 1
    rig = load_rig(RIG)
    shots = [shot for name in FRAMES for shot in shots_of(name, seed, rig)]
    rows: list[Row] = []
    for level_px, gate_px in LEVELS_PX.items():
        # one direction of error, which the level scales
        believed = miscalibrated(rig, level_px, 0.0, np.random.default_rng([SEED, seed]))
        believed = replace(believed, covariance=RigCovariance.exact(rig.names))
        stated = replace(believed, covariance=covariance_of_such(believed, level_px, 0.0))
        settings = MatchParameters(epipolar_gate_px=gate_px)
        totals = _totals(shots, believed, stated, settings)
        about = {"calibration_px": level_px, "gate_px": gate_px}
        rows += [
            {**about, "rule": rule, "instants": len(shots), **total}
            for rule, total in totals.items()
        ]
    return rows


def shots_of(name: str, seed: int, rig: Rig) -> list[Shot]:
    """The instants of a recording and the spots that are found in them."""
    handle = load_handle(HANDLE)
    job = scripted(name, rig, handle, seed, 2.0)
    shots = []
    for frame in FRAMES[name]:
        images = tuple(take(job, frame, index) for index in range(len(rig.cameras)))
        uv = tuple(
            find_markers(image, len(handle.marker_centres), handle.markers).uv for image in images
        )
        shots.append(shot_of(instant_of(job, frame, images), rig, uv, handle))
    return shots


def _totals(
    shots: list[Shot], rig: Rig, stated: Rig, settings: MatchParameters
) -> dict[str, dict[str, int]]:
    """The counts of each rule, and its errors of the pose, summed over instants and pairs of
    cameras.
    """
    handle = load_handle(HANDLE)
    p = Parameters(matching=settings, estimator="paper")
    gate_px = settings.epipolar_gate_px
    rows = []
    for shot in shots:
        named = {
            LAYOUT: measure(shot.now.images, rig, handle, parameters=p).labels,
            LAYOUT_STATED: measure(shot.now.images, stated, handle, parameters=p).labels,
        }
        found: dict[str, dict[tuple[int, int], np.ndarray]] = defaultdict(dict)
        for i, j in rig.pairs:
            left, right = rig.cameras[i], rig.cameras[j]
            views = (left, right, shot.now.images[i], shot.now.images[j], shot.uv[i], shot.uv[j])
            D = matching.epipolar_distances(left, right, shot.uv[i], shot.uv[j])
            spots = Spots(D, matching.ncc_matrix(*views[2:], settings.window_px))
            for name, rule in RULES.items():
                found[name][i, j] = rule(spots, gate_px)
            tolerance_px = TOLERANCE * gate_px
            found[THIRD][i, j] = by_third_view(shot, rig, i, j, spots, gate_px, tolerance_px)
            found[FOUR][i, j] = matching.match(*views, settings).index
            for name, labels in named.items():
                found[name][i, j] = by_layout(labels[i], labels[j])
        errors = {name: _errors(shot, rig, pairs) for name, pairs in found.items()}
        comparable = all(errors[name] is not None for name in found if name not in named)
        for name, pairs in found.items():
            of_pairs = pd.DataFrame([counts(shot, i, j, one) for (i, j), one in pairs.items()])
            error = errors[name] if comparable else None
            mm, deg = error or (0.0, 0.0)
            posed = errors[name] is not None
            about = {"rule": name, "posed": posed, "compared": error is not None}
            rows.append({**about, **of_pairs.sum(), "sum_mm": mm, "sum_deg": deg})
    totals = pd.DataFrame(rows).groupby("rule", sort=False).sum()
    return totals.to_dict("index")


def _errors(
    shot: Shot, rig: Rig, pairs: Mapping[tuple[int, int], np.ndarray]
) -> tuple[float, float] | None:
    """Errors of the pose from pairs, mm and deg; None if there is no pose."""
    T, truth = pose_by_pairs(shot, rig, pairs), shot.now.T_world_handle
    if T is None or truth is None:
        return None
    errors = pose_errors(*(RigidTransform.concatenate([one]) for one in (T, truth)))
    return errors.E_t_mm, errors.geodesic_mean_deg


def shares(draws: pd.DataFrame) -> Row:
    """Sums over the draws, and their shares in percent with intervals over the draws."""
    counted = ["instants", "given", "wrong", "due", "missing", "posed", "compared"]
    totals = draws[counted].sum()
    row: dict[str, Any] = {
        "draws": len(draws),
        **{name: int(value) for name, value in totals.items()},
        "seed": SEED,
    }
    for part, whole in (("wrong", "given"), ("missing", "due")):
        interval = of_ratio(draws[part], draws[whole])
        if totals[part] == 0:  # drawn again, nothing is nothing
            interval = of_share(0, totals[whole])
        percent = Interval(100.0 * interval.low, 100.0 * interval.high, interval.how)
        row |= columns_of_mean(f"{part}_percent", [100.0 * totals[part] / totals[whole]], percent)
    for part, name in (("sum_mm", "E_t_mm"), ("sum_deg", "angle_deg")):
        mean = ratio(draws[[part, "compared"]].to_numpy())
        row |= columns_of_mean(name, [mean], of_ratio(draws[part], draws["compared"]))
    return row


TABLES = [
    Table(
        "match_rivals",
        one_draw,
        [{}],
        by=("calibration_px", "gate_px", "rule"),
        draws=12,
        summary=shares,
    )
]
