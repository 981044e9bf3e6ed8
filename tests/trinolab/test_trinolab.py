"""The names that `trinolab` itself has: each one works, none is hidden by a module, and the
examples of the README and of the reference run.
"""

import re
from importlib import import_module

import numpy as np
import pytest
from firsthour import EMPTY, INSTANTS, TAKEN, blocks, write_recording
from makenotebook import glued, make_notebook

import trinolab
from trinolab import FACE
from workbench.sweep import runs


def test_the_names_of_the_face_are_the_things_themselves():
    given = {}
    exec("from trinolab import *", given)
    assert set(given) - {"__builtins__"} == set(FACE) == set(trinolab.__all__)
    for name, home in FACE.items():
        module, _, attribute = home.partition(":")
        loaded = import_module(module)
        assert getattr(trinolab, name) is (getattr(loaded, attribute) if attribute else loaded)
        assert name in dir(trinolab)
    assert trinolab.sweep(lambda a: 2 * a, a=[1, 4], progress=False)["result"].tolist() == [2, 8]
    assert trinolab.sweep.sweep is runs.sweep


# --- the README's block of Python, and those of the first page of the API reference

EXAMPLES = [*blocks("README.md", "From Python"), *blocks("book/api/index.md", "Examples")]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the recording of the README's first command, and with a small notebook that is
    called like a chapter.
    """
    root = tmp_path_factory.mktemp("readme")
    write_recording(root / "recording")
    (root / "notebooks").mkdir()
    make_notebook(
        root / "notebooks" / "06_matching.ipynb",
        glued(found="ncc_threshold + seed"),
        parameters="ncc_threshold = 0.7\nseed = 0",
    )
    return root


def measures_an_instant(left, place):
    assert left["pose"].status == "measured"
    number = int(re.search(r"/(\d{6})\.png", EXAMPLES[0])[1])
    truth = trinolab.read_poses(place / "recording" / "truth.csv").iloc[TAKEN.index(number)]
    position = left["pose"].T_world_handle.translation
    away = position - truth[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    assert np.linalg.norm(away) < 0.02  # mm, by the best estimator


def tracks_a_recording(left, place):
    assert (left["poses"]["status"] == "measured").sum() == INSTANTS - EMPTY
    assert left["result"].measured == INSTANTS - EMPTY
    assert left["result"].errors.E_t_mm < 0.02


CHECKS = [
    (0, measures_an_instant),
    (1, tracks_a_recording),
    *(pytest.param(k, None, marks=pytest.mark.heavy) for k in (2, 3)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "check"), CHECKS)
def test_examples(number, check, place, monkeypatch):
    assert len(EXAMPLES) == 4
    monkeypatch.chdir(place)
    left = {}
    exec(EXAMPLES[number], left)
    if check is not None:
        check(left, place)
