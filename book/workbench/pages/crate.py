"""The built pages as an RO-Crate: what they stand on is put beside them, and a file describes both.

The rules are those of RO-Crate 1.1 (https://www.researchobject.org/ro-crate/specification/1.1/).
"""

from __future__ import annotations

import json
import mimetypes
import shutil
import tomllib
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from trinolab.files.outputs import write_whole

from ..provenance import commit
from .numbers import ROOT, sha256

# of RO-Crate, and the one term of schema.org that it does not have
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
PAPER = "http://www.naturalspublishing.com/Article.asp?ArtcID=8106"
CC_BY = "https://creativecommons.org/licenses/by/4.0/"
BSD = "https://spdx.org/licenses/BSD-3-Clause"
PAPER_AUTHORS = ("Liu, Qiong", "Cao, LeiLei", "Chen, Jiang", "He, ZhaoXia")
# of the repository, copied beside the pages -> what it is
STANDS_ON = {
    "data/table1.csv": "The paper's Table 1",
    "data/calibration.toml": "The paper's calibration, Sect. 6.2",
    "data/equations.toml": "The ledger of the paper's equations",
    "data/claims.toml": "The protocol: claims and criteria",
    "data/deviations.toml": "The log of deviations from the protocol",
    "data/claims_results.csv": "The results of the protocol's run",
    "data/claims_draws.csv": "Every draw of the protocol's run",
    "data/sensitivity.csv": "What each assumption is worth",
    "environment.txt": "The exact environment, with hashes",
    "CITATION.cff": "How to cite",
    "codemeta.json": "The software, for catalogues",
    "LICENSE": "The licence of the code",
}
PAGES = {"book/start.html": "Start page and scoreboard", "book/report.html": "Replication report"}


def write_crate(html: Path) -> None:
    """Copy the files of `STANDS_ON` beside the built pages, and write ``ro-crate-metadata.json``."""
    for name in STANDS_ON:
        target = html / "crate" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, target)
    text = json.dumps(metadata(html), indent=1, ensure_ascii=False)
    write_whole(html / "ro-crate-metadata.json", text + "\n")


def metadata(html: Path) -> dict[str, Any]:
    """The description of the crate, as JSON-LD."""
    chapters = sorted(path.relative_to(html).as_posix() for path in html.glob("notebooks/*.html"))
    pages = [
        _file(html, name, PAGES.get(name, "A chapter of the book"), CC_BY)
        for name in (*PAGES, *chapters)
    ]
    inputs = [_file(html, f"crate/{name}", what, BSD) for name, what in STANDS_ON.items()]
    now = datetime.now(UTC).isoformat(timespec="seconds")
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": "trinolab: a three-camera master handle, reproduced",
        "description": "The executed book, its scoreboard and its replication report, with the data that they "
        "stand on.",
        "datePublished": now[:10],
        "license": {"@id": CC_BY},
        "author": {"@id": "#authors"},
        "publisher": {"@id": "#authors"},
        "hasPart": [{"@id": entity["@id"]} for entity in (*pages, *inputs)],
        "mainEntity": {"@id": "book/report.html"},
        "citation": {"@id": PAPER},
        "mentions": {"@id": "#build"},
    }
    build = {
        "@id": "#build",
        "@type": "CreateAction",
        "name": "make book",
        "endTime": now,
        "agent": {"@id": "#authors"},
        "instrument": {"@id": "#trinolab"},
        "object": [{"@id": entity["@id"]} for entity in inputs],
        "result": [{"@id": entity["@id"]} for entity in pages],
    }
    descriptor = {
        "@id": "ro-crate-metadata.json",
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }
    graph = [descriptor, root, *pages, *inputs, build, _software(), *_surroundings()]
    return {"@context": CONTEXT, "@graph": graph}


def _file(html: Path, name: str, what: str, licence: str) -> dict[str, Any]:
    path = html / name
    kind = mimetypes.guess_type(name)[0] or "text/plain"
    return {
        "@id": name,
        "@type": "File",
        "name": what,
        "encodingFormat": kind,
        "contentSize": str(path.stat().st_size),
        "sha256": sha256(path),
        "license": {"@id": licence},
    }


def _software() -> dict[str, Any]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "@id": "#trinolab",
        "@type": "SoftwareSourceCode",
        "name": project["name"],
        "description": project["description"],
        "version": version("trinolab"),
        "identifier": commit() or "unknown",
        "programmingLanguage": "Python",
        "license": {"@id": BSD},
        "author": {"@id": "#authors"},
    }


def _surroundings() -> list[dict[str, Any]]:
    """The entities that others refer to: authors, licences, the paper."""
    people = [
        {"@id": f"#{name.partition(',')[0].lower()}", "@type": "Person", "name": name}
        for name in PAPER_AUTHORS
    ]
    return [
        {"@id": "#authors", "@type": "Organization", "name": "The trinolab authors"},
        {"@id": CC_BY, "@type": "CreativeWork", "name": "CC BY 4.0", "identifier": CC_BY},
        {"@id": BSD, "@type": "CreativeWork", "name": "BSD-3-Clause", "identifier": BSD},
        {
            "@id": PAPER,
            "@type": "ScholarlyArticle",
            "name": "The Master Manipulator Control System in a Master-Slave Robot based on Trinocular "
            "Stereo Vision",
            "author": [{"@id": person["@id"]} for person in people],
            "publisher": {"@id": "#publisher"},
            "pagination": "749-757",
        },
        {
            "@id": "#publisher",
            "@type": "Organization",
            "name": "Natural Sciences Publishing",
            "url": "http://www.naturalspublishing.com/",
        },
        *people,
    ]
