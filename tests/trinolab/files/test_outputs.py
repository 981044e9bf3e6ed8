"""A file appears whole or not at all."""

import os
import re
import stat

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from satellites.bags.bags import write_bag
from trinolab.files import outputs
from trinolab.files.outputs import (
    check_parent,
    check_target,
    table_text,
    write_table,
    write_together,
    write_whole,
)
from trinolab.files.poses import pose_table, read_poses, write_poses, write_tum
from trinolab.files.recording import read_timestamps
from trinolab.files.recording_writer import begin, finish, partial_of
from trinolab.pose import Pose


def only(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def path(tmp_path):
    write_whole(tmp_path / "p.csv", "old")
    return tmp_path / "p.csv"


def test_written_file_is_for_everyone_to_read(path):
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert only(path.parent) == ["p.csv"]


@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (OSError(28, "No space left on device"), ValueError),
        (KeyboardInterrupt("No space left on device"), KeyboardInterrupt),
    ],
)
def test_failed_write_leaves_the_old_file(path, monkeypatch, failure, raised):
    def fail(*_):
        raise failure

    monkeypatch.setattr(outputs.os, "replace", fail)
    with pytest.raises(raised, match="No space left on device"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert only(path.parent) == ["p.csv"]


def test_disk_that_fills_up_leaves_the_old_file(path):
    resource = pytest.importorskip("resource", reason="limits of a process are set as POSIX does")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3, limit[1]))
    try:
        with pytest.raises(ValueError, match=r"p\.csv: cannot be written \(File too large\)"):
            write_whole(path, "new text")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert path.read_text() == "old"
    assert only(path.parent) == ["p.csv"]


def test_link_stays_a_link(path):
    link = path.with_name("link.csv")
    link.symlink_to("p.csv")
    write_whole(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"


@pytest.mark.parametrize("write", [check_target, lambda path: write_whole(path, "x")])
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no/p.csv", "no such folder to write into"),
        ("p.csv/p.csv", "no such folder to write into"),
        (".", "cannot be written (a folder or a device is there)"),
        (os.devnull, "cannot be written (a folder or a device is there)"),
    ],
)
def test_impossible_target_is_named(path, write, name, message):
    target = path.parent / name
    with pytest.raises(ValueError, match=re.escape(f"{target}: {message}")):
        write(target)


@pytest.mark.parametrize("make", [check_parent, partial_of, lambda path: write_bag("", path)])
def test_a_folder_that_cannot_be_made_is_named_as_it_was_given(tmp_path, make):
    new = tmp_path / "no" / "new"
    with pytest.raises(ValueError, match=re.escape(f"{new}: no such folder to write into")):
        make(new)


def test_files_that_belong_together_appear_together(tmp_path):
    (tmp_path / "b.png").mkdir()
    with pytest.raises(ValueError, match=r"b\.png: cannot be written"):
        write_together({tmp_path / "a.csv": "text", tmp_path / "b.png": b"bytes"})
    assert only(tmp_path) == ["b.png"]
    write_together({tmp_path / "a.csv": "text", tmp_path / "c.png": b"bytes"})
    assert (tmp_path / "a.csv").read_text() == "text"
    assert (tmp_path / "c.png").read_bytes() == b"bytes"
    assert stat.S_IMODE((tmp_path / "c.png").stat().st_mode) == 0o644


def test_a_table_has_six_digits_and_lines_that_end_alike_everywhere(tmp_path):
    table = pd.DataFrame({"name": ["a", "b"], "mm": [1 / 3, 2e-7], "n": [1, 1234567]})
    write_table(table, tmp_path / "t.csv")
    text = b"name,mm,n\na,0.333333,1\nb,2e-07,1234567\n"
    assert (tmp_path / "t.csv").read_bytes() == text


@pytest.mark.parametrize("first_s", [0.0, 2.1e9])
def test_times_are_written_in_full(tmp_path, first_s):
    """Also those that count from 1970: to a microsecond, of which 2^31 s leave two steps."""
    times = first_s + np.arange(5) / 30
    pose = Pose("measured", RigidTransform.identity(), np.eye(6), 0.1, 6, 3)
    write_poses(pose_table([pose] * 5, times), tmp_path / "p.csv")
    write_tum(read_poses(tmp_path / "p.csv"), tmp_path / "p.tum")
    begin(tmp_path / "r", ["left"])
    finish(tmp_path / "r", times)
    (tmp_path / "joints.csv").write_text(table_text(pd.DataFrame({"t_s": times, "a": 1 / 3})))
    for back in (
        read_poses(tmp_path / "p.csv")["t_s"],
        np.loadtxt(tmp_path / "p.tum")[:, 0],
        read_timestamps(tmp_path / "r" / "timestamps.csv"),
        pd.read_csv(tmp_path / "joints.csv")["t_s"],
    ):
        assert np.allclose(back, times, rtol=0, atol=1e-6)
    assert (tmp_path / "joints.csv").read_text().splitlines()[1].endswith(",0.333333333")
