"""A2: static accuracy over the common field of view: poses of a Sobol sequence, each measured once
and alone.
"""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from trinolab.checks import Array
from trinolab.metrics import FAR_DEG, FAR_MM
from trinolab.pose import rigid_fit
from workbench.intervals import by_bootstrap, rms

from . import figures, tracks
from .numbers import Answer, Number, Picture, distribution, far_count, share
from .setup import FREEDOMS, Drawn, Setup, sobol_poses
from .tracks import Row

NAME = "A2"
TITLE = "Static accuracy over the common field of view"
TOGETHER = 4  # poses of a part
ERRORS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
BINS, FEWEST = 6, 10  # of a freedom, and poses in each, to ask whether an error goes with it


def parts(setup: Setup) -> int:
    """How many groups of poses."""
    return -(-setup.poses // TOGETHER)


def run(setup: Setup, k: int) -> list[Row]:
    """Render and measure a few poses, each with its own noise."""
    poses = sobol_poses(setup.field, setup.poses, setup.seed).poses
    part = range(k * TOGETHER, min((k + 1) * TOGETHER, setup.poses))
    return tracks.rows_at_rest(setup, NAME, poses, part)


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """Errors before and after a rigid registration, where they are large, and what they go with."""
    drawn = sobol_poses(setup.field, setup.poses, setup.seed)
    track = tracks.as_track([row for part in rows for row in part])
    off, measured = tracks.errors(track, drawn.poses, setup, one_track=False)
    seed = setup.seed
    answer = Answer([share(NAME, "poses measured", int(measured.sum()), len(measured), seed)])
    answer.notes.append(
        f"{setup.poses} poses of a Sobol sequence: origins even in the volume, the handle's axis "
        "60 to 120 deg from the first camera's, any turn. Nobody holds the handle. The field is "
        f"{setup.field.volume_mm3 / 1e6:.1f} litres; the origins keep "
        f"{setup.field.reach_mm:.0f} mm from its edges, so that all markers stay in all images."
    )
    if not measured.any():
        return answer
    distances, angles = tracks.lengths(off[measured])
    answer.numbers += [
        *distribution(NAME, "position error", distances, "mm", seed),
        *distribution(NAME, "angle error", angles, "deg", seed),
        *_registered(drawn, off, measured, seed),
        far_count(
            NAME, int(((distances > FAR_MM) | (angles > FAR_DEG)).sum()), len(distances), seed
        ),
        *_true_by_reported(distances, angles, track.sigmas[measured], seed),
    ]
    answer.pictures += _pictures(drawn, off, measured)
    return answer


def _registered(drawn: Drawn, off: Array, found: np.ndarray, seed: int) -> list[Number]:
    """Errors after the rigid motion that best carries the measured positions onto the true ones."""
    truths = drawn.poses[found]
    measured = truths.translation + off[found, :3]
    T = rigid_fit(measured, truths.translation)
    if T is None:
        return []
    distances = np.linalg.norm(T.apply(measured) - truths.translation, axis=1)
    angles = np.rad2deg((T.rotation * Rotation.from_rotvec(off[found, 3:])).magnitude())
    return [
        *distribution(NAME, "position error, registered", distances, "mm", seed),
        *distribution(NAME, "angle error, registered", angles, "deg", seed),
    ]


def _true_by_reported(distances: Array, angles: Array, sigmas: Array, seed: int) -> list[Number]:
    """True error divided by the reported standard deviation, root mean square."""
    numbers = []
    for kind, error, sigma in (
        ("position", distances, sigmas[:, 0]),
        ("angle", angles, sigmas[:, 1]),
    ):
        ratio = error / sigma
        number = Number(
            NAME, f"true / reported {kind} error", "rms", rms(ratio), "", len(ratio), seed
        )
        numbers.append(number.within(by_bootstrap(ratio, rms)))
    return numbers


def explained(freedoms: Array, values: Array) -> tuple[Array, Array]:
    """How much of each error goes with each degree of freedom.

    A freedom is cut into `BINS` ranges of equally many poses, which serves an angle that closes on
    itself as well. The ranks of the absolute errors in them are compared by the test of Kruskal and
    Wallis (1952, DOI 10.1080/01621459.1952.10483441).

    Parameters
    ----------
    freedoms : ndarray, shape (n, d)
    values : ndarray, shape (n, e)

    Returns
    -------
    share : ndarray, shape (d, e)
        Of the ranks' variance that lies between the ranges, H / (n - 1); NaN for too few poses.
    chance : ndarray, shape (d, e)
        Probability of as much or more where nothing goes with anything.
    """
    shape = freedoms.shape[1], values.shape[1]
    part = np.full(shape, np.nan)
    chance = np.full(shape, np.nan)
    if len(values) < BINS * FEWEST:
        return part, chance
    for d, e in np.ndindex(*shape):
        order = np.argsort(freedoms[:, d], kind="stable")
        ordered = np.abs(values[order, e])
        if np.ptp(ordered) == 0:  # all of one rank
            part[d, e], chance[d, e] = 0.0, 1.0
            continue
        test = stats.kruskal(*np.array_split(ordered, BINS))
        part[d, e] = test.statistic / (len(values) - 1)
        chance[d, e] = test.pvalue
    return part, chance


def _pictures(drawn: Drawn, off: Array, found: np.ndarray) -> list[Picture]:
    distances, angles = tracks.lengths(off[found])
    freedoms = drawn.freedoms[found]
    position = freedoms[:, :3]
    axes = FREEDOMS[:3]
    maps = [
        Picture(
            f"map_{name}",
            f"Where in the field the position error is how large, seen along {along}: a dot per "
            "pose, its colour the error on a logarithmic scale.",
            figures.as_png(
                figures.plot_error_map(
                    position[:, pair], distances, [axes[k] for k in pair], "position error / mm"
                )
            ),
        )
        for name, along, pair in (("xz", "y", [0, 2]), ("yz", "x", [1, 2]))
    ]
    against = [
        Picture(
            f"freedoms_{name}",
            f"The {name} error over each of the six degrees of freedom, a dot per pose, with the "
            "median of six ranges.",
            figures.as_png(
                figures.plot_against(freedoms, values, FREEDOMS, f"{name} error / {unit}", BINS)
            ),
        )
        for name, values, unit in (("position", distances, "mm"), ("angle", angles, "deg"))
    ]
    part, chance = explained(freedoms, off[found])
    if np.isnan(part).any():  # too few poses
        return [*maps, *against]
    matrix = Picture(
        "explained",
        "A table of six degrees of freedom by six components of the error: the share of the ranks' "
        "variance that goes with a freedom, with a frame where that is no accident.",
        figures.as_png(
            figures.plot_explained(
                100 * part,
                chance < 0.05 / chance.size,
                [f.split(" /")[0] for f in FREEDOMS],
                ERRORS,
            )
        ),
    )
    return [*maps, *against, matrix]
