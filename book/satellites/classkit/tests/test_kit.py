"""The printed kit, measured in its rendered pages: bars, wraps, board; and what the command says."""

from dataclasses import replace

import cv2
import numpy as np
import pypdfium2
import pytest
from healthy import run
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.classkit.kit import make_kit
from satellites.classkit.wrap import unrolled, wrapped
from trinolab.calibration.target import find_target
from trinolab.camera import Camera
from trinolab.datasets import handle_file, load_handle
from trinolab.files.rigs import read_handle, write_handle

DPI = 300.0
PX_MM = DPI / 25.4
THICK = 0.25  # mm of label paper


def rendered(pdf):
    """Each page as grey levels, and its size, mm."""
    document = pypdfium2.PdfDocument(pdf)
    pages = [page.render(scale=DPI / 72, grayscale=True).to_numpy() for page in document]
    return [page.reshape(page.shape[:2]) for page in pages]


@pytest.fixture(scope="module")
def kit(tmp_path_factory):
    """A kit of a rod of 25 mm with markers of 6 mm, on thick paper, and its rendered pages."""
    out = tmp_path_factory.mktemp("kit") / "kit.pdf"
    printed = make_kit(handle_file("coded"), out, 25.0, 6.0, "a4", THICK)
    return printed, rendered(out)


def longest_dark(page):
    """The longest unbroken dark run of a page's rows, px."""
    longest = 0
    for row in page < 128:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        longest = max(longest, int(np.diff(edges.reshape(-1, 2), axis=1).max(initial=0)))
    return longest


def discs(page, diameter_mm):
    """Centres of the white discs in the dark ground, from left to right, mm; y points up."""
    contours, _ = cv2.findContours((page > 128).astype(np.uint8), cv2.RETR_CCOMP, 2)
    area = np.pi / 4 * (diameter_mm * PX_MM) ** 2
    found = []
    for contour in contours:
        moments = cv2.moments(contour)
        round_enough = cv2.arcLength(contour, True) ** 2 < 1.15 * 4 * np.pi * moments["m00"]
        if abs(moments["m00"] / area - 1) < 0.05 and round_enough:
            found.append([moments["m10"] / moments["m00"], -moments["m01"] / moments["m00"]])
    return np.array(sorted(found)) / PX_MM


def test_pages_have_the_size_of_the_paper_and_bars_of_100_mm(kit):
    """Both ways on the first page, and across on each."""
    printed, pages = kit
    document = pypdfium2.PdfDocument(printed.pdf)
    sizes = np.array([page.get_size() for page in document]) / 72 * 25.4
    assert len(sizes) == 4
    assert np.allclose(sizes, [210.0, 297.0], atol=0.01)
    below_the_board = pages[3][-int(25 * PX_MM) :]  # whose squares are shorter
    bars = [longest_dark(page) for page in (*pages[:3], below_the_board, pages[0].T)]
    assert np.allclose(np.array(bars) / PX_MM, 100.0, atol=0.2)


@pytest.mark.parametrize(("page", "name"), [(1, "coded"), (2, "paper")])
def test_markers_lie_on_the_wrap_where_the_handle_has_them(kit, page, name):
    _, pages = kit
    found = discs(pages[page], 6.0)
    assert len(found) == 12
    layout = load_handle(name)
    turn = np.pi * (25.0 + THICK)  # of the paper's middle, about which it bends
    degrees = np.rad2deg(layout.stated_angles)
    # the seam is halfway between 0 and 60 deg, where the first gap is
    around = (degrees - 30) % 360 / 360 * turn
    expected = np.column_stack([around, layout.stated_centres[:, 1]])
    expected = np.array(sorted(expected.round(6).tolist()))
    found = found[np.lexsort([found[:, 1], np.round(found[:, 0], 0)])]
    assert np.allclose(found - found.mean(axis=0), expected - expected.mean(axis=0), atol=0.05)
    neighbours = found[2::2, 0] - found[:-2:2, 0]
    assert np.allclose(neighbours, turn * 60 / 360, atol=0.05)


def test_the_print_is_no_mirror_image():
    """Seen from outside by a camera with the free end up, markers lie as they do on the paper."""
    handle = load_handle("coded")
    strip = unrolled(wrapped(handle))
    K = np.diag([800.0, 800.0, 1.0])
    camera = Camera("c", (640, 480), K, np.zeros(5), RigidTransform.identity())
    upside = Rotation.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]])  # y up, looking along -z
    for degrees in handle.columns_deg:
        turn = Rotation.from_euler("y", -degrees, degrees=True)
        T = RigidTransform.from_components([0.0, 0.0, 500.0], upside * turn)
        uv = camera.project(T.apply(handle.stated_centres))
        facing = np.abs((np.rad2deg(handle.stated_angles) - degrees + 180) % 360 - 180) < 61
        around, axial = strip.places[facing].T
        across = np.exp(2j * np.pi * around / strip.length_mm)  # the seam may lie between them
        around = np.angle(across / across.mean())
        assert np.corrcoef(around, uv[facing, 0])[0, 1] > 0.9
        assert np.corrcoef(axial, -uv[facing, 1])[0, 1] > 0.9


def test_board_of_the_page_is_read_by_calibrate_at_its_true_size(kit):
    printed, pages = kit
    uv = find_target(pages[3], printed.target)
    assert np.isfinite(uv).all()
    assert len(uv) == 48
    points = printed.target.points[:, :2]
    scale = np.linalg.norm(uv[-1] - uv[0]) / np.linalg.norm(points[-1] - points[0])
    assert scale / PX_MM == pytest.approx(1.0, abs=2e-3)
    # px: a similarity that keeps the board's sense, and so no mirror image
    expected = uv[0] + scale * (points - points[0])
    assert np.abs(uv - expected).max() < 1.0


def test_tabs_lift_no_marker(kit):
    printed, _ = kit
    for wrap in printed.wraps.values():
        assert len(wrap.tabs) == 2
        half = wrap.handle.marker_diameter_mm / 2
        for low, high in wrap.tabs:
            assert ((wrap.places[:, 1] + half < low) | (wrap.places[:, 1] - half > high)).all()


def test_command_writes_what_measure_reads(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    own = replace(
        load_handle("coded"), name="my rod/1", columns_deg=(0.0, 50.0, 120.0, 170.0, 240.0, 300.0)
    )
    write_handle(own, "own.toml")
    assert run("kit --handle own.toml --diameter 18 --paper letter --out k.pdf") == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert "--columns 7 --rows 9 --square 25" in out
    written = {"k.pdf", "k_my-rod-1.toml", "k_paper.toml", "own.toml"}
    assert {path.name for path in tmp_path.iterdir()} == written
    handle = read_handle("k_my-rod-1.toml")
    assert (handle.radius_mm, handle.marker_diameter_mm) == (9.1, 3.0)
    assert handle.rows_mm == own.rows_mm
    assert handle.placement_sigma_mm == 0.1
    # the same print twice is the same file
    first = (tmp_path / "k.pdf").read_bytes()
    assert run("kit --handle own.toml --diameter 18 --paper letter --out k.pdf") == 0
    assert (tmp_path / "k.pdf").read_bytes() == first


@pytest.mark.parametrize(
    ("rest", "said"),
    [
        ("--diameter 80", "coded: a wrap of 258 x 56 mm for a rod of 80 mm does not fit on the"),
        ("--diameter 4", "coded on a rod of 4 mm: columns_deg, rows_mm: markers 0 and 10 overlap"),
        ("--marker -1", "marker: expected a number in (0, 10000], got -1"),
        ("--marker 10 --diameter 20", "no column is 10.6 mm from the next one: no place for a"),
        ("--out k.txt", "k.txt: expected a name that ends in .pdf"),
        ("--out none/k.pdf", "none/k.pdf: no such folder to write into"),
    ],
)
def test_what_does_not_fit_is_one_line(tmp_path, monkeypatch, capfd, rest, said):
    monkeypatch.chdir(tmp_path)
    assert run(f"kit --handle coded --out k.pdf {rest}") == 2
    err = capfd.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_another_layout_that_does_not_fit_is_left_out_and_said(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    few = replace(
        load_handle("coded"), name="few", columns_deg=(0.0, 180.0), rows_mm=((10.0,), (10.0, -10.0))
    )
    write_handle(few, "few.toml")
    with caplog.at_level("INFO"):
        assert run("kit --handle few.toml --diameter 4 --out k.pdf") == 0
    assert "the other layout is left out: paper on a rod of 4 mm" in caplog.text
    assert len(rendered("k.pdf")) == 3
