"""The answer to the question that a reader brings: where do the paper's 0.31 mm come from?

Four statements, whose numbers come from Table 1, the error budget and the tests of its pattern. The
start page, the scoreboard, the report, the article and chapter 9 begin with them. Chapter 9.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1

from . import error_sources, isotropy
from .deviations import exact
from .pattern import smooth_share

LEVEL = 0.05
PAPER_MM = 0.31  # Sect. 6.5
# Words in the names of models that set something wrongly; in all others images and cameras err.
SET_WRONGLY = ("set", "reference", "misaligned", "clamped")


class Facts(NamedTuple):
    """Values on which the sentences rest.

    Attributes
    ----------
    E_t_mm : float
        Of the printed table (Eq. 26).
    scatter_mm : tuple of float
        Standard deviations of its position errors in x, y and z.
    isotropic_p : float
        Of Mauchly's test that these are equal.
    by_images : tuple of isotropy.Bound
        The share of the mean square for which random errors of the images account, of any size: with
        the covariance of the rod by Eq. 20 to 24, of the rod by least squares, and of a point.
    elongation : float
        Largest standard deviation of such an error, divided by the smallest; the least of all poses.
    assumed_share : float
        Of the mean square after the registration, for which errors of the assumed sizes account:
        images, calibration, platform, digits.
    smooth_p : float
        Share of tables with independent errors whose smooth share is at most the table's.
    constant_share : float
        Of the mean square of the angle errors, for which a constant of each angle accounts.
    offsets_deg : tuple of float
        These constants.
    models : int
        Number of models that were compared with the pattern.
    left : tuple of str
        Those of them that no statistic rejects.
    by_cameras : dict
        Least corrected p of an offset, for the models whose errors come from images and cameras alone.
    """

    E_t_mm: float
    scatter_mm: tuple[float, ...]
    isotropic_p: float
    by_images: tuple[isotropy.Bound, ...]
    elongation: float
    assumed_share: float
    smooth_p: float
    constant_share: float
    offsets_deg: tuple[float, ...]
    models: int
    left: tuple[str, ...]
    by_cameras: dict[str, float]


def facts(draws: int = 4000, seed: int = 0) -> Facts:
    """Values on which the sentences rest, with `draws` tables of independent errors, from `seed`."""
    table = load_table1()
    errors = exact([table.measured], table.set_poses)
    places, angles = errors.position_mm[0], errors.angles_deg[0]
    rows = load_sweep("budget").set_index(["registration", "source"]).rms_E_t_mm["20 poses"]
    chance = np.random.default_rng(seed).standard_normal((draws, *places.shape))
    positions = table.set_poses.translation
    smooth = smooth_share(positions, places)
    constant = len(angles) * (angles.mean(axis=0) ** 2).sum() / (angles**2).sum()
    patterns = load_sweep("patterns")
    least = patterns[~patterns["fitted"]].groupby("model", sort=False)["p_holm"].min()
    offsets = patterns[patterns["statistic"].str.startswith("offset")]
    by_cameras = {
        str(model): float(some["p_holm"].min())
        for model, some in offsets.groupby("model", sort=False)
        if not any(word in str(model) for word in SET_WRONGLY)
    }
    trial = error_sources.make_trial(load_rig("paper_pair"), load_handle("paper"), table.set_poses)
    covariances = [
        isotropy.of_source(error_sources.pixel_noise(trial, 1.0)),
        isotropy.of_rods(trial.rig, trial.handle, table.set_poses),
        isotropy.of_points(trial.rig, positions),
    ]
    return Facts(
        float(np.linalg.norm(places, axis=1).mean()),
        tuple(map(float, places.std(axis=0, ddof=1))),
        isotropy.mauchly(places),
        tuple(isotropy.of_images(places, positions, one, LEVEL) for one in covariances),
        float(np.sqrt(np.linalg.cond(covariances).min())),
        float((rows["certain: drawn together"] / rows["Table 1"]) ** 2),
        float((smooth_share(positions, chance) <= smooth).mean()),
        float(constant),
        tuple(map(float, angles.mean(axis=0))),
        len(least),
        tuple(str(model) for model in least.index[least >= LEVEL]),
        by_cameras,
    )


def checked(found: Facts) -> Facts:
    """The facts, if they support the sentences.

    Raises
    ------
    ValueError
        Names the part of a sentence that they do not support.
    """
    most = [bound.at_most for bound in found.by_images]
    parts = {
        "printed table is indeed": abs(found.E_t_mm - PAPER_MM) <= 0.005,
        "independent from pose to pose": LEVEL / 2 < found.smooth_p < 1 - LEVEL / 2,
        "in each direction": found.isotropic_p > LEVEL,
        "Whatever their size": min(bound.refused for bound in found.by_images) > 20.0,
        "much larger in one direction": found.elongation > 2.0,
        "they explain at most": max(most) < 0.5,
        "the sizes that we assume": found.assumed_share < min(most),
        "mostly constant": found.constant_share > 0.5,
        "too few to tell": len(found.left) != 1,
    }
    for part, holds in parts.items():
        if not holds:
            raise ValueError(f"answer: {part!r} does not hold; write the sentences again: {found}")
    return found


def sentences(found: Facts | None = None) -> tuple[str, ...]:
    """The answer, no stronger than the facts; by default those of the shipped tables."""
    f = checked(found or facts())
    most = [100 * bound.at_most for bound in f.by_images]
    alpha, beta, gamma = f.offsets_deg
    return (
        f"The mean position error of the paper's printed table is indeed {PAPER_MM} mm, and its position errors "
        "look random: independent from pose to pose, with a standard deviation of "
        f"{np.mean(f.scatter_mm):.1f} mm in each direction.",
        "Random errors of the pixel coordinates would be much larger in one direction than in another. Whatever "
        f"their size, they explain at most {min(most):.0f} to {max(most):.0f} % of the mean squared position "
        "error, depending on how the position is computed; with the sizes that we assume, all sources that were "
        f"certainly there explain {100 * f.assumed_share:.0f} %.",
        f"The error of each angle is mostly constant ({alpha:.1f}°, {beta:.1f}° and {gamma:.1f}° for α, β and γ), "
        "as if the angle had been read from a scale with a wrong zero.",
        "Twenty poses are too few to tell which part of the set-up caused these errors.",
    )


def sentence(found: Facts | None = None) -> str:
    """The sentences as one paragraph."""
    return " ".join(sentences(found))
