"""The other implementation of the runtime, as far as its core goes: Python without packages."""

import json
import shutil
import tarfile

import pytest

from workbench.browser.fetch import is_fetched, path_of
from workbench.browser.numbers import serving
from workbench.browser.site import SITE, STATIC
from workbench.pages.browser import CHROMIUM, Browser

pytestmark = [
    pytest.mark.heavy,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
    pytest.mark.skipif(
        not (is_fetched() and (SITE / "_browser" / "runtime.json").exists()),
        reason="the pages that run in a browser are not built: make browser",
    ),
]
# A worker that is spoken to as runtime.js does it; outputs are kept.
ASK = """
window.outputs = [];
window.worker = new Worker('/static/pyodide.js', {type: 'module'});
window.waiting = new Map();
worker.onmessage = ({data}) => {
    if (data.kind === 'output') outputs.push(data.output);
    else if (data.kind === 'done') waiting.get(data.id).resolve(data.value);
    else if (data.kind === 'failed') waiting.get(data.id).reject(data.message);
};
window.ask = (kind, about = {}) => new Promise((resolve, reject) => {
    const id = waiting.size + 1;
    waiting.set(id, {resolve, reject});
    worker.postMessage({id, kind, ...about});
});
"""
# A frame as `guest.door` makes it, without NumPy
CONSTANT = """
import json
import _host
from pyodide.ffi import to_js
head = json.dumps({"asks": "constant", "name": "COLOR_BGR2GRAY", "arrays": []}).encode()
answer = _host.call(to_js(len(head).to_bytes(4, "little") + head)).to_bytes()
print(json.loads(answer[4:])["value"])
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(STATIC, folder / "static")
    (folder / "files").mkdir()
    shutil.copy(SITE / "_browser" / "files" / "opencv.js.gz", folder / "files")
    with tarfile.open(path_of("pyodide")) as archive:
        archive.extractall(folder, filter="data")
    (folder / "package").rename(folder / "pyodide")
    (folder / "blank.html").write_text("<!doctype html><title>blank</title>")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    with serving(folder) as address:
        browser.open(f"{address}/blank.html")
        browser.evaluate(ASK)
        about = {"packages": [], "archives": [], "recordings": [], "source": "side = 20"}
        start = {"base": f"{address}/", "about": about}
        browser.started = browser.evaluate(f"ask('start', {json.dumps(start)})")
        yield browser
    browser.close()


def run(page, source):
    page.evaluate("outputs.length = 0")
    code = page.evaluate(f"ask('run', {{source: {json.dumps(source)}}})")["code"]
    return code, "".join(page.evaluate("outputs.map(one => one.text)"))


def test_it_starts_and_keeps_its_variables(page):
    assert page.started["code"] == 0
    assert run(page, "print(side + 22)") == (0, "42\n")


def test_an_error_is_said(page):
    code, says = run(page, "side / 0")
    assert code == 1
    assert "ZeroDivisionError" in says


def test_files_cross_both_ways(page):
    page.evaluate(
        "ask('write', {path: 'tmp/in.txt', bytes: new TextEncoder().encode('here').buffer})"
    )
    run(page, "open('/tmp/out.txt', 'w').write(open('/tmp/in.txt').read().upper())")
    read = "ask('read', {path: 'tmp/out.txt'}).then(bytes => new TextDecoder().decode(bytes))"
    assert page.evaluate(read) == "HERE"
    assert page.evaluate("ask('read', {path: 'tmp/none'})") is None


def test_python_asks_through_the_door(page):
    assert run(page, CONSTANT) == (0, "6\n")  # OpenCV's COLOR_BGR2GRAY
