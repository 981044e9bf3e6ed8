"""`notebookrun` on notebooks made for the purpose."""

import math

import nbformat
import numpy as np
import pytest
from makenotebook import glued as results_of
from makenotebook import make_notebook
from nbclient.exceptions import CellExecutionError, CellTimeoutError

from workbench.sweep.notebook import glued, read_parameters, run_notebook

PARAMETERS = "sigma_px: float = 0.5  # noise\nn = 3\nname = 'paper'\nwide = False\nlimits = [-1.0, 2]\nnothing = None"


@pytest.fixture
def make(tmp_path):
    """Write a notebook from its parameters cell (None for none) and one more; return its path."""

    def write(parameters=PARAMETERS, code="pass"):
        return make_notebook(tmp_path / "chapter.ipynb", code, parameters=parameters)

    return write


def test_read_parameters(make):
    expected = {
        "sigma_px": 0.5,
        "n": 3,
        "name": "paper",
        "wide": False,
        "limits": [-1.0, 2],
        "nothing": None,
    }
    assert read_parameters(make()) == expected


@pytest.mark.parametrize(
    "source", ["import os", "a = b = 1", "a, b = 1, 2", "a += 1", "a[0] = 1", "a = f()", "a: int"]
)
def test_other_statements_are_refused(make, source):
    with pytest.raises(
        ValueError, match=r"chapter\.ipynb: the cell tagged 'parameters' may only hold"
    ):
        read_parameters(make(source))


def test_missing_and_broken_notebooks_are_refused(make, tmp_path):
    with pytest.raises(ValueError, match=r"'parameters', got 0"):
        read_parameters(make(None))
    with pytest.raises(
        ValueError, match=r"none\.ipynb: expected a notebook, got FileNotFoundError"
    ):
        read_parameters(tmp_path / "none.ipynb")
    for text in ("{", "[]", '{"cells": 3, "nbformat": 4, "nbformat_minor": 5, "metadata": {}}'):
        (tmp_path / "broken.ipynb").write_text(text)
        with pytest.raises(ValueError, match=r"broken\.ipynb: expected a notebook"):
            run_notebook(tmp_path / "broken.ipynb")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"sigma": 1.0},
            "unknown parameter sigma; it has sigma_px, n, name, wide, limits, nothing",
        ),
        ({"sigma_px": "1"}, "sigma_px: expected float as in 0.5, got '1'"),
        ({"n": True}, "n: expected int as in 3, got True"),
        ({"sigma_px": True}, "sigma_px: expected float as in 0.5, got True"),
        ({"wide": 1}, "wide: expected bool as in False, got 1"),
        ({"sigma_px": math.nan}, "sigma_px: expected a Python literal, got nan"),
        ({"limits": [object]}, "limits: expected a Python literal"),
    ],
)
def test_wrong_parameters_are_refused_before_anything_runs(make, tmp_path, parameters, message):
    path = make(code="open('trace', 'w').close()")
    with pytest.raises(ValueError, match=r"expected|unknown") as caught:
        run_notebook(path, parameters)
    assert message in str(caught.value)
    assert not (tmp_path / "trace").exists()


def test_a_cell_that_fails_or_takes_too_long_ends_the_run(make):
    with pytest.raises(CellExecutionError, match="this went wrong"):
        run_notebook(make(code="raise RuntimeError('this went wrong')"))
    with pytest.raises(CellTimeoutError):
        run_notebook(make(code="import time; time.sleep(60)"), timeout_s=1)


def test_run(make, tmp_path):
    given = 'assert (sigma_px, n, name, nothing, limits) == (2, 4, "it\'s", 1.5, [-1.0, 2])'
    code = results_of(
        double="2 * sigma_px",
        third="1 / 3",
        numpy="np.float64(0.25)",
        truth="np.bool_(True)",
        missing="float('nan')",
        word="'two words'",
        pair="[1, 2.5]",
        object="object()",
        folder="os.getcwd()",
        threads="os.environ['OMP_NUM_THREADS']",
    )
    path = make(code=f"import os\nimport numpy as np\n{given}\n{code}")
    before = path.read_bytes()
    run = run_notebook(path, {"sigma_px": 2, "n": np.int64(4), "name": "it's", "nothing": 1.5})
    assert path.read_bytes() == before
    assert [cell.metadata.get("tags") for cell in run.notebook.cells[:2]] == [
        ["parameters"],
        ["injected-parameters"],
    ]
    results = dict(run.results)
    assert math.isnan(results.pop("missing"))
    assert results.pop("object").startswith("<object")
    assert results == {
        "double": 4,
        "third": 1 / 3,
        "numpy": 0.25,
        "truth": True,
        "word": "two words",
        "pair": [1, 2.5],
        "folder": str(tmp_path),
        "threads": "1",
    }
    assert run.seconds > 0


# --- papermill's convention, in both directions


@pytest.mark.heavy
def test_papermill_runs_our_notebooks_and_we_run_its(make, tmp_path):
    import papermill

    path = make(code=results_of(n="n", sigma="sigma_px"))
    executed = tmp_path / "executed.ipynb"
    papermill.execute_notebook(path, executed, {"n": 4}, progress_bar=False, cwd=tmp_path)
    assert glued(nbformat.read(executed, as_version=4)) == {"n": 4, "sigma": 0.5}
    again = run_notebook(executed, {"sigma_px": 2.0})  # what papermill has put in is replaced
    assert again.results == {"n": 3, "sigma": 2.0}
    tags = [cell.metadata.get("tags", []) for cell in again.notebook.cells]
    assert sum("injected-parameters" in tag for tag in tags) == 1


def test_a_letter_of_the_paper_is_answered_by_the_name_that_is_meant(make):
    path = make(parameters="update_rate = 0.1\nn = 1")
    with pytest.raises(
        ValueError, match=r"unknown parameter alpha; alpha is update_rate, it has update_rate, n$"
    ):
        run_notebook(path, {"alpha": 0.2})
    with pytest.raises(ValueError, match=r"unknown parameter lambda; it has update_rate, n$"):
        run_notebook(path, {"lambda": 2})
