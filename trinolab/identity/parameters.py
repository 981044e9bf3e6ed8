"""The parameters of the identification: every threshold that decides which marker is which."""

from __future__ import annotations

from dataclasses import dataclass

from ..checks import as_number, as_whole

# What the checks of `IdentityParameters` share, by the range that a field lies in.
_POSITIVE = (
    "gate_px",
    "sigma_px",
    "max_residual_px",
    "side_sigmas",
    "depth_step",
    "missing_share",
    "size_sigma",
    "roundness_sigma",
    "decisive_variances",
    "end_step_mm",
    "end_reach_mm",
)
_NOT_NEGATIVE = ("depth_range", "edge_px", "end_contrast")
_WHOLE = {
    "min_markers": 3,
    "tried_per_marker": 1,
    "max_pairs": 3,
    "max_single": 3,
    "seeds_kept": 1,
    "end_run": 1,
}


@dataclass(frozen=True)
class IdentityParameters:
    """Parameters of the identification, which the paper takes for granted (Sect. 5.2).

    Attributes
    ----------
    gate_px : float
        How far a found marker may lie from where a pose predicts it.
    sigma_px : float
        Standard deviation of a centroid's coordinate from where a pose predicts it, all biases
        included: of the detector, the calibration, the markers' places on the handle.
    min_markers : int
        Different markers that a pose must label; the paper asks for four.
    max_residual_px : float
        Largest residual, see `Hypothesis`.
    tried_per_marker : int
        Found markers of an image that are tried, as a multiple of the handle's markers.
    max_apart_deg : float
        Largest angle between the normals of two markers that one viewpoint may see.
    max_pairs : int
        Pairs of found markers of two cameras that are tried, those with the smallest gap between
        their rays first.
    max_single : int
        Found markers of one camera that are tried where it is the only one.
    side_sigmas : float
        Standard deviations by which the side of a triangle of found points may differ from the
        layout's.
    away_cosine : float
        Cosine of ray and normal above which a marker faces away; a little tolerance for poses that
        are not fitted yet.
    seeds_kept : int
        Poses of one set of seeds that are fitted.
    depth_range, depth_step : float
        The distance from one camera alone is uncertain by some percent: distances nearer and
        farther by up to this share are tried with the other cameras, in steps of this share.
    fit_gates : tuple of float
        Gates of the fits one after the other, in `gate_px`.
    enough_evidence : float
        Evidence (see `scoring.Verdict`) at which the search ends.
    steep_deg : float
        Slant from which on a marker's weight falls, and beyond which it is not missed.
    certain_deg : float
        Slant up to which a marker that is not found counts as missing in full; up to `steep_deg`
        less and less.
    edge_px : float
        A marker nearer to the image's edge is not missed.
    chance : float
        Probability of a coincidence up to which a pose holds: that markers thrown at random within
        the gate fit as well. Thousands of poses are tried.
    missing_share : float
        Share of a missing marker from which on something is missing.
    size_sigma, roundness_sigma : float
        Standard deviations of a marker's size (its logarithm) and of its ratio of axes: blur and
        motion blur change both.
    decisive_variances : float
        Difference of two costs, in variances of a centroid, by which the images decide between two
        poses.
    same_pose_deg : float
        Poses that are turned less against each other are one.
    end_step_mm : float
        Distance of the stations along the axis at which the body's edges are looked at.
    end_reach_mm : float
        How far they are looked at beyond the part of the body that two poses share: a hand may hold
        what follows.
    end_run : int
        Stations in a row that have to show the body.
    end_contrast : float
        Grey levels; an edge of less contrast shows nothing.
    end_lead : float
        Share of an edge's contrast by which a camera decides for an end of the body; by half of it
        it objects.
    """

    gate_px: float = 4.0
    sigma_px: float = 0.3
    min_markers: int = 4
    max_residual_px: float = 0.8
    tried_per_marker: int = 3
    max_apart_deg: float = 150.0
    max_pairs: int = 48
    max_single: int = 24
    side_sigmas: float = 3.0
    away_cosine: float = 0.1
    seeds_kept: int = 8
    depth_range: float = 0.04
    depth_step: float = 0.004
    fit_gates: tuple[float, ...] = (4.0, 2.0, 1.0)
    enough_evidence: float = -35.0
    steep_deg: float = 75.0
    certain_deg: float = 55.0
    edge_px: float = 10.0
    chance: float = 4e-8
    missing_share: float = 0.7
    size_sigma: float = 0.2
    roundness_sigma: float = 0.15
    decisive_variances: float = 25.0
    same_pose_deg: float = 3.0
    end_step_mm: float = 1.5
    end_reach_mm: float = 15.0
    end_run: int = 4
    end_contrast: float = 8.0
    end_lead: float = 0.6

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            as_number(getattr(self, name), name, low=0.0, open_low=True)
        for name in _NOT_NEGATIVE:
            as_number(getattr(self, name), name, low=0.0)
        for name, low in _WHOLE.items():
            as_whole(getattr(self, name), name, low=low)
        for name in ("max_apart_deg", "same_pose_deg"):
            as_number(getattr(self, name), name, low=0.0, high=180.0)
        as_number(self.away_cosine, "away_cosine", low=-1.0, high=1.0)
        as_number(self.enough_evidence, "enough_evidence", high=0.0)
        as_number(self.steep_deg, "steep_deg", low=0.0, high=89.0, open_low=True)
        as_number(self.certain_deg, "certain_deg", low=0.0, high=self.steep_deg - 1e-3)
        as_number(self.chance, "chance", low=0.0, high=1.0, open_low=True)
        as_number(self.end_lead, "end_lead", low=0.0, high=1.0)
        if not isinstance(self.fit_gates, tuple) or not self.fit_gates:
            raise ValueError(
                f"fit_gates: expected a tuple of one or more numbers, got {self.fit_gates!r}"
            )
        for gate in self.fit_gates:
            as_number(gate, "fit_gates", low=0.0, open_low=True)
