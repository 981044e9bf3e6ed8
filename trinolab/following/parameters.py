"""The parameters of the tracker that follows the handle's pose."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..parameters import Parameters
from .posefilter import PoseFilterParameters


@dataclass(frozen=True)
class FollowParameters(Parameters):
    """Parameters of a measurement, and of following it through a recording.

    Attributes
    ----------
    motion : PoseFilterParameters
    exposure_s : float
        How long the shutter is open, s; a moving marker is smeared as long.
    """

    motion: PoseFilterParameters = field(default_factory=PoseFilterParameters)
    exposure_s: float = 0.01

    @property
    def checked(self) -> FollowParameters:
        """With the paper's poses checked against the pixels: a track must not begin at a wrong one."""
        return replace(self, estimator="paper_checked") if self.estimator == "paper" else self
