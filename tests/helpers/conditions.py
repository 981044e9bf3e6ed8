"""What a test needs that not each computer has, as marks that skip it."""

import pytest

from workbench.pages.browser import CHROMIUM
from workbench.pages.figures import HTML

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"
)
needs_pages = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)
