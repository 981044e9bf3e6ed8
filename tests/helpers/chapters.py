"""The notebooks of the book: lessons, and the studies behind them (05b_..., 05c_...)."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))


def is_study(name):
    """Whether a notebook's name is that of a study: a letter follows the chapter's number."""
    return name[2] != "_"


LESSONS = [path for path in NOTEBOOKS if not is_study(path.stem)]
STUDIES = [path for path in NOTEBOOKS if is_study(path.stem)]
