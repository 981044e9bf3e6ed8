"""What C libraries write to standard error by themselves: decoders of images and videos do, beside our one line."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO


@contextmanager
def unheard() -> Iterator[IO[bytes]]:
    """Whatever the process writes to the file of standard error meanwhile goes to the file that this gives."""
    with tempfile.TemporaryFile() as file:
        kept = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield file
        finally:
            os.dup2(kept, 2)
            os.close(kept)
