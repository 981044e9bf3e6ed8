"""The recording that the README and the page of the commands make, and the commands that they
show.

It is made of instants of the standard recording ``calm``, which the book keeps: a recording's first
instants do not depend on how long it is (a test of the command `render` holds that). Of the second in
which the bench is empty there are two, because what is lost is looked for in the whole images, which
takes long.
"""

import re
import shutil
from pathlib import Path

import pandas as pd

from trinolab.bench.rendering import standard_recording

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 2.0  # as the text says
TAKEN = (0, 1, 30, 31, 32, 33, 34, 35)  # frames; the handle is there from the thirtieth on
EMPTY, INSTANTS = 2, len(TAKEN)


def write_recording(folder, frames=TAKEN):
    """Some frames of the recording in a folder that is not there yet. The images keep their names;
    in the tables they are counted from 0.
    """
    whole = standard_recording("calm", seconds=SECONDS, progress=False)

    def others(_, names):
        return [
            name
            for name in names
            if re.fullmatch(r"\d{6}\.png", name) and int(name[:6]) not in frames
        ]

    shutil.copytree(whole, folder, ignore=others)
    for name in ("timestamps.csv", "truth.csv", "truth_markers.csv"):
        table = pd.read_csv(folder / name).set_index("frame").loc[list(frames)]
        table.assign(frame=range(len(frames))).to_csv(folder / name, index=False)
    return folder


def blocks(page, heading):
    """The fenced blocks of code of a page's section, from its heading to the next one of that rank."""
    text = (ROOT / page).read_text(encoding="utf-8")
    section = text.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return re.findall(r"^```\w+\n(.*?)^```$", section, flags=re.MULTILINE | re.DOTALL)
