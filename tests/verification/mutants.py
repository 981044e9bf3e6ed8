"""The solutions of the exercises with one slip of the pen each: the graders refuse them."""

from mutants import HARMLESS, mutants, survives
from solutions import FUNCTIONS


def report(arguments) -> None:
    print(
        "wrong versions of each solution; refused; taken for right and named with the reason; not named"
    )
    made = refused = unnamed = 0
    for asked in FUNCTIONS:
        all_words = [(words, survives(asked, text)) for words, text in mutants(asked)]
        left = [words for words, taken in all_words if taken]
        strange = [words for words in left if (asked.number, words) not in HARMLESS]
        made += len(all_words)
        refused += len(all_words) - len(left)
        unnamed += len(strange)
        print(
            f"{asked.number} {len(all_words):4d} {len(all_words) - len(left):4d} {len(left):3d} {len(strange):3d}"
        )
        for words in strange:
            print(f"      not named: {words}")
    print(f"all   {made:4d} {refused:4d} {made - refused:3d} {unnamed:3d}")
    assert unnamed == 0, "a wrong solution is taken for right"
