"""The cells that show applets: in a notebook, in a sweep, and with the parameters that they ask for."""

import ast
import json
import re
from pathlib import Path

import nbformat
import pytest

from workbench.applets import applet_html, show_applet, wanted_parameters
from workbench.sweep.notebook import UNATTENDED, read_parameters

ROOT = Path(__file__).resolve().parents[3]
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))
DEPTH = {"sigma_px": 0.1}


def calls(path):
    """Name and names of the arguments of each call of `show_applet` in a notebook."""
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code" and "show_applet(" in cell.source:
            for node in ast.walk(ast.parse(cell.source)):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "show_applet":
                    yield node.args[0].value, {one.arg: one.value for one in node.keywords}


def test_every_applet_is_shown_with_its_parameters_in_a_notebook():
    shown = []
    for path in CHAPTERS:
        for name, arguments in calls(path):
            shown.append(name)
            assert set(arguments) == wanted_parameters(name), name
            assert set(arguments) <= set(read_parameters(path)), name
            assert all(value.id == key for key, value in arguments.items()), name
    scripts = {path.stem for path in (ROOT / "book" / "workbench" / "applets").glob("*.js")}
    assert sorted(shown) == sorted(scripts - {"shared"})


def test_a_cell_shows_the_scripts_and_what_they_need_to_know(monkeypatch):
    monkeypatch.setenv(UNATTENDED, "1")
    assert show_applet("depth", **DEPTH) is None  # in a sweep
    monkeypatch.delenv(UNATTENDED)
    html = show_applet("depth", **DEPTH).data
    (known,) = re.findall(r'<script type="application/json">(.*?)</script>', html)
    known = json.loads(known)
    assert known["parameters"] == DEPTH
    assert known["data"]["baseline_mm"] == pytest.approx(99.2)
    assert re.findall(r"trinolabApplets\.define\('(\w+)'", html) == ["depth"]
    assert html.count("<script") == html.count("</script>") == 3
    assert not re.search(r"https?://(?!www\.w3\.org)", html)  # no request
    second = applet_html("depth", DEPTH, shared=False)  # a page has the shared part once
    assert "window.trinolabApplets = " not in second
    assert "<style>" not in second


def test_what_is_wrong_is_said():
    with pytest.raises(ValueError, match="there is no applet 'nothing'"):
        show_applet("nothing")
    with pytest.raises(ValueError, match=r"expected \['sigma_px'\], got \['seed'\]"):
        show_applet("depth", seed=0)
