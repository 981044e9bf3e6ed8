"""Every chapter runs as it stands and with other parameters, and glues what a sweep asks for.

`make book` runs the chapters as they stand: what it has stored is looked at here, or they run here
if that is stale. At the ends of their parameters' ranges two lessons run in a small size; `make
verify` runs all, the studies as well, and repeats that in full. No sentence may contradict what a
run has glued.
"""

import json
from functools import cache

import nbformat
import pytest
from chapterruns import SMALL, TYPED, check_results, false_sentences, settings, typed_words
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


@each_notebook
def test_every_chapter_has_its_settings(path):
    assert path.stem in SMALL, "what makes it small"
    low, high = settings(path).values()
    defaults = read_parameters(path)
    assert low, "no parameter has a range behind it, as in 'alpha, 0.002 to 0.2'"
    assert all(defaults[name] != high[name] or low[name] != high[name] for name in low)


@each_notebook
def test_a_typed_comparative_beside_a_number_is_reviewed(path):
    reviewed = {what for what in TYPED[path.stem] if " " in what}
    assert typed_words(read_notebook(path)) == reviewed, "glue the word, or say when it is true"


@each_notebook
def test_runs_at_its_defaults(path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)  # figures are shown, as in a build
    run = as_it_stands(path)
    check_results(path.stem, run.results)
    assert without_figure(run) == []
    assert false_sentences(path.stem, run.notebook, read_parameters(path), run.results) == []


@cache
def two_lessons():
    """First what has changed since the pages were built, then others, by the hash of all that they are
    made from.
    """

    def order(path):
        made_from = made_from_notebook(read_notebook(path), path.parent)
        return build.executed(path) is not None, hash_text(str(made_from))

    return sorted(LESSONS, key=order)[:2]


def check_at(end, path):
    parameters = settings(path)[end] | SMALL[path.stem]
    notebook = read_notebook(path)
    notebook.cells.insert(0, new_code_cell(UNDRAWN))
    job = notebook_job(path, keep=True)._replace(text=json.dumps(notebook))
    outcome = run_whole(job, parameters)
    assert outcome.status != FAILED, outcome.error
    results = glued(nbformat.reads(outcome.notebook, as_version=4))
    check_results(path.stem, results)
    parameters = read_parameters(path) | parameters
    assert false_sentences(path.stem, notebook, parameters, results) == []


@pytest.mark.parametrize(("number", "end"), [(0, "low"), (1, "high")])
def test_two_lessons_run_at_an_end_of_their_ranges(number, end):
    check_at(end, two_lessons()[number])


@pytest.mark.heavy
@pytest.mark.parametrize("end", ["low", "high"])
@each_notebook
def test_runs_at_both_ends_of_its_ranges(path, end):
    check_at(end, path)


@each_notebook
def test_refuses_an_unknown_parameter(path):
    with pytest.raises(ValueError, match="unknown parameter no_such_parameter; it has "):
        run_notebook(path, {"no_such_parameter": 1})
