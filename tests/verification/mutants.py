"""The solutions of the exercises with one slip of the pen each: the graders refuse them."""

import pandas as pd
from mutants import HARMLESS, mutants, survives
from solutions import FUNCTIONS


def report(arguments) -> bool:
    """Whether no wrong solution is taken for right, but those that are named with the reason."""
    rows, strange = [], []
    for asked in FUNCTIONS:
        all_words = [(words, survives(asked, text)) for words, text in mutants(asked)]
        left = [(asked.number, words) for words, taken in all_words if taken]
        strange += [one for one in left if one not in HARMLESS]
        rows.append((asked.number, len(all_words), len(left)))
    table = pd.DataFrame(rows, columns=["exercise", "wrong versions", "taken for right"])
    print(table.to_string(index=False))
    print("of these not named:", strange or "none")
    return not strange
