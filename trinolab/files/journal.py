"""Journals of finished work: an interruption loses none, and one process at a time adds to it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from typing import Any, Self

from . import limits
from .outputs import check_target, resolved

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]


@contextmanager
def locked(path: Path, wait: bool = False) -> Iterator[None]:
    """Lock a folder, or a file, which is made if it does not exist, for this process while the
    block runs.

    The system releases the lock when the process ends, however that happens. On a file system
    without such locks nothing is locked.

    Parameters
    ----------
    path : path
    wait : bool
        Wait for the other process rather than refuse.

    Raises
    ------
    ValueError
        Names the path: another process works on it, or it cannot be opened.
    """
    if fcntl is None:
        yield
        return
    with ExitStack() as opened:
        while True:
            lock = _opened(path)
            opened.callback(_free, lock)
            _lock(lock, path, wait)
            if _is_still(path, lock):
                break
        yield


@contextmanager
def sole_writer(target: str | Path, name: str | Path | None = None) -> Iterator[None]:
    """Lock a file or a folder that is going to be written for this process while the block runs.

    The lock is a hidden file beside it, ``.NAME.lock``, which is removed when the block ends. The
    next process takes over the lock of one that was killed.

    Parameters
    ----------
    target : path
    name : path, optional
        Its name in an error.

    Raises
    ------
    ValueError
        Names the target: another process writes it, or nothing can be written beside it.
    """
    place = resolved(target)
    lock = place.with_name(f".{place.name}.lock")
    with ExitStack() as held:
        try:
            held.enter_context(locked(lock))
        except ValueError as error:
            raise ValueError(str(error).replace(str(lock), str(name or target), 1)) from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)  # while it is held: whoever waits for it looks again


class Journal:
    """A text file that grows by whole lines, for this process alone as long as it is open.

    Its beginning, the head, identifies the work. The lines of the same work are read, from the
    first one on; a line that was cut off, or is damaged, is dropped with all lines behind it. With
    another head the file is begun anew.

    Parameters
    ----------
    path : path
        Made if it is not there.
    head : str
        Whole lines, or nothing.
    is_line : callable
        Takes a line's number, from 0 behind the head, and its text, and returns whether it is a
        whole line of this work.

    Raises
    ------
    ValueError
        Names the file: another process works on it, it cannot be written, or is larger than
        `limits.TABLE_BYTES`.
    """

    def __init__(self, path: Path, head: str, is_line: Callable[[int, str], bool]) -> None:
        self.path = path
        self._head = head.encode()
        self._is_line = is_line
        check_target(path)
        with ExitStack() as opened:
            opened.enter_context(locked(path))
            try:
                # Without a buffer: what was written is with the system, what was not is nowhere.
                self._file = opened.enter_context(path.open("a+b", buffering=0))
            except OSError as error:
                raise ValueError(f"{path}: cannot be written ({error.strerror})") from None
            self._open = opened.pop_all()
        try:
            self._take_up()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def lines(self) -> list[str]:
        """The lines so far, without their ends."""
        text = self._text()
        if not text.startswith(self._head):
            return []
        lines = text[len(self._head) :].decode("utf-8", "surrogateescape").split("\n")
        # behind the last end there is nothing, or a line that was cut off
        ended = enumerate(lines[:-1])
        return [line for _, line in takewhile(lambda numbered: self._is_line(*numbered), ended)]

    def add_line(self, line: str) -> None:
        """One more line; it is with the system when this returns. Raises ValueError if it cannot be
        written.
        """
        self._write(f"{line}\n".encode())

    def close(self) -> None:
        """Release the file."""
        self._open.close()

    def remove(self) -> None:
        """Remove the file, and close it."""
        if fcntl is None:  # such a system may not remove a file that is open
            self.close()
        self.path.unlink(missing_ok=True)
        self.close()

    def _take_up(self) -> None:
        """Drop what does not belong to this work."""
        if self._text().startswith(self._head):
            whole_lines = "".join(f"{line}\n" for line in self.lines())
            self._file.truncate(
                len(self._head) + len(whole_lines.encode("utf-8", "surrogateescape"))
            )
            return
        self._file.truncate(0)
        try:
            self._write(self._head)
        except ValueError:
            self.remove()
            raise

    def _text(self) -> bytes:
        limits.check_bytes(self.path, os.fstat(self._file.fileno()).st_size, limits.TABLE_BYTES)
        self._file.seek(0)
        return self._file.read()

    def _write(self, text: bytes) -> None:
        """Write at the end of the file, in as many pieces as the system takes it."""
        try:
            while text:
                text = text[self._file.write(text) :]
        except OSError as error:
            raise ValueError(f"{self.path}: cannot be written ({error.strerror})") from None


def fingerprint(
    files: Sequence[str | Path], sources: Mapping[str, str | Path], *options: Any
) -> str:
    """Hash that tells one work on footage from another: by the contents of its files, its footage as
    it lies there, its options.
    """
    contents = [hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in files]
    where = {name: [str(Path(path).resolve()), stamp(Path(path))] for name, path in sources.items()}
    return hashlib.sha256(
        json.dumps([contents, where, [str(o) for o in options]]).encode()
    ).hexdigest()[:16]


def stamp(path: Path) -> list[tuple[str, int, int]]:
    """Names, sizes and times of a video, or of a folder's images."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [(file.name, (about := file.stat()).st_size, about.st_mtime_ns) for file in files]


def _opened(path: Path) -> int:
    """A descriptor of a folder or a file, for its lock."""
    try:
        return os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def _lock(held: int, path: Path, wait: bool) -> None:
    try:
        fcntl.flock(held, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ValueError(f"{path}: another process works on it") from None
    except OSError:  # a file system without locks
        return


def _is_still(path: Path, held: int) -> bool:
    """Whether a path names what was opened; before that was locked its owner may have removed or
    renamed it.
    """
    try:
        return os.path.samestat(path.stat(), os.fstat(held))
    except OSError:
        return False


def _free(held: int) -> None:
    """Unlock and close a descriptor; copies of this process may have it, too, and would go on to
    hold its lock.
    """
    with suppress(OSError):  # a file system without locks
        fcntl.flock(held, fcntl.LOCK_UN)
    os.close(held)
