"""What the page's sliders set: one table of names, ranges and units for page and loop."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from trinolab.background import BackgroundParameters
from trinolab.camera import Rig
from trinolab.checks import as_number
from trinolab.datasets import IMAGE_SIZE
from trinolab.following.parameters import FollowParameters
from trinolab.matching import MatchParameters
from trinolab.slave.mapping import MappingParameters

POSE, PAPER = "pose", "paper"  # which tracker follows the handle


class Slider(NamedTuple):
    """A number that the page sets: its name, what it says there, its range, step, value and unit;
    `paper` if only the paper's tracker asks for it.
    """

    name: str
    label: str
    low: float
    high: float
    step: float
    value: float
    unit: str
    paper: bool = False


SLIDERS = (
    Slider("scale", "scale, tool : handle", 0.1, 4.0, 0.1, 1.0, ""),
    Slider("cutoff_hz", "filter cut-off", 0.2, 10.0, 0.1, 1.5, "Hz"),
    Slider("delay_ms", "added delay", 0.0, 1000.0, 10.0, 0.0, "ms"),
    Slider("update_rate", "alpha (Eq. 6)", 0.0, 0.2, 0.005, 0.01, "", True),
    Slider("ncc_threshold", "NCC threshold (Eq. 18)", 0.0, 0.95, 0.05, 0.5, "", True),
)
Values = dict[str, float]


def defaults() -> Values:
    """The value of each slider at the start."""
    return {slider.name: slider.value for slider in SLIDERS}


def checked(name: object, value: object) -> float:
    """A slider's new value. Raises ValueError for an unknown slider, or a value out of range."""
    for slider in SLIDERS:
        if slider.name == name:
            return as_number(value, slider.name, slider.low, slider.high)
    raise ValueError(f"set: expected one of {', '.join(defaults())}, got {name!r}")


def follow_parameters(values: Values, rig: Rig, estimator: str) -> FollowParameters:
    """The tracker's parameters; a region that moves is as large a share of small images."""
    share = min(camera.size[0] * camera.size[1] for camera in rig.cameras) / (
        IMAGE_SIZE[0] * IMAGE_SIZE[1]
    )
    standard = BackgroundParameters(update_rate=values["update_rate"])
    return FollowParameters(
        background=replace(standard, min_pixels=max(round(share * standard.min_pixels), 1)),
        matching=MatchParameters(ncc_threshold=values["ncc_threshold"]),
        estimator=estimator,
    )


def mapping_parameters(values: Values, before: MappingParameters) -> MappingParameters:
    """The mapping's parameters."""
    filtering = replace(before.filtering, cutoff_hz=values["cutoff_hz"])
    return replace(before, scale=values["scale"], filtering=filtering)
