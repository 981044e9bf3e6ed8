"""The course as one zip with all that is needed to start: ``python -m workbench.pages.coursezip``.

It has the pages of the book, the notebooks, the package as a wheel, and what to install. The
students' has no solution, no teacher's note and no exam; the teachers' has them all.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from ..course.editions import EDITIONS, edition_files, entry_of
from .build import BUILD, HTML, ROOT
from .dist import LEFT_OUT, write_wheel
from .slides import write_all_slides
from .studentbook import STUDENT_HTML, build_student_book


def main(argv: Sequence[str] | None = None) -> int:
    """Write the zip of an edition and return the exit code: 2 for a mistake in the input."""
    parser = argparse.ArgumentParser(
        prog="python -m workbench.pages.coursezip",
        description=(__doc__ or "").partition("\n\n")[0],
    )
    parser.add_argument("edition", choices=EDITIONS)
    parser.add_argument("--out", type=Path, metavar="FILE.zip", help="(_build/EDITION.zip)")
    arguments = parser.parse_args(argv)
    target = arguments.out or BUILD / f"{arguments.edition}.zip"
    if not (HTML / "index.html").exists():
        print(f"{parser.prog}: no built pages: run `make book` first", file=sys.stderr)
        return 2
    pages = HTML
    if arguments.edition == "student":
        print("building the students' pages", flush=True)
        pages = STUDENT_HTML
        if not build_student_book():
            return 1
    try:
        write_zip(arguments.edition, pages, target)
    except ValueError as error:
        print(f"{parser.prog} {arguments.edition}: {error}", file=sys.stderr)
        return 2
    print(f"written: {target}, {target.stat().st_size / 1e6:.0f} MB")
    return 0


def write_zip(edition: str, pages: Path, target: Path) -> None:
    """Write an edition's notebooks, its built pages and the wheel into one zip, whole or not at all.

    Parameters
    ----------
    edition
        ``student`` or ``teacher``.
    pages
        The folder of its built pages.
    target
        The zip.
    """
    partial = target.with_suffix(".partial")
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(partial, "w") as whole:
        for name, text in sorted(edition_files(edition).items()):
            whole.writestr(entry_of(name), text)
        for path in sorted(pages.glob("**/*")):
            place = path.relative_to(pages).as_posix()
            if path.is_file() and not place.startswith(LEFT_OUT):
                whole.writestr(entry_of(f"book/{place}"), path.read_bytes())
        if edition == "teacher":
            write_all_slides(Path(folder) / "slides")
            for path in sorted(Path(folder).glob("slides/**/*")):
                if path.is_file():
                    place = path.relative_to(folder).as_posix()
                    whole.writestr(entry_of(place), path.read_bytes())
        wheel = write_wheel(ROOT, Path(folder))
        whole.writestr(entry_of(wheel.name), wheel.read_bytes())
    partial.replace(target)


if __name__ == "__main__":
    sys.exit(main())
