"""The folder for a host, and the comparison of its numbers, without a browser."""

import ast
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from pages import HTML, built

from trinolab.bench.rendering import made_from, scripted, write_recording
from trinolab.datasets import load_handle, load_rig
from trinolab.files import recording
from trinolab.files.images import read_grey
from trinolab.files.recording_writer import write_image
from workbench.browser import fetch, numbers, site
from workbench.browser.guest import frames
from workbench.pages.build import chapters

PAGE = '<html><head></head><body><div class="cell docutils container"></div></body></html>'


def test_a_page_gets_its_cells_as_data_that_no_script_ends():
    cells = [{"source": "print('</script>')"}]
    page = site.with_cells(PAGE, cells)
    (data,) = re.findall(r'id="browser-cells">(.*?)</script>', page)
    assert json.loads(data) == cells
    with pytest.raises(ValueError, match="1 cells of code, the notebook has 2"):
        site.with_cells(PAGE, cells * 2)


@built
def test_a_page_shows_the_cells_that_are_its_data():
    for path in chapters():
        page = HTML / path.relative_to(site.ROOT).with_suffix(".html")
        site.with_cells(page.read_text(encoding="utf-8"), site.cells_of(path))


def test_an_image_of_a_recording_comes_back_from_its_difference(tmp_path, monkeypatch):
    job = scripted("hard", load_rig("raised_40deg"), load_handle("coded"), 0, 1 / frames.FPS)
    folder = tmp_path / "hard"
    write_recording(job, folder, made_from(job, "hard"), progress=False, workers=1)
    images = [read_grey(folder / "images" / name / "000000.png") for name in job.rig.names]
    bench = frames.bench_of(folder)
    held = [frames.difference(image, bench, 0, k) for k, image in enumerate(images)]
    for name, one in zip(job.rig.names, held, strict=True):
        write_image(one, folder / "images" / name / "000000.png")
    monkeypatch.setattr(recording, "read_instants", recording.read_instants)
    frames.read_from(tmp_path)
    listed = recording.list_instants(folder / "images", job.rig)
    (restored,) = recording.read_instants(listed, job.rig)
    np.testing.assert_array_equal(restored, images)
    assert np.mean(np.array(held) != 0) < 0.5


def test_a_file_is_fetched_once_and_with_another_sum_refused(tmp_path, monkeypatch):
    piece = fetch.Piece("pip", "one==1", "one.whl", hashlib.sha256(b"one").hexdigest())
    monkeypatch.setattr(fetch, "PIECES", {"one": piece})
    brought = [b"something else", b"one"]

    def bring(piece: fetch.Piece, folder: Path) -> None:
        (folder / piece.file).write_bytes(brought.pop(0))

    monkeypatch.setattr(fetch, "_ask", bring)
    with pytest.raises(ValueError, match="SHA-256"):
        fetch.fetch(tmp_path)
    assert not fetch.path_of("one", tmp_path).exists()
    for _ in range(2):
        fetch.fetch(tmp_path)
    assert brought == []


@pytest.mark.parametrize(
    ("built", "here", "same"),
    [
        (1.0, 1.0009, True),
        (1.0, 1.0011, False),
        (0, 1e-9, False),
        ("inside", "inside", True),
        ("inside", "outside", False),
        (3, 3.0, True),
    ],
)
def test_numbers_agree_within_a_share_and_texts_exactly(built, here, same):
    assert numbers.agrees(built, here) is same


def test_what_is_missing_or_apart_does_not_agree():
    built = {"other": 1.0, "missing": 1.0, "pnp_mm": 1.0}
    table = numbers.compared("08_pose", built, {"other": 1.0, "pnp_mm": 1.1})
    assert table.set_index("name")["agrees"].to_dict() == {
        "other": True,
        "missing": False,
        "pnp_mm": False,
    }
    assert "1 of\n3 agree" in numbers.page_of(table)


def test_what_is_left_out_of_the_runtime_is_imported_by_nothing_that_runs_there():
    sources = [
        data.decode()
        for name, data in site._book()
        if name.endswith(".py")
        and "workbench/pages/" not in name  # these build, and do not run there
    ]
    sources += ["\n".join(cell.values()) for path in chapters() for cell in site.cells_of(path)]
    imported = {name for source in sources for name in imports(source)}
    assert "numpy" in imported
    assert not imported & set(site.LEFT_OUT.split())


def imports(source):
    """The packages that Python imports anywhere in a source."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or "").partition(".")[0]
