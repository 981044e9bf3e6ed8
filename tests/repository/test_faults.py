"""The catalogue of faults: what a person may do wrong, and what each command answers.

A mistake is answered by one line that names the file and the field, exit code 2, and no file that
was not there before; what is the world's (a dark camera, a frozen one) is answered by a status.
Interruptions and full disks: test_stopped.
"""

import os
import shlex
import shutil

import numpy as np
import pytest
from faultcatalogue import FAULTS, NO_MISTAKE
from healthy import (
    BOARDS,
    CAPTURE,
    EVALUATE,
    FOLLOW,
    MEASURE,
    RENDER,
    SWEEP,
    TRACK,
    VIDEOS,
    contents,
    make_healthy,
    run,
    true_path,
)

from trinolab.evaluation import FAR_DEG, FAR_MM
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.metrics import geodesic_deg
from workbench.studies import scoreboard
from workbench.sweep import engines

COUNT = 6  # instants of the recording


# --- a healthy folder


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """All that the commands read: a rig, a handle, a recording, the same as videos, poses, views of
    a board.
    """
    root = tmp_path_factory.mktemp("healthy")
    make_healthy(root, COUNT)
    return root


@pytest.fixture
def folder(healthy, tmp_path, monkeypatch):
    """The working folder: a copy of the healthy one."""
    shutil.copytree(healthy, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "line",
    [TRACK, VIDEOS, MEASURE, EVALUATE, RENDER, FOLLOW, CAPTURE, BOARDS, SWEEP],
    ids=lambda line: " ".join(shlex.split(line)[:2]),
)
def test_what_is_healthy_is_taken(line):
    assert run(line) == 0


@pytest.mark.parametrize(("spoil", "line", "message"), FAULTS.values(), ids=FAULTS)
def test_a_fault_costs_one_line_and_no_file(folder, spoil, line, message, capfd, monkeypatch):
    if "locked" in line and os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    monkeypatch.setattr(scoreboard, "CHECKS", {})  # a mistake is found before anything is computed
    monkeypatch.setattr(engines, "CONNECT_S", 1.0)  # of a cluster that never answers
    spoil()
    before = contents(folder)
    assert run(line) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n"), err[-1:]) == ("", 1, "\n")
    assert err.startswith("trinolab")
    assert message in err
    assert contents(folder) == before


# --- no mistake: what cameras see is answered by a status, or converted


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("line", [TRACK, MEASURE], ids=["track", "measure"])
@pytest.mark.parametrize(("spoil", "statuses"), NO_MISTAKE.values(), ids=NO_MISTAKE)
def test_what_cameras_see_is_no_mistake(spoil, statuses, line):
    spoil()
    assert run(line) == 0
    table, truth = read_poses("poses.csv"), true_path(COUNT)
    assert len(table) == COUNT
    # alone, an instant of so small images may be lost
    if statuses == {"lost"} or (statuses and line == TRACK):
        assert set(table["status"]) == statuses
    for frame, T in poses_by_frame(table[table["status"] == "measured"]).items():
        away = np.linalg.norm(T.translation - truth[frame].translation)
        assert away < FAR_MM
        assert geodesic_deg(T, truth[frame])[0] < FAR_DEG


def test_the_catalogue_is_long_enough():
    assert len(FAULTS) + len(NO_MISTAKE) >= 40
