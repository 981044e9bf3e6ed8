"""What is given away: the book as one zip for readers, and the package as a wheel: `make dist`.

    .venv/bin/python -m workbench.pages.dist

writes ``trinolab-book-VERSION.zip``, which opens from ``index.html``, and the wheel into
``_build/dist``.
"""

from __future__ import annotations

import subprocess
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
HTML = ROOT / "_build" / "html"
DIST = ROOT / "_build" / "dist"
LEFT_OUT = (".buildinfo", "objects.inv")  # what Sphinx keeps for itself
README = """Unpack this zip, and open index.html in a browser. No network is needed.

Text and figures: CC BY 4.0. Code: BSD-3-Clause, see crate/LICENSE. To cite: crate/CITATION.cff.
ro-crate-metadata.json names the pages, the data that they stand on, and their hashes.
"""


def main() -> int:
    """Write both, say where they are, and return the exit code."""
    if not (HTML / "index.html").exists():
        print("no built pages: run `make book` first", file=sys.stderr)
        return 2
    DIST.mkdir(parents=True, exist_ok=True)
    for path in (write_zip(HTML, DIST), write_wheel(ROOT, DIST)):
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    return 0


def write_zip(html: Path, folder: Path) -> Path:
    """Write the built pages into one zip, whole or not at all; return its path.

    All of it lies in one folder, so that whoever unpacks it finds it again.
    """
    name = f"trinolab-book-{version('trinolab')}"
    target = folder / f"{name}.zip"
    partial = target.with_suffix(".partial")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr(f"{name}/README.txt", README)
        for path in sorted(html.glob("**/*")):
            place = path.relative_to(html).as_posix()
            if path.is_file() and not place.startswith(LEFT_OUT):
                book.write(path, f"{name}/{place}")
    partial.replace(target)
    return target


def write_wheel(root: Path, folder: Path) -> Path:
    """Build the wheel of both packages with the environment's own hatchling; return its path."""
    for old in folder.glob("trinolab-*.whl"):
        old.unlink()
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder.resolve())],
        cwd=root,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise ValueError(f"the wheel could not be built: {done.stderr.strip()[-500:]}")
    (wheel,) = folder.glob("trinolab-*.whl")
    return wheel


if __name__ == "__main__":
    sys.exit(main())
