"""A recording folder as a clip, beside what was written into it."""

import numpy as np
import pytest

from trinolab.bench import recordings
from trinolab.bench.recordings import standard_recording
from trinolab.studies.ground_truth import read_clip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "recordings_folder", lambda: tmp_path)
    return standard_recording("hard", seconds=0.1, progress=False)


def test_a_clip_holds_all_of_a_folder(folder):
    clip = read_clip(folder)
    np.testing.assert_allclose(clip.times_s, [0, 1 / 30, 2 / 30], atol=1e-9)
    assert [len(film) for film in clip.films] == [3, 3, 3]
    assert clip.rig.names == ("ccd1", "ccd2", "ccd3")
    assert clip.handle.name == "coded"
    for film, empty, camera in zip(clip.films, clip.empty, clip.rig.cameras, strict=True):
        assert film[0].shape == empty.shape == camera.size[::-1]
        assert not np.array_equal(film[0], film[1])
    seen = clip.rig.cameras[0].project(clip.truths[0].apply(clip.handle.marker_centres))
    u, v = np.rint(seen[np.isfinite(seen).all(axis=1)]).astype(int).T
    assert clip.films[0][0][v, u].max() > 120  # markers are there


def test_a_file_that_is_missing_is_named(folder):
    (folder / "truth.csv").unlink()
    with pytest.raises(ValueError, match=r"truth\.csv"):
        read_clip(folder)
