"""Sweeps by tags: the table is that of the whole notebook, or an error."""

import json
import os
import re
import sys
from pathlib import Path

import psutil
import pytest
from chapterruns import SMALL, settings
from chapters import NOTEBOOKS, is_study
from makenotebook import glued, make_notebook
from processes import ended, is_running, started, wait_until
from sweepcases import CASES, write

from workbench.browser.sweeps import SWEEPS
from workbench.sweep import agreement, sweep
from workbench.sweep.cells import names_of, plan_cells
from workbench.sweep.jobs import State, close_kernels, notebook_job, run_tagged, run_whole
from workbench.sweep.notebook import read_notebook, read_parameters
from workbench.sweep.outcome import LAST_COLUMNS

QUICK = ("append, then once", "figure draws a random number", "the same result twice")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """What is kept of comparisons is this test's own."""
    monkeypatch.setattr(agreement, "cache_folder", lambda: tmp_path / "cache")
    yield
    close_kernels()


def results(table):
    """What a table says of the notebook: all but the time and the words of an error."""
    dropped = [name for name in LAST_COLUMNS if name != "status"]
    return table.drop(columns=dropped).to_json(orient="records", double_precision=15)


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.heavy) for name in CASES],
)
def test_a_case_gives_the_whole_table_or_an_error_in_a_line(tmp_path, name):
    path = write(tmp_path / "n.ipynb", CASES[name])
    refusal = ""
    try:
        table = sweep(path, x=[1, 2], progress=False)
    except ValueError as error:
        refusal = str(error)
    if refusal:
        assert re.fullmatch(".*(code cell|as tagged).*", refusal)
        return
    whole = sweep(path, x=[1, 2], progress=False, whole=True)
    assert results(table[list(whole.columns)]) == results(whole)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("once reads the parameter", "code cell 2 is tagged once and reads x, which is swept"),
        ("function of the parameter", "code cell 2 is tagged once and reads x, which is swept"),
        ("once reads what varies", "code cell 3 is tagged once and reads a, which code cell 2"),
        (
            "figure binds what is read",
            "code cell 2 is tagged figure and binds a, which code cell 3",
        ),
        ("figure imports what is read", "code cell 3 reads math, which only a cell tagged figure"),
        ("once after, of the same name", "code cell 4 reads a of code cell 3, but as tagged that"),
        ("name read between two bindings", "code cell 3 reads a of code cell 2, but as tagged"),
        ("function of a global", None),
        ("import in every cell", None),
        ("loop variable in both", None),
        ("a cell's own magic", None),
    ],
)
def test_tags_that_names_contradict_are_refused_with_both(tmp_path, name, line):
    notebook = read_notebook(write(tmp_path / "n.ipynb", CASES[name]))
    if line is None:
        assert plan_cells(notebook, ["x"]) is not None
    else:
        with pytest.raises(ValueError, match=line):
            plan_cells(notebook, ["x"])


def test_two_tags_are_refused_and_an_unknown_one_means_nothing(tmp_path):
    notebook = read_notebook(write(tmp_path / "n.ipynb", [("o", "a = x")]))
    notebook.cells[1].metadata["tags"] = ["sweep-always"]
    assert plan_cells(notebook, ["x"]) is None
    notebook.cells[1].metadata["tags"] = ["once", "figure"]
    with pytest.raises(ValueError, match="code cell 2 is tagged figure and once"):
        plan_cells(notebook, [])


def test_a_parameter_with_one_value_may_be_read_once(tmp_path):
    cells = [("o", "a = 2 * n"), ("-", "from myst_nb import glue\nglue('y', a * x)")]
    path = write(tmp_path / "n.ipynb", cells)
    notebook = read_notebook(path)
    notebook.cells[0].source = "x = 1\nn = 1"
    path.write_text(json.dumps(notebook))
    assert sweep(path, x=[1, 2], n=5, progress=False)["y"].tolist() == [10, 20]
    with pytest.raises(ValueError, match="code cell 2 is tagged once and reads n, which is swept"):
        sweep(path, x=[1, 2], n=[5, 6], progress=False)


def test_names_of_a_cell():
    names = names_of("import a, b.c as d\nfor k in e:\n    f = k + [g for g in h]\ni += 1\nd = 0")
    assert names.reads == {"e", "h", "i"}
    assert names.binds == {"a", "d", "k", "f", "i"}
    assert names.imports == {"a"}
    inner = names_of("def f(v):\n    global w\n    w = v + u\nclass C:\n    t = s\n    r = t")
    assert inner.reads >= {"u", "s"}
    assert "t" not in inner.reads
    assert {"f", "C", "w"} <= inner.binds
    assert names_of("%%bash\necho $x") == names_of("")
    assert names_of("%%time\na = b").reads == {"b"}


def test_a_difference_names_the_number_and_the_cells(tmp_path):
    cells = [
        ("o", "a = [3, 1, 2]"),
        ("-", "from myst_nb import glue\nglue('first', a[0] * x)"),
        ("f", "a.sort()"),
        ("-", "glue('second', a[0] * x)"),
    ]
    path = write(tmp_path / "n.ipynb", cells)
    out = tmp_path / "out"
    with pytest.raises(ValueError, match=r"second is 3 as tagged, and 1 in the whole") as caught:
        sweep(path, x=[1, 2], progress=False, out=out)
    assert "between code cells 4 and 5 (tagged: 4)" in str(caught.value)
    assert not (out / "table.csv").exists()


def test_the_comparison_is_made_once_for_a_text(tmp_path, monkeypatch):
    path = write(tmp_path / "n.ipynb", CASES["sum of a list"])
    sweep(path, x=[1, 2], progress=False)
    compared = []
    monkeypatch.setattr(
        "workbench.sweep.runs.check_agreement", lambda *arguments: compared.append(arguments)
    )
    assert sweep(path, x=[3, 4], progress=False)["y"].tolist() == [18, 24]
    assert compared == []
    write(path, [("o", "a = [1, 2, 4]"), CASES["sum of a list"][1]])
    sweep(path, x=[1, 2], progress=False)
    assert len(compared) == 2
    children = psutil.Process().children(recursive=True)
    assert not [one for one in children if "workbench.sweep.forking" in one.cmdline()]


def test_the_settings_to_compare_are_the_first_and_one_that_differs_in_all():
    settings = [{"a": a, "b": b} for a in (1, 2, 3) for b in (1, 2)]
    drawn = {tuple(agreement.chosen_settings(settings, str(key))) for key in range(30)}
    assert drawn == {(0, 3), (0, 5)}
    assert agreement.chosen_settings(settings[:1], "") == [0]


def test_what_goes_wrong_in_a_fork_costs_its_row(tmp_path):
    code = "import os, time\nif x == 2: raise ValueError('too much')\nif x == 3: os._exit(1)\nif x == 4: time.sleep(60)"
    path = write(tmp_path / "n.ipynb", [("o", "a = 1"), ("-", code), CASES["sum of a list"][1]])
    path.write_text(path.read_text().replace("sum(a)", "a"))
    job = notebook_job(path, 2.0, plan=plan_cells(read_notebook(path), ["x"]), varying=["x"])
    found = [run_tagged(job, {"x": value}) for value in (1, 2, 3, 4, 5)]
    assert [one.status for one in found] == ["ok", "failed", "failed", "failed", "ok"]
    assert [one.error for one in found[1:4]] == [
        "ValueError: too much (code cell 3)",
        "DeadKernelError: Kernel died",
        "CellTimeoutError: over 2 s (code cell 3)",
    ]


def test_what_changes_nothing_is_reported(tmp_path, caplog):
    path = make_notebook(
        tmp_path / "n.ipynb", "a = 5", glued(y="seed"), parameters="a = 1\nseed = 0\nb = 1"
    )
    sweep(path, a=[1, 2], seed=[1, 2], b=[3], progress=False)
    assert [record.getMessage() for record in caplog.records] == [
        "a: code cell 2 binds it anew, so that its setting may not reach the results",
        "a: all its settings give equal results",
    ]


# the chapters


@pytest.mark.heavy
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_chapter_by_its_tags_gives_what_it_gives_whole(path):
    """In its small size, at the high end of its ranges."""
    name, high = path.stem, settings(path)["high"]
    swept = SWEEPS[name].parameter if name in SWEEPS else next(iter(high))
    notebook = read_notebook(path)
    plan = plan_cells(notebook, [swept])
    values = {**high, **SMALL[name]}
    fixed = {key: value for key, value in values.items() if key != swept}
    job = notebook_job(path, plan=plan, fixed=fixed, varying=[swept])
    assert plan.once
    assert plan.left_out or is_study(name)  # which may glue something in each cell
    tagged = run_tagged(job, {swept: values[swept]})
    whole = run_whole(job._replace(keep=True), values)
    assert whole.status == "ok", whole.error
    agreement.check_agreement(plan, tagged, whole)
    close_kernels(job.sweep)


@pytest.mark.parametrize("name", [path.stem for path in NOTEBOOKS if path.stem not in SWEEPS])
def test_the_tags_of_a_chapter_hold_for_all_its_parameters(name):
    path = next(path for path in NOTEBOOKS if path.stem == name)
    plan = plan_cells(read_notebook(path), list(read_parameters(path)))
    assert plan is not None


def test_a_sweep_that_is_killed_leaves_no_process(tmp_path):
    """The process of the state and its forks end with the one that started them."""
    code = "import os, time\nopen('begun', 'a').write(f'{os.getpid()} {os.getppid()} ')\ntime.sleep(600)"
    path = write(tmp_path / "n.ipynb", [("o", "a = 1"), ("-", code)])
    code = f"from test_tags import state_of; state_of({str(path)!r}).run('x = 1', [(3, {code!r})])"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path]),
    }
    with started("", code, env=environment) as process:
        wait_until(lambda: (tmp_path / "begun").exists(), process)
        working = [int(word) for word in (tmp_path / "begun").read_text().split()]
        process.kill()
        ended(process)
    wait_until(lambda: not any(map(is_running, working)))


def state_of(path):
    """The state of a notebook that runs by its tags, in this process."""
    notebook = read_notebook(path)
    job = notebook_job(path, plan=plan_cells(notebook, ["x"]), varying=["x"])
    state = State(job)
    state.prepare()
    return state
