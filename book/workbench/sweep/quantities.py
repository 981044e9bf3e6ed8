"""What is known of a sweep's columns: units, the paper's values, and how many poses are behind an
error.
"""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

__all__ = ["PAPER", "Count", "count_of", "labelled", "unit_of"]

# Eq. 26 and 27 as Sect. 6.5 states them; `data/claims.toml` has them with their places.
PAPER = {"E_t_mm": 0.31, "E_alpha_deg": 0.67, "E_beta_deg": 0.56, "E_gamma_deg": 0.65}

ENDINGS = {
    "mm": "mm",
    "deg": "deg",
    "px": "px",
    "s": "s",
    "ms": "ms",
    "hz": "Hz",
    "N": "N",
    "kg": "kg",
    "percent": "%",
    "share": "%",
}
UNITS = {
    "update_rate": "1/frame",
    "slow_rate": "1/frame",
    "difference_threshold": "grey levels",
    "shadow_share": "",
    "share": "",
    "read_noise": "grey levels",
    "jerk_intensity": "mm$^2$/s$^5$",
    "velocity_sigma": "px/s",
}


class Count(NamedTuple):
    """The columns that say how many poses a mean is over, and how many there were."""

    measured: str
    all: str


# From the beginning of a result's name to its counts, in the chapters that glue them.
COUNTS = {
    "E_": [Count("cured_poses", "poses"), Count("fitted_instants", "instants")],
    "geodesic_mean_deg": [Count("fitted_instants", "instants")],
    "layout_": [Count("measured_instants", "instants")],
}


def unit_of(name: str) -> str:
    """The unit of a parameter or a result, from its name; empty if it has none."""
    return UNITS[name] if name in UNITS else ENDINGS.get(name.rpartition("_")[2], "")


def labelled(name: str) -> str:
    """A name with its unit, as an axis has it."""
    unit = unit_of(name)
    if "/" in unit:
        return f"{name}, {unit}"
    return f"{name} / {unit}" if unit else name


def count_of(name: str, columns: Container[str]) -> Count | None:
    """The columns with the number of poses behind a result, where a table has them."""
    for beginning, counts in COUNTS.items():
        if name.startswith(beginning):
            return next((count for count in counts if count.measured in columns), None)
    return None
