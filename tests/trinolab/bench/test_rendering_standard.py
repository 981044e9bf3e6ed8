"""Standard recordings: rendered once, kept in a cache, and never a stale one."""

import threading
from dataclasses import replace

import pytest

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

    def small(name):
        rig = load_rig(name)
        return replace(rig, cameras=tuple(scaled(camera, 0.125) for camera in rig.cameras))

    monkeypatch.setattr(rendering, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(rendering, "load_rig", small)
    return tmp_path / "cache"


def images(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def short(name="calm", **options):
    return standard_recording(name, **{"seconds": 0.1, "progress": False} | options)


def test_two_at_once_render_it_once(cache, monkeypatch):
    real, rendered, found = rendering.write_recording, [], []

    def counted(*arguments, **options):
        rendered.append(arguments)
        real(*arguments, **options)

    monkeypatch.setattr(rendering, "write_recording", counted)
    both = [threading.Thread(target=lambda: found.append(short("hard"))) for _ in range(2)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert len(rendered) == 1
    assert found[0] == found[1] == short("hard")
    assert found[0].parent == cache / "recordings" == recordings_folder()
    assert len(read_poses(found[0] / "truth.csv")) == 3


def test_whatever_it_is_made_from_changes_the_folder(monkeypatch):
    monkeypatch.setattr(rendering, "write_recording", lambda job, folder, *_: folder.mkdir())
    asked = [{"seed": 1}, {"seconds": 0.2}, {"rig_name": "paper_pair"}, {"handle_name": "paper"}]
    folders = [short(**options) for options in [{}, {"name": "hard"}, *asked]]
    monkeypatch.setattr(rendering, "DRAWN_WITH", ("camera.py",))
    folders.append(short())
    assert len(set(folders)) == 7


def test_a_shorter_recording_is_the_beginning_of_a_longer_one():
    shorter, longer = (images(short("hard", seconds=s)) for s in (0.07, 0.1))
    parts = [name for name in shorter if name.endswith(".png")]
    assert len(parts) == 2 * 3 + 3
    assert all(shorter[name] == longer[name] for name in parts)


# --- removed


@pytest.mark.parametrize("answer", ["y", " YES ", "", "n", "what?", None])
def test_clear_shows_what_there_is_and_removes_it_after_a_yes(answer, cache, capfd, monkeypatch):
    kept = [short(), short("hard")]
    before = [images(folder) for folder in kept]
    asked = []

    def said(question):
        asked.append(question)
        if answer is None:
            raise EOFError
        return answer

    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", said)
    assert cli.main(["clear"]) == 0
    out = capfd.readouterr().out.splitlines()
    assert asked == ["remove 0 MB? [y/N] "]
    assert str(recordings_folder()) in out[0]
    assert sorted(line.split()[-1] for line in out[1:3]) == sorted(path.name for path in kept)
    if (answer or "").strip().lower() not in ("y", "yes"):
        assert out[-1] == "nothing was removed"
        assert [images(folder) for folder in kept] == before
        return
    assert not recordings_folder().exists()
    assert cli.main(["clear"]) == 0  # nothing to remove is no mistake
    assert [images(folder) for folder in (short(), short("hard"))] == before


def test_without_a_terminal_it_takes_a_yes(capfd, monkeypatch):
    folder = short()
    size = sum(map(len, images(folder).values()))
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert cli.main(["clear"]) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "--yes removes 1 standard recordings, 0 MB" in err
    assert [(one.name, one.size) for one in cached_recordings()] == [(folder.name, size)]
    assert cli.main(["clear", "--yes"]) == 0
    assert not recordings_folder().exists()


def test_what_is_being_rendered_stays(capfd):
    folder, other = short(), short("hard")
    partial = folder.rename(folder.with_name(f"{folder.name}.partial"))
    with locked(folder.with_name(f"{folder.name}.lock")):
        assert cli.main(["clear", "--yes"]) == 0
    assert f"{folder.name}: left, it is being rendered\n" in capfd.readouterr().out
    assert not other.exists()
    assert partial.is_dir()
    assert [one.name for one in cached_recordings()] == [folder.name]


def test_a_removal_that_is_interrupted_leaves_no_recording_in_part(monkeypatch):
    folder = short()

    def interrupted(path, **_):
        if path.exists():
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rendering.shutil, "rmtree", interrupted)
        with pytest.raises(KeyboardInterrupt):
            clear_recordings()
    assert not folder.exists()
    assert [one.name for one in cached_recordings()] == [folder.name]
    short()  # rendered anew beside what is left
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
        short(**options)


def test_a_cache_that_cannot_be_written_is_named(cache):
    cache.write_text("a file")
    with pytest.raises(ValueError, match="recordings: cannot be written"):
        short()
