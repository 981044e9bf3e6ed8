"""The numbers that pages print, ``numbers.json``: those of the board, the protocol, the ranges, the
shipped tables, the chapters, the course and this build. `workbench.pages.template` puts them into the pages.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from trinolab.files.outputs import write_whole

from .. import provenance
from ..imports import our_files
from ..studies import answer
from ..studies.protocol import KINDS, can_show, load_claims, load_deviations, load_trials
from ..studies.scoreboard import essential_rows
from . import article
from .chapters import chapters
from .course import course
from .howmade import commit_said
from .ranges import decisive, flatness, ranges, rates
from .sensitivity import records, sensitivity

ROOT = Path(__file__).resolve().parents[3]
VERDICTS = ("match", "differs", "undecided", "cannot be tested", "met", "missed")
PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "pandas")
FILES = (
    "data/claims.toml",
    "data/claims_results.csv",
    "data/sensitivity.csv",
    "environment.txt",
)


def write_numbers(build: Path) -> dict[str, Any]:
    """Numbers of all pages, which are written into ``generated`` of the folder ``_build``."""
    table = article.checked(read_board(build / "scoreboard.csv"))
    facts = answer.facts()
    numbers = {
        **board(table),
        **protocol(),
        **article.values(facts),
        "cause": answer.sentence(facts),
        "ranges": (found := ranges(table)),
        "decisive": decisive(found),
        "flatness": flatness(),
        "rates": rates(),
        "sensitivity": sensitivity(read_sensitivity()),
        "chapters": chapters(build / "executed", build / "generated" / "hour"),
        "course": course(),
        "software": software(build / "seconds.json"),
    }
    write_whole(build / "generated" / "numbers.json", json.dumps(numbers, indent=1) + "\n")
    return numbers


def read_board(path: Path) -> pd.DataFrame:
    """The stored board, its numbers as numbers."""
    numbers = ("ours", "low", "high", "n")
    return pd.read_csv(
        path, dtype={"no": str}, keep_default_na=False, na_values={name: [""] for name in numbers}
    )


def read_sensitivity() -> pd.DataFrame:
    """The stored table of what each assumption is worth."""
    path = ROOT / "data" / "sensitivity.csv"
    return pd.read_csv(path, keep_default_na=False, na_values=[""])


def board(table: pd.DataFrame) -> dict[str, Any]:
    """Rows of the board by number, the essential ones by question, and the numbers of each kind's rows by
    verdict.
    """
    rows = {row["no"]: row for row in records(table)}
    answers = {one.question: one.answer for one in load_claims() if one.answer}
    questions = []
    for question, some in essential_rows(table).items():
        verdicts = set(some["verdict"])
        questions.append(
            {
                "question": question,
                "answer": answers[str(question)],
                "verdict": verdicts.pop() if len(verdicts) == 1 else "mixed",
                "rows": [rows[no] for no in some["no"]],
            }
        )
    essential = {row["no"] for one in questions for row in one["rows"]}
    for no, row in rows.items():
        row["essential"] = no in essential
        row["of_paper"] = row["kind"] != KINDS[-1]
    kinds = []
    for kind in KINDS:
        some = table[table["kind"] == kind]
        order = dict.fromkeys([*VERDICTS, *some["verdict"]])
        verdicts = {name: list(some["no"][some["verdict"] == name]) for name in order}
        verdicts = {name: nos for name, nos in verdicts.items() if nos}
        kinds.append({"kind": kind, "count": len(some), "verdicts": verdicts})
    return {"board": rows, "questions": questions, "kinds": kinds}


def protocol() -> dict[str, Any]:
    """Trials, claims and log of the protocol."""
    trials = load_trials()
    return {
        "trials": {name: one._asdict() for name, one in trials.items()},
        "claims": [{**asdict(one), "can_show": can_show(one, trials)} for one in load_claims()],
        "deviations": [one._asdict() for one in load_deviations()],
    }


def software(seconds: Path) -> dict[str, Any]:
    """Versions, machine, times and hashes of this build."""
    meta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    took = json.loads(seconds.read_text(encoding="utf-8")) if seconds.exists() else {}
    return {
        "authors": meta["author"][0]["name"],
        "name": meta["name"],
        "version": meta["version"],
        "license": meta["license"].rsplit("/")[-1],
        "commit": provenance.commit() or "unknown: no clone",
        "commit_shown": commit_said(),
        "python": platform.python_version(),
        "packages": ", ".join(f"{name} {version(name)}" for name in PACKAGES),
        "jupyter_book": version("jupyter-book"),
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "minutes": sum(took.values()) / 60,
        "files": {name: sha256(ROOT / name) for name in FILES},
        "code": provenance.hash_code(our_files()),
        "data": provenance.surroundings([])["its data"],
    }


def processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    match = re.search(r"model name\s*:\s*(.+)", text)
    return match[1] if match else platform.machine()


def sha256(path: Path) -> str:
    """The hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
