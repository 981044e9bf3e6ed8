"""Points of a target that other programs have found: their tables, made here and real ones, and pickles
that do more than hold numbers.
"""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from boards import SIZE, make_rig, positions
from healthy import run
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration import calibrate as calibrate_module
from trinolab.calibration.adjust import calibrate, posed
from trinolab.calibration.calibrate import calibrate_rig
from trinolab.calibration.synchrony import synchronised
from trinolab.calibration.tables import read_corners, read_lenses
from trinolab.calibration.target import Target
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_real_sets, real_set
from trinolab.files.rigs import read_rig, rig_text, write_rig

# the distances of the cameras of camera_array.toml
PUBLISHED_M = {
    "0-1": 1.6096,
    "0-2": 0.4854,
    "0-3": 0.9519,
    "1-2": 1.6547,
    "1-3": 1.1997,
    "2-3": 0.7128,
}
TARGET = Target("charuco", 8, 7, 15.0)  # 7 x 6 inner corners
COUNT = 8


def pixels():
    """Exact pixels (cameras, views, n, 2) of the target in the rig of `boards`, with 0.05 px of noise;
    some are not found.
    """
    rng = np.random.default_rng(0)
    points = np.array(TARGET.points)
    uv = np.stack(
        [
            [camera.project(T.apply(points)) for T in positions(COUNT)]
            for camera in make_rig().cameras
        ]
    )
    uv += rng.normal(0, 0.05, uv.shape)
    uv[0, 1, :10] = np.nan
    uv[1, 2] = np.nan
    return uv


def caliscope_table(uv, unit_mm=1000.0, old=False):
    camera, point = ("port", "point_id") if old else ("cam_id", "keypoint_id")
    places = np.array(TARGET.points)[:, :2] + TARGET.square_mm
    rows = [
        {
            "sync_index": 100 + v,
            camera: c,
            "frame_index": v,
            "frame_time": 0.1 * v,
            point: k,
            "img_loc_x": uv[c, v, k, 0],
            "img_loc_y": uv[c, v, k, 1],
            "obj_loc_x": places[k, 0] / unit_mm,
            "obj_loc_y": places[k, 1] / unit_mm,
        }
        for c, v, k in np.argwhere(np.isfinite(uv[..., 0]))
    ]
    return pd.DataFrame(rows)


def anipose_rows(uv):
    """As aniposelib's CharucoBoard gives them: a list a camera, a dictionary a view that was found."""
    return [
        [
            {
                "framenum": (0, 20 * v),
                "corners": view[np.isfinite(view[:, 0])].reshape(-1, 1, 2).astype(np.float32),
                "ids": np.flatnonzero(np.isfinite(view[:, 0])).reshape(-1, 1).astype(np.int32),
                "filled": view.reshape(-1, 1, 2),
            }
            for v, view in enumerate(of)
            if np.isfinite(view).any()
        ]
        for of in uv
    ]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    caliscope_table(pixels()).to_csv("xy.csv", index=False)
    Path("detections.pickle").write_bytes(pickle.dumps(anipose_rows(pixels())))
    return tmp_path


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ["xy.csv", "detections.pickle"])
def test_both_tables_give_what_was_put_in(name):
    seen = read_corners(name, TARGET, size=SIZE)
    assert seen.cameras == ("cam_0", "cam_1")
    assert seen.sizes == (SIZE, SIZE)
    assert len(seen.views) == COUNT
    # px: digits of a CSV file
    np.testing.assert_allclose(seen.uv, pixels(), rtol=0, atol=1e-9)
    assert not seen.inverted.any()
    assert not seen.mirrored.any()
    thinned = read_corners(name, TARGET, most=4, size=SIZE)
    np.testing.assert_array_equal(thinned.uv, seen.uv[:, ::2])
    assert thinned.passed_over == 4


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ["xy.csv", "detections.pickle"])
def test_a_rig_from_a_table(name, capsys):
    line = (
        f"calibrate --corners {name} --size 480 360 --board charuco --columns 8 --rows 7 --square 15 "
        "--distortions 5 --out rig.toml"
    )
    assert run(line) == 0
    assert "  cam_1: no target found in 1 of its views: " in capsys.readouterr().out
    truth = make_rig().cameras[1]
    found = read_rig("rig.toml").cameras[1]
    np.testing.assert_allclose(found.centre, truth.centre, rtol=0, atol=1.0)  # mm, of 110


@pytest.mark.usefixtures("folder")
def test_older_names_and_other_units_are_read():
    caliscope_table(pixels(), unit_mm=10.0, old=True).to_csv("old.csv", index=False)
    np.testing.assert_allclose(read_corners("old.csv", TARGET, size=SIZE).uv, pixels(), atol=1e-9)


@pytest.mark.usefixtures("folder")
def test_a_plain_table_of_points_is_read():
    rows = np.argwhere(np.isfinite(pixels()[..., 0]))
    table = pd.DataFrame(rows, columns=["camera", "view", "point"])
    table[["u", "v"]] = pixels()[tuple(rows.T)]
    table.to_csv("points.csv", index=False)
    seen = read_corners("points.csv", TARGET, size=SIZE)
    np.testing.assert_allclose(seen.uv, pixels(), atol=1e-9)
    assert (seen.times.tolist(), seen.time_unit) == (list(range(COUNT)), "frames")


@pytest.mark.usefixtures("folder")
def test_a_camera_without_a_point_is_refused():
    Path("none.pickle").write_bytes(pickle.dumps([*anipose_rows(pixels()), []]))
    with pytest.raises(ValueError, match=r"none\.pickle: has no point of one of its cameras"):
        read_corners("none.pickle", TARGET, size=SIZE)


def test_sizes_and_names_beside_a_table(folder):
    (folder / "camera_array.toml").write_text(
        "[cameras.0]\nsize = [480, 360]\n[cameras.1]\nsize = [640, 360]\n", encoding="utf-8"
    )
    assert read_corners("xy.csv", TARGET).sizes == ((480, 360), (640, 360))
    (folder / "calibration.toml").write_text(
        '[cam_0]\nname = "A"\nsize = [480, 360]\n[cam_1]\nname = "B"\nsize = [640, 360]\n',
        encoding="utf-8",
    )
    seen = read_corners("detections.pickle", TARGET)
    assert (seen.cameras, seen.sizes) == (("A", "B"), ((480, 360), (640, 360)))
    (folder / "calibration.toml").write_text('[cam_0]\nname = "A"\n', encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"calibration\.toml: has no size of camera 'cam_1'; --size"
    ):
        read_corners("detections.pickle", TARGET)


def changed(**columns):
    return caliscope_table(pixels()).assign(**columns)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("table", "target", "says"),
    [
        (
            changed(),
            Target("charuco", 8, 6, 15.0),
            "has points 0 to 41, the target .* has 35 from 0",
        ),
        (
            changed(),
            Target("charuco", 7, 8, 15.0),
            "its points lie otherwise than those of the target",
        ),
        (
            changed(),
            Target("charuco", 8, 7, 1.5),
            r"its squares have 0.015 \(15 mm if in m, 0.15 mm if in cm, 0.015 mm if in mm\), the stated "
            "target 1.5 mm",
        ),
        (changed().drop(columns="img_loc_x"), TARGET, "column 'img_loc_x' is missing"),
        (changed().drop(columns="cam_id"), TARGET, "column 'cam_id' is missing"),
        (changed(img_loc_x="left"), TARGET, "expected numbers in the columns of cameras"),
        (changed(cam_id=0), TARGET, "points of two or more cameras, at most 100, got 1"),
        (
            changed(cam_id=range(len(changed()))),
            TARGET,
            "points of two or more cameras, at most 100",
        ),
        (
            changed()[:0].assign(cam_id=pd.Series(dtype=int)),
            TARGET,
            "expected numbers in the columns|has no point",
        ),
        (changed(sync_index=1e300), TARGET, r"expected numbers up to 1e\+12"),
    ],
)
def test_a_table_of_another_target_or_form_is_named(table, target, says):
    table.to_csv("wrong.csv", index=False)
    with pytest.raises(ValueError, match=rf"^wrong\.csv: .*{says}"):
        read_corners("wrong.csv", target, size=SIZE)


@pytest.mark.usefixtures("folder")
def test_what_a_pickle_may_not_be():
    class Program:
        def __reduce__(self):
            return Path.touch, (Path("ran"),)

    wrong = {
        "program": pickle.dumps([[Program()]]),
        "text": pickle.dumps("rows"),
        "cut": pickle.dumps(anipose_rows(pixels()))[:200],
        "no pickle": b"\x89PNG",
        "long": b"\x80\x05\x96" + (2**40).to_bytes(8, "little") + b".",
        "memo": b"\x80\x05Nr\xff\xff\xff\x7f.",
    }
    for data in wrong.values():
        Path("wrong.pickle").write_bytes(data)
        with pytest.raises(ValueError, match=r"^wrong\.pickle: is not what Anipose writes"):
            read_corners("wrong.pickle", TARGET, size=SIZE)
    assert not Path("ran").exists()
    with pytest.raises(
        ValueError, match=r"has 42 points a view, the target .* has 35: likely other"
    ):
        read_corners("detections.pickle", Target("charuco", 8, 6, 15.0), size=SIZE)


@pytest.mark.usefixtures("folder")
def test_what_is_said_of_a_table_that_cannot_be_taken():
    with pytest.raises(
        ValueError, match="--size: expected width and height of the images, which no"
    ):
        read_corners("xy.csv", TARGET)
    with pytest.raises(ValueError, match=r"gone\.pickle: cannot be read"):
        read_corners("gone.pickle", TARGET, size=SIZE)
    with pytest.raises(ValueError, match=r"xy\.txt: expected a table of caliscope"):
        read_corners("xy.txt", TARGET, size=SIZE)
    with pytest.raises(ValueError, match="size: images have their own"):
        calibrate_rig({"a": "a", "b": "b"}, TARGET, "rig.toml", size=SIZE)


def test_lenses_that_cannot_be_read_are_refused_before_images_are(tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate_module, "read_views", pytest.fail)
    (tmp_path / "lenses.toml").write_text("x = \n")
    with pytest.raises(ValueError, match=r"lenses\.toml: no valid TOML"):
        calibrate_rig(
            {"a": "a", "b": "b"}, TARGET, tmp_path / "rig.toml", lenses=tmp_path / "lenses.toml"
        )


@pytest.mark.usefixtures("folder")
def test_lenses_that_are_known_are_held(capsys):
    write_rig(make_rig(), "lenses.toml")
    line = (
        "calibrate --corners xy.csv --size 480 360 --board charuco --columns 8 --rows 7 --square 15 "
        "--lenses {} --out rig.toml"
    )
    assert run(line.format("lenses.toml")) == 2
    assert (
        "lenses.toml: has no camera cam_0, which is to be calibrated (a, b)"
        in capsys.readouterr().err
    )
    named = [
        replace(camera, name=f"cam_{k}", T_cam_world=RigidTransform.identity())
        for k, camera in enumerate(make_rig().cameras)
    ]
    Path("lenses.toml").write_text(
        rig_text(Rig(tuple(replace(camera, size=(640, 360)) for camera in named))), encoding="utf-8"
    )
    assert run(line.format("lenses.toml")) == 2
    assert "camera cam_0 has 640 x 360 pixels, its images have 480 x 360" in capsys.readouterr().err
    # where the cameras of the file stand does not count, and may be one place
    Path("lenses.toml").write_text(rig_text(Rig(tuple(named))), encoding="utf-8")
    assert run(line.format("lenses.toml")) == 0
    assert "  fx / px               628.00000    fixed" in capsys.readouterr().out
    rig, truth = read_rig("rig.toml"), make_rig()
    for found, true in zip(rig.cameras, truth.cameras, strict=True):
        np.testing.assert_array_equal(found.matrix, true.matrix)
        np.testing.assert_array_equal(found.distortions, true.distortions)
    assert not rig.covariance.matrix[:, :9].any()
    off = rig.cameras[1].centre - truth.cameras[1].centre
    covariance = calibrate_rig(
        "xy.csv", TARGET, "again.toml", size=SIZE, lenses="lenses.toml"
    ).found.relative_covariance(1)
    assert (np.abs(off) < 4 * np.sqrt(np.diag(covariance)[:3])).all()
    # with the lenses known the place is known ten times better than the 1 mm above
    assert np.abs(off).max() < 0.1


def moving_table(late, path, frames=300, noise_px=0.08):
    """A table of frames 30 a second in which a hand moves the target without a stop, and the second camera
    begins some frames late; the cameras.
    """
    rng = np.random.default_rng(1)
    board = Target("chessboard", 9, 6, 20.0)
    points = np.array(board.points) - np.mean(board.points, axis=0)
    matrix = np.array([[720.0, 0, 319.5], [0, 720.0, 239.5], [0, 0, 1]])
    rows = []
    cameras = [
        replace(
            Camera.look_at(f"cam_{c}", (640, 480), 720.0, [x, 0, 0], [0, 0, 600]), matrix=matrix
        )
        for c, x in enumerate((-120.0, 120.0))
    ]
    for k in range(frames):
        for c, camera in enumerate(cameras):
            t = (60 + k + late * c) / 30
            turn = [22 * np.sin(1.1 * t), 24 * np.sin(0.83 * t + 1), 8 * np.sin(0.6 * t)]
            place = [55 * np.sin(0.7 * t), 35 * np.sin(0.93 * t + 2), 600 + 60 * np.sin(0.5 * t)]
            T = RigidTransform.from_components(
                place, Rotation.from_euler("xyz", turn, degrees=True)
            )
            uv = camera.project(T.apply(points))
            uv += rng.normal(0, noise_px, uv.shape)
            rows += [[k, c, n, *pixel] for n, pixel in enumerate(uv)]
    columns = ["view", "camera", "point", "u", "v"]
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return board, cameras


@pytest.mark.parametrize("late", [0, 1, -2, 6, 41, 0.4])
def test_a_camera_that_begins_late_is_paired_again(late, tmp_path):
    """A delay of whole frames leaves nothing; of fractions the sigma knows."""
    board, cameras = moving_table(late, tmp_path / "xy.csv")
    result = calibrate_rig(
        tmp_path / "xy.csv", board, tmp_path / "rig.toml", size=(640, 480), distortion_terms=0
    )
    truth = (cameras[1].T_cam_world * cameras[0].T_world_cam).inv()
    found = result.found.cameras[1].T_world_cam
    sigma = np.sqrt(np.diag(result.found.relative_covariance(1)))
    off = np.concatenate(
        [
            found.translation - truth.translation,
            (found.rotation * truth.rotation.inv()).as_rotvec(),
        ]
    )
    assert (np.abs(off) < 4 * sigma).all()
    assert np.linalg.norm(off[:3]) < 2.0  # mm, of 240
    again = [line for line in result.warnings if "begin at different frames" in line]
    assert len(again) == (late not in (0, 0.4))
    if again:
        assert f": cam_1 {late:+d} after cam_0" in again[0]
    if late == 0.4:
        assert result.synchrony.delays[1] == pytest.approx(late, abs=0.05)


PAIRS = ("0-1", "0-2", "0-3", "1-2", "1-3", "2-3")


def off_published(found):
    """How far the cameras' distances are from the published ones, as shares, by their pair."""
    centres = [camera.centre for camera in found.cameras]
    apart = {
        pair: np.linalg.norm(np.subtract(*(centres[int(k)] for k in pair.split("-"))))
        for pair in PAIRS
    }
    return {pair: apart[pair] / (1e3 * PUBLISHED_M[pair]) - 1 for pair in PAIRS}


@pytest.mark.parametrize("pair", PAIRS)
def test_published_baselines_of_caliscope(caliscope, pair):
    """0.81 % at most, for the last pair: its two cameras are together in 8 of the views that are used.
    With cameras that are taken for simultaneous it is off by 1.24 %.
    """
    assert abs(off_published(caliscope.found)[pair]) < 0.01


def test_cameras_that_are_not_simultaneous_are_said_to_be_so(caliscope):
    """The table's own times, of when images came to the computer, differ by 6 ms (rms) within a view."""
    assert re.match(
        r"the cameras are not simultaneous: cam_1 \+2\d\.\d ms, cam_2 \+\d.* after cam_0, and \+-9\.\d ms",
        caliscope.warnings[0],
    )


@pytest.mark.heavy
def test_left_out_views_lie_nearer_to_cameras_whose_delays_are_allowed_for(caliscope):
    """Each sixth of the views is left out of both calibrations."""
    source = real_set("caliscope")
    square = load_real_sets()["caliscope"].reference["square_mm"]
    target = Target("charuco", 4, 5, square)
    known = read_lenses(source / "camera_array.toml", caliscope.found.rig.names)
    seen = read_corners(source / "xy.csv", target)
    uv = np.where(np.isfinite(caliscope.found.residuals_px), seen.uv, np.nan)
    sizes = [camera.size for camera in known]
    count = uv.shape[1]
    every = calibrate(target.points, uv, sizes, lenses=known)
    velocity = image_velocity(every, target.points, seen.times)
    left = {"as if triggered": np.full(uv.shape, np.nan), "timed": np.full(uv.shape, np.nan)}
    for part in range(6):
        out, inside = np.arange(part, count, 6), np.delete(np.arange(count), np.s_[part::6])
        pixels = np.full_like(uv, np.nan)
        pixels[:, inside] = uv[:, inside]
        cameras = calibrate(target.points, pixels, sizes, lenses=known)
        timed, when = synchronised(target.points, pixels, cameras, seen.times, held=True)
        start = [every.T_world_target[v] for v in out]
        late = when.delays[:, None, None, None] * velocity
        left["as if triggered"][:, out] = posed(cameras, target.points, uv[:, out], start)
        left["timed"][:, out] = posed(timed, target.points, (uv - late)[:, out], start)
    rms = {name: np.sqrt(np.nanmean(of**2)) for name, of in left.items()}
    assert rms["timed"] < rms["as if triggered"]


def image_velocity(found, points, times):
    """Of the target's points, by the images of the views before and after, px/s."""
    before, after = np.arange(-1, len(times) - 1).clip(0), np.arange(1, len(times) + 1)
    after = after.clip(max=len(times) - 1)
    moved = np.array(
        [
            [camera.project(T.apply(points)) for T in found.T_world_target]
            for camera in found.cameras
        ]
    )
    return (moved[:, after] - moved[:, before]) / (times[after] - times[before])[:, None, None]


@pytest.fixture(scope="module")
def caliscope(tmp_path_factory):
    """The real table, with the lenses that caliscope has calibrated before, each camera by itself."""
    source = real_set("caliscope")
    if source is None:
        pytest.skip("no caliscope: TRINOLAB_DATA names no folder that has it")
    square = load_real_sets()["caliscope"].reference["square_mm"]
    result = calibrate_rig(
        source / "xy.csv",
        Target("charuco", 4, 5, square),
        tmp_path_factory.mktemp("caliscope") / "rig.toml",
        lenses=source / "camera_array.toml",
    )
    assert len(result.views) == 4 * 48
    assert result.found.rms_px < 0.8  # px; the cameras were not triggered together
    return result
