"""The recording that the README and the page of the commands make, and the commands that they
show.

It is the first part of the standard recording ``calm``, which the book keeps: a recording's first
instants do not depend on how long it is (a test of the command `render` holds that).
"""

import re
import shutil
from pathlib import Path

import pandas as pd

from trinolab.bench.recordings import standard_recording

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 2.0  # as the text says
INSTANTS = 36  # of these, as many as a test takes: the handle is there from the thirtieth on


def write_recording(folder, instants=INSTANTS):
    """The recording in a folder that is not there yet, up to an instant."""
    whole = standard_recording("calm", seconds=SECONDS, progress=False)

    def those_after(directory, names):
        return [
            name
            for name in names
            if re.fullmatch(r"\d{6}\.png", name) and int(name[:6]) >= instants
        ]

    shutil.copytree(whole, folder, ignore=those_after)
    for name in ("timestamps.csv", "truth.csv", "truth_markers.csv"):
        pd.read_csv(folder / name).head(instants).to_csv(folder / name, index=False)
    return folder


def readme_section(heading):
    """A section of the README, from its heading to the next one of that rank."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return text.split(f"\n## {heading}\n")[1].split("\n## ")[0]


def blocks(section):
    """The indented blocks of code of a section, without their indentation."""
    found = re.findall(r"(?:^    .*\n|^\n(?=    ))+", section, flags=re.MULTILINE)
    return [re.sub("^    ", "", block, flags=re.MULTILINE).lstrip("\n") for block in found]
