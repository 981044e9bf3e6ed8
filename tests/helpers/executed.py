"""Chapters and scoreboard as `make book` has stored them, if they are not stale; else computed
here.
"""

import pandas as pd

from workbench.pages import build
from workbench.provenance import made_from_module
from workbench.studies.scoreboard import scoreboard
from workbench.sweep.notebook import NotebookRun, glued, read_notebook, run_notebook


def as_it_stands(path):
    """A chapter's run at its defaults."""
    copy = build.executed(path)
    if copy is None:
        return run_notebook(path)
    notebook = read_notebook(copy)
    return NotebookRun(notebook, glued(notebook), 0.0)


def whole_scoreboard():
    """The scoreboard with all its verdicts."""
    if build.is_finished("scoreboard", made_from_module("workbench.studies.scoreboard")):
        return pd.read_csv(
            build.SCOREBOARD, dtype={"no": str}, keep_default_na=False, na_values={"ours": [""]}
        )
    return scoreboard()
