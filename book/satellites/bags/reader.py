"""A ROS 2 bag opened to be read, with no more memory than `trinolab.files.limits` says.

What a bag holds may be compressed a thousandfold: by chunks of an MCAP file, by message, or as a whole
file. The library that reads bags decompresses without a limit; here its decompressors are replaced by
ones that have one, while a bag is open.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

from trinolab.files import limits

METADATA = "metadata.yaml"
METADATA_BYTES = limits.MIB // 4  # its parser takes ten seconds for a megabyte
FILE_RATIO = (
    100  # of a file that is compressed as a whole, and for a while decompressed on the disk
)


@contextmanager
def opened(bag: str | Path) -> Iterator[Any]:
    """A reader of a bag.

    Parameters
    ----------
    bag : path
        A folder with ``metadata.yaml``, or an MCAP file.

    Raises
    ------
    ValueError
        Names the bag: not there, no regular file, not readable, or more in it at a time than
        `limits.BAG_BYTES`.
    """
    import apsw
    from rosbags.rosbag2 import Reader, ReaderError
    from rosbags.serde import SerdeError

    # what its parsers let through where bytes are damaged
    damaged = (KeyError, IndexError, TypeError, AttributeError, ArithmeticError, MemoryError)
    deep = (RecursionError, RuntimeError, EOFError)
    if not Path(bag).exists():
        raise ValueError(f"{bag}: no such file or folder")
    try:
        _check_files(Path(bag))
        with _bounded(), Reader(Path(bag)) as reader:
            for storage in getattr(reader.storage, "storages", [reader.storage]):
                _check_storage(storage)
            yield reader
    except (ReaderError, SerdeError, apsw.Error, *damaged, *deep) as error:
        what = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{bag}: cannot be read as a ROS 2 bag ({what})") from None
    except ValueError as error:
        what = " ".join(str(error).split())
        raise ValueError(what if what.startswith(str(bag)) else f"{bag}: {what}") from None


def _check_files(bag: Path) -> None:
    """Refuse a bag with a pipe or a device in it, or with a description that is too long."""
    for path in bag.iterdir() if bag.is_dir() else [bag]:
        if not path.is_dir():
            limits.check_regular(path)
    about = bag / METADATA
    if about.is_file():
        limits.check_bytes(about, about.stat().st_size, METADATA_BYTES)


def _check_storage(storage: Any) -> None:
    """Refuse chunks that would be in memory together, being of one time, and bound what a database
    makes of its cells.
    """
    import apsw

    _check_overlap(getattr(storage, "chunks", []))
    if (database := getattr(storage, "dbconn", None)) is not None:
        database.limit(apsw.SQLITE_LIMIT_LENGTH, limits.BAG_BYTES)


def _check_overlap(chunks: Sequence[Any]) -> None:
    """Refuse chunks that overlap in time, and together are more than is taken."""
    changes = [(one.message_start_time, 0, one.uncompressed_size) for one in chunks]
    changes += [(one.message_end_time, 1, -one.uncompressed_size) for one in chunks]
    held = 0
    for _, _, change in sorted(changes):
        held += change
        _check_held(held)


def _check_held(count: int) -> None:
    if count > limits.BAG_BYTES:
        raise ValueError(
            f"{count / limits.MIB:,.1f} MiB of messages at one time when decompressed, expected at "
            f"most {limits.BAG_BYTES / limits.MIB:,.0f}"
        )


@contextmanager
def _bounded() -> Iterator[None]:
    """Replace the decompressors of rosbags by bounded ones while the block runs."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag2 import reader, storage_mcap

    zstd: Any = reader.zstd  # of Python's own library, or its backport

    def chunk(unpacker: Callable[[], Any]) -> Callable[[bytes, int], bytes]:
        return lambda data, size: _unpacked(unpacker(), data, size)

    def message(data: bytes) -> bytes:
        return _unpacked(zstd.ZstdDecompressor(), data, limits.BAG_BYTES)

    def whole_file(file: BinaryIO, mode: str) -> Any:
        most = max(FILE_RATIO * _length(file), limits.BAG_BYTES)
        return _BoundedFile(zstd.open(file, mode), most)

    before = storage_mcap.DECOMPRESSORS
    reader.zstd = SimpleNamespace(decompress=message, open=whole_file)  # type: ignore[assignment]
    storage_mcap.DECOMPRESSORS = {
        **before,
        "zstd": chunk(zstd.ZstdDecompressor),
        "lz4": chunk(LZ4FrameDecompressor),
    }
    try:
        yield
    finally:
        reader.zstd = zstd
        storage_mcap.DECOMPRESSORS = before


def _unpacked(unpacker: Any, data: bytes, most: int) -> bytes:
    """What one frame holds. Raises ValueError for damaged ones, and for more bytes than `most` or than
    are taken.
    """
    _check_held(most)
    try:
        content: bytes = unpacker.decompress(data, max_length=most + 1)
    except Exception as error:  # each library has its own
        raise ValueError(f"cannot be decompressed ({error})") from None
    if len(content) > most:
        raise ValueError(f"cannot be decompressed (more than {most:,} bytes)")
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("cannot be decompressed (its end is missing, or more follows)")
    return content


def _length(file: BinaryIO) -> int:
    length = file.seek(0, 2)
    file.seek(0)
    return length


class _BoundedFile:
    """A file that is decompressed as it is read, up to so many bytes."""

    def __init__(self, file: Any, most: int) -> None:
        self._file = file
        self._left = most

    def __enter__(self) -> _BoundedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, size: int = shutil.COPY_BUFSIZE) -> bytes:  # type: ignore[attr-defined]
        content: bytes = self._file.read(size)
        self._left -= len(content)
        if self._left < 0:
            raise ValueError(f"a file that is {FILE_RATIO} times as long when it is decompressed")
        return content
