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


@pytest.fixture
def built(tmp_path):
    """What a build leaves, as far as the crate looks at it."""
    for name in (*crate.PAGES, "notebooks/01_structure.html"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"<html>{name}</html>", encoding="utf-8")
    crate.write_crate(tmp_path)
    return tmp_path


def test_the_crate_keeps_the_rules_of_ro_crate(built):
    found = json.loads((built / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    assert found["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    entities = {entity["@id"]: entity for entity in found["@graph"]}
    assert len(entities) == len(found["@graph"])
    assert all(entity["@type"] for entity in entities.values())
    descriptor, root = entities["ro-crate-metadata.json"], entities["./"]
    assert descriptor["@type"] == "CreativeWork"
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert descriptor["about"] == {"@id": "./"}
    assert root["@type"] == "Dataset"
    assert all(root[name] for name in ("name", "description", "datePublished", "license"))
    referred = re.findall(r'\{"@id": "([^":]+)"\}', json.dumps(found["@graph"]))
    assert set(referred) <= set(entities)
    files = {at: entity for at, entity in entities.items() if entity["@type"] == "File"}
    assert {part["@id"] for part in root["hasPart"]} == set(files)
    for at, entity in files.items():
        assert not Path(at).is_absolute()
        assert entity["sha256"] == hashlib.sha256((built / at).read_bytes()).hexdigest()


def test_the_crate_has_pages_data_and_the_build(built):
    text = (built / "ro-crate-metadata.json").read_text(encoding="utf-8")
    entities = {entity["@id"]: entity for entity in json.loads(text)["@graph"]}
    pages = {"book/report.html", "notebooks/01_structure.html"}
    assert {*pages, "crate/data/claims_results.csv"} <= set(entities)
    assert datetime.fromisoformat(entities["#build"]["endTime"]).tzinfo is not None
    assert entities["#trinolab"]["version"] == PROJECT["version"]
    assert str(ROOT) not in text


# --- the other metadata


def test_the_citation_file_has_what_its_format_asks_for():
    assert CFF["cff-version"] == "1.2.0"
    assert CFF["type"] in ("software", "dataset")
    assert CFF["message"]
    assert all("name" in one or "family-names" in one for one in CFF["authors"])
    (paper,) = CFF["references"]
    assert {"type", "title", "authors"} <= set(paper)
    assert paper["url"] == crate.PAPER


def test_all_metadata_agree():
    assert CFF["version"] == CODEMETA["version"] == PROJECT["version"]
    assert CFF["license"] == PROJECT["license"]
    assert CODEMETA["license"].endswith(PROJECT["license"])
    assert CODEMETA["@context"] == "https://w3id.org/codemeta/3.0"
    for name, field in (
        ("name", "name"),
        ("description", "description"),
        ("softwareRequirements", "dependencies"),
    ):
        assert CODEMETA[name] == PROJECT[field]
    assert CODEMETA["keywords"] == CFF["keywords"]
    paper = CODEMETA["referencePublication"]
    assert paper["@id"] == crate.PAPER
    (cited,) = CFF["references"]
    families = [one["family-names"] for one in cited["authors"]]
    assert [one["familyName"] for one in paper["author"]] == families
    bibliography = (ROOT / "book" / "references.bib").read_text(encoding="utf-8")
    assert crate.PAPER in bibliography.split("liu_master,")[1].split("\n}")[0]
