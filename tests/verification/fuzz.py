"""Readers of users' files on wrong files: no exception but a ValueError of one line that names the file."""

from fuzzing import READERS, fuzz, kinds

SHARES = {"values": 5, "text": 4, "bytes": 2, "cut": 1}


def report(arguments) -> None:
    print(f"{arguments.files} files for the readers, most of them wrong: taken, or refused by a ValueError of a line")
    print(f"{'reader':11s} {'what is wrong':13s} {'files':>7s} {'taken':>7s} {'refused':>7s}  anything else")
    parts = [(name, kind) for name in READERS for kind in kinds(name)]
    whole, total = sum(SHARES[kind] for _, kind in parts), 0
    for name, kind in parts:
        total += _line(name, kind, -(-arguments.files * SHARES[kind] // whole))
    print(f"{total} files in all", flush=True)


def _line(name: str, kind: str, count: int) -> int:
    try:
        counts, finding = fuzz(name, kind, count), "none"
    except Exception as error:  # a finding is what this looks for
        counts, finding = {}, f"{type(error).__name__}: {error}".replace("\n", " | ")
    taken, refused = counts.get("taken", 0), counts.get("refused", 0)
    print(f"{name:11s} {kind:13s} {taken + refused:7d} {taken:7d} {refused:7d}  {finding}", flush=True)
    return taken + refused
