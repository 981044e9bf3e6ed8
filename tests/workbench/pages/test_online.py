"""The files for Binder and Colab: they parse, and what they install has the versions of
``environment.txt``.
"""

import json
import re
import stat
import subprocess
import sys
import tomllib
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from workbench.pages import online

ROOT = Path(__file__).resolve().parents[3]
BINDER = ROOT / "binder"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
COLAB = nbformat.read(BINDER / "colab.ipynb", as_version=4)


def environment():
    """Each package of ``environment.txt``, read by the rules of the format."""
    text = (ROOT / "environment.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line.partition("--hash")[0].partition(" #")[0].strip() for line in text.splitlines()]
    return [Requirement(line) for line in lines if line and not line.startswith("#")]


def test_binder_has_what_a_fresh_machine_needs():
    (line,) = (BINDER / "requirements.txt").read_text().splitlines()
    assert (BINDER / line.removeprefix("-r ")).resolve() == ROOT / "environment.txt"
    python = (BINDER / "runtime.txt").read_text().strip().removeprefix("python-")
    assert f"{python}.9" in SpecifierSet(PROJECT["requires-python"])
    assert json.loads((ROOT / "codemeta.json").read_text())["runtimePlatform"] == f"Python {python}"
    packages = set((BINDER / "apt.txt").read_text().split())
    script = next(path for path in (ROOT / ".ci").iterdir() if "packages=(" in path.read_text())
    needed = set(re.search(r"packages=\((.*?)\)", script.read_text())[1].split())
    assert packages == needed - {"chromium"}, "all but the browser, which only tests need"
    script = BINDER / "postBuild"
    assert script.stat().st_mode & stat.S_IXUSR
    subprocess.run(["bash", "-n", str(script)], check=True)
    (copied,) = re.findall(r"cp -r (\S+)", script.read_text())
    assert (ROOT / copied / "package.json").is_file()


def test_colab_takes_its_versions_from_environment_txt(tmp_path):
    nbformat.validate(COLAB)
    (tmp_path / "environment.txt").symlink_to(ROOT / "environment.txt")
    (cell,) = [cell for cell in COLAB.cells if '"constraints.txt", "w"' in cell.source]
    subprocess.run([sys.executable, "-c", cell.source], cwd=tmp_path, check=True)
    written = {
        (found.name, str(found.specifier), str(found.marker))
        for found in map(Requirement, (tmp_path / "constraints.txt").read_text().splitlines())
    }
    theirs = {"ipykernel", "ipython", "tornado", "traitlets", "requests"}
    ours = {(one.name, str(one.specifier), str(one.marker)) for one in environment()}
    assert written < ours
    missing = {name for name, *_ in ours - written}
    assert theirs < missing
    assert all(name in cell.source for name in missing)


def test_colab_asks_for_packages_that_environment_txt_has():
    (line,) = [cell.source for cell in COLAB.cells if cell.source.startswith("%pip")]
    asked = [Requirement(text.strip('"')) for text in line.split()[6:]]
    assert {one.name for one in asked} <= {one.name for one in environment()}
    assert ".[slave]" in line
    assert "slave" in PROJECT["optional-dependencies"]


def test_colab_runs_a_chapter_and_shows_an_exercise_with_a_cell_to_write_in(tmp_path):
    """With a notebook of two cells in the chapter's place."""
    (tmp_path / "notebooks").mkdir()
    cells = [
        new_markdown_cell("# A chapter"),
        new_code_cell("import os\nprint(os.getcwd(), 6 * 7)"),
    ]
    nbformat.write(new_notebook(cells=cells), tmp_path / "notebooks" / "04_kalman.ipynb")
    (place,) = [cell.source for cell in COLAB.cells if "project = " in cell.source]
    chapter = re.search(r"^chapter = .*$", place, flags=re.MULTILINE)[0]
    first = new_code_cell(
        f"import os\nfrom IPython.display import Markdown, display\n"
        f"project = {str(tmp_path)!r}\n{chapter}"
    )
    (runs,) = [cell for cell in COLAB.cells if ".run_cell(cell.source)" in cell.source]
    back = new_code_cell(f"os.chdir({str(ROOT)!r})")
    run = new_notebook(cells=[first, runs.copy(), back, COLAB.cells[-1].copy()])
    replies = []
    client = NotebookClient(run, kernel_name="python3")
    client.on_cell_executed = lambda execute_reply, **_: replies.append(execute_reply)
    client.execute()
    shown = json.dumps(run.cells[1].outputs)
    assert "# A chapter" in shown
    assert f"{tmp_path / 'notebooks'} 42" in shown
    assert "variance" in json.dumps(run.cells[3].outputs)
    (written,) = replies[-1]["content"]["payload"]
    assert written["source"] == "set_next_input"
    assert written["text"].startswith("def filter_number(")
    assert written["text"].endswith('check("04.2", filter_number)')


def test_the_page_has_links_where_the_address_is_known():
    binder, colab = re.findall(r"\]\((\S+)\)", online.links("https://github.com/someone/trinolab"))
    tree = "HEAD?urlpath=lab/tree/notebooks"
    assert binder == f"https://mybinder.org/v2/gh/someone/trinolab/{tree}"
    notebook = "someone/trinolab/blob/HEAD/binder/colab.ipynb"
    assert colab == f"https://colab.research.google.com/github/{notebook}"
    (binder,) = re.findall(r"\]\((\S+)\)", online.links("https://git.example.org/a/b.git"))
    assert binder == f"https://mybinder.org/v2/git/https%3A%2F%2Fgit.example.org%2Fa%2Fb.git/{tree}"
    assert "codeRepository" in online.links(None)
