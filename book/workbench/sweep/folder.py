"""The folder of a sweep: its manifest, its finished runs as they come, its table and figure.

``manifest.json`` says what the sweep is and what its results were made from; ``runs.jsonl`` has a
line for each run that is finished, so that nothing is lost whenever the sweep stops; ``table.csv``
and ``figure.png`` appear at the end.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from trinolab.files.inputs import read_csv, read_json
from trinolab.files.journal import Journal, locked
from trinolab.files.outputs import write_together, write_whole

from .outcome import Outcome

MANIFEST = "manifest.json"
RUNS = "runs.jsonl"
TABLE = "table.csv"
FIGURE = "figure.png"
NOTEBOOKS = "notebooks"

log = logging.getLogger("trinolab")


class Identity(NamedTuple):
    """What tells one sweep from another.

    Attributes
    ----------
    what : str
        The notebook's or the function's name.
    parameters : list of str
    grid : str
        A hash of all settings.
    runs : int
    """

    what: str
    parameters: list[str]
    grid: str
    runs: int


class SweepFolder:
    """The folder of one sweep, for one process at a time. Those of another sweep, or of something
    else, are refused.

    The runs of the same sweep interrupted are taken up, unless what they were made from has
    changed: then they are dropped, and that is said. A line that was cut off is dropped as well,
    see `Journal`.

    Parameters
    ----------
    path : path
        Made if it is not there.
    identity : Identity
    made_from : mapping of str to str
        A hash for each thing that the results depend on, named as a sentence would name it.
    about : mapping
        What else the manifest says.

    Raises
    ------
    ValueError
        Names the folder: another sweep's, no sweep's, in use, or one that cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        identity: Identity,
        made_from: Mapping[str, str],
        about: Mapping[str, Any],
    ) -> None:
        self.path = Path(path)
        self._runs = identity.runs
        _check_place(self.path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ValueError(f"{path}: cannot be written ({error.strerror})") from None
        with ExitStack() as opened:
            opened.enter_context(locked(self.path))
            self._drop_stale(identity, dict(made_from))
            manifest = {**identity._asdict(), "made_from": dict(made_from), **about}
            write_whole(self.path / MANIFEST, json.dumps(manifest, indent=2, default=repr) + "\n")
            self._lines = opened.enter_context(self._kept_lines())
            self.done = self._finished()
            self._open = opened.pop_all()

    def __enter__(self) -> SweepFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def add(self, number: int, outcome: Outcome) -> None:
        """One more run; it is with the system when this returns. Raises ValueError if it cannot be
        written.
        """
        try:
            if outcome.notebook:
                (self.path / NOTEBOOKS).mkdir(exist_ok=True)
                write_whole(self.path / NOTEBOOKS / f"{number:06d}.ipynb", outcome.notebook)
        except OSError as error:
            raise ValueError(
                f"{self.path / NOTEBOOKS}: cannot be written ({error.strerror})"
            ) from None
        self._lines.add_line(json.dumps({"run": number, **outcome._replace(notebook="")._asdict()}))
        self.done[number] = outcome._replace(notebook="")

    def kept(self) -> int:
        """How many runs the file has: one more than `done`, if an interruption came in the middle
        of `add`.
        """
        return len(self._finished())

    def finish(self, found: pd.DataFrame, figure: bytes) -> None:
        """Write the table and its figure. Raises ValueError if they cannot be written."""
        write_together(
            {
                self.path / TABLE: found.to_csv(index=False, lineterminator="\n"),
                self.path / FIGURE: figure,
            }
        )

    def _kept_lines(self) -> Journal:
        """The lines of the finished runs."""
        return Journal(
            self.path / RUNS, "", lambda _, line: _read_line(line, self._runs) is not None
        )

    def _finished(self) -> dict[int, Outcome]:
        """The runs that have a whole line."""
        return dict(filter(None, (_read_line(line, self._runs) for line in self._lines.lines())))

    def _drop_stale(self, identity: Identity, made_from: dict[str, str]) -> None:
        """Drop the finished runs of this sweep if what they were made from has changed; refuse
        those of another.
        """
        if not (self.path / MANIFEST).exists():
            return
        before = _manifest(self.path)
        if {name: before.get(name) for name in Identity._fields} != identity._asdict():
            of = ", ".join(map(str, before.get("parameters") or []))
            raise ValueError(
                f"{self.path}: holds another sweep ({before.get('what')} over {of}; {before.get('runs')} "
                "runs); name another folder"
            )
        old = before.get("made_from", {})
        changed = [name for name in {**old, **made_from} if old.get(name) != made_from.get(name)]
        if not changed:
            return
        with self._kept_lines() as stale:
            log.warning(
                "%s: %s changed since; %d finished runs are stale and are done again",
                self.path,
                f"{' and '.join(changed)} {'has' if len(changed) == 1 else 'have'}",
                len(stale.lines()),
            )
            stale.remove()
        for name in (TABLE, FIGURE):
            (self.path / name).unlink(missing_ok=True)
        shutil.rmtree(self.path / NOTEBOOKS, ignore_errors=True)


def read_sweep(folder: str | Path) -> pd.DataFrame:
    """The table of a finished sweep, as `runs.sweep` returned it. ValueError if there is none."""
    manifest = _manifest(Path(folder))
    if not (path := Path(folder) / TABLE).exists():
        raise ValueError(
            f"{folder}: the sweep is not finished; the command that began it goes on with it"
        )
    table = read_csv(path, skipinitialspace=False)
    if "error" not in table:
        raise ValueError(f"{path}: column 'error' is missing")
    # without a failure it is read as numbers
    table["error"] = table["error"].astype(object).fillna("").astype(str)
    table.attrs["parameters"] = manifest.get("parameters", [])
    if manifest.get("verdicts"):
        table.attrs["verdicts"] = manifest["verdicts"]
    return table


def _check_place(path: Path) -> None:
    """Refuse a place that is no folder, or a folder with something else in it."""
    if path.exists() and not path.is_dir():
        raise ValueError(f"{path}: expected a folder for the sweep, got a file")
    if (
        path.is_dir()
        and not (path / MANIFEST).exists()
        and any(entry.name[0] != "." for entry in path.iterdir())
    ):
        raise ValueError(f"{path}: holds something that is no sweep; name another folder")


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    try:
        content = read_json(path)
    except ValueError:
        raise ValueError(f"{path}: expected the manifest of a sweep") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected the manifest of a sweep")
    return content


def _read_line(line: str, runs: int) -> tuple[int, Outcome] | None:
    """The number and the outcome of one of so many runs; None for a damaged line."""
    try:
        entry = json.loads(line)
        number = int(entry.pop("run"))
        outcome = Outcome(**entry)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    return (number, outcome) if number in range(runs) else None
