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


@pytest.mark.heavy
def test_a_reader_changes_alpha(browser, lab):
    def sees(expression):
        """What an expression of JavaScript gives, once it is something true."""
        return wait_until(lambda: browser.evaluate(expression))

    browser.open(f"{lab}/lab/tree/notebooks/03_background.ipynb?reset")
    panel = "globalThis.jupyterapp?.shell.currentWidget"
    sees(f"{panel}?.content?.model?.cells.length > 20 && {panel}.sessionContext.isReady")
    # admonitions are boxes, and not text between colons
    assert "This chapter" in sees("document.querySelector('.myst aside')?.innerText")
    # folded as on its page, unchanged
    sees(f"{panel}.content.widgets.some((one) => one.hasClass('trinolab-parameters'))")
    cells = nbformat.read(ROOT / "notebooks" / "03_background.ipynb", as_version=4).cells
    hidden = [cell.id for cell in cells if "hide-input" in cell.metadata.get("tags", [])]
    folded = f"{panel}.content.widgets.filter((one) => one.inputHidden).map((one) => one.model.id)"
    assert browser.evaluate(folded) == hidden != []
    assert not browser.evaluate(f"{panel}.context.model.toString().includes('source_hidden')")
    changed = "\nupdate_rate, spacing, cameras, row_step = 0.05, 8, 1, 10"
    browser.evaluate(f"""
        globalThis.cellOf = (id) => {panel}.content.widgets.find((one) => one.model.id == id);
        const source = cellOf('background-03').model.sharedModel;
        source.setSource(source.source + {json.dumps(changed)});
        jupyterapp.commands.execute('notebook:run-all-cells').then(
            (good) => (globalThis.ran = good ? 'well' : 'with an error'));
    """)
    assert sees("globalThis.ran") == "well"
    text = "cellOf('background-12').node.querySelector('.myst')?.innerText"
    browser.evaluate(f"{panel}.content.scrollToCell(cellOf('background-12'))")
    said = sees(f"{text}?.includes('0.05') && {text}")
    assert re.search(r"false alarm for 0\.3 s, and the resting hand is seen for 0\.7 s", said)
