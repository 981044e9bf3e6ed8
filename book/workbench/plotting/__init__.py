"""Figures: arrays in, figures out.

Colours are those of Okabe and Ito, which colour-blind readers can tell apart, on white, whatever
the page's theme.
"""

from .background import plot_pixel_histories, plot_shares, plot_verdicts, show_table
from .basics import (
    COLOURS,
    plot_curves,
    plot_pose_errors,
    show_frames,
    show_image,
    write_drawing,
)
from .calibration import (
    plot_boards,
    plot_chi_square,
    plot_grids,
    plot_relative_errors,
    plot_with_intervals,
)
from .errors import (
    picture_of_residuals,
    plot_by_slant,
    plot_calibration_error,
    plot_elevation,
    plot_estimators,
    plot_factor,
    plot_residuals,
    plot_shifts,
)
from .filters import (
    plot_beliefs,
    plot_learning,
    plot_normals,
    plot_prediction,
    plot_tracks,
)
from .markers import (
    mark_window,
    plot_following,
    plot_over_slant,
    plot_rod_section,
    plot_thresholds,
)
from .matching import plot_epipolar_plane, plot_windows
from .pose import plot_frames, plot_two_rays
from .rig import plot_layouts, plot_rig
from .slave import plot_arm, plot_delays, plot_exceedance, plot_session, plot_two_port
from .structure import plot_chain, plot_structure
from .table1 import (
    plot_budget,
    plot_errors_in_space,
    plot_factors,
    plot_null,
    plot_over_beta,
    plot_power,
    plot_refused,
)
from .wall import plot_impedances, plot_limits, plot_nyquist
from .workspace import (
    Mesh,
    plot_workspace,
    show_cones_from_above,
    workspace_plotter,
    workspace_scene,
)

__all__ = [
    "COLOURS",
    "Mesh",
    "mark_window",
    "picture_of_residuals",
    "plot_arm",
    "plot_beliefs",
    "plot_boards",
    "plot_budget",
    "plot_by_slant",
    "plot_calibration_error",
    "plot_chain",
    "plot_chi_square",
    "plot_curves",
    "plot_delays",
    "plot_elevation",
    "plot_epipolar_plane",
    "plot_errors_in_space",
    "plot_estimators",
    "plot_exceedance",
    "plot_factor",
    "plot_factors",
    "plot_following",
    "plot_frames",
    "plot_grids",
    "plot_impedances",
    "plot_layouts",
    "plot_learning",
    "plot_limits",
    "plot_normals",
    "plot_null",
    "plot_nyquist",
    "plot_over_beta",
    "plot_over_slant",
    "plot_pixel_histories",
    "plot_pose_errors",
    "plot_power",
    "plot_prediction",
    "plot_refused",
    "plot_relative_errors",
    "plot_residuals",
    "plot_rig",
    "plot_rod_section",
    "plot_session",
    "plot_shares",
    "plot_shifts",
    "plot_structure",
    "plot_thresholds",
    "plot_tracks",
    "plot_two_port",
    "plot_two_rays",
    "plot_verdicts",
    "plot_windows",
    "plot_with_intervals",
    "plot_workspace",
    "show_cones_from_above",
    "show_frames",
    "show_image",
    "show_table",
    "workspace_plotter",
    "workspace_scene",
    "write_drawing",
]
