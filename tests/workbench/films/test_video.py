"""Films that cannot be written are refused, and leave nothing."""

import numpy as np
import pytest

from workbench.films import video
from workbench.films.video import Film

PICTURE = np.zeros((32, 48, 3), np.uint8)


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"film.avi: expected a name that ends in .webm"):
        Film(tmp_path / "film.avi", 30.0)


def filmed(path, fps):
    with Film(path, fps) as film:
        film.add(PICTURE)


def test_a_film_that_cannot_be_opened_is_refused(tmp_path):
    """No codec takes such a rate."""
    with pytest.raises(ValueError, match="cannot be written as a VP8 video"):
        filmed(tmp_path / "film.webm", -1.0)
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_is_cut_off_does_not_appear(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "_is_whole", lambda path: False)
    with pytest.raises(ValueError, match="is the disk full"):
        filmed(tmp_path / "film.webm", 30.0)
    assert list(tmp_path.iterdir()) == []
