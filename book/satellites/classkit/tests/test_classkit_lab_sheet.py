"""The lab sheet, gone through: its own commands, on what three simulated webcams would have taken.

Only `capture` is not run: the folders that it would have written are put there. The board is the
page of the printed PDF, seen by the cameras; the rod is the kit's.
"""

import re
import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pypdfium2
import pytest
from healthy import run, write_video
from pages import page_says
from scipy.spatial.transform import RigidTransform, Rotation
from setups import pose_at, shot_at
from webcams import BENCH, WEBCAMS, webcam_rig

from satellites.classkit import criteria
from satellites.classkit.criteria import GOOD, NOT_MEASURED, Criterion
from satellites.classkit.preflight import of_rig, place_of_handle
from satellites.classkit.seen import Seen
from satellites.classkit.sheets import EDGE_MM, PAPERS, board_target
from trinolab.bench.scenario import Job, take
from trinolab.datasets import load_real_sets, real_set
from trinolab.files import recording_writer
from trinolab.files.fetch import why_not
from trinolab.files.poses import read_poses, transforms, truth_table, write_poses
from trinolab.files.rigs import read_handle, read_rig
from trinolab.metrics import position_errors
from workbench.cli.arguments import parser
from workbench.studies.real_recordings import load_caliscope

PAGE = Path(__file__).resolve().parents[4] / "book" / "lab_sheet.md"
SIZE = PAPERS["a4"]
PX_MM = 6.0  # of the printed page, as it is warped into an image
SUB = 3  # samples a pixel and side
VIEWS, INSTANTS, FPS = 20, 45, 30.0


def commands():
    """What stands in the page's boxes of shell, line by line."""
    boxes = re.findall(
        r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    lines = "".join(boxes).replace("\\\n", " ").splitlines()
    return [line.removeprefix("trinolab ") for line in lines if line.startswith("trinolab ")]


def run_page(name, number=0):
    """The exit code of one of the page's lines that run a command."""
    return run([line for line in commands() if line.split()[0] == name][number])


def table_below(heading):
    """The cells of the first table that a page has below some words."""
    text = PAGE.read_text(encoding="utf-8").partition(heading)[2]
    lines = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_limits_of_the_page_are_those_of_the_command():
    known = {c.what: c for c in vars(criteria).values() if isinstance(c, Criterion)}
    rows = table_below("where they come from")
    assert len(rows) == len(known) - 1  # but for the one of images without a handle
    for what, good, usable, _ in rows:
        numbers = [re.match(r"[0-9.]+", cell) for cell in (good, usable)]
        assert float(numbers[0][0]) == known[what].good
        assert usable == "any" or float(numbers[1][0]) == known[what].usable


def test_every_command_of_the_page_is_one_that_the_program_takes():
    found = [parser().parse_args(shlex.split(line)).command for line in commands()]
    assert {"kit", "capture", "calibrate", "preflight", "track", "refine", "live"} <= set(found)


def board_views(rig, pdf, count):
    """Frames (cameras, views) of the board's page, held in front of the cameras, tilted each time
    another way.
    """
    page = pypdfium2.PdfDocument(pdf)[3].render(scale=PX_MM * 25.4 / 72, grayscale=True).to_numpy()
    page = cv2.GaussianBlur(page.reshape(page.shape[:2]), (0, 0), 1.0)
    target = board_target(SIZE)
    left = (SIZE[0] - target.columns * target.square_mm) / 2
    first = np.array([left, EDGE_MM]) + target.square_mm  # its first inner corner, from the top
    to_mm = np.array(
        [[1 / PX_MM, 0, 0.5 / PX_MM - first[0]], [0, 1 / PX_MM, 0.5 / PX_MM - first[1]], [0, 0, 1]]
    )
    rng = np.random.default_rng(5)
    place = pose_at(0.0, rig=rig).translation
    towards = place - np.mean([camera.centre for camera in rig.cameras], axis=0)
    upright = Rotation.align_vectors(
        [towards, [1.0, 0, 0]], [[0, 0, 1.0], [1.0, 0, 0]], weights=[1e6, 1]
    )[0]
    frames = [[] for _ in rig.cameras]
    for k in range(count):
        around = 2 * np.pi * k / 8
        tilt = np.deg2rad(rng.uniform(15, 32)) * np.array([np.cos(around), np.sin(around), 0])
        turn = Rotation.from_rotvec(tilt) * Rotation.from_euler(
            "z", rng.uniform(-15, 15), degrees=True
        )
        centre = place + rng.uniform([-50, -40, -40], [50, 40, 120])
        rotation = upright * turn
        T = RigidTransform.from_components(
            centre - rotation.apply(target.points.mean(axis=0)), rotation
        )
        for camera, side in zip(rig.cameras, frames, strict=True):
            side.append(printed(camera, page, to_mm, T, rng))
    return frames


def printed(camera, page, to_mm, T_world_page, rng):
    """A frame of the page: a warp with some samples a pixel, blur, noise."""
    T = camera.T_cam_world * T_world_page
    H = camera.matrix @ np.column_stack([T.rotation.as_matrix()[:, :2], T.translation]) @ to_mm
    fine = np.array([[SUB, 0, (SUB - 1) / 2], [0, SUB, (SUB - 1) / 2], [0, 0, 1.0]])
    width, height = camera.size
    shape = (SUB * width, SUB * height)
    warped = cv2.warpPerspective(page, fine @ H, shape, flags=cv2.INTER_AREA, borderValue=120)
    frame = warped.reshape(height, SUB, width, SUB).mean(axis=(1, 3)) * 0.65 + 30
    frame = cv2.GaussianBlur(frame, (0, 0), 0.7) + rng.normal(0, 1.5, frame.shape)
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8)


def captured(folder, names, frames, times, rig_file=None):
    """The folder that `capture` would have written: of the board, or of the kit's rod."""
    known = names if rig_file is None else read_rig(rig_file)
    handle = read_handle("kit_coded.toml") if folder != "board" else None
    partial = recording_writer.begin(folder, known, handle)
    for k, images in enumerate(frames):
        recording_writer.add(partial, known, k, images)
    recording_writer.finish(folder, list(times))


def rod_frames(rig, handle, count):
    """The rod at rest for some instants, then in a hand's motion; and its true poses."""
    times = np.arange(count) / FPS
    shots = [shot_at(max(t - 0.3, 0.0), 0.005 * (t > 0.3), 200.0, rig) for t in times]
    job = Job(rig, handle, shots, times, 0, BENCH)
    frames = [[take(job, k, c) for c in range(3)] for k in range(count)]
    return frames, times, RigidTransform.concatenate([shot.T_world_handle for shot in shots])


@pytest.mark.heavy
def test_from_three_webcams_to_a_tracked_handle(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    rig = webcam_rig(WEBCAMS[0])
    assert run_page("kit") == 0
    views = board_views(rig, "kit.pdf", VIEWS)
    captured("board", rig.names, zip(*views, strict=True), np.arange(VIEWS, dtype=float))

    capfd.readouterr()
    assert run_page("calibrate") == 0
    said = capfd.readouterr().out
    assert "views dropped: none" in said
    found = read_rig("rig.toml")
    baseline = np.linalg.norm(found.cameras[1].centre - found.cameras[0].centre)
    sigma = np.sqrt(np.diag(found.covariance.matrix)).reshape(3, 15)[1, 12:]
    assert baseline == pytest.approx(200.0, abs=4 * np.linalg.norm(sigma))

    handle = read_handle("kit_coded.toml")
    frames, times, truth = rod_frames(rig, handle, INSTANTS)
    captured("light", rig.names, frames[:10], times[:10])
    captured("rod", rig.names, frames, times, "rig.toml")
    shutil.copytree("rod", "slow")
    # a recording folder may have videos as well
    shutil.rmtree("rod/images")
    for name, side in zip(rig.names, zip(*frames, strict=True), strict=True):
        write_video(Path("rod", f"{name}.mkv"), side)
    assert run_page("preflight") == 0  # without a rig
    assert run_page("preflight", 1) == 0
    said = capfd.readouterr().out
    assert said.splitlines()[-1] == "the set-up is good"

    assert run_page("track") == 0
    poses = read_poses("poses.csv")
    assert set(poses["status"]) == {"measured"}
    error = position_errors(transforms(poses), truth).mean()
    # The calibration's errors are common to all poses; their own sigma knows them.
    page_says("book/lab_sheet.md", f"{INSTANTS} instants have a mean error of {error:.2f} mm")
    page_says("book/lab_sheet.md", f"`sigma_mm` ({poses['sigma_mm'].median():.2f} mm here)")
    assert error < 3 * poses["systematic_mm"].median()
    assert poses["systematic_mm"].median() < 0.31  # mm: what the sheet asks of a calibration
    write_poses(truth_table(truth), "truth.csv")
    assert run("evaluate poses.csv truth.csv --handle kit_coded.toml") == 0
    assert Path("seen.webm").stat().st_size > 10_000

    assert run_page("refine") == 0
    assert read_rig("refined/rig.toml").names == rig.names


@pytest.mark.skipif(
    real_set("caliscope") is None,
    reason=f"no caliscope: {why_not(load_real_sets()['caliscope'])}",
)
def test_the_cameras_of_a_published_session_stand_well():
    """Four webcams around a board, of which two face each other."""
    rig = load_caliscope().rig
    rows = of_rig(rig, place_of_handle(Seen(rig.names, rig, None), rig))
    assert [one["verdict"] for one in rows] == [GOOD, NOT_MEASURED]
