"""One test of the shipped data sheet measured again, where only what it measures has changed.

    python -m satellites.accept.renew A5 [--workers N]

renews the test's numbers and notes in ``data/accept/raised_40deg.json``, with a note that says when
and with which code; all else stays as `make sheet` has left it. Finished parts are kept: the same
call goes on where an interrupted one has stopped.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from trinolab.datasets import data_path
from trinolab.files.inputs import read_json
from trinolab.files.outputs import write_together
from workbench.provenance import commit

from .command import WORKERS
from .numbers import Answer
from .sheet import plain_row
from .work import RENDERED, TESTS, Source, all_measured, setup_of

KEPT = Path("_build/renewed.jsonl")


def measured_again(source: Source, name: str, kept: Path, workers: int) -> Answer:
    """A test on images of the bench, from its parts."""
    setup = setup_of(source)
    found = all_measured(source, {name: TESTS[name].parts(setup)}, kept, workers)
    return TESTS[name].judge(setup, found.rows[name])


def renewed(content: dict[str, Any], name: str, answer: Answer, by: str) -> dict[str, Any]:
    """A sheet's JSON with another answer to one of its tests; `by` says when and with what it was
    measured.
    """
    rows = [row for row in content["numbers"] if row["test"] != name]
    rows += [plain_row(asdict(number)) for number in answer.numbers]
    notes = content["notes"] | {name: [*answer.notes, f"This test was measured again {by}."]}
    # the sort is stable: within a test the order stays
    return content | {
        "notes": dict(sorted(notes.items())),
        "numbers": sorted(rows, key=lambda row: row["test"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("test", choices=RENDERED)
    parser.add_argument("--workers", type=int, default=WORKERS, help="processes (%(default)s)")
    arguments = parser.parse_args()
    path = data_path("accept", "raised_40deg.json")
    content = read_json(path)
    about = content["about"]
    rig = data_path("rigs", f"{about['rig']}.toml")
    handle = data_path("handles", f"{about['handle']}.toml")
    source = Source(str(rig), str(handle), about["poses"], about["seed"])
    answer = measured_again(source, arguments.test, KEPT, arguments.workers)
    by = f"on {datetime.now(UTC).date()}, with the code of commit {(commit() or 'unknown')[:7]}"
    text = json.dumps(renewed(content, arguments.test, answer, by), indent=1, ensure_ascii=False)
    write_together({path: text + "\n"})


if __name__ == "__main__":
    main()
