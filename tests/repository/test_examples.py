"""Each file in `examples` runs as it stands, and prints what its user wants to know."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))


def test_there_are_examples():
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.heavy] * (path.stem == "a_recording"), id=path.stem)
        for path in EXAMPLES
    ],
)
def test_an_example_runs_and_is_accurate(path, tmp_path):
    done = subprocess.run(
        [sys.executable, str(path)], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stderr == "" or "instant" in done.stderr
    (off_mm,) = map(float, re.findall(r"([\d.]+) mm", done.stdout))
    assert off_mm < 0.35, done.stdout
