"""Tables in TOML, JSON and CSV. A file that cannot be read, or exceeds `limits`, raises a
ValueError that names it.
"""

from __future__ import annotations

import codecs
import io
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from . import limits

if TYPE_CHECKING:
    import pandas as pd


# what may stand before a table: a mark, comments, a spreadsheet's line of its separator
_BEFORE = re.compile(rb"(?:\xef\xbb\xbf)?(?:(?:#[^\r\n]*|sep=[,;\t])(?:\r\n?|\n)){0,1000}")
_NUMBER_FIRST = re.compile(rb"[ \t]*[-+.]*\d")


class _TooManyError(ValueError):
    """A table with more words than allowed."""


def read_csv(path: str | Path, **options: Any) -> pd.DataFrame:
    """Read a CSV file of this computer; `options` are those of `pandas.read_csv`.

    The file is read here: pandas would fetch an address, and unpack what is named like an archive. What
    spreadsheets and NumPy save is read as well, see `_form`.

    Raises
    ------
    ValueError
        Names the file: unreadable, empty, no text, rows of different lengths, too large.
    """
    import pandas as pd  # only here: `trinolab.measure` loads without it

    content, form = _form(_text(path, limits.TABLE_BYTES))
    limits.check_table(path, content, form["sep"].encode())
    options = {"skipinitialspace": True, **form, **options}
    try:
        text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", newline="")
        table = _read(path, text, content, options)
    except _TooManyError:
        raise
    except (ValueError, OverflowError) as error:  # pandas' own are of the first kind
        raise ValueError(f"{path}: no valid CSV ({_reason(error)})") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path}: no valid CSV (rows have more fields than the first line)")
    return table


def _form(content: bytes) -> tuple[bytes, dict[str, str]]:
    """A table as UTF-8 that begins with its header, and how it is separated: by commas, semicolons or
    tabs, with decimal points or commas. Lines that begin with ``#`` may stand before; the last of them
    is the header where numbers follow it, as NumPy writes tables.
    """
    begin = _BEFORE.match(content).end()  # type: ignore[union-attr]
    before, content = content[:begin].replace(b"\r", b"\n").rstrip(b"\n"), content[begin:]
    first = re.match(rb"[^\r\n]{0,65536}", content)[0]  # type: ignore[index]
    separator = max((b",", b";", b"\t"), key=first.count)
    header = before.rpartition(b"\n")[2].removeprefix(b"#").strip()
    if _NUMBER_FIRST.match(first) and 0 < first.count(separator) == header.count(separator):
        content, first = header + b"\n" + content, header
    names = separator.join(name.strip() for name in first.split(separator))
    content = names + content[len(first) :]
    comma = separator != b"," and re.search(rb"\d,\d", content)
    point = comma and re.search(rb"\d\.\d", content)
    return content, {"sep": separator.decode(), "decimal": "," if comma and not point else "."}


def _read(path: str | Path, text: IO[str], content: bytes, options: dict[str, Any]) -> pd.DataFrame:
    """The table; a large one is read in pieces, so that one of more words than are taken is refused
    when they have come.
    """
    import pandas as pd

    lines = content.count(b"\n") + content.count(b"\r") + 1
    cells = content.count(options["sep"].encode()) + lines
    if cells <= limits.WORDS:
        return pd.read_csv(text, low_memory=False, **options)
    pieces, words = [], 0
    at_a_time = max(limits.WORDS // 4 * lines // cells, 1)
    for piece in pd.read_csv(text, low_memory=False, chunksize=at_a_time, **options):
        words += len(piece) * len(piece.select_dtypes(exclude=["number", "bool"]).columns)
        if words > limits.WORDS:
            raise _TooManyError(f"{path}: expected at most {limits.WORDS:,} words in its cells")
        pieces.append(piece)
    return pd.concat(pieces)


def _reason(error: Exception) -> str:
    """The reason why pandas refuses a CSV file, in words that need no knowledge of it."""
    import pandas as pd

    if isinstance(error, pd.errors.EmptyDataError):
        return "it is empty"
    if lengths := re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error)):
        first, line, there = lengths.groups()
        return f"line {line} has {there} fields, the lines before have {first}"
    if isinstance(error, UnicodeDecodeError):
        return "its text is not UTF-8"
    if missing := re.search(r"columns expected but not found: (\[.*\])", str(error)):
        names = sorted(re.findall(r"'([^']*)'", missing[1]))
        return f"column {', '.join(names)} is missing"
    if "EOF inside string" in str(error):
        return "a quotation mark is not closed"
    return (str(error).splitlines() or ["?"])[0]


def get(table: Mapping[str, Any], key: str, where: str) -> Any:
    """Return ``table[key]`` of a file's table; a missing key is a ValueError that names file and
    key.
    """
    if not isinstance(table, Mapping) or key not in table:
        raise ValueError(f"{where}: '{key}' is missing")
    return table[key]


def read_toml(path: str | Path, most: int = limits.TOML_BYTES) -> dict[str, Any]:
    """Read a TOML file of at most so many bytes; what cannot be opened or parsed is a ValueError that
    names the file, and so is YAML.
    """
    if Path(path).suffix.lower() in (".yaml", ".yml"):
        raise ValueError(f"{path}: expected TOML, got YAML by its name")
    content = _text(path, most)
    limits.check_toml(path, content)
    try:
        return tomllib.loads(content.decode("utf-8-sig"))  # editors of Windows put a mark before it
    except RecursionError:
        raise ValueError(f"{path}: no valid TOML (lists within lists, too many)") from None
    except (
        ValueError
    ) as error:  # tomllib's own, text that is not UTF-8, a whole number of thousands of digits
        raise ValueError(f"{path}: no valid TOML ({error})") from None


def read_json(path: str | Path) -> Any:
    """Read a JSON file; what cannot be opened or parsed is a ValueError that names the file."""
    content = _content(path, limits.TREE_BYTES)
    try:
        return json.loads(content.decode())
    except (ValueError, RecursionError):
        raise ValueError(f"{path}: no valid JSON") from None


def _text(path: str | Path, most: int) -> bytes:
    """A text's bytes as UTF-8, which Windows may have saved as UTF-16; errors as for `_content`."""
    content = _content(path, most)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace").encode()
    return content


def _content(path: str | Path, most: int) -> bytes:
    """A file's bytes. Raises ValueError, which names it, if it cannot be read, or is longer."""
    try:
        return limits.read_bytes(path, most)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
