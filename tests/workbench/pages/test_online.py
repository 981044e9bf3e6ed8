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
import pytest
from nbclient import NotebookClient
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


def test_binder_installs_environment_txt_itself():
    (line,) = (BINDER / "requirements.txt").read_text().splitlines()
    assert (BINDER / line.removeprefix("-r ")).resolve() == ROOT / "environment.txt"


def test_binder_has_a_python_for_which_the_environment_was_resolved():
    python = (BINDER / "runtime.txt").read_text().strip().removeprefix("python-")
    assert f"{python}.9" in SpecifierSet(PROJECT["requires-python"])
    assert json.loads((ROOT / "codemeta.json").read_text())["runtimePlatform"] == f"Python {python}"


def test_binder_has_the_systems_packages_that_a_fresh_machine_needs():
    packages = set((BINDER / "apt.txt").read_text().split())
    script = next(path for path in (ROOT / ".ci").iterdir() if "packages=(" in path.read_text())
    needed = set(re.search(r"packages=\((.*?)\)", script.read_text())[1].split())
    assert packages == needed - {"chromium"}, "all but the browser, which only tests need"


def test_binder_installs_the_package_as_make_does():
    script = BINDER / "postBuild"
    assert script.stat().st_mode & stat.S_IXUSR
    assert script.read_text().startswith("#!/usr/bin/env bash\n")
    subprocess.run(["bash", "-n", str(script)], check=True)
    assert "pip install --no-deps --no-build-isolation -e ." in script.read_text()
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


def test_colab_runs_a_chapter(tmp_path):
    """With a notebook of two cells in the chapter's place."""
    (tmp_path / "notebooks").mkdir()
    cells = [
        nbformat.v4.new_markdown_cell("# A chapter"),
        nbformat.v4.new_code_cell("import os\nprint(os.path.basename(os.getcwd()), 6 * 7)"),
    ]
    nbformat.write(
        nbformat.v4.new_notebook(cells=cells), tmp_path / "notebooks" / "04_kalman.ipynb"
    )
    (place,) = [cell.source for cell in COLAB.cells if "project = " in cell.source]
    chapter = re.search(r"^chapter = .*$", place, flags=re.MULTILINE)[0]
    first = nbformat.v4.new_code_cell(f"import os\nproject = {str(tmp_path)!r}\n{chapter}")
    (runs,) = [cell for cell in COLAB.cells if ".run_cell(cell.source)" in cell.source]
    run = nbformat.v4.new_notebook(cells=[first, runs.copy()])
    NotebookClient(run, kernel_name="python3").execute()
    shown = json.dumps(run.cells[1].outputs)
    assert "# A chapter" in shown
    assert "notebooks 42" in shown


def test_colab_shows_an_exercise_and_a_cell_to_write_in():
    first = nbformat.v4.new_code_cell("from IPython.display import Markdown, display")
    run = nbformat.v4.new_notebook(cells=[first, COLAB.cells[-1].copy()])
    replies = []
    client = NotebookClient(run, kernel_name="python3", resources={"metadata": {"path": ROOT}})
    client.on_cell_executed = lambda execute_reply, **_: replies.append(execute_reply)
    client.execute()
    assert "variance" in json.dumps(run.cells[1].outputs)
    (written,) = replies[-1]["content"]["payload"]
    assert written["source"] == "set_next_input"
    assert written["text"].startswith("def filter_number(")
    assert written["text"].endswith('check("04.2", filter_number)')


@pytest.mark.parametrize(
    ("address", "links"),
    [
        (
            "https://github.com/someone/trinolab",
            [
                "https://mybinder.org/v2/gh/someone/trinolab/HEAD?urlpath=lab/tree/notebooks",
                "https://colab.research.google.com/github/someone/trinolab/blob/HEAD/binder/colab.ipynb",
            ],
        ),
        (
            "https://git.example.org/a/b.git",
            [
                "https://mybinder.org/v2/git/https%3A%2F%2Fgit.example.org%2Fa%2Fb.git/HEAD?urlpath=lab/tree/notebooks"
            ],
        ),
        (None, []),
    ],
)
def test_the_page_has_links_where_the_address_is_known(address, links):
    text = online.links(address)
    assert re.findall(r"\]\((\S+)\)", text) == links
    assert ("codeRepository" in text) == (address is None)
