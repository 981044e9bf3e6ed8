"""The parameters of the tracker that follows the handle's pose."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..checks import as_number, as_whole
from ..identity.search import SINGLE_UNITS
from ..methods import PAPER
from ..parameters import Parameters
from .posefilter import PoseFilterParameters

# What the checks of `FollowParameters` share, by the range that a field lies in.
_POSITIVE = (
    "still_misfit",
    "max_fit_residual_px",
    "max_sigma_mm",
    "max_sigma_deg",
    "shift_sigma_px",
)
_NOT_NEGATIVE = (
    "exposure_s",
    "rate_noise_mm_s",
    "rate_noise_rad_s",
    "blurred_px",
    "blurred_length",
    "agreed_mm",
    "search_px",
    "min_response",
    "shift_agreement_px",
    "gate_all_sigmas",
    "gate_all_mm",
    "gate_some_sigmas",
    "gate_some_mm",
)
_ANGLES_DEG = (
    "expected_slant_deg",
    "agreed_deg",
    "gate_all_deg",
    "gate_some_deg",
    "gate_alike_deg",
)

# of an instant, of which half is for the search: enough for one camera's triplet
LEAST_WORK = 2 * SINGLE_UNITS


@dataclass(frozen=True)
class FollowParameters(Parameters):
    """Parameters of a measurement, and of following it through a recording.

    Attributes
    ----------
    motion : PoseFilterParameters
    exposure_s : float
        How long the shutter is open, s: the time of a moving marker's motion blur.
    expected_slant_deg : float
        Markers turned further away are not looked for.
    rate_noise_mm_s, rate_noise_rad_s : float
        Process noise of the motion within the exposure: added to the standard deviations of the
        predicted rates.
    blurred_px : float
        Motion within the exposure above which a marker may show motion blur, and measured length
        above which it does.
    blurred_length : float
        Length of a marker's image, divided by its length without motion, above which it shows
        motion blur.
    still_misfit : float
        Misfit (1 is noise) up to which the image model without motion blur explains the images;
        above it the length of the markers' smear is measured.
    max_fit_residual_px : float
        Largest rms residual of the windows of a good fit.
    max_sigma_mm, max_sigma_deg : float
        Largest standard deviations of a measured pose: four of them are 2 mm and 5 deg.
    agreed_mm, agreed_deg : float
        Distance and angle by which an estimator's pose may differ from that on which the markers
        agree.
    min_found : int
        Least number of found markers in all cameras for a fit of pixels.
    min_shown_share : float
        Share of the expected markers that a camera must show for the image model to count it.
    most_work : float
        Most work that one instant takes, in units of `work.Work`. A fit that needs more ends with
        its pose so far; a search resumes in the next instant.
    search_px : float
        Largest shift of the handle's image that is looked for where the handle is not in its place.
    search_step_px : int
        Pixels of a step of this search.
    min_response : float
        Smallest response of a marker to the search, grey levels; less is noise.
    shift_sigma_px : float
        Standard deviation of the shift that one camera shows.
    shift_agreement_px : float
        Distance within which the cameras' shifts must agree on one motion of the handle.
    gate_all_sigmas, gate_all_mm, gate_all_deg : float
        Gate of a pose that all cameras show: distance and angle from the prediction, in its
        standard deviations, and what is added to them.
    gate_some_sigmas, gate_some_mm, gate_some_deg : float
        The same where a camera does not show it.
    gate_alike_deg : float
        Largest angle of either gate for a handle that looks alike from several sides: the paper's
        after 60 deg.
    """

    motion: PoseFilterParameters = field(default_factory=PoseFilterParameters)
    exposure_s: float = 0.01
    expected_slant_deg: float = 76.0
    rate_noise_mm_s: float = 50.0
    rate_noise_rad_s: float = 0.3
    blurred_px: float = 1.5
    blurred_length: float = 1.15
    still_misfit: float = 1.5
    max_fit_residual_px: float = 1.0
    max_sigma_mm: float = 0.5
    max_sigma_deg: float = 1.2
    agreed_mm: float = 1.5
    agreed_deg: float = 2.5
    min_found: int = 3
    min_shown_share: float = 0.55
    most_work: float = 240.0
    search_px: float = 60.0
    search_step_px: int = 3
    min_response: float = 2.0
    shift_sigma_px: float = 2.0
    shift_agreement_px: float = 6.0
    gate_all_sigmas: float = 5.0
    gate_all_mm: float = 5.0
    gate_all_deg: float = 5.0
    gate_some_sigmas: float = 3.0
    gate_some_mm: float = 2.0
    gate_some_deg: float = 2.5
    gate_alike_deg: float = 25.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in _POSITIVE:
            as_number(getattr(self, name), name, low=0.0, open_low=True)
        for name in _NOT_NEGATIVE:
            as_number(getattr(self, name), name, low=0.0)
        for name in _ANGLES_DEG:
            as_number(getattr(self, name), name, low=0.0, high=180.0)
        as_number(self.min_shown_share, "min_shown_share", low=0.0, high=1.0)
        as_whole(self.min_found, "min_found", low=1)
        as_number(self.most_work, "most_work", low=LEAST_WORK)
        as_whole(self.search_step_px, "search_step_px", low=1)

    @property
    def checked(self) -> FollowParameters:
        """These parameters, with the paper's poses checked against the pixels: a track must not
        begin at a wrong one. The paper's estimator is also that of parameters which name none.
        """
        p = self.with_default(PAPER)
        return replace(p, check=True) if p.estimator == PAPER else p
