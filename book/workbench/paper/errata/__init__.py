"""The paper's misprints as printed, each beside what shows that it is one. Nothing here is for use.

An effect is one quantity, computed once by the printed form and once by the corrected one, and a
check that the first fails and the second passes. The printed forms stand in the modules
``errata_*`` and nowhere else in the package.
"""

from __future__ import annotations

from collections.abc import Callable

from ..ledger import Effect
from . import background, kalman, markers, pose, table1, workspace

__all__ = [
    "ERRATA",
    "effects",
    "printed_cones",
    "printed_rotation_error",
    "printed_workspace_volume",
]

ERRATA: dict[str, tuple[Callable[[], Effect], ...]] = {
    "1": (workspace.turn_of_ccd1,),
    "2": (workspace.turn_of_ccd2,),
    "3": (workspace.turn_of_ccd3, workspace.shift_of_ccd3),
    "4": (workspace.workspace_volume,),
    "5": (background.black_pixels,),
    "6": (background.resting_handle,),
    "8": (kalman.late_observation,),
    "9": (kalman.noisy_prediction,),
    "10": (kalman.lost_transpose,),
    "12": (kalman.sum_observed,),
    "14": (kalman.one_for_a_matrix, kalman.late_covariance),
    "16": (markers.endless_bisection, markers.wrong_way),
    "17": (markers.residual_for_a_distance,),
    "18": (markers.broken_bounds, markers.window_that_starts_at_its_point),
    "20": (pose.direction_of_motion, pose.second_form, pose.first_form, pose.one_focal_length),
    "21": (pose.change_of_frame,),
    "22": (pose.plain_mean,),
    "24": (pose.four_markers, pose.any_matrix),
    "27": (table1.plain_difference,),
    "Sect. 3.2": (workspace.whole_sides,),
    "Sect. 4.2": (kalman.certain_start, kalman.largest_rectangle),
    "Sect. 6.2": (pose.no_rotation, pose.use_of_no_rotation),
    "Sect. 6.5": (table1.mean_of_alpha,),
}

"""The entry of ``data/equations.toml`` -> what computes its effects."""


def effects() -> dict[str, tuple[Effect, ...]]:
    """Compute every effect, by the entry of the ledger; it takes a few seconds."""
    return {no: tuple(compute() for compute in functions) for no, functions in ERRATA.items()}
