"""The API reference and the picture of the house: complete, linked, and true to the imports."""

import ast
import re
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
import test_structure
import yaml

from workbench.pages import house, reference
from workbench.paper.ledger import load_ledger

ROOT = Path(__file__).resolve().parents[1]
PAGES = reference.pages()
ENTRY = re.compile(r"^\.\. auto(?:function|class):: (\S+)", re.MULTILINE)
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
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    return {
        f"{module}.{node.name}"
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and ast.get_docstring(node)
    }


def test_every_public_function_and_class_has_one_entry(texts):
    found = [name for text in texts.values() for name in ENTRY.findall(text)]
    wanted = set().union(
        *(
            written(path)
            for path in test_structure.MODULES
            if test_structure.room(path) not in {*reference.BY_MODULE, *test_structure.FACE}
        )
    )
    assert len(found) == len(set(found))
    assert set(found) == wanted
    assert len(found) > 500


def test_every_name_is_in_the_table_of_its_page_first(texts):
    for page in set(PAGES) - set(reference.BY_MODULE):
        head, *_ = texts[page].split("\n## ")
        entries = ENTRY.findall(texts[page])
        assert re.findall(r"^\| \{py:obj\}`\w+ <([\w.]+)>`", head, re.M) == entries
        assert all(
            row.count("|") - row.count(r"\|") == 5
            for row in head.split("\n")
            if row.startswith("| ")
        )


@pytest.mark.parametrize("entry", LEDGER, ids=lambda entry: entry.name)
def test_what_implements_an_equation_links_to_it_and_to_its_chapter(entry, texts):
    for name in entry.functions:
        (text,) = [text for text in texts.values() if f".. autofunction:: {name}\n" in text]
        block = text.split(f".. autofunction:: {name}\n")[1].split("```")[0]
        spans = re.findall(r"`Eq\. (\d+)(?:-(\d+))? <equation-\1>`", block)
        assert any(int(first) <= int(entry.no) <= int(last or first) for first, last in spans)
        assert f":doc:`chapter {int(entry.chapter[:2])} </notebooks/{entry.chapter}>`" in block


def test_every_page_is_in_the_book():
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    chapters = [chapter for part in toc["parts"] for chapter in part["chapters"]]
    (section,) = [
        chapter["sections"] for chapter in chapters if chapter["file"] == "book/api/index"
    ]
    assert sorted(one["file"] for one in section) == sorted(f"book/api/{page}" for page in PAGES)
    for page in PAGES:
        assert f"generated/api/{page}.md" in (ROOT / "book" / "api" / f"{page}.md").read_text(
            encoding="utf-8"
        )


def test_pages_are_written_for_the_book_to_include(tmp_path, texts):
    reference.write_pages(tmp_path / "new" / "folder")
    assert {path.stem for path in (tmp_path / "new" / "folder").iterdir()} == {
        *PAGES,
        "face",
        "contents",
    }
    assert (tmp_path / "new" / "folder" / "pose.md").read_text(encoding="utf-8") == texts["pose"]
    face = (tmp_path / "new" / "folder" / "face.md").read_text(encoding="utf-8")
    assert (
        "{py:obj}`trinolab.measure <trinolab.measurement.measure>` | Measure the handle's pose"
        in face
    )


def test_a_module_at_the_top_that_is_on_no_page_is_an_error(monkeypatch):
    monkeypatch.delitem(reference.TOP, "pose")
    with pytest.raises(
        ValueError, match=r"expected each module at the top of the package once, got a .*'tracker'"
    ):
        reference.pages()


def test_what_a_chapter_uses_is_found_where_it_is_defined():
    code = """import trinolab
from trinolab import identity as who, pose
from trinolab.matching import ncc
who.identify(trinolab.measure, pose.fit_pose(pose.LOST), ncc, workbench.sweep.sweep)
other.measure(np.zeros(3))"""
    found = {
        name for name in reference._names_used(ast.parse(code)) if name in reference._known_names()
    }
    assert found - {
        name for name in found if name in {"trinolab.pose", "trinolab.identity", "workbench.sweep"}
    } == {
        "trinolab.identity.identify.identify",
        "trinolab.measurement.measure",
        "trinolab.pose.fit_pose",
        "trinolab.matching.ncc",
        "workbench.sweep.runs.sweep",
    }


@pytest.mark.parametrize(
    ("numbers", "spans"),
    [
        ([], []),
        ([20], [(20, "20")]),
        ([5, 6, 16], [(5, "5-6"), (16, "16")]),
        ([1, 3, 4, 5], [(1, "1"), (3, "3-5")]),
    ],
)
def test_numbers_as_spans(numbers, spans):
    assert reference._spans(numbers) == spans


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
    assert reference._full_name(name, module) == full


# --- the picture


def test_the_picture_knows_the_imports():
    """As the walls' own reader of imports finds them, by another way."""
    imported = {}
    for path in test_structure.MODULES:
        if (room := test_structure.room(path)) not in test_structure.FACE:
            imported.setdefault(room, set()).update(
                test_structure.rooms_imported(path) - test_structure.FACE
            )
    assert house.rooms(together={}) == imported


def reachable(graph):
    """For each room all that stands below it."""
    below = {}
    for _ in graph:
        below = {
            room: others.union(*(below.get(other, set()) for other in others))
            for room, others in graph.items()
        }
    return below


def test_arrows_that_are_left_out_follow_from_the_others():
    graph = house.rooms()
    floor = house.floors(graph)
    arrows = house.needed(graph, floor)
    assert reachable(arrows) == reachable(graph)
    assert sum(map(len, arrows.values())) < sum(map(len, graph.values())) / 2
    for room, others in arrows.items():
        for other in others:  # none can be spared
            fewer = {**arrows, room: others - {other}}
            assert other not in reachable(fewer)[room]


def test_every_room_is_drawn_above_what_it_imports_and_nothing_overlaps():
    graph, fig = house.rooms(), house.draw_house()
    fig.canvas.draw()
    at = {text.get_text().split(", ")[0]: text for text in fig.axes[0].texts}
    assert set(at) == set(graph)
    for room, others in graph.items():
        assert all(at[room].get_position()[1] > at[other].get_position()[1] for other in others)
    boxes = [text.get_window_extent() for text in at.values()]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    plt.close(fig)


def test_a_circle_is_an_error():
    with pytest.raises(ValueError, match="expected no circle, got one among a, b"):
        house.floors({"a": {"b"}, "b": {"a", "c"}, "c": set()})


def test_an_arrow_has_a_place_on_each_floor_that_it_passes():
    floor = {"a": 3, "b": 0}
    (way,) = house.routed({"a": {"b"}, "b": set()}, floor)
    assert [k for _, k in way] == [3, 2, 1, 0]
    assert all(upper[1] == lower[1] + 1 for upper, lower in pairwise(way))


def test_picture_and_table_are_written_and_the_same_again(tmp_path):
    house.write_house(tmp_path / "a")
    house.write_house(tmp_path / "b")
    assert (tmp_path / "a" / "house.svg").read_bytes() == (
        tmp_path / "b" / "house.svg"
    ).read_bytes()
    table = (tmp_path / "a" / "house.md").read_text(encoding="utf-8")
    assert table.count("\n") == 2 + len(reference.folders())
    assert "| {doc}`sweep </book/api/sweep>` | " in table
