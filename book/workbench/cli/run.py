"""What ``trinolab run`` does: in one folder the commands from the calibration to the film, from the
first whose output is missing.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

from trinolab.files.inputs import read_toml

from .arguments import parser

PROJECT = "project.toml"
RIG = "rig.toml"
# the options that preflight and track have in common
SHARED = ("rig", "handle", "video", "fps", "timestamps", "bits")


class Step(NamedTuple):
    """A command: its words, without the program's name, and the files that it writes."""

    words: list[str]
    outputs: tuple[str, ...]


def run(
    folder: str | Path, command: Callable[[list[str]], int], on_step: Callable[[str], object]
) -> int:
    """Run the commands that are left to do in a folder, and return the largest exit code.

    Parameters
    ----------
    folder : path
        A recording folder. Where it lacks a rig, a handle or videos called as the rig's cameras,
        its ``project.toml`` has them: the keys are options of preflight and track, and the table
        ``calibrate`` has those of calibrate.
    command : callable
        Takes the words of a command line and returns the exit code. The first that is above 1 is
        the last.
    on_step : callable
        Takes each command line before it runs.

    Raises
    ------
    ValueError
        If there is no such folder, or the project file says nothing that can be run.
    """
    if not Path(folder).is_dir():
        raise ValueError(f"{folder}: no such folder")
    codes = [0]
    with chdir(folder):
        left = _left(list(steps()))
        for step in left:
            parser().parse_args(step.words)  # what is wrong is said before the first one begins
        for step in left:
            on_step(shlex.join(["trinolab", *step.words]))
            codes.append(command(step.words))
            if codes[-1] > 1:
                break
    return max(codes)


def steps() -> Iterator[Step]:
    """The steps that this folder asks for, in their order."""
    project = read_toml(PROJECT) if Path(PROJECT).exists() else {}
    board = project.pop("calibrate", {})
    if unknown := project.keys() - set(SHARED):
        raise ValueError(
            f"{PROJECT}: expected {', '.join(SHARED)} and a table calibrate, got {min(unknown)}"
        )
    if not isinstance(board, dict):
        raise ValueError(f"{PROJECT}: calibrate: expected a table, got {board!r}")
    if "rig" in project and board:
        raise ValueError(f"{PROJECT}: expected a rig or a table calibrate, got both")
    if not ("rig" in project or board or Path(RIG).exists()):
        raise ValueError(
            f"expected {RIG} in the folder, or a {PROJECT} with a rig or a table calibrate; "
            "trinolab run --help shows one"
        )
    if board:
        yield Step(["calibrate", *_options(board), "--out", RIG], (RIG,))
    project = {"rig": RIG, "handle": "handle.toml", **project}
    footage = [*([] if "video" in project else ["."]), *_options(project)]
    yield Step(["preflight", *footage, "--out", "preflight.csv"], ("preflight.csv",))
    yield Step(
        ["track", *footage, "--out", "poses.csv", "--overlay", "seen.webm"],
        ("poses.csv", "seen.webm"),
    )
    if Path("truth.csv").exists():
        yield Step(["evaluate", "poses.csv", "truth.csv", "--handle", str(project["handle"])], ())


def _left(every: list[Step]) -> list[Step]:
    """The steps from the first one on that lacks an output; what writes no file is left in any
    case.
    """
    first = next(
        k
        for k, step in enumerate([*every, Step([], ())])
        if not step.outputs or not all(Path(name).exists() for name in step.outputs)
    )
    return every[first:]


def _options(table: Mapping[str, Any]) -> list[str]:
    """The words of a command line that a table of options stands for."""
    words = []
    for name, value in table.items():
        words.append(f"--{name}")
        if isinstance(value, dict):
            words += [f"{key}={path}" for key, path in value.items()]
        else:
            words += map(str, value if isinstance(value, list) else [value])
    return words
