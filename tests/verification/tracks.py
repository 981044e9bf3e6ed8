"""The standard recordings tracked and held against their truth, and a real hand's motion before the
bench's cameras.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from trinolab.bench.rendering import render, standard_recording
from trinolab.datasets import data_path, load_real_sets
from trinolab.evaluation import evaluate
from trinolab.files.fetch import why_not
from trinolab.files.poses import read_poses, truth_table, write_poses
from trinolab.following.track import track_folder
from workbench.studies.real_recordings import (
    Trajectory,
    at_times,
    before_the_cameras,
    load_trajectories,
)

HANDLES, METHODS = ("coded", "paper"), ("paper", "best")
SECONDS = 10.0


def report(arguments) -> None:
    print(
        "tracks: share measured of the instants at which one camera truly sees four markers or two see three each,\n"
        "until the first loss and over all; flips, poses off by more than 2 mm or 5 deg; errors; instants to be back"
    )
    print(
        f"{'recording':20s} {'handle':7s} {'method':7s}{'until lost':>11s}{'all':>8s}{'flips':>6s}{'off':>5s}"
        f"{'E_t mm':>9s}{'deg':>7s}  back after"
    )
    with TemporaryDirectory() as folder:
        for name, seed in (("calm", 0), ("hard", 0), ("hard", 1), ("hard", 2)):
            for handle in HANDLES:
                _lines(
                    f"{name}, seed {seed}",
                    standard_recording(name, seed, SECONDS, handle_name=handle),
                    handle,
                    Path(folder),
                )
        _real(Path(folder))


def _real(folder: Path) -> None:
    """Ten seconds of a handheld recording, its middle moved to the bench's, upright there; it
    leaves the images.
    """
    recorded = load_trajectories()
    if recorded is None:
        print(f"a real hand: not run, {why_not(load_real_sets()['trajectories'])}")
        return
    every = np.arange(5.0, 5.0 + SECONDS, 1 / 30)
    path = before_the_cameras(Trajectory(every, at_times(recorded, every))).poses
    write_poses(truth_table(path).assign(t_s=every), folder / "path.csv")
    for handle in HANDLES:
        out = folder / f"real_{handle}"
        render(
            data_path("rigs", "raised_40deg.toml"),
            data_path("handles", f"{handle}.toml"),
            str(folder / "path.csv"),
            out,
        )
        _lines("a real hand", out, handle, folder)


def _lines(name: str, recording: Path, handle: str, folder: Path) -> None:
    truth = read_poses(recording / "truth.csv")
    first = truth[truth["status"] != "lost"].iloc[:1]
    start = folder / "start.csv"
    write_poses(first, start)
    for method in METHODS:
        out = folder / "poses.csv"
        table = track_folder(
            recording, out, method=method, start=start if handle == "paper" else None
        )
        result = evaluate(out, recording / "truth.csv", recording / "handle.toml")
        begun = table[table["frame"] >= table["frame"][table["status"] == "measured"].min()]
        lost = begun["frame"][begun["status"] == "lost"].min()
        until = begun if np.isnan(lost) else begun[begun["frame"] < lost]
        held = truth[(truth["status"] != "lost") & truth["frame"].isin(until["frame"])]
        part = folder / "part.csv"
        write_poses(held, part)
        (folder / "truth_markers.csv").write_bytes((recording / "truth_markers.csv").read_bytes())
        before = evaluate(out, part, recording / "handle.toml")
        shares = [100 * r.visible_measured / max(r.visible, 1) for r in (before, result)]
        print(
            f"{name:20s} {handle:7s} {method:7s}{shares[0]:9.2f} %{shares[1]:6.2f} %{result.track.flips:6d}"
            f"{result.track.far_off:5d}{result.errors.E_t_mm:9.4f}{result.errors.geodesic_mean_deg:7.3f}"
            f"  {', '.join(map(str, result.track.waits))}",
            flush=True,
        )
