"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def check_target(path: str | Path) -> None:
    """Refuse, with a ValueError, a place where `write_whole` could not write: asked before a long
    computation.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        raise ValueError(f"{path}: cannot be written (a folder or a device is there)")
    check_parent(path)


def check_parent(path: str | Path) -> None:
    """Refuse, with a ValueError, a file or a folder that could not be made where it is to be."""
    folder = resolved(path).parent
    if not folder.is_dir():
        raise ValueError(f"{path}: no such folder to write into")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{path}: cannot be written (no permission in its folder)")


def check_targets(targets: Iterable[str | Path], inputs: Iterable[str | Path] = ()) -> None:
    """Refuse as `check_target` does, and a file that would be written twice, or over one that the
    command reads.
    """
    taken = {resolved(path) for path in inputs}
    for path in targets:
        check_target(path)
        if resolved(path) in taken:
            raise ValueError(
                f"{path}: expected a file of its own, got one that this command reads, or writes as well"
            )
        taken.add(resolved(path))


def resolved(path: str | Path) -> Path:
    """The place that a path means. Raises ValueError for a link that leads to itself."""
    try:
        return Path(path).resolve()
    except RuntimeError:  # Python before 3.13
        raise ValueError(f"{path}: a link that leads to itself") from None


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file through a temporary one beside it, so that it is never seen half written.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    write_together({path: text})


def write_together(contents: Mapping[str | Path, str | bytes]) -> None:
    """Write files that belong together: the first one takes its name only when the last one is
    written, too.

    Raises
    ------
    ValueError
        Names the file that cannot be written.
    """
    written: list[tuple[Path, Path]] = []
    path: str | Path = ""
    try:
        for path, content in contents.items():
            check_target(path)
            written.append((_temporary(Path(path).resolve(), content), Path(path).resolve()))
        for temporary, target in written:
            os.replace(temporary, target)
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        for temporary, _ in written:
            temporary.unlink(missing_ok=True)


def _temporary(target: Path, content: str | bytes) -> Path:
    """A finished file beside the target, for everyone to read; none is left behind by a failure."""
    mode, encoding = ("w", "utf-8") if isinstance(content, str) else ("wb", None)
    with tempfile.NamedTemporaryFile(
        mode, dir=target.parent, prefix=f".{target.name}.", delete=False, encoding=encoding
    ) as file:
        temporary = Path(file.name)
        try:
            file.write(content)
            file.close()
            temporary.chmod(0o644)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    return temporary


def table_text(table: pd.DataFrame) -> str:
    """CSV of a table: nine digits of a number, and nanoseconds of a time ``t_s``, which may count
    from 1970.
    """
    if "t_s" in table:
        table = table.assign(t_s=table["t_s"].map(time_text, na_action="ignore"))
    return table.to_csv(index=False, float_format="%.9g", lineterminator="\n")


def time_text(t_s: float) -> str:
    """A time, s, to a nanosecond."""
    return f"{t_s:.9f}".rstrip("0").rstrip(".")


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table that `load_sweep` reads back, whole or not at all; six digits."""
    write_whole(path, table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
