"""The API reference and the table of the folders: complete, linked, and true to the imports."""

import ast
import re
from pathlib import Path

import pytest
import yaml

import satellites
import trinolab
import workbench
from workbench.imports import PACKAGES, module_of_file, our_files
from workbench.pages import house, reference
from workbench.paper.ledger import load_ledger

ROOT = Path(__file__).resolve().parents[3]
PAGES = reference.pages()
ENTRY = re.compile(r"^\.\. auto(?:function|class):: (\S+)", re.MULTILINE)
NOT_IN_FULL = {*reference.BY_MODULE, *reference.NOT_SHOWN}
LEDGER = [entry for entry in load_ledger() if entry.no.isdigit()]


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


@pytest.mark.parametrize("entry", LEDGER, ids=lambda entry: entry.name)
def test_what_implements_an_equation_links_to_it_and_to_its_chapter(entry, texts):
    for name in entry.functions:
        (text,) = [text for text in texts.values() if f".. autofunction:: {name}\n" in text]
        block = text.split(f".. autofunction:: {name}\n")[1].split("```")[0]
        spans = re.findall(r"`Eq\. (\d+)(?:-(\d+))? <equation-\1>`", block)
        assert any(int(first) <= int(entry.no) <= int(last or first) for first, last in spans)
        assert f":doc:`chapter {int(entry.chapter[:2])} </notebooks/{entry.chapter}>`" in block


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


def test_what_a_chapter_uses_is_found_where_it_is_defined():
    code = """import trinolab
from trinolab import identity as who, pose
from trinolab.matching import ncc
who.identify(trinolab.measure, pose.fit_pose(pose.LOST), ncc, workbench.sweep.sweep)
other.measure(np.zeros(3))"""
    found = set(reference.names_used(ast.parse(code))) & set(reference.known_names())
    assert found >= {
        "trinolab.identity.identify.identify",
        "trinolab.measurement.measure",
        "trinolab.pose.fit_pose",
        "trinolab.matching.ncc",
        "workbench.sweep.runs.sweep",
    }
    assert not [name for name in found if "zeros" in name or "other" in name]


@pytest.mark.parametrize(
    ("name", "module", "full"),
    [
        ("Camera", "trinolab.matching", "trinolab.camera.Camera"),  # imported there
        ("Camera.project", "trinolab.matching", "trinolab.camera.Camera.project"),
        # estimators have another one
        ("Views", "trinolab.identity.search", "trinolab.identity.layout.Views"),
        # not imported, but there is only one
        ("pose.fit_pose", "trinolab.files.rigs", "trinolab.pose.fit_pose"),
        ("trinolab.pose.fit_pose", None, "trinolab.pose.fit_pose"),
        ("T_world_handle", "trinolab.pose", "T_world_handle"),  # an argument
        ("RigidTransform", "trinolab.pose", "RigidTransform"),  # another package's
        ("fit_pose", "trinolab.files.rigs", "fit_pose"),  # a word without a dot says too little
    ],
)
def test_a_name_in_a_docstring_means_what_it_means_in_the_module(name, module, full):
    assert reference.full_name(name, module) == full


# --- the table of the folders


def test_the_table_knows_the_imports():
    """As the lines of the sources say it, read by another way than the graph's."""
    rooms = house.rooms()
    for room in ("trinolab.tracker", "trinolab.following", "satellites.live"):
        package, name = room.split(".")
        place = PACKAGES[package] / name
        inside = [path for path in our_files() if place in path.parents]
        named = set().union(*map(rooms_named, inside or [place.with_suffix(".py")]))
        assert rooms[room] == named & set(rooms) - {room}


def rooms_named(path):
    """The rooms that the import lines of a file name."""
    package = module_of_file(path).split(".")
    package = package if path.name == "__init__.py" else package[:-1]
    named = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = [*above, *(node.module or "").split(".")] if node.module else above
            named |= {".".join([*base, alias.name][:2]) for alias in node.names}
    return named


def test_the_table_has_every_folder(tmp_path):
    house.write_house(tmp_path)
    rows = (tmp_path / "house.md").read_text(encoding="utf-8").splitlines()[2:]
    folders = [reference.folders(package) for package in (trinolab, workbench, satellites)]
    assert len(rows) == sum(map(len, folders))
