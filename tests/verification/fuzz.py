"""Readers of users' files on wrong files: no exception but a ValueError of one line that names the
file.
"""

from collections import Counter

from fuzzing import READERS, fuzz, kinds

SHARES = {"text": 3, "bytes": 1}
# neither TOML nor CSV: not counted among the files that were asked for
BESIDE = ("manifest", "image")


def report(arguments) -> bool:
    """Whether nothing was found."""
    print(
        f"{arguments.files} TOML and CSV files, most of them wrong, and others: taken, or refused by a ValueError of\n"
        "one line that names the file; anything else is a finding"
    )
    parts = [(name, kind) for name in READERS for kind in kinds(name)]
    whole = sum(SHARES[kind] for name, kind in parts if name not in BESIDE)
    findings = [_finding(*part, -(-arguments.files * SHARES[part[1]] // whole)) for part in parts]
    return not any(findings)


def _finding(name: str, kind: str, count: int) -> str:
    """Print a reader's line; what was found, if anything."""
    counts, finding = Counter[str](), ""
    try:
        counts.update(fuzz(name, kind, count))
    except Exception as error:  # a finding is what this looks for
        finding = f"{type(error).__name__}: {error}".replace("\n", " | ")
    taken, refused = counts["taken"], counts["refused"]
    print(f"{name:11s} {kind:7s} {taken:7d} taken {refused:7d} refused  {finding}", flush=True)
    return finding
