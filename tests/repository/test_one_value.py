"""One quantity, one value: what the paper's method with two cameras does at Table 1's poses is a row of
the scoreboard, over many draws. A page that draws once again says that it is its own draw, and
quotes the row.
"""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Chapter -> the names of its own draw, as its text quotes them or a table shows them, and the rows
# that it has to quote beside them.
OWN_DRAWS = {
    "01_structure": (("pair_deg",), ("8b",)),
    "07_calibration": (("true_E_t_mm", "E_t_mm", "true_E_beta_deg"), ("5", "5j", "7", "7b")),
    "08_pose": (("ratio_E_t_mm", "ratio_E_alpha_deg"), ("5j", "6b", "7b", "8k")),
    "09_table1": (("ratio_E_t_mm", "ratio_E_alpha_deg"), ("5j", "6b", "7b", "8k")),
    "10_estimators": (("paper_pair_paper_E_t",), ("5j",)),
    "11_master_slave": (("rms_mm", "rms_deg"), ("5j", "6b")),
}
# These measure Table 1's poses by the paper's method as well, and it is another quantity.
OTHER_QUANTITY = {
    "02_workspace": "poses of another workspace",
    "03_background": "through this chapter's background",
    "04_kalman": "through this chapter's windows",
    "05_markers": "through this chapter's search for markers",
    "06_matching": "through this chapter's matching",
    "12_force_feedback": "three cameras",
}
MEASURES = re.compile(r"\breplicat(?:e|e_table1|ion_errors)\(")


def cells(chapter, kind):
    notebook = json.loads((ROOT / "notebooks" / f"{chapter}.ipynb").read_text(encoding="utf-8"))
    return ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == kind]


def test_every_chapter_that_measures_table_1_is_known():
    measuring = {
        path.stem
        for path in ROOT.glob("notebooks/*.ipynb")
        if any(MEASURES.search(code) for code in cells(path.stem, "code"))
    }
    assert measuring <= set(OWN_DRAWS) | set(OTHER_QUANTITY)


@pytest.mark.parametrize("chapter", OWN_DRAWS)
def test_an_own_draw_says_so_and_quotes_the_row(chapter):
    names, rows = OWN_DRAWS[chapter]
    code, texts = cells(chapter, "code"), cells(chapter, "markdown")
    for name in names:
        quoting = [text for text in texts if re.search(rf"`{name}\b", text)]
        assert quoting, name
        assert all("own draw" in text for text in quoting), name
        assert all(re.search(r"\*The\* value|values? to quote", text) for text in quoting), name
    for no in rows:
        assert any("scoreboard.quoted(" in cell and no in cell for cell in code), no
        quoting = [text for text in texts if f"`board_{no}`" in text]
        assert quoting, no
        assert all(f"<claim-{no}>" in text for text in quoting), no


@pytest.mark.parametrize("page", sorted((ROOT / "book").glob("*.md")), ids=lambda path: path.stem)
def test_no_page_has_the_value_typed_by_hand(page):
    """E_t or an angle beside the paper's method, as a number in the text of a page."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for no in ("5", "5j", "6", "6b", "7", "7b", "8", "8k"):
        for found in re.finditer(rf"<claim-{no}>", text):
            around = text[max(found.start() - 40, 0) : found.end() + 5]
            assert not re.search(r"0\.\d+ (?:mm|deg)", around), around
