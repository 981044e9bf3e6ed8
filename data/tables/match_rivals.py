"""Rules that pair spots, while the calibration is right or off; see `workbench.studies.match_rivals`.

A draw is a pair of recordings, `calm` and `hard`, with motions of their own; a few instants of each are
rendered, and every rule and every calibration pairs the same spots.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from trinolab import matching
from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import take
from trinolab.camera import Rig, RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.markers import find_markers
from trinolab.matching import MatchParameters
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from workbench.intervals import Interval, of_ratio, of_share
from workbench.studies.broken import covariance_of_such, miscalibrated
from workbench.studies.carrier import Row, Table, columns_of_mean
from workbench.studies.ground_truth import instant_of
from workbench.studies.match_rivals import HANDLE, RULES, Shot, Spots, by_layout, counts, shot_of

RIG = "raised_40deg"
LEVELS_PX = (0.0, 0.5, 2.0)  # standard deviations of the principal points' coordinates
GATES_PX = (2.0, 8.0)
# two seconds each: the second one of `calm`, in which a hand is there, and all of `hard`
FRAMES = {"calm": range(30, 60, 8), "hard": range(2, 60, 8)}
SEED = 6  # of the calibrations
FOUR = "four constraints"
LAYOUT = "layout"  # the rig file passes for exact
LAYOUT_STATED = "layout, error stated"  # it says how far off it may be


def one_draw(draw: int) -> list[Row]:
    """The counts of the recordings with the seed draw + 1, over all their instants and cameras."""
    seed = draw + 1
    rig = load_rig(RIG)
    shots = [shot for name in FRAMES for shot in shots_of(name, seed, rig)]
    rows: list[Row] = []
    for level_px in LEVELS_PX:
        # one direction of error, which the level scales
        believed = miscalibrated(rig, level_px, 0.0, np.random.default_rng([SEED, seed]))
        believed = replace(believed, covariance=RigCovariance.exact(rig.names))
        stated = replace(believed, covariance=covariance_of_such(believed, level_px, 0.0))
        for gate_px in GATES_PX:
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
        shots.append(shot_of(instant_of(job, frame, images), rig, uv))
    return shots


def _totals(
    shots: list[Shot], rig: Rig, stated: Rig, settings: MatchParameters
) -> dict[str, dict[str, int]]:
    """The counts of each rule, summed over instants and pairs of cameras."""
    handle = load_handle(HANDLE)
    p = Parameters(matching=settings, estimator="paper")
    names = (*RULES, FOUR, LAYOUT, LAYOUT_STATED)
    found: dict[str, list[dict[str, int]]] = {name: [] for name in names}
    for shot in shots:
        named = {
            LAYOUT: measure(shot.now.images, rig, handle, parameters=p).labels,
            LAYOUT_STATED: measure(shot.now.images, stated, handle, parameters=p).labels,
        }
        for i, j in rig.pairs:
            left, right = rig.cameras[i], rig.cameras[j]
            views = (left, right, shot.now.images[i], shot.now.images[j], shot.uv[i], shot.uv[j])
            D = matching.epipolar_distances(left, right, shot.uv[i], shot.uv[j])
            S = matching.ncc_matrix(*views[2:], settings.window_px)
            for name, rule in RULES.items():
                pairs = rule(Spots(D, S), settings.epipolar_gate_px)
                found[name].append(counts(shot, i, j, pairs))
            pairs = matching.match(*views, settings).index
            found[FOUR].append(counts(shot, i, j, pairs))
            for name, labels in named.items():
                found[name].append(counts(shot, i, j, by_layout(labels[i], labels[j])))
    return {
        name: {key: sum(one[key] for one in ones) for key in ones[0]}
        for name, ones in found.items()
    }


def shares(draws: pd.DataFrame) -> Row:
    """Sums over the draws, and their shares in percent with intervals over the draws."""
    totals = draws[["instants", "given", "wrong", "due", "missing"]].sum()
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
