"""The API reference and the table of the folders: complete, linked, and true to the imports."""

import ast
import re
from pathlib import Path

import pytest
import yaml

from workbench.imports import module_of_file, our_files
from workbench.pages import reference

ROOT = Path(__file__).resolve().parents[3]
PAGES = reference.pages()
ENTRY = re.compile(r"^\.\. auto(?:function|class):: (\S+)", re.MULTILINE)
NOT_IN_FULL = {*reference.BY_MODULE, *reference.NOT_SHOWN}


@pytest.fixture(scope="module")
def texts():
    return {
        page: reference.page_text(title, modules, page in reference.BY_MODULE)
        for page, (title, modules) in PAGES.items()
    }


def written(path):
    """The full names of the public functions and classes of a file that have a docstring, by its
    source.
    """
    module = module_of_file(path)
    return {
        f"{module}.{node.name}"
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and ast.get_docstring(node)
    }


def test_every_public_function_and_class_has_one_entry_in_the_order_of_its_page_s_table(texts):
    found = [name for text in texts.values() for name in ENTRY.findall(text)]
    shown = [
        path for path in our_files() if not NOT_IN_FULL & set(module_of_file(path).split(".")[1:2])
    ]
    assert len(found) == len(set(found))
    assert set(found) == set().union(*map(written, shown))
    for page in set(PAGES) - set(reference.BY_MODULE):
        head, *_ = texts[page].split("\n## ")
        rows = re.findall(r"^\| \{py:obj\}`\w+ <([\w.]+)>`", head, re.M)
        assert rows == ENTRY.findall(texts[page])


def test_every_page_is_in_the_book(tmp_path, texts):
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    chapters = [chapter for part in toc["parts"] for chapter in part["chapters"]]
    (index,) = [chapter for chapter in chapters if chapter["file"] == "book/api/index"]
    listed = [one["file"] for one in index["sections"]]
    assert sorted(listed) == sorted(f"book/api/{page}" for page in PAGES)
    reference.write_pages(tmp_path / "api")
    assert {path.stem for path in (tmp_path / "api").iterdir()} == {*PAGES, "face", "contents"}
    for page in PAGES:
        included = (ROOT / "book" / "api" / f"{page}.md").read_text(encoding="utf-8")
        assert f"generated/api/{page}.md" in included
        assert (tmp_path / "api" / f"{page}.md").read_text(encoding="utf-8") == texts[page]


def test_a_module_at_the_top_that_is_on_no_page_is_an_error(monkeypatch):
    monkeypatch.delitem(reference.TOP, "pose")
    with pytest.raises(ValueError, match="each module at the top of the package once"):
        reference.pages()


@pytest.mark.parametrize(
    ("name", "module", "full"),
    [
        ("Camera", "trinolab.matching", "trinolab.camera.Camera"),  # imported there
        ("Camera.project", "trinolab.matching", "trinolab.camera.Camera.project"),
        # estimators have another one
        ("Views", "trinolab.identity.search", "trinolab.identity.layout.Views"),
        # not imported, but there is only one
        ("pose.fit_pose", "trinolab.files.rigs", "trinolab.pose.fit_pose"),
        ("T_world_handle", "trinolab.pose", "T_world_handle"),  # an argument
        ("RigidTransform", "trinolab.pose", "RigidTransform"),  # another package's
        ("fit_pose", "trinolab.files.rigs", "fit_pose"),  # a word without a dot says too little
    ],
)
def test_a_name_in_a_docstring_means_what_it_means_in_the_module(name, module, full):
    assert reference.full_name(name, module) == full
