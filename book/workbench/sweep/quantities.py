"""What is known of a sweep's columns: units, the paper's values, and how many poses are behind an
error.
"""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

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
# of two words, which go before those of one
PAIRS = {
    "deg_s": "deg/s",
    "mm_s": "mm/s",
    "bit_s": "bit/s",
    # of chapter 3: shares of the pixels, in percent
    "rest_end": "%",
    "ghost_end": "%",
}
LAST = dict.fromkeys(("false", "after", "missed", "rest"), "%")  # of chapter 3, as the second word
COUNTED = (
    "wrong",
    "missing",
    "due",
    "given",
    "lost",
    "left",
    "named",
)  # first words of whole numbers
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


# From the beginning of a result's name to its counts, in the chapters that glue them and in tables.
COUNTS = {
    "E_": [
        Count("cured_poses", "poses"),
        Count("fitted_instants", "instants"),
        Count("n", "poses"),
    ],
    "geodesic_": [Count("fitted_instants", "instants"), Count("n", "poses")],
    "layout_": [Count("measured_instants", "instants")],
    "wrong_percent": [Count("due_matches", "due_matches")],
    "missing_percent": [Count("due_matches", "due_matches")],
}


def unit_of(name: str) -> str:
    """The unit of a parameter or a result, from the words of its name; empty if it has none."""
    if name in UNITS:
        return UNITS[name]
    words = name.split("_")
    for at in reversed(range(len(words))):
        if unit := PAIRS.get("_".join(words[at - 1 : at + 1])) or ENDINGS.get(words[at]):
            return unit
    return LAST.get(words[-1], "") if len(words) == 2 else ""


def is_count(name: str, whole: bool) -> bool:
    """Whether a result of whole numbers counts something, by the first or last word of its name."""
    words = name.split("_")
    return whole and not unit_of(name) and (words[0] in COUNTED or words[-1] in COUNTED)


def labelled(name: str, counts: bool = False) -> str:
    """A name with its unit, as an axis has it, or that it counts something."""
    unit = unit_of(name)
    if counts or "/" in unit:
        return f"{name}, {unit or 'number'}"
    return f"{name} / {unit}" if unit else name


def paper_value(name: str) -> float | None:
    """What the paper states for a result, whoever has measured it; None where it states nothing."""
    return next(
        (value for key, value in PAPER.items() if f"_{key}_" in f"_{name}_"),
        None,
    )


def count_of(name: str, columns: Container[str]) -> Count | None:
    """The columns with the number of poses, or of matches, behind a result, where a table has them."""
    for beginning, counts in COUNTS.items():
        if name.startswith(beginning):
            known = next((count for count in counts if count.measured in columns), None)
            if known is not None:
                return known
    first, _, rest = name.partition("_")
    if first in ("wrong", "missing") and f"due_{rest}" in columns:
        return Count(f"due_{rest}", f"due_{rest}")
    # of several estimators in one row
    which = f"n_{name.rpartition('_')[2]}"
    is_error = name.startswith(("E_", "geodesic_"))
    return Count(which, "poses") if is_error and which in columns else None
