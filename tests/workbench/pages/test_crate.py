"""The RO-Crate of the built pages, by the rules of RO-Crate 1.1, and the other metadata."""

import hashlib
import json
import re
import tomllib
from datetime import datetime
from pathlib import Path

import pytest
import yaml

from workbench.pages import crate

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CFF = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
CODEMETA = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))


def problems(folder):
    """What breaks a rule of RO-Crate 1.1 in a folder's ``ro-crate-metadata.json``."""
    found = json.loads((folder / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    entities = {entity.get("@id"): entity for entity in found["@graph"]}
    said = []
    first, *more = found["@context"]
    if first != "https://w3id.org/ro/crate/1.1/context" or any("@vocab" in terms for terms in more):
        said.append("context")
    if len(entities) != len(found["@graph"]) or None in entities:
        said.append("every entity has an @id of its own")
    if not all(entity.get("@type") for entity in entities.values()):
        said.append("every entity has a @type")
    descriptor = entities.get("ro-crate-metadata.json", {})
    if (
        descriptor.get("@type") != "CreativeWork"
        or descriptor.get("conformsTo") != {"@id": "https://w3id.org/ro/crate/1.1"}
        or descriptor.get("about") != {"@id": "./"}
    ):
        said.append("descriptor")
    root = entities.get("./", {})
    if root.get("@type") != "Dataset" or not all(
        root.get(name) for name in ("name", "description", "datePublished", "license")
    ):
        said.append("root")
    said += [
        f"{at} is nowhere"
        for at in references(found["@graph"])
        if at not in entities and ":" not in at
    ]
    files = {at for at, entity in entities.items() if entity.get("@type") == "File"}
    if {part["@id"] for part in root.get("hasPart", [])} != files:
        said.append("every file is a part of the root")
    for at in files:
        if at.startswith("/") or ".." in at or not (folder / at).is_file():
            said.append(f"{at}: no such file")
        elif hashlib.sha256((folder / at).read_bytes()).hexdigest() != entities[at]["sha256"]:
            said.append(f"{at}: another hash")
    return said


def references(value):
    """Every @id to which an entity refers."""
    if isinstance(value, list):
        return [at for item in value for at in references(item)]
    if not isinstance(value, dict):
        return []
    if set(value) == {"@id"}:
        return [value["@id"]]
    return [at for item in value.values() for at in references(item)]


@pytest.fixture
def built(tmp_path):
    """What a build leaves, as far as the crate looks at it."""
    for name in (*crate.PAGES, "notebooks/01_structure.html"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"<html>{name}</html>", encoding="utf-8")
    crate.write_crate(tmp_path)
    return tmp_path


def test_the_crate_keeps_the_rules(built):
    assert problems(built) == []


def test_the_crate_has_pages_data_and_the_build(built):
    graph = json.loads((built / "ro-crate-metadata.json").read_text(encoding="utf-8"))["@graph"]
    entities = {entity["@id"]: entity for entity in graph}
    for name in (
        "book/report.html",
        "notebooks/01_structure.html",
        "crate/data/claims_results.csv",
    ):
        assert entities[name]["@type"] == "File"
    assert datetime.fromisoformat(entities["#build"]["endTime"]).tzinfo is not None
    assert entities["#trinolab"]["version"] == PROJECT["version"]
    assert str(ROOT) not in json.dumps(graph)


@pytest.mark.parametrize(
    ("break_it", "problem"),
    [
        (
            lambda f, text: (f / "book/report.html").write_text("other"),
            "book/report.html: another hash",
        ),
        (lambda f, text: (f / "crate/LICENSE").unlink(), "crate/LICENSE: no such file"),
        (lambda f, text: rewrite(f, text, '"@id": "#authors"', '"@id": "#nobody"', 1), "#nobody"),
        (lambda f, text: rewrite(f, text, "ro/crate/1.1/context", "ro/crate/9/context"), "context"),
        (lambda f, text: rewrite(f, text, '"datePublished"', '"published"'), "root"),
    ],
)
def test_a_broken_crate_is_found(built, break_it, problem):
    break_it(built, (built / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    assert any(said.startswith(problem) for said in problems(built))


def rewrite(folder, text, old, new, count=-1):
    (folder / "ro-crate-metadata.json").write_text(text.replace(old, new, count), encoding="utf-8")


# --- the other metadata


def test_the_citation_file_has_what_its_format_asks_for():
    assert CFF["cff-version"] == "1.2.0"
    assert CFF["type"] in ("software", "dataset")
    assert CFF["message"]
    assert all("name" in one or "family-names" in one for one in CFF["authors"])
    known = {
        "cff-version",
        "message",
        "type",
        "title",
        "version",
        "license",
        "abstract",
        "keywords",
        "authors",
        "references",
    }
    assert set(CFF) <= known
    (paper,) = CFF["references"]
    assert {"type", "title", "authors"} <= set(paper)
    assert paper["url"] == crate.PAPER


def test_all_metadata_agree():
    assert CFF["version"] == CODEMETA["version"] == PROJECT["version"]
    assert CFF["license"] == PROJECT["license"]
    assert CODEMETA["license"].endswith(PROJECT["license"])
    assert CODEMETA["name"] == PROJECT["name"]
    assert CODEMETA["description"] == PROJECT["description"]
    assert CODEMETA["softwareRequirements"] == PROJECT["dependencies"]
    assert CODEMETA["keywords"] == CFF["keywords"]
    paper = CODEMETA["referencePublication"]
    assert paper["@id"] == crate.PAPER
    assert [one["familyName"] for one in paper["author"]] == [
        one["family-names"] for one in CFF["references"][0]["authors"]
    ]
    bibliography = (ROOT / "book" / "references.bib").read_text(encoding="utf-8")
    entry = bibliography.split("liu_master,")[1].split("\n}")[0]
    assert crate.PAPER in entry
    assert re.search(r"pages|pp\.", entry)


def test_codemeta_is_of_its_vocabulary():
    assert CODEMETA["@context"] == "https://w3id.org/codemeta/3.0"
    assert CODEMETA["@type"] == "SoftwareSourceCode"
