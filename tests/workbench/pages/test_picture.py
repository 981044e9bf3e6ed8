"""README's picture of the start page, as it is stored and taken again of the built page."""

import cv2
from pages import HTML, built

from workbench.pages import picture


def is_page_with_a_frame(path):
    shown = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (picture.HEIGHT, picture.WIDTH)
    assert 0.1 < (shown < 100).mean() < 0.3  # the frame is dark, as images of the bench are
    assert path.stat().st_size < 150_000


def test_the_stored_picture():
    is_page_with_a_frame(picture.OUT)


@built
def test_the_picture_taken_again(tmp_path):
    picture.write_picture(HTML / "book" / "start.html", tmp_path / "start.webp")
    is_page_with_a_frame(tmp_path / "start.webp")
