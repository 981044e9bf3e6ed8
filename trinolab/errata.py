"""The paper's misprints as printed, each beside what shows that it is one. Nothing here is for use.

An effect is one quantity, computed once by the printed form and once by the corrected one, and a check that the first
fails and the second passes. The printed forms stand in the modules ``errata_*`` and nowhere else in the package.
"""

from __future__ import annotations

from collections.abc import Callable

from . import errata_background, errata_kalman, errata_markers, errata_pose, errata_table1, errata_workspace
from .errata_pose import printed_rotation_error
from .errata_workspace import printed_cones, printed_workspace_volume
from .ledger import Effect

__all__ = ["ERRATA", "effects", "printed_cones", "printed_rotation_error", "printed_workspace_volume"]

ERRATA: dict[str, tuple[Callable[[], Effect], ...]] = {
    "1": (errata_workspace.turn_of_ccd1,),
    "2": (errata_workspace.turn_of_ccd2,),
    "3": (errata_workspace.turn_of_ccd3, errata_workspace.shift_of_ccd3),
    "4": (errata_workspace.workspace_volume,),
    "5": (errata_background.black_pixels,),
    "6": (errata_background.resting_handle,),
    "8": (errata_kalman.late_observation,),
    "9": (errata_kalman.noisy_prediction,),
    "10": (errata_kalman.lost_transpose,),
    "12": (errata_kalman.sum_observed,),
    "14": (errata_kalman.one_for_a_matrix, errata_kalman.late_covariance),
    "16": (errata_markers.endless_bisection, errata_markers.wrong_way),
    "17": (errata_markers.residual_for_a_distance,),
    "18": (errata_markers.broken_bounds, errata_markers.window_that_starts_at_its_point),
    "20": (errata_pose.direction_of_motion, errata_pose.second_form, errata_pose.first_form,
           errata_pose.one_focal_length),
    "21": (errata_pose.change_of_frame,),
    "22": (errata_pose.plain_mean,),
    "24": (errata_pose.four_markers, errata_pose.any_matrix),
    "27": (errata_table1.plain_difference,),
    "Sect. 3.2": (errata_workspace.whole_sides,),
    "Sect. 4.2": (errata_kalman.certain_start, errata_kalman.largest_rectangle),
    "Sect. 6.2": (errata_pose.no_rotation, errata_pose.use_of_no_rotation),
    "Sect. 6.5": (errata_table1.mean_of_alpha,),
}
"""The entry of ``data/equations.toml`` -> what computes its effects."""


def effects() -> dict[str, tuple[Effect, ...]]:
    """Compute every effect, by the entry of the ledger; it takes a few seconds."""
    return {no: tuple(compute() for compute in functions) for no, functions in ERRATA.items()}
