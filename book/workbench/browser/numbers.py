"""Run chapters in a browser and compare what they glue there with the built pages.

    python -m workbench.browser.numbers [CHAPTER ...]

The browser is a second platform: another processor's arithmetic, other releases of the libraries,
another build of OpenCV. The table goes to ``data/browser_numbers.csv``, and ``make browser`` shows it
as a page. It takes a quarter of an hour for chapters 1 to 9.
"""

from __future__ import annotations

import argparse
import functools
import html
import json
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from trinolab.files.outputs import write_table

from ..pages.browser import Browser
from ..pages.build import BUILD, ROOT, chapters, result_of
from ..sweep.notebook import glued, read_notebook

SITE = BUILD / "browser"
TABLE = ROOT / "data" / "browser_numbers.csv"
SPREAD = 1e-3  # of a number, as a share: other libraries draw, sort and converge otherwise
CORNERS = "not run: OpenCV.js has no findChessboardCorners"
SOLVEPNP = (
    "the browser's solvePnP is that of OpenCV 5; in which draws it differs is not looked into"
)
TRACKED = "not run: tracking is compiled by Numba, which no browser has"
# What may differ by more, by the chapter and how the name begins, and why.
APART = {
    ("01_structure", "film_"): TRACKED,
    ("07_calibration", "corner_"): CORNERS,
    ("07_calibration", "half_window"): CORNERS,
    ("07_calibration", "assumed_px"): CORNERS,
    ("07_calibration", "opencv_by_sigma"): "how far OpenCV's minimum is from ours; here SciPy's is",
    ("07_calibration", "free_apart_um"): "how far OpenCV's minimum is from ours; here SciPy's is",
    ("08_pose", "pnp_"): SOLVEPNP,
    ("08_pose", "far_"): SOLVEPNP,
}
LESSONS = 9  # chapters that run whole
LOOK_S = 0.5


class Ran(NamedTuple):
    """What became of a chapter: the numbers that it glued, and what each cell says of its run."""

    glued: dict[str, Any]
    cells: list[tuple[str, str]]


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Serve a folder on this machine's own address, as any static host does; yields the address."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def wait_until_idle(browser: Browser) -> None:
    """Wait until nothing runs on the chapter's page that is open."""
    time.sleep(LOOK_S)
    while browser.evaluate("book.running"):
        time.sleep(LOOK_S)


def run_chapter(browser: Browser, address: str) -> Ran:
    """Open a chapter's page, run all of its cells, and return what they gave."""
    browser.open(address)
    browser.evaluate("void book.run(book.cells)")
    wait_until_idle(browser)
    states = browser.evaluate(
        "book.cells.map(({status}) => [status.dataset.kind ?? '', status.textContent])"
    )
    return Ran(browser.evaluate("book.glued"), [(kind, says) for kind, says in states])


def agrees(built: Any, here: Any) -> bool:
    """Whether two values are the same: a text exactly, a number within `SPREAD`."""
    if isinstance(built, int | float) and isinstance(here, int | float):
        return built == here or abs(built - here) <= SPREAD * max(abs(built), abs(here))
    return str(built) == str(here)


def compared(chapter: str, built: Mapping[str, Any], here: Mapping[str, Any]) -> pd.DataFrame:
    """The numbers of a chapter from both platforms, one per row."""
    rows = [
        {
            "chapter": chapter,
            "name": name,
            "built": value,
            "browser": here.get(name),
            "agrees": name in here and agrees(value, here[name]),
        }
        for name, value in built.items()
    ]
    table = pd.DataFrame(rows)
    table["why"] = [
        "" if row["agrees"] else why_apart(chapter, row["name"]) for row in table.to_dict("records")
    ]
    return table


def why_apart(chapter: str, name: str) -> str:
    """Why a number may differ by more than `SPREAD`; empty if nothing is known."""
    return next(
        (why for (of, begin), why in APART.items() if of == chapter and name.startswith(begin)), ""
    )


def of_chapter(chapter: str, ran: Ran) -> pd.DataFrame:
    """The numbers of a chapter's built page and those of its run, one per row."""
    return compared(chapter, glued(read_notebook(result_of(chapter))), ran.glued)


def page_of(table: pd.DataFrame) -> str:
    """A page that lists both, those that do not agree first."""
    rows = "\n".join(map(_row, table.sort_values("agrees", kind="stable").to_dict("records")))
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Numbers of two platforms</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>body {{ font-family: sans-serif; max-width: 60em; margin: 1em auto; padding: 0 1em; }}
table {{ border-collapse: collapse; }} td, th {{ border: 1px solid #bbb; padding: 0.2em 0.5em;
text-align: left; overflow-wrap: anywhere; }} .differs {{ background: #fde8e0; }}</style>
<h1>Numbers of two platforms</h1>
<p>Each number that a chapter's text quotes, as the book was built with it and as the same cells give
it in a browser, on WebAssembly with other releases of the libraries. {int(table["agrees"].sum())} of
{len(table)} agree: a text exactly, a number within {SPREAD:g} of its size.</p>
<table><tr><th>chapter</th><th>name</th><th>built page</th><th>browser</th><th>agrees</th></tr>
{rows}
</table></html>
"""


def _row(row: Mapping[str, Any]) -> str:
    """A row of the page's table."""
    agrees = "yes" if row["agrees"] else f"no: {row['why']}"
    texts = [row["chapter"], row["name"], _short(row["built"]), _short(row["browser"]), agrees]
    cells = "".join(f"<td>{html.escape(str(text))}</td>" for text in texts)
    return f"<tr{'' if row['agrees'] else ' class=differs'}>{cells}</tr>"


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the chapters named, all lessons by default, and write the table; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m workbench.browser.numbers")
    parser.add_argument("chapter", nargs="*", help="such as 04_kalman; chapters 1 to 9 by default")
    asked = (
        parser.parse_args(arguments).chapter
        or [path.stem for path in chapters() if path.stem[:2].isdigit() and path.stem[2] == "_"][
            :LESSONS
        ]
    )
    if not (SITE / "index.html").exists():
        print(f"{SITE}: not there; `make browser` builds it", file=sys.stderr)
        return 2
    tables = _tables()
    failed = False
    with tempfile.TemporaryDirectory() as folder, serving(SITE) as address:
        for chapter in asked:
            start = time.monotonic()
            browser = Browser(Path(tempfile.mkdtemp(dir=folder)))
            try:
                ran = run_chapter(browser, f"{address}/notebooks/{chapter}.html")
            finally:
                browser.close()
            table = of_chapter(chapter, ran)
            kinds = [kind for kind, _ in ran.cells]
            print(
                f"{chapter}: {time.monotonic() - start:.0f} s, {kinds.count('done')} of {len(kinds)} "
                f"cells ran, {kinds.count('cannot')} cannot; "
                f"{table['agrees'].sum()} of {len(table)} numbers agree",
                flush=True,
            )
            for number, (kind, says) in enumerate(ran.cells, start=1):
                if kind != "done":
                    print(f"    cell {number}: {says or 'was not reached'}")
            for row in table[~table["agrees"]].to_dict("records"):
                print(
                    f"    {row['name']}: {json.dumps(row['built'])}, here {json.dumps(row['browser'])}"
                )
            failed |= "failed" in kinds
            tables[chapter] = table
            # after each chapter, so that an interruption loses nothing
            write_table(pd.concat([tables[name] for name in sorted(tables)]), TABLE)
    return int(failed)


def _tables() -> dict[str, pd.DataFrame]:
    """What the table has of each chapter."""
    if not TABLE.exists():
        return {}
    known = pd.read_csv(TABLE, keep_default_na=False)
    return {str(chapter): rows for chapter, rows in known.groupby("chapter")}


if __name__ == "__main__":
    sys.exit(main())
