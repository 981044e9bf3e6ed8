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


@cache
def functions_of(file):
    """The names of a file's functions."""
    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    return {node.name for node in body if isinstance(node, ast.FunctionDef)}


def text_of(chapter):
    """The text cells of a chapter."""
    cells = nbformat.read(ROOT / "notebooks" / f"{chapter}.ipynb", as_version=4).cells
    return "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


# --- the ledger and the code


def test_there_are_27_equations_in_their_order():
    assert [entry.no for entry in EQUATIONS] == [str(k) for k in range(1, 28)]
    assert len({entry.no for entry in LEDGER}) == len(LEDGER)


@each_entry
def test_all_that_the_ledger_names_is_there(entry):
    assert entry.functions
    assert entry.tests
    assert entry.what.endswith(".")
    assert entry.printed != entry.corrected
    assert entry.no.isdigit() or entry.no == f"Sect. {entry.section}"
    text = text_of(entry.chapter)
    for dotted in entry.functions:
        module, _, name = dotted.rpartition(".")
        function = getattr(importlib.import_module(module), name)
        assert function.__module__ == module
        summary = function.__doc__.partition("\n\n")[0]
        assert not entry.no.isdigit() or entry.no in equations_named(summary), summary
    for test in entry.tests:
        file, _, name = test.partition("::")
        assert name.startswith("test_")
        assert name in functions_of(file)
    assert not entry.no.isdigit() or rf"\tag{{{entry.no}}}" in text


def test_what_is_not_as_printed_has_an_effect_and_every_effect_an_entry():
    assert (
        {entry.no for entry in LEDGER if entry.status != "as printed"}
        <= set(ERRATA)
        <= {e.no for e in LEDGER}
    )


@pytest.mark.parametrize(
    ("line", "numbers"),
    [
        ("Cones (Eq. 1-3).", "1 2 3"),
        ("Points (Eq. 20, 22).", "20 22"),
        ("All (Eq. 1, 3-5, 9).", "1 3 4 5 9"),
        ("The workspace (Sect. 3.2).", ""),
        ("Nothing here.\n\nBut below (Eq. 5).", ""),
        ("Twenty (Eq. 20).", "20"),
    ],
)
def test_numbers_in_a_docstring(line, numbers):
    assert equations_named(line) == set(numbers.split())


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
    tests = ("tests/t.py::test_t",)
    wanted = Entry("1", "3.2", "x", "misprint", "y", "Wrong.", ("a.b",), tests, "02_workspace")
    assert load(BOTH)[0] == wanted


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("what =", "waht =", "entry 1: 'what' is missing"),
        ("what =", 'note = "a"\nwhat =', "entry 1: 'note' is not a field"),
        ('"misprint"', '"wrong"', "Eq. 1: expected a status of"),
        ('"misprint"', '"as printed"', "Eq. 1: expected a corr"),
        ('corrected = "y"', 'corrected = ""', "Eq. 1: expected a corrected form"),
        ('["a.b"]', "[1]", "functions: expected a list of strings"),
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
    places = re.findall(r"^\(equation-(\d+)\)=$", page, flags=re.MULTILINE)
    assert places == [str(k) for k in range(1, 28)]
    for entry in EQUATIONS:
        text = section(page, entry.no)
        assert f"<equation-{entry.no}>`" in page.splitlines()[0], "no link to jump"
        for said in (
            f"## {entry.name}\n",
            entry.corrected or entry.printed,
            rf"\tag{{{entry.no}}}",
        ):
            assert said in text
        assert all(f".{name.rpartition('.')[2]} <{name}>`" in text for name in entry.functions)
    assert "{ref}`ambiguous <erratum-eq-20>`" in section(page, 20)
    # to the equation where the chapter has a label
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


def test_the_errata_have_a_place_for_every_link_of_the_index():
    everything = {entry.no: EFFECTS["20"] for entry in LEDGER}
    links = set(re.findall(r"<(erratum-[\w-]+)>", index_page(LEDGER, everything)))
    places = re.findall(r"^\((erratum-[\w-]+)\)=$", errata_page(LEDGER, everything), re.MULTILINE)
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
    assert page.count(r"\tag{20}") == page.count(r"\begin{equation*}") == 2
    assert page.index("As printed:") < page.index("As we use it:")
    same = replace(EQUATIONS[19], status="as printed", corrected="")  # one form alone
    assert errata_page([same], EFFECTS).count(r"\begin{equation*}") == 1
    for effect in EFFECTS["20"]:
        assert ledger.effect_item(effect) in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (47.936, "47.9"),
        (0.00069913, "0.000699"),
        (-1e-9, "0"),
        (float("inf"), "infinite"),
        (float("nan"), "undefined"),
        (8, "8"),
        (1234.5, "1234"),
    ],
)
def test_numbers_for_a_table(value, text):
    assert number_text(value) == text


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (1.5, None, "at least 1.5"),
        (None, 0.02, "at most 0.02"),
        (None, 1e-12, "0"),
        (0.5, 2.0, "0.5 to 2"),
        (1.0, 1.0, "1"),
    ],
)
def test_what_an_effect_must_be_in_words(low, high, said):
    limits = {"at_least": low, "at_most": high}
    given = {name: value for name, value in limits.items() if value is not None}
    effect = Effect("20", "Distance.", "mm", 12.7, 0.05, **given)
    wanted = f"- Distance.: **12.7** mm as printed, 0.05 mm as corrected; it must be {said}."
    assert ledger.effect_item(effect) == wanted
