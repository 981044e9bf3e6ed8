"""How many frames a film has that a page holds."""

import base64
import re

import cv2


def frames_in(page, folder):
    """Decode the one film in a page's text; it is written to the folder for that."""
    (data,) = re.findall(r'src="data:video/webm;base64,([^"]+)"', page)
    path = folder / "from_page.webm"
    path.write_bytes(base64.b64decode(data))
    video, count = cv2.VideoCapture(str(path)), 0
    while video.read()[0]:
        count += 1
    return count
