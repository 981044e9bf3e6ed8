"""Which statements of a notebook a sweep runs, and that they give what the whole notebook gives."""

import ast
import json
from pathlib import Path

import nbformat
import pytest
from chapterruns import OTHER_PARAMETERS, SMALL
from makenotebook import glued, make_notebook

from workbench.sweep import sweep
from workbench.sweep.notebook import read_notebook, read_parameters
from workbench.sweep.slicing import ALWAYS, explained, slice_notebook
from workbench.sweep.warmkernel import close_kernels, notebook_job, run_job

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"
START = "import numpy as np\nimport matplotlib.pyplot as plt\nfrom dataclasses import replace"


@pytest.fixture(autouse=True)
def _close():
    yield
    close_kernels()


def parts(tmp_path, *cells, swept=("a",), tags=()):
    """The code of each cell that runs once, and of each that runs each time."""
    path = make_notebook(tmp_path / "n.ipynb", START, *cells)
    notebook = read_notebook(path)
    for cell, tag in zip(notebook.cells[2:], tags, strict=False):
        cell.metadata["tags"] = [tag]
    part = slice_notebook(notebook, swept)
    once = None if part.once is None else [cell.source for cell in part.once.cells[2:]]
    return once, [cell.source for cell in part.each.cells[2:]], part


def test_what_no_result_needs_is_left_out(tmp_path):
    once, each, _ = parts(
        tmp_path,
        "x = [1, 2]\ny = [a * k for k in x]\nassert y\nprint(y)",
        "figure = plt.figure()\nplt.plot(y)",
        glued(y="sum(y)"),
    )
    assert once == ["x = [1, 2]", "", "from myst_nb import glue"]
    assert each == ["y = [a * k for k in x]", "", "glue('y', sum(y), display=False)"]


def test_part_of_a_loop_is_left_out(tmp_path):
    loop = """for k in range(3):
    low = np.percentile([a, k], 3)
    if k > 1:
        print(low)
        total = k * a
    glue(f"r{k}", k * a)"""
    _, each, _ = parts(tmp_path, "from myst_nb import glue\ntotal = 0\n" + loop)
    assert each[0] == "for k in range(3):\n    glue(f'r{k}', k * a)"


def test_a_loop_that_may_be_left_early_stays_whole(tmp_path):
    loop = "for k in range(3):\n    x = k * a\n    if x > 1:\n        break\n    n = k"
    _, each, _ = parts(tmp_path, "n = 0\n" + loop, glued(n="n"))
    assert each[0] == loop


@pytest.mark.parametrize(
    "change",
    [
        "x.append(a)",
        "x[0] = a",
        "x += [a]",
        "del x[int(a) :]",
        "y = x\ny.append(a)",
        "y = [x]\ny[0].append(a)",
        "for y in [x]:\n    y.append(a)",
        "def add(to):\n    to.append(a)\nadd(x)",
        "def add():\n    x.append(a)\nadd()",
        "list(map(lambda y: y.append(a), [x]))",
        "np.copyto(x, a)",
        "np.add(x, a, out=x)",
        "import heapq\nheapq.heappush(x, a)",
        "class Adder:\n    def go(self, to):\n        to.append(a)\nAdder().go(x)",
        "box = {}\nbox['x'] = x\nbox['x'].append(a)",
        "with open('f') as file:\n    x.append(a)",
        "if a:\n    x.append(a)",
        "while len(x) < 3:\n    x.append(a)",
        "try:\n    x.append(a)\nexcept ValueError:\n    pass",
        "(y := x).append(a)",
        "import cv2\ncv2.accumulate(np.ones(1) * a, x)",
        "def kept():\n    yield x\nfor y in kept():\n    y.append(a)",
        "def kept():\n    import math\n    return x\nkept().append(math.floor(a))",
        "y: list = x\ny.append(a)",
    ],
)
def test_a_change_of_an_object_is_kept_and_what_reads_it_later_varies(tmp_path, change):
    once, each, _ = parts(tmp_path, "x = [1.0]", change, "n = len(x)", glued(n="n"))
    assert once[0] == "x = [1.0]"
    assert each[1] != ""
    assert once[2] == ""
    assert each[2] == "n = len(x)"


@pytest.mark.parametrize("draw", ["rng.normal()", "np.clip(rng, 0, 1)", "[rng][0].normal()"])
def test_whoever_gets_a_generator_draws_from_it(tmp_path, draw):
    draws = f"def drawn():\n    return {draw}\nfigure = plt.plot(drawn())"
    once, each, _ = parts(
        tmp_path, "rng = np.random.default_rng(0)", draws, glued(x="rng.normal()")
    )
    assert (once[1] + "\n" + each[1]).splitlines() == draws.splitlines()


@pytest.mark.parametrize(
    "strange", ["exec('x = 2')", "globals()['x'] = 2", "%time", "from math import *", "np.e = 3"]
)
def test_what_cannot_be_known_is_kept_with_all_before_it(tmp_path, strange):
    once, _, part = parts(tmp_path, "y = 1", strange, glued(x="x"))
    assert once is None  # nothing is taken for the same each time
    assert part.needed.cells[2].source == "y = 1"
    assert part.needed.cells[3].source == strange


def test_draws_from_the_global_generator_keep_their_order(tmp_path):
    """What is thrown away has moved it on."""
    draws = ["np.random.seed(0)", "y = np.random.normal()", "x = a * np.random.normal()"]
    once, each, _ = parts(tmp_path, *draws, glued(x="x"))
    assert [first or then for first, then in zip(once[:3], each[:3], strict=True)] == draws


def test_a_cell_that_may_raise_is_kept(tmp_path):
    refuse = "if a > 3:\n    raise ValueError(a)"
    _, each, _ = parts(tmp_path, refuse, "y = 1", glued(x="a"))
    assert each[:2] == [refuse, ""]


def test_a_statement_of_a_kind_that_is_not_known_is_kept_with_all_before_it(tmp_path):
    match = "match a:\n    case 1:\n        x = 2"
    _, _, part = parts(tmp_path, "y = 1", match, glued(x="x"))
    assert part.needed.cells[2].source == "y = 1"
    assert part.needed.cells[3].source == match


def test_a_call_whose_value_nobody_takes_is_kept_and_ends_what_runs_once(tmp_path):
    once, each, _ = parts(
        tmp_path, "import logging", "logging.basicConfig()", "x = 1", glued(x="x")
    )
    assert (once[0], once[2]) == ("import logging", "")
    assert (each[1], each[2]) == ("logging.basicConfig()", "x = 1")


def test_a_tagged_cell_runs_each_time(tmp_path):
    once, each, _ = parts(tmp_path, "x = 1", "y = 2", glued(x="x"), tags=[None, ALWAYS])
    assert (once[:2], each[:2]) == (["x = 1", ""], ["", "y = 2"])


def test_a_name_that_is_used_again_keeps_its_order(tmp_path):
    once, each, _ = parts(
        tmp_path,
        "x = 1\nfor y in range(2):\n    v = x * a + y",
        "x = 2\nz = x",
        "for y in range(3):\n    w = y",
        glued(v="v", x="x", z="z", w="w"),
    )
    assert each[:3] == ["for y in range(2):\n    v = x * a + y", "x = 2\nz = x", ""]
    assert once[:3] == ["x = 1", "", "for y in range(3):\n    w = y"]


def test_a_function_reads_what_it_reads_when_it_is_called(tmp_path):
    once, each, _ = parts(tmp_path, "def f():\n    return g * 2", "g = a", glued(x="f()"))
    assert once[0].startswith("def f")
    assert each[1:] == ["g = a", "glue('x', f(), display=False)"]


def test_a_notebook_without_results_is_not_cut(tmp_path):
    assert (
        slice_notebook(read_notebook(make_notebook(tmp_path / "n.ipynb", "x = 1")), ["a"]) is None
    )


def test_each_cell_is_explained(tmp_path):
    _, _, part = parts(tmp_path, "x = 1\ny = a", "print(x)", glued(x="x", y="y"))
    path = tmp_path / "n.ipynb"
    lines = [line[5:] for line in explained(read_notebook(path), part).splitlines()]
    assert lines[1].startswith("left out: no result needs it ")
    assert lines[2].startswith("once, and in part each time: reads a ")
    assert lines[3].startswith("left out: no result needs it ")


PROCESS = "import os\nrng = np.random.default_rng(0)\nmany = [rng.normal() for _ in range(4)]"


def test_what_runs_once_is_the_same_in_each_run(tmp_path):
    """The second cell changes a list and draws; each run finds both as the first one did."""
    path = make_notebook(
        tmp_path / "n.ipynb",
        START,
        PROCESS,
        "many.append(a)\nlength = len(many)\ndrawn = rng.normal()",
        glued(process="os.getpid()", first="many[0]", length="length", drawn="drawn", a2="a * 2"),
    )
    found = sweep(path, a=[1.0, 2.0, 3.0], progress=False)
    assert list(found["status"]) == ["ok"] * 3
    assert found["process"].nunique() == 1
    assert list(found["length"]) == [5] * 3
    assert found["drawn"].nunique() == found["first"].nunique() == 1
    assert list(found["a2"]) == [2.0, 4.0, 6.0]
    whole = sweep(path, a=[1.0, 2.0, 3.0], progress=False, whole=True)
    assert list(whole.columns) == list(found.columns)
    same = [name for name in found if name not in ("process", "seconds")]
    assert found[same].equals(whole[same])


def test_what_cannot_be_copied_runs_each_time(tmp_path):
    path = make_notebook(
        tmp_path / "n.ipynb", "numbers = (k for k in range(9))", glued(x="next(numbers) + a")
    )
    assert list(sweep(path, a=[1.0, 2.0], progress=False)["x"]) == [1.0, 2.0]


def test_what_raises_in_the_part_that_runs_once_is_a_failed_run(tmp_path):
    path = make_notebook(tmp_path / "n.ipynb", "x = 1 / 0", glued(x="x"))
    found = sweep(path, a=[1.0, 2.0], progress=False)
    assert list(found["error"]) == ["ZeroDivisionError: division by zero (code cell 2)"] * 2


def test_a_check_is_made_in_a_whole_run_alone(tmp_path):
    path = make_notebook(tmp_path / "n.ipynb", "assert a < 2", glued(x="a"))
    assert list(sweep(path, a=[1.0, 2.0], progress=False)["status"]) == ["ok", "ok"]
    whole = sweep(path, a=[1.0, 2.0], progress=False, whole=True)
    assert list(whole["status"]) == ["ok", "failed"]


def both_ways(name, swept):
    """A chapter in its small size at other parameters: whole, and in part in a kernel that has had
    another run before.
    """
    path = NOTEBOOKS / f"{name}.ipynb"
    values = {**OTHER_PARAMETERS[name], **SMALL[name]}
    notebook = read_notebook(path)
    cell = next(c for c in notebook.cells if "parameters" in c.metadata.get("tags", []))
    defaults = {**read_parameters(path), **values}
    cell.source = "\n".join(f"{key} = {value!r}" for key, value in defaults.items())
    part = slice_notebook(notebook, [swept])
    job = notebook_job(path, None, part=part)
    whole = notebook_job(path, None)._replace(text=json.dumps(notebook), drawn=False)
    other = read_parameters(path)[swept]
    run_job(job, {swept: other})
    return run_job(whole, {swept: values[swept]}), run_job(job, {swept: values[swept]}), part


def same(whole, part):
    return json.dumps(whole.results) == json.dumps(part.results) and whole.status == part.status


QUICK = [("12_force_feedback", next(iter(OTHER_PARAMETERS["12_force_feedback"])))]
CHAPTERS = [(name, next(iter(values))) for name, values in OTHER_PARAMETERS.items()]


@pytest.mark.parametrize(("name", "swept"), QUICK)
def test_a_chapter_in_part_gives_what_it_gives_whole(name, swept):
    whole, part, _ = both_ways(name, swept)
    assert whole.status == "ok", whole.error
    assert same(whole, part)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("name", "swept"),
    [*(pair for pair in CHAPTERS if pair not in QUICK)]
    + [(name, "seed") for name, values in OTHER_PARAMETERS.items() if "seed" in values],
)
def test_every_chapter_in_part_gives_what_it_gives_whole(name, swept):
    whole, part, cut = both_ways(name, swept)
    assert whole.status == "ok", whole.error
    assert same(whole, part)
    left = [use for use in cut.cells if not use.once + use.each]
    assert left  # something is left out


@pytest.mark.parametrize(
    ("name", "swept", "costly"),
    [
        ("03_background", "update_rate", ["read_recording('hard'", "lights_of(", "at_rest("]),
        ("06_matching", "ncc_threshold", ["read_recording('hard'", "identified("]),
    ],
)
def test_the_two_sweeps_of_the_book_do_once_what_costs_most(name, swept, costly):
    part = slice_notebook(read_notebook(NOTEBOOKS / f"{name}.ipynb"), [swept])
    once, each = (statements(notebook) for notebook in (part.once, part.each))
    for call in costly:
        assert any(call in statement for statement in once)
        assert not any(call in statement for statement in each)
    assert not any("show_applet(" in statement for statement in once + each)


def statements(notebook):
    """The source of each statement of a notebook but for functions."""
    return [
        ast.unparse(statement)
        for cell in notebook.cells
        if cell.cell_type == "code"
        for statement in ast.parse(cell.source).body
        if not isinstance(statement, ast.FunctionDef)
    ]


def test_the_keys_of_a_dictionary_are_nothing_that_a_change_of_its_values_changes(tmp_path):
    once, each, _ = parts(
        tmp_path,
        "pairs = [(0, 1), (1, 2)]\nfound = {pair: [] for pair in pairs}",
        "for pair in pairs:\n    found[pair].append(a)",
        "n = len(pairs)",
        glued(n="n", found="len(found)"),
    )
    assert once[2] == "n = len(pairs)"
    assert each[1].startswith("for pair in pairs")


def test_the_source_of_a_part_is_python():
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        part = slice_notebook(notebook, list(read_parameters(path))[:1])
        assert part.once is not None, path.stem
        for cell in (*part.once.cells, *part.each.cells):
            if cell.cell_type == "code":
                ast.parse(cell.source)
