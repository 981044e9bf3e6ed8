"""The chapters with other parameters than their own, and what each of them must glue."""

import tomllib

from chapters import is_study

ERRORS = {"E_t_mm", "E_alpha_deg", "E_beta_deg", "E_gamma_deg"}
# A new chapter needs an entry here, and in `SMALL` what makes it small.
OTHER_PARAMETERS = tomllib.loads("""
01_structure = {rig_name = "paper_pair", handle_name = "coded", row = 12, seed = 1}
02_workspace = {rig_name = "raised_40deg", half_angle_deg = 15.0}
03_background = {update_rate = 0.05, difference_threshold = 12.0, shadow_share = 0.4, seed = 1}
04_kalman = {jerk_intensity = 2e9, sigma_px = 3.0, velocity_sigma = 800.0, seed = 5}
05_markers = {surplus = 3.0, read_noise = 6.0, seed = 1}
05b_centroid = {surplus = 3.0, read_noise = 6.0, seed = 1}
06_matching = {ncc_threshold = 0.9, epipolar_gate_px = 1.0, instants = 8, seed = 1}
07_calibration = {positions = 10, square_mm = 12.0, half_window_px = 5, noise_px = 0.1, seed = 2}
07b_accuracy = {positions = 10, square_mm = 12.0, noise_px = 0.1, seed = 2}
08_pose = {handle_name = "coded", sigma_px = 0.05, seed = 3}
09_table1 = {handle_name = "coded", seed = 1, noise_px = 0.1, level = 0.001}
09b_causes = {handle_name = "coded", seed = 1, level = 0.001}
10_estimators = {rig_name = "raised_40deg", estimator = "reprojection", seed = 1}
10b_trust = {estimator = "reprojection", turned_deg = 0.02, seed = 1}
11_master_slave = {scale = 2.0, turn_scale = 0.5, cutoff_hz = 3.0, noise_mm = 0.1, seed = 1}
11b_delay = {scale = 2.0, turn_scale = 0.5, cutoff_hz = 3.0, noise_mm = 0.1, seed = 1}
12_force_feedback = {mass_kg = 0.5, damping = 5.0, delay_s = 0.1, rate_hz = 60.0, seed = 1}
12b_wall = {mass_kg = 0.5, damping = 5.0, delay_s = 0.1, rate_hz = 60.0}
""")

SMALL = {
    "01_structure": {"frames": 6, "row_step": 20},
    "02_workspace": {"step_deg": 26.0, "row_step": 20},
    "03_background": {"spacing": 32, "cameras": 1, "row_step": 20},
    "04_kalman": {"moving": 6, "motions": 1},
    "05_markers": {"frame_step": 29, "row_step": 20},
    "05b_centroid": {"frame_step": 29, "draws": 4},
    "06_matching": {"instants": 6, "row_step": 20},
    "07_calibration": {"positions": 4, "draws": 1, "row_step": 20},
    "07b_accuracy": {"positions": 4},
    "08_pose": {"draws": 10, "row_step": 20},
    "09_table1": {"row_step": 20, "tables": 100},
    "09b_causes": {"tables": 100},
    "10_estimators": {"row_step": 20, "turns": 2},
    "10b_trust": {"row_step": 20},
    "11_master_slave": {"share": 0.42, "row_step": 20},
    "11b_delay": {"share": 0.42},
    "12_force_feedback": {"share": 0.1, "row_step": 20},
    "12b_wall": {"share": 0.1},
}


def check_results(name, results):
    """A lesson checks the errors of the whole chain; a study need not do it again."""
    missing = ERRORS - results.keys()
    assert not missing or is_study(name)
    for name in ERRORS - missing:
        assert isinstance(results[name], float), name
        assert results[name] >= 0, name
