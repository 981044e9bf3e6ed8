"""Numbers and figures of the article, the replication in ten pages, and its metadata for the journal.

The text is ``article.md.j2``. `make article` prints the built page.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1
from trinolab.files.inputs import read_toml
from trinolab.files.outputs import write_whole
from trinolab.methods import BEST

from ..plotting.basics import write_drawing
from ..plotting.structure import plot_rig
from ..plotting.table1 import plot_budget, plot_errors_in_space, plot_refused
from ..studies import accounts, claim_draws, deviations, isotropy, lever, pattern
from ..studies import answer as cause
from ..studies.protocol import load_deviations
from .template import render

ROOT = Path(__file__).resolve().parents[3]
TEMPLATE = "article.md.j2"
RIG, HANDLE, ROW = "raised_40deg", "paper", 5  # of the picture of the rig; a row of Table 1
AXIS_MM = 60.0  # how long the handle's axes are drawn
SHORT = "of the set angles", "of angles"  # in the names of models
MAGNIFIED = 50.0
TABLES = 4000  # drawn, for a probability
SEED = 0
# What the text says in words of single rows.
NEEDED = {
    **dict.fromkeys(("1", "3", "4"), "match"),
    **dict.fromkeys(("2", "9", "10"), "differs"),
    **dict.fromkeys(("5", "6", "7", "8", "18"), "undecided"),
    "8i": "undecided",
    "11b": "missed",
}
BUDGET = {
    "certainly there": (
        "pixel noise",
        "centroid bias",
        "calibration",
        "platform",
        "printed digits",
    ),
    "drawn at once": ("certain: drawn together",),
    "if the program is as printed": ("R_rl as printed", "one focal length"),
    "Table 1": ("Table 1",),
}
STATISTICS = {
    "growth_alpha": "growth\n" + r"of $\alpha$",
    "growth_gamma": "growth\n" + r"of $\gamma$",
    "offset_alpha": "offset\n" + r"of $\alpha$",
    "offset_beta": "offset\n" + r"of $\beta$",
    "offset_gamma": "offset\n" + r"of $\gamma$",
    "depth": "z by\nx, y",
    "smooth": "smooth\nshare",
}


def write_parts(numbers: dict[str, Any], folder: Path) -> None:
    """Write the figures and the metadata into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    text = render('{% include "article.md.j2" %}', numbers)
    write_whole(folder / "metadata.yaml", metadata(text))
    for name, draw in FIGURES.items():
        write_drawing(draw(), folder / f"{name}.svg")


def metadata(text: str) -> str:
    """The journal's metadata, ``book/metadata.yaml``, with the abstract of the text."""
    fields = yaml.safe_load((ROOT / "book" / "metadata.yaml").read_text(encoding="utf-8"))
    section = text.split("## Abstract")[1].split("\n## ")[0]
    plain = re.sub(r"\{cite:p\}`[^`]*` |[*]", "", section)
    abstract = " ".join(plain.split())
    return yaml.safe_dump({**fields, "abstract": abstract}, sort_keys=False, allow_unicode=True)


def checked(board: pd.DataFrame) -> pd.DataFrame:
    """The board, if its verdicts are those that the text speaks of.

    Raises
    ------
    ValueError
        Names the claim that has another verdict.
    """
    verdicts = dict(zip(board["no"], board["verdict"], strict=True))
    for no, verdict in NEEDED.items():
        if verdicts.get(no) != verdict:
            raise ValueError(
                f"article: claim {no}: the text says {verdict!r}, the board {verdicts.get(no)!r}; "
                f"write book/workbench/pages/{TEMPLATE} anew"
            )
    return board


def values(facts: cause.Facts) -> dict[str, Any]:
    """Numbers that the article alone quotes."""
    return {**_of_the_protocol(), **_of_table1(facts), **_of_the_lever(), **_of_the_damaged()}


def _of_the_damaged() -> dict[str, Any]:
    """Instants with a fault, measured poses, and the faults of the wrong ones (claim 11b)."""
    table = load_sweep("stress")
    some = table[(table["estimator"] == BEST) & (table["fault"] != "none")]
    return {
        "damaged_instants": f"{some['n'].sum():,}",
        "damaged_measured": f"{some['measured'].sum():,}",
        "damaged_faults": _listed(some["fault"][some["wrong"] > 0].drop_duplicates().to_list()),
    }


def _of_the_protocol() -> dict[str, Any]:
    log = load_deviations()
    frozen = str(read_toml(ROOT / "data" / "deviations.toml")["frozen"]["date"])
    equations = read_toml(ROOT / "data" / "equations.toml")["equation"]
    assumptions = (ROOT / "book" / "assumptions.md").read_text(encoding="utf-8")
    return {
        "frozen": frozen,
        "last_change": max(entry.date for entry in log),
        "equations": len(equations),
        "assumptions": len(set(re.findall(r"\{#a(\d+)\}", assumptions))),
        "board_positions": claim_draws.POSITIONS,
        "marker_mm": f"{load_handle(HANDLE).marker_diameter_mm:g}",
        "elevation": f"{RIG.split('_')[1].removesuffix('deg')}°",
    }


def _of_table1(facts: cause.Facts) -> dict[str, Any]:
    table = load_table1()
    angles = deviations.exact([table.measured], table.set_poses).angles_deg[0]
    budget = _budget()
    registered = load_sweep("budget").set_index(["registration", "source"])["E_t_mm"]
    patterns = load_sweep("patterns")
    of_points = isotropy.of_points(load_rig("paper_pair"), table.set_poses.translation)
    per_px = np.sqrt(of_points.mean(axis=0).diagonal())
    return {
        "poses": len(table.set_poses),
        "assumed_share": f"{100 * facts.assumed_share:.0f} %",
        "scatter_mm": _listed([f"{value:.2f}" for value in facts.scatter_mm]),
        "isotropic_p": f"{facts.isotropic_p:.2f}",
        "per_px": _listed([f"{value:.2f}" for value in per_px]),
        "refused": _listed([f"{bound.refused:.0f}" for bound in facts.by_images]),
        "at_most": _listed([f"{100 * bound.at_most:.0f} %" for bound in facts.by_images]),
        "assumed_mm": f"{budget.loc['certain', 'mm']:.2g}",
        "table_mm": f"{budget.loc['Table 1', 'mm']:.2g}",
        "table_mean_mm": f"{registered['20 poses', 'Table 1']:.2g}",
        "smooth_p": f"{facts.smooth_p:.2f}",
        "chance_tables": f"{TABLES:,}",
        "magnified": f"{MAGNIFIED:g}",
        "offsets": _listed([f"{value:+.2f}°" for value in angles.mean(axis=0)]),
        "scatters": _listed([f"{value:.2f}°" for value in angles.std(axis=0, ddof=1)]),
        "constant_share": f"{100 * facts.constant_share:.0f} %",
        "models": facts.models,
        "by_cameras": len(facts.by_cameras),
        "cameras_p": f"{max(facts.by_cameras.values()):.2g}",
        "tests": int((~patterns["fitted"]).sum()),
        "level": cause.LEVEL,
        "left": _listed([f"*{name}*" for name in facts.left]).replace(*SHORT) or "none",
    }


def _of_the_lever() -> dict[str, Any]:
    """What a clamp at the rod's nearest end would do, and whether the table has a lever."""
    table = load_table1()
    truths, measured = table.set_poses, table.measured
    errors = deviations.exact([measured], truths)
    turns = (measured.rotation * truths.rotation.inv()).as_rotvec(degrees=True)
    swing = lever.lever_field(turns, truths.rotation)
    field = pattern.rigid_field(truths.translation)
    n = 3 * len(truths)
    parts = {"registration": field.reshape(n, -1), "lever": swing.reshape(n, -1)}
    off_mm = (measured.translation - truths.translation).reshape(n)
    rod = load_handle(HANDLE)
    end_mm = min(abs(rod.top_mm), abs(rod.bottom_mm))
    scatter_mm = accounts.clamping(errors, truths).place_mm.value
    power = lever.power(
        swing,
        field,
        [0.0, end_mm, 0.0],
        scatter_mm,
        cause.LEVEL,
        TABLES,
        np.random.default_rng(SEED),
    )
    fitted = lever.part_tests(parts, off_mm)["lever"]
    if np.any(np.abs(fitted.values) > fitted.sigmas):
        raise ValueError(f"article: the text says that the lever is zero, it is {fitted.values}")
    return {
        "lever_p": f"{fitted.p:.3f}",
        "lever_sigma_mm": f"{np.ceil(fitted.sigmas.max()):.0f}",
        "end_mm": f"{end_mm:g}",
        "end_moved_mm": f"{np.linalg.norm(end_mm * swing[:, :, 1], axis=1).mean():.2f}",
        "end_power": f"{100 * power:.0f} %",
    }


def _listed(texts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))


def _draw_rig() -> Any:
    rig, rod = load_rig(RIG), load_handle(HANDLE)
    pose = load_table1().set_poses[ROW - 1]
    views = {}
    for camera in rig.cameras:
        width, height = camera.size
        corners = camera.rays([[0, 0], [width, 0], [width, height], [0, height]])
        views[camera.name] = (camera.centre, camera.centre + corners)
    ends = pose.apply([[0, rod.bottom_mm, 0], [0, rod.top_mm, 0]])
    axes = pose.apply(np.vstack([np.zeros(3), AXIS_MM * np.eye(3)]))
    return plot_rig(views, ends, pose.apply(rod.marker_centres), axes)


def _draw_space() -> Any:
    table = load_table1()
    positions = table.set_poses.translation
    errors = table.measured.translation - positions
    return plot_errors_in_space(positions, errors, MAGNIFIED)


def _budget() -> pd.DataFrame:
    """The lines of the budget that the figure shows, rms in mm and deg, by source."""
    stored = load_sweep("budget")
    lines = stored[stored["registration"] == "20 poses"].set_index("source")
    rows = [
        (name.split(":")[0], group, lines.rms_E_t_mm[name], lines.rms_geodesic_deg[name])
        for group, names in BUDGET.items()
        for name in names
    ]
    return pd.DataFrame(rows, columns=["source", "group", "mm", "deg"]).set_index("source")


def _draw_budget() -> Any:
    axes = {"mm": "rms position / mm", "deg": "rms rotation / deg"}
    return plot_budget(_budget(), axes)


def _draw_refused() -> Any:
    table = load_sweep("patterns")
    short = table["model"].str.replace(*SHORT)
    short = short.str.replace("reference turned + handle set askew", "misalignments", regex=False)
    return plot_refused(table.assign(model=short), STATISTICS, cause.LEVEL).figure


FIGURES: dict[str, Callable[[], Any]] = {
    "rig": _draw_rig,
    "budget": _draw_budget,
    "space": _draw_space,
    "refused": _draw_refused,
}
