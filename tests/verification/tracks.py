"""The standard recordings tracked and held against their truth."""

from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from trinolab.bench.rendering import standard_recording
from trinolab.evaluation import evaluate
from trinolab.files.poses import read_poses, write_poses
from trinolab.following.track import track_folder

CLIPS = (("calm", 0), ("hard", 0), ("hard", 1), ("hard", 2))
HANDLES, METHODS = ("coded", "paper"), ("paper", "best")
SECONDS = 10.0


def report(arguments) -> None:
    print(
        "Tracks: per cent measured of the instants at which one camera truly sees four markers or two see three each,"
        "\nuntil the first loss and over all; flips, poses off by more than 2 mm or 5 deg; errors, mm and deg; "
        "instants to be back"
    )
    with TemporaryDirectory() as folder:
        rows = [
            _row(*clip, *how, Path(folder)) for clip in CLIPS for how in product(HANDLES, METHODS)
        ]
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.4f}".format), flush=True)


def _row(name: str, seed: int, handle: str, method: str, folder: Path) -> dict[str, object]:
    recording = standard_recording(name, seed, SECONDS, handle_name=handle)
    truth = read_poses(recording / "truth.csv")
    seen = truth[truth["status"] != "lost"]
    start, out, part = (folder / f"{what}.csv" for what in ("start", "poses", "part"))
    write_poses(seen.iloc[:1], start)
    given = start if handle == "paper" else None
    table = track_folder(recording, out, method=method, start=given)
    result = evaluate(out, recording / "truth.csv", recording / "handle.toml")
    frames = table["frame"]
    begin = frames[table["status"] == "measured"].min()
    lost = frames[(frames >= begin) & (table["status"] == "lost")].min()
    end = np.inf if np.isnan(lost) else lost
    write_poses(seen[(seen["frame"] >= begin) & (seen["frame"] < end)], part)
    (folder / "truth_markers.csv").write_bytes((recording / "truth_markers.csv").read_bytes())
    before = evaluate(out, part, recording / "handle.toml")
    shares = [100 * r.visible_measured / max(r.visible, 1) for r in (before, result)]
    return {
        "recording": f"{name}, seed {seed}",
        "handle": handle,
        "method": method,
        "until lost": shares[0],
        "all": shares[1],
        "flips": result.track.flips,
        "off": result.track.far_off,
        "E_t": result.errors.E_t_mm,
        "angle": result.errors.geodesic_mean_deg,
        "back after": ", ".join(map(str, result.track.waits)),
    }
