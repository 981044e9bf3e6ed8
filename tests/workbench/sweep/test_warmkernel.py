"""Kernels that stay: what they forget, and what becomes of runs that go wrong in them."""

import json
from pathlib import Path

import nbformat
import pytest
from makenotebook import glued, make_notebook
from nbformat.v4 import new_code_cell, new_notebook

from workbench.sweep.warmkernel import Kernel, Key, close_kernels, notebook_job, run_job

ROOT = Path(__file__).resolve().parents[3]

# Changes whatever a notebook may change; `local` is a module beside it.
SPOIL = """
import builtins, cv2, logging, os, random, sys, warnings
import matplotlib, matplotlib.pyplot as plt
import numpy as np, pandas as pd
import local
from trinolab import camera, matching
from IPython import get_ipython
from matplotlib_inline.config import InlineBackend
left = 1
local.value, matching.mutual = "changed", None
camera.epipolar_lines.__doc__ = "changed"
plt.figure(); plt.rcParams["lines.linewidth"] = 9; matplotlib.style.use("ggplot")
InlineBackend.instance().figure_formats = {"svg"}
np.random.seed(0); random.seed(0); cv2.setRNGSeed(5); cv2.setNumThreads(3)
np.set_printoptions(precision=2); np.seterr(all="raise"); pd.options.display.max_rows = 3
os.environ["LEFT"], os.environ["HOME"] = "1", "elsewhere"; del os.environ["OMP_NUM_THREADS"]; os.chdir("/")
sys.path.insert(0, "left"); sys.argv.append("left"); sys.setrecursionlimit(500); builtins.left_behind = 1
sys.excepthook = print
warnings.simplefilter("error"); logging.basicConfig(level=10); logging.getLogger("trinolab").setLevel(10)
get_ipython().ast_node_interactivity = "all"
get_ipython().events.register("post_run_cell", lambda *_: None)
get_ipython().display_formatter.formatters["text/plain"].for_type(int, lambda *_: "changed")
"""
# All of that as it is.
REPORT = """
import builtins, cv2, logging, os, random, sys, warnings
import json as _json
import matplotlib, matplotlib.pyplot as plt
import numpy as np, pandas as pd
state = {}
state["names"] = sorted(name for name in globals() if name[0] != "_"), In, str(Out)
import local
from trinolab import camera, matching
from IPython import get_ipython
from matplotlib_inline.config import InlineBackend
shell, drawn = get_ipython(), np.zeros(3)
cv2.randu(drawn, 0, 1)
state["modules"] = local.value, str(matching.mutual)[:16], camera.epipolar_lines.__doc__
state["figures"] = plt.get_fignums(), repr(sorted(matplotlib.rcParams.items()))
state["inline"] = str(InlineBackend.instance().figure_formats)
state["cv2"] = drawn.tolist(), cv2.getNumThreads()
state["numpy"] = str(np.get_printoptions()), np.geterr(), str(np.array([0.123456789]))
state["pandas"] = pd.options.display.max_rows
state["os"] = sorted(os.environ.items()), os.getcwd()
state["sys"] = sys.path, "left" in sys.argv, sys.getrecursionlimit(), sorted(vars(builtins)), str(sys.excepthook)[:30]
state["warnings"] = str(warnings.filters)
state["logging"] = logging.getLogger().level, len(logging.getLogger().handlers), logging.getLogger("trinolab").level
printers = {name: len(f.type_printers) for name, f in shell.display_formatter.formatters.items()}
state["ipython"] = shell.ast_node_interactivity, shell.execution_count, printers
state["callbacks"] = {name: len(functions) for name, functions in shell.events.callbacks.items()}
text = _json.dumps(state)
"""
IMPORTS = "local trinolab trinolab.camera trinolab.matching no_such_module"
DRAWS = "draws = [np.random.random(), random.random()]\nprint(_json.dumps([text, draws]))"


@pytest.fixture(autouse=True)
def _close():
    yield
    close_kernels()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "local.py").write_text("value = 'as in the file'\n")
    return str(tmp_path)


def execute(kernel, *sources):
    """Run a notebook; what its last cell printed."""
    notebook = new_notebook(cells=[*map(new_code_cell, sources)])
    kernel.run(notebook, 60)
    return notebook.cells[-1].outputs[0].text


def reported(kernel):
    state, draws = json.loads(execute(kernel, REPORT, DRAWS))
    state = json.loads(state)
    state["os"][0] = [entry for entry in state["os"][0] if entry[0] != "JPY_PARENT_PID"]
    return state, draws


def test_a_warm_kernel_is_like_a_new_one(folder, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)
    new, warm = (Kernel(Key("test", "python3", folder, IMPORTS), warm) for warm in (False, True))
    try:
        expected, _ = reported(new)
        execute(warm, SPOIL, "print(1)")
        spoilt, draws_of_seed = reported(warm)
        # the test can fail
        assert {name for name in expected if spoilt[name] != expected[name]} == set(expected)
        assert warm.reset()
        found, draws = reported(warm)
        assert found == expected
        assert not set(draws) & set(draws_of_seed)
        assert warm.reset()
        # and by chance each time, as in a new process
        assert not set(reported(warm)[1]) & set(draws)
        shown = new_notebook(
            cells=[new_code_cell("import matplotlib.pyplot as plt\nplt.plot([1, 2]);")]
        )
        warm.run(shown, 60)
        assert [sorted(output.data) for output in shown.cells[0].outputs] == [
            ["image/png", "text/plain"]
        ]
    finally:
        new.close()
        warm.close()


@pytest.mark.heavy
def test_a_chapter_gives_the_same_in_a_warm_kernel_as_in_a_new_one():
    job = notebook_job(ROOT / "notebooks" / "06_matching.ipynb", 120)
    other, again = (
        run_job(job, {"instants": 4, **setting})
        for setting in ({"ncc_threshold": 0.9}, {"seed": 1})
    )
    new = run_job(job._replace(fresh=True), {"instants": 4, "seed": 1})
    assert [outcome.status for outcome in (other, again, new)] == ["ok"] * 3
    assert len(new.results) > 4
    assert again.results == new.results != other.results


KINDS = """
import os, threading, time
if kind == "raises": raise ValueError("too much")
if kind == "exits": os._exit(1)
if kind == "sleeps": time.sleep(6000)
if kind == "threads": threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
"""


@pytest.mark.heavy
def test_what_goes_wrong_in_a_kernel(tmp_path):
    path = make_notebook(
        tmp_path / "n.ipynb", KINDS, glued(process="os.getpid()"), parameters="kind = 'fine'"
    )
    job = notebook_job(path, 600, keep=True)
    impatient = job._replace(timeout_s=2)
    kinds = ["fine", "raises", "fine", "threads", "fine", "exits", "fine", "sleeps", "fine"]
    found = [run_job(impatient if kind == "sleeps" else job, {"kind": kind}) for kind in kinds]
    assert [outcome.status for outcome in found] == [
        "failed" if kind in ("raises", "exits", "sleeps") else "ok" for kind in kinds
    ]
    assert found[1].error == "ValueError: too much (code cell 2)"
    assert found[5].error == "DeadKernelError: Kernel died"
    assert found[7].error.startswith("CellTimeoutError: ")
    first, again, threads, new, after_exit, after_sleep = (
        outcome.results["process"] for outcome in found if outcome.status == "ok"
    )
    assert first == again == threads  # a cell that raises does no harm
    assert len({first, new, after_exit, after_sleep}) == 4  # these do, and get another kernel
    executed = [nbformat.reads(outcome.notebook, as_version=4) for outcome in found]
    assert executed[1].cells[2].outputs[0].ename == "ValueError"
    assert [cell.metadata.get("tags") for cell in executed[0].cells[:2]] == [
        ["parameters"],
        ["injected-parameters"],
    ]


@pytest.mark.heavy
def test_a_kernel_uses_one_thread(tmp_path):
    code = """
import os
before = len(os.listdir("/proc/self/task"))
import cv2
import numpy as np
a = np.ones((1500, 1500)) @ np.ones((1500, 1500))
cv2.GaussianBlur(np.zeros((4000, 4000), np.uint8), (31, 31), 5)
"""
    path = make_notebook(
        tmp_path / "n.ipynb",
        code,
        glued(more="len(os.listdir('/proc/self/task')) - before", cv2="cv2.getNumThreads()"),
    )
    assert run_job(notebook_job(path, 60), {}).results == {"more": 0, "cv2": 1}


@pytest.mark.heavy
def test_fresh_kernels_are_not_used_again(tmp_path):
    path = make_notebook(tmp_path / "n.ipynb", "import os", glued(process="os.getpid()"))
    job = notebook_job(path, 60, fresh=True)
    assert run_job(job, {}).results != run_job(job, {}).results


def test_a_kernel_that_is_not_installed_is_a_failed_run(tmp_path):
    path = make_notebook(tmp_path / "n.ipynb", "1")
    path.write_text(path.read_text().replace('"name": "python3"', '"name": "no-such-kernel"'))
    outcome = run_job(notebook_job(path, 60), {})
    assert outcome.status == "failed"
    assert "no-such-kernel" in outcome.error
