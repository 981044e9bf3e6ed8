"""Readers of users' files on wrong files: no exception but a ValueError of one line that names the
file.
"""

import sys

from fuzzing import READERS, fuzz, kinds

SHARES = {"values": 5, "text": 4, "bytes": 2, "cut": 1}
# neither TOML nor CSV: not counted among the files that were asked for
BESIDE = ("manifest", "image")


def report(arguments) -> None:
    print(
        f"{arguments.files} TOML and CSV files, most of them wrong, and others: taken, or refused by a ValueError of"
    )
    print(
        "one line that names the file; anything else is a finding, and ends this with exit code 1"
    )
    print(
        f"{'reader':11s} {'what is wrong':13s} {'files':>7s} {'taken':>7s} {'refused':>7s}  finding"
    )
    parts = [(name, kind) for name in READERS for kind in kinds(name)]
    whole = sum(SHARES[kind] for name, kind in parts if name not in BESIDE)
    lines = [_line(name, kind, -(-arguments.files * SHARES[kind] // whole)) for name, kind in parts]
    tables = sum(
        count for (name, _), (count, _) in zip(parts, lines, strict=True) if name not in BESIDE
    )
    print(
        f"{tables} TOML and CSV files, {sum(count for count, _ in lines)} files in all", flush=True
    )
    if any(finding for _, finding in lines):
        sys.exit(1)


def _line(name: str, kind: str, count: int) -> tuple[int, str]:
    """Print a reader's line; how many files it took or refused, and what was found."""
    try:
        counts, finding = fuzz(name, kind, count), ""
    except Exception as error:  # a finding is what this looks for
        counts, finding = {}, f"{type(error).__name__}: {error}".replace("\n", " | ")
    taken, refused = counts.get("taken", 0), counts.get("refused", 0)
    print(
        f"{name:11s} {kind:13s} {taken + refused:7d} {taken:7d} {refused:7d}  {finding or 'none'}",
        flush=True,
    )
    return taken + refused, finding
