"""A page is rendered as Sphinx reads it, and a name that is not there stops the build."""

import json
from types import SimpleNamespace

import pytest
from pages import ROOT
from sphinx.errors import ExtensionError

from workbench.pages import template


def test_a_page_has_its_numbers_and_a_notebook_is_no_template(tmp_path):
    (tmp_path / template.NUMBERS).parent.mkdir(parents=True)
    (tmp_path / template.NUMBERS).write_text(json.dumps({"poses": 20}))
    env = SimpleNamespace(doc2path=lambda name: tmp_path / f"{name}.md")
    app = SimpleNamespace(srcdir=tmp_path, env=env)
    text = "[A1]{#a1} {#- a remark -#}{{ poses }} poses"
    for name, shown in (("book/one", "[A1]{#a1} 20 poses"), ("notebooks/01_one", text)):
        source = [text]
        template.render_page(app, name, source)
        assert source == [shown]
    with pytest.raises(ExtensionError, match=r"one\.md: 'nowhere' is undefined"):
        template.render_page(app, "book/one", ["{{ nowhere }}"])


def test_every_page_finds_its_numbers(page):
    for path in (ROOT / "book").rglob("*.md"):
        assert page(path.relative_to(ROOT / "book").with_suffix("")), path
