"""Real recordings made by others: their places on this machine, and fetching them on request.

They are not part of the package. A set lies in the folder that the environment variable
TRINOLAB_DATA names, or in the user's cache after it was fetched. Every file is checked against its
SHA-256 before it is used.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from .inputs import get, read_toml

VARIABLE = "TRINOLAB_DATA"


class RealFile(NamedTuple):
    """A file of a set: its name, its SHA-256 (hexadecimal), and its path below the set's
    address.
    """

    name: str
    sha256: str
    path: str


@dataclass(frozen=True)
class RealSet:
    """An entry of ``data/real.toml``, which explains the fields at its top.

    Attributes
    ----------
    name, what, licence, origin, address : str
    files : tuple of RealFile
    reference : dict
        Published and measured results.
    """

    name: str
    what: str
    licence: str
    origin: str
    address: str
    files: tuple[RealFile, ...]
    reference: dict[str, Any]


def read_real_sets(path: str | Path) -> dict[str, RealSet]:
    """Read the list of sets.

    Raises
    ------
    ValueError
        Names the file, the set and the field that is missing.
    """
    return {
        name: _set_from(name, row, f"{path}: [{name}]") for name, row in read_toml(path).items()
    }


def find(real: RealSet, fetch: bool = False) -> Path | None:
    """The folder of a set: below TRINOLAB_DATA, in the user's cache, or fetched into it.

    Parameters
    ----------
    real : RealSet
    fetch : bool
        Fetch what is in neither place. Without it nothing ever touches the network.

    Returns
    -------
    Path or None
        None if the set is not here and was not to be fetched.

    Raises
    ------
    ValueError
        If TRINOLAB_DATA names no folder, a file of the set is missing there or has another hash,
        the set cannot be fetched (no pinned address, no network), or the fetched file is another
        one.
    """
    named = os.environ.get(VARIABLE, "")
    if named and not Path(named).is_dir():
        raise ValueError(f"{VARIABLE}: expected a folder, got {named!r}")
    if named and (Path(named) / real.name).is_dir():
        return _checked(real, Path(named) / real.name)
    cache = cache_folder() / real.name
    if all((cache / file.name).is_file() for file in real.files):
        return _checked(real, cache)
    return _checked(real, _fetched(real, cache)) if fetch else None


def why_not(real: RealSet | None = None) -> str:
    """The reason why a set is not here, for a chapter, a test or the scoreboard."""
    named = os.environ.get(VARIABLE, "")
    what = real.name if real else "such set"
    return f"{VARIABLE} has no {what}" if named else f"{VARIABLE} is not set"


def cache_folder() -> Path:
    """The user's cache folder, which holds fetched sets."""
    import pooch

    return Path(pooch.os_cache("trinolab"))


def _fetched(real: RealSet, folder: Path) -> Path:
    """Fetch a set's files; says the licence on the logger of pooch, which writes to standard
    error.
    """
    import pooch

    if not real.address:
        raise ValueError(
            f"{real.name}: not fetched (licence: {real.licence}; origin: {real.origin}); "
            f"set {VARIABLE} to a folder that has {real.name}/"
        )
    pooch.get_logger().info(
        "%s: %s. Licence: %s. From %s", real.name, real.what, real.licence, real.origin
    )
    for file in real.files:
        address = f"{real.address}/{file.path}"
        try:
            pooch.retrieve(
                address, known_hash=f"sha256:{file.sha256}", fname=file.name, path=folder
            )
        except OSError as error:  # what requests raises is one, too
            raise ValueError(f"{real.name}: {address} cannot be fetched ({error})") from None
    return folder


def _checked(real: RealSet, folder: Path) -> Path:
    """The folder, if every file in it is the one that is meant."""
    for file in real.files:
        path = folder / file.name
        if not path.is_file():
            raise ValueError(f"{path}: missing; {real.name} needs it")
        if hashlib.sha256(path.read_bytes()).hexdigest() != file.sha256:
            raise ValueError(
                f"{path}: SHA-256 is not {file.sha256[:12]}...; this is another file than the one meant"
            )
    return folder


def _set_from(name: str, row: dict[str, Any], where: str) -> RealSet:
    files = tuple(
        RealFile(*(get(file, key, f"{where}: files") for key in RealFile._fields))
        for file in get(row, "files", where)
    )
    rest = {
        key: get(row, key, where) for key in ("what", "licence", "origin", "address", "reference")
    }
    return RealSet(name=name, files=files, **rest)
