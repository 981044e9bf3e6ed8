"""The chapters in JupyterLab, as `make lab` opens them, in a real browser."""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import nbformat
import pytest
from browser import CHROMIUM, Browser
from processes import wait_until

ROOT = Path(__file__).resolve().parents[1]
EXTENSIONS = ROOT / "book" / "lab"
SCRIPT = EXTENSIONS / "trinolab-numbers" / "static" / "remoteEntry.js"
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"
)
# Chapter 3 with another alpha, and small enough for a test.
CHANGED = "update_rate = 0.05\nspacing = 8\ncameras = 1\nrow_step = 10\n"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


def text_of(path):
    notebook = nbformat.read(path, as_version=4)
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")


def test_numbers_have_the_formats_of_the_pages(browser):
    """Every format that a chapter uses, by Python and by the extension."""
    quoted = [re.findall(r"\{glue:text\}`[^`:]*:?([^`]*)`", text_of(path)) for path in CHAPTERS]
    formats = sorted(set().union(*quoted))
    assert {".1f", ".0%", "g", ""} <= set(formats)
    values = [0.0, 0.016, 0.4449, 1.0, 9.5e8, 12.3456789, 950.2, 123456.7]
    browser.open("about:blank")
    browser.evaluate(SCRIPT.read_text(encoding="utf-8") + "; null")
    for form in formats:
        shown = [
            browser.evaluate(f"formatted({json.dumps(str(value))}, {json.dumps(form)})")
            for value in values
        ]
        expected = [format(value, form) if form else str(value) for value in values]
        assert shown == expected
    assert browser.evaluate("""formatted("'survives'", "")""") == "survives"


@pytest.fixture
def lab(tmp_path):
    """The address of a JupyterLab on a copy of chapter 3: what Lab saves is not ours."""
    (tmp_path / "notebooks").mkdir()
    shutil.copy(ROOT / "notebooks" / "03_background.ipynb", tmp_path / "notebooks")
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    options = {
        "ServerApp.root_dir": tmp_path,
        "ServerApp.port": port,
        "ServerApp.allow_root": True,
        "ServerApp.open_browser": False,
        "IdentityProvider.token": "",
        "LabApp.extra_labextensions_path": EXTENSIONS,
        "LabApp.expose_app_in_browser": True,
    }
    folders = {name: str(tmp_path / name) for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR")}
    environment = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "jupyterlab",
            *(f"--{key}={value}" for key, value in options.items()),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**environment, **folders},
    )
    address = f"http://127.0.0.1:{port}"

    def answers():
        try:
            return urlopen(f"{address}/api").status == 200
        except OSError:
            return False

    wait_until(answers, process)
    yield address
    process.terminate()
    process.wait()


@pytest.mark.heavy
def test_a_reader_changes_alpha_and_moves_its_slider(browser, lab):
    browser.open(f"{lab}/lab/tree/notebooks/03_background.ipynb?reset")

    def seen(expression):
        return wait_until(lambda: browser.evaluate(expression))

    panel = "globalThis.jupyterapp?.shell.currentWidget"
    seen(f"{panel}?.content?.model?.cells.length > 40 && {panel}.sessionContext.isReady")
    # admonitions are boxes, and not text between colons
    assert "This chapter" in seen("document.querySelector('.myst aside')?.innerText")
    browser.evaluate(f"""
        globalThis.cellOf = (id) => {panel}.content.widgets.find((one) => one.model.id == id);
        const parameters = cellOf('background-03').model.sharedModel;
        parameters.setSource(parameters.source + '\\n' + {json.dumps(CHANGED)});
        jupyterapp.commands.execute('notebook:run-all-cells').then((good) => (globalThis.ran = good));
    """)
    seen("globalThis.ran")

    # the numbers of the text are those of the run
    browser.evaluate("jupyterapp.shell.currentWidget.content.scrollToCell(cellOf('background-12'))")
    said = seen("""
        (() => {
            const text = cellOf('background-12').node.querySelector('.myst')?.innerText;
            return text?.includes('0.05') && text;
        })()
    """)
    assert re.search(r"false alarm for 0\.3 s, and the resting hand is seen for 0\.7 s", said)

    # the slider redraws the figure, and what stands above it
    browser.evaluate(
        "jupyterapp.shell.currentWidget.content.scrollToCell(cellOf('background-37-slider'))"
    )
    shown = """
        (() => {
            const node = cellOf('background-37-slider').node;
            const image = node.querySelector('.jp-OutputArea img');
            return image && [node.querySelector('.jp-OutputArea pre').innerText, image.src];
        })()
    """
    before = seen(shown)
    assert "alpha = 0.05" in before[0]
    browser.evaluate("""
        cellOf('background-37-slider').node.querySelector('.noUi-handle').dispatchEvent(
            new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}));
        globalThis.moved = performance.now();
    """)
    after = wait_until(lambda: (now := browser.evaluate(shown)) and now[1] != before[1] and now)
    print(f"the picture changed after {browser.evaluate('performance.now() - moved'):.0f} ms")
    assert "alpha = 0.1" in after[0]
