"""`trinolab track` on a short recording: what it writes, whole or not at all."""

import shutil

import numpy as np
import pytest
from scenes import pose, record
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import handle_file, load_handle, load_rig, rig_file
from trinolab.files.poses import read_poses, transforms
from trinolab.following.track import track_folder
from trinolab.rigid import shifted

RIG, PAPER = load_rig("paper_pair"), load_handle("paper")
FIRST = pose([0.0, 5.0, 560.0], [170.0, 15.0, 40.0])
COUNT, FPS = 6, 25.0
PATH = RigidTransform.concatenate(
    [shifted(FIRST, np.array([90.0, -60, 40, 0.2, 0.3, -0.2]) * k / FPS) for k in range(COUNT)]
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of the paper's handle."""
    return record(tmp_path_factory.mktemp("track") / "r", RIG, PAPER, PATH, FPS)


@pytest.mark.slow
def test_it_writes_poses_and_tum_and_shows_every_instant(folder, tmp_path):
    watched = []
    table = track_folder(
        folder,
        tmp_path / "p.csv",
        start=folder / "truth.csv",
        watch=lambda recording, now, tracked: watched.append(
            (recording.rate, now.frame, tracked.measurement.pose.status)
        ),
    )
    assert table["status"].tolist() == ["measured"] * COUNT
    back = read_poses(tmp_path / "p.csv")
    assert back["t_s"].tolist() == pytest.approx(np.arange(COUNT) / FPS)
    off = transforms(back).translation - PATH.translation
    assert np.linalg.norm(off, axis=1).max() < 0.1  # mm
    assert np.loadtxt(tmp_path / "p.tum").shape == (COUNT, 8)
    assert watched == [(pytest.approx(FPS), k, "measured") for k in range(COUNT)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.csv", "p.tum"]


@pytest.mark.slow
def test_a_recording_may_be_tracked_with_another_rig_and_handle(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "r")
    for name in ("rig.toml", "handle.toml"):
        (tmp_path / "r" / name).unlink()
    (tmp_path / "t.csv").write_text("frame,t_s\n" + "".join(f"{k},{5 + k}\n" for k in range(COUNT)))
    options = {"timestamps": tmp_path / "t.csv", "method": "paper"}
    files = {"rig": rig_file("paper_pair"), "handle": handle_file("paper")}
    table = track_folder(tmp_path / "r", tmp_path / "p.csv", **files, **options)
    assert set(table["status"]) == {"ambiguous"}
    assert table["t_s"].tolist() == [5, 6, 7, 8, 9, 10]
    track_folder(tmp_path / "r", tmp_path / "q.csv", RIG, PAPER, **options)
    assert (tmp_path / "q.csv").read_bytes() == (tmp_path / "p.csv").read_bytes()
