"""First guesses: what a student has predicted before the run, kept beside the answers.

A prediction that was wrong is worth as much as one that was right, as long as it was made. So the
words of an exercise of the kind *predict* are kept when they are first checked, with the time and
with whether numbers stood beside them by then. What is kept is never written over.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from trinolab.files.outputs import write_whole

from .exercise import Exercise, ValueExercise

KEPT = "predictions.json"
LARGEST = 100_000  # bytes


def is_predicted(asked: Exercise) -> bool:
    """Whether an exercise asks for a prediction: words to choose before the run."""
    return isinstance(asked, ValueExercise) and asked.kind == "predict"


def first_guesses(folder: Path) -> dict[str, dict[str, Any]]:
    """The first guesses that are kept in a folder, by the exercises' numbers."""
    path = folder / KEPT
    try:
        if path.is_symlink() or path.stat().st_size > LARGEST:
            return {}
        kept = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(kept, dict):
        return {}
    return {number: guess for number, guess in kept.items() if _is_guess(guess)}


def _is_guess(guess: Any) -> bool:
    return (
        isinstance(guess, dict)
        and isinstance(guess.get("words"), dict)
        and all(isinstance(word, str) for word in guess["words"].values())
        and isinstance(guess.get("at"), str)
        and isinstance(guess.get("before"), bool)
    )


def keep_guess(number: str, words: Mapping[str, str], before: bool, folder: Path) -> dict[str, Any]:
    """Keep a guess, unless there is one already; the one that is kept.

    Parameters
    ----------
    number
        Of the exercise.
    words
        What is predicted, by name.
    before
        Whether none of the numbers that the run gives stood there.
    folder
        Where the answers are. Where it cannot be written nothing is kept.
    """
    kept = first_guesses(folder)
    if number not in kept:
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        kept[number] = {"words": dict(words), "at": now, "before": before}
        with contextlib.suppress(ValueError, OSError):
            write_whole(folder / KEPT, json.dumps(kept, indent=1, sort_keys=True) + "\n")
    return kept[number]
