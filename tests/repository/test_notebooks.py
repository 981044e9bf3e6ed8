"""Every chapter runs as it stands and with other parameters, and glues what a sweep asks for.

`make book` runs the chapters as they stand: what it has stored is looked at here, or they run here
if that is stale. With other parameters two lessons run in a small size; `make verify` runs all, the
studies as well, and repeats that in full.
"""

import json
from functools import cache

import nbformat
import pytest
from chapterruns import OTHER_PARAMETERS, SMALL, check_results
from chapters import LESSONS, NOTEBOOKS
from executed import as_it_stands
from nbformat.v4 import new_code_cell

from workbench.pages import build
from workbench.provenance import hash_text, made_from_notebook
from workbench.sweep.jobs import notebook_job, run_whole
from workbench.sweep.notebook import glued, read_notebook, read_parameters, run_notebook
from workbench.sweep.outcome import FAILED

GLUED = {"application/papermill.record/text/plain"}  # what a glued number is stored as
# figures are made, and not drawn: that takes a quarter of the time
UNDRAWN = "%config InlineBackend.figure_formats = set()"

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def without_figure(run):
    """The cells that have a caption and show nothing under it."""
    return [
        cell.id
        for cell in run.notebook.cells
        if "figure" in cell.metadata.get("mystnb", {})
        and not any("data" in output and not set(output.data) <= GLUED for output in cell.outputs)
    ]


@pytest.mark.parametrize("entries", [OTHER_PARAMETERS, SMALL], ids=["OTHER_PARAMETERS", "SMALL"])
def test_every_chapter_has_an_entry(entries):
    missing = {path.stem for path in NOTEBOOKS} - set(entries)
    assert not missing, "a chapter needs an entry in OTHER_PARAMETERS and in SMALL, see above"


@each_notebook
def test_runs_at_its_defaults(path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)  # figures are shown, as in a build
    run = as_it_stands(path)
    check_results(path.stem, run.results)
    assert without_figure(run) == []


@cache
def two_lessons():
    """First what has changed since the pages were built, then others, by the hash of all that they are
    made from.
    """

    def order(path):
        made_from = made_from_notebook(read_notebook(path), path.parent)
        return build.executed(path) is not None, hash_text(str(made_from))

    return sorted(LESSONS, key=order)[:2]


def check_other_parameters(path):
    other, small = (entries.get(path.stem, {}) for entries in (OTHER_PARAMETERS, SMALL))
    defaults = read_parameters(path)
    assert any(value != defaults.get(name) for name, value in other.items()), (
        "no parameter differs from its default"
    )
    notebook = read_notebook(path)
    notebook.cells.insert(0, new_code_cell(UNDRAWN))
    job = notebook_job(path, keep=True)._replace(text=json.dumps(notebook))
    outcome = run_whole(job, {**other, **small})
    assert outcome.status != FAILED, outcome.error
    check_results(path.stem, glued(nbformat.reads(outcome.notebook, as_version=4)))


@pytest.mark.parametrize("number", [0, 1])
def test_two_lessons_run_at_other_parameters(number):
    check_other_parameters(two_lessons()[number])


@pytest.mark.heavy
@each_notebook
def test_runs_at_other_parameters(path):
    check_other_parameters(path)


@each_notebook
def test_refuses_an_unknown_parameter(path):
    with pytest.raises(ValueError, match="unknown parameter no_such_parameter; it has "):
        run_notebook(path, {"no_such_parameter": 1})
