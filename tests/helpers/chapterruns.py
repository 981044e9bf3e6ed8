"""The chapters at the ends of the ranges that their parameters have, and what must hold there: of
what they glue, and of the words that their text has typed beside it.
"""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

from chapters import is_study

from workbench.course.editions import GLUED
from workbench.sweep.notebook import read_notebook

ERRORS = {"E_t_mm", "E_alpha_deg", "E_beta_deg", "E_gamma_deg"}
# A range ends the comment behind a parameter: "0.002 to 0.2", "paper or coded".
RANGE = re.compile(r"^(\w+) = .*#.*?(\S+) (?:to|or) (\S+)$", re.M)
COMPARATIVES = re.compile(
    r"\b(more|less|larger|smaller|better|worse|(?<!at )most|twice|only|exceeds?|fewer|higher|lower"
    r"|farther|nearer|faster|slower|hardly|mostly|nearly|raises|lowers|helps|grows|falls)\b"
)
SENTENCES = re.compile(r"(?<=[.?!])\s+|\n")
NO_NUMBER = re.compile(r" (?:-?(?:nan|inf)|-0(?:\.0+)?)%?$")
# What makes a chapter small; a new chapter needs an entry.
SMALL = {
    "01_structure": {"frames": 6, "row_step": 20},
    "02_workspace": {"step_deg": 26.0, "row_step": 20},
    "03_background": {"spacing": 32, "cameras": 1, "row_step": 20},
    "04_kalman": {"moving": 6, "motions": 1},
    "05_markers": {"frame_step": 29, "row_step": 20},
    "05b_centroid": {"frame_step": 29, "draws": 4},
    "06_matching": {"instants": 6, "row_step": 20},
    "07_calibration": {"draws": 3, "row_step": 20},
    "07b_accuracy": {},
    "08_pose": {"draws": 10, "row_step": 20},
    "09_table1": {"row_step": 20, "tables": 100},
    "09b_causes": {"tables": 100},
    "10_estimators": {"row_step": 20, "turns": 2},
    "10b_trust": {"row_step": 20},
    "11_master_slave": {"share": 0.42, "row_step": 20},
    "11b_delay": {"share": 0.42},
    "12_force_feedback": {"share": 0.1, "row_step": 20},
    "12b_wall": {"share": 0.1},
}
# By chapter, cell and word: what makes a typed comparative true, of the glued values or as a fact.
TYPED = tomllib.loads((Path(__file__).parent / "typedwords.toml").read_text(encoding="utf-8"))


def _literal(text):
    try:
        return ast.literal_eval(text)
    except ValueError:
        return text


@cache
def settings(path):
    """A chapter's parameters at the low and at the high ends of their ranges; the latter with
    another seed.
    """
    (cell,) = (
        one
        for one in read_notebook(path).cells
        if "parameters" in one.metadata.get("tags", []) and one.cell_type == "code"
    )
    ends = {name: (_literal(low), _literal(high)) for name, low, high in RANGE.findall(cell.source)}
    seed = {"seed": 1} if "\nseed = " in cell.source else {}
    low, high = ({name: pair[k] for name, pair in ends.items()} for k in (0, 1))
    return {"low": low, "high": {**high, **seed}}


def check_results(name, results):
    """A lesson checks the errors of the whole chain; a study need not do it again."""
    missing = ERRORS - results.keys()
    assert not missing or is_study(name)
    for error in ERRORS - missing:
        assert isinstance(results[error], float), error
        assert results[error] >= 0, error


def typed_words(notebook):
    """The comparatives that stand typed in a sentence with a glued value, as cell and word."""
    return {
        f"{cell.id} {word}"
        for cell in notebook.cells
        if cell.cell_type == "markdown"
        for sentence in SENTENCES.split(cell.source)
        if GLUED.search(sentence)
        for word in COMPARATIVES.findall(GLUED.sub("", sentence))
    }


def false_sentences(name, notebook, parameters, results):
    """What of a chapter's text contradicts what it has glued: numbers that are none, and typed words
    and verdicts that are not true.
    """
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    shown = {f"{one} is {results[one]:{form}}" for one, form in GLUED.findall(text)}
    no_numbers = sorted(one for one in shown if NO_NUMBER.search(one))
    values = {**parameters, **results, "glued": results}
    false = [
        f"{what}: not {why}"
        for what, why in TYPED[name].items()
        if not why.startswith("always: ") and not eval(why, values)
    ]
    return no_numbers + false
