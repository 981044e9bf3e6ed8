"""The parameters of a measurement, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

from .background import BackgroundParameters
from .checks import as_number
from .identity.parameters import IdentityParameters
from .kalman import KalmanParameters
from .markers import MarkerParameters
from .matching import MatchParameters
from .methods import check_option, estimator_of


@dataclass(frozen=True)
class Parameters:
    """Parameters of a measurement, stage by stage.

    Attributes
    ----------
    background : BackgroundParameters
        Used by those who follow the handle, like `kalman` and `memory_s` by `tracker.step` alone.
    kalman : KalmanParameters
    markers : MarkerParameters
    matching : MatchParameters
    identity : IdentityParameters
    estimator : {"paper", "reprojection", "patches", "best"}
        Method that estimates the pose from the markers, see `estimators.estimate`; ``best`` is
        stored as ``patches``. None leaves it to the function that is given the parameters:
        `tracker.step` and `estimators.estimate` take the paper's, `measurement.measure` and the
        commands `methods.DEFAULT`.
    max_slant_deg : float
        Markers turned further away are identified but not measured, as long as four are left:
        beyond 70 deg the centroid of a wrapped marker lies more than 1 px from the image of its
        centre.
    sigma_px : float
        Standard uncertainty of a centroid, its bias included, where a rig is compared with it
        (`identity.reconcile`). Its contribution to the pose is in `uncertainty.centroids`.
    memory_s : float
        Time for which the last measured pose serves for prediction and for the choice among
        equivalent poses, s.
    check : bool
        Whether the paper's pose is checked against the pixels, see `estimators.checked`; no other
        estimator has this.
    """

    background: BackgroundParameters = field(default_factory=BackgroundParameters)
    kalman: KalmanParameters = field(default_factory=KalmanParameters)
    markers: MarkerParameters = field(default_factory=MarkerParameters)
    matching: MatchParameters = field(default_factory=MatchParameters)
    identity: IdentityParameters = field(default_factory=IdentityParameters)
    estimator: str | None = None
    max_slant_deg: float = 70.0
    sigma_px: float = 0.1
    memory_s: float = 0.3
    check: bool = False

    def __post_init__(self) -> None:
        if self.estimator is not None:
            object.__setattr__(self, "estimator", estimator_of(self.estimator, "estimator"))
        check_option(self.check, self.estimator)
        as_number(self.max_slant_deg, "max_slant_deg", low=0.0, high=90.0)
        as_number(self.sigma_px, "sigma_px", low=0.0, open_low=True)
        as_number(self.memory_s, "memory_s", low=0.0)

    def with_default(self, method: str) -> Self:
        """These parameters; with the estimator of that name where they name none."""
        return replace(self, estimator=method) if self.estimator is None else self
