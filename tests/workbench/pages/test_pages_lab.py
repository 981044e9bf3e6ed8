"""The chapters in JupyterLab, as `make lab` opens them, in a real browser."""

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
from contextlib import suppress
from pathlib import Path
from urllib.request import urlopen

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook
from processes import started, wait_until

ROOT = Path(__file__).resolve().parents[3]
EXTENSIONS = ROOT / "book" / "lab"
SCRIPT = EXTENSIONS / "trinolab-numbers" / "static" / "remoteEntry.js"
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def test_numbers_have_the_formats_of_the_pages(browser):
    """Every format that a chapter uses, by Python and by the extension."""
    texts = [path.read_text(encoding="utf-8") for path in CHAPTERS]
    formats = set(re.findall(r"\{glue:text\}`[^`:]*:?([^`]*)`", "".join(texts)))
    assert {".1f", ".0%", "g", ""} <= formats
    values = [0.0, 0.016, 0.4449, 1.0, 9.5e8, 12.3456789, 950.2, 123456.7]
    browser.open("about:blank")
    browser.evaluate(SCRIPT.read_text(encoding="utf-8") + "; null")
    asked = [[str(value), form] for value in values for form in sorted(formats)]
    shown = browser.evaluate(f"{json.dumps(asked)}.map(one => formatted(...one))")
    expected = [format(float(value), form) if form else value for value, form in asked]
    assert shown == expected
    assert browser.evaluate("""formatted("'survives'", "")""") == "survives"


@pytest.fixture
def lab(tmp_path):
    """The address of a JupyterLab on a copy of the chapters: what Lab saves is not ours."""
    shutil.copytree(ROOT / "notebooks", tmp_path / "notebooks")
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{one.getsockname()[1]}"
    options = {
        "ServerApp.root_dir": tmp_path,
        "ServerApp.port": address.rpartition(":")[2],
        "ServerApp.allow_root": True,
        "ServerApp.open_browser": False,
        "IdentityProvider.token": "",
        "LabApp.extra_labextensions_path": EXTENSIONS,
        "LabApp.expose_app_in_browser": True,
    }
    folders = {name: str(tmp_path / name) for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR")}
    environment = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    line = shlex.join(f"--{key}={value}" for key, value in options.items())
    run = "import sys; from jupyterlab.labapp import main; sys.exit(main())"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = started(line, run, env={**environment, **folders}, **quiet)

    def answers():
        with suppress(OSError):
            return urlopen(f"{address}/api").status == 200

    wait_until(answers, process)
    yield address
    process.terminate()
    process.wait()


class Reader:
    """A chapter that is open in JupyterLab."""

    def __init__(self, browser, address, chapter, cells=20):
        self._browser = browser
        browser.open(f"{address}/lab/tree/notebooks/{chapter}.ipynb?reset")
        panel = "globalThis.jupyterapp?.shell.currentWidget"
        self.sees(
            f"{panel}?.content?.model?.cells.length > {cells} && {panel}.sessionContext.isReady"
        )
        browser.evaluate(f"""
            globalThis.cellOf = (id) => {panel}.content.widgets.find((one) => one.model.id == id);
            globalThis.goTo = (id) => {panel}.content.scrollToCell(cellOf(id));
        """)

    def sees(self, expression):
        """Wait until an expression of JavaScript gives something true, and return that."""
        return wait_until(lambda: self._browser.evaluate(expression))

    def runs_all(self, cell, changed):
        """Change the cell of parameters, and run all cells."""
        self._browser.evaluate(f"""
            cellOf('{cell}').model.sharedModel.setSource(
                cellOf('{cell}').model.sharedModel.source + {json.dumps(chr(10) + changed)});
            jupyterapp.commands.execute('notebook:run-all-cells').then(
                (good) => (globalThis.ran = good ? 'well' : 'with an error'));
        """)
        assert self.sees("globalThis.ran") == "well"

    def reads(self, cell, word):
        """What a cell's text says, once it has a word."""
        self._browser.evaluate(f"goTo('{cell}')")
        return self.sees(f"""
            (() => {{
                const text = cellOf('{cell}').node.querySelector('.myst')?.innerText;
                return text?.includes('{word}') && text;
            }})()
        """)

    def moves_the_slider_of(self, cell):
        """One stop to the right: what the output says before and after, when its picture has
        changed.
        """
        self._browser.evaluate(f"goTo('{cell}')")
        shown = f"""
            (() => {{
                const node = cellOf('{cell}').node;
                const image = node.querySelector('.jp-OutputArea img');
                return image && [node.querySelector('.jp-OutputArea pre').innerText, image.src];
            }})()
        """
        before = self.sees(shown)
        self._browser.evaluate(f"""
            cellOf('{cell}').node.querySelector('.noUi-handle').dispatchEvent(
                new KeyboardEvent('keydown', {{key: 'ArrowRight', bubbles: true}}));
        """)
        after = wait_until(
            lambda: (now := self._browser.evaluate(shown)) and now[1] != before[1] and now
        )
        return before[0], after[0]


@pytest.mark.heavy
def test_a_reader_changes_alpha_and_moves_its_slider(browser, lab):
    reader = Reader(browser, lab, "03_background")
    # admonitions are boxes, and not text between colons
    assert "This chapter" in reader.sees("document.querySelector('.myst aside')?.innerText")
    # folded as on its page, unchanged
    panel = "jupyterapp.shell.currentWidget"
    reader.sees(f"{panel}.content.widgets.some((one) => one.hasClass('trinolab-parameters'))")
    cells = nbformat.read(ROOT / "notebooks" / "03_background.ipynb", as_version=4).cells
    hidden = [cell.id for cell in cells if "hide-input" in cell.metadata.get("tags", [])]
    folded = f"{panel}.content.widgets.filter((one) => one.inputHidden).map((one) => one.model.id)"
    assert browser.evaluate(folded) == hidden != []
    assert not browser.evaluate(f"{panel}.context.model.toString().includes('source_hidden')")
    reader.runs_all("background-03", "update_rate, spacing, cameras, row_step = 0.05, 8, 1, 10")
    said = reader.reads("background-12", "0.05")
    assert re.search(r"false alarm for 0\.3 s, and the resting hand is seen for 0\.7 s", said)
    before, after = reader.moves_the_slider_of("background-37-slider")
    assert "alpha = 0.05" in before
    assert "alpha = 0.1" in after


@pytest.mark.heavy
def test_an_applet_is_shown_and_moved(browser, lab, tmp_path):
    """By its own cell, without an extension; keys move its slider and are no commands of Lab's."""
    shown = 'from workbench.applets import show_applet\n\nshow_applet("depth", sigma_px=0.1)'
    cells = [new_markdown_cell("# An applet", id="title"), new_code_cell(shown, id="shown")]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    notebook = new_notebook(cells=cells, metadata=kernel)
    nbformat.write(notebook, tmp_path / "notebooks" / "applets.ipynb")
    reader = Reader(browser, lab, "applets", cells=1)
    reader.runs_all("title", "")
    box = "document.querySelector('.jp-OutputArea .applet')"
    label = f"{box}?.querySelector('svg[role=img]')?.getAttribute('aria-label')"
    before = reader.sees(label)
    assert "99.2 mm apart" in before
    browser.evaluate(f"{box}.querySelector('[name=baseline]').focus()")
    for key in ("ArrowRight", "d", "d"):  # d, d would delete the cell
        browser.press(key)
    assert reader.sees(f"{label} != {json.dumps(before)}")
    assert browser.evaluate("document.querySelectorAll('.jp-Notebook .jp-Cell').length") == 2
