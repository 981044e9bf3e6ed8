"""Standard recordings: rendered once, kept in a cache, and never a stale one."""

import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from processes import HANGS_S

from trinolab.bench import rendering
from trinolab.bench.rendering import (
    cached_recordings,
    clear_recordings,
    recordings_folder,
    standard_recording,
)
from trinolab.bench.scene import scaled
from trinolab.datasets import load_rig
from trinolab.files.journal import locked
from trinolab.files.poses import read_poses
from workbench import cli


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own, and rigs of an eighth of the pixels."""
    monkeypatch.setattr(rendering, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(
        rendering,
        "load_rig",
        lambda name: replace(
            load_rig(name), cameras=tuple(scaled(c, 0.125) for c in load_rig(name).cameras)
        ),
    )
    return tmp_path / "cache"


def images(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_it_is_rendered_once(cache, monkeypatch):
    first = standard_recording("hard", seconds=0.1, progress=False)
    assert first.parent == cache / "recordings" == recordings_folder()
    assert len(read_poses(first / "truth.csv")) == 3
    monkeypatch.setattr(rendering, "write_recording", None)  # would be called
    assert standard_recording("hard", seconds=0.1) == first


def test_whatever_it_is_made_from_changes_the_folder(monkeypatch):
    monkeypatch.setattr(rendering, "write_recording", lambda job, folder, *_: folder.mkdir())
    asked = [
        {},
        {"seed": 1},
        {"seconds": 0.2},
        {"rig_name": "paper_pair"},
        {"handle_name": "paper"},
    ]
    folders = [standard_recording("calm", **{"seconds": 0.1} | options) for options in asked]
    folders.append(standard_recording("hard", seconds=0.1))
    monkeypatch.setattr(rendering, "DRAWN_WITH", ("camera.py",))
    folders.append(standard_recording("calm", seconds=0.1))
    assert len(set(folders)) == 7


def test_equal_seeds_give_equal_recordings(cache):
    first = images(standard_recording("hard", seed=2, seconds=0.1))
    (gone,) = clear_recordings()
    assert gone.size == sum(len(data) for data in first.values())
    assert not (cache / "recordings").exists()
    assert images(standard_recording("hard", seed=2, seconds=0.1)) == first


def test_a_shorter_recording_is_the_beginning_of_a_longer_one():
    short, long = (images(standard_recording("hard", seconds=s)) for s in (0.07, 0.1))
    parts = [name for name in short if name.endswith(".png")]
    assert len(parts) == 2 * 3 + 3
    assert all(short[name] == long[name] for name in parts)


def test_calm_begins_with_the_empty_scene():
    folder = standard_recording("calm", seconds=0.1)
    assert set(read_poses(folder / "truth.csv")["status"]) == {"lost"}
    empty, frame = (
        cv2.imread(
            str(
                folder / name / "ccd1.png"
                if name == "background"
                else folder / name / "ccd1" / "000002.png"
            ),
            0,
        ).astype(float)
        for name in ("background", "images")
    )
    assert np.abs(cv2.blur(frame - empty, (9, 9))).max() < 3  # noise alone
    assert np.abs(frame - empty).max() > 3  # another one


def test_two_at_once_render_it_once(cache):
    code = (
        "import sys, pathlib; from trinolab.bench import rendering; "
        "rendering.cache_folder = lambda: pathlib.Path(sys.argv[1]); load = rendering.load_rig; "
        "from dataclasses import replace; from trinolab.bench.scene import scaled; "
        "small = lambda rig: replace(rig, cameras=tuple(scaled(c, 0.125) for c in rig.cameras)); "
        "rendering.load_rig = lambda name: small(load(name)); "
        "print(rendering.standard_recording('hard', seconds=0.1, progress=False))"
    )
    both = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(cache)], stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = {process.communicate(timeout=HANGS_S)[0] for process in both}
    assert [process.returncode for process in both] == [0, 0]
    assert said == {f"{standard_recording('hard', seconds=0.1)}\n"}


def answering(monkeypatch, *answers):
    """A person at a terminal, and the questions that are asked there."""
    asked, left = [], iter(answers)

    def answer(question):
        asked.append(question)
        if (said := next(left, None)) is None:
            raise EOFError
        return said

    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", answer)
    return asked


@pytest.mark.parametrize("answers", [("y",), (" YES ",)])
def test_clear_shows_what_there_is_asks_and_removes(cache, capfd, monkeypatch, answers):
    kept = [standard_recording(name, seconds=0.1) for name in ("calm", "hard")]
    asked = answering(monkeypatch, *answers)
    assert cli.main(["clear"]) == 0
    out = capfd.readouterr().out.splitlines()
    assert asked == ["remove 0 MB? [y/N] "]
    assert out[0] == f"in {recordings_folder()}, for all copies of trinolab on this account:"
    assert sorted(line.split()[-1] for line in out[1:3]) == sorted(path.name for path in kept)
    assert out[3:] == [f"0 MB of standard recordings removed from {recordings_folder()}"]
    assert not recordings_folder().exists()
    assert cli.main(["clear"]) == 0  # nothing to remove is no mistake
    assert capfd.readouterr().out == f"no standard recording is kept in {recordings_folder()}\n"


@pytest.mark.parametrize("answers", [("",), ("n",), ("what?",), ()])
def test_whoever_does_not_say_yes_keeps_them(cache, capfd, monkeypatch, answers):
    before = images(standard_recording("calm", seconds=0.1))
    answering(monkeypatch, *answers)
    assert cli.main(["clear"]) == 0
    assert capfd.readouterr().out.endswith("nothing was removed\n")
    assert images(standard_recording("calm", seconds=0.1)) == before


def test_without_a_terminal_it_takes_a_yes(cache, capfd, monkeypatch):
    folder = standard_recording("calm", seconds=0.1)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert cli.main(["clear"]) == 2
    assert capfd.readouterr() == (
        "",
        "trinolab clear: no terminal to ask on; --yes removes 1 standard recordings, 0 MB, from "
        f"{recordings_folder()}\n",
    )
    assert folder.is_dir()
    assert cli.main(["clear", "--yes"]) == 0
    assert not recordings_folder().exists()


def test_what_is_being_rendered_stays(cache, capfd):
    folder, other = (standard_recording(name, seconds=0.1) for name in ("calm", "hard"))
    folder.rename(folder.with_name(f"{folder.name}.partial"))
    with locked(folder.with_name(f"{folder.name}.lock")):
        assert cli.main(["clear", "--yes"]) == 0
    assert capfd.readouterr().out == (
        f"{folder.name}: left, it is being rendered\n"
        f"0 MB of standard recordings removed from {recordings_folder()}\n"
    )
    assert not other.exists()
    assert folder.with_name(f"{folder.name}.partial").is_dir()
    assert [one.name for one in cached_recordings()] == [folder.name]


def test_a_removal_that_is_interrupted_leaves_no_recording_in_part(cache, monkeypatch):
    folder = standard_recording("calm", seconds=0.1)

    def interrupted(path, **_):
        if path.exists():
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rendering.shutil, "rmtree", interrupted)
        with pytest.raises(KeyboardInterrupt):
            clear_recordings()
    assert not folder.exists()
    assert [one.name for one in cached_recordings()] == [folder.name]
    standard_recording("calm", seconds=0.1)  # rendered anew beside what is left
    clear_recordings()
    assert not recordings_folder().exists()


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"name": "wild"}, "motion"),
        ({"seed": -1}, "seed"),
        ({"seconds": 0}, "seconds"),
        ({"rig_name": "no"}, "no"),
        ({"handle_name": "no"}, "no"),
    ],
)
def test_a_wrong_name_or_number_is_refused(options, named):
    with pytest.raises(ValueError, match=named):
        standard_recording(**{"name": "calm", "seconds": 0.1} | options)


def test_a_cache_that_cannot_be_written_is_named(cache):
    cache.write_text("a file")
    with pytest.raises(ValueError, match="recordings: cannot be written"):
        standard_recording("calm", seconds=0.1)
