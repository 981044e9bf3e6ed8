"""The written exam, in as many versions as are wanted: ``python -m workbench.course.exam --seed 3``.

The problems are those of ``exam.md.j2``; a version has other numbers, drawn from lists in which each
comes out well by a calculator. The seeds 0 and 1 are the versions A and B of the book's pages.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from trinolab.files.outputs import write_whole

# A problem's numbers: one row is a version of it.
POINTS = [(30, -20, 600, 120), (45, 15, 750, 150), (-40, 25, 500, 100), (60, -30, 800, 160)]
CONES = [
    (15, (40, 30, 200), 400),
    (12, (40, 30, 250), 500),
    (18, (40, 30, 160), 300),
    (20, (48, 36, 170), 350),
]
BACKGROUNDS = [(50, 110, 20, 0.05, 2), (40, 100, 15, 0.04, 3), (60, 130, 20, 0.08, 2)]
FILTERS = [(10, 9, 16, 3, 0.75, 13), (20, 8, 25, 2, 0.4, 22), (5, 6, 9, 2, 0.5, 7)]
ROWS = [(20, 220, 20, 140, 20, 100, 20), (30, 230, 30, 150, 30, 110, 30)]
RODS = [(1.0, 4, 30, 4), (1.2, 5, 35, 5), (1.5, 6, 25, 4)]
LINES = [((3, 4, 250), (30, 45)), ((5, 12, 600), (36, 40)), ((8, 6, 500), (40, 25))]
WINDOWS = [((1, 2, 3, 6), (2, 2, 4, 8)), ((2, 4, 3, 7), (1, 4, 3, 8)), ((5, 1, 2, 4), (9, 2, 1, 4))]
POSES = [(90, (5, 5, 5)), (-90, (10, 4, -5)), (90, (-5, 8, 2))]
OFFSETS = [((2, 1, 2), (0, 3, 4)), ((2, 3, 6), (4, 0, 3)), ((1, 4, 8), (3, 4, 0))]
ANGLES = [(179.5, -179.0), (179.0, -178.2), (-179.4, 179.8)]
HANDS = [(20, 10, 5, 3), (10, 15, 20, 2), (30, 10, 15, 4)]
WALLS = [(3, 40, 300, 600), (2, 50, 400, 400), (4, 60, 200, 800)]
BOARDS = [(15, 600, 50, 6), (12, 500, 36, 5), (20, 800, 45, 4)]
DESIGNS = [(0.1, 800, 1600, 0.05), (0.2, 1000, 2000, 0.1), (0.05, 500, 2500, 0.04)]
HANDLE = ((0, 0, 0), (10, 0, 0), (0, 20, 0), (0, 0, 5))
FOCAL = 2000  # px, of the first problem


def draw(seed: int) -> dict[str, Any]:
    """The numbers of a version: seeds 0 and 1 take the first and the second row of each list, so that they
    differ in each problem; another one draws rows.
    """
    rng = np.random.default_rng(seed)

    def row(rows: Sequence[Any]) -> Any:
        drawn = int(rng.integers(len(rows)))
        return rows[seed if seed < 2 else drawn]

    x, y, z, baseline = row(POINTS)
    half_angle, point, apart = row(CONES)
    bench, rod, threshold, alpha, noise = row(BACKGROUNDS)
    guess, variance, first, R, Q, second = row(FILTERS)
    marker_mm, rod_mm, slant, px_a_mm = row(RODS)
    line, spot = row(LINES)
    window_1, window_2 = row(WINDOWS)
    turn, shift = row(POSES)
    off_1, off_2 = row(OFFSETS)
    gamma_set, gamma_seen = row(ANGLES)
    *hand, scale = row(HANDS)
    damping, age_ms, spring, wall = row(WALLS)
    square, distance, square_px, ruler = row(BOARDS)
    wish_mm, reach_mm, design_f, centroid_px = row(DESIGNS)
    moved_camera = row((3, 1, 2))
    before = np.round(rng.uniform(0.1, 0.2, 3), 2).tolist()
    after = np.round(rng.uniform(2.0, 4.0, 3), 1).tolist()
    distances = [
        (pair, was, off if moved_camera in pair else was)
        for pair, was, off in zip(((1, 2), (1, 3), (2, 3)), before, after, strict=True)
    ]
    return {
        "f": FOCAL,
        "x": x,
        "y": y,
        "z": z,
        "baseline": baseline,
        "half_angle": half_angle,
        "point": point,
        "apart": apart,
        "bench": bench,
        "rod": rod,
        "threshold": threshold,
        "alpha": alpha,
        "noise": noise,
        "guess": guess,
        "variance": variance,
        "first": first,
        "R": R,
        "Q": Q,
        "second": second,
        "row": row(ROWS),
        "marker_mm": marker_mm,
        "rod_mm": rod_mm,
        "slant": slant,
        "px_a_mm": px_a_mm,
        "line": line,
        "spot": spot,
        "window_1": window_1,
        "window_2": window_2,
        "turn": turn,
        "shift": shift,
        "off_1": off_1,
        "off_2": off_2,
        "gamma_set": gamma_set,
        "gamma_seen": gamma_seen,
        "hand": hand,
        "scale": scale,
        "damping": damping,
        "age_ms": age_ms,
        "spring": spring,
        "wall": wall,
        "square": square,
        "distance": distance,
        "square_px": square_px,
        "ruler": ruler,
        "wish_mm": wish_mm,
        "reach_mm": reach_mm,
        "design_f": design_f,
        "centroid_px": centroid_px,
        "distances": distances,
        "moved_camera": moved_camera,
    }


def answers(drawn: dict[str, Any]) -> dict[str, Any]:
    """The results of a version, each by the formula that a student would use."""
    given = SimpleNamespace(**drawn)
    return {
        **_views(given),
        **_rates(given),
        **_filter(given),
        **_marks(given),
        **_pose(given),
        **_tool(given),
    }


def _views(given: SimpleNamespace) -> dict[str, Any]:
    """Problems 1, 2, 9 and 10."""
    length = float(np.linalg.norm(given.point))
    half_angle = np.radians(given.half_angle)
    depth_a_pixel = given.z**2 / (given.f * given.baseline)
    focal = given.square_px * given.distance / given.square
    disparity_px = np.sqrt(2) * given.centroid_px
    return {
        "u_left": 640 + given.f * given.x / given.z,
        "u_right": 640 + given.f * (given.x - given.baseline) / given.z,
        "v": 512 + given.f * given.y / given.z,
        "disparity": given.f * given.baseline / given.z,
        "depth_a_pixel": depth_a_pixel,
        "across_a_pixel": given.z / given.f,
        "length": length,
        "bound": length * np.cos(half_angle),
        "angle": np.degrees(np.arccos(given.point[2] / length)),
        "litres": np.pi * given.apart**3 * np.tan(half_angle) ** 2 / 12 / 1e6,
        "focal": focal,
        "focal_off": focal * given.ruler / given.distance,
        "design_baseline": given.reach_mm**2 * disparity_px / (given.design_f * given.wish_mm),
    }


def _rates(given: SimpleNamespace) -> dict[str, Any]:
    """Problem 3."""
    lamp_jump = given.bench / 2

    def exact(jump: float, alpha: float) -> float:
        return float(np.log(given.threshold / jump) / np.log(1 - alpha))

    rod_exact = exact(given.rod - given.bench, given.alpha)
    lamp_exact = exact(lamp_jump, given.alpha)
    return {
        "rod_exact": rod_exact,
        "rod_frames": int(np.ceil(rod_exact)),
        "lamp_jump": lamp_jump,
        "lamp_exact": lamp_exact,
        "lamp_frames": int(np.ceil(lamp_exact)),
        "quick_frames": int(np.ceil(exact(given.rod - given.bench, 0.5))),
        "noise_left": given.noise * np.sqrt(given.alpha / (2 - given.alpha)),
    }


def _filter(given: SimpleNamespace) -> dict[str, Any]:
    """Problem 4."""
    gain_1 = given.variance / (given.variance + given.R)
    mean_1 = given.guess + gain_1 * (given.first - given.guess)
    variance_1 = (1 - gain_1) * given.variance
    grown = variance_1 + given.Q
    gain_2 = grown / (grown + given.R)
    return {
        "gain_1": gain_1,
        "mean_1": mean_1,
        "variance_1": variance_1,
        "gain_2": gain_2,
        "mean_2": mean_1 + gain_2 * (given.second - mean_1),
        "variance_2": (1 - gain_2) * grown,
        "nis": (given.first - given.guess) ** 2 / (given.variance + given.R),
    }


def _marks(given: SimpleNamespace) -> dict[str, Any]:
    """Problems 5 and 6."""
    first = (given.row[0] + given.row[1]) / 2
    line_length = float(np.hypot(*given.line[:2]))
    value = given.line[0] * given.spot[0] + given.line[1] * given.spot[1] - given.line[2]
    first_window, second_window = np.array(given.window_1), np.array(given.window_2)
    return {
        "tried": (first, (given.row[0] + first) / 2),
        "bias_mm": 3 / 8 * given.marker_mm**2 * np.sin(np.radians(given.slant)) / given.rod_mm,
        "line_length": line_length,
        "off_line": abs(value) / line_length,
        "ncc": np.corrcoef(first_window, second_window)[0, 1],
        "cosine": first_window
        @ second_window
        / np.sqrt((first_window**2).sum() * (second_window**2).sum()),
    }


def _pose(given: SimpleNamespace) -> dict[str, Any]:
    """Problem 7."""
    sine = int(np.sign(given.turn))
    rotation = np.array([[0, -sine, 0], [sine, 0, 0], [0, 0, 1]])
    length_1, length_2 = np.linalg.norm(given.off_1), np.linalg.norm(given.off_2)
    together = np.add(given.off_1, given.off_2)
    return {
        "handle": HANDLE,
        "seen": [(rotation @ place + given.shift).tolist() for place in HANDLE],
        "length_1": length_1,
        "length_2": length_2,
        "E_t": (length_1 + length_2) / 2,
        "wrong_E_t": np.linalg.norm(together) / 2,
        "gamma_error": 360 - abs(given.gamma_set - given.gamma_seen),
    }


def _tool(given: SimpleNamespace) -> dict[str, Any]:
    """Problem 8."""
    left, down, nearer = given.hand
    lag_ms = given.age_ms + 1000 / 30 / 2
    quick_lag_ms = given.age_ms + 1000 / 300 / 2
    return {
        "moved": (-given.scale * left, -given.scale * nearer, -given.scale * down),
        "lag_ms": lag_ms,
        "stiffness": 1000 * given.damping / lag_ms,
        "felt": 1 / (1 / given.spring + 1 / given.wall),
        "quick_lag_ms": quick_lag_ms,
        "quick_stiffness": 1000 * given.damping / quick_lag_ms,
    }


def exam(seed: int, solutions: bool) -> str:
    """A version of the exam as MyST Markdown, with its solutions or without."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["number"] = number
    drawn = draw(seed)
    template = environment.get_template("exam.md.j2")
    return template.render(**drawn, **answers(drawn), solutions=solutions) + "\n"


def number(value: float, digits: int = 2) -> str:
    """A number as one writes it by hand: no zeros behind."""
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def main(argv: Sequence[str] | None = None) -> int:
    """Print or write a version, and return the exit code: 2 for a mistake in the input."""
    parser = argparse.ArgumentParser(
        prog="python -m workbench.course.exam", description="A version of the written exam."
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the version: 0 is A, 1 is B (%(default)s)"
    )
    parser.add_argument("--solutions", action="store_true", help="with them, for the teacher")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="(standard output)")
    arguments = parser.parse_args(argv)
    if arguments.seed < 0:
        parser.error("--seed: expected a whole number from 0 on")
    text = exam(arguments.seed, arguments.solutions)
    if arguments.out is None:
        print(text, end="")
        return 0
    try:
        write_whole(arguments.out, text)
    except ValueError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
