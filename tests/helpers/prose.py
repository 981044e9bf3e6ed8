"""Print what the style sheet, `book/style.md`, advises against in the pages that follow it; the exit
code is 1 if there is any. Code, formulas and the targets of links are not read.
"""

import re
import sys
from pathlib import Path

import nbformat

ROOT = Path(__file__).resolve().parents[2]
# files and patterns; a chapter joins when it has been edited
COVERED = (
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "book/*.md",
    "book/decisions/*.md",
    "book/workbench/pages/article.md.j2",
    "notebooks/*.ipynb",
)
UNITS = r"\d (?:mm|µm|px|ms|s|deg|%|[kMG]B)"
PARTS = "(?:axis|camera|cell|chapter|frame|image|instant|marker|pixel|row|run|step|view)"
# what is advised against, as a regular expression in which a blank is any white space -> what to write
VOCABULARY = {
    rf"{UNITS} an? {PARTS}\b": "per",
    rf"\b(?:an?|one) \w+ an? {PARTS}(?=[,.;:)])": "per",
    r"\bin place of\b": "instead of",
    r"\bin the (?:mean|median)(?=[,.;:)])": "on average; the median is",
    r"\b(?:is|are|was|were|be) off by\b": "the error is",
    r"\d (?:mm|µm|px|ms|deg|%) off\b": "an error of",
    r"\b(?:holds?|held)(?: \w+){0,3} against\b": "compare with",
    r"\b(?:is|are|was|were|be) told (?:from|nothing)\b": "distinguish from; without a prior",
    r"\b(?:by|for|from|to|with) who\b": "for readers who",
    r"\bwhoever\b": "anyone who",
    r"\b(?:allow|enable|permit)s? to\b": "can, lets us",
    r"\bbelongs? into\b": "belongs in",
    r"\b(?:is|are) called like\b": "is named after",
    r"\banew\b": "again",
}
SKIPPED = r"^```.*?^```$|`+[^`]+`+|\$[^$]+\$|\]\([^)]*\)|https?://\S+|^---\n.*?^---$"


def texts(path):
    """The text of a page, or those of a notebook's markdown cells, with their place."""
    if path.suffix != ".ipynb":
        return {str(path): path.read_text(encoding="utf-8")}
    cells = nbformat.read(path, as_version=4).cells
    return {
        f"{path}, cell {number}": cell.source
        for number, cell in enumerate(cells)
        if cell.cell_type == "markdown"
    }


def faults(text):
    """The faults of a text: line, what is written, and what to write."""
    plain = re.sub(
        SKIPPED, lambda code: "\n" * code[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL
    )
    return [
        (plain.count("\n", 0, found.start()) + 1, " ".join(found[0].split()), advice)
        for pattern, advice in VOCABULARY.items()
        for found in re.finditer(pattern.replace(" ", r"\s+"), plain, flags=re.IGNORECASE)
    ]


def main():
    """Print the faults of the pages that are covered, and return how many there are."""
    lines = [
        f"{place}:{line}: {written!r}: {advice}"
        for pattern in COVERED
        for path in sorted(ROOT.glob(pattern))
        for place, text in texts(path).items()
        for line, written, advice in sorted(faults(text))
    ]
    print("\n".join(lines) or "prose: nothing that the style sheet advises against")
    return len(lines)


if __name__ == "__main__":
    sys.exit(bool(main()))
