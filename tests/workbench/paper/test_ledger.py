"""The ledger of equations against the code: 27 of 27, and every function, test and chapter that it
names is there.
"""

import ast
import importlib
import re
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path

import nbformat
import pytest

from workbench.paper import ledger
from workbench.paper.errata import ERRATA
from workbench.paper.ledger import (
    Effect,
    Entry,
    equations_named,
    errata_page,
    index_page,
    load_ledger,
    number_text,
)

ROOT = Path(__file__).resolve().parents[3]
LEDGER = load_ledger()
EQUATIONS = [entry for entry in LEDGER if entry.no.isdigit()]
each_entry = pytest.mark.parametrize("entry", LEDGER, ids=lambda entry: entry.name)
each_equation = pytest.mark.parametrize("entry", EQUATIONS, ids=lambda entry: entry.name)


@cache
def names_in(file):
    """The names of a file's functions; none if there is no such file."""
    path = ROOT / file
    return (
        {
            node.name
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef)
        }
        if path.is_file()
        else set()
    )


@cache
def text_of(chapter):
    """The text cells of a chapter; nothing if there is no such chapter."""
    path = ROOT / "notebooks" / f"{chapter}.ipynb"
    cells = nbformat.read(path, as_version=4).cells if path.is_file() else []
    return "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


def summary(dotted):
    """What a function's docstring begins with; None if the module has no such function."""
    module, _, name = dotted.rpartition(".")
    try:
        function = getattr(importlib.import_module(module), name, None)
    except ImportError:
        return None
    own = callable(function) and function.__module__ == module
    return (function.__doc__ or "").partition("\n\n")[0] if own else None


def missing(entry):
    """What an entry names that is not there."""
    problems = []
    for function in entry.functions:
        line = summary(function)
        if line is None:
            problems.append(f"no function {function}")
        elif entry.no.isdigit() and entry.no not in equations_named(line):
            problems.append(f"{function} does not name Eq. {entry.no}: {line}")
    for test in entry.tests:
        file, _, name = test.partition("::")
        if not name.startswith("test_") or name not in names_in(file):
            problems.append(f"no test {test}")
    if not text_of(entry.chapter):
        problems.append(f"no chapter {entry.chapter}")
    elif entry.no.isdigit() and rf"\tag{{{entry.no}}}" not in text_of(entry.chapter):
        problems.append(f"chapter {entry.chapter} does not show Eq. {entry.no}")
    return problems


# --- the ledger and the code


def test_there_are_27_equations_in_their_order():
    assert [entry.no for entry in EQUATIONS] == [str(k) for k in range(1, 28)]
    assert len({entry.no for entry in LEDGER}) == len(LEDGER)


@each_entry
def test_all_that_the_ledger_names_is_there(entry):
    assert entry.functions
    assert entry.tests
    assert missing(entry) == []


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (
            {"functions": ("trinolab.workspace.cones.no_such",)},
            "no function trinolab.workspace.cones.no_such",
        ),
        ({"functions": ("trinolab.no_such.inside",)}, "no function trinolab.no_such.inside"),
        (
            {"functions": ("trinolab.pose.Rig",)},
            "no function trinolab.pose.Rig",
        ),  # it only imports it
        (
            {"functions": ("trinolab.pose.rigid_fit",)},
            "trinolab.pose.rigid_fit does not name Eq. 1: ",
        ),
        (
            {"tests": ("tests/trinolab/workspace/test_intersection.py::test_no_such",)},
            "no test tests/trinolab/workspace/test_intersection.py::test_no_such",
        ),
        (
            {"tests": ("tests/trinolab/workspace/test_intersection.py::intersect",)},
            "no test tests/trinolab/workspace/test_intersection.py::intersect",
        ),
        ({"tests": ("tests/no_such.py::test_status",)}, "no test tests/no_such.py::test_status"),
        ({"chapter": "99_no_such"}, "no chapter 99_no_such"),
        ({"no": "5"}, "trinolab.workspace.cones.paper_cones does not name Eq. 5: "),
    ],
)
def test_a_wrong_name_is_found(change, problem):
    assert missing(EQUATIONS[0]) == []
    assert missing(replace(EQUATIONS[0], **change))[0].startswith(problem)


def test_a_chapter_that_shows_another_equation_is_found():
    entry = replace(EQUATIONS[3], functions=(), no="26")
    assert missing(entry) == ["chapter 02_workspace does not show Eq. 26"]


@each_entry
def test_an_entry_is_complete(entry):
    assert re.fullmatch(r"\d(\.\d)?", entry.section)
    assert entry.what.endswith(".")
    assert entry.printed != entry.corrected
    assert entry.no.isdigit() or entry.no == f"Sect. {entry.section}"


@each_entry
def test_the_formulas_are_closed(entry):
    for tex in (entry.printed, entry.corrected, entry.what):
        plain = tex.replace(r"\{", "").replace(r"\}", "")
        assert plain.count("{") == plain.count("}")
        opened = list[str]()
        for what, name in re.findall(r"\\(begin|end)\{(\w+)\}", tex):
            if what == "begin":
                opened.append(name)
            else:
                assert opened.pop() == name
        assert not opened
        assert tex.count(r"\left") - tex.count(r"\leftarrow") == tex.count(r"\right") - tex.count(
            r"\rightarrow"
        )
    assert entry.what.count("$") % 2 == 0
    assert "$" not in entry.printed + entry.corrected


def test_what_is_not_as_printed_has_an_effect_and_every_effect_an_entry():
    assert (
        {entry.no for entry in LEDGER if entry.status != "as printed"}
        <= set(ERRATA)
        <= {e.no for e in LEDGER}
    )


@pytest.mark.parametrize(
    ("line", "numbers"),
    [
        ("Distances (Eq. 17).", {"17"}),
        ("Cones (Eq. 1-3).", {"1", "2", "3"}),
        ("Points (Eq. 20, 22).", {"20", "22"}),
        ("All (Eq. 1, 3-5, 9).", {"1", "3", "4", "5", "9"}),
        ("The workspace (Sect. 3.2).", set()),
        ("", set()),
        ("Nothing here.\n\nBut below (Eq. 5).", set()),
        ("Twenty (Eq. 20).", {"20"}),
    ],
)
def test_numbers_in_a_docstring(line, numbers):
    assert equations_named(line) == numbers


# --- the loader

ROW = """[[{kind}]]
no = "1"
section = "3.2"
printed = "x"
status = "misprint"
corrected = "y"
what = "Wrong."
functions = ["a.b"]
tests = ["tests/t.py::test_t"]
chapter = "02_workspace"
"""
BOTH = ROW.format(kind="equation") + ROW.format(kind="text")


@pytest.fixture
def load(tmp_path, monkeypatch):
    def from_text(text):
        (tmp_path / "equations.toml").write_text(text)
        monkeypatch.setattr(ledger, "data_path", lambda name: tmp_path / name)
        return load_ledger()

    return from_text


def test_an_entry_is_read(load):
    assert load(BOTH)[0] == Entry(
        "1",
        "3.2",
        "x",
        "misprint",
        "y",
        "Wrong.",
        ("a.b",),
        ("tests/t.py::test_t",),
        "02_workspace",
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('what = "Wrong."\n', "", "entry 1: 'what' is missing"),
        ("what =", "waht =", "entry 1: 'what' is missing"),
        ("what =", 'note = "a"\nwhat =', "entry 1: 'note' is not a field"),
        ('"misprint"', '"wrong"', "Eq. 1: expected a status of"),
        ('"misprint"', '"as printed"', "Eq. 1: expected a corr"),
        ('corrected = "y"', 'corrected = ""', "Eq. 1: expected a corrected form"),
        ('["a.b"]', '"a.b"', "functions: expected a list of strings"),
        ('["a.b"]', "[1]", "functions: expected a list"),
        ('"02_workspace"', "2", "chapter: expected a string, got 2"),
        ("[[text]]", "[[txt]]", "'text' is missing"),
    ],
)
def test_a_wrong_ledger_is_named_with_its_field(load, old, new, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        load(BOTH.replace(old, new))


# --- the pages

EFFECTS = {
    "20": (
        Effect("20", "distance", "mm", 47.936, 1e-13, at_most=1e-6),
        Effect("20", "share", "", float("nan"), float("inf"), at_least=0.5),
    )
}


def section(page, no):
    """The section of an equation of the index."""
    return page.split(f"(equation-{no})=\n")[1].split("\n(equation-")[0]


def test_the_index_has_a_section_an_equation():
    page = index_page(LEDGER, EFFECTS, ["eq-20"])
    assert re.findall(r"^\(equation-(\d+)\)=$", page, flags=re.MULTILINE) == [
        str(k) for k in range(1, 28)
    ]
    for entry in EQUATIONS:
        text = section(page, entry.no)
        assert f"## {entry.name}\n" in text
        assert f"<equation-{entry.no}>`" in page.splitlines()[0], "no link to jump"
        assert (entry.corrected or entry.printed) in text
        assert rf"\tag{{{entry.no}}}" in text
        assert all(f".{name.rpartition('.')[2]} <{name}>`" in text for name in entry.functions)
    assert "{ref}`ambiguous <erratum-eq-20>`" in section(page, 20)
    assert "Sect. 5.3, as printed;" in section(page, 22)


def test_the_index_leads_to_the_equation_where_the_chapter_has_a_label():
    page = index_page(LEDGER, EFFECTS, ["eq-20"])
    assert "{ref}`chapter 8 <eq-20>`" in section(page, 20)
    assert "{doc}`chapter 8 </notebooks/08_pose>`" in section(page, 21)


def test_the_tests_of_an_equation_can_be_pasted():
    command = section(index_page(LEDGER, EFFECTS), 20).split("```sh\n")[1].split("\n```")[0]
    words = shlex.split(command.replace("\\\n", " "))
    assert words[0] == "pytest"
    assert tuple(words[1:]) == EQUATIONS[19].tests


def test_chapters_have_labels_before_their_own_equations_alone():
    for entry in EQUATIONS:
        for path in ROOT.glob("notebooks/*.ipynb"):
            text = text_of(path.stem)
            labels = text.count(f"(eq-{entry.no})=\n")
            assert labels <= (path.stem == entry.chapter), f"eq-{entry.no} in {path.stem}"
            if labels:
                after = text.split(f"(eq-{entry.no})=\n")[1]
                assert after.startswith(("$$", r"\begin{"))
                assert rf"\tag{{{entry.no}}}" in after.split("\n\n")[0]


def test_chapters_link_back_to_the_index():
    """A chapter links to an entry of its own; from there the others are a line away."""
    for chapter in {entry.chapter for entry in EQUATIONS}:
        text = text_of(chapter)
        own = [entry.no for entry in EQUATIONS if f"(eq-{entry.no})=" in text]
        if own:
            assert any(f"equations.md#equation-{no})" in text for no in own), chapter


def test_the_errata_have_a_place_for_every_link_of_the_index():
    everything = {entry.no: EFFECTS["20"] for entry in LEDGER}
    links = set(re.findall(r"<(erratum-[\w-]+)>", index_page(LEDGER, everything)))
    places = re.findall(
        r"^\((erratum-[\w-]+)\)=$", errata_page(LEDGER, everything), flags=re.MULTILINE
    )
    assert len(links) == 27
    assert len(set(places)) == len(places) == len(LEDGER)
    assert links <= set(places)


def test_the_errata_keep_errors_ambiguities_and_limits_apart():
    page = errata_page(LEDGER, {"22": EFFECTS["20"]})
    parts = re.split(r"^## (.+)$", page, flags=re.MULTILINE)[1:]
    assert parts[::2] == [title for title, _ in ledger.PARTS.values()]
    for status, text in zip(ledger.PARTS, parts[1::2], strict=True):
        shown = re.findall(r"^### (.+)$", text, flags=re.MULTILINE)
        wanted = [entry.name for entry in LEDGER if entry.status == status]
        assert shown == (wanted if status != "as printed" else ["Eq. 22"])


def test_an_erratum_shows_both_forms_and_the_effect():
    page = errata_page([entry for entry in EQUATIONS if entry.no in ("19", "20")], EFFECTS)
    assert "# Eq. 19" not in page
    assert (
        page.count(r"\tag{20}")
        == page.count(r"\begin{equation*}")
        == page.count(r"\end{equation*}")
        == 2
    )
    assert "- distance: **47.9** mm as printed, 0 mm as corrected; it must be 0." in page
    assert (
        "- share: **undefined** as printed, infinite as corrected; it must be at least 0.5." in page
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (47.936, "47.9"),
        (0.00069913, "0.000699"),
        (1.2e-13, "0"),
        (-1e-9, "0"),
        (float("inf"), "infinite"),
        (float("nan"), "undefined"),
        (8, "8"),
        (1234.5, "1234"),
    ],
)
def test_numbers_for_a_table(value, text):
    assert number_text(value) == text


def test_pages_are_written_for_the_book_to_include(tmp_path):
    ledger.write_pages(tmp_path / "new" / "folder", EFFECTS)
    for name, page in (("equations", index_page), ("errata", errata_page)):
        assert (tmp_path / "new" / "folder" / f"{name}.md").read_text(encoding="utf-8") == page(
            LEDGER, EFFECTS
        )
        assert f"_build/generated/{name}.md" in (ROOT / "book" / f"{name}.md").read_text(
            encoding="utf-8"
        )


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"at_least": 1.5}, "at least 1.5"),
        ({"at_most": 0.02}, "at most 0.02"),
        ({"at_most": 1e-12}, "0"),
        ({"at_least": 0.5, "at_most": 2.0}, "0.5 to 2"),
        ({"at_least": 1.0, "at_most": 1.0}, "1"),
    ],
)
def test_what_an_effect_must_be_in_words(limits, said):
    effect = ledger.Effect("20", "Distance.", "mm", 12.7, 0.05, **limits)
    assert ledger.effect_item(effect) == (
        f"- Distance.: **12.7** mm as printed, 0.05 mm as corrected; it must be {said}."
    )
